"""Runs a system of FMUs on a log, whole and block by block, as often as asked."""

import dataclasses
from collections.abc import Iterable, Mapping
from functools import cached_property, partial
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from cosim.compare.binding import BEGINS, SPEED, bind, cut_signals, measured_value, start_values
from cosim.compare.mapping import CompareTable
from cosim.compare.metrics import noise_floor, score
from cosim.compare.outcome import BlockOutcome, Comparison, SignalOutcome
from cosim.compare.prepare import first_value, on_grid
from cosim.compare.recording import WHOLE, Recording
from cosim.compare.wiring import Group, Upstream, groups, separating, upstream
from cosim.errors import DataError, UsageError
from cosim.inference.beginning import level, speed
from cosim.logs.log import Log
from cosim.master import Runner
from cosim.master.inputs import Series
from cosim.signals import SIGNALS
from cosim.ssp.hints import did_you_mean
from cosim.ssp.read import read_system, resolve, settable_names
from cosim.ssp.stated import assumed_si, constants, variables, with_units
from cosim.ssp.system import Port, System, Value

Array = NDArray[np.float64]


class Comparator:
    """A log and a system, ready to be compared with one set of parameters after the other; a context manager.

    Attributes:
        log: on a uniform step.
        step: [s].
        bindings: what each signal of the model stands for, in the log or not.
        measured: those that the log holds.
        notes: what was done to the log, and what is left out.
        constants: ``component.variable`` -> what the table says of parameters and of inputs that were not measured.
    """

    def __init__(
        self,
        log: Log,
        source: Path | System,
        *,
        table: CompareTable | None = None,
        step: float | None = None,
        parameter_set: str | None = None,
    ) -> None:
        """Load the system and prepare the log.

        Args:
            log: measured.
            source: an .ssp or .fmu file, or a System (which the caller closes).
            table: which variable each signal stands for, beyond the known names.
            step: communication step [s]; by default that of the log.
            parameter_set: name of the only ParameterSet to apply.

        Raises:
            ModelError, SimulationError: the system is bad or cannot be instantiated.
            DataError, UsageError: the table or step does not fit; log and model have no signal in common.
        """
        table = table or CompareTable()
        self.log, self.step, self.notes = on_grid(log, step)
        self.notes += [*dict.fromkeys(table.aside.values()), *table.notes]
        self.time: Array = np.arange(len(self.log), dtype=np.float64) * self.step
        stamps = self.log.time[0] + self.time
        # the same numbers, unless the step was given: held once
        self._stamps = self.log.time if np.array_equal(stamps, self.log.time) else stamps
        self.time = self._stamps if np.array_equal(self.time, self._stamps) else self.time
        self.system = source if isinstance(source, System) else read_system(source, parameter_set)
        self._owned = None if isinstance(source, System) else self.system
        try:
            wrong = with_units(self.system, table.units)
            self.constants, more = constants(self.system, table.constant)
            if wrong := wrong + more:
                raise DataError("; ".join(wrong))
            self.bindings = bind(self.system, self.log.units, table)
            self.measured = tuple(name for name in self.bindings if name in self.log)
            driven = {wire.target for name in self.measured for wire in self.bindings[name].wires}
            for name in table.constant:
                if driven & set(variables(self.system, name)):
                    raise DataError(f"constant '{name}': it is measured: leave it out")
            self.notes += self._without_unit(table)
            self.starts = start_values(self.system, table, self.bindings)
            self._check(table.aside)
            self.runner = Runner(self._needed(), many=True)
        except BaseException:
            self._close_system()
            raise
        # as measured, before any resampling
        self.floors = {n: noise_floor(log[n], log.step) for n in self.measured}

    def close(self) -> None:
        """Free the FMUs; safe to call twice."""
        self.runner.close()
        self._close_system()

    def _close_system(self) -> None:
        if self._owned is not None:
            self._owned.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def command(self) -> tuple[str, ...]:
        """Measured signals that nothing in the model makes."""
        return tuple(name for name in self.measured if self.bindings[name].command)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Measured signals that the model makes."""
        return tuple(name for name in self.measured if not self.bindings[name].command)

    def simulate(self, parameters: Mapping[str, Value] | None = None) -> dict[str, Array]:
        """Run the system once, driven by the command alone.

        Args:
            parameters: ``component.variable`` -> start value (SI); start angles follow the log unless given here.

        Returns:
            signal -> simulated values (n,) in the signal's SI unit.

        Raises:
            UsageError: an unknown name.
            SimulationError: an FMU failed.
        """
        recorded = self._run(parameters or {}, self.command)
        return {name: self._shown(name, recorded, WHOLE) for name in self.outputs}

    def run(self, parameters: Mapping[str, Value] | None = None) -> Comparison:
        """Compare: the whole driven by the command, then every block by what was measured.

        Args:
            parameters: ``component.variable`` -> start value (SI).

        Raises:
            UsageError: an unknown name.
            SimulationError: an FMU failed.
        """
        given = {**self.constants, **(parameters or {})}
        notes: list[str] = []
        lacking = {name: self.missing(name) for name in self.outputs}
        possible = [name for name, missing in lacking.items() if not missing]
        whole = self._run(given, self.command) if possible else Recording((), 0)
        signals = {name: self._outcome(name, whole, free_offset=False) for name in possible}
        if len(possible) < len(lacking):
            names = ", ".join(sorted({repr(m) for missing in lacking.values() for m in missing}))
            notes.append(f"the log has no {names}: what follows from it cannot be simulated from the command")
        cut = cut_signals(self.measured, self.bindings, lambda p: whole.read(str(p)), possible, notes)
        found, not_judged = groups(self.system, self.bindings, self.measured, cut)
        single = self._run(given, cut) if found else Recording((), 0)
        for group in found:
            for name, (before, behind) in separating(
                self.system, self.bindings, self.measured, group
            ).items():
                pair = f"{before.component} and {behind.component}"
                notes.append(f"'{name}' is not measured, so {pair} are judged together")
        return Comparison(
            log=self.log,
            model=self.system.name,
            step=self.step,
            time=self._stamps,
            command=self.command,
            signals=signals,
            blocks=[self._block(group, single) for group in found],
            not_judged=not_judged,
            parameters={**self.start_values(), **given},
            notes=[*self.notes, *self._assumed(given), *notes],  # by now with what the runs had to say
        )

    def _assumed(self, given: Mapping[str, Value]) -> list[str]:
        """What to say of inputs that the log does not hold, of FMUs that run without."""
        ports = dict.fromkeys(p for n in self.outputs for p in self._upstream(n, self.command).assumed)
        ports = {p: None for p in ports if str(p) not in self.constants}
        shown = []
        for port in ports:
            starts = self.system.components[port.component].starts
            value = given.get(str(port), starts.get(port.variable, self.system.variable(port).start))
            told = str(value).lower() if isinstance(value, bool) else value
            shown.append(f"{port} ({told:g})" if isinstance(told, float) else f"{port} ({told})")
        text = f"assumed: inputs that were not measured stay as they start: {', '.join(shown)}"
        return [text] if shown else []

    def missing(self, name: str) -> tuple[str, ...]:
        """Inputs of the model that the log would need to hold for this signal to follow from the command."""
        return self._upstream(name, self.command).missing

    # Helpers

    def _check(self, aside: Iterable[str]) -> None:
        if not self.outputs:
            raise DataError(
                f"{self.log.source}: the log holds nothing that '{self.system.name}' simulates: it holds "
                f"{', '.join(self.log.signals)}, the model {', '.join(self.bindings) or 'no known signal'}; a mapping's "
                "table [compare] says which variable a signal stands for"
            )
        parts = {*aside, *({"p_a", "p_b"} if "p_load" in self.bindings else ())}
        left = [name for name in self.log.signals if name not in self.bindings and name not in parts]
        if left:
            self.notes.append(f"'{self.system.name}' has no {', '.join(left)}: not compared")

    def _without_unit(self, table: CompareTable) -> list[str]:
        """What to say of measured signals whose FMU states no unit."""
        shown = []
        for name in self.measured:
            binding = self.bindings[name]
            ports = [binding.port] if binding.port else [wire.target for wire in binding.wires]
            stated = name in table.signals and table.signals[name].factor is not None
            if ports and not stated and not any(self.system.variable(p).unit for p in ports):
                shown.append((name, self.log.display[name]))
        told = assumed_si(shown)
        return [told] if told else []

    def _needed(self) -> System:
        """The part of the system that makes a measured signal: the rest would only cost time."""
        ways = [self._upstream(name, self.command) for name in self.outputs]
        names = {component for way in ways for component in way.components}
        return dataclasses.replace(
            self.system,
            components={name: c for name, c in self.system.components.items() if name in names},
            wires=tuple(w for w in self.system.wires if {w.source.component, w.target.component} <= names),
            inputs={},
            outputs={},
            parameters={},
            notes=[],
            folder=None,
        )

    def _upstream(self, name: str, cut: tuple[str, ...]) -> Upstream:
        return upstream(self.system, self.bindings[name], self.bindings, cut)

    def start_values(self) -> dict[str, float]:
        """Start parameter -> value (SI), from the first samples of the signal it starts with."""
        values = {}
        for parameter, name in self.starts.items():
            if name in self.log:
                drives = [self.log[n] for n in self.command]
                first, moving = first_value(self.log[name], self.log.valid_mask(name), drives, self.step)
                values[parameter] = first * self.bindings[name].gain
                note = f"'{name}' already moves when the log begins, but the model starts at rest: judge it later"
                if moving and not self._begins_moving and note not in self.notes:
                    self.notes.append(note)
        return values | self._begun

    @cached_property
    def _begun(self) -> dict[str, float]:
        """Start values (SI) beyond angles of a log that begins in motion: velocity, spool, load pressure."""
        found: dict[str, float] = {}
        for name, component in self.system.components.items():
            for parameter, signal in BEGINS.items():
                binding = self.bindings.get(signal)
                if parameter not in component.fmu.variables or binding is None or signal not in self.log:
                    continue
                if parameter == SPEED:
                    found[f"{name}.{parameter}"] = binding.gain * speed(self.log.time, self.log[signal])
                elif binding.port is not None and binding.port.component == name:
                    found[f"{name}.{parameter}"] = binding.gain * level(self.log[signal], self.log.step)
        return found if any(found.values()) else {}

    @property
    def _begins_moving(self) -> bool:
        return any(name.endswith(SPEED) for name in self._begun)

    def excitation(self, drive: tuple[str, ...]) -> tuple[dict[str, tuple[Array, Array]], list[str]]:
        """What measured signals put on the inputs of the components.

        Args:
            drive: names of the signals.

        Returns:
            ``component.input`` -> (times [s], values), (n,) each, in the FMU's unit; and those that are held over a step.
        """
        inputs: dict[str, tuple[Array, Array]] = {}
        hold: list[str] = []
        for name in drive:
            binding = self.bindings[name]
            for wire in binding.wires:
                target = str(wire.target)
                if wire.target.component not in self.runner.system.components:
                    continue
                factor, values = wire.factor * binding.gain, self.log[name]
                if (factor, wire.offset) != (1.0, 0.0):  # the log's own array where it is the same
                    values = factor * values + wire.offset
                inputs[target] = (self.time, values)
                if name in self.log.held or (name in SIGNALS and SIGNALS[name].held):
                    hold.append(target)
        return inputs, hold

    def _run(self, parameters: Mapping[str, Value], drive: tuple[str, ...]) -> Recording:
        """What the components put out (by the port's name) when these signals drive the model."""
        given, hold = self.excitation(drive)
        inputs: dict[str, Series] = dict(given)
        ports = {port for n in self.outputs for port, _ in self.bindings[n].parts}
        ports |= {p for n in self.outputs if (p := self.bindings[n].port) is not None}
        names = [str(port) for port in sorted(ports)]
        recording = Recording(names, len(self.time))
        result = self.runner.run(
            float(self.time[-1]),
            self.step,
            parameters=self.settings({**self.start_values(), **self.constants, **parameters}),
            inputs=inputs,
            hold=hold,
            record=names,
            sink=recording.put,
        )
        for message in result.messages:
            if message not in self.notes:
                self.notes.append(message)
        return recording

    def settings(self, parameters: Mapping[str, Value]) -> dict[str, Value]:
        """Start values of the components that run, under the components' own names.

        Raises:
            UsageError: a name is unknown.
        """
        settings: dict[str, Value] = {}
        for name, value in parameters.items():
            ports = resolve(self.system, name)
            if not ports:
                raise UsageError(
                    f"there is no '{name}' to set{did_you_mean(name, settable_names(self.system))}"
                )
            settings |= {str(p): value for p in ports if p.component in self.runner.system.components}
        return settings

    def shown_by_sensors(self, recorded: Mapping[Port, Array]) -> dict[str, Array]:
        """Signal -> what its sensors show (n,) [SI], from the components' outputs."""
        return {name: measured_value(self.bindings[name], recorded.__getitem__) for name in self.outputs}

    def _shown(self, name: str, recorded: Recording, part: slice) -> Array:
        """What a signal's sensors show in a part of the log [SI]."""
        return measured_value(self.bindings[name], lambda port: recorded.read(str(port), part))

    def _block(self, group: Group, recorded: Recording) -> BlockOutcome:
        outcomes = {name: self._outcome(name, recorded, free_offset=True) for name in group.signals}
        return BlockOutcome(group.name, group.components, group.driven_by, outcomes)

    def _outcome(self, name: str, recorded: Recording, *, free_offset: bool) -> SignalOutcome:
        drifts = name in self.starts.values()
        measured, simulated = self.log[name], self._shown(name, recorded, WHOLE)
        valid, floor = self.log.valid_mask(name), self.floors[name]
        free = free_offset and drifts
        rated = score(measured, simulated, self._stamps, valid, floor, drifts=drifts, free_offset=free)
        return SignalOutcome(name, rated, self.log, partial(self._shown, name, recorded))
