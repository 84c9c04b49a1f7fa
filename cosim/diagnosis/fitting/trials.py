"""Sets of effects, fitted: what to estimate, from which starts, and which candidates are worth the time."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from cosim.diagnosis.budget import current, seen_by_threads
from cosim.diagnosis.fitting.fit import Fit, Task, Unknown, fit, placed
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.limits import idle, out_of_reach, passed_in_fit, reached
from cosim.diagnosis.fitting.noise import Whitener
from cosim.diagnosis.fitting.paced import paced
from cosim.diagnosis.fitting.starts import Size, fit_from_starts
from cosim.diagnosis.fitting.weighed import weighed
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.thresholds import (
    ASTRAY,
    BEHIND_BASE,
    CALIBRATED_TRUST,
    LAGGING,
    LARGEST_FORM,
    ROUGH_TRUST,
    SETTLED_GAIN,
    STILL_GAINING,
)
from cosim.diagnosis.watch import counted
from fmus import registry
from fmus.contract import Effect, Variable

SMALLEST_START = 0.05  # of an effect's typical size: the smallest start
FIRST_ROUNDS = 4  # of a fit, before those that lag far behind are given up
QUICK_ROUNDS = 6  # the same of a quick fit
FITTED_ON = 4  # times as many rounds more, at most, where the order of a few counts
QUICK = True  # the benchmark of the time switches it off
HIDDEN = "sensor.bias"  # the model starts where the sensor reads: a bias only shifts the zero of laws that have their own


@dataclass
class Trial:
    """One set of effects, fitted.

    Attributes:
        effects: the effects, in the order they were added.
        fit: the fit, with the trusted parameters under their priors.
        price: free parameters beyond those of the nominal model.
        fewer: what has been fitted with one of the effects left out, and under which noise and model.
    """

    effects: tuple[Effect, ...]
    fit: Fit
    price: int
    fewer: dict[tuple[str, ...], tuple[Mapping[str, Whitener], GroupModel, "Trial"]] = field(
        default_factory=dict, repr=False, compare=False
    )

    @property
    def score(self) -> float:
        """Log-likelihood less BIC's price for each free parameter, and the log odds that the effects have beforehand."""
        odds = sum(effect.prior for effect in self.effects)
        return self.fit.log_likelihood - charged(self.price, self.fit) + odds

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, sorted."""
        return tuple(sorted(e.name for e in self.effects))


def charged(parameters: int, found: Fit) -> float:
    """BIC's price of free parameters, in log-likelihood, by the number of values fitted."""
    return 0.5 * parameters * float(np.log(max(found.count, 2)))


def candidates_of(task: Task) -> tuple[Effect, ...]:
    """The effects that a fit can tell in a group: all but those seen in the raw samples, and a bias that the start hides."""
    hidden = {*SAMPLED, HIDDEN} if task.model.group.starts else SAMPLED
    return tuple(e for e in task.model.group.effects() if e.name not in hidden)


def holds(effect: Effect, other: Effect) -> bool:
    """True if an effect changes all parameters of another and more: Stribeck's friction those of Coulomb's."""
    return other.component == effect.component and set(other.free) < set(effect.free)


def declared(effect: Effect, parameter: str) -> Variable:
    """Declaration of a parameter that an effect frees: its own, or its block's."""
    if parameter in effect.parameters:
        return effect.parameters[parameter]
    return registry.parameter(effect.component, parameter)


def trusted(model: GroupModel, tolerance: float) -> list[Unknown]:
    """The group's trusted parameters with their priors."""
    found = []
    for name in model.group.trusted:
        value = model.nominal(name)
        deviation, low, high = model.trust(name, tolerance)
        scale = min(deviation, abs(value) or deviation)
        ratio = tolerance >= CALIBRATED_TRUST and low > 0.0
        found.append(Unknown(name, value, scale, low, high, (value, deviation), ratio=ratio))
    return found


