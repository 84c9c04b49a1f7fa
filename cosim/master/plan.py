"""The tables of one simulation: which value goes where. Both engines run over the same plan.

All numbers of a step lie in one vector ``values``: the outputs of every component in stepping order, then the system's
inputs, then copies of those discrete outputs whose value at the START of the step is needed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.master.dialect import CODES
from cosim.master.order import Order, step_order
from cosim.ssp.hints import did_you_mean
from cosim.ssp.system import NUMERIC, Port, System, Wire

Array = NDArray[np.float64]
Index = NDArray[np.int64]
References = NDArray[np.uint32]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Recorded:
    """One signal of the result: factor * source + offset, where the source is an index of ``values`` or an input series.

    Attributes:
        index: into ``values``, or -1 for an input of the system.
        series: number of the system input, or -1.
    """

    name: str
    unit_of: Port
    index: int
    series: int
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Plan:
    """Tables for the loop; component c has inputs in_start[c]..in_start[c+1] and outputs out_start[c]..out_start[c+1].

    Attributes:
        order: components in stepping order and delayed wires.
        initial: order of initialisation, all wires counted.
        in_source: index into ``values`` of each input, at the time the wire hands over.
        in_initial: the same in initialisation mode, where everything is of the same instant.
        in_kind, out_kind: the code of each one's type (`cosim.master.dialect`), 0 for Real and Float64.
        in_reals, out_reals: where the Real ones of each component end; they come first.
        snapshots: (source, copy) indices of discrete outputs.
        n_outputs, n_series: lengths of the first two parts of ``values``.
    """

    order: Order
    initial: Order
    in_start: Index
    in_source: Index
    in_initial: Index
    in_factor: Array
    in_offset: Array
    in_reference: References
    in_kind: Index
    in_reals: Index
    out_start: Index
    out_reference: References
    out_kind: Index
    out_reals: Index
    snapshots: Index
    n_outputs: int
    n_series: int
    series: tuple[str, ...]
    held: tuple[bool, ...]
    recorded: tuple[Recorded, ...]
    notes: tuple[str, ...]

    @property
    def n_values(self) -> int:
        """Length of ``values``."""
        return self.n_outputs + self.n_series + len(self.snapshots)

    def places(self) -> Index:
        """Which of ``values`` are recorded, shape (n_recorded,), increasing."""
        return np.array(sorted({r.index for r in self.recorded if r.index >= 0}), dtype=np.int64)


def make_plan(
    system: System, inputs: Sequence[str], hold: Sequence[str], record: Sequence[str] | None
) -> Plan:
    """Plan a simulation.

    Args:
        system: components and wires.
        inputs: names of the driven inputs: of the system, or ``component.variable``.
        hold: those of them that are held even if no FMU declares them discrete.
        record: names to record, or None for every output that is a number and driven input.

    Raises:
        UsageError: an unknown or unsuitable name.
    """
    return _Planner(system, inputs, hold).plan(record)


def _real_ends(start: Index, kind: Index) -> Index:
    """Where the Real entries of each component end, shape (c,)."""
    return np.array([a + int(np.sum(kind[a:b] == 0)) for a, b in pairwise(start)], dtype=np.int64)


def begins(system: System, port: Port) -> bool:
    """True if a step takes the value at its start of this input."""
    return port.variable in system.components[port.component].fmu.begins


class _Planner:
    def __init__(self, system: System, inputs: Sequence[str], hold: Sequence[str]) -> None:
        self.system, self.series, self.notes = system, tuple(inputs), list[str]()
        self.driven: dict[Port, tuple[int, Wire]] = {}
        for k, name in enumerate(inputs):
            for wire in self.targets(name):
                if wire.target in self.driven:
                    raise UsageError(
                        f"input {wire.target} is driven twice: by '{inputs[self.driven[wire.target][0]]}' and '{name}'"
                    )
                self.driven[wire.target] = k, wire
        self.wires = [w for w in system.wires if w.target not in self.driven]
        for wire in system.wires:
            if wire.target in self.driven:
                self.notes.append(f"input {wire.target} follows the given series instead of {wire.source}")
        for name in [n for n in hold if n not in inputs and n not in system.inputs and n != "u"]:
            raise UsageError(f"hold names '{name}', which is no driven input{did_you_mean(name, inputs)}")
        self.held = tuple(n in hold or self.declared_discrete(k) for k, n in enumerate(inputs))
        fmus = {c.name: c.fmu for c in system.components.values()}
        self.late = {w for w in self.wires if system.variable(w.source).variability == "discrete"}
        self.order = step_order(fmus, [w for w in self.wires if w not in self.late])
        # what an input takes at the start of a step comes from the step before, loop or not
        delayed = self.order.delayed
        self.late |= {w for w in self.wires if begins(system, w.target) and w not in delayed}
        self.initial = step_order(fmus, self.wires)
        self.notes += [
            f"connection {w} closes a loop and carries last step's value" for w in self.order.delayed
        ]

    def targets(self, name: str) -> tuple[Wire, ...]:
        """The component inputs that a driven name feeds."""
        if name in self.system.inputs:
            return self.system.inputs[name].targets
        component, _, variable = name.partition(".")
        if component in self.system.components:
            found = self.system.components[component].fmu.variables.get(variable)
            if found is not None and found.causality == "input" and found.kind in NUMERIC:
                return (Wire(Port("", name), Port(component, variable)),)
        known = list(self.system.inputs) + [
            f"{c.name}.{v.name}"
            for c in self.system.components.values()
            for v in c.fmu.variables.values()
            if v.causality == "input"
        ]
        raise UsageError(f"there is no input '{name}' that takes numbers{did_you_mean(name, known)}")

    def declared_discrete(self, k: int) -> bool:
        ports = [target for target, (j, _) in self.driven.items() if j == k]
        return bool(ports) and all(self.system.variable(p).variability == "discrete" for p in ports)

    def plan(self, record: Sequence[str] | None) -> Plan:
        names = self.order.names
        outputs: dict[Port, int] = {}
        bounds = [0]
        wanted = self.wanted(record)
        # getting costs as much as setting: only what is recorded or wired
        ports = set(wanted.values()) | {wire.source for wire in self.wires}
        for name in names:
            fmu = self.system.components[name].fmu
            # those that are Real first: they are read in one call
            for variable in sorted(fmu.variables.values(), key=lambda v: CODES.get(v.type, -1) != 0):
                port = Port(name, variable.name)
                if port in ports and variable.kind in NUMERIC and variable.causality != "input":
                    outputs[port] = len(outputs)
            bounds.append(len(outputs))
        late = sorted({outputs[w.source] for w in self.late})
        copies = {source: len(outputs) + len(self.series) + d for d, source in enumerate(late)}
        rows = [row for name in names for row in self.inputs_of(name, outputs, copies)]
        counts = [sum(1 for row in rows if row[0] == name) for name in names]
        in_start = np.cumsum([0, *counts], dtype=np.int64)
        in_kind = np.array([self.kind(row[4].target) for row in rows], dtype=np.int64)
        out_kind = np.array([self.kind(p) for p in outputs], dtype=np.int64)
        return Plan(
            order=self.order,
            initial=self.initial,
            in_start=in_start,
            in_kind=in_kind,
            in_reals=_real_ends(in_start, in_kind),
            out_kind=out_kind,
            out_reals=_real_ends(np.array(bounds, dtype=np.int64), out_kind),
            in_reference=np.array([row[1] for row in rows], dtype=np.uint32),
            in_source=np.array([row[2] for row in rows], dtype=np.int64),
            in_initial=np.array([row[3] for row in rows], dtype=np.int64),
            in_factor=np.array([row[4].factor for row in rows], dtype=np.float64),
            in_offset=np.array([row[4].offset for row in rows], dtype=np.float64),
            out_start=np.array(bounds, dtype=np.int64),
            out_reference=np.array([self.system.variable(p).reference for p in outputs], dtype=np.uint32),
            snapshots=np.array(late, dtype=np.int64),
            n_outputs=len(outputs),
            n_series=len(self.series),
            series=self.series,
            held=self.held,
            recorded=tuple(self.recorded(name, port, outputs) for name, port in wanted.items()),
            notes=tuple(self.notes),
        )

    def inputs_of(
        self, name: str, outputs: Mapping[Port, int], copies: Mapping[int, int]
    ) -> list[tuple[str, int, int, int, Wire]]:
        """(component, reference, source, source in initialisation, wire) of each driven or connected input."""
        rows = []
        for target, (k, wire) in self.driven.items():
            if target.component == name:
                index = len(outputs) + k
                rows.append((name, self.system.variable(target).reference, index, index, wire))
        for wire in self.wires:
            if wire.target.component == name:
                now = outputs[wire.source]
                index = copies[now] if wire in self.late else now
                rows.append((name, self.system.variable(wire.target).reference, index, now, wire))
        return sorted(rows, key=lambda row: self.kind(row[4].target) > 0)

    def kind(self, port: Port) -> int:
        """The code of a variable's type."""
        return CODES[self.system.variable(port).type]

    def wanted(self, record: Sequence[str] | None) -> dict[str, Port]:
        """What to record: the variable behind each name (a driven system input has no component)."""
        if record is None:
            found = {
                f"{c.name}.{v.name}": Port(c.name, v.name)
                for c in self.system.components.values()
                for v in c.fmu.variables.values()
                if v.causality == "output" and v.kind in NUMERIC
            }
            return found | {name: Port("", name) for name in self.series}
        return {name: self.port(name) for name in record}

    def port(self, name: str) -> Port:
        if name in self.series:
            return Port("", name)
        if name in self.system.outputs:
            return self.system.outputs[name]
        component, _, variable = name.partition(".")
        if component in self.system.components:
            found = self.system.components[component].fmu.variables.get(variable)
            if found is not None and found.kind in NUMERIC:
                return Port(component, variable)
            if found is not None:
                raise UsageError(f"'{name}' is of type {found.kind}: only numbers can be recorded")
        known = [f"{c.name}.{v}" for c in self.system.components.values() for v in c.fmu.variables]
        raise UsageError(
            f"there is no variable '{name}' to record{did_you_mean(name, [*known, *self.system.outputs])}"
        )

    def recorded(self, name: str, port: Port, outputs: Mapping[Port, int]) -> Recorded:
        if not port.component:
            wires = self.targets(name)
            return Recorded(name, wires[0].target if wires else port, -1, self.series.index(name))
        if port in outputs:
            return Recorded(name, port, outputs[port], -1)
        if port in self.driven:
            k, wire = self.driven[port]
            return Recorded(name, port, -1, k, wire.factor, wire.offset)
        for wire in self.wires:
            if wire.target == port:
                return Recorded(name, port, outputs[wire.source], -1, wire.factor, wire.offset)
        raise UsageError(f"input '{name}' is not connected, so it is constant: nothing to record")
