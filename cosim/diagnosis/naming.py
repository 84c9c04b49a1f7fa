"""Which effects of the library explain a group's residual."""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from cosim.diagnosis.data import Record, free_bases
from cosim.diagnosis.fit import Fit, Task, Unknown, fit, fit_from_starts
from cosim.diagnosis.freeform import Basis, Leftover, explain
from cosim.diagnosis.groups import TRUSTED, GroupModel
from cosim.diagnosis.noise import learned
from fmus import registry
from fmus.contract import Effect, Variable

SURE = 10.0  # log-likelihood beyond BIC's price that a cause must gain: odds of e^10 against chance
CLOSE = 6.0  # log-likelihood within which two explanations cannot be told apart
BEYOND = 3.0  # standard deviations of trust beyond which a nominal parameter is itself a cause (CONTRACT section 4)


@dataclass
class Trial:
    """One set of effects, fitted.

    Attributes:
        effects: the effects, in the order they were added.
        fit: the fit, with the trusted parameters under their priors.
        price: free parameters beyond those of the nominal model.
    """

    effects: tuple[Effect, ...]
    fit: Fit
    price: int

    @property
    def score(self) -> float:
        """Log-likelihood less BIC's price for each free parameter."""
        return self.fit.log_likelihood - 0.5 * self.price * float(np.log(max(self.fit.count, 2)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, sorted."""
        return tuple(sorted(e.name for e in self.effects))


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
        exercised: effect -> True if the log could have shown it at its practical floor.
    """

    task: Task
    null: Trial
    chosen: Trial
    single: list[Trial] = field(default_factory=list)
    rivals: dict[str, list[Trial]] = field(default_factory=dict)
    before: dict[str, Leftover] = field(default_factory=dict)
    after: dict[str, Leftover] = field(default_factory=dict)


def declared(effect: Effect, parameter: str) -> Variable:
    """Declaration of a parameter that an effect frees: its own, or its block's."""
    if parameter in effect.parameters:
        return effect.parameters[parameter]
    return registry.block(registry.FMU_OF_COMPONENT.get(effect.component, effect.component)).parameters[
        parameter
    ]


def trusted(model: GroupModel, tolerance: float) -> list[Unknown]:
    """The group's trusted parameters with their priors."""
    found = []
    for name in TRUSTED:
        if name.partition(".")[0] in model.group.components:
            value = model.nominal(name)
            deviation = abs(value) * tolerance
            found.append(Unknown(name, value, deviation, 0.1 * value, 10.0 * value, (value, deviation)))
    return found


def unknowns(model: GroupModel, effects: Iterable[Effect], tolerance: float) -> tuple[list[Unknown], dict[str, tuple[float, ...]]]:  # fmt: skip
    """What to estimate with these effects, and from which starts: a parameter that an effect frees loses its prior."""
    found = {u.name: u for u in trusted(model, tolerance)}
    starts: dict[str, tuple[float, ...]] = {}
    for effect in effects:
        for parameter, free in effect.free.items():
            name = f"{effect.component}.{parameter}"
            variable = declared(effect, parameter)
            nominal = model.nominal(name)
            found[name] = Unknown(name, nominal, free.scale, variable.low, variable.high)
            starts[name] = free.starts if parameter in effect.parameters else (nominal, *free.starts)
    return list(found.values()), starts


def tried(task: Task, effects: tuple[Effect, ...], tolerance: float, near: Fit | None = None) -> Trial:
    """Fit a set of effects; parameters that `near` has already estimated begin there."""
    wanted, starts = unknowns(task.model, effects, tolerance)
    if near is not None:
        for name in near.values:
            if name in starts:
                starts[name] = (near.values[name],)
        wanted = [
            Unknown(u.name, near.values.get(u.name, u.start), u.scale, u.low, u.high, u.prior) for u in wanted
        ]
    price = (
        len(wanted)
        - len(trusted(task.model, tolerance))
        + sum(u.prior is None and u.name in TRUSTED for u in wanted)
    )
    found = fit_from_starts(task, wanted, starts) if starts else fit(task, wanted)
    return Trial(effects, found, price)


def tried_all(
    task: Task, sets: list[tuple[Effect, ...]], tolerance: float, near: Fit | None = None
) -> list[Trial]:
    """Fit many sets, on both cores: the compiled simulation lets go of the interpreter. Best first."""
    with ThreadPoolExecutor(2) as pool:
        trials = list(pool.map(lambda e: tried(copied(task), e, tolerance, near), sets))
    return sorted(trials, key=lambda t: -t.score)


def copied(task: Task) -> Task:
    """The same task with a model of its own, for another thread."""
    model = GroupModel(task.model.group, task.model.drive, task.model.h, task.model.fixed)
    return Task(model, task.measured, task.rules, task.doubt, task.mask, task.shrink)


def bases_of(task: Task, record: Record, found: Fit) -> dict[str, list[Basis]]:
    """Free functions for each signal of the group, its linear part as fitted."""
    own = [n for n in TRUSTED if n.partition(".")[0] in task.model.group.components]
    predicted = {s: task.measured[s] - r for s, r in found.residuals.items()}
    return free_bases(
        record, task.model.group, {n: task.model.nominal(n) for n in own} | found.values, predicted
    )


def leftovers(task: Task, record: Record, found: Fit) -> dict[str, Leftover]:
    """What free functions explain of a fit's residuals, by signal."""
    silent = {s: np.zeros_like(r) for s, r in found.residuals.items()}
    explained = {}
    for signal, bases in bases_of(task, record, found).items():
        white = partial(lambda signal, values: task.white(silent | {signal: values}), signal)
        explained[signal] = explain(found.residuals[signal], bases, task.rules[signal], white)
    return explained


def learn_noise(task: Task, record: Record, found: Fit) -> None:
    """Set the task's whitening rules from the part of the residuals that free functions do not explain."""
    rules = {}
    for signal, bases in bases_of(task, record, found).items():
        columns = [b.columns for b in bases] + ([task.doubt[signal]] if signal in task.doubt else [])
        rules[signal] = learned(task.rules[signal], found.residuals[signal], np.concatenate(columns))
    task.set_rules(rules)


def worth_naming(trial: Trial, effect: Effect, model: GroupModel, tolerance: float) -> bool:
    """True if the effect's size matters: beyond its floor and its own uncertainty, beyond trust for a trusted parameter."""
    for parameter, free in effect.free.items():
        name = f"{effect.component}.{parameter}"
        change = abs(trial.fit.values[name] - model.nominal(name))
        spread = trial.fit.deviations[name]
        if name in TRUSTED and len(effect.free) == 1:
            return change - 1.64 * spread > BEYOND * tolerance * abs(model.nominal(name))
        if free.floor and change > free.floor and change > 2.0 * spread:
            return True
    return all(free.floor == 0.0 for free in effect.free.values())


def accepted(new: Trial, old: Trial, model: GroupModel, tolerance: float) -> bool:
    """True if `new` (one effect more) is to be believed over `old`."""
    effect = new.effects[-1]
    if not worth_naming(new, effect, model, tolerance):
        return False
    if all(f"{effect.component}.{p}" in TRUSTED for p in effect.free):
        return (
            new.fit.log_likelihood > old.fit.log_likelihood + 3.0
        )  # the size is the test; it must also explain something
    return new.score > old.score + SURE


def find(task: Task, record: Record, tolerance: float = 0.01, most: int = 3) -> Finding:
    """Name the effects in one group: forward with swaps, then backward."""
    model = task.model
    null = tried(task, (), tolerance)
    learn_noise(task, record, null.fit)
    candidates = model.group.effects()
    finding = Finding(task, null, null)
    for _ in range(3):
        null = tried(task, (), tolerance, null.fit)
        single = tried_all(task, [(e,) for e in candidates], tolerance, null.fit)
        chosen = grown(task, null, single, candidates, tolerance, most)
        finding = Finding(task, null, chosen, single)
        sizes = {s: rule.sigma for s, rule in task.rules.items()}
        learn_noise(task, record, chosen.fit)
        if all(task.rules[s].sigma > 0.97 * size for s, size in sizes.items()):
            break  # the noise was known well enough
    finding.before = leftovers(task, record, finding.null.fit)
    finding.after = leftovers(task, record, finding.chosen.fit)
    finding.rivals = rivals(task, finding, candidates, tolerance)
    return finding


def grown(task: Task, null: Trial, single: list[Trial], candidates: tuple[Effect, ...], tolerance: float, most: int) -> Trial:  # fmt: skip
    """Forward selection with swaps and removals, from the single effects already fitted."""
    chosen = null
    options = single
    while len(chosen.effects) < most:
        better = [t for t in options if accepted(t, chosen, task.model, tolerance)]
        if not better:
            return chosen
        chosen = better[0]
        chosen = swapped(task, chosen, null, candidates, tolerance)
        rest = [e for e in candidates if e not in chosen.effects]
        options = tried_all(task, [(*chosen.effects, e) for e in rest], tolerance, chosen.fit)
    return chosen


def swapped(
    task: Task, chosen: Trial, null: Trial, candidates: tuple[Effect, ...], tolerance: float
) -> Trial:
    """Exchange or drop single effects of a set of two or more while that pays."""
    while len(chosen.effects) > 1:
        sets: list[tuple[Effect, ...]] = []
        for out in chosen.effects[:-1]:
            kept = tuple(e for e in chosen.effects if e is not out)
            sets.append(kept)
            sets += [(*kept, e) for e in candidates if e not in chosen.effects]
        best = tried_all(task, sets, tolerance)[0]
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
        sets = [(*kept, e) for e in candidates if e not in finding.chosen.effects]
        found[effect.name] = (
            tried_all(task, sets, tolerance)
            if kept
            else [t for t in finding.single if t.effects[0] is not effect]
        )
    return found
