"""Which further effects are worth a fit: a score test of their sensitivities."""

import itertools
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from cosim.diagnosis.budget import current
from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.trials import Trial, copied, declared, holds, starting
from cosim.diagnosis.thresholds import HOPELESS, NAMING_GAIN, NOT_MADE_UP, PROMISING
from fmus.contract import Effect

DOSE = 0.02  # of a typical size: so little that what is not linear in it does not matter


def promising(
    task: Task, base: Trial, candidates: Iterable[Effect], tolerance: float, needed: float = 0.0
) -> list[Effect]:
    """The candidates that may add to a fitted set, by a score test: the most promising, and all near them.

    Each is put in at each of its starts; what that changes, less what the parameters already free can take up, points
    somewhere in the space of residuals, and the residual's part along it bounds what a small dose would gain.

    Args:
        task: data, model and noise.
        base: the fitted set.
        candidates: the effects.
        tolerance: trust in the nominal parameters.
        needed: log-likelihood that a candidate must gain to matter; those that promise less than half of it are left out.
    """

    def gain(effect: Effect) -> float:
        name, *more = [f"{effect.component}.{p}" for p in effect.free]
        if (
            name in task.model.group.trusted and not more
        ):  # free already, against its prior: what that costs is what is to be gained
            deviation = task.model.trust(name, tolerance)[0]
            return relief(base, name, task.model.nominal(name), deviation, base.fit.count)
        wanted, starts = starting(task, (effect,), tolerance, base.fit)
        return pointed(copied(task), base, {u.name: starts[u.name] for u in wanted if u.name in starts})

    # a law beside one that holds it says the same thing twice
    listed = [c for c in candidates if not any(holds(c, e) or holds(e, c) for e in base.effects)]
    if listed and current().over:
        current().leave_out(task.model.group.name, "a further cause")
        return []
    with ThreadPoolExecutor(2) as pool:
        gains = dict(zip((e.name for e in listed), pool.map(gain, listed), strict=True))
    listed.sort(key=lambda e: -gains[e.name])
    listed = [e for e in listed if gains[e.name] >= HOPELESS * needed]
    reach = 0.3 * gains[listed[0].name] if listed else 0.0
    return listed[:PROMISING] + [e for e in listed[PROMISING:] if gains[e.name] > max(reach, NAMING_GAIN)]


def pointed(task: Task, base: Trial, starts: Mapping[str, tuple[float, ...]]) -> float:
    """Log-likelihood that a small dose of a change would gain at most: the largest over all combinations of its starts.

    Args:
        task: data, model and noise.
        base: the fitted set that is changed.
        starts: ``component.parameter`` -> values it takes, SI; the others stay as fitted.
    """
    plain = task.white(base.fit.residuals)
    # the pulls of the priors are residuals too: a change may gain by relieving them
    residual = plain if base.fit.rows is None else base.fit.rows
    slopes = np.zeros((residual.size, 0)) if base.fit.slopes is None else base.fit.slopes
    hidden = np.linalg.qr(slopes)[0]  # priors are rows below the residuals
    best = 0.0
    for values in itertools.product(*starts.values()):
        moved = base.fit.values | dict(zip(starts, values, strict=True))
        change = plain - task.white(task.residuals(moved))
        change = np.concatenate([change, np.zeros(hidden.shape[0] - change.size)])
        change -= hidden @ (hidden.T @ change)
        size = float(change @ change)
        if size > 0.0:
            best = max(best, 0.5 * float(change @ residual) ** 2 / size)
    return best


def identifiable(task: Task, null: Trial, candidates: Iterable[Effect]) -> tuple[Effect, ...]:
    """The candidates that are not one number with the model's free parameters in this log.

    A small dose of such an effect changes the prediction as the free parameters can change it: a gain that differs between
    the directions in a log of one direction, a gain of the sensor where inertia and friction are free. Whatever it is
    said to be, they make up for it.
    """
    if null.fit.slopes is None or not null.fit.slopes.size:
        return tuple(candidates)
    hidden = np.linalg.qr(null.fit.slopes[: null.fit.count])[0]
    base = task.white(task.residuals(null.fit.values))

    def apart(effect: Effect) -> bool:
        for parameter, free in effect.free.items():
            name = f"{effect.component}.{parameter}"
            if free.phase or name in null.fit.values:
                return True
            sign = 1.0 if declared(effect, parameter).high > task.model.nominal(name) else -1.0
            moved = null.fit.values | {name: task.model.nominal(name) + sign * DOSE * free.scale}
            change = task.white(task.residuals(moved)) - base
            rest = change - hidden @ (hidden.T @ change)
            if not change.any() or float(rest @ rest) > NOT_MADE_UP**2 * float(change @ change):
                return True
        return False

    return tuple(effect for effect in candidates if apart(effect))


def relief(base: Trial, name: str, nominal: float, deviation: float, count: int) -> float:
    """Log-likelihood that a trusted parameter would gain without its prior: the pull against what the data hold it with.

    Args:
        base: a fit in which the parameter is free under its prior.
        name: ``component.parameter``.
        nominal: mean of its prior, SI.
        deviation: standard deviation of its prior, SI.
        count: number of residuals, the priors' not counted.
    """
    names = list(base.fit.values)
    if name not in names or base.fit.slopes is None or names.index(name) >= base.fit.slopes.shape[1]:
        return 0.0
    pull = (base.fit.values[name] - nominal) / deviation
    at = names.index(name)
    own = base.fit.slopes[:, at].copy()
    own[count:] = 0.0  # its prior's row goes
    others = np.linalg.qr(np.delete(base.fit.slopes, at, axis=1))[0]
    own -= others @ (others.T @ own)
    held = float(own @ own)
    # a straight line promises too much where the data hardly hold it: no more than all that is left can be gained
    return min(0.5 * pull**2 * (1.0 + 1.0 / max(held, 1e-12)), base.fit.count / 2.0)
