"""Which effects of the library explain a group's residual."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from cosim.compare.metrics import rms
from cosim.diagnosis.budget import current
from cosim.diagnosis.fitting.bounds import impossible
from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.noise import Whitener, broad
from cosim.diagnosis.fitting.pace import in_exact_steps, paced
from cosim.diagnosis.fitting.phases import usually_spelled
from cosim.diagnosis.fitting.trials import (
    Trial,
    candidates_of,
    declared,
    fitted_on,
    freed,
    polished,
    quickly,
    tried,
    tried_all,
    without,
)
from cosim.diagnosis.hypotheses.forms import forms, in_plain_form, in_same_form
from cosim.diagnosis.hypotheses.local_minima import away_from_stops
from cosim.diagnosis.hypotheses.pruning import confirmed, prune
from cosim.diagnosis.hypotheses.screening import identifiable, promising
from cosim.diagnosis.hypotheses.static_curve import together
from cosim.diagnosis.record.grid import Pieces
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.record.signatures import Signature, signatures
from cosim.diagnosis.residuals.finding import Finding, lacking, learn_noise, leftovers, relearned
from cosim.diagnosis.residuals.local import Event, apart, burst, line, near
from cosim.diagnosis.residuals.slow_oscillation import slow_oscillation
from cosim.diagnosis.thresholds import (
    BEYOND_TRUST,
    CALIBRATED_TRUST,
    IN_TURN,
    IN_VAIN,
    INDISTINGUISHABLE,
    LINE_PERIODS,
    NAMING_GAIN,
    NOMINAL_TRUST,
    ONE_SIDED_95,
    RIVAL_WITHIN,
    SINGLE_WITHIN,
    SURE_SIZE,
)
from cosim.inference.pieces import slope
from fmus.contract import Effect

Array = NDArray[np.float64]

# of task, null, one and other: whether the sizes of the one are sure and it predicts other data noticeably better
Judge = Callable[[Task, Trial, Trial, Trial], bool]


def worth_naming(trial: Trial, effect: Effect, model: GroupModel, tolerance: float) -> bool:
    """True if the effect's size matters: beyond its floor and its own uncertainty, beyond trust for a trusted parameter.

    Sizes of one effect that can hardly be told from each other (Coulomb's level and Stribeck's peak) may be sure together.
    """
    floored = any(free.floor for free in effect.free.values())
    large = False
    for parameter, free in effect.free.items():
        name = f"{effect.component}.{parameter}"
        change = abs(trial.fit.values[name] - model.nominal(name))
        spread = trial.fit.deviations[name]
        if name in model.group.trusted and len(effect.free) == 1:
            return change - ONE_SIDED_95 * spread > BEYOND_TRUST * tolerance * abs(model.nominal(name))
        if (free.floor or not floored) and change > free.floor:
            if change > SURE_SIZE * spread:
                return True
            large = True
    sizes = sizes_of(effect, model, trial.fit.values) if large else {}
    return len(sizes) > 1 and joint(trial.fit, sizes) > sure_from(len(sizes))


def sizes_of(effect: Effect, model: GroupModel, values: Mapping[str, float]) -> dict[str, float]:
    """``component.parameter`` -> estimate less its off value, of those that are what its size is: in its unit, no phase."""
    if effect.key not in effect.free:
        return {}
    unit = declared(effect, effect.key).unit
    same_unit = [p for p, free in effect.free.items() if not free.phase and declared(effect, p).unit == unit]
    names = [f"{effect.component}.{p}" for p in same_unit]
    return {n: values[n] - model.nominal(n) for n in names}


def joint(found: Fit, sizes: dict[str, float]) -> float:
    """Wald's statistic of several estimates against none: chi-square of their number where all are nothing."""
    names = list(found.values)[: found.covariance.shape[0]]
    at = [names.index(n) for n in sizes if n in names]
    if len(at) < len(sizes):
        return 0.0
    return wald(np.array(list(sizes.values())), found.covariance[np.ix_(at, at)])


def wald(sizes: Array, covariance: Array) -> float:
    """Wald's statistic of estimates (k,) less where they are nothing, by their covariance (k, k)."""
    return float(sizes @ np.linalg.pinv(covariance, hermitian=True) @ sizes)


