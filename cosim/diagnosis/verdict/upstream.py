"""Causes before a group that explain what the group shows: too small to stand out where they act, large once integrated.

An asymmetry of one per cent hides in the noise of the pressure, yet over a minute it turns the slew away as a drift of the
sensor would. Each effect that the blocks before could have is therefore weighed here as well: as far as their own
measurement allows it, and by what it would then do to this group.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.chain import Known, delivered
from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.trials import Trial, charged, declared, freed
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import INDISTINGUISHABLE
from fmus.contract import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Origin:
    """What a group shows, explained by a block before it.

    Attributes:
        at: place of that block among those before.
        trial: its effects, fitted.
        behind: log-likelihood by which this explains the log worse than what was named in the group, prices counted;
            negative where it explains the log better.
    """

    at: int
    trial: Trial
    behind: float


def alternatives(finding: Finding) -> list[Trial]:
    """Every single effect of a group in which nothing is named, otherwise what can hardly be told from what is."""
    chosen = finding.chosen
    if not chosen.effects:
        return list(finding.single)
    sets = [t for listed in finding.rivals.values() for t in listed]
    return [
        t
        for t in sets
        if t.score > chosen.score - INDISTINGUISHABLE and len(t.effects) == len(chosen.effects)
    ]


def origins(finding: Finding, known: list[Known], record: Record) -> list[Origin]:
    """Explanations of what was named in a group, or of what it shows, by the blocks before it, best first.

    Args:
        finding: what was found in the group.
        known: the blocks before it, in order.
        record: the log.
    """
    named = finding.chosen.score - finding.null.score
    found = []
    for at, item in enumerate(known):
        for trial in item.others:
            # a parameter that is free already counts in the drive's covariance
            new = [e for e in trial.effects if e not in item.named]
            if any(n in item.model.group.trusted for n in freed(tuple(new))):
                continue
            gained = gain_downstream(finding, known, at, trial, record)
            upstream = trial.fit.log_likelihood - item.fit.log_likelihood
            price = charged(trial.price - item.price, finding.null.fit)
            found.append(Origin(at, trial, named - (gained + upstream - price)))
    return sorted(found, key=lambda origin: origin.behind)


def upstream_rivals(finding: Finding, listed: list[Origin], known: list[Known]) -> list[tuple[Effect, float]]:
    """Effects of blocks where nothing is named, with how far each explains the log worse than a group's one cause."""
    if len(finding.chosen.effects) != 1:
        return []
    return [(o.trial.effects[0], o.behind) for o in listed if not known[o.at].named]


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
    """Blocks as known, without their discrepancy."""
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
