"""A whole system of our blocks as compiled code: the same numbers as its FMUs, some ten times as fast.

Each block runs over the whole log before the next begins, so a parameter of one block runs again only that block and those
behind it. A system has such a twin if its FMUs are ours, from this very library, and its wires form no loop.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.compare import Comparator
from cosim.compiled import CompiledBlock, compiled_block
from cosim.errors import SimulationError
from cosim.master.plan import make_plan
from cosim.ssp.system import Component, Port, Value, Wire
from fmus import registry
from fmus.build import composed_block

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Feed:
    """What an input gets.

    Attributes:
        series: (n,) values of the log, or None.
        wire: the connection, where there is no series; None too for an input that keeps its start value.
        held: the value at the START of a step counts, else that at its END.
        start: start value.
    """

    series: Array | None
    wire: Wire | None
    held: bool
    start: float


def block_of(component: Component) -> CompiledBlock | None:
    """The compiled block whose text a component's FMU runs, or None if the FMU is not ours or of another version."""
    fmu = component.fmu
    if fmu.module is None:
        return None
    script = fmu.folder / "resources" / f"{fmu.module[0]}.py"
    stem = Path(fmu.source).stem
    name = registry.FMU_OF_COMPONENT.get(stem, stem)
    if name not in registry.BLOCKS or not script.is_file():
        return None
    composed = composed_block(name, stem)
    if composed.takes_time or not script.read_text(encoding="utf-8").startswith(composed.source):
        return None
    return compiled_block(name, stem)


class Twin:
    """The part of a comparator's system that makes measured signals, compiled; driven by the command alone."""

    def __init__(self, comparator: Comparator) -> None:
        """Compile the blocks.

        Raises:
            LookupError: the system has no twin; the message says why.
        """
        self.comparator = comparator
        system = comparator.runner.system
        found = {name: block_of(component) for name, component in system.components.items()}
        foreign = [name for name, block in found.items() if block is None]
        if foreign:
            raise LookupError(
                f"{', '.join(foreign)} {'is' if len(foreign) == 1 else 'are'} not of our blocks"
            )
        inputs, hold = comparator.excitation(comparator.command)
        plan = make_plan(system, tuple(inputs), tuple(sorted(hold)), None)
        if plan.order.delayed:
            raise LookupError(f"the wires form a loop (closed by {', '.join(map(str, plan.order.delayed))})")
        self.blocks = {name: found[name] for name in plan.order.names}
        held = dict(zip(plan.series, plan.held, strict=True))
        wires = {w.target: w for w in system.wires}
        self.feeds: dict[str, list[Feed]] = {}
        for name, block in self.blocks.items():
            assert block is not None
            feeds = []
            for item in block.composed.inputs:
                port = Port(name, item)
                series = inputs[str(port)][1] if str(port) in inputs else None
                wire = None if series is not None else wires.get(port)
                late = wire is not None and system.variable(wire.source).variability == "discrete"
                feeds.append(Feed(series, wire, held.get(str(port), late), self._start(port)))
            self.feeds[name] = feeds
        self.starts = {
            name: {p: self._start(Port(name, p)) for p in block.nominal}
            for name, block in self.blocks.items()
            if block
        }
        self.kept: dict[str, tuple[tuple[float, ...], Array]] = {}

    def _start(self, port: Port) -> float:
        component = self.comparator.system.components[port.component]
        value = component.starts.get(port.variable, component.fmu.variables[port.variable].start)
        return float(value) if value is not None else 0.0

    def simulate(self, parameters: Mapping[str, Value]) -> dict[str, Array]:
        """Run driven by the command alone, as `Comparator.simulate`.

        Raises:
            UsageError: an unknown name.
            SimulationError: a result is no finite number.
        """
        comparator = self.comparator
        settings = comparator.settings({**comparator.start_values(), **parameters})
        outputs: dict[Port, Array] = {}
        fresh: set[str] = set()
        for name, block in self.blocks.items():
            assert block is not None
            own = dict(self.starts[name])
            feeds = self.feeds[name]
            starts = [f.start for f in feeds]
            for key, value in settings.items():
                component, _, variable = key.partition(".")
                if component == name and variable in own:
                    own[variable] = float(value)
                elif component == name and variable in block.composed.inputs:
                    starts[list(block.composed.inputs).index(variable)] = float(value)
            mark = (*own.values(), *starts)
            sources = {f.wire.source.component for f in feeds if f.wire is not None}
            kept = self.kept.get(name)
            if kept is None or kept[0] != mark or sources & fresh:
                rows = [self._row(f, s, outputs) for f, s in zip(feeds, starts, strict=True)]
                first = np.array([r[0] for r in rows])
                steps = np.array([r[1] for r in rows])
                kept = (mark, block.run(steps, comparator.step, own, first))
                self.kept[name] = kept
                fresh.add(name)
            outputs |= {Port(name, o): row for o, row in zip(block.composed.outputs, kept[1], strict=True)}
        bad = next((p for p, row in outputs.items() if not np.isfinite(row).all()), None)
        if bad is not None:
            raise SimulationError(f"'{bad}' is not a finite number")
        return comparator.shown_by_sensors(outputs)

    def _row(self, feed: Feed, start: float, outputs: Mapping[Port, Array]) -> tuple[float, Array]:
        """Value at initialisation, and that of each step."""
        if feed.series is not None:
            values = feed.series
        elif feed.wire is not None:
            values = feed.wire.factor * outputs[feed.wire.source] + feed.wire.offset
        else:
            values = np.full(self.comparator.time.size, start)
        return float(values[0]), values[:-1] if feed.held else values[1:]
