"""Causes tried on data that took no part in naming them: another log of the machine, or the rest of this one.

A cause that the fitting log asks for but that does not make the prediction of the held-out data better is refused: it
has described that one log and not the machine.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.budget import current
from cosim.diagnosis.fitting.bounds import cannot_be, greatest_torque
from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.limits import Passed, passed, unmet
from cosim.diagnosis.fitting.noise import Whitener
from cosim.diagnosis.fitting.trials import (
    QUICK_ROUNDS,
    Trial,
    holds,
    quickly,
    tried,
    tried_all,
    unknowns,
    without,
)
from cosim.diagnosis.held_out.free_run import errors, onward, refitted
from cosim.diagnosis.hypotheses.naming import Judge, worth_naming
from cosim.diagnosis.record.record import Record, joined
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.residuals.cross_validation import fold_cuts, fold_numbers, moving
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import (
    AS_WELL,
    CALIBRATED_TRUST,
    CANCELLING,
    HOPELESS,
    INDISTINGUISHABLE,
    LEAST_SPREAD,
    NESTED,
    RIVALS_HELD_OUT,
    SURE_SIZE,
)
from cosim.inference.held_out import (
    HeldOutGain,
    course_of,
    gain_of_errors,
    mean_squares,
    size_of_gain,
    steps_without,
)
from cosim.inference.thresholds import FEWEST_PARTS
from cosim.logs import Log
from fmus.contract import Effect

Array = NDArray[np.float64]

HALVINGS = 4  # lengths of a step, each half of the one before, until none is taken


@dataclass(frozen=True)
class Held:
    """Held-out data.

    Attributes:
        record: the log, from its start.
        first: sample from which errors count.
        logs: names of the logs; none where it is the end of the fitted one.
        sha256: of their files.
        in_turn: it is the fitted logs themselves, each left out in turn, or of one log each quarter.
    """

    record: Record
    first: int
    logs: tuple[str, ...] = ()
    sha256: str = ""
    in_turn: bool = False

    @property
    def name(self) -> str:
        """Of the logs, in one text."""
        return ", ".join(self.logs)


def held_logs(records: Sequence[Record], logs: Sequence[Log]) -> Held:
    """One or more whole logs held out."""
    return Held(joined(records), 0, tuple(log.name for log in logs), ", ".join(log.sha256 for log in logs))


def each_in_turn(record: Record, rule: Whitener, tolerance: float) -> Held | None:
    """The logs of a record, each left out in turn, or the quarters of one log; None of one of a few windows.

    Nor where nominal parameters are trusted: there windows judge, with what is trusted. What a machine, its operator or
    what the model lacks changes within a log, its windows have in common as the windows of one log among several: a cause
    has to help where nothing was fitted.
    """
    many = record.cuts or rule.log_of(record.time.size).size >= FEWEST_PARTS
    return Held(record, 0, in_turn=True) if many and tolerance >= CALIBRATED_TRUST else None


@dataclass(frozen=True)
class Refused:
    """A cause that held-out data do not bear out.

    Attributes:
        effect: the effect.
        group: where it was named.
        signal: what was compared.
        gain: log-likelihood that it gains in the fitting log.
        without, with_it: RMSE on held-out data, SI.
        sure: the whole fitting log determines its size.
        instead: the named cause in whose place it would stand, if it explains the fitting log as well as that.
        in_fitted: the errors are those of a free run over the fitted log.
        passed: its limits that readings pass.
    """

    effect: Effect
    group: str
    signal: str
    gain: float
    without: float
    with_it: float
    sure: bool = True
    instead: str = ""
    in_fitted: bool = False
    passed: tuple[Passed, ...] = ()


@dataclass(frozen=True)
class Step:
    """A set of causes fitted to the whole fitting log.

    Attributes:
        effects: the causes.
        fit: with them.
        fitted: RMSE over the fitting log, SI.
        held: RMSE on held-out data, SI.
        unsure: names of those whose size is too small to matter or cannot be, whose uncertainty holds no cause at all, of
            which two make up for each other, or limits that readings pass or never come near.
        squares: (parts,) mean square of the error in each part of the held-out data, SI, at least that of the sensor's
            rounding: a machine that stands is predicted to the last digit. Of logs left out in turn it is over that of the
            signal in the log, so that each log counts as much. Where the axis drifts, the prediction begins in each part
            where the machine stands, and `fitted` and `held` are of the same.
        placed: the parts are those of one run of an axis whose place counts.
        course: (parts, spans) means of the error over short spans, of what `squares` are of; only where `placed`.
        above: larger sets by whose removal of causes this one was reached: each is known to be about as good.
    """

    effects: tuple[Effect, ...]
    fit: Fit
    fitted: float
    held: float
    unsure: tuple[str, ...] = ()
    squares: Array = field(default_factory=lambda: np.zeros(1), repr=False)
    placed: bool = False
    course: Array | None = field(default=None, repr=False)
    above: tuple["Step", ...] = field(default=(), repr=False)

    @property
    def sure(self) -> bool:
        """True if the whole fitting log determines the size of each."""
        return not self.unsure

    def clearly_better(self, other: "Step") -> bool:
        """True if the difference on held-out data is more than the choice of these windows may have made.

        Of what this set has beyond another the fitted log has asked for, which counts, too.
        """
        gain = self.gain_over(other)
        return self.sure and (gain.borne_out if {*other.effects} < {*self.effects} else gain.sure)

    def about_as_good(self, other: "Step") -> bool:
        """True if another set is not clearly better on held-out data, or by so little that nobody would mind."""
        return not (other.noticeably_better(self) and other.clearly_better(self))

    def noticeably_better(self, other: "Step") -> bool:
        """True if held-out data are predicted better by more than nobody would mind, be it by chance.

        What nobody would mind is measured as the gain is: that of an error larger by so much in each part.
        """
        minded = size_of_gain(self.squares, AS_WELL**2 * self.squares, self.placed)
        return size_of_gain(self.squares, other.squares, self.placed) >= minded

    def gain_over(self, other: "Step") -> HeldOutGain:
        """What this set gains on held-out data over another."""
        apart = None
        if self.course is not None and other.course is not None:
            apart = np.mean((self.course - other.course) ** 2, axis=1)
        return gain_of_errors(self.squares, other.squares, self.placed, apart)


def least(steps: Sequence[Step]) -> Step:
    """The set that errs least on held-out data; one that is not sure, only where none is."""
    return nearest([s for s in steps if s.sure] or list(steps))


def nearest(steps: Sequence[Step]) -> Step:
    """The set that errs least on held-out data, sure or not."""
    return reduce(lambda one, other: other if other.gain_over(one).gain > 0.0 else one, steps)


Steps = dict[frozenset[tuple[str, ...]], Step]  # by name and parameters of each effect


def refuse(
    finding: Finding, held: Held, tolerance: float, done: Steps | None = None
) -> tuple[Finding, list[Refused], tuple[Effect, ...]]:
    """A finding as held-out data see it, its causes that do not help on them, and what is kept of it.

    A cause is kept if without it the error on held-out data is larger by more than the choice of these data may have made
    (95 %), that of the set or of one passed on the way to it (`shrunk`), and if the whole fitting log determines its size.
    Because some help together only (friction and a limit of the stroke bend the same curve at its two ends), causes are
    taken in one by one from none and left out one by one from all, and the better end counts. Of a cause that holds
    another (Stribeck friction holds Coulomb friction) the fuller must be better than the simpler. A rival that explains
    the fitting log as well as a cause takes its place if it is clearly better on held-out data.

    Args:
        finding: what was named in one group; the one returned is `confirmed` if nothing is refused.
        held: the held-out data.
        tolerance: trust in the nominal parameters.
        done: sets judged already, while causes were looked for; it grows.
    """
    signal = compared(finding.task, held)
    waiting = tuple(e for e in finding.chosen.effects if e.name not in SAMPLED)
    if not signal:
        return finding, [], finding.chosen.effects
    step = stepper(finding, held, signal, tolerance, done)
    losses = {e.name: loss(finding, e, tolerance) for e in waiting}
    at = balanced(finding, step(waiting), waiting, step, losses)
    if len(at.effects) < len(waiting):  # some that were left out may help with fewer beside them
        at = least([at, balanced(finding, step(()), waiting, step, losses)])
    if done is not None:
        done[key_of(at.effects)] = at  # with what stands above it
    kept = {e.name for e in at.effects}
    group = finding.task.model.group.name
    refused = []
    for effect in (e for e in waiting if e.name not in kept):
        with_it = step(widened(finding, at.effects, effect))
        beyond = tuple(passed_in(held, finding.task, effect, with_it.fit))
        refused.append(
            Refused(
                effect, group, signal, losses[effect.name], at.held, with_it.held, with_it.sure, passed=beyond
            )
        )
    if current().over:  # what is kept has not been held against all that could be left out
        current().leave_out(group, "some of its causes on the held-out data")
    finding = replace(
        finding,
        confirmed=bool(at.effects) and not refused and not current().over,
        held_squares=at.squares,
        borne={e.name: borne(at, e, step) for e in at.effects},
    )
    return finding, refused, at.effects


def next_best(
    finding: Finding, held: Held, without_: Collection[str], tolerance: float, done: Steps
) -> tuple[dict[Effect, HeldOutGain], dict[Effect, list[Effect]]]:
    """Of the sets judged without some causes the one that held-out data bear out best, with what each of it gains there.

    None where they bear out none: Coulomb friction may be sure where a peak beside it is not. Of those that they do not tell
    apart the likeliest.

    Args:
        finding: what is known of the group.
        held: the held-out data.
        without_: names of the causes.
        tolerance: trust in the nominal parameters.
        done: the sets judged already; it may grow.

    Returns:
        The gains; and what cannot be told from each.
    """
    listed = [
        s for s in done.values() if s.sure and s.effects and not {e.name for e in s.effects} & {*without_}
    ]
    signal = compared(finding.task, held)
    if not listed or not signal or current().over:
        return {}, {}
    best = least(listed)
    # sets within the best one and others by one measure: else what is worse within it returns as something unlikelier
    as_good = [
        s
        for s in listed
        if len(s.effects) <= len(best.effects)
        and not (best.noticeably_better(s) and best.gain_over(s).borne_out)
    ]
    fewest = min(len(s.effects) for s in as_good)
    as_good = [s for s in as_good if len(s.effects) == fewest]
    first = max(as_good, key=lambda s: sum(e.prior for e in s.effects))
    step = stepper(finding, held, signal, tolerance, done)
    at = shrunk(finding, replace(first, above=()), step, {})
    gains = {e: borne(at, e, step) for e in at.effects}
    if not all(gain.borne_out for gain in gains.values()):
        return {}, {}
    undecided = {}
    for effect in at.effects:
        rest = {e for e in at.effects if e != effect}
        instead = [{*s.effects} - rest for s in as_good if s is not first and rest < {*s.effects}]
        undecided[effect] = [e for one in instead if len(one) == 1 for e in one if e != effect]
    return gains, undecided


def passed_in(held: Held, task: Task, effect: Effect, found: Fit) -> list[Passed]:
    """Limits of an effect that readings pass (`passed`), the fitted or the held-out ones."""
    record, first = held.record, held.first
    readings = {n: v[first:] for n, v in record.signals.items()}
    return passed(task, effect, found, readings, tuple(c - first for c in record.cuts))


def compared(task: Task, held: Held) -> str:
    """The group's signal that held-out data judge; empty where they do not have it, or not what drives the group."""
    if task.model.group.drive not in held.record.signals:
        return ""
    return next((s for s in task.measured if s in held.record.signals), "")