def sure_from(count: int) -> float:
    """Wald's statistic from which so many sizes are sure together."""
    return float(chi2.isf(2.0 * norm.sf(SURE_SIZE), count))


def accepted(new: Trial, old: Trial, model: GroupModel, tolerance: float, sure: float = NAMING_GAIN) -> bool:
    """True if `new` (one effect more) is to be believed over `old`: by `sure` of log-likelihood beyond its price."""
    effect = new.effects[-1]
    if not believable(new, model, tolerance):
        return False
    if all(f"{effect.component}.{p}" in model.group.trusted for p in effect.free):
        # its prior has been its price; beyond that it must gain as much as any other cause
        return new.fit.log_likelihood > old.fit.log_likelihood + sure
    return new.score > old.score + sure


def believable(new: Trial, model: GroupModel, tolerance: float) -> bool:
    """True if the last effect of a set has a size that matters and can be."""
    return worth_naming(new, new.effects[-1], model, tolerance) and not impossible(new, model)


def find(
    task: Task,
    record: Record,
    tolerance: float = NOMINAL_TRUST,
    most: int = 3,
    better: Judge | None = None,
) -> Finding:
    """Name the effects in one group: forward with swaps and removals, the noise learned anew after each step.

    Where parameters are free, what most reduces the error itself comes first (`least_error`), and where other data will
    judge it is all: the details that noise learned from a poor model makes much of were other ones in each log.

    Noise is what remains when all causes are known: learned too early it hides the next cause or bends the first, so
    whenever a cause has made it smaller, everything is fitted again before the next is looked for. Causes that windows of
    this log left out do not bear out are taken out again, unless other data judge them (`better`).
    """
    within = better is None
    candidates = candidates_of(task)
    null, exact = nominal(task, record, tolerance), task.model
    if free := tolerance >= CALIBRATED_TRUST:
        candidates = identifiable(task, null, candidates)
    paced(task, exact, null.fit, candidates, tolerance)
    largest = least_error(task, null, candidates, tolerance, most, better) if most and free else None
    if largest is not None and not within:
        # other data will judge by the size of the error as well: what does not change that would not stay
        null, chosen, single = under_noise_left(task, record, null, largest, candidates, tolerance)
    else:
        null, chosen, single = in_detail(task, record, exact, null, largest, candidates, tolerance, most)
    null, chosen, single = in_exact_steps(task, exact, null, chosen, single, tolerance)
    chosen = in_plain_form(task, chosen, tolerance)
    single = in_same_form(task, chosen, single, tolerance)
    if within:  # otherwise other data decide
        chosen = confirmed(task, chosen, null, tolerance)
    finding = Finding(task, null, chosen, single, free=free)
    if len(chosen.effects) == 1:
        single = [to_the_end(task, t, finding, tolerance, SINGLE_WITHIN) for t in single]
    before, after = (leftovers(task, record, trial.fit) for trial in (null, chosen))
    finding = replace(finding, single=single, before=before, after=after)
    if within:
        finding = prune(finding, record, tolerance)
        if finding.chosen is not chosen:
            finding = replace(finding, single=in_same_form(task, finding.chosen, single, tolerance))
    seen = sampled(task, record, finding.chosen.fit)
    return replace(
        finding,
        # where other data decide some of the causes may go first, and their rivals with them
        rivals=rivals(task, finding, candidates, tolerance, RIVAL_WITHIN if within else 0.0),
        events={s: local_tests(task, s, finding.chosen.fit) for s in task.measured},
        signatures=seen,
        chosen=with_signatures(usually_spelled(finding.chosen), seen),
    )


