"""Which effects of the library explain a group's residual."""

from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain

import numpy as np

from cosim.diagnosis.bounds import impossible
from cosim.diagnosis.crossval import refuted, window_numbers
from cosim.diagnosis.data import Record, free_bases
from cosim.diagnosis.fit import Fit, Task
from cosim.diagnosis.freeform import SYSTEMATIC, Basis, Leftover, explain
from cosim.diagnosis.group_model import GroupModel
from cosim.diagnosis.local import Event, burst, line
from cosim.diagnosis.noise import learned
from cosim.diagnosis.samples import SAMPLED, Mark, marks
from cosim.diagnosis.trials import (
    CLOSE,
    SURE,
    Trial,
    declared,
    polished,
    promising,
    tried,
    tried_all,
    trusted,
    unknowns,
)
from fmus.contract import Effect

__all__ = ["BEYOND", "CLOSE", "SURE", "Finding", "Trial", "declared", "find", "tried", "trusted", "unknowns"]

SMALLER = 0.97  # of the noise: less, and all is fitted again
BEYOND = 3.0  # standard deviations of trust beyond which a nominal parameter is itself a cause (CONTRACT section 4)


@dataclass
class Finding:
    """What was found in one group.

    Attributes:
        task: data, model and noise.
        null: the nominal model, trusted parameters fitted under their priors.
        chosen: the accepted set of effects (empty: the nominal model).
        single: every single effect, best first.
        rivals: for each accepted effect, sets that differ in that effect, best first.
        before, after: what free functions still explain, by signal.
        events: what is left at one time ("event") or one frequency ("line") only, by signal.
        marks: effects seen in the raw samples.
        upstream: effects of the blocks before, with how far each explains the log worse than the accepted one.
        confirmed: held-out data have borne out the chosen effects.
    """

    task: Task
    null: Trial
    chosen: Trial
    single: list[Trial] = field(default_factory=list)
    rivals: dict[str, list[Trial]] = field(default_factory=dict)
    before: dict[str, Leftover] = field(default_factory=dict)
    after: dict[str, Leftover] = field(default_factory=dict)
    events: dict[str, dict[str, Event]] = field(default_factory=dict)
    marks: list[Mark] = field(default_factory=list)
    upstream: list[tuple[Effect, float]] = field(default_factory=list)
    confirmed: bool = False


def bases_of(task: Task, record: Record, found: Fit) -> dict[str, list[Basis]]:
    """Free functions for each signal of the group, its linear part as fitted."""
    own = task.model.group.linear
    predicted = {s: task.measured[s] - r for s, r in found.residuals.items()}
    return free_bases(
        record, task.model.group, {n: task.model.nominal(n) for n in own} | found.values, predicted
    )


def leftovers(task: Task, record: Record, found: Fit) -> dict[str, Leftover]:
    """What free functions explain of a fit's residuals, by signal."""
    silent = {s: np.zeros_like(r) for s, r in found.residuals.items()}
    window = window_numbers(task)
    explained = {}
    for signal, bases in bases_of(task, record, found).items():
        white = partial(lambda signal, values: task.white(silent | {signal: values}), signal)
        explained[signal] = explain(found.residuals[signal], bases, task.rules[signal], white, window)
    return explained


def learn_noise(task: Task, record: Record, found: Fit) -> None:
    """Set the task's whitening rules from the part of the residuals that free functions do not explain."""
    rules = {}
    for signal, bases in bases_of(task, record, found).items():
        columns = chain.from_iterable([*(b.columns() for b in bases), task.doubt.get(signal, ())])
        rules[signal] = learned(task.rules[signal], found.residuals[signal], columns)
    task.set_rules(rules)


def worth_naming(trial: Trial, effect: Effect, model: GroupModel, tolerance: float) -> bool:
    """True if the effect's size matters: beyond its floor and its own uncertainty, beyond trust for a trusted parameter."""
    for parameter, free in effect.free.items():
        name = f"{effect.component}.{parameter}"
        change = abs(trial.fit.values[name] - model.nominal(name))
        spread = trial.fit.deviations[name]
        if name in model.group.trusted and len(effect.free) == 1:
            return change - 1.64 * spread > BEYOND * tolerance * abs(model.nominal(name))
        if free.floor and change > free.floor and change > 2.0 * spread:
            return True
    return all(free.floor == 0.0 for free in effect.free.values())


