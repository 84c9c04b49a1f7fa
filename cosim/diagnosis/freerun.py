"""Fits to the error over a whole log, drift included: what a free run is judged by."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.budget import current
from cosim.diagnosis.data import Record, fixed_values, is_start
from cosim.diagnosis.fit import Fit, Task, fit, placed
from cosim.diagnosis.grid import of_piece
from cosim.diagnosis.group_model import GroupModel
from cosim.diagnosis.naming import Finding, tried, unknowns
from cosim.diagnosis.noise import Whitener
from fmus.contract import Effect

Array = NDArray[np.float64]

ROUNDS = 6  # of a fit, at most
GAINED = 1e-3  # of the sum of squares that a further round must take away
CLUSTERS = 12  # parts of the log that count as independent repetitions in intervals


def whole(task: Task, size: Mapping[str, float], mask: NDArray[np.bool_] | None = None) -> Task:
    """The task of fitting the error over the whole log as it is, drift included: what a free run is judged by.

    Args:
        task: the task of naming, in windows with offsets of their own.
        size: signal -> size of the error, SI.
        mask: (windows,) windows that count, or None for all.
    """
    rules = {
        s: Whitener(r.bins, r.window, False, (size[s] ** 2,) + (0.0,) * len(r.sizes[1:]), r.skip, cuts=r.cuts)
        for s, r in task.rules.items()
    }
    return Task(task.model, task.measured, rules, lost=task.lost, mask=mask)


def refitted(
    finding: Finding,
    effects: tuple[Effect, ...],
    tolerance: float,
    near: Fit,
    mask: NDArray[np.bool_] | None = None,
) -> Fit:
    """Trusted parameters and effects fitted to the error over the whole log.

    Over a whole log sticking makes the error jagged, with several valleys. The search begins where the fit in windows
    ends, so that it finds the valley that the shape of the signal speaks for, and goes on until it gains no more. What is
    left of a real machine's log is mostly what the model lacks and not noise, so parts of the log stand for independent
    repetitions in the intervals (sandwich estimator; Huber 1967, White 1982).

    Args:
        finding: what was named in one group.
        effects: the causes.
        tolerance: trust in the nominal parameters.
        near: a fit in windows of a set nearby.
        mask: (windows,) windows that count, or None for all.
    """
    size = {s: max(float(np.std(r)), 1e-300) for s, r in near.residuals.items()}
    task = whole(finding.task, size, mask)
    wanted, _ = unknowns(task.model, effects, tolerance)
    found = tried(finding.task, effects, tolerance, near).fit
    for left in reversed(range(ROUNDS)):
        before = found.log_likelihood if left < ROUNDS - 1 else -np.inf
        found = fit(task, placed(wanted, found.values), rounds=20)
        if found.log_likelihood < before + GAINED * abs(before) or current().over:
            break
    if not wanted or found.slopes is None or found.rows is None:
        return found
    scales = np.array([u.scale for u in wanted])
    scores = found.slopes[: found.count] * found.rows[: found.count, None]
    parts = np.stack([part.sum(axis=0) for part in np.array_split(scores, CLUSTERS)])
    bread = np.linalg.pinv(found.slopes.T @ found.slopes)
    known = found.slopes[
        found.count :
    ]  # the priors' rows: what the log does not tell is as uncertain as they leave it
    meat = parts.T @ parts * CLUSTERS / (CLUSTERS - 1.0) + known.T @ known
    covariance = bread @ meat @ bread * np.outer(scales, scales)
    names = [u.name for u in wanted]
    # of what nothing depends on, such as a part of friction larger than the whole, neither its size nor none is known
    for i in np.flatnonzero(~found.slopes.any(axis=0)):
        off = abs(found.values[names[i]] - task.model.nominal(names[i]))
        covariance[i, i] = max(off, scales[i]) ** 2
    deviations = dict(zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), strict=True))
    return replace(found, covariance=covariance, deviations=deviations)


def errors(finding: Finding, fit: Fit, record: Record) -> dict[str, Array]:
    """Error (n,) of the group's signals over another log, driven by its measured drive, with a fit's values, SI."""
    model = finding.task.model
    if model.group.drive not in record.signals:
        return {}
    fixed = {n: v for n, v in of_piece(model.fixed, 0).items() if not is_start(n)}
    fixed |= fixed_values(record, model.group)
    own = GroupModel(model.group, record.signals[model.group.drive], record.h, fixed, record.grid)
    simulated = own.simulate({n: v for n, v in fit.values.items() if not is_start(n)})
    return {s: record.signals[s] - simulated[s] for s in finding.task.measured if s in record.signals}