def unknowns(
    model: GroupModel, effects: Iterable[Effect], tolerance: float
) -> tuple[list[Unknown], dict[str, tuple[float, ...]]]:
    """What to estimate with these effects, and from which starts: a parameter that an effect frees loses its prior."""
    found = {u.name: u for u in trusted(model, tolerance)}
    starts: dict[str, tuple[float, ...]] = {}
    for effect in effects:
        for parameter, free in effect.free.items():
            name = f"{effect.component}.{parameter}"
            variable = declared(effect, parameter)
            nominal = model.nominal(name)
            # an effect seen in the samples stays where it was seen: a scale this small holds it there
            scale = 1e-12 if effect.name in SAMPLED else free.scale
            low, high = variable.low, variable.high
            known = name in model.group.trusted
            # however wrong, it has the order of magnitude that it is trusted to have
            if known:
                _, least, most = model.trust(name, tolerance)
                low, high = max(low, least), min(high, most)
            # where nobody knows the nominal value, parts of it are no bound
            if parameter in effect.ranges and not (known and tolerance >= CALIBRATED_TRUST):
                least, most = effect.ranges[parameter].edges(nominal)
                low, high = float(np.fmax(low, least)), float(np.fmin(high, most))
            if parameter in effect.forms:
                low, high = (
                    max(low, nominal - LARGEST_FORM * free.scale),
                    min(high, nominal + LARGEST_FORM * free.scale),
                )
            # where the period is sought, too, it goes straight with the phase, and bent with sine and cosine
            whole = free.phase and len(effect.free) == 2
            amplitude = f"{effect.component}.{effect.key}" if whole else ""
            within = (f"{effect.component}.{free.within[0]}", free.within[1]) if free.within else None
            found[name] = Unknown(name, nominal, scale, low, high, amplitude=amplitude, within=within)
            # a small size is always tried: from there a weak effect, or none, is soon found
            off = nominal if free.floor == 0.0 else nominal + SMALLEST_START * free.scale
            listed = parameter in effect.parameters and free.floor == 0.0
            starts[name] = free.starts if listed else tuple(dict.fromkeys((off, *free.starts)))
    return list(found.values()), starts


def anchored(wanted: list[Unknown], values: Mapping[str, float]) -> list[Unknown]:
    """Unknowns that begin at known values and stay within a typical change of them where nothing else holds them.

    A part of a log may never show a parameter (a stop that it does not reach): a fit to that part must not carry it off.
    """
    return [u if u.prior else replace(u, prior=(u.start, u.scale)) for u in placed(wanted, values)]


def tried(
    task: Task,
    effects: tuple[Effect, ...],
    tolerance: float,
    near: Fit | None = None,
    rounds: int = 12,
    quick: bool = False,
) -> Trial:
    """Fit a set of effects, quickly if so wanted (see `fit`); parameters that `near` has already estimated begin there."""
    wanted, starts = starting(task, effects, tolerance, near)
    if near is not None:
        for name in near.values:
            if name in starts:
                starts[name] = (near.values[name], *unused(task, effects, name, near, starts[name]))
        wanted = placed(wanted, near.values)
    price = price_of(task, wanted, tolerance)
    if not starts:
        return Trial(effects, fit(task, wanted, rounds=rounds, quick=quick), price)
    slopes = None if near is None else near.slopes
    size = sought(task.model, effects, starts)
    besides = {}
    if size is not None and size.phase:
        effect = next(e for e in effects if size.name == f"{e.component}.{e.key}")
        besides = weighed(task, effect, {u.name: u.start for u in wanted})
    elif size is not None and quickly(tolerance):
        effect = next(
            e for e in effects if size.name.partition(".")[2] in e.free and size.name.startswith(e.component)
        )
        besides = paced(task, effect, {u.name: u.start for u in wanted})
    found = fit_from_starts(
        task, wanted, starts, rounds=rounds, size=size, slopes=slopes, quick=quick, besides=besides
    )
    if beyond := passed_in_fit(task, effects, found):
        # one end of a travel is there, though in the place of the other something else was described
        found = fit(task, placed(wanted, found.values | beyond), rounds=rounds, quick=quick)
    met = out_of_reach(task, effects, found, not rough(tolerance))
    return Trial(effects, met, price - sum(unpaid(task.model, e, met) for e in effects))


def unpaid(model: GroupModel, effect: Effect, found: Fit) -> int:
    """How many of an effect's parameters a fit says nothing of: what no data could tell costs nothing, but one is paid.

    Where a log moves to one side only, a dead zone is so no dearer than friction, which has one parameter for both sides.
    """
    silent = [
        idle(found, name) or (bool(free.limits) and found.values[name] == model.nominal(name))
        for p, free in effect.free.items()
        if (name := f"{effect.component}.{p}") in found.values
    ]
    return min(sum(silent), max(len(silent) - 1, 0))


def unused(
    task: Task, effects: tuple[Effect, ...], name: str, near: Fit, starts: tuple[float, ...]
) -> tuple[float, ...]:
    """Further starts of a limit that a fit left out of reach: what is fitted now may make the machine meet it."""
    limits = {f"{e.component}.{p}" for e in effects for p, free in e.free.items() if free.limits}
    return starts if name in limits and near.values[name] == task.model.nominal(name) else ()