def in_detail(
    task: Task,
    record: Record,
    exact: GroupModel,
    null: Trial,
    largest: Trial | None,
    candidates: tuple[Effect, ...],
    tolerance: float,
    most: int,
) -> tuple[Trial, Trial, list[Trial]]:
    """What the log tells under the noise learned from what is left; as `onward`.

    Args:
        task: data, model and noise.
        record: the log.
        exact: the model in the log's own steps.
        null: the nominal model, fitted.
        largest: what most reduces the error, with which the search begins again where it has left something: noise learned
            from a poor model may have hidden it.
        candidates: the effects.
        tolerance: trust in the nominal parameters.
        most: effects at most.
    """
    single = tried_all(task, [(e,) for e in candidates], tolerance, null.fit)
    known = task.rules, task.model

    def searched(chosen: Trial) -> tuple[Trial, Trial, list[Trial]]:
        return onward(task, record, exact, null, chosen, single, candidates, tolerance, most)

    chosen = best_single(task, null, single, tolerance) if most else null
    found = searched(chosen)
    if largest is None or current().over or not lacking(task, record, found[1].fit):
        return found
    ended = task.rules, task.model
    task.set_rules(known[0])
    task.model = known[1]
    other = searched(tried(task, largest.effects, tolerance, largest.fit))
    if remaining(task, other[1]) < remaining(task, found[1]):
        return other
    task.set_rules(ended[0])
    task.model = ended[1]
    return found


def onward(
    task: Task,
    record: Record,
    exact: GroupModel,
    null: Trial,
    chosen: Trial,
    single: list[Trial],
    candidates: tuple[Effect, ...],
    tolerance: float,
    most: int,
) -> tuple[Trial, Trial, list[Trial]]:
    """The nominal model, the set that a search ends with, and the single effects, all under the noise learned meanwhile.

    Args:
        task: data, model and noise.
        record: the log.
        exact: the model in the log's own steps.
        null: the nominal model, fitted.
        chosen: the set with which the search begins.
        single: every single effect, fitted.
        candidates: the effects.
        tolerance: trust in the nominal parameters.
        most: effects at most.
    """
    for _ in range(2 * most):
        if not chosen.effects or current().over:
            break
        if relearned(task, record, chosen.fit):
            paced(task, exact, chosen.fit, candidates, tolerance)
            null = tried(task, (), tolerance, null.fit)
            single = tried_all(task, [(e,) for e in candidates], tolerance, null.fit, single)
            chosen = fitted_again(task, null, chosen, single, candidates, tolerance)
        room = 0 < len(chosen.effects) < most
        more = extended(task, record, chosen, single, candidates, tolerance) if room else None
        if more is None:
            break
        chosen = more
    return null, chosen, single


def under_noise_left(
    task: Task, record: Record, null: Trial, found: Trial, candidates: tuple[Effect, ...], tolerance: float
) -> tuple[Trial, Trial, list[Trial]]:
    """The nominal model, a set of effects and each single effect, all under the noise that the set leaves.

    Args:
        task: data, model and noise, which is learned anew.
        record: the log.
        null: the nominal model, fitted.
        found: the set.
        candidates: the effects.
        tolerance: trust in the nominal parameters.
    """
    chosen = tried(task, found.effects, tolerance, found.fit)
    if relearned(task, record, chosen.fit):
        null = tried(task, (), tolerance, null.fit)
        chosen = tried(task, chosen.effects, tolerance, chosen.fit)
    single = tried_all(task, [(e,) for e in candidates], tolerance, null.fit)
    return null, chosen, single


def remaining(task: Task, trial: Trial) -> float:
    """RMS of what a set leaves of a group's first signal in the windows, SI; what is constant there counts where it does."""
    signal, rule = next(iter(task.rules.items()))
    rows = rule.windows(trial.fit.residuals[signal])
    return rms((rows - rows.mean(axis=1, keepdims=True) if rule.demean else rows).ravel())


