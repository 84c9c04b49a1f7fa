"""The diagnosis of any system, on one page: cut, drive each group by what was measured, name, ask the neighbours."""

import math
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import PARAMETER, Action, acted, each, in_log, placed
from cosim.anysystem.cuts import Cuts, cut_by_logs, lacking, signals_of
from cosim.anysystem.experiment import Proposal, propose
from cosim.anysystem.friction import EFFECT, rubs
from cosim.anysystem.missing import Missing, allowed, missing
from cosim.anysystem.model import HOLD, GroupModel, Quantity, Segment, place
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.read import Recording, begun, value_of
from cosim.anysystem.readings import stale_of
from cosim.anysystem.search import (
    CLOSE,
    MOST_COARSE,
    Candidate,
    Finding,
    Search,
    Trust,
    errors,
    extended,
    worth,
)
from cosim.anysystem.smooth import followed, still
from cosim.anysystem.start import settable
from cosim.anysystem.stretch import PROBES, head, lengths, most_samples, part_of
from cosim.anysystem.thin import ENOUGH, LITTLE, SAME, alike, factors, loses, share, thinned
from cosim.compare.metrics import rms
from cosim.diagnosis.budget import Budget
from cosim.diagnosis.thresholds import FEWEST_SAMPLES, WORSE_ELSEWHERE
from cosim.errors import DataError, OutOfTimeError, SimulationError
from cosim.inference.problem import Problem
from cosim.logs.log import whole_interval
from cosim.ssp.system import NUMERIC, Port, System, Value
from cosim.system.effects import EFFECTS
from cosim.system.graph import CutGroup, measured_ports, port_of
from cosim.system.runs import Runs
from cosim.system.structure import Structure, structure

Array = NDArray[np.float64]
Watch = Callable[[str], None]
WINDOWS = 30  # a log is cut into, of which every third is held out
SHOWN = 10  # inputs that a sentence lists
SEARCHED = 0.85  # of the time allowed, until which groups are judged
GRACE = 0.05  # of it: beyond its stage a run may take so much, since what was begun mostly ends soon,
BRIEFLY = 2.0  # s, and all together at least so much: a few short runs tell how a model is as it is
AS_GOOD = 2.0  # times a reading's noise: a model that leaves no more of it takes the reading's place
LEAST_GAIN = 0.05  # below it a reading holds more noise than signal
UNEVEN = 0.01  # of an interval
PAUSED = 0.01  # of a log: shorter pauses need no word
WHOLLY = 0.999  # of a limit: rounding apart it is reached
FAR = 5.0  # spreads of a reading by which a model errs that is in another unit, or runs away
NO_LOGS: tuple[frozenset[int], frozenset[int]] = (frozenset(), frozenset())
SAID = 3e-3  # of a signal's spread: what a finer solver changes of it is said


