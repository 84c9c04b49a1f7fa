"""What is wrong in one group: screening by the shape of each effect, fits, evidence, held-out windows, adequacy."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import (
    LEAST_DELAY,
    PARAMETER,
    Action,
    Reach,
    acts,
    each,
    moderate,
    of_all,
    off,
    part_of,
    sides,
    starts,
    unknowns,
)
from cosim.anysystem.missing import allowed, missing
from cosim.anysystem.model import DRIVE, HOLD, SHIFT, GroupModel, place
from cosim.anysystem.readings import Grid, Stale, grid_of, stale_of
from cosim.compare.metrics import white_noise
from cosim.diagnosis.budget import Budget
from cosim.diagnosis.held_out.between import Between, between_logs, combined, drawn_by_logs
from cosim.errors import OutOfTimeError, SimulationError
from cosim.inference.freeform import Explained, explained
from cosim.inference.held_out import HeldOutGain, ratio_ci95, squares_by_block
from cosim.inference.noise import quietest
from cosim.inference.problem import DIFFERENCE, EVALUATIONS, FINE, Fit, Problem
from cosim.inference.unknowns import Unknown
from cosim.ssp.system import Port
from cosim.system.effects import EFFECTS

Array = NDArray[np.float64]

# thresholds, each with its reason
NAMED = 10.0  # log-likelihood beyond the price of the parameters: the best of some hundred candidates on clean data
CLOSE = 6.0  # log-likelihood within which two hypotheses cannot be told apart (DIAGNOSIS.md, 7)
ROUNDED = 0.1  # of a step: smaller noise of a rounded reading is not believed: little is left, and at its edges only
LEAST = 1e-3  # of a signal's spread: two programs that integrate the same model differ by that
SIZE = 2e-3  # of a signal's spread: what is smaller does not matter to anybody
SOLVERS = 1.25  # times the error of the model's solvers: what is smaller may be theirs
TOLD = 0.05  # share of a residual's variance that inputs must tell before it counts as systematic
UNTOLD = 0.025  # of a signal's spread, and
MOST_COARSE = 0.1  # of a reading's spread: what changes more with half the step is another model
LOUD = 3.0  # times its white noise: a residual beyond both is no noise even if no input tells it
ABOVE = 1.2  # times a reading's white noise: a fit that leaves more of it may not be the best of its kind
BETTER = 0.15  # a set of causes is named if it leaves no more than this part of what was systematic,
LEAVES = 0.5  # or this of the windows held out, where they are other numbers of the law, or nothing tells what they leave
CONSTANT = 0.95  # part of a reading's spread that an explanation leaves where it explains nothing
SCATTERS = "differs from log to log so much that another may have none of it"
WORTH = 0.85  # RMS of a signal with one cause more, at most, where a further cause is looked for
PARTS = 8  # of a log, in each of which a drive may be off by the mean of its reading's noise
KEPT_ON = 0.05  # of a response: so much of it at the end of the log is not forgotten
SCREENED = 7  # candidates fitted at each stage
SURELY_AGAIN = 4  # of them with the noise that the best leaves
REPLACED = 10  # causes that are tried in the place of a named one
OTHERS = 3  # more of them, of effects that are not among these, where they promise
PROMISE = 0.1  # of what the best does
AROUND = tuple(np.geomspace(0.02, 1.0, 7))  # of a scale: how far from an estimate a better one is looked for
AGAIN = 3  # times at most
SCANNED = 9  # values of a limit over its range
GROWS = 2.0  # times what a parameter changes early in a log: where it changes so much late, it puts a model out of step
UNDONE = (
    0.5  # of what more of a parameter does: less of it undoes so much where the likelihood has one optimum
)
HORIZONS = (1 / 16, 1 / 8, 1 / 4, 1 / 2)  # of a log: where such a parameter is fitted first
HORIZON_STEPS = 6  # of each of these fits
OFF_STEP = 0.01  # of a parameter: where the first of them begins
SEARCHING = 0.8  # of the time that is left: what was found is then decided upon, with its last estimate
LOOKED = 0.5  # of the time that is left: candidates are looked at before the best of them are fitted
DRIFTS = 1.25  # times the error of a run (RMS): least squares leave hardly less than the likelihood where noise is noise
ALONG = 0.9  # of the square of a slope that lies along another's: what may do the same is fitted in its place
KEPT = 3  # of them from which a second cause is looked for,
FAR_BEHIND = 9.0  # where they leave no more than so many times the squares that the best leaves
ASKED = 3  # parameters that are taken as exact, where nothing else explains a log
SETTLING = 6  # evaluations in which what is no cause is settled beside the causes
AGREES = 1e-3  # of a log-likelihood: two fits that differ by less ended in one place
NOTHING = 0.01  # log-likelihood: a number that changes no more is not told
RUNAWAY = 1e9  # spreads of a signal: a model that a small change moves so far is unstable there
MOST = 3  # causes in a group
DECADES = 9  # of an FMU's unit: from nano to giga
EARLY = 1.0  # samples, at most
FAR_MORE = 20.0  # log-likelihood: two ways to hand inputs over differ by less than 1 for each input where slopes hold
FAR_LESS = (
    0.5  # of what is left: a hidden fault seems to leave a little less (0.995 of it), contacts leave 1e-4
)
SURE = 3.0  # deviations of a trusted parameter: beyond them it is a cause
ALMOST = 0.99  # of that
JITTER = 0.7  # samples, prior of the moment at which an input acts or an output is read
FAINT = 20.0  # times that, under the white noise alone: what a moderate size does is no more, and is looked at again
FOLLOWED = 1e-3  # of the square of what a start changes: where the base's numbers leave less it is theirs
SMALLEST = 0.02  # of a start: less of it is hardly more than nothing


@dataclass
class Candidate:
    """A set of causes with its fit."""

    actions: tuple[Action, ...]
    fit: Fit
    price: float
    score: float = 0.0


@dataclass
class Begin:
    """Where a fit of one cause more may begin.

    Attributes:
        promise: log-likelihood that it may gain, the others following.
        start: its numbers as they were tried.
        part: how much of them the log asks for, by slopes.
        follow: name -> by how much the others' numbers then move.
    """

    promise: float
    start: dict[str, float]
    part: float
    follow: dict[str, float]


@dataclass
class Base:
    """A set of causes beside which one more is looked for.

    Attributes:
        candidate: the set.
        rest: what it leaves, whitened.
        slopes: (n + k, u) of what it leaves in its unknowns over their scales, zero in what is held out.
        span: (n, m) an orthonormal base of these in the fitted part.
    """

    candidate: Candidate
    rest: Array
    slopes: Array
    span: Array

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Of its fit."""
        return self.candidate.fit.unknowns


@dataclass
class Look:
    """What was seen of a cause beside others.

    Attributes:
        base: the others.
        changes: what each start changes of what they leave.
        starts: where a fit may begin.
        fitted: those from which one was made.
    """

    base: Base
    changes: list[Array] = field(default_factory=list)
    starts: list[Begin] = field(default_factory=list)
    fitted: list[dict[str, float]] = field(default_factory=list)


@dataclass
class Trust:
    """What is known of the parameters.

    Attributes:
        trusted: ``component.parameter`` -> (value, relative deviation).
        free: those that are fitted with every cause -> value.
        tolerance: relative deviation of one of which nothing is said.
    """

    trusted: dict[str, tuple[float, float]] = field(default_factory=dict)
    free: dict[str, float] = field(default_factory=dict)
    tolerance: float = 0.01


Judged = dict[Action, tuple[Candidate, HeldOutGain]]


@dataclass
class Finding:
    """What was found in a group.

    Attributes:
        model, problem: how it was judged.
        null: without causes.
        chosen: with those that are named, estimated on the whole log.
        fitted: the same as the fitted windows alone have it, by which gains are measured.
        nearest: with the causes that explain most, even if they leave too much to be named.
        alike: for each named cause, others that explain the log alike.
        rivals: for each, (action, log-likelihood behind).
        held: for each, what it gains on windows held out.
        told: signal of each log -> what inputs still tell of the residual with the causes.
        before: the same without causes.
        floors: signal -> noise floor.
        spreads: signal -> standard deviation of its reading.
        free: free parameters -> (value, standard deviation).
        settled: parameters that are no causes as the extended model has them -> (value, standard deviation): trusted ones
            within their tolerance, and free ones beside the causes.
        between: numbers of the causes, by `Action.key` or ``parameter|...`` -> what several logs say of them one by one.
        unexplained: signals that stay wrong, with words.
        twins: for each named cause, those of `alike` that were fitted, with all values of the model; other effects
            first.
        twin_unknowns: (cause, twin) -> what was fitted with the twin.
        never: causes that the log could not have shown even at a moderate size, with that size.
        read: causes that the readings show by themselves.
        bent: trusted parameters at the limit of what is trusted, where no cause is named.
        instead: the cause that comes nearest then.
        refused: causes that the fitted windows ask for and the held-out ones do not bear out, with words.
    """

    model: GroupModel
    problem: Problem
    null: Candidate
    chosen: Candidate
    fitted: Candidate | None = None
    nearest: Candidate | None = None
    alike: dict[Action, list[Action]] = field(default_factory=dict)
    rivals: dict[Action, list[tuple[Action, float]]] = field(default_factory=dict)
    held: dict[Action, HeldOutGain] = field(default_factory=dict)
    gains: dict[Action, float] = field(default_factory=dict)
    told: dict[str, Explained] = field(default_factory=dict)
    before: dict[str, Explained] = field(default_factory=dict)
    floors: dict[str, float] = field(default_factory=dict)
    spreads: dict[str, float] = field(default_factory=dict)
    free: dict[str, tuple[float, float]] = field(default_factory=dict)
    settled: dict[str, tuple[float, float]] = field(default_factory=dict)
    between: dict[str, Between] = field(default_factory=dict)
    unexplained: dict[str, str] = field(default_factory=dict)
    twins: dict[Action, list[tuple[Action, dict[str, float]]]] = field(default_factory=dict)
    twin_unknowns: dict[tuple[Action, Action], tuple[Unknown, ...]] = field(default_factory=dict)
    never: dict[Action, dict[str, float]] = field(default_factory=dict)
    read: dict[Action, Grid | Stale] = field(default_factory=dict)
    bent: tuple[str, ...] = ()
    instead: Action | None = None
    refused: list[tuple[Action, str]] = field(default_factory=list)

    @property
    def named(self) -> tuple[Action, ...]:
        """The causes."""
        return (*self.chosen.actions, *self.read)


def parameter(name: str) -> Action:
    """Another value of ``component.parameter``."""
    return Action(PARAMETER, Port(*name.split(".", 1)))


def renumbered(actions: Sequence[Action]) -> bool:
    """Whether causes are other numbers of the model, and no other law."""
    return all(action.effect == PARAMETER for action in actions)


def _between_programs(name: str, fit: Fit, agreed: Fit) -> float:
    """Variance of an estimate by what two programs make of one model, which `agreed` has in its covariance and `fit` not."""
    return max(agreed.deviation(name) ** 2 - fit.deviation(name) ** 2, 0.0)


def moments(problem: Problem) -> list[str]:
    """Nuisances that are the moments within a sample at which a log was read: of all, these alone are no simulation's."""
    return [u.name for u in problem.nuisances_shared if u.name.startswith(f"{SHIFT}:")]


def errors(finding: Finding, values: Mapping[str, float]) -> dict[str, Array]:
    """Measured minus what the model does by itself."""
    with finding.problem.sharing(moments(finding.problem)):
        return finding.problem.residuals(values)


def extended(finding: Finding, candidate: Candidate) -> dict[str, float]:
    """Values of the extended model: the causes, and what was settled beside them."""
    return candidate.fit.values | {f"{PARAMETER}|{n}": v for n, (v, _) in finding.settled.items()}


def worth(finding: Finding) -> float:
    """How well a finding's causes explain the group's readings, less the price of what they take; for another drive.

    Every tenth sample counts as independent: what is left is coloured.
    """
    residual = finding.problem.residuals(finding.chosen.fit.values)
    size = 0.0
    for signal, _ in finding.model.group.judged:
        own = finding.model.whole(residual, signal)
        left = max(float(np.sqrt(np.mean(own**2))), 1e-9 * finding.spreads[signal])
        size += own.size / 10.0 * float(np.log(left))
    return -size - finding.chosen.price