def rough(tolerance: float) -> bool:
    """True where what a model predicts between its blocks says nothing: not even its orders of magnitude are known."""
    return tolerance > ROUGH_TRUST


def starting(
    task: Task, effects: tuple[Effect, ...], tolerance: float, near: Fit | None
) -> tuple[list[Unknown], dict[str, tuple[float, ...]]]:
    """What to estimate with these effects, and from which starts: of a limit also where the log has its extremes."""
    wanted, starts = unknowns(task.model, effects, tolerance)
    # what a model of rough guesses predicts between its blocks is known once it has been fitted
    known = near.values if near else None if rough(tolerance) else {}
    bounds = {u.name: (u.low, u.high) for u in wanted}
    for name, extremes in reached(task, effects, known).items():
        # a spool that never leaves its dead zone has no speed: no limit of it is possible there
        starts[name] = (*starts[name], *np.clip(extremes, *bounds[name]).tolist())
    return wanted, starts


def price_of(task: Task, wanted: list[Unknown], tolerance: float) -> int:
    """Free parameters beyond those of the nominal model."""
    known = trusted(task.model, tolerance)
    return (
        len(wanted) - len(known) + sum(u.prior is None and u.name in task.model.group.trusted for u in wanted)
    )


def of_usual_size(task: Task, effects: tuple[Effect, ...], tolerance: float, most: float) -> Trial:
    """Fit a set of effects none of which is larger than so many of its typical sizes."""
    wanted, starts = unknowns(task.model, effects, tolerance)
    for effect in (e for e in effects if e.key in e.free):
        name, reach = f"{effect.component}.{effect.key}", most * effect.free[effect.key].scale
        off = task.model.nominal(name)
        wanted = [
            replace(u, low=max(u.low, off - reach), high=min(u.high, off + reach)) if u.name == name else u
            for u in wanted
        ]
    return Trial(effects, fit_from_starts(task, wanted, starts), price_of(task, wanted, tolerance))


def sought(
    model: GroupModel, effects: tuple[Effect, ...], starts: dict[str, tuple[float, ...]]
) -> Size | None:
    """What sets the size of the one effect that nothing is known of yet; None where all are known, or several are not."""
    keys = {f"{e.component}.{e.key if e.key in e.free else next(iter(e.free))}": e for e in effects}
    new = [(n, e) for n, e in keys.items() if len(starts[n]) > 1 and e.name not in SAMPLED]
    if len(new) != 1:
        return None
    ((key, effect),) = new
    phases = [f"{effect.component}.{p}" for p, free in effect.free.items() if free.phase]
    return Size(key, model.nominal(key), phases[0] if phases else "")


def without(
    task: Task, trial: Trial, effect: Effect, null: Trial, tolerance: float, quick: bool = False
) -> Trial:
    """A fitted set without one of its effects, fitted once only; of the last one the nominal model is left.

    Args:
        task: data, model and noise.
        trial: the fitted set.
        effect: one of its effects.
        null: the nominal model.
        tolerance: trust in the nominal parameters.
        quick: a few rounds do: it only serves to see what could take the effect's place.
    """
    kept = tuple(e for e in trial.effects if e != effect)
    if not kept:
        return null
    rules, model, known = trial.fewer.get((effect.name, *effect.free), (None, None, null))
    if rules is not task.rules or model is not task.model or (known.fit.sketched and not quick):
        begin = trial.fit if rules is not task.rules or model is not task.model else known.fit
        known = tried(task, kept, tolerance, begin, *((QUICK_ROUNDS, True) if quick else ()))
        trial.fewer[effect.name, *effect.free] = (task.rules, task.model, known)
    return known


def quickly(tolerance: float) -> bool:
    """True where quick fits do: beside trusted parameters that act alike the minimum is narrow, and they keep to it."""
    return QUICK and tolerance >= CALIBRATED_TRUST