def accepted(new: Trial, old: Trial, model: GroupModel, tolerance: float) -> bool:
    """True if `new` (one effect more) is to be believed over `old`."""
    effect = new.effects[-1]
    if not worth_naming(new, effect, model, tolerance) or impossible(new, model):
        return False
    if all(f"{effect.component}.{p}" in model.group.trusted for p in effect.free):
        # the size is the test; but what cannot be told from the old explanation is none
        return new.fit.log_likelihood > old.fit.log_likelihood + CLOSE
    return new.score > old.score + SURE


def find(
    task: Task,
    record: Record,
    tolerance: float = 0.01,
    most: int = 3,
    within: bool = True,
    begin: Trial | None = None,
) -> Finding:
    """Name the effects in one group: forward with swaps and removals, the noise learned anew after each step.

    Noise is what remains when all causes are known: learned too early it hides the next cause or bends the first, so
    whenever a cause has made it smaller, everything is fitted again before the next is looked for. Causes that windows of
    this log refute, or that explain less than what stays unexplained, are taken out again, unless other data will judge
    them (`within` is False). A search may begin with a set of effects that is known to hold.
    """
    candidates = tuple(e for e in task.model.group.effects() if e.name not in SAMPLED)
    null = tried(task, (), tolerance)
    learn_noise(task, record, null.fit)
    null = tried(task, (), tolerance, null.fit)
    single = tried_all(task, [(e,) for e in candidates], tolerance, null.fit)
    chosen = best_single(task, null, single, tolerance) if most else null
    if begin is not None:
        chosen = tried(task, begin.effects, tolerance, begin.fit)
    for _ in range(2 * most):
        if not chosen.effects:
            break
        if smaller_noise(task, record, chosen.fit):
            null = tried(task, (), tolerance, null.fit)
            single = tried_all(task, [(e,) for e in candidates], tolerance, null.fit, single)
            if len(chosen.effects) == 1:
                chosen = best_single(task, null, single, tolerance)
            else:
                chosen = tried(task, chosen.effects, tolerance, chosen.fit)
                chosen = swapped(task, chosen, candidates, tolerance)
        more = extended(task, chosen, candidates, tolerance) if 0 < len(chosen.effects) < most else None
        if more is None:
            break
        chosen = more
    if within:
        chosen = confirmed(task, chosen, null, tolerance)
    finding = Finding(task, null, chosen, single)
    finding.before = leftovers(task, record, finding.null.fit)
    finding.after = leftovers(task, record, finding.chosen.fit)
    if within:
        drop_outweighed(finding, record, tolerance)
    finding.rivals = rivals(task, finding, candidates, tolerance)
    finding.events = {s: local_tests(task, s, finding.chosen.fit) for s in task.measured}
    finding.marks = sampled(task, record, finding.chosen.fit)
    if finding.marks:
        finding.chosen = with_marks(finding.chosen, finding.marks)
    return finding


def confirmed(task: Task, chosen: Trial, null: Trial, tolerance: float) -> Trial:
    """The chosen set without what no possible value explains and what held-out windows refute, the worst first."""
    while chosen.effects and (out := impossible(chosen, task.model) or refuted(task, chosen, tolerance)):
        kept = tuple(e for e in chosen.effects if e is not out[0])
        chosen = tried(task, kept, tolerance, chosen.fit) if kept else null
    return chosen


def drop_outweighed(finding: Finding, record: Record, tolerance: float) -> None:
    """Take causes out that explain less than what stays unexplained."""
    while out := outweighed(finding, tolerance):
        kept = tuple(e for e in finding.chosen.effects if e is not out)
        finding.chosen = tried(finding.task, kept, tolerance, finding.chosen.fit) if kept else finding.null
        finding.after = leftovers(finding.task, record, finding.chosen.fit)


def outweighed(finding: Finding, tolerance: float) -> Effect | None:
    """The least of the causes, if more is left unexplained than it explains: it may be what it imitates of that."""
    left = sum(r.gain for r in finding.after.values() if r.p_value < SYSTEMATIC and r.held_out > 0.0)
    if not finding.chosen.effects or left <= 0.0:
        return None
    losses = []
    for effect in finding.chosen.effects:
        rest = tuple(e for e in finding.chosen.effects if e is not effect)
        without = tried(finding.task, rest, tolerance, finding.chosen.fit) if rest else finding.null
        losses.append((finding.chosen.fit.log_likelihood - without.fit.log_likelihood, effect))
    loss, effect = min(losses, key=lambda item: item[0])
    return effect if loss < left else None


