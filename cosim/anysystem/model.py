"""One group of a system as a function values -> signals: driven by what was measured, its FMUs run, effects at its ports."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import PARAMETER, acted, in_log, placed
from cosim.anysystem.smooth import followed
from cosim.compare.metrics import noise_floor
from cosim.inference.problem import ABOUT
from cosim.ssp.fmu import promises_initial_outputs
from cosim.ssp.system import Port, System
from cosim.system.graph import CutGroup, Unit, together
from cosim.system.runs import Runs

Array = NDArray[np.float64]
SHIFT = "shift"
HOLD = "hold"
DRIVE = "drive"


@dataclass(frozen=True)
class Quantity:
    """What drives a group in place of a reading.

    Attributes:
        series: number of a log -> (n,); in the others its reading drives.
        slopes: for each number that made it of the reading, the same: what one standard deviation of it changes.
    """

    series: Mapping[int, Array]
    slopes: list[dict[int, Array]] = field(default_factory=list)


@dataclass(frozen=True)
class Loop:
    """What is run together with a component, since it depends on what that then does.

    Attributes:
        component: its name in `Runs`; it has an input ``u`` in the place of the component's, and an output ``y``.
        moved: output of the component that it reads.
        settings: its parameters that are no finding.
    """

    component: str
    moved: Port
    settings: Mapping[str, float]


@dataclass
class Segment:
    """One log on a uniform grid.

    Attributes:
        start: first stamp [s].
        h: interval [s].
        signals: measured name -> (n,), in the unit of the FMU's variable.
        driving: the same made smooth, for what they drive.
        number: of the log.
        fitted: (n,) mask of what fits use.
        windows: (n,) number of the window, over all segments.
        recorded: the signals (m,) as they were read, where that was not on this grid.
        stamps: (m,) where these are, in intervals from the start.
        steps: signals whose values hold until the next sample.
        missing: signal -> (n,) True in a pause, or where a value was missing; only signals that have such places.
    """

    start: float
    h: float
    signals: dict[str, Array]
    fitted: NDArray[np.bool_]
    windows: NDArray[np.int64]
    driving: dict[str, Array] = field(default_factory=dict)
    number: int = 0
    recorded: dict[str, Array] = field(default_factory=dict)
    stamps: Array = field(default_factory=lambda: np.zeros(0))
    steps: frozenset[str] = frozenset()
    missing: dict[str, NDArray[np.bool_]] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Samples."""
        return int(self.fitted.size)

    def reading(self, signal: str) -> Array:
        """(m,) a signal as it was read: straight lines between uneven stamps hide its steps and repeated samples."""
        return self.recorded.get(signal, self.signals[signal])

    def noise(self, signal: str) -> float:
        """Standard deviation of the noise of a signal as it was read, as `cosim compare` tells it."""
        every = float(np.median(np.diff(self.stamps))) if self.stamps.size else 1.0
        return noise_floor(self.reading(signal), every * self.h)

    def known(self, signal: str) -> NDArray[np.bool_]:
        """(n,) True where a signal was read, and not filled in a pause or a missing value."""
        return ~self.missing.get(signal, np.zeros(self.count, dtype=np.bool_))

    def at_stamps(self, series: Array) -> Array:
        """(m,) a series (n,) of the grid where the log was read."""
        return np.interp(self.stamps, np.arange(series.size), series) if self.stamps.size else series

    def on_grid(self, held: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) the place whose value each sample of the grid holds, from the reading (m,) that each reading repeats."""
        if not self.stamps.size:
            return held
        last = np.searchsorted(self.stamps, np.arange(self.count), side="right") - 1
        own = np.minimum(np.rint(self.stamps[held]).astype(np.int64)[last.clip(0)], np.arange(self.count))
        return np.where(held[last.clip(0)] < last, own, np.arange(self.count))


def place(signal: str, segment: int) -> str:
    """Name of a signal in one of several logs."""
    return f"{signal}#{segment}"


class GroupModel:
    """The model of one group.

    Attributes:
        group: what is between the cuts, with all that any of the logs measured.
        segments: the logs.
        cuts: the group as each log cuts it, in their order.
        base: values that hold unless a call says otherwise: ``component.parameter`` of free parameters.
        trusted: ``component.parameter`` -> (value, standard deviation) of those whose deviations values may hold.
        held: signal -> for each log the places whose values its samples hold, where some are stale.
        steps: signal -> step of a reading that is rounded: what differs by less than half of it is not seen.
        drives: signal -> what drives instead of the reading.
        off: signal -> (first, last, size): by how much it is taken to be off in this part of each log.
        added: ``port|where`` -> for each log what is added there, behind the effects.
        loops: ``port|where`` -> effect -> what is run with the component for it.
        until: part of each log that is run; what was measured stands for the rest.
        spared: readings for which that stands as a whole.
        own: signals by which the group is judged and which drive it as well.
        late: judged signals that an FMU need not have calculated before its first step.
        differs: signal -> RMS by which two runs of the same differ; empty before that was tried.
        coarse: signal -> RMS error of the model's own solvers, from a run in which they work more finely.
    """

    def __init__(
        self,
        group: CutGroup,
        system: System,
        runs: Runs,
        segments: Sequence[Segment],
        cuts: Mapping[int, CutGroup] | None = None,
    ) -> None:
        self.system, self.runs, self.segments = system, runs, list(segments)
        self.cuts = [(cuts or {}).get(s.number, group) for s in segments]
        self.group = group if all(c == group for c in self.cuts) else seen_by(group, self.cuts)
        group = self.group
        self.base: dict[str, float] = {}
        self.trusted: dict[str, tuple[float, float]] = {}
        self.drives: dict[str, Quantity] = {}
        self.steps: dict[str, float] = {}
        self.off: dict[str, tuple[float, float, float]] = {}
        self.added: dict[str, list[Array]] = {}
        self.loops: dict[str, dict[str, Loop]] = {}
        self.held: dict[str, dict[int, NDArray[np.int64]]] = {}
        self.differs: dict[str, float] = {}
        self.coarse: dict[str, float] = {}
        self.until = 1.0
        self.spared: frozenset[str] = frozenset()
        judged = {signal for signal, _ in group.judged}
        self.own = frozenset(d.signal for d in group.drives if d.signal in judged)
        self.late = frozenset(
            signal
            for signal, port in group.judged
            if not promises_initial_outputs(system.components[port.component].fmu)
        )

    def judging(self, signal: str) -> list[int]:
        """The logs that judge the group by a signal."""
        return [k for k, own in enumerate(self.cuts) if any(s == signal for s, _ in own.judged)]

    def places(self, signal: str) -> list[str]:
        """Names of a signal in the logs that judge by it."""
        return [place(signal, k) for k in self.judging(signal)]

    def before(self, signal: str, k: int) -> frozenset[str]:
        """What leads to a signal in a log, as `ports` calls it, without inputs that its own reading drives.

        What follows a reading holds its noise, and would tell it.
        """
        group = self.cuts[k]
        leads = {port.component for s, port in group.judged if s == signal}
        while more := {w.source.component for w in group.inner if w.target.component in leads} - leads:
            leads |= more
        ends = [(d.port, d.signal) for d in group.drives] + [(w.target, "") for w in group.inner]
        outputs = [*(w.source for w in group.inner), *(p for _, p in group.judged)]
        found = [f"in:{p}" for p, by in ends if p.component in leads and by != signal]
        return frozenset(found + [f"out:{p}" for p in outputs if p.component in leads])

    def whole(self, series: Mapping[str, Array], signal: str) -> Array:
        """A signal's series of all logs that judge by it, behind one another, where it was read."""
        return np.concatenate([series[name] for name in self.places(signal)])[self.known(signal)]

    def known(self, signal: str) -> NDArray[np.bool_]:
        """Where a signal was read in all logs that judge by it, behind one another."""
        return np.concatenate([self.segments[k].known(signal) for k in self.judging(signal)])

    def measured(self, signal: str) -> Array:
        """What was read of a signal in all logs that judge by it, behind one another."""
        logs = [self.segments[k] for k in self.judging(signal)]
        return np.concatenate([log.signals[signal][log.known(signal)] for log in logs])

    def __call__(self, values: Mapping[str, float]) -> dict[str, Array]:
        """The judged signals of all logs, `place`(signal, k) -> (n,)."""
        found = dict[str, Array]()
        for k, own in enumerate(self.cuts):
            names = {place(signal, k): signal for signal, _ in own.judged}
            if names.keys() <= self.spared:
                found |= {name: self.segments[k].signals[signal] for name, signal in names.items()}
                continue
            series = self.ports(values, k)
            for signal, _ in own.judged:
                seen = self.seen(signal, k, series[signal])
                found[place(signal, k)] = np.concatenate(
                    [seen, self.segments[k].signals[signal][seen.size :]]
                )
        return found

    def count(self, k: int) -> int:
        """Samples of a log that are run."""
        return max(int(np.ceil(self.until * self.segments[k].count)), 2)

    @contextmanager
    def first(self, part: float) -> Iterator[dict[str, int]]:
        """Within this only the first part of each log is run: reading -> how many samples of it."""
        self.until = part
        try:
            yield {
                place(signal, k): self.count(k) for k, own in enumerate(self.cuts) for signal, _ in own.judged
            }
        finally:
            self.until = 1.0

    @contextmanager
    def sparing(self, names: Collection[str]) -> Iterator[None]:
        """Within this a log is not run of which all judged readings are among these."""
        before, self.spared = self.spared, frozenset(names)
        try:
            yield
        finally:
            self.spared = before

    def seen(self, signal: str, k: int, series: Array) -> Array:
        """A modelled reading (n,) as far as what was measured tells.

        Within half a step of a rounded reading nothing does, nor in a pause, nor where the FMU did not promise a value.
        """
        segment = self.segments[k]
        reading = segment.signals[signal][: series.size]
        if signal in self.late:
            series = np.concatenate([reading[:1], series[1:]])
        if signal in segment.missing:
            series = np.where(segment.missing[signal][: series.size], reading, series)
        if signal not in self.steps:
            return series
        half = 0.5 * self.steps[signal]
        return np.asarray(reading + series - np.clip(series, reading - half, reading + half))

    def ports(self, values: Mapping[str, float], k: int) -> dict[str, Array]:
        """Readings of the judged signals, and what leaves (``out:port``) and enters (``in:port``) each component.

        A reading may be wrong and drive its own group: what it drives then gets the quantity before the reading, as the
        model has it, brought slowly to the log. Where that goes round through the group, by what the first round gave.
        """
        everything = in_log({**self.base, **values}, self.segments[k].number)
        places = placed(everything)
        found = self._round(everything, places, k, {})
        wrong = [s for s, port in self.cuts[k].judged if s in self.own and f"{port}|sensor" in places]
        if not wrong:
            return found
        ports = dict(self.cuts[k].judged)
        quantities = {}
        for s in wrong:
            reading = self.segments[k].signals[s][: found[s].size]
            quantities[s] = followed(found[f"out:{ports[s]}"], reading - found[s])
        return self._round(everything, places, k, quantities)

    def _about(self, everything: Mapping[str, float]) -> dict[str, float]:
        """Trusted parameters that values have moved beside the causes."""
        moved = {n: everything.get(f"{ABOUT}{PARAMETER}|{n}") for n in self.trusted}
        return {n: self.trusted[n][0] + v * self.trusted[n][1] for n, v in moved.items() if v is not None}

    def _round(
        self,
        everything: Mapping[str, float],
        places: Mapping[str, Mapping[str, Mapping[str, float]]],
        k: int,
        quantities: Mapping[str, Array],
    ) -> dict[str, Array]:
        """One run of all units, some drives being these quantities (n,) instead of readings."""
        segment, group = self.segments[k], self.cuts[k]
        h = segment.h
        parameters = self._about(everything)
        parameters |= {n.split("|")[1]: v for n, v in everything.items() if n.startswith(PARAMETER)}
        parameters |= {n: v for n, v in everything.items() if "|" not in n and ":" not in n}
        found: dict[str, Array] = {}
        entering: dict[Port, Array] = {}
        early: dict[Port, float] = {}
        for drive in group.drives:
            series = self._driving(drive.signal, k, everything, quantities)
            ends = f"{drive.signal}>{drive.port}"
            shift = everything.get(f"{SHIFT}:{ends}", 0.0) + everything.get(f"{HOLD}:{ends}", 0.0)
            series = series[: self.count(k)]
            whole = round(shift)
            early[drive.port] = shift - whole
            if whole:
                series = series[np.clip(np.arange(series.size) + whole, 0, series.size - 1)]
            if (drive.factor, drive.offset) != (1.0, 0.0):
                series = drive.factor * series + drive.offset
            entering[drive.port] = self._acted(series, k, drive.port, "input", places)
        judged = {port for _, port in group.judged}
        for unit in group.units:
            wanted = tuple(
                dict.fromkeys(
                    [*self._leaving(unit, group), *(p for p in judged if p.component in unit.components)]
                )
            )
            inputs = {
                p: self._held(p, s, early.get(p, 0.0))
                for p, s in entering.items()
                if p.component in unit.components
            }
            if not wanted:
                continue
            loops = self._loops(unit, places)
            if loops:
                outputs = self._looped(unit, loops, segment.start, h, inputs, wanted, parameters)
            elif inputs:
                outputs = self.runs.run(unit, segment.start, h, inputs, wanted, parameters)
            else:
                outputs = self.runs.free_run(unit, segment.start, h, self.count(k), wanted, parameters)
            for port, series in outputs.items():
                found[f"pure:{port}"] = series
                series = self._acted(series, k, port, "output", places)
                found[f"out:{port}"] = series
                for wire in group.inner:
                    if wire.source == port and wire.target.component not in unit.components:
                        handed = wire.factor * series + wire.offset
                        entering[wire.target] = self._acted(handed, k, wire.target, "input", places)
        for port, series in entering.items():
            found[f"in:{port}"] = series
        for signal, port in group.judged:
            reading = acted(found[f"out:{port}"], h, port, "sensor", places)
            found[signal] = reading[self.held[signal][k][: reading.size]] if signal in self.held else reading
        return found

    def _loops(
        self, unit: Unit, places: Mapping[str, Mapping[str, Mapping[str, float]]]
    ) -> dict[Port, tuple[Loop, dict[str, float]]]:
        """What acts in a loop with components of a unit: port -> what it is, and its numbers; nothing where these are 0."""
        found = {}
        for place, loops in self.loops.items():
            port = Port(*place.partition("|")[0].split(".", 1))
            for effect, loop in loops.items():
                numbers = places.get(place, {}).get(effect, {})
                if port.component in unit.components and any(numbers.values()):
                    found[port] = loop, dict(numbers)
        return found

    def _looped(
        self,
        unit: Unit,
        loops: Mapping[Port, tuple[Loop, dict[str, float]]],
        start: float,
        h: float,
        inputs: Mapping[Port, Array],
        wanted: tuple[Port, ...],
        parameters: Mapping[str, float],
    ) -> dict[Port, Array]:
        """A run of a unit with what acts in a loop with it; superposition holds in none of these."""
        parts = [*(loop.component for loop, _ in loops.values()), *unit.components]
        own = {
            f"{loop.component}.{n}": v
            for loop, numbers in loops.values()
            for n, v in {**loop.settings, **numbers}.items()
        }
        before = {Port(loops[p][0].component, "u") if p in loops else p: s for p, s in inputs.items()}
        with self.runs.exact():
            return self.runs.run(Unit(tuple(parts)), start, h, before, wanted, {**parameters, **own})

    def _acted(
        self,
        series: Array,
        k: int,
        port: Port,
        where: str,
        places: Mapping[str, Mapping[str, Mapping[str, float]]],
    ) -> Array:
        """A series behind the effects at a port, and what is added there."""
        found = acted(series, self.segments[k].h, port, where, places)
        added = self.added.get(f"{port}|{where}")
        return found if added is None else found + added[k][: found.size]

    def _driving(
        self, signal: str, k: int, values: Mapping[str, float], quantities: Mapping[str, Array]
    ) -> Array:
        segment = self.segments[k]
        series = segment.driving.get(signal, segment.signals[signal])
        if signal in quantities:
            series = quantities[signal]
        elif signal in self.drives:
            series = self.drives[signal].series.get(segment.number, series)
            for i, slope in enumerate(self.drives[signal].slopes):
                if (value := values.get(f"{DRIVE}:{signal}:{i}", 0.0)) and segment.number in slope:
                    series = series + value * slope[segment.number]
        if signal in self.off:
            first, last, size = self.off[signal]
            place = np.arange(series.size) / series.size
            series = series + size * ((place >= first) & (place < last))
        return series

    def _held(self, port: Port, series: Array, early: float = 0.0) -> Array:
        """What an input is set to in each step: the mean of the values at its two ends, so that a held input is not early.

        `early` from -0.5 to 0.5 samples shifts the weight to one of them: at -0.5 a step holds what was measured at its
        start, which is what a controller of the log's own rate does. So it is with what is true or false, or a whole number.
        """
        variable = self.system.variable(port)
        if variable.kind != "Real":
            return series
        found = series.copy()
        found[1:] = (0.5 + early) * series[1:] + (0.5 - early) * series[:-1]
        if variable.variability == "discrete":  # the master hands over its value at the START of a step
            found[:-1] = found[1:].copy()
        return found

    @staticmethod
    def _leaving(unit: Unit, group: CutGroup) -> list[Port]:
        return [
            w.source
            for w in group.inner
            if w.source.component in unit.components and w.target.component not in unit.components
        ]

    def looped(self, port: Port) -> bool:
        """Whether a port's wire lies within a loop that is stepped as one, where no effect can be put on a series."""
        return any(
            port in (wire.source, wire.target)
            and wire.source.component in unit.components
            and wire.target.component in unit.components
            for own in self.cuts
            for unit in own.units
            for wire in own.inner
        )


def seen_by(group: CutGroup, cuts: Sequence[CutGroup]) -> CutGroup:
    """A group with all that several logs measure of it."""
    return replace(together(cuts), units=group.units)
