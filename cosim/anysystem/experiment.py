"""The next experiment for any system: the run that tells two explanations apart best, or shows what a log never exercised.

Each excitation of a menu is played on the groups one after the other, as the machine would have it: what one hands on
drives the next. Excitations keep within what the log itself reached, so that nothing is asked of a machine that it has not
done. T-optimality as for the drive (`cosim.diagnosis.answer.experiment`): the second explanation is refitted to what the
first predicts, and what then still differs, in units of the noise, counts.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import NEXT, Action
from cosim.anysystem.missing import FEWEST_RUNS
from cosim.anysystem.model import GroupModel, Segment
from cosim.anysystem.search import JITTER, NAMED, Finding
from cosim.errors import SimulationError
from cosim.files import write_text
from cosim.system.runs import Runs

if TYPE_CHECKING:
    from cosim.anysystem.pipeline import AnyDiagnosis

Array = NDArray[np.float64]
Description = dict[str, float | str | list[float]]
Series = dict[str, Array]
LONGEST = 4000  # samples of an experiment
PART = 0.3  # of the runs of FMUs that the diagnosis made: so many may be spent on the experiment
TRIED = 2  # twins of a cause for which one is looked for
NEVER_SHOWN = 8  # effects that were never exercised and that one is to show
SWEEPS = 12  # of a loop of groups, until what goes round stands
SETTLED = 1e-3  # of a signal's reach
HELD = 1e-3  # of an unknown's scale, for slopes
TELLS = 6.0  # log-likelihood from which an experiment tells two explanations apart (DIAGNOSIS.md, 7)


@dataclass(frozen=True)
class Proposal:
    """An experiment to make.

    Attributes:
        why: what it does, as it goes behind "it".
        excitation: which input, shape, amplitude and the like, in the units of the log.
        gain: log-likelihood by which it would do so.
        h: interval [s].
        inputs: signal -> (n,) what to play, in the unit of the FMU's variable.
    """

    why: str
    excitation: Description
    gain: float
    h: float
    inputs: Mapping[str, Array]


class _Spent(Exception):  # noqa: N818 - no error: the menu ends
    """As many runs were made as the experiment may take, or the time is over."""


class Rehearsal:
    """Experiments played on what was found; counts the runs that they take.

    Attributes:
        groups: that were judged, upstream first.
        looped: one of them is driven by what it or a later one hands on.
        outside: signals that come from outside, as the log has them.
        count: samples.
    """

    def __init__(self, found: "AnyDiagnosis", runs: Runs) -> None:
        self.found, self.runs = found, runs
        first = max(found.segments, key=lambda s: len(s.driving))
        self.h, self.count = first.h, min(first.count, LONGEST)
        self.log: Series = {}
        for segment in (
            first,
            *found.segments,
        ):  # what the first lacks comes from another, as far as that goes
            for n, s in {**segment.signals, **segment.driving}.items():
                self.log.setdefault(n, np.resize(s, self.count))
        self.groups = [g for g in found.groups if g.name in found.findings]
        judged = {s for g in found.groups for s, _ in g.judged}
        driving = dict.fromkeys(d.signal for g in self.groups for d in g.drives)
        late = [{s for g in self.groups[k:] for s, _ in g.judged} for k in range(len(self.groups))]
        self.looped = any(d.signal in late[k] for k, g in enumerate(self.groups) for d in g.drives)
        self.outside = {
            n: next(s.signals[n] for s in (first, *found.segments) if n in s.signals)
            for n in driving
            if n not in judged
        }
        self.allowed = max(FEWEST_RUNS, round(PART * runs.count))
        self.most = runs.count

    def allow(self, share: float) -> None:
        """What follows may take this share of the runs that the experiment may take."""
        self.most = self.runs.count + round(share * self.allowed)

    def read(self, inputs: Series, changed: Mapping[str, Mapping[str, float]]) -> Series:
        """Readings of all judged signals on inputs from outside.

        Args:
            inputs: signal -> (n,).
            changed: group -> values of its model; the others as they were found.

        Raises:
            SimulationError: a component fails, or what goes round a loop does not settle.
            _Spent: too many runs were made, or the time is over.
        """
        handed = {**self.log, **inputs}
        for _ in range(SWEEPS):
            before = dict(handed)
            readings: Series = {}
            for group in self.groups:
                if self.runs.count > self.most or self.found.budget.over:
                    raise _Spent
                finding = self.found.findings[group.name]
                segment = Segment(
                    0.0,
                    self.h,
                    handed,
                    np.ones(self.count, bool),
                    np.zeros(self.count, np.int64),
                    number=NEXT,
                )
                model = GroupModel(group, self.found.system, self.runs, [segment])
                model.base, model.loops = finding.model.base, finding.model.loops
                values = changed.get(group.name, finding.chosen.fit.values)
                ports = model.ports(values, 0)
                for signal, port in group.judged:
                    readings[signal], handed[signal] = ports[signal], ports[f"out:{port}"]
            if not all(np.isfinite(r).all() for r in readings.values()):
                raise SimulationError("an experiment leads to no finite numbers")
            moved = [
                float(np.max(np.abs(handed[s] - before[s])))
                <= SETTLED * max(float(np.ptp(self.log[s])), 1e-300)
                for s in readings
            ]
            if not self.looped or all(moved):
                return readings
        raise SimulationError("what goes round does not settle")

    def white(self, one: Series, other: Series) -> Array:
        """(n,) difference of two sets of readings in units of their noise, all signals in one row."""
        rows = []
        for finding in self.found.findings.values():
            for signal, _ in finding.model.group.judged:
                noise = finding.problem.noise[finding.model.places(signal)[0]]
                rows.append(noise.whiten(np.atleast_2d(one[signal] - other[signal]))[0])
        return np.concatenate(rows)

    def menu(self) -> Iterator[tuple[Description, Series]]:
        """Excitations of one input from outside at a time, the others at their middle; the plainest first."""
        t = np.arange(self.count) / self.count
        shapes = []
        for name, cycles, shape in (
            ("steps", 5.0, _steps), ("sine", 10.0, _sine), ("steps with rests", 10.0, _rests),
            ("triangle", 4.0, _triangle), ("steps", 20.0, _steps), ("sine", 3.0, _sine),
            ("steps with rests", 30.0, _rests), ("sine", 40.0, _sine), ("triangle", 15.0, _triangle),
        ):  # fmt: skip
            shapes.append((name, cycles, shape(cycles * t)))
        reached = {n: np.quantile(s, [0.005, 0.995]) for n, s in self.outside.items()}
        middle = {n: 0.5 * float(a + b) for n, (a, b) in reached.items()}
        for share in (1.0, 0.25):
            for name, cycles, curve in shapes:
                for signal, (low, high) in reached.items():
                    if high <= low:
                        continue
                    size = share * 0.5 * float(high - low)
                    inputs = {n: np.full(self.count, m) for n, m in middle.items()}
                    inputs[signal] = middle[signal] + size * curve
                    yield self._described(signal, name, size, middle[signal], cycles), inputs

    def _described(self, signal: str, shape: str, size: float, middle: float, cycles: float) -> Description:
        from cosim.anysystem.answer import column_scale

        unit, factor, offset = column_scale(self.found, signal)
        return {
            "input": signal,
            "shape": shape,
            "amplitude": float(f"{size / abs(factor):.4g}"),
            "middle": float(f"{(middle - offset) / factor:.4g}"),
            "unit": unit,
            "period_s": float(f"{self.count * self.h / cycles:.4g}"),
            "duration_s": float(f"{self.count * self.h:.6g}"),
        }


def _sine(turns: Array) -> Array:
    return np.asarray(np.sin(2.0 * np.pi * turns))


def _steps(turns: Array) -> Array:
    return np.where(turns % 1.0 < 0.5, 1.0, -1.0)


def _rests(turns: Array) -> Array:
    return np.asarray(_steps(turns) * (np.floor(turns) % 2 == 0))


def _triangle(turns: Array) -> Array:
    return np.asarray((2.0 / np.pi) * np.arcsin(np.sin(2.0 * np.pi * turns)))


def propose(found: "AnyDiagnosis", runs: Runs) -> Proposal | None:
    """The experiment for the first cause that has a twin in these logs, else for what they never exercised; or None."""
    if not found.findings or found.budget.over:
        return None
    rehearsal = Rehearsal(found, runs)
    if not rehearsal.outside:
        return None
    for name, action in found.causes():
        finding = found.findings[name]
        for twin, values in finding.twins.get(action, [])[:TRIED]:
            rehearsal.allow(1.0 / TRIED)
            best = _apart(rehearsal, finding, action, twin, values)
            if best is not None:
                return best
    rehearsal.allow(1.0)
    return _shown(rehearsal)


def _apart(
    rehearsal: Rehearsal, finding: Finding, action: Action, twin: Action, values: Mapping[str, float]
) -> Proposal | None:
    """The excitation that tells a cause from its twin best, the twin refitted."""
    group = finding.model.group.name
    best: Proposal | None = None
    why = f"tells {action.words} from {twin.words}, which this log cannot"
    numbers = [u for u in finding.twin_unknowns.get((action, twin), ()) if u.name in values]
    try:
        for description, inputs in rehearsal.menu():
            try:
                true = rehearsal.read(inputs, {})
                other = rehearsal.read(inputs, {group: values})
                target = rehearsal.white(true, other)
                if best is not None and 0.5 * float(target @ target) <= best.gain:
                    continue
                columns = []
                for unknown in numbers:
                    step = HELD * unknown.scale
                    if values[unknown.name] + step > unknown.high:
                        step = -step
                    moved = rehearsal.read(
                        inputs, {group: {**values, unknown.name: values[unknown.name] + step}}
                    )
                    columns.append(rehearsal.white(moved, other) / step * unknown.scale)
            except SimulationError:
                continue
            shifts = _shifts(rehearsal, other)
            rows = np.stack([*columns, *shifts], axis=1)
            prior = np.diag([1e-6] * len(columns) + [1.0 / JITTER] * len(shifts))
            aim = np.concatenate([target, np.zeros(rows.shape[1])])
            table = np.concatenate([rows, prior])
            rest = aim - table @ np.linalg.lstsq(table, aim, rcond=None)[0]
            gain = 0.5 * float(rest @ rest)
            if gain > (best.gain if best is not None else TELLS):
                best = Proposal(why, description, gain, rehearsal.h, inputs)
    except _Spent:
        pass
    return best


def _shifts(rehearsal: Rehearsal, readings: Series) -> list[Array]:
    """What a shift of each reading by a sample does, in units of its noise: the moment within an interval is unknown."""
    zero = {s: np.zeros(rehearsal.count) for s in readings}
    return [rehearsal.white({**zero, s: np.gradient(r)}, zero) for s, r in readings.items()]


def _shown(rehearsal: Rehearsal) -> Proposal | None:
    """The excitation that shows most of what the log never exercised, at a moderate size."""
    never = [(f, a, v) for f in rehearsal.found.findings.values() for a, v in f.never.items()][:NEVER_SHOWN]
    if not never:
        return None
    best: Proposal | None = None
    most = (0, 0.0)
    try:
        for description, inputs in rehearsal.menu():
            gains = []
            try:
                plain = rehearsal.read(inputs, {})
                for finding, _, size in never:
                    values = {**finding.chosen.fit.values, **size}
                    moved = rehearsal.white(rehearsal.read(inputs, {finding.model.group.name: values}), plain)
                    gains.append(0.5 * float(moved @ moved))
            except SimulationError:
                continue
            rank = sum(g > 2.0 * NAMED for g in gains), float(np.median(gains))
            if rank > most:
                names = [a.words for (_, a, _), g in zip(never, gains, strict=True) if g > 2.0 * NAMED]
                more = f" and {len(names) - 3} more" if len(names) > 3 else ""
                why = f"would show {', '.join(names[:3])}{more}, which this log could not"
                if rank[0]:
                    best = Proposal(why, description, rank[1], rehearsal.h, inputs)
                most = rank
    except _Spent:
        pass
    return best


def write_inputs(found: "AnyDiagnosis", proposal: Proposal, folder: Path) -> Path:
    """Write ``next_experiment.csv``: time and all inputs from outside, in the units of the log."""
    from cosim.anysystem.answer import column_scale

    scales = {n: column_scale(found, n) for n in proposal.inputs}
    columns = [(s - scales[n][2]) / scales[n][1] for n, s in proposal.inputs.items()]
    heading = ",".join(["time [s]", *(f"{n} [{scales[n][0]}]" for n in proposal.inputs)])
    rows = "".join(
        ",".join([f"{k * proposal.h:.9g}", *(f"{v:.9g}" for v in row)]) + "\n"
        for k, row in enumerate(np.stack(columns, axis=1).tolist())
    )
    return write_text(folder / "next_experiment.csv", f"{heading}\n{rows}")
