"""A group of blocks simulated over a log, again and again with other parameters."""

from collections.abc import Mapping
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import CompiledBlock, CompiledPair, compiled_block
from cosim.diagnosis.model.groups import COMPONENT_VALUES, Group
from cosim.diagnosis.record.grid import Grid, Pieces, cuts_of, of_piece, plain_name
from fmus.contract import Variable

Array = NDArray[np.float64]

INSIDE = ("spool_0", "p_load_0")  # parameters of the state at the start that a slew sensor does not read


def compiled_stage(component: str, block: str) -> CompiledBlock:
    """The compiled block of a component."""
    return compiled_block(block, component)


@cache
def parted(name: str) -> tuple[str, str]:
    """Component and parameter of ``component.parameter``; kept, because each of thousands of runs asks for all."""
    component, _, parameter = name.partition(".")
    return component, parameter


def standing(start: Mapping[str, float], settings: Mapping[str, float]) -> dict[str, float]:
    """The state at the start, SI, of which these are the sensor's readings; its gain and bias are settings.

    What starts inside the drive (a spool, a pressure) no slew sensor reads: it stays as it is.
    """
    gain, bias = settings.get("sensor.gain", 1.0), settings.get("sensor.bias", 0.0)
    found = {}
    for name, reading in start.items():
        parameter = plain_name(name).rpartition(".")[2]
        if parameter in INSIDE:
            found[name] = reading
        elif gain == 0.0:  # a sensor that shows nothing says nothing of the start
            found[name] = 0.0
        else:
            found[name] = (reading if parameter == "omega_0" else reading - bias) / gain
    return found


