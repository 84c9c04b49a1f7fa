"""Steps of a search: the longest in which the model and its candidates tell the same as in steps of the log's own.

A search simulates thousands of times, and most of its candidates are out by far more than the error of a longer step. What
it finds is fitted again in steps ten times as exact before anything is concluded from it.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.budget import current
from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.trials import Trial, tried, tried_all, unknowns
from cosim.diagnosis.record.grid import Grid
from cosim.diagnosis.thresholds import LONGEST_STEP_SHARE, STEP_ERROR, STEP_ERROR_AFTER, STEP_ERROR_OF_CHANGE
from fmus.contract import Effect

Array = NDArray[np.float64]


def paced(
    task: Task,
    exact: GroupModel,
    found: Fit,
    candidates: Iterable[Effect],
    tolerance: float,
    part: float = 1.0,
) -> None:
    """Give a task the longest steps that do for its fit and its candidates; those of `exact` where none are longer.

    Args:
        task: data, model and noise; its model is replaced.
        exact: the model in the log's own steps.
        found: what is known so far.
        candidates: effects to be tried, each judged at its largest start.
        tolerance: trust in the nominal parameters.
        part: of what a longer step may be off in a search.
    """
    points = [found.values]
    for effect in candidates:
        _, starts = unknowns(exact, (effect,), tolerance)
        points.append(found.values | {n: values[-1] for n, values in starts.items()})
    fine = [task.white(task.against(exact.simulate(point))) for point in points]
    same = part * STEP_ERROR * float(np.sqrt(fine[0].size))
    reach = [max(same, part * STEP_ERROR_OF_CHANGE * float(np.linalg.norm(row - fine[0]))) for row in fine]
    for grid in longer(exact, task.model):
        model = exact.in_steps(grid)
        if all(
            off(task, model, point, row) <= most for point, row, most in zip(points, fine, reach, strict=True)
        ):
            task.model = model
            return
    task.model = exact


def off(task: Task, model: GroupModel, values: Mapping[str, float], fine: Array) -> float:
    """Length of the whitened difference of a model's residual and `fine`."""
    return float(np.linalg.norm(task.white(task.against(model.simulate(dict(values)))) - fine))


def longer(exact: GroupModel, most: GroupModel) -> list[Grid]:
    """Grids of longer steps than the log's own, the longest first; none longer than those of `most` if it has such.

    Only of a log sampled more rarely than its model is simulated: a longer step must end at the samples. Of several logs
    each has steps of its own, and there are none.
    """
    if not isinstance(exact.grid, Grid):
        return []
    whole = round(exact.h / exact.step)
    limit = LONGEST_STEP_SHARE * exact.h if most.step == exact.step else most.step
    steps = [exact.h / parts for parts in range(1, whole)]
    fit = [s for s in steps if 1.5 * exact.step < s <= limit * (1.0 + 1e-9)]
    return [Grid(exact.grid.stamps, step, exact.grid.lines) for step in sorted(fit, reverse=True)]


def in_exact_steps(
    task: Task, exact: GroupModel, null: Trial, chosen: Trial, single: list[Trial], tolerance: float
) -> tuple[Trial, Trial, list[Trial]]:
    """The nominal model, the chosen set and the single effects fitted on in exact steps; best single first."""
    searched = task.model
    if searched is exact:
        return null, chosen, single
    paced(task, exact, chosen.fit, [e for t in single for e in t.effects], tolerance, STEP_ERROR_AFTER)
    if task.model.step == searched.step:
        return null, chosen, single
    same = not chosen.effects
    null = tried(task, (), tolerance, null.fit)
    chosen = null if same else tried(task, chosen.effects, tolerance, chosen.fit)
    if current().over:  # of single effects not fitted again the longer steps' fits stay
        return null, chosen, single
    return null, chosen, tried_all(task, [t.effects for t in single], tolerance, null.fit, single)