def least_error(
    task: Task,
    null: Trial,
    candidates: tuple[Effect, ...],
    tolerance: float,
    most: int,
    better: Judge | None = None,
) -> Trial | None:
    """What most reduces the error itself, as long as that is sure; None for nothing.

    Where parameters are free and much is wrong, the noise learned from what a poor model leaves is as large and as slow as
    its errors: they cost nothing, and no cause that would mend them gains. Here all that is left by the richer of two sets
    counts as white noise, as few independent values as its correlation allows. The search ends where `IN_VAIN` steps have
    made nothing noticeably better on the data that judge it.
    """
    known, chosen = task.rules, null

    def weighed(trial: Trial) -> None:
        task.set_rules({s: broad(rule, trial.fit.residuals[s]) for s, rule in task.rules.items()})

    def worth(trial: Trial) -> float:
        # by what each leaves, the size of which is not known: of n values n/2 times the logarithm, less a price and with the
        # odds beforehand; BIC's price, or AIC's where other data have the last word
        count = max(-2.0 * chosen.fit.log_likelihood, 2.0)
        left = float(np.log(max(-2.0 * trial.fit.log_likelihood, 1e-300)))
        odds = sum(effect.prior for effect in trial.effects)
        bic = 0.5 * float(np.log(count))
        return -0.5 * count * left - trial.price * (bic if better is None else min(1.0, bic)) + odds

    def foremost(options: list[Trial]) -> list[Trial]:
        # by quick fits they stand in an order of chance
        ahead = sorted(options, key=worth, reverse=True)[:IN_TURN]
        return sorted(fitted_on(task, ahead, tolerance, worth), key=worth, reverse=True)

    def believed(options: list[Trial]) -> Trial | None:
        # the best by far may be one whose size nobody knows
        for best in options:
            weighed(best)
            before = tried(task, chosen.effects, tolerance, chosen.fit)
            more = tried(task, best.effects, tolerance, best.fit)
            # a beginning only: what is named is decided later
            if worth(more) > worth(before) and believable(more, task.model, tolerance):
                return more
        weighed(chosen)
        return None

    def begun() -> Trial | None:
        # one by one, what bends the same curve would each be found where the others are missing
        bent = together(task, null, candidates, tolerance)
        if bent is None:
            return None
        weighed(bent)
        if worth(bent) <= worth(tried(task, (), tolerance, null.fit)):
            weighed(chosen)
            return None
        found = swapped(task, bent, candidates, tolerance, worth)
        weighed(found)
        return found

    try:
        weighed(null)
        chosen = null = tried(task, (), tolerance, null.fit)
        proven, in_vain = chosen, 0
        if (bent := begun()) is not None:
            chosen = bent
            if better is None or better(task, null, chosen, proven):
                proven = chosen
        for _ in range(most):
            further = [e for e in candidates if e not in chosen.effects]
            if chosen.effects:
                further = promising(task, chosen, further, tolerance)
            options = tried_all(task, [(*chosen.effects, e) for e in further], tolerance, chosen.fit)
            if not options or current().over:
                break
            more = believed(foremost(options))
            if more is None:
                break
            # few values count here: whether what pays its price is sure is asked later
            chosen = swapped(task, more, candidates, tolerance, worth)
            if better is not None:
                proven, in_vain = (chosen, 0) if better(task, null, chosen, proven) else (proven, in_vain + 1)
            if in_vain == IN_VAIN:
                break
    finally:
        task.set_rules(known)
    chosen = proven if better is not None and proven.effects else chosen
    return chosen if chosen.effects else None


def nominal(task: Task, record: Record, tolerance: float) -> Trial:
    """The model without effects, fitted, and the noise learned from it."""
    null = tried(task, (), tolerance)
    learn_noise(task, record, null.fit)
    null = tried(task, (), tolerance, null.fit)
    clear = away_from_stops(task, null, tolerance)
    if clear is not null:
        learn_noise(task, record, clear.fit)
        null = tried(task, (), tolerance, clear.fit)
    return null


def best_single(task: Task, null: Trial, single: list[Trial], tolerance: float) -> Trial:
    """The best single effect that is to be believed over the nominal model, or the nominal model."""
    better = [t for t in single if accepted(t, null, task.model, tolerance)]
    return max((polished(task, t, tolerance) for t in better[:2]), key=lambda t: t.score, default=null)


def fitted_again(
    task: Task,
    null: Trial,
    chosen: Trial,
    single: list[Trial],
    candidates: tuple[Effect, ...],
    tolerance: float,
) -> Trial:
    """The chosen set under the noise learned since, or what is better now."""
    if len(chosen.effects) == 1 and not chosen.effects[0].is_formed:
        return best_single(task, null, single, tolerance)
    return swapped(task, tried(task, chosen.effects, tolerance, chosen.fit), candidates, tolerance)


