"""Where a search begins that stops would mislead: what just meets a stop makes the error jagged over the parameters.

A spool that grazes a stop loses its speed there, and what follows goes with the root of how far beyond it would have gone.
The error then has many local minima, even over the trusted parameters of a model that lacks nothing.
"""

import numpy as np

from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.limits import measured_by
from cosim.diagnosis.fitting.trials import Trial, tried
from cosim.diagnosis.residuals.cross_validation import part
from cosim.diagnosis.thresholds import NEAR_STOP, WINDOWS_LEFT


def away_from_stops(task: Task, trial: Trial, tolerance: float) -> Trial:
    """The trial, or a better one of the same effects that began with the windows of the log in which no stop was met."""
    clear = np.ones(
        next(iter(task.rules.values())).windows(next(iter(task.measured.values()))).shape[0], bool
    )
    for effect in task.model.group.effects():
        for parameter, free in effect.free.items():
            stop = task.model.nominal(f"{effect.component}.{parameter}")
            if (signal := measured_by(task, effect, free)) and not free.rate:
                reached = task.rules[signal].windows(task.measured[signal]) / stop
                clear &= np.max(reached, axis=1) < NEAR_STOP
    if clear.all() or np.mean(clear) < WINDOWS_LEFT:
        return trial
    begun = tried(part(task, clear), trial.effects, tolerance, trial.fit)
    other = tried(task, trial.effects, tolerance, begun.fit)
    return other if other.score > trial.score else trial