class Search:
    """The search in one group."""

    def __init__(
        self,
        model: GroupModel,
        trust: Trust,
        exclude: Sequence[str] = (),
        most: int = MOST,
        budget: Budget | None = None,
    ) -> None:
        """Run the group as it is.

        Args:
            model: the group.
            trust: what is known of the system's parameters.
            exclude: effects that are no candidates.
            most: causes looked for.
            budget: the time it may take; unlimited by default.

        Raises:
            SimulationError: it cannot be run at all.
        """
        self.model, self.exclude, self.most = model, tuple(exclude), most
        self.budget = budget or Budget()
        segments = model.segments
        inside = set(model.group.components)
        self.trusted = {n: t for n, t in trust.trusted.items() if n.partition(".")[0] in inside}
        self.free = {n: v for n, v in trust.free.items() if n.partition(".")[0] in inside}
        measured, fitted, windows, least = {}, {}, {}, {}
        self.spreads = {}
        for signal, _ in model.group.judged:
            judging = model.judging(signal)
            whole = model.measured(signal)
            spread = max(float(np.std(whole)), 1e-9 * max(1.0, float(np.abs(whole).max())))
            self.spreads[signal] = spread
            for k in judging:
                segment, name = segments[k], place(signal, k)
                measured[name] = segment.signals[signal]
                fitted[name], windows[name] = segment.fitted, segment.windows
                least[name] = max(quietest(whole), LEAST * spread)
        self.problem = Problem(measured, fitted, windows, model, least)
        self.problem.missing = {
            place(s, k): segments[k].missing[s]
            for s, _ in model.group.judged
            for k in model.judging(s)
            if s in segments[k].missing
        }
        self.problem.hurried = lambda: self.budget.over
        self.problem.sparing = model.sparing
        self.base: dict[str, float] = {PARAMETER + "|" + n: v for n, v in self.free.items()}
        with model.runs.exact():
            first = model({**self.base})  # raises where the system itself cannot be run
            self._check(first)
            self.scales = self._scales(first)
            if not model.differs:
                model.runs.forget()
                again = model({**self.base})
                model.differs = {s: self._difference(first, again, s) for s, _ in model.group.judged}
                model.coarse = self._coarse(first)
        self.differs = model.differs
        for name in least:
            signal = name.partition("#")[0]
            self.problem.least[name] = max(least[name], self.differs[signal], model.coarse.get(signal, 0.0))
        self.reaches = self._reaches()
        self.read = self._read(first)
        self._learn_white()
        self.slow = self._slow(first)
        self.slopes: dict[str, dict[str, Array]] = {}  # what a deviation of each trusted parameter changes
        self.estimated: dict[str, tuple[float, float]] = {}
        self.wide: list[Unknown] = []  # the free parameters
        self.null = self._null()
        self.learned = False
        self.steady = False  # what stays wrong passes for no noise
        self.on_all = False  # the estimates are of the whole log
        self.tried: list[Candidate] = []  # all sets that were fitted
        self.accepted = self.null  # the best as far as it has come
        self.sizes: dict[
            Action, float
        ] = {}  # log-likelihood that each cause's starts change at most, at first sight
        self.by_log: tuple[int, ...] = ()  # numbers of the logs of which each has sizes of its own
        self.moved: dict[Action, Action] = {}  # causes at an output that are as good at an input

    # What is given

    def _read(self, first: Mapping[str, Array]) -> dict[Action, Grid | Stale]:
        """What the readings show by themselves; stale samples are then modelled."""
        found: dict[Action, Grid | Stale] = {}
        for signal, port in self.model.group.judged:
            judging, names = self.model.judging(signal), self.model.places(signal)
            logs = [self.model.segments[k] for k in judging]
            series = [log.reading(signal) for log in logs]
            grid = grid_of(series)
            moved = [log.at_stamps(first[n]) for log, n in zip(logs, names, strict=True)]
            stale = None if grid else stale_of(series, moved)
            if grid is not None:
                self.model.steps[signal] = grid.step
                for name in names:
                    self.problem.least[name] = max(self.problem.least[name], ROUNDED * grid.step)
                if "port.quantisation" not in self.exclude:
                    found[Action("port.quantisation", port, "sensor")] = grid
            if stale is not None:
                own = [log.on_grid(held) for log, held in zip(logs, stale.held, strict=True)]
                self.model.held[signal] = dict(zip(judging, own, strict=True))
                if "port.dropout" not in self.exclude:
                    found[Action("port.dropout", port, "sensor")] = stale
        return found

    def _scales(self, first: Mapping[str, Array]) -> dict[str, float]:
        """Size of each trusted or free parameter: its value, or of one that is 0 a decade that moves the model."""
        values = {n: v for n, (v, _) in self.trusted.items()} | self.free
        return {n: abs(v) or self._decade(n, first) for n, v in values.items()}

    def _decade(self, name: str, first: Mapping[str, Array]) -> float:
        """Power of ten of a parameter that moves the model most nearly as much as a reading varies; 1 where none does."""
        tried = dict[int, float]()
        power = 0
        while (
            power not in tried and abs(power) <= DECADES and not (power > 2 and min(tried.values()) == np.inf)
        ):
            try:
                moved = self.model({**self.base, f"{PARAMETER}|{name}": 10.0**power})
                change = max(self._difference(first, moved, s) / self.spreads[s] for s in self.spreads)
            except SimulationError:
                change = np.inf
            tried[power] = abs(float(np.log(change))) if 0.0 < change < np.inf else np.inf
            power += 1 if change < 1.0 else -1
        best = min(tried, key=lambda p: tried[p])
        return 10.0**best if tried[best] < np.inf else 1.0

    def _difference(self, one: Mapping[str, Array], other: Mapping[str, Array], signal: str) -> float:
        """RMS by which two runs of the same differ: 0 for a system that is deterministic."""
        difference = self.model.whole(one, signal) - self.model.whole(other, signal)
        return float(np.sqrt(np.mean(difference**2)))

    def _coarse(self, first: Mapping[str, Array]) -> dict[str, float]:
        """RMS error that the model's own solvers make of each signal; nothing where that cannot be asked."""
        model, h = self.model, max(s.h for s in self.model.segments)
        units = dict.fromkeys(unit for own in model.cuts for unit in own.units)
        # what goes round within a loop comes a step late: that is no solver's error
        if any(len(unit.components) > 1 or not model.runs.can_halve(unit, h) for unit in units):
            return {}
        try:
            with model.runs.finer():
                fine = model({**self.base})
        except SimulationError:
            return {}
        # half the step leaves half the error of a solver of first order, a hundredth of the tolerance hardly any
        inside = model.group.components
        part = 1.0 if any(model.system.components[c].fmu.tolerance for c in inside) else 2.0
        found = {s: part * self._difference(first, fine, s) for s, _ in model.group.judged}
        # of a model far beyond its reading, as in another unit, the error falls with all that brings it there
        ranges = {s: float(np.std(model.whole(first, s))) for s in found}
        shares = {s: min(1.0, self.spreads[s] / max(ranges[s], 1e-300)) for s in found}
        # and of one that halves its steps and is another model, all would pass for its solvers' error
        return {
            s: min(shares[s] * size, MOST_COARSE * self.spreads[s])
            for s, size in found.items()
            if np.isfinite(size)
        }

    def _matters(self, signal: str) -> float:
        """RMS of what matters: less is nobody's concern, or the error of the model's own solvers."""
        return max(SIZE * self.spreads[signal], SOLVERS * self.model.coarse.get(signal, 0.0))

    def _check(self, series: Mapping[str, Array]) -> None:
        for name, values in series.items():
            if not np.isfinite(values).all():
                raise SimulationError(
                    f"'{name.partition('#')[0]}' is not a finite number in the model's own run"
                )

    def _reaches(self) -> dict[str, Reach]:
        """Reach of each place where an effect may act, as the model has it."""
        found: dict[str, list[Array]] = {}
        for k in range(len(self.model.segments)):
            for name, series in self.model.ports(self.base, k).items():
                if name.startswith(("pure:", "in:")):
                    found.setdefault(name, []).append(series)
        h = self.model.segments[0].h
        return {name: Reach.of(np.concatenate(parts), h) for name, parts in found.items()}

    def reach(self, action: Action) -> Reach:
        """What the signal reaches on which an effect acts."""
        return self.reaches[f"{'in' if action.where == 'input' else 'pure'}:{action.port}"]

    def candidates(self) -> list[Action]:
        """Everything that may be wrong in this group."""
        group, found = self.model.group, []
        found += [parameter(n) for n in self.trusted]
        driven = {d.port for d in group.drives}
        judged = {p for _, p in group.judged}
        inputs = [
            p
            for p in [*(d.port for d in group.drives), *(w.target for w in group.inner)]
            if not self.model.looped(p)
        ]
        outputs = [
            p
            for p in [*(p for _, p in group.judged), *(w.source for w in group.inner)]
            if not self.model.looped(p)
        ]
        fans = [w.source for w in group.inner]
        for port in dict.fromkeys(inputs):
            if port in driven or not self._only_wire(port, fans, judged):
                found += [Action(e, port, "input") for e, effect in EFFECTS.items() if not effect.reading]
        for port in dict.fromkeys(outputs):
            found += [Action(e, port, "output") for e, effect in EFFECTS.items() if not effect.reading]
        for signal, port in group.judged:
            found.append(Action("port.drift", port, "sensor"))
            if (
                signal in self.model.own
            ):  # what the reading drives is here: it knows whether the reading alone is off
                found += [Action(e, port, "sensor") for e, effect in EFFECTS.items() if not effect.reading]
        real = {
            p for p in dict.fromkeys(a.port for a in found) if self.model.system.variable(p).kind == "Real"
        }
        return [a for a in found if a.effect not in self.exclude and a.port in real]

    def _only_wire(self, port: Port, fans: Sequence[Port], judged: set[Port]) -> bool:
        """Whether an unmeasured wire into this port is the only one of its source: then both of its ends are one place."""
        source = next(w.source for w in self.model.group.inner if w.target == port)
        return fans.count(source) == 1 and source not in judged

    def numbers(self, action: Action) -> list[Unknown]:
        """Unknowns of a cause."""
        if action.effect == PARAMETER:
            name = str(action.port)
            value = self.trusted[name][0]
            variable = self.model.system.variable(action.port)
            size = self.scales[name]
            low, high = max(variable.low, value - 20.0 * size), min(variable.high, value + 20.0 * size)
            if value > 0.0:
                low = max(low, 1e-3 * value)  # a sign that turns is another model
            return [Unknown(f"{PARAMETER}|{name}", low, high, 0.2 * size)]
        return unknowns(action, self.reach(action))

    def moderate(self, action: Action) -> dict[str, float]:
        """A moderate size of it; nothing for what a reading shows by itself."""
        if action.effect == PARAMETER:
            value, deviation = self.trusted[str(action.port)]
            size = max(0.2, 5.0 * deviation) * self.scales[str(action.port)]
            (unknown,) = self.numbers(action)
            return {unknown.name: unknown.within(value + size)}
        return moderate(action, self.reach(action))

    def _sides(self, action: Action) -> dict[str, list[float]]:
        return {} if action.effect == PARAMETER else sides(action, self.reach(action))

    def begins(self, action: Action) -> list[dict[str, float]]:
        """Where its search begins."""
        if action.effect == PARAMETER:
            value = self.trusted[str(action.port)][0]
            size = self.scales[str(action.port)]
            (unknown,) = self.numbers(action)
            near = dict.fromkeys(unknown.within(value + part * size) for part in (0.2, -0.2, 0.8))
            return [{unknown.name: v} for v in near if v != value]
        return starts(action, self.reach(action))

    # Sizes that differ from log to log

    def _free(self, actions: Sequence[Action]) -> list[Unknown]:
        """What is fitted of causes: their numbers, or those of each log."""
        numbers = [u for a in actions for u in self.numbers(a)]
        if not self.by_log:
            return numbers
        return [replace(u, name=each(u.name, log)) for u in numbers for log in self.by_log]

    def _fit(
        self,
        actions: Sequence[Action],
        begin: Mapping[str, float],
        evaluations: int = EVALUATIONS,
        difference: float = DIFFERENCE,
        roughly: Array | None = None,
    ) -> Fit | None:
        """A fit of causes; where each log has sizes of its own their numbers are the means of these."""
        free = self._free(actions)
        own = {u.name: begin.get(u.name, begin[of_all(u.name)]) for u in free}
        fit = self.problem.fit(free, {**begin, **own}, evaluations, difference, roughly=roughly)
        return None if fit is None else self._meant(fit, actions)

    def _meant(self, fit: Fit, actions: Sequence[Action]) -> Fit:
        """A fit in the numbers of all logs."""
        if not self.by_log or not fit.unknowns:
            return fit
        numbers = [u for a in actions for u in self.numbers(a)]
        logs = len(self.by_log)
        mean = np.kron(np.eye(len(numbers)), np.full((1, logs), 1.0 / logs))
        means = mean @ np.array([fit.values[u.name] for u in fit.unknowns])
        values = fit.values | {u.name: float(m) for u, m in zip(numbers, means, strict=True)}
        return replace(fit, values=values, covariance=mean @ fit.covariance @ mean.T, unknowns=tuple(numbers))

    def _values_without(self, candidate: Candidate, actions: Sequence[Action]) -> dict[str, float]:
        """A candidate's values without the numbers of some causes."""
        lost = {u.name for a in actions for u in self.numbers(a)}
        return {n: v for n, v in candidate.fit.values.items() if of_all(n) not in lost}

    @staticmethod
    def _shifted(values: Mapping[str, float], name: str, value: float) -> dict[str, float]:
        """Values with another one of a number, and as much more or less in each log that has its own."""
        step = value - values[name]
        return {n: v + step if of_all(n) == name else v for n, v in values.items()}

    def _scattered(self, found: list[Candidate], null: Candidate) -> list[Candidate]:
        """The candidates with sizes of each log's own, where these explain more than their price: a limit that changes.

        What is wrong in some logs alone is no size: a log that shows none of it, and contradicts what the others have, is
        left to be judged apart.
        """
        logs = [s.number for s in self.model.segments if s.fitted.any()]
        if len(logs) < 2 or self.budget.over:
            return found
        best = found[0]
        self.by_log = tuple(logs)
        fit = self._fit(best.actions, best.fit.values, 8)
        own = None if fit is None else self._scored(Candidate(best.actions, fit, self._price(best.actions)))
        if own is None or own.score < best.score + NAMED or self._absent(own):
            self.by_log = ()
            return found
        again = [own, *(Candidate(c.actions, c.fit, self._price(c.actions)) for c in found[1:])]
        return self._relearned(again, [null])

    def _held_own(self, best: Candidate) -> dict[str, float]:
        """Values of the best with which what stays wrong is asked: a log held out may have sizes of its own as well."""
        logs = [s.number for s in self.model.segments if not s.fitted.any()]
        values = dict(best.fit.values)
        if not self.by_log or not best.actions or not logs or self.budget.over:
            return values
        free = [
            replace(u, name=each(u.name, log)) for a in best.actions for u in self.numbers(a) for log in logs
        ]
        values |= {u.name: values[of_all(u.name)] for u in free}
        with self.problem.whole():
            fit = self.problem.fit(free, values, 8)
        return values if fit is None else fit.values

    def _absent(self, candidate: Candidate) -> bool:
        """Whether a log is nearer to having nothing of a cause than to the mean of all."""
        for action in candidate.actions:
            for log in self.by_log:
                own = candidate.fit.values
                none, mean = (
                    self._at(own | {each(n, log): v for n, v in values.items()})
                    for values in (self._off(action), {u.name: own[u.name] for u in self.numbers(action)})
                )
                if none > mean + CLOSE:
                    return True
        return False

    # The null model

    def _learn_white(self) -> None:
        """A first idea of the noise: what is independent from sample to sample."""
        from cosim.inference.noise import Noise

        for name, values in self.problem.measured.items():
            read = values[~self.problem.missing[name]] if name in self.problem.missing else values
            self.problem.noise[name] = Noise(max(white_noise(read), self.problem.least[name]) ** 2)

    def _null(self) -> Candidate:
        problem = self.problem
        if self.free:
            wide = self.wide
            for name, value in self.free.items():
                variable = self.model.system.variable(Port(*name.split(".", 1)))
                size = self.scales[name]
                low, high = max(variable.low, value - 50.0 * size), min(variable.high, value + 50.0 * size)
                wide.append(
                    Unknown(
                        f"{PARAMETER}|{name}",
                        max(low, 1e-3 * value) if value > 0.0 else low,
                        high,
                        0.2 * size,
                    )
                )
            factors = (1.0, 0.5, 2.0)
            scaled = [{u.name: u.within(f * self.base[u.name]) for u in wide} for f in factors]
            best = self._best_of(wide, [self.base | own for own in scaled])
            if best is not None:
                self.base = best.values
                self.estimated = {
                    n: (best.values[f"{PARAMETER}|{n}"], best.deviation(f"{PARAMETER}|{n}"))
                    for n in self.free
                }
        self._share(self.base)
        self._hold()
        fit = problem.fit((), self.base)
        if fit is None:
            raise SimulationError(
                problem.failures[0] if problem.failures else "the model gives no finite numbers"
            )
        return Candidate((), fit, 0.0)

    def _hold(self) -> None:
        """Begin with inputs that are held over each sample where that alone makes far more of a log.

        The moment at which an input acts is a nuisance with a slope. Where contacts and other switches within a component
        make half a sample more than the slope of it, the end of its range that controllers have is tried as it is.
        """
        held = {
            f"{HOLD}:{d.signal}>{d.port}": -0.5
            for d in self.model.group.drives
            if self.model.system.variable(d.port).kind == "Real"
        }
        before, after = self.problem.rows(self.base), self.problem.rows({**self.base, **held})
        if not held or before is None or after is None:
            return
        inside = self.problem.mask
        left, now = float(np.sum(before[inside] ** 2)), float(np.sum(after[inside] ** 2))
        if now < FAR_LESS * left and 0.5 * (left - now) > FAR_MORE:
            self.base |= held
            self._share(self.base)

    def _share(self, at: Mapping[str, float]) -> None:
        """Slopes of the nuisances around some values."""
        model, problem = self.model, self.problem
        here = model(at)
        nuisances, rows = [], []

        def add(unknown: Unknown, moved: Mapping[str, Array], step: float) -> None:
            slope = {n: (moved[n] - here[n]) / step for n in problem.names}
            if self._bounded(slope):
                nuisances.append(unknown)
                rows.append(slope)

        def add_each(unknown: Unknown, slope: Mapping[str, Array]) -> None:
            for own, part in self._each(unknown, slope) if self._bounded(slope) else ():
                nuisances.append(own)
                rows.append(part)

        for drive in model.group.drives:
            name = f"{SHIFT}:{drive.signal}>{drive.port}"
            # half a sample: the slope is then exact for an input that is held over each step. What is true or false, or a
            # whole number, acts from its sample on or an interval earlier, where what is read at the same sample has seen it
            real = model.system.variable(drive.port).kind == "Real"
            try:
                moved = [model({**at, name: s}) for s in ((0.5, -0.5) if real else (1.0, 0.0))]
            except SimulationError:
                continue
            slope = {n: moved[0][n] - moved[1][n] for n in problem.names}
            add_each(Unknown(name, -EARLY, EARLY, 1.0, JITTER), slope)
        for signal, quantity in model.drives.items():
            for i in range(len(quantity.slopes)):
                name = f"{DRIVE}:{signal}:{i}"
                try:
                    moved_one = model({**at, name: 1.0})
                except SimulationError:
                    continue
                add(Unknown(name, -SURE, SURE, 1.0, 1.0), moved_one, 1.0)
        for signal, _ in model.group.judged:
            if signal in model.steps:
                continue  # a step hides by far more than what a sample's moment makes out
            shifted = {
                n: np.gradient(here[n]) * ~problem.missing.get(n, np.zeros(here[n].size, dtype=np.bool_))
                if n.partition("#")[0] == signal
                else np.zeros_like(here[n])
                for n in problem.names
            }
            add_each(Unknown(f"{SHIFT}:{signal}", -EARLY, EARLY, 1.0, JITTER), shifted)
        for name, (value, deviation) in self.trusted.items():
            key = f"{PARAMETER}|{name}"
            if any(k == key for k in at):
                continue  # it is a cause here
            step = deviation * self.scales[name]
            try:
                moved_one = model({**at, key: value + step})
            except SimulationError:
                continue
            add(Unknown(key, -SURE, SURE, 1.0, 1.0), moved_one, 1.0)
            if nuisances and nuisances[-1].name == key:
                self.slopes[name] = rows[-1]
        for name in self.free:
            key = f"{PARAMETER}|{name}"
            step = 0.02 * (abs(at[key]) or self.scales[name])
            try:
                moved_one = model({**at, key: at[key] + step})
            except SimulationError:
                continue
            add(Unknown(f"free:{key}", -np.inf, np.inf, 1.0, 1e3), moved_one, 1.0)
        for unknown, slope in self.slow:
            nuisances.append(unknown)
            rows.append(slope)
        problem.share(
            nuisances, {n: np.array([r[n] for r in rows]).reshape(len(rows), -1) for n in problem.names}
        )

    def _bounded(self, slope: Mapping[str, Array]) -> bool:
        """Whether a model does not run away where it is moved: its slope says something."""
        return all(
            float(np.abs(s).max(initial=0.0)) < RUNAWAY * self.spreads[n.partition("#")[0]]
            for n, s in slope.items()
        )

    def _slow(self, first: Mapping[str, Array]) -> list[tuple[Unknown, dict[str, Array]]]:
        """Slow errors of what drives the group, as nuisances: what a component that integrates makes of them is no fault.

        A drive is off by no more than programs agree on, all along; and by the mean of its reading's noise in each part of
        the log, where the group does not forget it.
        """
        model, found = self.model, list[tuple[Unknown, dict[str, Array]]]()
        for drive in {d.signal: d for d in model.group.drives}.values():
            signal = drive.signal
            if model.system.variable(drive.port).kind != "Real":
                continue
            readings = [
                s.signals[signal]
                for s, own in zip(model.segments, model.cuts, strict=True)
                if any(d.signal == signal for d in own.drives)
            ]
            spread = float(np.std(np.concatenate(readings)))
            noise = max(white_noise(r) for r in readings)
            count = min(r.size for r in readings) / PARTS
            sizes = [(0.0, 1.0, LEAST * spread)]
            sizes += [
                (p / PARTS, (p + 1) / PARTS, noise / np.sqrt(count)) for p in range(PARTS) if noise > 0.0
            ]
            for number, (begin, end, size) in enumerate(sizes):
                if size <= 0.0:
                    continue
                # large enough to be seen in the digits of an FMU that controls its own step
                step = 0.02 * spread
                model.off[signal] = begin, end, step
                try:
                    moved = model({**self.base})
                except SimulationError:
                    break
                finally:
                    model.off.clear()
                slope = {n: (moved[n] - first[n]) / step for n in self.problem.names}
                if number == 1 and not self._kept(slope):
                    break
                unknown = Unknown(f"slow:{signal}:{number}", -SURE * size, SURE * size, size, size)
                found += self._each(unknown, slope)
        return found

    def _each(self, unknown: Unknown, slope: Mapping[str, Array]) -> list[tuple[Unknown, dict[str, Array]]]:
        """A nuisance with its slopes in each log by itself: when a logger reads, and how far a drive is off, differ."""
        count = len(self.model.segments)
        if count == 1:
            return [(unknown, dict(slope))]
        return [
            (
                replace(unknown, name=f"{unknown.name}#{k}"),
                {n: s if n.endswith(f"#{k}") else np.zeros_like(s) for n, s in slope.items()},
            )
            for k in range(count)
        ]

    @staticmethod
    def _kept(slope: Mapping[str, Array]) -> bool:
        """Whether what happened in the first part of a log is still there at its end."""
        return any(
            float(np.abs(s[-max(s.size // PARTS, 1) :]).mean()) > KEPT_ON * float(np.abs(s).max()) > 0.0
            for s in slope.values()
        )

    # The search

    def wrong(self) -> dict[str, str]:
        """Signals that are systematically wrong without any cause, with words."""
        residual = self.problem.residuals(self.null.fit.values)
        return self._wrong(self._told(residual, self.null), residual)

    def contradicts(self, finding: Finding) -> bool:
        """Whether these logs are explained worse with what was found in others."""
        here = self.problem.rows(self.null.fit.values)
        names = {u.name for a in finding.chosen.actions for u in finding.chosen.fit.unknowns}
        values = {n: v for n, v in finding.chosen.fit.values.items() if n in names}
        theirs = self.problem.rows({**self.null.fit.values, **values})
        if here is None or theirs is None:
            return here is not None
        return 0.5 * float(theirs @ theirs - here @ here) > CLOSE

    def likeliest_of(self, names: Sequence[str], values: Mapping[str, float]) -> list[str]:
        """Of some parameters those whose slopes promise something, beside nothing or about these values; the best first."""
        gains = [self.problem.freed(at) for at in (self.null.fit.values, values)]
        most = {n: max(g.get(f"{PARAMETER}|{n}", 0.0) for g in gains) for n in names}
        return sorted((n for n in names if most[n] > NAMED), key=lambda n: -most[n])[:ASKED]

    def instead(
        self, names: Sequence[str], actions: Sequence[Action], values: Mapping[str, float]
    ) -> Candidate | None:
        """The best explanation with one of some parameters in the place of a cause or of all, if it is nearly as good.

        Args:
            names: the parameters.
            actions: the causes, as another search found them.
            values: theirs, and all others.
        """
        chosen = Candidate(
            tuple(actions), replace(self.null.fit, values={**self.null.fit.values, **values}), 0.0
        )
        self._settle(chosen)
        kept = dict.fromkeys([(), *(tuple(a for a in actions if a != out) for out in actions)])
        found: list[Candidate] = []
        for name in names:
            for rest in kept:
                if self.budget.over:
                    self._left_out(f"{name}, which is taken as exact")
                    break
                at = {**self.null.fit.values, **{n: values[n] for a in rest for n in self._off(a)}}
                begin = max(({**at, **own} for own in self.begins(parameter(name))), key=self._at)
                several = (*rest, parameter(name))
                if (fit := self._fit(several, begin)) is not None:
                    found.append(self._scored(Candidate(several, fit, self._price(several))))
        best = max(found, key=lambda c: c.score, default=None)
        null = self._scored(self.null).score
        least = null + max(NAMED, (1.0 - PROMISE) * (chosen.score - null))
        return best if best is not None and best.score >= least else None

    def run(self, begin: Candidate | None = None) -> Finding:
        """Causes, rivals, what stays; begun beside what explains most of the log, if that is known."""
        finding = Finding(
            self.model, self.problem, self.null, self.null, spreads=self.spreads, free=self.estimated
        )
        residual = self.problem.residuals(self.null.fit.values)
        finding.before = self._told(residual, self.null)
        try:
            best, singles = self._searched(begin)
            fewer = self._pruned(best)
            if self._drifts(best, fewer):
                self.steady = True
                fewer = self._pruned(self._refitted([best], [self.null])[0])
        except OutOfTimeError:  # in the middle of a run: what was accepted before stands
            fewer, singles = self.accepted, []
            self._left_out("what the search had begun")
        with self.model.runs.uncut():
            self._decide(finding, fewer, singles)
        return finding

    def _searched(self, begin: Candidate | None) -> tuple[Candidate, list[Candidate]]:
        """The causes that explain most, and those that were fitted one by one."""
        best, pool = self.null, [self.null]
        singles: list[Candidate] = []
        with self.budget.part(SEARCHING):
            if begin is not None:
                pool = self._relearned([begin], [self.null])
                best, singles = pool[0], [c for c in pool if len(c.actions) == 1]
            for count in range(1 if begin is None else 2, self.most + 1):
                if not self._systematic(best, count):
                    break
                if self.budget.over:
                    self._left_out("any cause" if count == 1 else f"a cause number {count}")
                    break
                found: list[Candidate] = []
                least = pool[0].fit.log_likelihood
                for base in pool[:KEPT]:
                    if base.fit.log_likelihood >= FAR_BEHIND * least:
                        found += self._stage(base)
                found = self._unique(found)
                self.tried += found
                if not found:
                    break
                if count == 1:
                    found = self._with_numbers(found)
                found = self._relearned(found, [best, *singles])
                if count == 1:
                    found = self._by_score([self._needed(c) if len(c.actions) > 1 else c for c in found])
                    if len(found[0].actions) == 1 and found[0].score > self._scored(best).score + NAMED:
                        found = self._scattered(found, best)
                    singles = [c for c in found if len(c.actions) == 1]
                richer = found[0]
                poorer = self._scored(best)
                likelier = richer.score >= poorer.score + NAMED
                if not likelier and self._drifts(richer, poorer):
                    self.steady = True
                    found = self._refitted(found, [best, *singles])
                elif likelier and count > 1 and not self.steady and not self._nearer(poorer, richer):
                    found = self._by_the_run(found, best, singles)
                richer, poorer = found[0], self._scored(best)
                if richer.score < poorer.score + NAMED or (count > 1 and not self._nearer(poorer, richer)):
                    break
                best, pool = richer, found
                self.accepted = best
        if self.learned:  # a stage that failed has learned its own
            self._settle(best)
            for other in singles:
                self._scored(other)
        return best, singles

    def _between(self, best: Candidate) -> dict[str, Between]:
        """Each number of the causes by where each of the fitted logs draws it: how a machine changes until the next."""
        if len(self.model.segments) < 2 or not best.actions:
            return {}
        if self.budget.over:
            self._left_out("what each log says of the estimates")
            return {}
        if self.by_log:
            return self._between_own(best)
        names, nuisances = self.problem.names, [u.name for u in self.problem.nuisances_shared]
        logs = [np.full(self.problem.measured[n].size, int(n.rpartition("#")[2])) for n in names]
        # what is believed of a nuisance of one log counts as that log's
        own = [int(n.rpartition("#")[2]) if "#" in n else -1 for n in nuisances]
        numbers = np.concatenate([*logs, np.array(own, dtype=np.int64)])
        fit = best.fit
        with self.problem.whole() if self.on_all else nullcontext():
            self._scored(best)
            fit = best.fit
            numbers = np.where(self.problem.mask, numbers, -1)
            slopes = self.problem.slopes(fit)
        drawn = drawn_by_logs(slopes, fit.rows, numbers, np.array([u.scale for u in fit.unknowns]))
        if drawn is None:
            return {}
        nothing = self._nothing(best.actions)
        return {
            u.name: between_logs(
                fit.values[u.name],
                fit.deviation(u.name),
                drawn.steps[:, i],
                drawn.shares[:, i],
                self._size(fit.values[u.name], nothing[u.name]),
            )
            for i, u in enumerate(fit.unknowns)
        }

    @staticmethod
    def _size(value: float, nothing: float) -> float:
        """How large a number is; a limit out of reach says nothing of one that is met."""
        return min(abs(value - nothing), abs(value))

    def _between_own(self, best: Candidate) -> dict[str, Between]:
        """The same where each log has sizes of its own, which are fitted."""
        free = self._free(best.actions)
        with self.problem.whole() if self.on_all else nullcontext():
            fit = self.problem.fit(free, best.fit.values, 8, DIFFERENCE * FINE)
        if fit is None:
            return {}
        nothing = self._nothing(best.actions)
        found = {}
        for number in (u for a in best.actions for u in self.numbers(a)):
            names = [each(number.name, log) for log in self.by_log]
            values = np.array([fit.values[n] for n in names])
            # a limit that a log does not meet has no slope there
            deviations = np.array([fit.deviation(n) for n in names])
            told = deviations > 0.0
            own, squares = values[told], deviations[told] ** 2
            if own.size < 2:
                value, deviation = best.fit.values[number.name], best.fit.deviation(number.name)
                all_ = (float(own[0]), float(squares[0])) if own.size else (value, deviation**2)
                found[number.name] = Between(all_[0], values, np.where(told, deviations, np.inf), all_[1])
                continue
            size = self._size(float(own.mean()), nothing[number.name])
            over = combined(float(own.mean()), 0.0, values, deviations, size)
            weights = 1.0 / (squares + over.scatter**2)
            weights /= weights.sum()
            found[number.name] = replace(
                over,
                value=float(weights @ own),
                within=float(weights**2 @ squares),
                share=float(weights @ weights),
            )
        return found

    def _holds_none(self, action: Action, fit: Fit) -> bool:
        """Whether the 95 % interval of a parameter holds what the model has."""
        ((name, nothing),) = self._off(action).items()
        return abs(fit.values[name] - nothing) <= 1.96 * fit.deviation(name)

    def _none_between(self, action: Action, between: Mapping[str, Between]) -> bool:
        """Whether several logs, taken as repetitions, do not tell any size of a cause from none."""
        ends = {n: (between[n].ci95, off) for n, off in self._off(action).items() if n in between}
        return bool(ends) and all(low <= off <= high for (low, high), off in ends.values())

    def _off(self, action: Action) -> dict[str, float]:
        """Values at which a cause is none."""
        if action.effect == PARAMETER:
            return {f"{PARAMETER}|{action.port}": self.trusted[str(action.port)][0]}
        return off(action, self.reach(action))

    def _nothing(self, actions: Sequence[Action]) -> dict[str, float]:
        """The same of several causes."""
        return {n: v for a in actions for n, v in self._off(a).items()}

    def _left_out(self, what: str) -> None:
        self.budget.leave_out(self.model.group.name, what)

    def _settle(self, best: Candidate) -> None:
        """Nuisances and noise as the best set leaves them."""
        self._share(best.fit.values)
        residual = self.problem.residuals(best.fit.values)
        wrong = self._wrong(self._told(residual, best), residual) if self.steady else ()
        self.problem.learn(residual, [place for signal in wrong for place in self.model.places(signal)])
        self._scored(best)

    def _scored(self, candidate: Candidate) -> Candidate:
        """The candidate's score under the noise as it is known now."""
        rows = self.problem.rows(candidate.fit.values)
        if rows is None:
            candidate.score = -np.inf
        else:
            likelihood = self.problem.log_likelihood(rows, candidate.fit.values, ())
            candidate.fit = replace(candidate.fit, rows=rows, log_likelihood=likelihood)
            candidate.price = self._price(candidate.actions)
            candidate.score = likelihood - candidate.price
        return candidate

    def _rms(self, fit: Fit) -> list[float]:
        residual = self.problem.residuals(fit.values)
        return [
            float(np.sqrt(np.mean(self.model.whole(residual, s) ** 2))) for s, _ in self.model.group.judged
        ]

    def _by_the_run(
        self, found: list[Candidate], best: Candidate, singles: Sequence[Candidate]
    ) -> list[Candidate]:
        """Sets with one cause more by the least error of the run, where that brings one nearer; else as they were.

        What the model lacks besides is slow, as noise may be: by noise that was learned of it a set may be far likelier and
        come no nearer.
        """
        others = [best, *singles]
        self.steady = True
        again = self._refitted(found, others)
        self._scored(best)
        if self._nearer(best, again[0]):
            return again
        self.steady = False
        self._settle(found[0])
        for other in (*others, *found):
            self._scored(other)
        return found

    def _nearer(self, poorer: Candidate, richer: Candidate) -> bool:
        """Whether a set with one cause more comes so much nearer to a signal that a further one is worth looking for."""
        rows = self._rms(poorer.fit), self._rms(richer.fit)
        return min(b / max(a, 1e-300) for a, b in zip(*rows, strict=True)) <= WORTH

    def _systematic(self, candidate: Candidate, count: int) -> bool:
        """Whether there may be anything (more) to find."""
        if count == 1:
            return True
        residual = self.problem.residuals(candidate.fit.values)
        left = self._told(residual, candidate)
        return bool(self._wrong(left, residual)) or self._above_noise(candidate.fit)

    def leaves(self, signal: str, candidate: Candidate) -> float:
        """RMS of what a candidate leaves of a signal, over the noise of its reading."""
        sizes = dict(zip([s for s, _ in self.model.group.judged], self._rms(candidate.fit), strict=True))
        return sizes[signal] / max(self._white(signal), 1e-300)

    def _above_noise(self, fit: Fit) -> bool:
        """Whether a fit leaves more of a signal than its reading's noise."""
        sizes = zip(self.model.group.judged, self._rms(fit), strict=True)
        return any(size > ABOVE * self._white(signal) for (signal, _), size in sizes)

    def _stage(self, base: Candidate) -> list[Candidate]:
        """The set with each promising cause more: all are looked at, the best are fitted, and then what is dear is tried."""
        rest = self.problem.rows(base.fit.values)
        if rest is None:
            return []
        looks: dict[Action, Look] = {}
        followed: list[Action] = []
        gains = self._at_first_sight(base)
        beside = self._beside(base, rest)
        with self.budget.part(LOOKED):
            for action in self._most_likely_first(gains):
                if action in base.actions or self._twice(action, base.actions):
                    continue
                if action.effect != PARAMETER and not acts(action.effect, self.reach(action)):
                    self.sizes[action] = 0.0
                    continue
                if self.budget.over:
                    self._left_out(action.effect)
                    continue
                look = Look(beside)
                self._look(action, look)
                looks[action] = look
                # nobody follows what nobody sees
                if (
                    action.effect == PARAMETER
                    and any(0.5 * float(c @ c) > NAMED for c in look.changes)
                    and (self._loses_step(action) or self._other_optima(look.changes))
                ):
                    followed.append(action)
        found = self._best_fitted(beside, looks, {})
        if followed:
            early = self._at_first_sight(base, HORIZONS[1])
            followed.sort(key=lambda a: -max(gains.get(a, 0.0), early.get(a, 0.0)))
            with self.budget.part(LOOKED):
                for action in followed:
                    if self.budget.over:
                        self._left_out(f"{action.effect} followed from the first part of the log")
                        continue
                    self._reached(action, self._kept_in_step(base, action), looks[action])
            found = self._best_fitted(beside, looks, found)
        ordered = self._by_score(list(found.values()))
        return [self._both_sides(c) if k < KEPT else c for k, c in enumerate(ordered)]

    def _with_numbers(self, singles: list[Candidate]) -> list[Candidate]:
        """The causes one by one, and before them several wrong numbers of the model at once where these explain more.

        One number in the place of several leaves so much that effects elsewhere seem to explain it better, and that what
        is left passes for noise. Hence they are fitted before the noise is learned.
        """
        best = singles[0]
        if min(len(self.trusted), self.most) < 2 or not self._systematic(best, 2):
            return singles
        if self.budget.over:
            self._left_out("several parameters at once")
            return singles
        leading = next((c for c in singles if c.actions[0].effect == PARAMETER), None)
        actions = self._seen_apart(leading)
        if len(actions) < 2:
            return singles
        begin = {**self._nothing(actions), **self.null.fit.values}
        starts = [begin]
        if leading is not None and leading.actions[0] in actions:
            starts.append(begin | leading.fit.values)
        # slopes of the nuisances around numbers that are far off, as where a model runs away, say nothing of the right ones
        with self.problem.sharing(()):
            fit = self._best_of(self._free(actions), starts)
        if fit is None:
            return singles
        self._share(fit.values)
        fit = self._fit(actions, fit.values, 10)
        if fit is not None:
            several = self._needed(self._scored(Candidate(actions, fit, self._price(actions))))
        if fit is None or len(several.actions) < 2 or several.score < best.score + NAMED:
            self._share(self.null.fit.values)
            return singles
        self.tried.append(several)
        return [several, *singles]

    def _best_of(self, unknowns: Sequence[Unknown], starts: Sequence[dict[str, float]]) -> Fit | None:
        """The best fit of several numbers from these starts, each also by way of one that bears large errors.

        Where a law bends, as at a dead zone, and a model that integrates runs far away, least squares end where all errors
        are middling. A fit that lets some parts of a log be wrong finds the numbers that make the others right.
        """
        found: list[Fit] = []
        for at in starts:  # the first of fits that are as good stays the first
            if found and self.budget.over:
                break
            near = self.problem.fit(unknowns, at, 25, robust=True)
            begins = [at] if near is None else [at, near.values]
            found += [fit for v in begins if (fit := self.problem.fit(unknowns, v, 25)) is not None]
            found.sort(key=lambda f: -f.log_likelihood)
            top = found[0].log_likelihood if found else 0.0
            if len(found) > 1 and top - found[1].log_likelihood < 1.0 + AGREES * abs(top):
                break  # two ways lead there
        if not found:
            return None
        best = found[0]
        stated = dict[str, float]()
        for unknown in unknowns:  # one of which the data say nothing stays where it was
            moved = best.values | stated | {unknown.name: starts[0][unknown.name]}
            if self._at(moved) > best.log_likelihood - NOTHING:
                stated[unknown.name] = starts[0][unknown.name]
        return self.problem.fit(unknowns, best.values | stated, 1) if stated else best

    def _seen_apart(self, leading: Candidate | None) -> tuple[Action, ...]:
        """Trusted parameters of which a moderate size shows beside all others: of two that do the same, one.

        Of the one that explains most by itself its own size: a limit that is just not met has no slope.
        """
        changes = {}
        for name, slope in self.slopes.items():
            value, deviation = self.trusted[name]
            (size,) = self.moderate(parameter(name)).values()
            times = (size - value) / (deviation * self.scales[name])
            changes[name] = {n: times * s for n, s in slope.items()}
        if leading is not None:
            here, there = (self.problem.model(f.values) for f in (self.null.fit, leading.fit))
            changes[str(leading.actions[0].port)] = {n: there[n] - here[n] for n in self.problem.names}
        return tuple(parameter(n) for n in self.problem.apart(changes, NAMED))

    def _needed(self, several: Candidate) -> Candidate:
        """Of several parameters those that count, by the fit's slopes; fitted again."""
        trusted = self._nothing(several.actions)
        price = self._price(several.actions[:1])
        spare = self.problem.spare(several.fit, trusted, NAMED + price)[: len(several.actions) - 1]
        while spare and not self.budget.over:
            names = [name for name, _ in spare]
            lost = [a for a in several.actions if f"{PARAMETER}|{a.port}" in names]
            actions = tuple(a for a in several.actions if a not in lost)
            stay = self._values_without(several, lost)
            fit = self._fit(actions, {n: spare[-1][1].get(n, v) for n, v in stay.items()}, 8)
            if fit is not None:
                fewer = self._scored(Candidate(actions, fit, self._price(actions)))
                if fewer.score > several.score - NAMED:
                    return self._needed(fewer) if len(actions) > 1 else fewer
            spare = spare[: len(spare) // 2]  # slopes do not reach so far
        # what is compared with it has numbers enough to make up for a fit that ended early
        fine = self._fit(several.actions, several.fit.values, 8, DIFFERENCE * FINE)
        if fine is None or fine.log_likelihood < several.fit.log_likelihood:
            return several
        return self._scored(replace(several, fit=fine))

    def _at_first_sight(self, base: Candidate, part: float = 1.0) -> dict[Action, float]:
        """Log-likelihood that each trusted parameter would gain by its slope alone, in the first part of the log."""
        counts = {n: max(round(part * m.size), 1) for n, m in self.problem.measured.items()}
        with self.problem.first(counts) if part < 1.0 else nullcontext():
            freed = self.problem.freed(base.fit.values)
        names = {f"{PARAMETER}|{n}": parameter(n) for n in self.trusted}
        return {names[n]: gain for n, gain in freed.items() if n in names}

    def _most_likely_first(self, gains: Mapping[Action, float]) -> list[Action]:
        """All candidates: parameters whose slopes promise something, the best first; effects at ports; other parameters."""
        rank = {a: (0, -g) if (g := gains.get(a, 0.0)) > NAMED else (2, -g) for a in gains}
        return sorted(self.candidates(), key=lambda a: rank.get(a, (2 if a.effect == PARAMETER else 1, 0.0)))

    def _beside(self, base: Candidate, rest: Array) -> Base:
        """A set beside which one cause more is looked for, with what its numbers can make up for."""
        slopes = self.problem.slopes(replace(base.fit, rows=rest), DIFFERENCE)
        span, _ = np.linalg.qr(slopes[self.problem.mask][:, np.any(slopes != 0.0, axis=0)])
        return Base(base, rest, slopes, span)

    def _reached(self, action: Action, start: dict[str, float], look: Look) -> float:
        """What a start reaches as it is; kept with what it promises as the numbers beside it follow.

        That is the score test of the cause: what it changes beyond what these can make up for, and how far that goes along
        with what is left.
        """
        inside, base = self.problem.mask, look.base
        with self.problem.fitted_alone():
            rows = self.problem.rows({**base.candidate.fit.values, **start})
        if rows is None:
            return 0.0
        change = (base.rest - rows)[inside]
        with np.errstate(over="ignore"):  # a start that makes a model run away
            size = float(change @ change)
        if not np.isfinite(size):
            return 0.0
        look.changes.append(change)
        if not base.candidate.actions:
            self.sizes[action] = max(self.sizes.get(action, 0.0), 0.5 * size)
        if size <= 0.0:
            return 0.0
        reached = float(change @ base.rest[inside]) - 0.5 * size
        own = change - base.span @ (base.span.T @ change)
        beyond = float(own @ own)
        along = float(own @ base.rest[inside]) if beyond > FOLLOWED * size else 0.0
        part = along / beyond if along else 0.0
        promise = max(0.5 * along * abs(part), reached)
        if promise > 0.0:
            part = float(np.clip(part, SMALLEST, 1.0))
            moved = np.linalg.lstsq(base.slopes[inside], part * change, rcond=None)[0]
            follow = {u.name: u.scale * float(m) for u, m in zip(base.unknowns, moved, strict=True)}
            look.starts.append(Begin(promise, start, part, follow))
        return reached

    def _begun(self, base: Base, action: Action, begin: Begin) -> dict[str, float]:
        """Where a fit begins: at a start as it was tried, or at as much of it as the log asks for, others following."""
        values = base.candidate.fit.values
        plain = {**values, **begin.start}
        if begin.part == 1.0 and not begin.follow:
            return plain
        known = {u.name: u for u in (*base.unknowns, *self._free((action,)))}
        less = {**values, **self._part_of(action, begin.start, begin.part)}
        less |= {n: values[n] + m for n, m in begin.follow.items()}
        less = {n: known[n].within(v) if n in known else v for n, v in less.items()}
        return less if self._at(less) > self._at(plain) else plain

    def _part_of(self, action: Action, start: Mapping[str, float], part: float) -> dict[str, float]:
        """So much of a cause as a part of a start is."""
        if action.effect == PARAMETER:
            return {n: v + part * (start[n] - v) for n, v in self._off(action).items()}
        return part_of(action, self.reach(action), start, part)

    def _look(self, action: Action, look: Look) -> None:
        """What a cause does from where its search would begin, and which of its sides do more."""
        limits = self._sides(action)
        nothing = self._off(action) if limits else {}
        both = dict(nothing)
        for name, values in limits.items():
            reached = [self._reached(action, {**nothing, name: value}, look) for value in values]
            if max(reached) > 0.0:
                both[name] = values[int(np.argmax(reached))]
        if sum(both[n] != nothing[n] for n in limits) > 1:
            self._reached(action, both, look)
        for start in () if limits else self.begins(action):
            self._reached(action, start, look)

    def _best_fitted(
        self, base: Base, looks: Mapping[Action, Look], before: Mapping[Action, Candidate]
    ) -> dict[Action, Candidate]:
        """Fits of those that promise most; those that were fitted before stay, with what better starts give."""
        ranked: list[tuple[float, Action, list[Begin]]] = []
        for action, look in looks.items():
            if look.starts:
                own = sorted(look.starts, key=lambda begin: -begin.promise)
                ranked.append((own[0].promise, action, own[: self._tries(action)]))
        ranked.sort(key=lambda item: -item[0])
        chosen = [r for r in ranked[:SCREENED] if r[0] >= max(2.0, 0.02 * ranked[0][0])]
        known = {action.effect for _, action, _ in chosen}
        for item in ranked[SCREENED:]:  # one effect at many places shall not keep the others out
            if (
                len(chosen) < SCREENED + OTHERS
                and item[1].effect not in known
                and item[0] > PROMISE * ranked[0][0]
            ):
                chosen.append(item)
                known.add(item[1].effect)
        found = dict(before)
        for _, action, begins in chosen:
            fresh = [begin for begin in begins if begin.start not in looks[action].fitted]
            if not fresh:
                continue
            if found and self.budget.over:
                self._left_out(f"{action.effect} by a fit")
                continue
            looks[action].fitted += [begin.start for begin in fresh]
            nearer = [self._begun(base, action, begin) for begin in fresh]
            fits = [fit for at in nearer if (fit := self._fitted(base, action, at)) is not None]
            fits += [before[action]] if action in before else []
            if fits:
                found[action] = max(fits, key=lambda c: c.score)
        return found

    def _loses_step(self, action: Action) -> bool:
        """Whether what a parameter changes grows along the log: a free oscillation that gets out of step, a ball's bounces.

        Then two sizes of it differ in phase, and the likelihood has an optimum for each turn.
        """
        slope = self.slopes.get(str(action.port), {})
        count = max((s.size for s in slope.values()), default=0) // PARTS
        return any(
            float(np.abs(s[-count:]).mean()) > GROWS * float(np.abs(s[count : 3 * count]).mean())
            for s in slope.values()
        )

    @staticmethod
    def _other_optima(changes: Sequence[Array]) -> bool:
        """Whether a size above and one below change the readings otherwise than in opposite ways: bounces, or turns.

        A ball that has come to rest at the end of the log is out of step before, and what that changes does not grow.
        """
        if len(changes) < 2:
            return False
        above, below = changes[:2]
        sizes = float(np.linalg.norm(above)), float(np.linalg.norm(below))
        return min(sizes) > UNDONE * max(sizes) and -float(above @ below) < UNDONE * sizes[0] * sizes[1]

    def _kept_in_step(self, base: Candidate, action: Action) -> dict[str, float]:
        """A parameter's value followed from the first part of the log, where no size of it is out of step, to the whole."""
        (unknown,) = self.numbers(action)
        value = self.trusted[str(action.port)][0]
        start = {unknown.name: unknown.within(value + OFF_STEP * self.scales[str(action.port)])}
        for part in HORIZONS:
            with self.model.first(part) as counts, self.problem.first(counts):
                fit = self.problem.fit([unknown], {**base.fit.values, **start}, HORIZON_STEPS)
            if fit is not None:
                start = {unknown.name: fit.values[unknown.name]}
        return start

    def _both_sides(self, candidate: Candidate) -> Candidate:
        """A cause of two limits, each looked for over its whole range: from beyond the signal no slope leads back."""
        action = candidate.actions[-1]
        numbers = self.numbers(action)
        if len(numbers) != 2 or self.budget.over:
            return candidate
        best, values = candidate.score, dict(candidate.fit.values)
        for unknown in numbers:
            for part in np.linspace(0.02, 0.98, SCANNED):
                moved = self._shifted(
                    values, unknown.name, unknown.low + float(part) * (unknown.high - unknown.low)
                )
                score = self._at(moved) - candidate.price
                if score > best:
                    best, values = score, moved
        if best <= candidate.score:
            return candidate
        fit = self._fit(candidate.actions, values)
        again = None if fit is None else self._scored(Candidate(candidate.actions, fit, candidate.price))
        return again if again is not None and again.score > candidate.score else candidate

    def _at(self, values: Mapping[str, float]) -> float:
        """Log-likelihood of values; minus infinity where the model cannot be run."""
        with self.problem.fitted_alone():
            rows = self.problem.rows(values)
        return -np.inf if rows is None else self.problem.log_likelihood(rows, values, ())

    def _elsewhere(self, candidate: Candidate) -> Candidate:
        """The candidate, or a better estimate of the same causes away from it, where it leaves more than noise.

        What switches within a component (a valve that a level opens, a contact) makes the likelihood jump with a number:
        slopes then end at the next step of it.
        """
        every = self._free(candidate.actions)
        for _ in range(AGAIN):
            if self.budget.over or not self._above_noise(candidate.fit):
                break
            best, values = candidate.score, candidate.fit.values
            for unknown in every:
                for part in (*AROUND, *(-p for p in AROUND)):
                    at = unknown.within(candidate.fit.values[unknown.name] + part * unknown.scale)
                    moved = candidate.fit.values | {unknown.name: at}
                    score = self._at(moved) - candidate.price
                    if score > best:
                        best, values = score, moved
            if best < candidate.score + 1.0:
                break
            fit = self._fit(candidate.actions, values)
            again = None if fit is None else self._scored(Candidate(candidate.actions, fit, candidate.price))
            if again is None or again.score <= candidate.score:
                break
            candidate = again
        return candidate

    def _tries(self, action: Action) -> int:
        """Starts from which a cause is fitted: one side of two may hold a search that begins on the other."""
        return 1 if action.effect == PARAMETER or len(EFFECTS[action.effect].parameters) == 1 else 3

    def _twice(self, action: Action, others: Sequence[Action]) -> bool:
        """The same effect at the same port already."""
        return any(a.effect == action.effect and a.port == action.port for a in others)

    def _fitted(self, base: Base, action: Action, begin: Mapping[str, float]) -> Candidate | None:
        """A set with a cause more, roughly: the slopes of the others are those that they have without it."""
        actions, numbers = (*base.candidate.actions, action), self.numbers(action)
        roughly = None
        if base.unknowns and not self.by_log and (rows := self.problem.rows(begin)) is not None:
            here = Fit(dict(begin), np.zeros((0, 0)), tuple(numbers), rows, 0.0)
            roughly = np.concatenate([base.slopes, self.problem.slopes(here, DIFFERENCE)], axis=1)
        fit = self._fit(actions, begin, roughly=roughly)
        if fit is None:
            return None
        candidate = Candidate(actions, fit, self._price(actions))
        return self._scored(candidate)

    def _price(self, actions: Sequence[Action]) -> float:
        return 0.5 * float(np.log(self.problem.independent)) * len(self._free(actions))

    @staticmethod
    def _by_score(found: Sequence[Candidate]) -> list[Candidate]:
        return sorted(found, key=lambda c: -c.score)

    def _unique(self, found: list[Candidate]) -> list[Candidate]:
        seen: dict[frozenset[Action], Candidate] = {}
        for candidate in self._by_score(found):
            seen.setdefault(frozenset(candidate.actions), candidate)
        return list(seen.values())

    def _relearned(self, found: list[Candidate], others: Sequence[Candidate]) -> list[Candidate]:
        """The candidates fitted again with the noise that the best of them leaves; twice, since the best may change."""
        again = self._refitted(found, others)
        if self._drifts(self._by_score(found)[0], self._by_score(again)[0]):
            self.steady = True
            again = self._refitted(found, others)
        for other in others:
            self._scored(other)
        return again

    def _refitted(self, given: Sequence[Candidate], others: Sequence[Candidate]) -> list[Candidate]:
        found = [replace(candidate) for candidate in given]
        for _ in range(2):
            best = max(found, key=lambda c: c.score)
            self._settle(best)
            self.learned = True
            again = []
            near = best.score - PROMISE * (best.score - self._scored(others[0]).score)
            for rank, candidate in enumerate(self._by_score(found)):
                # one that explains nearly as much may be the same: it is judged at its best, as the best is
                if rank < SURELY_AGAIN or (rank < SCREENED + OTHERS and self._scored(candidate).score > near):
                    fit = self._fit(candidate.actions, candidate.fit.values, 8)
                    candidate = Candidate(candidate.actions, fit or candidate.fit, candidate.price)
                again.append(self._scored(candidate))
            found = self._by_score(again)
            if found[0].actions == best.actions:
                break
        return found

    def _drifts(self, best: Candidate, now: Candidate) -> bool:
        """Whether what explains best comes far less near to the log by noise that was learned: then it is none.

        What the model lacks besides is slow, as noise may be, and fits that believe so let the run drift.
        """
        if self.steady or not best.actions:
            return False
        rows = self._rms(best.fit), self._rms(now.fit)
        return any(after > DRIFTS * before for before, after in zip(*rows, strict=True))

    def _pruned(self, best: Candidate) -> Candidate:
        """Without causes that the others make up for."""
        while len(best.actions) > 1:
            if self.budget.over:
                self._left_out("whether fewer causes do")
                break
            poorer = []
            for k in range(len(best.actions)):
                actions = best.actions[:k] + best.actions[k + 1 :]
                fit = self._fit(actions, self._values_without(best, (best.actions[k],)))
                if fit is not None:
                    poorer.append(self._scored(Candidate(actions, fit, self._price(actions))))
            if not poorer:
                break
            top = max(poorer, key=lambda c: c.score)
            if top.score < best.score - NAMED:
                break
            best = top
        return best

    # Conclusions

    def _decide(self, finding: Finding, best: Candidate, singles: list[Candidate]) -> None:
        problem = self.problem
        null = self._scored(self.null)
        kept: list[Action] = []
        unsure: list[Action] = []
        # parameters that are no causes, being as they are trusted to be, but not nominal
        trusted: list[Action] = []
        if best.actions and not self.budget.over:
            best = self._elsewhere(best)
            fine = self._fit(best.actions, best.fit.values, 10, DIFFERENCE * FINE)
            if fine is not None and fine.log_likelihood >= best.fit.log_likelihood - 1.0:
                best = self._scored(Candidate(best.actions, fine, best.price))
            best = self._at_outputs(best, singles)
        best, judged = self._held_out(best, null)
        between = self._between(best)
        agreed = self._as_well_as_programs_agree(best).fit
        # beside others, too, of something that the library lacks a drift or an offset often is a part
        wrong = dict[str, str]()
        if len(judged) > 1 and not self._other_log():  # what another log bears out is no part of that
            residual = problem.residuals(best.fit.values)
            wrong = self._wrong(self._told(residual, best), residual)
        for action, (poorer, gain) in judged.items():
            rows = self._rms(poorer.fit), self._rms(best.fit)
            # without it trusted numbers may have to be where nobody believes them
            bent = problem.pull(poorer.fit.rows) - problem.pull(best.fit.rows)
            matters = bent > NAMED or any(
                np.sqrt(max(a**2 - b**2, 0.0)) > self._matters(s)
                for (s, _), a, b in zip(self.model.group.judged, *rows, strict=True)
            )
            finding.held[action] = gain
            finding.gains[action] = best.fit.log_likelihood - poorer.fit.log_likelihood
            if not gain.sure:
                finding.refused.append(
                    (
                        action,
                        f"gains {gain.gain:.1f} in log-likelihood on the windows held out, "
                        f"95 % interval {gain.ci95[0]:.1f} to {gain.ci95[1]:.1f}",
                    )
                )
            elif action.effect == PARAMETER and self._small(action, best.fit):
                trusted.append(action)
            elif action.effect == PARAMETER and self._as_programs_differ(action, best.fit, agreed):
                finding.refused.append(
                    (action, "is no further from what is trusted than two programs with one model differ")
                )
            elif action.effect != PARAMETER and self._none_within(action, best.fit, agreed):
                finding.refused.append(
                    (action, "may be none within what two programs with one model differ by")
                )
            elif (
                action.effect != PARAMETER
                and (part := self._left(best.fit, wrong, True, poorer.fit)) > LEAVES
            ):
                finding.refused.append(
                    (action, f"leaves {100 * part:.0f} % of what is systematic without it")
                )
            elif not matters or self._small(action, best.fit):
                finding.refused.append((action, "is too small to matter"))
            elif self._none_between(action, between):
                finding.refused.append((action, SCATTERS))
                unsure.append(action)
            elif action.effect == PARAMETER and self._holds_none(action, agreed):
                finding.refused.append((action, "its interval holds what the model has"))
                unsure.append(action)
            else:
                kept.append(action)
        sizes = best.fit.values
        while tuple(kept) != best.actions:
            lost = [a for a in best.actions if a not in kept and a not in trusted]
            fit = self._fit(tuple(kept), self._values_without(best, lost))
            best = self._scored(Candidate(tuple(kept), fit or null.fit, self._price(kept)))
            # what told one of them from none may be gone with the others
            between = self._between(best)
            gone = [a for a in kept if self._none_between(a, between)]
            finding.refused += [(a, SCATTERS) for a in gone]
            unsure += gone
            kept = [a for a in kept if a not in gone]
        finding.fitted = best
        finding.settled = self._settled(best, [a for a in unsure if a.effect == PARAMETER], sizes)
        if self.budget.over and best.actions:
            self._left_out("the last estimate, by the whole log")
        elif best.actions and len(self.model.segments) == len(
            {id(s) for s in self.model.segments if s.fitted.any()}
        ):
            best = self._on_all(best)
        finding.nearest = best
        residual = problem.residuals(self._held_own(best))
        left = self._told(residual, best)
        wrong = self._wrong(left, residual)
        if best.actions and wrong:
            ratio, why = self._left(best.fit, wrong), ""
            if any(self._silences(action, best.fit) for action in best.actions):
                why = "may be zero: the log then shows nothing of what the model hands on there"
            elif self._as_a_constant(errors(finding, extended(finding, best)), wrong):
                why = "explains no more of the log than a constant reading would"
            elif ratio > BETTER and not self._borne_out(best, finding.fitted.fit, wrong, left):
                why = (
                    f"leaves {100 * ratio:.0f} % of what is systematic"
                    if ratio < 1.0
                    else "leaves no less of what is systematic"
                )
            if why:
                finding.refused += [(action, why) for action in best.actions]
                best = null
                residual = problem.residuals(null.fit.values)
                left = self._told(residual, null)
                wrong = self._wrong(left, residual) or wrong
        if not best.actions:
            finding.settled = {}
            finding.bent = self._at_limits(best)
            # of what the log cannot tell apart a parameter: they are what is trusted too much
            near = [c.actions[0] for c in singles if c.score > singles[0].score - CLOSE]
            finding.instead = next((a for a in near if a.effect == PARAMETER), near[0] if near else None)
        # programs differ alike in all logs: that says nothing of what changes from one to the next
        finding.between = self._between(best)
        if self.by_log:  # of a limit that some logs do not meet the others tell
            meant = {n: b.value for n, b in finding.between.items()}
            best = replace(best, fit=replace(best.fit, values=best.fit.values | meant))
        plain = best.fit
        best = self._as_well_as_programs_agree(best)
        finding.between = {
            n: replace(b, within=b.within + best.fit.deviation(n) ** 2 - plain.deviation(n) ** 2)
            for n, b in finding.between.items()
        }
        finding.chosen, finding.told = best, left
        if not best.actions or finding.fitted is None:
            finding.fitted = best
        for action, shown in self.read.items():
            part = float(np.mean(~problem.mask))
            finding.read[action], finding.gains[action] = shown, shown.gain
            finding.held[action] = HeldOutGain(part * shown.gain, 0.0)
            finding.alike[action], finding.rivals[action] = [], []
        finding.unexplained = wrong
        finding.floors = {s: self._floor(s, best) for s, _ in self.model.group.judged}
        self._rivals(finding, best, singles, null)
        finding.never = self._never(best)

    def _settled(
        self, best: Candidate, unsure: Sequence[Action], sizes: Mapping[str, float]
    ) -> dict[str, tuple[float, float]]:
        """Parameters that are no causes where the model's own run is best, trusted ones within their tolerance.

        Of those that held-out data ask for, but whose size is not sure, trust says nothing; `sizes` are where they begin.
        """
        others = [n for n in self.trusted if f"{PARAMETER}|{n}" not in best.fit.values]
        if not best.actions or not (others or self.wide) or self.budget.over:
            return {}
        unknowns = list(self.wide)
        at = self.problem.nuisances(best.fit.values)
        start = {u.name: u.within(best.fit.values[u.name] + at.get(f"free:{u.name}", 0.0)) for u in unknowns}
        for action in unsure:
            others.remove(str(action.port))
            unknowns += self.numbers(action)
            start |= {u.name: sizes[u.name] for u in self.numbers(action)}
        for name in others:
            variable = self.model.system.variable(Port(*name.split(".", 1)))
            value, relative = self.trusted[name]
            size, key = relative * self.scales[name], f"{PARAMETER}|{name}"
            low, high = max(variable.low, value - SURE * size), min(variable.high, value + SURE * size)
            unknown = Unknown(key, low, high, size, size, value)
            unknowns.append(unknown)
            start[key] = unknown.within(value + size * at.get(key, 0.0))
        with self.problem.sharing(moments(self.problem)):
            centres = {u.name: u.centre for u in unknowns if u.prior < np.inf}
            begins = (best.fit.values | start, best.fit.values | start | centres)
            fits = [self.problem.fit(unknowns, begin, SETTLING) for begin in begins]
            plain = self._at(best.fit.values)
        fit = max((f for f in fits if f is not None), key=lambda f: f.log_likelihood, default=None)
        if fit is None or fit.log_likelihood < plain + 1.0:
            return {}
        return {u.name.partition("|")[2]: (fit.values[u.name], fit.deviation(u.name)) for u in unknowns}

    def _held_out(self, best: Candidate, null: Candidate) -> tuple[Candidate, Judged]:
        """The causes, and for each what explains the log without it and what it gains over that on held-out data.

        Where another log is held out what stays wrong may be held for slow noise, which hears nothing of how far a whole
        run is off. So a cause that is not sure by it is asked again with what stays wrong as no noise, and one that is not
        sure by the run, which few windows decide where it drifts, with what stays wrong as noise.
        """
        judged = self._judged(best, null)
        sure = all(gain.sure for _, gain in judged.values())
        if sure or not self._other_log() or self.budget.over:
            return best, judged
        self.steady = not self.steady
        self._settle(best)
        fit = self._fit(best.actions, best.fit.values, 10)
        again = self._scored(Candidate(best.actions, fit or best.fit, best.price))
        anew = self._judged(again, null)
        if any(gain.sure and not judged[a][1].sure for a, (_, gain) in anew.items() if a in judged):
            surest = {a: max(own, judged.get(a, own), key=lambda j: j[1].ci95[0]) for a, own in anew.items()}
            return again, {a: (self._scored(poorer), gain) for a, (poorer, gain) in surest.items()}
        self.steady = not self.steady
        self._settle(best)  # the rows of all with the nuisances that are now
        return best, {a: (self._scored(poorer), gain) for a, (poorer, gain) in judged.items()}

    def _judged(self, best: Candidate, null: Candidate) -> Judged:
        found = {}
        for action in best.actions:
            if (poorer := self._without(best, action, null)) is not None:
                rows = self._scored(poorer).fit.rows
                found[action] = poorer, self.problem.held_out(best.fit.rows, rows)
        return found

    def _other_log(self) -> bool:
        """Whether a log of its own is held out."""
        return any(not segment.fitted.any() for segment in self.model.segments)

    def _left(
        self, fit: Fit, wrong: Collection[str], held: bool = False, without: Fit | None = None
    ) -> float:
        """Part of what is systematic in a wrong signal that a fit leaves, at most: of all, or of what is held out.

        Of what another leaves that is `without` something, else of what the model does.
        """
        found = 0.0
        null, residual = (self.problem.residuals(f.values) for f in (without or self.null.fit, fit))
        for signal in wrong:
            floor = self._white(signal) ** 2
            before, after = (float(np.mean(self._part(r, signal, held) ** 2)) for r in (null, residual))
            found = max(found, float(np.sqrt(max(after - floor, 0.0) / max(before - floor, 1e-300))))
        return found

    def _part(self, series: Mapping[str, Array], signal: str, held: bool) -> Array:
        """A signal's series of all logs behind one another; all of them, or what is held out."""
        fitted = self.problem.fitted
        whole = np.concatenate([series[n] for n in self.model.places(signal)])
        out = np.concatenate([~fitted[n] | (not held) for n in self.model.places(signal)])
        return np.asarray(whole[out & self.model.known(signal)])

    def _borne_out(
        self, best: Candidate, fitted: Fit, wrong: Collection[str], left: Mapping[str, Explained]
    ) -> bool:
        """Whether what is held out bears causes out that leave much: a real log always leaves something.

        Another log does where its error surely falls. Windows of the same log do where no more than half is left, by other
        numbers of the law or by what leaves something that nothing tells.
        """
        if self._other_log():
            return self._surely_less(fitted, wrong)
        if self._left(fitted, wrong, held=True) > LEAVES:
            return False
        return renumbered(best.actions) or self._nothing_tells(best, wrong, left)

    def _surely_less(self, fit: Fit, wrong: Collection[str]) -> bool:
        """Whether the error of each wrong signal surely falls in what is held out, by its windows."""
        null, residual = (self.problem.residuals(f.values) for f in (self.null.fit, fit))
        windows = {n: own.astype(np.float64) for n, own in self.problem.window.items()}
        for signal in wrong:
            number = self._part(windows, signal, True)
            before, after = (squares_by_block(self._part(r, signal, True), number) for r in (null, residual))
            if not before.size or ratio_ci95(after, before)[1] >= 1.0:
                return False
        return True

    def _nothing_tells(self, best: Candidate, wrong: Collection[str], left: Mapping[str, Explained]) -> bool:
        """Whether neither inputs nor a function added at a port tell what causes leave.

        Of something that the library lacks an offset or a limit often is a part: then they do.
        """
        if any(self._share_told(signal, left[signal]) for signal in wrong) or self.budget.over:
            return False
        most = allowed(self.model.runs)
        return missing(self.model, self.problem, best.fit.values, self.spreads, most) is None

    def _at_limits(self, candidate: Candidate) -> tuple[str, ...]:
        """Trusted parameters that an explanation puts at the limit of what is trusted."""
        at = self.problem.nuisances(candidate.fit.values)
        prefix = f"{PARAMETER}|"
        for name, (value, deviation) in self.trusted.items():
            if (own := candidate.fit.values.get(prefix + name)) is not None:
                at[prefix + name] = (own - value) / (deviation * self.scales[name])
        return tuple(
            n.removeprefix(prefix) for n, v in at.items() if n.startswith(prefix) and abs(v) > ALMOST * SURE
        )

    def _at_outputs(self, best: Candidate, singles: Sequence[Candidate]) -> Candidate:
        """Causes elsewhere, and parameters, moved to a judged output where that is as good: its reading can be asked."""
        judged = {port for _, port in self.model.group.judged}
        for action in best.actions:
            if action.where == "sensor" or (action.where == "output" and action.port in judged):
                continue
            if self._among_numbers(action, best):
                continue
            for other, start in self._output_twins(action, best, singles):
                if other in best.actions:
                    continue
                actions = tuple(other if a == action else a for a in best.actions)
                fit = self._fit(actions, self._values_without(best, (action,)) | start, 8)
                moved = None if fit is None else self._scored(Candidate(actions, fit, self._price(actions)))
                if moved is not None and moved.score > best.score - 1.0:
                    self.moved[other] = action
                    best = moved
                    break
        return best

    @staticmethod
    def _among_numbers(action: Action, best: Candidate) -> bool:
        """Whether a parameter is one of several of its component: numbers that are wrong together stay numbers."""
        own = [a for a in best.actions if a.effect == PARAMETER and a.port.component == action.port.component]
        return action.effect == PARAMETER and len(own) > 1

    def _output_twins(
        self, action: Action, best: Candidate, singles: Sequence[Candidate]
    ) -> list[tuple[Action, dict[str, float]]]:
        """Effects at judged outputs that may be the same as a cause elsewhere, with where their fit begins."""
        ports = [port for _, port in self.model.group.judged]
        values = best.fit.values
        if action.effect != PARAMETER:
            same = EFFECTS[action.effect].parameters
            return [
                (other, {other.key(p): values[action.key(p)] for p in same})
                for port in ports
                if (other := Action(action.effect, port, "output")).effect
                not in ("port.offset", *self.exclude)
            ]
        found = {
            single.actions[0]: {u.name: single.fit.values[u.name] for u in self.numbers(single.actions[0])}
            for single in singles
            if single.actions[0].where == "output" and single.actions[0].port in ports
        }
        value = self.trusted[str(action.port)][0]
        for port in ports:
            gain = Action("port.gain", port, "output")
            if port.component == action.port.component and value and "port.gain" not in self.exclude:
                found.setdefault(gain, {gain.key("gain"): values[f"{PARAMETER}|{action.port}"] / value})
        return list(found.items())

    def _on_all(self, best: Candidate) -> Candidate:
        """The last estimate, of the whole log: what only a window held out shows counts as well."""
        with self.problem.whole():
            self._scored(best)
            starts = [self._both_sides(best)] if len(best.actions) == 1 else [best]
            fits = [self._fit(c.actions, c.fit.values, 10, DIFFERENCE * FINE) for c in starts]
        fit = next((f for f in fits if f is not None), None)
        self.on_all = fit is not None
        return best if fit is None else self._scored(Candidate(best.actions, fit, best.price))

    def _as_well_as_programs_agree(self, best: Candidate) -> Candidate:
        """The estimate with what the machine and a program that integrates its model differ by in its deviations.

        Noise averages out over a long log, this does not: no number is known better than what changes the readings so much.
        """
        fit = best.fit
        if not fit.unknowns or self.budget.over:
            return best
        here = self.model(fit.values)
        variances = []
        for unknown in fit.unknowns:
            step = DIFFERENCE * unknown.scale
            if fit.values[unknown.name] + step > unknown.high:
                step = -step
            try:
                moved = self.model(self._shifted(fit.values, unknown.name, fit.values[unknown.name] + step))
            except SimulationError:
                variances.append(0.0)
                continue
            slopes = []
            for signal, _ in self.model.group.judged:
                change = self.model.whole(moved, signal) - self.model.whole(here, signal)
                floor = max(LEAST * self.spreads[signal], self.model.coarse.get(signal, 0.0))
                slopes.append(float(np.sqrt(np.mean(change**2))) / abs(step) / floor)
            variances.append(max(slopes) ** -2 if max(slopes) > 0.0 else 0.0)
        return replace(best, fit=replace(fit, covariance=fit.covariance + np.diag(variances)))

    def _without(self, best: Candidate, action: Action, null: Candidate) -> Candidate | None:
        actions = tuple(a for a in best.actions if a != action)
        if not actions:
            return null
        fit = self._fit(actions, self._values_without(best, (action,)))
        return None if fit is None else Candidate(actions, fit, self._price(actions))

    def _small(self, action: Action, fit: Fit) -> bool:
        """Too small to be told from the way a log is sampled, or within three deviations of what is trusted."""
        if action.effect in ("port.delay", "port.lag"):
            (unknown,) = self.numbers(action)
            return fit.values[unknown.name] < LEAST_DELAY * self.model.segments[0].h
        if action.effect == PARAMETER:
            name = str(action.port)
            value, deviation = self.trusted[name]
            return abs(fit.values[f"{PARAMETER}|{name}"] - value) <= 3.0 * deviation * self.scales[name]
        return False

    def _as_programs_differ(self, action: Action, fit: Fit, agreed: Fit) -> bool:
        """Whether a parameter is off by no more than trust, and what two programs make of one model, allow together."""
        name = f"{PARAMETER}|{action.port}"
        value, deviation = self.trusted[str(action.port)]
        allowed = np.sqrt(
            (deviation * self.scales[str(action.port)]) ** 2 + _between_programs(name, fit, agreed)
        )
        return bool(abs(fit.values[name] - value) <= SURE * allowed)

    def _none_within(self, action: Action, fit: Fit, agreed: Fit) -> bool:
        """Whether what two programs make of one model holds, at 95 %, for each size of a cause that there is none of it."""
        known = {u.name for u in fit.unknowns}
        differ = [
            abs(fit.values[name] - none) > 1.96 * np.sqrt(_between_programs(name, fit, agreed))
            for name, none in self._off(action).items()
            if name in known
        ]
        return bool(differ) and not any(differ)

    def _silences(self, action: Action, fit: Fit) -> bool:
        """Whether a gain may be zero, beside something that stays wrong: the model then is one that explains nothing."""
        names = [n for n in self._off(action) if n.endswith("|gain") and n in {u.name for u in fit.unknowns}]
        return any(abs(fit.values[n]) <= 1.96 * fit.deviation(n) for n in names)

    def _as_a_constant(self, residual: Mapping[str, Array], wrong: Collection[str]) -> bool:
        """Whether each signal that stays wrong is as far from the model's own run as from its own mean.

        A model that is far off, such as one in another unit, comes nearer by whatever silences it.
        """
        return all(
            np.sqrt(np.mean(self._part(residual, s, False) ** 2))
            > CONSTANT * np.std(self._part(self.problem.measured, s, False))
            for s in wrong
        )

    def _white(self, signal: str) -> float:
        """White noise of a reading; what is rounded has at least that of its steps, and all what two runs differ by."""
        logs = [self.model.segments[k] for k in self.model.judging(signal)]
        readings = [log.signals[signal][log.known(signal)] for log in logs]
        return max(*(white_noise(r) for r in readings), self.problem.least[self.model.places(signal)[0]])

    def _floor(self, signal: str, best: Candidate) -> float:
        """Noise of a reading: what is left by the best, where that is noise; else that of the reading itself."""
        residual = self.problem.residuals(best.fit.values)
        own = self.model.whole(residual, signal)
        return (
            float(np.std(own))
            if signal not in self._wrong(self._told(residual, best), residual)
            else min(self.model.segments[k].noise(signal) for k in self.model.judging(signal))
        )

    def _told(self, residual: Mapping[str, Array], candidate: Candidate) -> dict[str, Explained]:
        """What inputs and outputs of the group tell of a residual, signal by signal of the longest log."""
        found = {}
        for signal, _ in self.model.group.judged:
            judging = self.model.judging(signal)
            mixed = [
                k
                for k in judging
                if 0 < int(self.model.segments[k].fitted.sum()) < self.model.segments[k].count
            ]
            k = max(judging, key=lambda k: self.model.segments[k].count)
            if k not in mixed and mixed:
                k = mixed[0]
            segment = self.model.segments[k]
            before = self.model.before(signal, k)
            shown = {
                n.partition(":")[2]: v
                for n, v in self.model.ports(candidate.fit.values, k).items()
                if n.startswith(("in:", "out:")) and n in before
            }
            fitted = segment.fitted
            if k not in mixed:  # whole logs are held out: windows of this one are
                fitted = segment.windows % 3 != 1
            read = segment.known(signal)
            shown = {n: v[read] for n, v in shown.items()}
            own = residual[place(signal, k)][read]
            found[signal] = explained(own, shown, fitted[read], segment.windows[read], segment.h)
        return found

    def _share_told(self, signal: str, item: Explained) -> float:
        """Share of a residual's variance that inputs tell on windows held out, where it is sure and matters; else 0."""
        share = 1.0 - (item.after / max(item.before, 1e-300)) ** 2
        return share if item.sure and share > TOLD and item.size > self._matters(signal) else 0.0

    def _wrong(self, left: Mapping[str, Explained], residual: Mapping[str, Array]) -> dict[str, str]:
        """Signals whose residual is systematic, with words."""
        found = {}
        for signal, item in left.items():
            spread = self.spreads[signal]
            if share := self._share_told(signal, item):
                top = sorted(item.by.items(), key=lambda pair: -pair[1])[:2]
                names = " and ".join(n for n, part in top if part > 0.2) or top[0][0]
                found[signal] = (
                    f"the residual depends on {names}: {100 * share:.0f} % of its variance on windows held out"
                )
                continue
            own = self.model.whole(residual, signal)
            rms = float(np.std(own))
            if rms > UNTOLD * spread and rms > LOUD * max(self._white(signal), 1e-300):
                found[signal] = (
                    "the residual is far above the reading's noise, and what was measured does not tell it directly"
                )
        return found

    def _rivals(
        self, finding: Finding, best: Candidate, singles: Sequence[Candidate], null: Candidate
    ) -> None:
        """Other causes in the place of each named one."""
        for action in best.actions:
            if self.budget.over and len(best.actions) > 1:
                self._left_out("other causes in the place of one of several")
                continue
            others: list[tuple[Action, float]] = []
            alike: list[Action] = []
            fits: dict[Action, Fit] = {}
            rest = tuple(a for a in best.actions if a != action)
            begins = self._in_place_of(rest, singles)
            if self._among_numbers(action, best):
                begins = self._exchanged(action, best)
            elsewhere = self._other_place(action, best)
            for rival, values in (elsewhere | begins).items():
                single = next((s for s in singles if s.actions == (rival,)), None)
                if (
                    rival == action
                    or rival in rest
                    or (not rest and single is None and rival not in elsewhere)
                ):
                    continue
                if rest or single is None:
                    begin = self._values_without(best, (action,)) | values
                    fit = self._fit((*rest, rival), begin, 8)
                    if fit is None:
                        continue
                    with_rival = self._scored(Candidate((*rest, rival), fit, self._price((*rest, rival))))
                else:
                    assert single is not None
                    with_rival = self._scored(single)
                    near = self._scored(best).score - with_rival.score
                    if CLOSE <= near < NAMED + single.price:  # estimated as finely as the best
                        fine = self._fit(single.actions, single.fit.values, 8, DIFFERENCE * FINE)
                        with_rival = self._scored(replace(single, fit=fine)) if fine else with_rival
                score, fits[rival] = with_rival.score, with_rival.fit
                behind = self._scored(best).score - score
                others.append((rival, behind))
                if behind < CLOSE or self._same(best.fit, fits[rival]):
                    alike.append(rival)
            same = self.moved.get(action)
            if same is not None and same not in alike:
                alike.insert(0, same)
                others = [(same, 0.0), *(o for o in others if o[0] != same)]
            finding.rivals[action] = sorted(others, key=lambda item: item[1])
            finding.alike[action] = alike
            # the same effect elsewhere often is the same for every run
            for twin in sorted(fits, key=lambda a: (a.effect == action.effect, dict(others)[a])):
                if twin in alike:
                    finding.twins.setdefault(action, []).append((twin, fits[twin].values))
                    finding.twin_unknowns[action, twin] = fits[twin].unknowns

    def _other_place(self, action: Action, best: Candidate) -> dict[Action, dict[str, float]]:
        """A cause of a reading as one of the quantity, or the other way round, where what it drives tells."""
        judged = {port: signal for signal, port in self.model.group.judged}
        if (
            judged.get(action.port) not in self.model.own
            or action.where not in ("output", "sensor")
            or EFFECTS[action.effect].reading
        ):
            return {}
        other = Action(action.effect, action.port, "sensor" if action.where == "output" else "output")
        return {
            other: {other.key(p): best.fit.values[action.key(p)] for p in EFFECTS[action.effect].parameters}
        }

    def _in_place_of(
        self, rest: tuple[Action, ...], singles: Sequence[Candidate]
    ) -> dict[Action, dict[str, float]]:
        """Causes that were fitted beside the others of a set, or alone, with their numbers; the best first."""
        beside = {self.moved.get(a, a) for a in rest} | set(rest)
        found: dict[Action, dict[str, float]] = {}
        sets = [c for c in self.tried if rest and len(c.actions) == len(rest) + 1]
        for candidate in [*self._by_score(sets), *singles]:
            others = [a for a in candidate.actions if a not in beside]
            if len(others) == 1 and others[0] not in found:
                numbers = self.numbers(others[0])
                found[others[0]] = {u.name: candidate.fit.values[u.name] for u in numbers}
        return dict(list(found.items())[:REPLACED])

    def _exchanged(self, action: Action, best: Candidate) -> dict[Action, dict[str, float]]:
        """What may do the same as one of several numbers, by its slope beside those of the others; where a fit begins.

        These are other trusted parameters, and gains where the component is wired.
        """
        known = {u.name: u for u in best.fit.unknowns}
        key = f"{PARAMETER}|{action.port}"

        def slope(unknown: Unknown, at: float) -> Array:
            """Of the whitened series over the unknown's scale."""
            here = {**best.fit.values, unknown.name: at}
            moved = here | {unknown.name: at + DIFFERENCE * unknown.scale}
            return self.problem.changed(here, moved) / DIFFERENCE

        beside = [u for n, u in known.items() if n != key]
        try:
            others = np.stack([slope(u, best.fit.values[u.name]) for u in beside], axis=1)
            whole = slope(known[key], best.fit.values[key])
        except SimulationError:
            return {}
        base, _ = np.linalg.qr(others)
        own = whole - base @ (base.T @ whole)
        step = (best.fit.values[key] - self.trusted[str(action.port)][0]) / known[key].scale
        found: list[tuple[float, Action, dict[str, float]]] = []
        for other in self.candidates():
            if other in best.actions or other.effect not in (PARAMETER, "port.gain"):
                continue
            if other.effect != PARAMETER and other.port.component != action.port.component:
                continue
            (nothing,) = self._off(other).values()
            (unknown,) = self.numbers(other)
            try:
                slopes = slope(unknown, nothing)
            except SimulationError:
                continue
            theirs = slopes - base @ (base.T @ slopes)
            size, along = float(theirs @ theirs), float(theirs @ own)
            alike = along**2 / max(size * float(own @ own), 1e-300)
            if alike > ALONG:
                far = step * along / size
                follow = np.linalg.lstsq(others, step * whole - far * slopes, rcond=None)[0]
                begin = {
                    u.name: u.within(best.fit.values[u.name] + u.scale * float(f))
                    for u, f in zip(beside, follow, strict=True)
                }
                begin[unknown.name] = unknown.within(nothing + unknown.scale * far)
                found.append((alike, other, begin))
        found.sort(key=lambda item: -item[0])
        return {other: begin for _, other, begin in found[:REPLACED]}

    def _same(self, one: Fit, other: Fit) -> bool:
        """Whether two fits predict the same but for what matters to nobody.

        A delay before a component or behind it, say: the two differ by how series are read between samples, and long logs
        tell even that.
        """
        left, theirs = self.problem.residuals(one.values), self.problem.residuals(other.values)
        return all(
            float(np.sqrt(np.mean((left[name] - theirs[name]) ** 2)))
            < SIZE * self.spreads[name.partition("#")[0]]
            for name in self.problem.names
        )

    def _never(self, best: Candidate) -> dict[Action, dict[str, float]]:
        """Causes of which a moderate size would be within the noise: nobody knows whether they are there.

        The screening has seen what each would do at the noise that was known then; only what was faint is looked at again.
        """
        found: dict[Action, dict[str, float]] = {}
        here = best.fit.rows
        for action in self.candidates():
            if (
                (size := self.sizes.get(action)) is None
                or size > FAINT * NAMED
                or any(a.port == action.port and a.effect == action.effect for a in best.actions)
            ):
                continue
            if self.budget.over:
                self._left_out("what the log never exercised")
                break
            moved = self.moderate(action)
            rows = self.problem.rows({**best.fit.values, **moved})
            if rows is None:
                continue
            change = (here - rows)[self.problem.mask]
            if 0.5 * float(change @ change) < NAMED + self._price((action,)):
                found[action] = moved
        return found