def extended(
    task: Task,
    record: Record,
    chosen: Trial,
    single: list[Trial],
    candidates: tuple[Effect, ...],
    tolerance: float,
) -> Trial | None:
    """The chosen set with the best further effect or form of a law, exchanges and removals tried; None if none is sure.

    What the one chosen effect was strained to in the absence of the other may keep a search that begins there from finding
    it: where something is left, both are sought anew from their own starts (of more effects there are too many).
    """
    rest = promising(task, chosen, (e for e in candidates if e not in chosen.effects), tolerance)
    further = [(*chosen.effects, e) for e in rest]
    options = tried_all(task, [*further, *forms(task, chosen, single)], tolerance, chosen.fit, single)
    better = [t for t in options if accepted(t, chosen, task.model, tolerance)]
    if not better and len(chosen.effects) == 1 and lacking(task, record, chosen.fit):
        better = [
            t for t in tried_all(task, further, tolerance) if accepted(t, chosen, task.model, tolerance)
        ]
    if not better:
        return None
    found = swapped(task, polished(task, better[0], tolerance), candidates, tolerance)
    return found if freed(found.effects) != freed(chosen.effects) else None


def local_tests(task: Task, signal: str, found: Fit) -> dict[str, Event]:
    """What is left of a signal at one time or at one frequency."""
    white, rule = task.white_of(signal, found.residuals), task.rules[signal]
    interval, begin = rule.bins * task.model.h, rule.skip * task.model.h
    event = burst(white, interval, begin)
    # what happened once may ring as well: a line is what all the rest has
    rings = line(apart(white, event, interval, begin), interval)
    if rings.start > 0.0:  # no larger than what is left there
        size = rule.sigma * float(np.sqrt(max(rings.excess - 1.0, 0.0)))
        there = near(rule.windows(found.residuals[signal]), interval, rings.start)
        rings = replace(rings, size=min(size, there))
    tests = {"event": placed_in_time(task, rule, event), "line": rings}
    if task.model.grid is None or task.model.grid.even:  # elsewhere bins differ in length
        own = found.residuals[signal], task.model.drive, task.predicted(found)[signal]
        left, *motions = (rule.windows(values) for values in own)
        log, highest = rule.log_of(task.model.drive.size), LINE_PERIODS / (rule.window * interval)
        # an oscillation goes on within a log, and not from one to the next
        each = [
            slow_oscillation(
                left[log == i].ravel(), [m[log == i].ravel() for m in motions], interval, highest
            )
            for i in np.unique(log)
        ]
        best = min(each, key=lambda e: e.p_value)
        tests["oscillation"] = replace(best, p_value=min(1.0, best.p_value * len(each)))
    return tests


def placed_in_time(task: Task, rule: Whitener, event: Event) -> Event:
    """An event with times of the logs one behind the other, in the place of those counted over the windows."""
    if not isinstance(task.model.grid, Pieces):
        return event
    inside, stamps = rule.layout.inside(task.model.drive.size), task.model.grid.stamps
    bins = [round((t / task.model.h - rule.skip) / rule.bins) * rule.bins for t in (event.start, event.end)]
    start, end = (float(stamps[inside[min(k, inside.size - 1)]]) for k in bins)
    return replace(event, start=start, end=end)


def sampled(task: Task, record: Record, found: Fit) -> list[Signature]:
    """Effects seen in the raw samples of the group's slew reading, of those that the group may show.

    What the samples show in one third of the log and not in another happened once, and is no property of the sensor: the
    third that shows least but one has to bear it out.
    """
    reading = task.model.group.reading
    if reading is None or reading not in task.measured:
        return []
    allowed = {e.name for e in task.model.group.effects()}
    values, noise = record.signals[reading], task.rules[reading].rms
    rate = slope(task.predicted(found)[reading], task.model.h, task.model.cuts)
    parts = zip(np.array_split(values, 3), np.array_split(rate, 3), strict=True)
    each = [{m.effect: m.gain for m in signatures(part, moving, noise)} for part, moving in parts]
    seen = [m for m in signatures(values, record.rate(reading), noise) if m.effect in allowed]
    again = [replace(m, held_out=sorted(one.get(m.effect, 0.0) for one in each)[1]) for m in seen]
    return [m for m in again if m.held_out_gain.sure]