class GroupModel:
    """A group simulated over a log, again and again with other parameters.

    Args:
        group: the blocks.
        drive: (n,) the driving signal, SI, one value a sample.
        h: interval between samples, s.
        fixed: ``component.parameter`` -> SI of everything that differs from nominal and is not estimated; a start angle is
            what the sensor reads there.
        grid: the stamps of the samples and the finer steps, or those of several logs, each of which is simulated by itself;
            None where each sample is a step.
    """

    def __init__(
        self,
        group: Group,
        drive: Array,
        h: float,
        fixed: dict[str, float] | None = None,
        grid: Grid | Pieces | None = None,
    ) -> None:
        self.group = group
        self.grid = grid
        self.drive = np.ascontiguousarray(drive, dtype=np.float64)
        self.h = h
        self.fixed = COMPONENT_VALUES | (fixed or {})
        self.stages = [(c, compiled_stage(c, b)) for c, b in group.stages]
        self.pair: tuple[int, CompiledPair] | None = None  # place of the first of two that feed back
        if group.loop is not None:
            at = group.components.index(group.loop[0])
            self.pair = at, CompiledPair(self.stages[at][1], self.stages[at + 1][1])
        self.kept: dict[int, tuple[tuple[float, ...], Array]] = {}
        self.driving: Array | None = None  # the drive at the steps
        self.begins = [*(n for n, _ in group.starts), *(f"{c}.omega_0" for c, _ in self.stages)]
        self.parts: list[GroupModel] = []
        if isinstance(grid, Pieces):
            drives = np.split(self.drive, grid.cuts)
            each = zip(drives, grid.intervals, grid.grids, strict=True)
            self.parts = [
                GroupModel(group, own, step, of_piece(self.fixed, i), finer)
                for i, (own, step, finer) in enumerate(each)
            ]

    def nominal(self, name: str) -> float:
        """Value of ``component.parameter`` before anything is estimated."""
        if name in self.fixed:
            return self.fixed[name]
        component, _, parameter = name.partition(".")
        for found, block in self.stages:
            if found == component:
                return block.nominal[parameter]
        slot = self.group.upstream_slot
        if slot and slot[0] == component:
            return compiled_stage(slot[0], slot[1]).nominal[parameter]
        raise KeyError(name)

    def copy(self) -> "GroupModel":
        """The same with runs of its own to remember, for another thread."""
        made = GroupModel(self.group, self.drive, self.h, self.fixed, self.grid)
        made.driving = self.driving
        return made

    def in_steps(self, grid: Grid) -> "GroupModel":
        """The same, simulated in other steps."""
        return GroupModel(self.group, self.drive, self.h, self.fixed, grid)

    def declared(self, name: str) -> Variable:
        """Declaration of ``component.parameter``."""
        component, _, parameter = name.partition(".")
        return dict(self.stages)[component].composed.parameters[parameter]

    def trust(self, name: str, tolerance: float) -> tuple[float, float, float]:
        """Standard deviation of the trust in a nominal value, lowest and highest estimate, SI."""
        value, variable = self.nominal(name), self.declared(name)
        if value > 0.0:
            by = 1e3 if tolerance > 1.0 else 10.0  # beyond 1 not even its order of magnitude is known
            return value * tolerance, max(value / by, variable.low), min(value * by, variable.high)
        # zero or negative: the value itself says little about its size
        scale = dict(self.group.scale)
        typical = variable.nominal * scale.get(name, scale.get(variable.unit, 1.0))
        return max(abs(value), typical) * tolerance, variable.low, variable.high

    def simulate(self, values: dict[str, float]) -> dict[str, Array]:
        """Predicted signals, (n,) each, SI, with ``component.parameter`` -> value replaced."""
        if self.parts:
            settings = self.fixed | values
            each = [part.simulate(of_piece(settings, i)) for i, part in enumerate(self.parts)]
            return {s: np.concatenate([found[s] for found in each]) for s in each[0]}
        return self.alone(values)

    def alone(self, values: dict[str, float]) -> dict[str, Array]:
        """Predicted signals of one log, (n,) each, SI."""
        settings = self.fixed | values
        settings |= standing({n: settings[n] for n in self.begins if n in settings}, settings)
        signal = self.fed(settings)
        h = self.h
        if isinstance(self.grid, Grid):
            signal, h = self.stepped(signal), self.grid.step
        changed = False
        rows: list[Array] = []
        owned: dict[str, dict[str, float]] = {component: {} for component, _ in self.stages}
        for name, value in settings.items():
            component, parameter = parted(name)
            if component in owned:
                owned[component][parameter] = value
        for i, (component, block) in enumerate(self.stages):
            own = owned[component]
            key = tuple((block.nominal | own).values())
            if i == 0 and self.group.upstream_slot:
                prefix = self.group.upstream_slot[0] + "."
                key += tuple(sorted(v for n, v in settings.items() if n.startswith(prefix)))
            if self.pair is not None and i == self.pair[0]:
                behind, other = self.stages[i + 1]
                key += tuple((other.nominal | owned[behind]).values())
            kept = self.kept.get(i)
            if self.pair is not None and i == self.pair[0] + 1:
                outputs = self.kept[i][1]  # it ran with the one before
            elif kept is not None and kept[0] == key and not changed:
                outputs = kept[1]
            else:
                # a held drive acts from the start of a step, a continuous one is known at its end
                steps = signal[:-1] if i == 0 and self.group.held else signal[1:]
                changed = True
                if self.pair is not None and i == self.pair[0]:
                    others = owned[self.stages[i + 1][0]]
                    outputs, fed_back = self.pair[1].run(steps, h, own, others, float(signal[0]))
                    self.kept[i + 1] = (key, fed_back)
                else:
                    outputs = block.run(steps[None, :], h, own, signal[:1])
                if i + 1 < len(self.stages):
                    self.kept[i] = (key, outputs)
            rows.append(outputs)
            signal = outputs[0]
        return self.observed(rows)

    def stepped(self, signal: Array) -> Array:
        """The drive at the steps of the grid; the measured one is the same in every run."""
        if not isinstance(self.grid, Grid):
            return signal
        if signal is not self.drive:
            return self.grid.driven(signal, self.group.held)
        if self.driving is None:
            self.driving = self.grid.driven(signal, self.group.held)
        return self.driving

    @property
    def cuts(self) -> tuple[int, ...]:
        """First sample of each log but the first."""
        return cuts_of(self.grid)

    @property
    def step_cuts(self) -> tuple[int, ...]:
        """First step of the simulation of each log but the first."""
        return self.grid.step_cuts if isinstance(self.grid, Pieces) else ()

    @property
    def step(self) -> float:
        """Interval of the simulation, s."""
        return self.h if self.grid is None else self.grid.step

    def inside(self, component: str, signal: str, values: dict[str, float]) -> Array | None:
        """(n,) a signal between two stages, SI, step by step, with these values; None where there is none."""
        if self.parts:
            settings = self.fixed | values
            rows = [
                part.inside(component, signal, of_piece(settings, i)) for i, part in enumerate(self.parts)
            ]
            found = [row for row in rows if row is not None]
            return np.concatenate(found) if found else None
        self.simulate(values)
        for i, (name, block) in enumerate(self.stages):
            outputs = block.outputs
            if name == component and signal in outputs and i in self.kept:
                return np.asarray(self.kept[i][1][outputs.index(signal)])
        return None

    def fed(self, settings: dict[str, float]) -> Array:
        """The drive as the first block feels it."""
        slot = self.group.upstream_slot
        if slot is None:
            return self.drive
        component, block, equation = slot
        own = {n.partition(".")[2]: v for n, v in settings.items() if n.startswith(component + ".")}
        compiled = compiled_stage(component, block)
        if all(own.get(name, v) == v for name, v in compiled.nominal.items()):
            return self.drive
        memory = compiled.module.Memory(*([0.0] * len(compiled.module.Memory._fields)))
        return np.asarray(
            getattr(compiled.module, f"over_{equation}")(self.drive, memory, compiled.parameters(own))
        )

    @cached_property
    def shown(self) -> list[tuple[str, list[tuple[int, int, float]]]]:
        """Each measured signal, and of what it is the sum: place of the stage and of its output, factor."""
        names = dict(enumerate(block.outputs for _, block in self.stages))
        at = {f"{self.stages[i][0]}.{n}": (i, k) for i, own in names.items() for k, n in enumerate(own)}
        last = len(self.stages) - 1
        at |= {n: (last, k) for k, n in enumerate(names[last])}
        parts = dict(self.group.parts)
        # what the sensors show, which is not always what the next block feels
        each = {s: parts.get(s, ((s, 1.0),)) for s in self.group.observed}
        return [(s, [(*at[output], factor) for output, factor in own]) for s, own in each.items()]

    def observed(self, rows: list[Array]) -> dict[str, Array]:
        """Measured signals from the outputs of each stage."""
        found = {}
        for signal, ((stage, output, factor), *more) in self.shown:
            values = rows[stage][output] if factor == 1.0 else factor * rows[stage][output]
            for stage, output, factor in more:
                values = values + factor * rows[stage][output]
            found[signal] = values if self.grid is None else self.grid.sampled(values)
        return found
