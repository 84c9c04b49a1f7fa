"""Fits to the error over a whole log, drift included, and to what the error of an axis that drifts moves meanwhile."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import rms
from cosim.diagnosis.budget import current
from cosim.diagnosis.fitting.fit import Fit, Task, Unknown, fit, placed
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.limits import passed_in_fit
from cosim.diagnosis.fitting.noise import NO_NOISE, Whitener
from cosim.diagnosis.fitting.trials import tried, unknowns
from cosim.diagnosis.record.grid import of_piece
from cosim.diagnosis.record.record import Record, fixed_values, is_start
from cosim.diagnosis.residuals.cross_validation import window_numbers
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import FREE_RUN_PARTS
from fmus.contract import Effect

Array = NDArray[np.float64]

FREE_RUN_ROUNDS = 6  # of a fit, at most
WALK_ROUNDS = 4  # times that the size of the walk is learned anew, at most
WALK_SETTLED = 0.95  # of its size, less than which a fit must leave for that to be worth it


def whole(task: Task, size: Mapping[str, float], mask: NDArray[np.bool_] | None = None) -> Task:
    """The task of fitting the error over the whole log as it is, drift included: what a free run is judged by.

    Args:
        task: the task of naming, in windows with offsets of their own.
        size: signal -> size of the error, SI.
        mask: (windows,) windows that count, or None for all.
    """
    # a reading that the model meets to its last digit, such as one that stands still, leaves no error
    square = {s: max(own, NO_NOISE) ** 2 for s, own in size.items()}
    rules = {
        s: Whitener(r.bins, r.window, False, (square[s],) + (0.0,) * len(r.sizes[1:]), r.skip, cuts=r.cuts)
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

    Over a whole log sticking makes the error jagged, with several local minima. The search begins where the fit in windows
    ends, so that it finds the minimum that the shape of the signal speaks for, and goes on until it settles. What is
    left of a real machine's log is mostly what the model lacks and not noise, so parts of the log stand for independent
    repetitions in the intervals (sandwich estimator; Huber 1967, White 1982).

    Args:
        finding: what was named in one group.
        effects: the causes.
        tolerance: trust in the nominal parameters.
        near: a fit in windows of a set nearby.
        mask: (windows,) windows that count, or None for all.
    """
    size = {s: float(np.std(r)) for s, r in near.residuals.items()}
    task = whole(finding.task, size, mask)
    wanted, _ = unknowns(task.model, effects, tolerance)
    begin = tried(finding.task, effects, tolerance, near).fit.values
    for _ in range(FREE_RUN_ROUNDS):
        found = fit(task, placed(wanted, begin), rounds=20)
        # one end of a travel is there, though in the place of the other something else was described
        beyond = passed_in_fit(task, effects, found)
        if (found.settled and not beyond) or current().over:
            break
        begin = found.values | beyond
    numbers = np.arange(found.count) * FREE_RUN_PARTS // max(found.count, 1)
    return with_sandwich(found, wanted, task.model, numbers)


def with_sandwich(found: Fit, wanted: list[Unknown], model: GroupModel, cluster: NDArray[np.int64]) -> Fit:
    """A fit with the covariance that parts of the log as independent repetitions give.

    Args:
        found: the fit.
        wanted: what was estimated.
        model: the group.
        cluster: (count,) number of the part to which each whitened residual belongs, from 0.
    """
    if not wanted or found.slopes is None or found.rows is None:
        return found
    scales = np.array([u.scale for u in wanted])
    scores = found.slopes[: found.count] * found.rows[: found.count, None]
    parts = np.zeros((FREE_RUN_PARTS, scores.shape[1]))
    np.add.at(parts, cluster, scores)
    bread = np.linalg.pinv(found.slopes.T @ found.slopes)
    # the priors' rows: what the log does not tell is as uncertain as they leave it
    known = found.slopes[found.count :]
    meat = parts.T @ parts * FREE_RUN_PARTS / (FREE_RUN_PARTS - 1.0) + known.T @ known
    covariance = bread @ meat @ bread * np.outer(scales, scales)
    names = [u.name for u in wanted]
    # of what nothing depends on, such as a part of friction larger than the whole, neither its size nor none is known
    for i in np.flatnonzero(~found.slopes.any(axis=0)):
        off = abs(found.values[names[i]] - model.nominal(names[i]))
        covariance[i, i] = max(off, scales[i]) ** 2
    deviations = dict(zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), strict=True))
    return replace(found, covariance=covariance, deviations=deviations)


@dataclass
class Drifting(Task):
    """A task in windows, with how the error of its first signal moves from one window to the next as further values.

    Noise as slow as a window hides what a whole stroke is off by: in a window of its own offset that is noise. From
    window to window it is a random walk, the steps of which are as good as independent.

    Attributes:
        step: size of a step of that walk, SI.
    """

    step: float = 1.0

    @property
    def steps_in(self) -> NDArray[np.int64]:
        """(steps,) number of the window in which each step of the walk begins."""
        signal, rule = next(iter(self.rules.items()))
        log = rule.log_of(self.measured[signal].size)
        return np.flatnonzero(np.diff(log) == 0)

    def walked(self, residuals: Mapping[str, Array]) -> Array:
        """(steps,) how far the mean error moves from each window to the next, SI; not from one log to another."""
        signal, rule = next(iter(self.rules.items()))
        return np.asarray(np.diff(rule.windows(residuals[signal]).mean(axis=1))[self.steps_in])

    def white_rows(self, residuals: Sequence[Mapping[str, Array]]) -> Array:
        """As those of a task, and then the steps of the walk."""
        walks = np.stack([self.walked(own) / self.step for own in residuals])
        return np.concatenate([super().white_rows(residuals), walks], axis=1)


def onward(finding: Finding, effects: tuple[Effect, ...], tolerance: float, near: Fit) -> Fit:
    """Trusted parameters and effects fitted to the windows of a log and to how the error moves from one to the next.

    The sum of all such steps, the error at the end of a free run over minutes, is decided by the last per mille of a gain
    and by what pushed the axis once: a fit to it bends all parameters to one log's course. The steps are many.

    Args:
        finding: what was named in one group.
        effects: the causes.
        tolerance: trust in the nominal parameters.
        near: a fit in windows of a set nearby.
    """
    known = finding.task
    found = tried(known, effects, tolerance, near).fit
    task = Drifting(**{f.name: getattr(known, f.name) for f in fields(Task)})
    if not task.steps_in.size:  # a window a log: nothing goes on from one to the next
        return found
    wanted, _ = unknowns(task.model, effects, tolerance)
    # where a reading in steps lies within its step nobody knows: two windows, each off by up to half of one
    coarse = task.steps.get(next(iter(task.rules)), 0.0) / np.sqrt(6.0)
    begin = found.values
    for _ in range(WALK_ROUNDS):
        task.step = max(rms(task.walked(found.residuals)), coarse, 1e-300)
        found = fit(task, placed(wanted, begin))
        beyond = passed_in_fit(task, effects, found)
        settled = rms(task.walked(found.residuals)) > WALK_SETTLED * task.step
        if (settled and not beyond) or current().over:
            break
        begin = found.values | beyond
    windows = np.concatenate([window_numbers(known), task.steps_in])
    count = int(windows.max(initial=0)) + 1
    return with_sandwich(found, wanted, task.model, windows * FREE_RUN_PARTS // count)


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