def with_signatures(trial: Trial, seen: list[Signature]) -> Trial:
    """The trial with the parameters of what the samples show among its values."""
    values = {f"{m.effect.partition('.')[0]}.{m.parameter}": m.value for m in seen}
    spreads = {f"{m.effect.partition('.')[0]}.{m.parameter}": m.deviation for m in seen}
    fit_ = replace(trial.fit, values=trial.fit.values | values, deviations=trial.fit.deviations | spreads)
    return Trial(trial.effects, fit_, trial.price)


def swapped(
    task: Task,
    chosen: Trial,
    candidates: tuple[Effect, ...],
    tolerance: float,
    worth: Callable[[Trial], float] | None = None,
) -> Trial:
    """Exchange or drop single effects of a set of two or more while that pays.

    Args:
        task: data, model and noise.
        chosen: the set.
        candidates: the effects.
        tolerance: trust in the nominal parameters.
        worth: of a set, where not its score counts; what does not pay its price then goes, and not all that is not sure.
    """
    worth, sure = (lambda t: t.score, NAMING_GAIN) if worth is None else (worth, 0.0)
    while len(chosen.effects) > 1 and not current().over:
        sets: list[tuple[Effect, ...]] = []
        for out in chosen.effects:
            kept = tuple(e for e in chosen.effects if e != out)
            fewer = without(task, chosen, out, chosen, tolerance, quickly(tolerance))
            free = (e for e in candidates if e not in chosen.effects)
            # in the place of the one left out another must make up for what that one explains; beside a trusted
            # parameter that acts as it does a small dose says nothing of that
            lost = chosen.fit.log_likelihood - fewer.fit.log_likelihood
            needed = lost if tolerance >= CALIBRATED_TRUST else 0.0
            sets += [kept, *((*kept, e) for e in promising(task, fewer, free, tolerance, needed))]
        best = max(tried_all(task, sets, tolerance, chosen.fit), key=worth, default=chosen)
        dropped = len(best.effects) < len(chosen.effects)
        if worth(best) > worth(chosen) + (-sure if dropped else 1.0):
            chosen = best
        else:
            break
    return chosen


def rivals(
    task: Task,
    finding: Finding,
    candidates: tuple[Effect, ...],
    tolerance: float,
    share: float = RIVAL_WITHIN,
) -> dict[str, list[Trial]]:
    """For each accepted effect, the sets in which another stands in its place, best first; `share` as `to_the_end`."""
    found: dict[str, list[Trial]] = {}
    for effect in finding.chosen.effects:
        kept = tuple(e for e in finding.chosen.effects if e != effect)
        sets = []
        if kept:
            fewer = without(task, finding.chosen, effect, finding.null, tolerance, quickly(tolerance))
            free = (e for e in candidates if e not in finding.chosen.effects)
            sets = [(*kept, e) for e in promising(task, fewer, free, tolerance)]
        found[effect.name] = (
            tried_all(task, sets, tolerance, finding.chosen.fit)
            if kept
            else [t for t in finding.single if t.effects[0] != effect]
        )
        if kept:  # one effect may do what the whole set does
            found[effect.name] += [t for t in finding.single if t.effects[0] not in finding.chosen.effects]
        found[effect.name] = [to_the_end(task, t, finding, tolerance, share) for t in found[effect.name]]
    return found


def to_the_end(
    task: Task, rival: Trial, finding: Finding, tolerance: float, share: float = RIVAL_WITHIN
) -> Trial:
    """A rival that explains nearly as much as the chosen set, fitted until it settles: it may explain as much."""
    best = finding.chosen.fit.log_likelihood
    reach = best - max(INDISTINGUISHABLE, share * (best - finding.null.fit.log_likelihood))
    return (
        rival
        if rival.fit.settled or rival.fit.log_likelihood < reach
        else polished(task, rival, tolerance, hopeful=False)
    )