def smaller_noise(task: Task, record: Record, found: Fit) -> bool:
    """Learn the noise from a fit; True if it is smaller than was thought, otherwise the rules stay as they were."""
    rules = task.rules
    learn_noise(task, record, found)
    if any(task.rules[s].sigma < SMALLER * rule.sigma for s, rule in rules.items()):
        return True
    task.set_rules(rules)
    return False


def best_single(task: Task, null: Trial, single: list[Trial], tolerance: float) -> Trial:
    """The best single effect that is to be believed over the nominal model, or the nominal model."""
    better = [t for t in single if accepted(t, null, task.model, tolerance)]
    return max((polished(task, t, tolerance) for t in better[:2]), key=lambda t: t.score, default=null)


def extended(task: Task, chosen: Trial, candidates: tuple[Effect, ...], tolerance: float) -> Trial | None:
    """The chosen set with the best further effect, exchanges and removals tried; None if no further one is believed."""
    rest = promising(task, chosen, (e for e in candidates if e not in chosen.effects), tolerance)
    options = tried_all(task, [(*chosen.effects, e) for e in rest], tolerance, chosen.fit)
    better = [t for t in options if accepted(t, chosen, task.model, tolerance)]
    if not better:
        return None
    found = swapped(task, polished(task, better[0], tolerance), candidates, tolerance)
    return found if found.names != chosen.names else None


def local_tests(task: Task, signal: str, found: Fit) -> dict[str, Event]:
    """What is left of a signal at one time or at one frequency."""
    white, rule = task.white_of(signal, found.residuals), task.rules[signal]
    interval = rule.bins * task.model.h
    return {
        "event": burst(white, interval, rule.skip * task.model.h),
        "line": line(white, interval),
    }


def sampled(task: Task, record: Record, found: Fit) -> list[Mark]:
    """Effects seen in the raw samples of the group's slew reading, of those that the group may show."""
    reading = task.model.group.reading
    if reading is None or reading not in task.measured:
        return []
    allowed = {e.name for e in task.model.group.effects()}
    seen = marks(task.measured[reading], record.rate(reading), task.rules[reading].rms)
    return [m for m in seen if m.effect in allowed]


def with_marks(trial: Trial, seen: list[Mark]) -> Trial:
    """The trial with the parameters of what the samples show among its values."""
    values = {f"{m.effect.partition('.')[0]}.{m.parameter}": m.value for m in seen}
    spreads = {f"{m.effect.partition('.')[0]}.{m.parameter}": m.deviation for m in seen}
    fit_ = replace(trial.fit, values=trial.fit.values | values, deviations=trial.fit.deviations | spreads)
    return Trial(trial.effects, fit_, trial.price)


def swapped(task: Task, chosen: Trial, candidates: tuple[Effect, ...], tolerance: float) -> Trial:
    """Exchange or drop single effects of a set of two or more while that pays."""
    while len(chosen.effects) > 1:
        sets: list[tuple[Effect, ...]] = []
        for out in chosen.effects:
            kept = tuple(e for e in chosen.effects if e is not out)
            fewer = tried(task, kept, tolerance, chosen.fit)
            others = promising(task, fewer, (e for e in candidates if e not in chosen.effects), tolerance)
            sets += [kept, *((*kept, e) for e in others)]
        best = tried_all(task, sets, tolerance, chosen.fit)[0]
        dropped = len(best.effects) < len(chosen.effects)
        if best.score > chosen.score + (-SURE if dropped else 1.0):
            chosen = best
        else:
            break
    return chosen


def rivals(
    task: Task, finding: Finding, candidates: tuple[Effect, ...], tolerance: float
) -> dict[str, list[Trial]]:
    """For each accepted effect, the sets in which another stands in its place, best first."""
    found: dict[str, list[Trial]] = {}
    for effect in finding.chosen.effects:
        kept = tuple(e for e in finding.chosen.effects if e is not effect)
        sets = []
        if kept:
            fewer = tried(task, kept, tolerance, finding.chosen.fit)
            others = promising(
                task, fewer, (e for e in candidates if e not in finding.chosen.effects), tolerance
            )
            sets = [(*kept, e) for e in others]
        found[effect.name] = (
            tried_all(task, sets, tolerance, finding.chosen.fit)
            if kept
            else [t for t in finding.single if t.effects[0] is not effect]
        )
        if kept:  # one effect may do what the whole set does
            found[effect.name] += [t for t in finding.single if t.effects[0] not in finding.chosen.effects]
    return found