def tried_all(
    task: Task,
    sets: list[tuple[Effect, ...]],
    tolerance: float,
    near: Fit | None = None,
    begun: Iterable[Trial] = (),
) -> list[Trial]:
    """Fit many sets, on both cores: the compiled simulation lets go of the interpreter. Best first.

    All get a few quick rounds; only those that may still win are fitted to the end. When the time is over, what has not
    begun is left out.

    Args:
        task: data, model and noise.
        sets: the sets of effects.
        tolerance: trust in the nominal parameters.
        near: where parameters known already begin.
        begun: earlier trials of the same sets, under other noise: their estimates are where these begin.
    """
    started = {t.names: t.fit for t in begun}
    budget, group = current(), task.model.group.name
    quick = quickly(tolerance)
    rounds = QUICK_ROUNDS if quick else FIRST_ROUNDS

    def first(effects: tuple[Effect, ...]) -> Trial | None:
        if budget.over:
            budget.leave_out(group, effects[0].name if len(effects) == 1 else "a set of causes")
            return None
        begin = started.get(sorted_names(effects), near)
        return tried(copied(task), effects, tolerance, begin, rounds, quick=quick)

    def further(trial: Trial) -> Trial:
        reach = max(best - max(LAGGING, 0.5 * (best - base)), base - BEHIND_BASE)
        if trial.fit.settled or trial.fit.log_likelihood <= reach or budget.over:
            return trial
        if quick:
            again = tried(copied(task), trial.effects, tolerance, trial.fit, QUICK_ROUNDS, quick=True)
            if again.score < trial.score + STILL_GAINING:
                return trial
            trial = again
        return tried(copied(task), trial.effects, tolerance, trial.fit)

    def led(trial: Trial) -> Trial:
        other = None if budget.over else led_on(trial, trials)
        if other is None:
            return trial
        if not quick:
            return max(trial, tried(copied(task), trial.effects, tolerance, other.fit), key=lambda t: t.score)
        redone = tried(copied(task), trial.effects, tolerance, other.fit, rounds, quick=True)
        return max(trial, further(redone), key=lambda t: t.score)

    with ThreadPoolExecutor(2) as pool:
        begun_now = counted(pool.map(seen_by_threads(first), sets), len(sets))
        trials = [trial for trial in begun_now if trial is not None]
        if not trials:
            return []
        base = near.log_likelihood if near is not None else min(t.fit.log_likelihood for t in trials)
        for more in (further, led):
            best = max(t.fit.log_likelihood for t in trials)
            trials = list(pool.map(seen_by_threads(more), trials))
    return sorted(trials, key=lambda t: -t.score)


def freed(effects: Iterable[Effect]) -> list[str]:
    """``component.parameter`` of all that the effects free."""
    return [f"{e.component}.{p}" for e in effects for p in e.free]


def led_on(trial: Trial, others: list[Trial]) -> Trial | None:
    """Another trial from which this one's search should begin again, since it went astray; None if there is none.

    One that frees a part of what this one frees, and yet explains more; or one that frees all that this one frees, in as
    many effects (Stribeck friction for Coulomb friction), and explains far more.
    """
    own, reached = set(freed(trial.effects)), trial.fit.log_likelihood
    found = [
        t
        for t in others
        if (set(freed(t.effects)) < own and t.fit.log_likelihood > reached + ASTRAY)
        or (
            set(freed(t.effects)) > own
            and len(t.effects) == len(trial.effects)
            and t.fit.log_likelihood > reached + LAGGING
        )
    ]
    return max(found, key=lambda t: t.fit.log_likelihood, default=None)


def polished(task: Task, trial: Trial, tolerance: float, hopeful: bool = True) -> Trial:
    """The trial fitted on until it settles or gains no more; one of little hope, only if a few more quick rounds gain."""
    if not hopeful and quickly(tolerance) and not (trial.fit.settled or current().over):
        again = tried(task, trial.effects, tolerance, trial.fit, QUICK_ROUNDS, quick=True)
        if again.score < trial.score + STILL_GAINING:
            return trial
        trial = again
    for _ in range(4):
        if trial.fit.settled or current().over:
            break
        further = tried(task, trial.effects, tolerance, trial.fit)
        if further.score < trial.score + SETTLED_GAIN:
            break
        trial = further
    return trial


def fitted_on(
    task: Task, trials: Iterable[Trial], tolerance: float, worth: Callable[[Trial], float]
) -> list[Trial]:
    """Trials fitted on, on both cores, while a few more quick rounds gain; `worth` is of what they are compared by."""

    def further(trial: Trial) -> Trial:
        for _ in range(FITTED_ON):
            if trial.fit.settled or current().over:
                break
            again = tried(copied(task), trial.effects, tolerance, trial.fit, QUICK_ROUNDS, quick=True)
            gained = worth(again) - worth(trial)
            trial = again if gained > 0.0 else trial
            if gained < SETTLED_GAIN:
                break
        return trial

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(seen_by_threads(further), trials))


def copied(task: Task) -> Task:
    """The same task with a model of its own, for another thread."""
    return replace(task, model=task.model.copy())


def sorted_names(effects: Iterable[Effect]) -> tuple[str, ...]:
    """Names of effects, sorted."""
    return tuple(sorted(e.name for e in effects))