@dataclass
class AnyDiagnosis:
    """Everything that was found.

    Attributes:
        system: the model.
        logs: as read; those held out last.
        segments: the same on uniform grids.
        cuts: how they cut the system.
        findings: by name of the group.
        where: cause -> where it is, once its neighbours were asked: input, output or sensor.
        structure: what the graph alone can tell apart.
        votes: cause -> group driven by the reading -> what it gains if the quantity drives it.
        undecided: cause -> other places at which it would look the same.
        unjudged: group -> why.
        held: how many of the logs, the last ones, are held out.
        notes: what the user should know.
        advice: those of the notes that say what to correct before anything else.
        budget: the time allowed, and what was left out for it.
        stage: what goes on.
        proposal: the next experiment.
        span: first and last stamp of the part of a single log that is used, s; None for all of it, or of several logs.
        stated: ``component.variable`` -> what the mapping says of parameters and of inputs that were not measured.
        only: group -> numbers of the logs in which its causes are, where others show that they are not there; and of these.
        missing: group that stays wrong -> where what is missing enters; None where nobody can tell.
        runs, steps: runs of units and communication steps made.
    """

    system: System
    logs: list[Recording]
    segments: list[Segment]
    cuts: Cuts
    findings: dict[str, Finding] = field(default_factory=dict)
    where: dict[tuple[str, Action], str] = field(default_factory=dict)
    undecided: dict[tuple[str, Action], list[str]] = field(default_factory=dict)
    unjudged: dict[str, str] = field(default_factory=dict)
    held: int = 0
    votes: dict[tuple[str, Action], dict[str, float]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    advice: list[str] = field(default_factory=list)
    verdict: str = ""
    structure: Structure = field(default_factory=lambda: Structure((), ()))
    runs: int = 0
    steps: int = 0
    budget: Budget = field(default_factory=Budget)
    stage: str = ""
    proposal: Proposal | None = None
    missing: dict[str, Missing | None] = field(default_factory=dict)
    only: dict[str, tuple[frozenset[int], frozenset[int]]] = field(default_factory=dict)
    stated: dict[str, Value] = field(default_factory=dict)
    span: tuple[float, float] | None = None

    @property
    def groups(self) -> tuple[CutGroup, ...]:
        """What is judged together."""
        return self.cuts.groups

    def causes(self) -> list[tuple[str, Action]]:
        """Group and cause, the one that explains most first."""
        found = [(name, a) for name, f in self.findings.items() for a in f.named]
        return sorted(found, key=lambda item: -self.findings[item[0]].gains.get(item[1], 0.0))


def segments_of(logs: Sequence[Recording], held: int) -> tuple[list[Segment], list[str]]:
    """The logs on uniform grids, in windows of which every third is held out, or with whole logs held out.

    Raises:
        DataError: a log is too short.
    """
    found, notes, number = [], list[str](), 0
    for k, log in enumerate(logs):
        count = log.time.size
        if count < FEWEST_SAMPLES:
            raise DataError(
                f"{log.source}: the log has {count} samples; a diagnosis needs at least {FEWEST_SAMPLES}: "
                "record longer, or faster"
            )
        intervals = np.diff(log.time)
        h = float(f"{np.median(intervals):.12g}")
        signals, recorded, stamps = log.signals, dict[str, Array](), np.zeros(0)
        missing = dict(log.missing)
        if float(np.max(np.abs(intervals - h))) > UNEVEN * h:
            recorded, stamps = dict(signals), (log.time - log.time[0]) / h
            grid = log.time[0] + h * np.arange(int(np.floor((log.time[-1] - log.time[0]) / h + 1e-9)) + 1)
            before = np.searchsorted(log.time, grid + 1e-6 * h, side="right") - 1
            missing = unread(log, grid, h)
            signals = {
                n: v[before] if n in log.held else np.interp(grid, log.time, v) for n, v in signals.items()
            }
            count = grid.size
            notes.append(f"{log.source}: uneven intervals: brought to {h:g} s by straight lines")
            notes += paused(log, missing)
        else:  # the mean interval: a median of rounded stamps would drift off them
            h = whole_interval(float(f"{np.mean(intervals):.12g}"), count)
        windows = np.minimum(np.arange(count) * WINDOWS // count, WINDOWS - 1) + number
        number += WINDOWS
        fitted = np.full(count, k < len(logs) - held) if held else windows % 3 != 1
        found.append(
            Segment(
                float(log.time[0]),
                h,
                dict(signals),
                fitted,
                windows.astype(np.int64),
                number=k,
                recorded=recorded,
                stamps=stamps,
                steps=log.held,
                missing=missing,
            )
        )
    return found, notes


def unread(log: Recording, grid: Array, h: float) -> dict[str, NDArray[np.bool_]]:
    """Signal -> (n,) True at points of a grid [s] within a pause, or beside a missing value; only signals that have such."""
    last = log.time.size - 1
    before = np.searchsorted(log.time, grid + 1e-6 * h, side="right") - 1
    after = np.minimum(np.searchsorted(log.time, grid - 1e-6 * h, side="left"), last)
    inside = np.zeros(grid.size, dtype=np.bool_)
    for start, stop in log.gaps:
        inside |= (log.time[before] <= start) & (log.time[after] >= stop)
    none = np.zeros(log.time.size, dtype=np.bool_)
    found = {}
    for name in log.signals:
        lost = log.missing.get(name, none)
        found[name] = inside | lost[before] | (lost[after] & (name not in log.held))
    return {name: mask for name, mask in found.items() if mask.any()}


def paused(log: Recording, missing: Mapping[str, NDArray[np.bool_]]) -> list[str]:
    """What to say of a log with pauses: nothing is judged there, and what drives the model is guessed."""
    if not log.gaps or not missing:
        return []
    share = float(
        np.mean(np.logical_and.reduce([missing.get(n, np.zeros(1, dtype=np.bool_)) for n in log.signals]))
    )
    if share < PAUSED:
        return []
    return [
        f"{log.source}: pauses ({len(log.gaps)}) make {100 * share:.2g} % of the time: the model runs through them as if "
        "its inputs went on evenly, and is not judged there; if they moved, diagnose the parts as logs of their own"
    ]


def segments_for(found: AnyDiagnosis, group: CutGroup) -> list[Segment]:
    """The logs that judge a group, or a part of it; windows of each are held out where none of them is as a whole."""
    own = [s for s in found.segments if s.number in found.cuts.own[group.name]]
    return windowed(own) if all(s.fitted.all() for s in own) else own


def windowed(segments: Sequence[Segment]) -> list[Segment]:
    """The same logs, with every third window of each held out."""
    return [replace(s, fitted=s.windows % 3 != 1) for s in segments]


def apart_from(found: AnyDiagnosis) -> list[str]:
    """What to say of signals that not all logs have."""
    used = {n for g in found.groups for n in signals_of(g)}
    notes = []
    for name in dict.fromkeys(n for log in found.logs for n in log.signals if n not in used):
        without = [log.source.name for log in found.logs if name not in log.signals]
        if without:
            notes.append(
                f"{name} is left aside: {listed(without)} {'lacks' if len(without) == 1 else 'lack'} it"
            )
    for k, (log, segment) in enumerate(zip(found.logs, found.segments, strict=True)):
        apart, joined = lacking(found.cuts, log, k)
        if apart:
            names = list(dict.fromkeys(n for lost in apart.values() for n in lost))
            notes.append(
                f"{log.source.name} lacks {listed(names)}: it takes no part where {listed(list(apart))} "
                f"{'is' if len(apart) == 1 else 'are'} judged"
                + ("" if segment.fitted.any() else ", and windows of the others are held out there")
            )
        notes += [
            f"{log.source.name} lacks {listed(lost)}: it judges {listed(parts)} as one"
            for parts, lost in joined
        ]
    return notes


def diagnose_system(
    system: System,
    logs: Sequence[Recording],
    runs: Runs,
    options: AnyOptions,
    *,
    held: int = 0,
    tolerance: float = 0.01,
    calibrate: bool = False,
    watch: Watch = lambda text: None,
    budget: Budget | None = None,
) -> AnyDiagnosis:
    """Judge every group of a system, and say where each cause is.

    Args:
        system: the model.
        logs: of one machine; the last `held` of them are held out.
        runs: its FMUs.
        options: what the mapping says.
        held: see `logs`.
        tolerance: relative standard deviation of trusted parameters for which the mapping gives none.
        calibrate: trusted parameters are fitted freely.
        watch: told about each stage.
        budget: the time it may take; then the best so far stands, and what was not tried is kept there.

    Raises:
        DataError: nothing can be judged.
        SimulationError: a component cannot be run as it is.
    """
    cuts = cut_by_logs(system, logs, held)
    names, groups = cuts.names, cuts.groups
    segments, notes = segments_of(logs, held)
    found = AnyDiagnosis(system, list(logs), segments, cuts, held=held, notes=notes, stated=options.given)
    found.notes += apart_from(found)
    found.budget = budget or found.budget
    found.structure = structure(system, names, tuple(options.trusted))
    trust = Trust(tolerance=tolerance)
    for name, own in options.trusted.items():
        value = value_of(system, name) or 0.0
        if calibrate:
            trust.free[name] = value
        else:
            trust.trusted[name] = (value, own or tolerance)
    for name in options.free:
        trust.free[name] = value_of(system, name) or 0.0
    theirs = [own for group in groups for own in cuts.own[group.name].values()]
    runs.load(list(dict.fromkeys(unit for own in theirs for unit in own.units)))
    runs.stop, runs.left = found.budget.end, lambda: found.budget.left(GRACE, BRIEFLY)
    found.budget.allow(SEARCHED)
    whole = list(logs)
    with suppress(OutOfTimeError):  # said of each group
        thin(found, runs, trust, options, SAME)
        within_time(found, runs, trust, options)
    found.notes += sparser(found)
    for segment in found.segments:
        for name in segment.signals.keys() & set(names):
            segment.driving[name] = still(segment.signals[name])
    with found.budget.searching():
        for k, group in enumerate(groups):
            found.budget.allow(SEARCHED * (k + 1) / len(groups))
            if found.budget.ended and group.judged:
                found.unjudged[group.name] = found.budget.why
                continue
            found.stage = f"judging {group.name}"
            try:
                judge(found, group, runs, trust, options, watch)
            except OutOfTimeError:
                found.unjudged[group.name] = too_slow(found, group, runs)
        found.budget.allow(1.0)
        found.stage = found.stage if found.budget.ended else "asking the neighbours"
        for name in list(found.findings):
            try:
                locate(found, name, trust, options)
            except OutOfTimeError:
                found.budget.leave_out(name, "whether a cause is of the output or of its reading")
    if not found.findings and found.budget.ended:
        raise KeyboardInterrupt
    if not found.findings:
        reasons = "; ".join(f"{g}: {why}" for g, why in found.unjudged.items())
        raise DataError(f"no component can be judged: {reasons}")
    found.verdict = verdict_of(found)
    with suppress(OutOfTimeError, SimulationError):
        found.notes += over_the_rest(found, whole, runs, options)
    found.stage = found.stage if found.budget.ended else "looking for the next experiment"
    with found.budget.searching():
        most = allowed(runs)
        try:
            for name, finding in found.findings.items():
                if finding.unexplained and not found.budget.over:
                    found.missing[name] = missing(
                        finding.model, finding.problem, finding.chosen.fit.values, finding.spreads, most
                    )
            found.proposal = propose(found, runs)
        except OutOfTimeError:
            found.budget.leave_out("the system", "what is missing, and the next experiment")
    runs.left = lambda: math.inf
    found.runs, found.steps = runs.count, runs.steps
    return found


def too_slow(found: AnyDiagnosis, group: CutGroup, runs: Runs) -> str:
    """Why nothing is known of a group: the time was over before its model as it is had been run as often as it takes."""
    units = {unit for own in found.cuts.own[group.name].values() for unit in own.units}
    times = [runs.took.get(unit.components, 0.0) for unit in units]
    one = f"; one run of it takes {sum(times):.2g} s" if sum(times) > 0.0 else ""
    return (
        f"{found.budget.why} before it could be judged{one}, and a diagnosis makes hundreds of runs: allow more "
        "time (--budget), or take a shorter log or one with fewer samples"
    )


def whole_outputs(found: AnyDiagnosis, group: CutGroup) -> list[str]:
    """Measured outputs of a group that are whole numbers, or true or false."""
    inside = {component for unit in group.units for component in unit.components}
    ports = {n: port_of(found.system, n) for log in found.logs for n in log.signals}
    return [
        str(p)
        for p in dict.fromkeys(ports.values())
        if p.component in inside
        and found.system.variable(p).kind != "Real"
        and found.system.variable(p).causality != "input"
    ]


def judge(
    found: AnyDiagnosis, group: CutGroup, runs: Runs, trust: Trust, options: AnyOptions, watch: Watch
) -> None:
    """Judge one group; its model, where it fits, then gives the quantity behind the reading to what comes after."""
    if not group.judged:
        whole = whole_outputs(found, group)
        found.unjudged[group.name] = (
            f"of its outputs only {', '.join(whole)} was measured, and what is whole or true or false is not judged"
            if whole
            else "none of its outputs was measured"
        )
        return
    watch(group.name)
    segments = segments_for(found, group)
    if not any(segment.fitted.any() for segment in segments):
        lacks = "held out: the others lack" if segments else "given that has all of"
        found.unjudged[group.name] = f"no log is {lacks} {', '.join(signals_of(group))}"
        return
    model = model_of(found, group, runs, segments, options)
    still_inputs = unmeasured(found.system, group)
    stated = options.given
    switches = [n for n in still_inputs if found.system.variable(Port(*n.split(".", 1))).kind == "Boolean"]
    found.notes += assumed(group, still_inputs, stated, trust, switches)
    search = Search(model, trust, options.exclude, options.causes, found.budget)
    found.notes += [
        f"{group.name} is not deterministic: two runs differ by {size:.3g} in {signal} (RMS), which counts as noise"
        for signal, size in search.known.differs.items()
        if size > 0.0
    ]
    found.notes += [
        f"{group.name}: its own solver is off in {signal} by {100 * size / search.spreads[signal]:.2g} % of its spread "
        "(RMS), so less is not looked for; export it with a finer step or tolerance"
        for signal, size in model.coarse.items()
        if SAID * search.spreads[signal] < size < WHOLLY * MOST_COARSE * search.spreads[signal]
    ]
    too_long = steps_too_long(search)
    found.notes += too_long
    found.advice += too_long
    doubted = doubtful(found, search)
    heard(found, search, doubted)
    if model.drives:
        model.segments = known_in(found, model, doubted)
        search = Search(model, trust, options.exclude, options.causes, found.budget)
    finding, healthy = search.run(), list[Finding]()
    try:
        if (
            doubted and not found.budget.over and (finding.named or finding.unexplained)
        ):  # the group's own causes may have swayed it: ask it again with them
            search, finding = asked_again(found, search, finding, doubted, trust, options)
        search, finding = driven_by_itself(found, search, finding, trust, options)
        search, finding = taken_as_exact(found, search, finding, trust, options)
        finding, *healthy = in_some_logs(found, search, finding, trust, options)
        search, finding = with_friction(found, search, finding, trust, options)
    except OutOfTimeError:  # in the middle of a run: what was found before stands
        found.budget.leave_out(group.name, "another look with other drives, parameters or logs")
    if group.source and len(found.groups) > 1 and finding.unexplained and not finding.named:
        found.unjudged[group.name] = (
            "nothing enters it, and the log holds something else than it plays: taken as given"
        )
        return
    guessed = [n for n in still_inputs if n not in stated and n not in trust.free]
    if guessed and not group.drives and finding.unexplained and not finding.named:
        found.unjudged[group.name] = (
            f"{' and '.join(guessed)} was not measured, and at its start value the log holds something else: "
            "measure it, or give its value in the mapping ([diagnose] constant)"
        )
        return
    with runs.uncut():  # it is told, whatever the time
        found.findings[group.name] = finding
        found.notes += [f"{group.name}: a candidate was refused: {text}" for text in search.problem.failures]
        beyond = far_off(finding)
        found.notes += at_limits(finding) + own_steps(finding) + beyond
        found.advice += beyond
        if finding.unexplained:
            return
        for one in (finding, *healthy):
            for signal, _ in group.judged:
                for k, series in behind(one, signal).items():
                    one.model.segments[k].driving[signal] = series


def model_of(
    found: AnyDiagnosis, group: CutGroup, runs: Runs, segments: list[Segment], options: AnyOptions
) -> GroupModel:
    """A group's model, with what the mapping says of its inputs and of where it begins."""
    model = GroupModel(group, found.system, runs, segments, found.cuts.own[group.name])
    held = [
        d
        for d in group.drives
        if found.system.variable(d.port).kind == "Real"
        and all(d.signal in s.steps for s in segments if d.signal in s.signals)
    ]
    model.base = {f"{HOLD}:{d.signal}>{d.port}": -0.5 for d in held} | begins(model, options)
    return model


def thin(found: AnyDiagnosis, runs: Runs, trust: Trust, options: AnyOptions, little: float) -> None:
    """Take logs that are sampled far faster than anything in them moves at fewer samples.

    Args:
        found: its logs.
        runs: the FMUs.
        trust: the parameters that are fitted.
        options: what the mapping says.
        little: what a reading may lose beyond its white noise, in parts of its spread.
    """
    choices = factors(found.segments)
    groups = [g for g in found.groups if g.judged and found.cuts.own[g.name]]
    values = {f"{PARAMETER}|{n}": v for n, v in trust.free.items()}

    def given(segments: Sequence[Segment], group: CutGroup) -> tuple[GroupModel, dict[str, Array]]:
        own = [s for s in segments if s.number in found.cuts.own[group.name]]
        model = model_of(found, group, runs, own, options)
        with runs.exact():
            return model, model(values)

    def bears(group: CutGroup, coarse: Sequence[Segment], every: int) -> bool:
        model, series = full[group.name]
        logs = {place(s, k): model.segments[k] for s, _ in group.judged for k in model.judging(s)}
        readings = {n: log.signals[n.rpartition("#")[0]] for n, log in logs.items()}
        if any(loses(readings[n], share(log, every)) > little for n, log in logs.items()):
            return False
        _, fewer = given(coarse, group)
        return all(alike(series[n], fewer[n], share(log, every)) for n, log in logs.items())

    try:
        full = {g.name: given(found.segments, g) for g in groups} if choices else {}
        for model, series in full.values():
            for signal, _ in model.group.judged:
                logs = [model.segments[k] for k in model.judging(signal)]
                moved = [log.at_stamps(series[n]) for log, n in zip(logs, model.places(signal), strict=True)]
                if stale_of([log.reading(signal) for log in logs], moved):
                    return  # each counts
        drives = [drive for group in found.groups for drive in group.drives]
        real = {d.signal: found.system.variable(d.port).kind == "Real" for d in drives}
        for every in choices:
            coarse = [thinned(s, every, real) for s in found.segments]
            if all(bears(g, coarse, every) for g in groups):
                found.segments = coarse
                return
    except SimulationError:  # which is said where the group is judged
        return


def sparser(found: AnyDiagnosis) -> list[str]:
    """What to say of logs that are taken at fewer samples."""
    notes = []
    judged = {signal for group in found.groups for signal, _ in group.judged}
    for log, s in zip(found.logs, found.segments, strict=True):
        every = round(s.h / float(np.median(np.diff(log.time))))
        if every < 2:
            continue
        lost = max((loses(series, every) for n, series in s.recorded.items() if n in judged), default=0.0)
        notes.append(
            f"{log.source.name}: sampled far faster than anything in it moves: {s.h:g} s are enough"
            if lost <= SAME
            else f"{log.source.name}: one run of it takes long, and a diagnosis makes thousands: it uses one sample each "
            f"{s.h:g} s, by which a reading loses {100 * lost:.1g} % of its spread (less with --budget 1h)"
        )
    return notes


def within_time(found: AnyDiagnosis, runs: Runs, trust: Trust, options: AnyOptions) -> None:
    """Where one run takes longer than a diagnosis can bear, take fewer samples or, where those lose too much, a part.

    Fewer samples of a whole log tell more than a part of it.
    """

    def most() -> int | None:
        seconds = a_sample(found, runs, trust, options)
        return None if seconds is None else most_samples(seconds, found.budget.seconds)

    counts = most()
    if counts is None or sum(s.count for s in found.segments) <= counts:
        return
    thin(found, runs, trust, options, LITTLE)
    counts = most()
    if counts is not None and shorten(found, counts, options):
        thin(found, runs, trust, options, LITTLE)


def a_sample(found: AnyDiagnosis, runs: Runs, trust: Trust, options: AnyOptions) -> float | None:
    """Time that a sample takes in one run of all groups [s]; None where the logs are short or cannot be run."""
    groups = [g for g in found.groups if g.judged and found.cuts.own[g.name]]
    counts = [s.count for s in found.segments]
    longest = found.segments[int(np.argmax(counts))]
    if sum(counts) <= ENOUGH or longest.count < PROBES[-1]:
        return None
    values = {f"{PARAMETER}|{n}": v for n, v in trust.free.items()}

    def taken(count: int) -> float:
        began = time.monotonic()
        for group in groups:
            if longest.number in found.cuts.own[group.name]:
                model_of(found, group, runs, [head(longest, count)], options)(values)
        return time.monotonic() - began

    try:
        with runs.exact():
            taken(PROBES[0] // 2)  # loads them
            few, many = (taken(count) for count in PROBES)
    except SimulationError:  # which is said where the group is judged
        return None
    return max(many - few, 0.0) / (PROBES[1] - PROBES[0])


def shorten(found: AnyDiagnosis, most: int, options: AnyOptions) -> bool:
    """Take a part of each log if they have more samples together than can be run; True if so."""
    wanted = lengths([s.count for s in found.segments], most)
    if wanted is None:
        return False
    groups = [g for g in found.groups if g.judged and found.cuts.own[g.name]]
    judged = {signal for group in groups for signal, _ in group.judged}
    told = set(options.start.values())
    parts = [
        part_of(log, judged, told, round(count * log.time.size / segment.count))
        for log, segment, count in zip(found.logs, found.segments, wanted, strict=True)
    ]
    found.notes += [
        f"{log.source.name}: one run of it takes long, and a diagnosis makes thousands: it uses {part.time[0]:g} to "
        f"{part.time[-1]:g} s, where the inputs visit most (more of it with --budget 1h)"
        for log, part in zip(found.logs, parts, strict=True)
        if part is not log
    ]
    if len(parts) == 1:
        found.span = (float(parts[0].time[0]), float(parts[0].time[-1]))
    found.logs, (found.segments, _) = parts, segments_of(parts, found.held)
    return True


def over_the_rest(
    found: AnyDiagnosis, whole: Sequence[Recording], runs: Runs, options: AnyOptions
) -> list[str]:
    """What the causes explain in the parts of logs that had no share in the diagnosis: one run of each, of all of it."""
    used = {k: part for k, (log, part) in enumerate(zip(whole, found.logs, strict=True)) if part is not log}
    notes: list[str] = []
    if not used or found.budget.over:
        return notes
    segments = [s for s in segments_of(whole, found.held)[0] if s.number in used]
    for finding in found.findings.values():
        for segment in segments:
            if segment.number not in found.cuts.own[finding.model.group.name]:
                continue
            model = like(found, finding.model, [segment])
            model.drives, model.base = {}, finding.model.base | begins(model, options)
            causes = extended(finding, finding.fitted or finding.chosen)
            before, after = (model(values) for values in (finding.null.fit.values, causes))
            times, part = segment.start + segment.h * np.arange(segment.count), used[segment.number]
            inside = (times >= part.time[0]) & (times <= part.time[-1])
            for signal, _ in model.cuts[0].judged:
                here, there = inside & segment.known(signal), ~inside & segment.known(signal)
                first, last = (
                    segment.signals[signal] - series[place(signal, 0)] for series in (before, after)
                )
                text = f"{whole[segment.number].source.name}: in the rest of it the error of {signal} "
                if finding.named:
                    notes.append(
                        text + f"is {ratio(last[there], first[there]):.2g} times that of the model as it is"
                    )
                elif (more := ratio(last[there], last[here])) > WORSE_ELSEWHERE:
                    notes.append(text + f"is {more:.2g} times that of the part used")
    return notes


def ratio(errors: Array, others: Array) -> float:
    """Root mean square of some errors over that of others; 1 where there are none."""
    return rms(errors) / rms(others) if errors.size and np.any(others) else 1.0


def in_some_logs(
    found: AnyDiagnosis, search: Search, finding: Finding, trust: Trust, options: AnyOptions
) -> list[Finding]:
    """What is wrong in some logs alone, where all of them together have no explanation and others show nothing wrong.

    A machine may have been changed, repaired or broken between two logs. Those that show nothing wrong must speak against
    the cause: else it is in all.

    Returns:
        The finding of these logs, and that of the others without a cause; `finding` alone if none of this is so.
    """
    segments, name = search.model.segments, search.model.group.name
    if len(segments) < 2 or not finding.unexplained or found.budget.over:
        return [finding]

    def of(own: Sequence[Segment]) -> Search:
        mixed = any(s.fitted.any() for s in own) and not all(s.fitted.all() for s in own)
        return Search(
            like(found, search.model, own if mixed else windowed(own)),
            trust,
            options.exclude,
            options.causes,
            found.budget,
        )

    healthy = [s for s in segments if not of([s]).wrong()]
    others = [s for s in segments if all(s is not h for h in healthy)]
    if not healthy or not others:
        return [finding]
    without = of(healthy)
    if len(healthy) > 1 and without.wrong():  # each by itself tells too little of the free parameters
        return [finding]
    wrong, right = ([found.logs[s.number].source.name for s in own] for own in (others, healthy))
    said = f"{listed(right)} {'shows' if len(right) == 1 else 'show'} nothing wrong"
    theirs = of(others).run()
    if theirs.unexplained or not theirs.named or not without.contradicts(theirs):
        found.notes.append(
            f"{name}: {said}: what is wrong shows in {listed(wrong)} alone"
            + ("" if len(wrong) == 1 else "; diagnose each of these by itself")
        )
        return [finding]
    found.only[name] = frozenset(s.number for s in others), frozenset(s.number for s in healthy)
    found.notes.append(
        f"{listed([a.words for a in theirs.named])}: in {listed(wrong)} alone; {said} and "
        f"{'contradicts' if len(right) == 1 else 'contradict'} it"
    )
    return [theirs, Finding(without.model, without.problem, without.known.null, without.known.null)]


def listed(words: Sequence[str]) -> str:
    """Words as a sentence lists them."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def at_limits(finding: Finding) -> list[str]:
    """What the user should know of a group that is adequate only if trusted parameters are off by all that is trusted."""
    if not finding.bent or finding.unexplained:
        return []
    other = (
        f"; if they are surer than that, the nearest cause is {finding.instead.words}"
        if finding.instead
        else ""
    )
    return [
        f"{finding.model.group.name} explains the log only with {' and '.join(finding.bent[:SHOWN])} three deviations "
        f"from what is trusted{other}"
    ]


def own_steps(finding: Finding) -> list[str]:
    """What to say of a group that stays wrong where nobody can ask how far its solvers are off."""
    model = finding.model
    h = min(segment.h for segment in model.segments)
    fixed = [u for u in model.group.units if len(u.components) == 1 and not model.runs.can_halve(u, h)]
    if not finding.unexplained or not fixed:
        return []
    names = [c for u in fixed for c in u.components]
    steps = [f"{model.system.components[n].fmu.step_size:g} s" for n in names]
    return [
        f"{listed(names)}: steps of {listed(steps)} of {'its' if len(names) == 1 else 'their'} own, which cannot be made "
        "finer here: what its solver errs by them is among what is unexplained; if the FMU can be exported with a finer "
        "step, try that"
    ]


def behind(finding: Finding, signal: str, candidate: Candidate | None = None) -> dict[int, Array]:
    """The quantity behind a reading in each log that has it, as a group's model has it, brought slowly to the reading.

    With the causes that are named, or those of a candidate.
    """
    values, model = (candidate or finding.chosen).fit.values, finding.model
    left = finding.problem.residuals(values)
    found = {}
    for k in model.judging(signal):
        segment, own = model.segments[k], left[place(signal, k)]
        # with the moment at which it was read, which the model's series does not have
        predicted = segment.signals[signal] - own
        if signal in model.steps or signal in segment.missing:
            whole = model.ports(values, k)[signal]
            predicted = (
                whole if signal in model.steps else np.where(segment.missing[signal], whole, predicted)
            )
        found[k] = followed(predicted, own)
    return found


def unmeasured(system: System, group: CutGroup) -> dict[str, float | None]:
    """Inputs of a group that nothing measured enters: ``component.input`` -> start value, None where the FMU gives none."""
    entered = system.places([*(d.port for d in group.drives), *(w.target for w in group.inner)])
    found = {}
    for component in group.components:
        for variable in system.components[component].fmu.variables.values():
            if (
                variable.causality == "input"
                and variable.kind in NUMERIC
                and (component, variable.reference) not in entered
            ):
                name = f"{component}.{variable.name}"
                value = system.components[component].starts.get(variable.name, variable.start)
                found[name] = float(value) if isinstance(value, (int, float)) else None
    return found


def steps_too_long(search: Search) -> list[str]:
    """Signals of which a model is another one with half the step."""
    h = max(s.h for s in search.model.segments)
    return [
        f"{signal}: with half the step the model gives something else, by a tenth of what the reading varies or more: "
        f"{h:.3g} s are too long for it; let it take shorter steps inside, or record faster"
        for signal, size in search.model.coarse.items()
        if size >= WHOLLY * MOST_COARSE * search.spreads[signal]
    ]


def far_off(finding: Finding) -> list[str]:
    """Signals that stay wrong and of which the model as it is goes far beyond anything that was read."""
    residual = errors(finding, finding.null.fit.values)
    notes = []
    for signal in finding.unexplained:
        own = finding.model.whole(residual, signal)
        times = float(np.sqrt(np.mean(own**2))) / max(finding.spreads[signal], 1e-300)
        if times > FAR:
            notes.append(
                f"{signal}: the model as it is errs {times:.2g} times as much as the reading varies: check units, signs "
                "and values in the mapping and in the FMU"
            )
    return notes


def begins(model: GroupModel, options: AnyOptions) -> dict[str, float]:
    """Parameters that are an initial value, in each log what a signal of it begins with."""
    own = {n: s for n, s in options.start.items() if n.partition(".")[0] in model.group.components}
    found = dict[str, float]()
    for segment in model.segments:
        drives = [segment.signals[d.signal] for d in model.group.drives if d.signal in segment.signals]
        first = begun(own, segment.signals, segment.missing, drives, segment.h)
        found |= {each(name, segment.number): value for name, value in first.items()}
    return found


def assumed(
    group: CutGroup,
    inputs: Mapping[str, float | None],
    stated: Collection[str],
    trust: Trust,
    switches: Collection[str] = (),
) -> list[str]:
    """What is taken for granted of inputs that were not measured, in one sentence for the group; `switches` are Boolean."""
    guessed = {
        n: v for n, v in inputs.items() if n not in stated and n not in trust.free and n not in trust.trusted
    }
    if not guessed:
        return []
    words = [
        f"{n} ({'no start value' if v is None else str(bool(v)).lower() if n in switches else f'{v:g}'})"
        for n, v in guessed.items()
    ]
    more = f" and {len(words) - SHOWN} more" if len(words) > SHOWN else ""
    return [
        f"assumed: inputs of {group.name} that were not measured stay at their start values: "
        f"{', '.join(words[:SHOWN])}{more}; [diagnose] constant in the mapping gives others"
    ]


Doubted = list[tuple[str, Action, str, Quantity]]
"""Group, its cause, the signal that drives this group, the quantity that it would be without the cause."""


def doubtful(found: AnyDiagnosis, search: Search) -> Doubted:
    """Drives of a group whose reading, or the quantity itself, is off by a cause that was found before."""
    doubted: Doubted = []
    for drive in search.model.group.drives:
        for name, finding in found.findings.items():
            port = dict(finding.model.group.judged).get(drive.signal)
            for action in finding.chosen.actions:
                known = any((d[1], d[2]) == (action, drive.signal) for d in doubted)
                if action.port == port and action.where in ("output", "sensor") and not known:
                    series = before_effect(finding, action, drive.signal)
                    doubted.append((name, action, drive.signal, series))
    return doubted


def known_in(found: AnyDiagnosis, model: GroupModel, doubted: Doubted) -> list[Segment]:
    """The logs of which it is known what drives a group, where a reading is off: those by which that was judged."""
    judges = {signal: found.only.get(name, NO_LOGS)[1] for name, _, signal, _ in doubted}
    known = [
        s
        for s, own in zip(model.segments, model.cuts, strict=True)
        if all(
            s.number in q.series or s.number in judges.get(n, ()) or all(d.signal != n for d in own.drives)
            for n, q in model.drives.items()
        )
    ]
    if len(known) == len(model.segments) or not any(s.fitted.any() for s in known):
        return model.segments
    others = [found.logs[s.number].source.name for s in model.segments if all(s is not k for k in known)]
    found.notes.append(
        f"{listed(others)}: no part where {model.group.name} is judged: {listed(list(model.drives))} is read wrongly, and "
        "what it should be is known of the other logs only"
    )
    return windowed(known) if all(s.fitted.all() for s in known) else known


def heard(found: AnyDiagnosis, search: Search, doubted: Doubted) -> None:
    """Ask whether it is the reading that is off: then the quantity before the effect drives the group from here on."""
    for name, action, signal, series in doubted:
        vote = vote_of(search.problem, search.model, search.known.null.fit.values, signal, series)
        if vote is None:
            continue
        found.votes.setdefault((name, action), {})[search.model.group.name] = vote
        if vote > CLOSE or (action.where == "sensor" and vote > -CLOSE):
            search.model.drives[signal] = series


def like(found: AnyDiagnosis, model: GroupModel, segments: Sequence[Segment] | None = None) -> GroupModel:
    """A model of the same group, driven by the same, of these logs or the same."""
    group = next(g for g in found.groups if g.name == model.group.name)
    other = GroupModel(
        group, found.system, model.runs, segments or model.segments, found.cuts.own[group.name]
    )
    other.base, other.drives, other.differs = dict(model.base), dict(model.drives), model.differs
    other.coarse, other.loops = model.coarse, dict(model.loops)
    return other


def asked_again(
    found: AnyDiagnosis, search: Search, finding: Finding, doubted: Doubted, trust: Trust, options: AnyOptions
) -> tuple[Search, Finding]:
    """The search with each doubted drive the other way as well; what explains the group better stands, and is its vote."""
    for name, action, signal, series in doubted:
        model = like(found, search.model)
        model.drives = {s: v for s, v in search.model.drives.items() if s != signal}
        quantity = signal not in search.model.drives
        if quantity:
            model.drives[signal] = series
        other = Search(model, trust, options.exclude, options.causes, found.budget)
        theirs = other.run()
        better = worth(theirs) - worth(finding)
        found.votes.setdefault((name, action), {})[model.group.name] = 10.0 * (
            better if quantity else -better
        )
        if better > 0.0:
            search, finding = other, theirs
    return search, finding


def driven_by_itself(
    found: AnyDiagnosis, search: Search, finding: Finding, trust: Trust, options: AnyOptions
) -> tuple[Search, Finding]:
    """The search again where readings that judge the group drive it as well, now by the model of what they read.

    The noise of such a reading would else go through the components behind it and look like a fault of theirs.
    """
    begun = finding.nearest or finding.chosen
    near = search.model.own - {
        s for s, _ in search.model.group.judged if search.fits.leaves(s, begun) > AS_GOOD
    }
    if not near or found.budget.over or not (finding.named or finding.unexplained):
        return search, finding
    segments = search.model.segments
    before = [dict(segment.driving) for segment in segments]
    places = {s: search.model.group.components.index(p.component) for s, p in search.model.group.judged}
    for signal in sorted(near, key=lambda s: places[s]):  # what comes first drives the others
        for k, series in behind(finding, signal, begun).items():
            segments[k].driving[signal] = series
    try:
        other = Search(like(found, search.model), trust, options.exclude, options.causes, found.budget)
        theirs = other.run()
        if worth(theirs) > worth(finding) - CLOSE:
            return other, theirs
    except OutOfTimeError:
        found.budget.leave_out(
            search.model.group.name, "whether readings that drive it should be the model's"
        )
    for segment, driving in zip(segments, before, strict=True):
        segment.driving.update(driving)
    return search, finding


def with_friction(
    found: AnyDiagnosis, search: Search, finding: Finding, trust: Trust, options: AnyOptions
) -> tuple[Search, Finding]:
    """The search again with dry friction among the causes, where that explains what is wrong better."""
    wrong = finding.unexplained or finding.chosen.actions
    if not wrong or EFFECT in options.exclude or found.budget.over:
        return search, finding
    try:
        if (action := rubs(search, finding)) is None:
            return search, finding
        other = Search(like(found, search.model), trust, options.exclude, options.causes, found.budget)
        theirs = other.run()
    except OutOfTimeError:
        found.budget.leave_out(search.model.group.name, "dry friction")
        return search, finding
    return (other, theirs) if action in theirs.named else (search, finding)


def taken_as_exact(
    found: AnyDiagnosis, search: Search, finding: Finding, trust: Trust, options: AnyOptions
) -> tuple[Search, Finding]:
    """The search with parameters that the mapping takes as exact, where something stays wrong without them.

    One of them may do what several causes were named for, as a dead zone that the machine has not: then it is one as well.
    One that does as much as a cause and is none by itself is declared indistinguishable from it. Where nothing was named it
    must explain the log: of something that the library lacks another number often tells a part.
    """
    known = {*trust.trusted, *trust.free, *options.start}
    values = {
        f"{c}.{v.name}": value_of(found.system, f"{c}.{v.name}")
        for c in search.model.group.components
        for v in found.system.components[c].fmu.variables.values()
        if settable(v) and f"{c}.{v.name}" not in known
    }
    exact = {n: v for n, v in values.items() if v is not None}
    runs = search.model.runs
    most = allowed(runs) - runs.count  # each is run at least once
    if not 0 < len(exact) <= most or not finding.unexplained or found.budget.over:
        return search, finding
    own = {n: (v, trust.tolerance) for n, v in exact.items()}
    model, chosen = like(found, search.model), finding.chosen
    looked = Search(
        model, replace(trust, trusted=trust.trusted | own), options.exclude, options.causes, found.budget
    )
    names = looked.likeliest_of(list(own), chosen.fit.values)
    if not names:
        return search, finding
    asked = replace(trust, trusted=trust.trusted | {n: own[n] for n in names})
    other = Search(model, asked, options.exclude, options.causes, found.budget)
    begin = other.instead(names, chosen.actions, chosen.fit.values)
    if begin is None:
        return search, finding
    theirs = other.run(begin)
    ours = [n for n in names if any(a.effect == PARAMETER and str(a.port) == n for a in theirs.named)]
    if not ours or worth(theirs) < worth(finding) or (theirs.unexplained and not chosen.actions):
        number = begin.actions[-1]
        for action in set(chosen.actions) - set(begin.actions):
            finding.alike[action] = [number, *finding.alike.get(action, ())]
            finding.rivals[action] = [(number, 0.0), *finding.rivals.get(action, ())]
        return search, finding
    trust.trusted |= {n: own[n] for n in ours}
    said = (
        f"{' and '.join(ours)}: taken as exact, and asked as well since nothing else explains the log as well; "
        "[diagnose] trusted in the mapping says what you know of it"
    )
    found.notes.append(said)
    found.advice.append(said)
    return other, theirs


def locate(found: AnyDiagnosis, name: str, trust: Trust, options: AnyOptions) -> None:
    """Whether what shows at an output is the output's or the reading's: what the reading drives knows.

    A group that the reading drives is run with the quantity before the effect as well. If it fits better so, the reading is
    wrong; if worse, the quantity itself is; if nothing depends on the reading, nobody can tell.
    """
    finding = found.findings[name]
    ports = {port: signal for signal, port in finding.model.group.judged}
    for action in finding.named:
        if action.where not in ("output", "sensor") or action.port not in ports:
            if action.where == "input" and not EFFECTS[action.effect].looped:
                _drive(found, name, action)
            continue
        signal = ports[action.port]
        reading = action.effect in (
            "port.drift",
            "port.quantisation",
            "port.dropout",
        )  # they are nowhere else
        for n, user in list(found.findings.items()):  # groups of a loop were judged before
            asked = found.votes.setdefault((name, action), {})
            if n == name or n in asked or all(d.signal != signal for d in user.model.group.drives):
                continue
            if reading and not (user.named or user.unexplained):
                continue
            series = before_effect(finding, action, signal)
            if (
                user.named or user.unexplained
            ) and not found.budget.over:  # it may have taken the reading's fault for its own
                tries = []
                for quantity in (series, undone(finding, action, signal)):
                    if quantity is not None:
                        model = like(found, user.model)
                        model.drives[signal] = quantity
                        tries.append(
                            Search(model, trust, options.exclude, options.causes, found.budget).run()
                        )
                theirs = max(tries, key=worth)
                asked[n] = 10.0 * (worth(theirs) - worth(user))
                if asked[n] > 0.0:
                    found.findings[n] = theirs
                continue
            vote = vote_of(user.problem, user.model, user.null.fit.values, signal, series)
            if vote is not None:
                asked[n] = vote
        votes = list(found.votes.get((name, action), {}).values())
        total = sum(votes)
        if reading:
            found.where[name, action] = "sensor"
        elif votes and abs(total) > CLOSE:
            found.where[name, action] = "sensor" if total > 0.0 else "output"
            as_decided(found, name, action, signal, trust, options)
        elif signal in finding.model.own:  # both places were looked for
            found.where[name, action] = action.where
        else:
            found.where[name, action] = "output"
            found.undecided[name, action] = [Action(action.effect, action.port, "sensor").words]


def as_decided(
    found: AnyDiagnosis, name: str, action: Action, signal: str, trust: Trust, options: AnyOptions
) -> None:
    """Groups that were judged as if the effect were elsewhere, and found something then, judged again as the others say.

    What is taken off a reading that is right comes back as a fault of what it drives.
    """
    quantity = found.where[name, action] == "sensor"
    for n, user in list(found.findings.items()):
        driven = any(d.signal == signal for d in user.model.group.drives)
        if n == name or not driven or (signal in user.model.drives) == quantity or found.budget.over:
            continue
        if not (user.named or user.unexplained):
            continue
        model = like(found, user.model)
        model.drives.pop(signal, None)
        if quantity:
            model.drives[signal] = before_effect(found.findings[name], action, signal)
        found.findings[n] = Search(model, trust, options.exclude, options.causes, found.budget).run()


def _drive(found: AnyDiagnosis, name: str, action: Action) -> None:
    """An effect at the only input of a measured signal from outside may be one of its reading as well."""
    group = found.findings[name].model.group
    drive = next((d for d in group.drives if d.port == action.port), None)
    if drive is None:
        return
    feeds = [
        g
        for g in found.groups
        for d in g.drives
        if d.signal == drive.signal and (g.name != name or d.port != action.port)
    ]
    judged = any(s == drive.signal for g in found.groups if g.name in found.findings for s, _ in g.judged)
    if not feeds and not judged:
        found.undecided.setdefault((name, action), []).append(
            Action(action.effect, port_behind(found.system, drive.signal, drive.port), "sensor").words
        )


def port_behind(system: System, signal: str, port: Port) -> Port:
    """The port whose reading a signal is."""
    sources, _ = measured_ports(system, [signal])
    found = sources.get(signal, port)
    return found if found.component else port


def before_effect(finding: Finding, action: Action, signal: str) -> Quantity:
    """What a reading would be without an effect, in each log, and what the effect's uncertainty changes of it."""
    fit = finding.chosen.fit
    effect = f"{action.effect}|{action.port}|"
    own = [u.name for u in fit.unknowns if u.name.startswith(effect)]
    series: dict[int, Array] = {}
    slopes: list[dict[int, Array]] = [{} for _ in own]
    for k, reading in behind(finding, signal).items():
        number = finding.model.segments[k].number
        values = in_log(fit.values, number)
        before = {n: v for n, v in values.items() if not n.startswith(effect)}
        ports = finding.model.ports(values, k)
        whole = ports[signal]
        if action.where == "sensor":
            h = finding.model.segments[k].h
            pure = acted(ports[f"out:{action.port}"], h, action.port, "sensor", placed(before))
        else:
            pure = finding.model.ports(before, k)[signal]
        # what the model's own slow errors and its timing make out, but not the effect
        series[number] = pure - whole + reading
        for i, name in enumerate(own):
            moved = finding.model.ports({**values, name: values[name] + fit.deviation(name)}, k)[signal]
            slopes[i][number] = whole - moved
    return Quantity(series, slopes)


def undone(finding: Finding, action: Action, signal: str) -> Quantity | None:
    """What drives by a reading, with an effect taken off it that can be undone sample by sample; None for others."""
    values = finding.chosen.fit.values
    model = finding.model
    own = [model.segments[k] for k in model.judging(signal)]
    driving = {s.number: s.driving.get(signal, s.signals[signal]) for s in own}
    if action.effect == "port.offset":
        return Quantity({k: series - values[action.key("offset")] for k, series in driving.items()})
    if action.effect == "port.gain" and abs(gain := values[action.key("gain")]) > LEAST_GAIN:
        return Quantity({k: series / gain for k, series in driving.items()})
    return None


def vote_of(
    problem: Problem, model: GroupModel, values: Mapping[str, float], signal: str, series: Quantity
) -> float | None:
    """Log-likelihood that a group gains if other series drive it; None where it cannot be run."""
    with_reading = problem.rows(values)
    kept = model.drives
    model.drives = {**kept, signal: series}
    try:
        with_quantity = problem.rows(values)
    finally:
        model.drives = kept
    if with_reading is None or with_quantity is None:
        return None
    return 0.5 * float(with_reading @ with_reading - with_quantity @ with_quantity)


def verdict_of(found: AnyDiagnosis) -> str:
    """The verdict over all groups."""
    named = any(f.named for f in found.findings.values())
    left = any(f.unexplained for f in found.findings.values())
    if not named:
        return "unexplained" if left else "adequate"
    return "partly_explained" if left else "explained"
