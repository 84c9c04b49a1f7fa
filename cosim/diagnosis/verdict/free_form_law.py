"""Two laws that both had to take another form: what the log says of them whatever their forms.

Friction is a torque along the speed, a valve that opens late one along the pressure. Each law gets a free function of its
own signal beside it; what is then left between the two is no detail of a form.
"""

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.trials import Trial
from cosim.diagnosis.record.record import low_pass
from cosim.diagnosis.residuals.bases import to_motion
from cosim.diagnosis.residuals.freeform import Basis, solved
from cosim.diagnosis.thresholds import RESTING_SHARE
from cosim.inference.pieces import slope
from fmus.contract import Effect

Array = NDArray[np.float64]

LAW_KNOTS = 16  # on each side of zero, where such laws bend
LAW_CUTOFF = 20.0  # Hz: a measured signal holds little above but noise


def behind(task: Task, one: tuple[Effect, Trial], other: tuple[Effect, Trial]) -> float | None:
    """Log-likelihood by which the second of two laws explains the log worse, each with a free function beside it.

    None where the two depend on the same signal, or one of them is no torque along a signal.
    """
    if not one[0].along or not other[0].along or one[0].along == other[0].along:
        return None
    ahead, back = (with_free_function(task, trial, effect.along) for effect, trial in (one, other))
    return None if ahead is None or back is None else ahead - back


def with_free_function(task: Task, trial: Trial, along: str) -> float | None:
    """Log-likelihood of a fitted set with any torque along a signal beside it; None where nothing moves along it."""
    group = task.model.group
    driver = signal_along(task, trial, along) if group.kind == "mechanical" else None
    if driver is None or not driver.any():
        return None
    values = {n: task.model.nominal(n) for n in group.linear} | trial.fit.values
    size, angle = np.abs(driver), group.observed[0]
    steps = np.quantile(size[size > RESTING_SHARE * size.max()], np.linspace(0.0, 1.0, LAW_KNOTS))
    knots = np.unique(np.concatenate([-steps, [0.0], steps]))
    linear, model = to_motion(group, values, group.is_speed(angle)), task.model
    basis = Basis(along, "torque", "N.m", knots, driver, linear, model.h, cuts=model.cuts)
    silent = {s: np.zeros_like(r) for s, r in trial.fit.residuals.items()}
    columns = np.stack([task.white(silent | {angle: column}) for column in basis.columns()], axis=1)
    target = task.white(trial.fit.residuals) if trial.fit.rows is None else trial.fit.rows
    columns = np.concatenate([columns, np.zeros((target.size - columns.shape[0], columns.shape[1]))])
    # what is fitted already may move along, at the price of its prior
    matrix = columns if trial.fit.slopes is None else np.concatenate([trial.fit.slopes, columns], axis=1)
    rest = solved(matrix, target)[2]
    return trial.fit.log_likelihood + 0.5 * (float(target @ target) - rest)


def signal_along(task: Task, trial: Trial, along: str) -> Array | None:
    """(n,) the signal as the fitted model has it, or as it was measured where it drives the group; None without it."""
    model = task.model
    if along == "omega":
        seen = task.predicted(trial.fit)[model.group.observed[0]]
        return seen if model.group.is_speed(model.group.observed[0]) else slope(seen, model.h, model.cuts)
    if along == model.group.drive:
        return low_pass(model.drive, model.h, LAW_CUTOFF, model.cuts)
    inner = model.inside("continuity", along, trial.fit.values)
    return inner if inner is None or model.grid is None else model.grid.sampled(inner)
