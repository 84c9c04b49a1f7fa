"""Causes before a group that explain what the group shows: too small to stand out where they act, large once integrated.

An asymmetry of one per cent hides in the noise of the pressure, yet over a minute it turns the slew away as a drift of the
sensor would. Each effect that the blocks before could have is therefore weighed here as well: as far as their own
measurement allows it, and by what it would then do to this group.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.chain import Known, delivered
from cosim.diagnosis.data import Record
from cosim.diagnosis.fit import Fit, Task
from cosim.diagnosis.group_model import GroupModel
from cosim.diagnosis.naming import Finding
from cosim.diagnosis.trials import Trial, declared, freed
from fmus.contract import Effect

Array = NDArray[np.float64]


def upstream_rivals(finding: Finding, known: list[Known], record: Record) -> list[tuple[Effect, float]]:
    """Effects of the blocks before a group, with how far each explains the log worse than the named cause, best first.

    Args:
        finding: what was found in the group; only a single named cause has rivals here.
        known: the blocks before it, in order.
        record: the log.

    Returns:
        (effect, log-likelihood behind the named cause, prices counted); negative where it explains the log better.
    """
    if len(finding.chosen.effects) != 1 or not known:
        return []
    named = finding.chosen.score - finding.null.score
    found = []
    for i, item in enumerate(known):
        for trial in item.single:
            # a parameter that is free already counts as doubt of the drive
            if trial.effects[0] in item.named or any(
                n in item.model.group.trusted for n in freed(trial.effects)
            ):
                continue
            gained = gain_downstream(finding, known, i, trial, record)
            upstream = trial.fit.log_likelihood - item.fit.log_likelihood
            price = 0.5 * trial.price * float(np.log(max(finding.null.fit.count, 2)))
            found.append((trial.effects[0], named - (gained + upstream - price)))
    return sorted(found, key=lambda rival: rival[1])


def gain_downstream(finding: Finding, known: list[Known], at: int, trial: Trial, record: Record) -> float:
    """Log-likelihood that an effect before a group gains in the group, its size held by its own measurement."""
    task, null = finding.task, finding.null.fit

    def shift(values: dict[str, float]) -> Array:
        """Whitened change of the group's prediction when block `at` has these values."""
        moved = [
            *known[:at],
            replace(known[at], fit=replace(known[at].fit, values=values, covariance=np.empty((0, 0)))),
            *known[at + 1 :],
        ]
        return predicted(task, delivered([bare(k) for k in moved], record)[0], null) - base

    base = predicted(task, task.model.drive, null)
    best = shift(trial.fit.values)
    steps = [(shift(values) - best) / part for part, values in one_deviation(trial)]
    residual = task.white(null.residuals) - best
    width = len(steps)
    slopes = np.zeros((residual.size, 0)) if null.slopes is None else null.slopes
    pulls = slopes.shape[0] - residual.size  # rows of the priors
    full = np.concatenate([residual, np.zeros(pulls)]) if null.rows is None else null.rows.copy()
    full[: residual.size] = residual
    free = np.zeros((residual.size + pulls, width))
    if steps:
        free[: residual.size] = np.stack(steps, axis=1)
    matrix = np.block([[free, slopes], [np.eye(width), np.zeros((width, slopes.shape[1]))]])
    target = np.concatenate([full, np.zeros(width)])
    solution, *_ = np.linalg.lstsq(matrix, target, rcond=None)
    rest = target - matrix @ solution
    return -0.5 * float(rest @ rest) - null.log_likelihood


def bare(known: Known) -> Known:
    """Blocks as known, without their doubt."""
    return replace(known, fit=replace(known.fit, covariance=np.empty((0, 0))))


def predicted(task: Task, drive: Array, fit: Fit) -> Array:
    """Whitened prediction of a group for a drive, with the values of a fit."""
    model = GroupModel(task.model.group, drive, task.model.h, task.model.fixed, task.model.grid)
    return task.white(model.simulate(fit.values))


def one_deviation(trial: Trial) -> list[tuple[float, dict[str, float]]]:
    """Values one standard deviation along each freed parameter, the others moved as they go with it.

    Where limits are nearer than that, the part of it, with its sign, that they leave room for stands before the values.
    """
    names = list(trial.fit.values)
    limits = {
        f"{e.component}.{p}": (declared(e, p).low, declared(e, p).high) for e in trial.effects for p in e.free
    }
    moved = []
    for name in limits:
        j = names.index(name)
        deviation = trial.fit.deviations[name]
        if not 0.0 < deviation < np.inf:
            continue
        change = dict(zip(names, (trial.fit.covariance[:, j] / deviation).tolist(), strict=True))
        part = max((room(trial.fit.values, change, limits, sign) * sign for sign in (1.0, -1.0)), key=abs)
        if part != 0.0:
            moved.append((part, {n: trial.fit.values[n] + part * d for n, d in change.items()}))
    return moved


def room(
    values: dict[str, float], change: dict[str, float], limits: dict[str, tuple[float, float]], sign: float
) -> float:
    """Part of a change, 1 at most, that values can make in this direction without leaving their limits."""
    parts = [1.0]
    for name, (low, high) in limits.items():
        d = sign * change[name]
        if d != 0.0:
            parts.append(max(0.0, ((high if d > 0.0 else low) - values[name]) / d))
    return min(parts)