def borne(at: Step, effect: Effect, step: Callable[[tuple[Effect, ...]], Step]) -> HeldOutGain:
    """What is lost on held-out data where an effect is left out of a set: over this set, or one above it that is surer."""
    fewer = step(tuple(e for e in at.effects if e != effect))
    return max((s.gain_over(fewer) for s in (at, *at.above)), key=lambda gain: gain.asked[0])


def loss(finding: Finding, effect: Effect, tolerance: float) -> float:
    """Log-likelihood of the fitting log that a chosen effect gains beside the others.

    No more than all gain together: the others explain no less than the model without any, wherever a quick fit of them ends.
    """
    fewer = without(finding.task, finding.chosen, effect, finding.null, tolerance, quickly(tolerance))
    poorer = max(fewer.fit.log_likelihood, finding.null.fit.log_likelihood)
    return finding.chosen.fit.log_likelihood - poorer


def stepper(
    finding: Finding, held: Held, signal: str, tolerance: float, done: Steps | None = None
) -> Callable[[tuple[Effect, ...]], Step]:
    """Fits sets of effects to the whole fitting log and judges them on held-out data, each set once.

    Args:
        finding: what was named in one group; fits begin where its fit ends.
        held: the held-out data.
        signal: what is compared.
        tolerance: trust in the nominal parameters.
        done: sets judged already: the error of a free run does not depend on what the noise is held to be; it grows.
    """
    done = {} if done is None else done
    searched = {key_of(t.effects): t.fit for t in listed_trials(finding)}
    quiet = held.record.rounding(signal) ** 2

    def judged(effects: tuple[Effect, ...], near: Fit) -> Step:
        model, rule = finding.task.model, finding.task.rules[signal]
        anew = model.group.drifts
        fit_ = (onward if anew else refitted)(finding, effects, tolerance, near)
        fitted = float(np.sqrt(np.mean(parts_of(fit_.residuals[signal], rule, anew, model.cuts))))
        trial, apart = Trial(effects, fit_, 0), cancelling(effects, fit_, model)
        torque = greatest_torque(model, fit_.values)
        unsure = tuple(
            e.name
            for e in effects
            if e.name in apart
            or not worth_naming(trial, e, model, tolerance)
            or cannot_be(e, sizes_in(fit_, e), model, torque)
            or passed_in(held, finding.task, e, fit_)
            or unmet(finding.task, e, fit_)
        )
        placed, course = model.group.integrates and not anew, None
        if held.in_turn:
            each = left_out_errors(finding, effects, fit_, signal, tolerance, anew)
            spread = spreads(finding.task.measured[signal], rule)
            # each log counts as much; few logs are cut into as many parts as make an interval
            count = -(-FEWEST_PARTS // len(each))
            own = [parts_of(e, rule, True, fewest=count) if anew else mean_squares(e, count) for e in each]
            own = [np.maximum(squares, quiet) for squares in own]
            square = np.concatenate(own)
            squares = np.concatenate([o / v for o, v in zip(own, spread, strict=True)])
            if placed:
                slow = [course_of(e, count) / np.sqrt(v) for e, v in zip(each, spread, strict=True)]
                course = np.concatenate(slow)
        else:
            squares, course = errs(finding, fit_, held, signal)
            square = squares
        error = float(np.sqrt(np.mean(square)))
        return Step(effects, fit_, fitted, error, unsure, squares, placed, course)

    def step(effects: tuple[Effect, ...]) -> Step:
        key = key_of(effects)
        if key not in done:
            found = judged(effects, searched.get(key, finding.chosen.fit))
            # a set leaves no more than a part of it does: a search that ended there went astray
            inside = min((s for k, s in done.items() if k < key), key=lambda s: s.fitted, default=found)
            if inside.fitted < NESTED * found.fitted and not current().over:
                found = min(found, judged(effects, inside.fit), key=lambda s: s.fitted)
            for other in [k for k, s in done.items() if k > key and found.fitted < NESTED * s.fitted]:
                del done[other]  # to be judged anew, from here
            done[key] = found
        return done[key]

    return step


def spreads(reading: Array, rule: Whitener) -> list[float]:
    """Variance by which the error of each fold counts: its own, so each says as much; more where hardly anything moves."""
    own = [float(np.var(part)) for part in np.split(reading, fold_cuts(rule, reading.size))]
    least_spread = max(LEAST_SPREAD * float(np.mean(own)), 1e-300)
    return [max(variance, least_spread) for variance in own]


def errs(finding: Finding, fit_: Fit, held: Held, signal: str) -> tuple[Array, Array | None]:
    """What is left of a signal on held-out data with the estimates of a fit, as `Step` has its squares and its course."""
    group = finding.task.model.group
    gone = errors(finding, fit_, held.record)[signal][held.first :]
    cuts = tuple(c - held.first for c in held.record.cuts)
    found = parts_of(gone, finding.task.rules[signal], group.drifts, cuts)
    squares = np.maximum(found, held.record.rounding(signal) ** 2)
    return squares, course_of(gone, squares.size) if group.integrates and not group.drifts else None


def predicts_better(held: Held, tolerance: float, done: Steps) -> Judge:
    """What held-out data say of two sets while causes are looked for; `done` as `stepper` takes it."""
    apart: Steps = {}

    def better(task: Task, null: Trial, one: Trial, other: Trial) -> bool:
        signal = compared(task, held)
        if not signal:
            return True  # nothing is said against it
        # of an axis that drifts a fit depends on what the noise is held to be meanwhile
        known = apart if task.model.group.drifts else done
        finding = Finding(task, null, one, [other])
        step = stepper(finding, held, signal, tolerance, known)
        new, old = (step(tuple(e for e in t.effects if e.name not in SAMPLED)) for t in (one, other))
        if not new.noticeably_better(old):
            return False
        return new.sure or any(s.sure and s.noticeably_better(old) for s in map(step, surer(finding, new)))

    return better


def surer(finding: Finding, at: Step) -> Iterator[tuple[Effect, ...]]:
    """A set with something simpler in the place of a cause whose size is not sure: Coulomb for Stribeck friction."""
    for effect in (e for e in at.effects if e.name in at.unsure):
        _, *others = narrowed(finding, at.effects, effect)
        yield from others


def listed_trials(finding: Finding) -> Iterator[Trial]:
    """The sets that the search for a finding has fitted and kept: beside one of them the others' values lead astray."""
    yield from finding.single
    for found in finding.rivals.values():
        yield from found
    yield finding.chosen


def key_of(effects: Iterable[Effect]) -> frozenset[tuple[str, ...]]:
    """What tells sets of effects apart, whatever their order."""
    return frozenset((e.name, *e.free) for e in effects)


def parts_of(
    error: Array, rule: Whitener, anew: bool, cuts: tuple[int, ...] = (), fewest: int = FEWEST_PARTS
) -> Array:
    """(parts,) mean square of an error in each part, SI: parts as long as a window, or so short that chance can be told.

    Args:
        error: (n,) of a free run, SI.
        rule: of the signal.
        anew: in each part the prediction begins where the machine stands.
        cuts: first sample of each log but the first.
        fewest: parts at least.
    """
    count = max(fewest, round(error.size / (rule.bins * rule.window)))
    return mean_squares(error, min(count, error.size), anew, cuts)


def cancelling(effects: tuple[Effect, ...], fit_: Fit, model: GroupModel) -> set[str]:
    """Names of the effects of a set of which only the sum of two sizes is known: a shifted valve and a constant load.

    Of two sizes that make up for each other the deviation of either is that of the sum by 1 / sqrt(1 - r^2), and itself as
    much unsure as their correlation r: so it counts as many times.
    """
    keys = {f"{e.component}.{e.key}": e.name for e in effects if e.key in e.free}
    found = set()
    for pair, r in fit_.correlations.items():
        if abs(r) > CANCELLING and set(pair) <= set(keys):
            times = SURE_SIZE / np.sqrt(max(1.0 - r * r, 1e-12))
            off = [abs(fit_.values[n] - model.nominal(n)) < times * fit_.deviations[n] for n in pair]
            found |= {keys[n] for n in pair} if any(off) else set()
    return found


def sizes_in(fit_: Fit, effect: Effect) -> dict[str, float]:
    """What a fit says of an effect's parameters, SI."""
    return {p: fit_.values[f"{effect.component}.{p}"] for p in effect.free}


def left_out_errors(
    finding: Finding, effects: tuple[Effect, ...], fit_: Fit, signal: str, tolerance: float, walked: bool
) -> list[Array]:
    """(n,) error of a signal in each fold (`fold_of`), simulated with the estimates that the others give, SI.

    These follow from the fit to all by one Gauss-Newton step (`cosim.inference.held_out`), as much of it as makes the error
    in the others no larger.

    Args:
        finding: what was named in the group.
        effects: the causes.
        fit_: the fit to all logs with these.
        signal: the signal.
        tolerance: trust in the nominal parameters.
        walked: that fit is one of `freerun.onward`, not one to the free run.
    """
    task, model = finding.task, finding.task.model
    rule, count = task.rules[signal], task.measured[signal].size
    cuts = fold_cuts(rule, count)
    names, slopes = moving(fit_)
    steps = np.zeros((len(cuts) + 1, len(names)))
    if names and fit_.rows is not None:
        scales = np.array([fit_.scales[n] for n in names])
        steps = steps_without(fit_.rows, slopes, fold_numbers(task.rules, count, walked)) * scales
    bounds = {u.name: (u.low, u.high) for u in unknowns(model, effects, tolerance)[0]}

    def errors_at(step: Array) -> list[Array]:
        moved = {n: float(np.clip(fit_.values[n] + s, *bounds[n])) for n, s in zip(names, step, strict=True)}
        simulated = model.simulate(model.fixed | fit_.values | moved)[signal]
        return np.split(task.measured[signal] - simulated, cuts)

    def elsewhere(errors: list[Array], i: int) -> float:
        rest = [float(e.size * np.mean(mean_squares(e, 1, walked))) for k, e in enumerate(errors) if k != i]
        return sum(rest)

    found, at = [], errors_at(np.zeros(len(names)))
    for i, step in enumerate(steps):
        for halving in range(HALVINGS):  # a straight line that leads astray makes the others' errors larger
            errors = errors_at(0.5**halving * step)
            if elsewhere(errors, i) <= elsewhere(at, i):
                break
        else:
            errors = at
        found.append(errors[i])
    return found


def reconsider(
    finding: Finding, held: Held, refused: Iterable[Refused], tolerance: float, done: Steps | None = None
) -> tuple[Finding, tuple[Effect, ...], list[Refused]]:
    """Hold what could stand in the place of a kept cause against it on held-out data, which may tell the two apart or not.

    A rival that is clearly better there takes the cause's place. One that is about as good is declared indistinguishable.
    One that explains the fitting log as well and is clearly worse is refused. An effect that was refused because it adds
    nothing to those that are kept may do as well in the place of one of them, and is a rival all the same. Of the rivals in
    the fitting log the closest are judged.

    Args:
        finding: what is kept in one group.
        held: the held-out data.
        refused: what they refused in this group.
        tolerance: trust in the nominal parameters.
        done: sets judged already.

    Returns:
        The finding with these rivals and what is `undecided`; the set to keep: of effects that cannot be told apart, the
        likeliest; and the rivals refused.
    """
    chosen = finding.chosen
    named = tuple(e for e in chosen.effects if e.name not in SAMPLED)
    signal = next((s for s in finding.task.measured if s in held.record.signals), "")
    if not named or not signal or current().over:
        return finding, chosen.effects, []
    group = finding.task.model.group
    taken, worse = chosen.effects, []
    step = stepper(finding, held, signal, tolerance, done)
    best = at = step(named)
    listed, told, kept_apart = dict(finding.rivals), dict(finding.undecided), dict(finding.undecided)
    for effect in named:
        # one that has taken another's place already cannot take this one's, too
        rest = tuple(e for e in best.effects if e != effect)
        # what holds the kept one was refused in its place already
        turned_down = [
            r.effect
            for r in refused
            if r.effect not in chosen.effects and effect not in simpler(finding, r.effect)
        ]
        beside = closest(listed.get(effect.name, ()), chosen)
        able = [e for e in turned_down if not hopeless(finding, effect, e, tolerance)]
        others = dict.fromkeys([*able, *beside[:RIVALS_HELD_OUT]])
        instead: dict[Effect, Step] = {}
        for other in (
            e for e in others if e not in rest and not any(holds(e, r) or holds(r, e) for r in rest)
        ):
            if current().over:
                break
            instead[other] = step((*rest, other))
        cause = min(
            (e for e, s in instead.items() if not best.about_as_good(s)),
            key=lambda e: instead[e].fitted,
            default=effect,
        )
        if cause != effect:
            instead[effect], best = best, instead.pop(cause)
            taken = tuple(cause if e == effect else e for e in taken)
        bare = step(rest)
        undecided = [e for e, s in instead.items() if may_stand(e, s, bare, best)]
        proven = [e for e in undecided if instead[e].gain_over(bare).borne_out]
        told[cause.name] = [e.name for e in undecided]
        # should the set be kept as it was: what took its place is the first that may stand there
        first = [cause] if cause != effect else []
        kept_apart[effect.name] = [e.name for e in (*first, *undecided) if e != effect]
        as_well = dict(indistinguishable(finding, effect))
        if cause in as_well:
            as_well |= {effect: -as_well[cause]}
        elif cause != effect:
            gain = loss(finding, effect, tolerance)
            worse.append(Refused(effect, group.name, signal, gain, best.held, instead[effect].held))
        worse += [
            Refused(e, group.name, signal, as_well[e], best.held, s.held, True, cause.name)
            for e, s in instead.items()
            if e in as_well and best.clearly_better(s)
        ]
        known = {e.name for e in beside}
        sets = [(*rest, e) for e in undecided if e.name not in known]
        found = tried_all(finding.task, sets, tolerance, chosen.fit)
        listed[cause.name] = [*listed.get(effect.name, ()), *found]
        other = likeliest(cause, proven, group.asked)
        if other != cause:
            best = instead[other]
            taken = tuple(other if e == cause else e for e in taken)
            told[other.name] = [cause.name]
    if taken != chosen.effects:
        marked = tuple(e for e in taken if e.name in SAMPLED)
        begin = step(tuple(e for e in taken if e.name not in SAMPLED))
        after = shrunk(finding, replace(begin, above=(*at.above, at)), step, {})
        if not after.about_as_good(at):  # what is likelier by itself costs another cause its size
            return replace(finding, rivals=listed, undecided=kept_apart), chosen.effects, worse
        taken = (*after.effects, *marked)
        kept = {e.name: borne(after, e, step) for e in after.effects}
        finding = replace(finding, held_squares=after.squares, borne=kept)
    return replace(finding, rivals=listed, undecided=told), taken, worse


def closest(rivals: Iterable[Trial], chosen: Trial) -> list[Effect]:
    """What rivals have in the place of one of the chosen effects, the closest first."""
    beside = [
        [e for e in t.effects if e not in chosen.effects] for t in sorted(rivals, key=lambda t: -t.score)
    ]
    return [new[0] for new in beside if len(new) == 1]


def may_stand(other: Effect, instead: Step, bare: Step, at: Step) -> bool:
    """True if held-out data do not tell a rival in a cause's place from the cause.

    What describes the fitting log better is no worse a name for that the held-out log shows it too rarely.

    Args:
        other: the rival.
        instead: the set with it.
        bare: the set with neither.
        at: the set with the cause.
    """
    gained = instead.gain_over(bare)
    gains = gained.borne_out or (gained.gain > 0.0 and instead.fitted < at.fitted)
    return other.name not in instead.unsure and gains and instead.about_as_good(at)


def hopeless(finding: Finding, effect: Effect, other: Effect, tolerance: float) -> bool:
    """True if in the place of a named effect another does not half of what that one does in the fitting log."""
    task, chosen = finding.task, finding.chosen
    fewer = without(task, chosen, effect, finding.null, tolerance, quickly(tolerance))
    lost = chosen.fit.log_likelihood - fewer.fit.log_likelihood
    instead = tried(task, (*fewer.effects, other), tolerance, chosen.fit, QUICK_ROUNDS, quick=True)
    return instead.fit.log_likelihood - fewer.fit.log_likelihood < HOPELESS * lost


def likeliest(effect: Effect, others: Sequence[Effect], asked: Sequence[str]) -> Effect:
    """Of effects that cannot be told apart, the one to name: by the mapping's order if it asks for it, else by its odds."""
    options = [effect, *others]
    if effect.name in asked:
        return min(options, key=lambda e: asked.index(e.name) if e.name in asked else len(asked))
    return max(options, key=lambda e: e.prior)


def indistinguishable(finding: Finding, effect: Effect) -> list[tuple[Effect, float]]:
    """Effects that explain the fitting log as well as a named one in its place, and what they gain over it there."""
    found = []
    for trial in finding.rivals.get(effect.name, []):
        rival = next(e for e in trial.effects if e not in finding.chosen.effects)
        if trial.score > finding.chosen.score - INDISTINGUISHABLE:
            found.append((rival, trial.score - finding.chosen.score))
    return found


def balanced(
    finding: Finding,
    at: Step,
    waiting: tuple[Effect, ...],
    step: Callable[[tuple[Effect, ...]], Step],
    losses: Mapping[str, float],
) -> Step:
    """The set from which nothing can be left out, and into which nothing more can be taken, that held-out data bear out.

    Args:
        finding: what was named in one group.
        at: where to begin.
        waiting: the effects named.
        step: fits a set of effects.
        losses: name of an effect -> log-likelihood that it gains in the fitting log; the least is left out first.
    """
    for _ in waiting:
        before = at
        while not current().over:
            more = [step(widened(finding, at.effects, e)) for e in waiting if e not in at.effects]
            better = [s for s in more if s.clearly_better(at)]
            for effect in at.effects:
                rest = tuple(e for e in at.effects if e != effect)
                more = [step((*rest, e)) for e, _ in indistinguishable(finding, effect) if e not in rest]
                better += [s for s in more if not at.about_as_good(s)]
            if not better:
                better = [s for s in map(step, pairs(finding, at.effects, waiting)) if s.clearly_better(at)]
            # the one that describes the fitting log best, of those that held-out data bear out
            if not better:
                break
            at = min(better, key=lambda s: s.fitted)
        at = shrunk(finding, at, step, losses)
        if {e.name for e in at.effects} == {e.name for e in before.effects}:
            break
    return at


def pairs(
    finding: Finding, effects: tuple[Effect, ...], waiting: tuple[Effect, ...]
) -> Iterator[tuple[Effect, ...]]:
    """The set with two more of the effects that wait: a load and a friction may each do harm without the other."""
    for one, other in combinations([e for e in waiting if e not in effects], 2):
        both = widened(finding, widened(finding, effects, one), other)
        if {one, other} <= set(both):
            yield both


def shrunk(
    finding: Finding, at: Step, step: Callable[[tuple[Effect, ...]], Step], losses: Mapping[str, float]
) -> Step:
    """The smallest set, down from one, that is not clearly worse on held-out data than any on the way to it.

    An effect stays if the set without it, or with something simpler in its place, is clearly worse than one of them. So
    effects that help together only stay together, though none of them is sure by itself, and what goes by small steps
    goes no further than one step might have. On the way lie sets whose sizes are unsure: nothing is held against those.
    (Of a model confidence set the simplest; Hansen, Lunde and Nason, Econometrica 79, 2011.)
    """
    passed = [*at.above, at] if at.sure else [*at.above]
    while at.effects and not current().over:
        smaller = next_smaller(finding, at, step, losses, passed)
        if smaller is None or (smaller.sure and any(s.clearly_better(smaller) for s in passed)):
            break
        at = smaller
        if at.sure:
            passed.append(at)
    return replace(passed[-1], above=tuple(passed[:-1])) if passed else at


def next_smaller(
    finding: Finding,
    at: Step,
    step: Callable[[tuple[Effect, ...]], Step],
    losses: Mapping[str, float],
    passed: Sequence[Step],
) -> Step | None:
    """A set with an effect less, or a simpler one in its place, that held-out data do not speak against; None without one.

    The effect that gains least in the fitting log goes first, before all one whose size is unsure.
    """
    in_order = sorted(at.effects, key=lambda e: losses.get(e.name, 0.0))
    if not at.sure:
        first = next(e for e in in_order if e.name in at.unsure)
        instead = [step(e) for e in narrowed(finding, at.effects, first)]
        if all(at.noticeably_better(s) for s in instead):
            instead += [step(e) for e in exchanged(finding, at.effects, first)]
        return nearest(instead)  # what is unsure in it yet goes next
    worse = []
    for effect in in_order:
        for effects in narrowed(finding, at.effects, effect):
            fewer = step(effects)
            if any(s.clearly_better(fewer) for s in passed):
                continue
            if fewer.sure:
                return fewer
            worse.append(fewer)
    return least(worse) if worse else None


def narrowed(finding: Finding, effects: tuple[Effect, ...], effect: Effect) -> list[tuple[Effect, ...]]:
    """The set without an effect, and those with a simpler one in its place."""
    rest = tuple(e for e in effects if e != effect)
    less = [e for e in simpler(finding, effect) if e.name not in {r.name for r in rest}]
    return [rest, *((*rest, e) for e in less)]


def exchanged(finding: Finding, effects: tuple[Effect, ...], effect: Effect) -> list[tuple[Effect, ...]]:
    """The sets with one of the closest rivals in the place of an effect: of that the log may tell the size."""
    rest = tuple(e for e in effects if e != effect)
    others = dict.fromkeys(closest(finding.rivals.get(effect.name, ()), finding.chosen))
    apart = [e for e in others if not any(e == r or holds(e, r) or holds(r, e) for r in (*rest, effect))]
    return [(*rest, e) for e in apart[:RIVALS_HELD_OUT]]


def widened(finding: Finding, effects: tuple[Effect, ...], effect: Effect) -> tuple[Effect, ...]:
    """The set with one effect more, in place of those that it holds."""
    inside = {e.name for e in simpler(finding, effect)}
    return (*(e for e in effects if e.name not in inside), effect)


def simpler(finding: Finding, effect: Effect) -> list[Effect]:
    """Candidates that change a part of what an effect changes: Coulomb friction for Stribeck friction."""
    return [e for e in finding.task.model.group.effects() if holds(effect, e)]
