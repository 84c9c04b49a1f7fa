"""How well a drive's curve predicts what it was not fitted to, beside the same drive without a dead zone.

Parts of the logs are left out in turn: tenths of one log, of several logs each one. What is compared is the way covered in
short stretches, as in the fit. A stretch at rest that is predicted to rest counts as one that is right.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.identify.drive_fit import Run, begin, fine, fitted, mean_speeds, ways

Array = NDArray[np.float64]

PARTS = 10  # of one log, left out in turn


@dataclass(frozen=True)
class Predicted:
    """Errors of the speed over the stretches that were left out.

    Attributes:
        error: root mean square, of the curve.
        without: the same without a dead zone, everything else fitted anew.
        spread: standard deviation of the measured speed over these stretches.
        parts: how many were left out in turn.
        logs: whether these parts are whole logs.
    """

    error: float
    without: float
    spread: float
    parts: int
    logs: bool

    @property
    def told(self) -> float:
        """Share of how the speed varies that the curve tells, in percent."""
        return 100.0 * (1.0 - self.error / self.spread) if self.spread > 0.0 else 0.0


def predicted(runs: Sequence[Run], lag: float) -> Predicted:
    """Each part of the logs predicted by the drive that the others show.

    Args:
        runs: of one machine.
        lag: of its speed, s: stretches are longer than it.

    Raises:
        DataError: the logs are too short.
    """
    logs = fine(runs, lag)
    goal = mean_speeds(logs)
    count = [log.begins.size for log in logs]
    one = len(logs) == 1
    part = np.arange(count[0]) * PARTS // count[0] if one else np.repeat(np.arange(len(logs)), count)
    every = np.ones(goal.size, dtype=bool)
    start = begin(logs, goal)
    left = []
    for still in (True, False):
        x, typical, _ = fitted(logs, goal, start, every, still=still)
        off = np.empty_like(goal)
        for k in range(int(part[-1]) + 1):
            own, _, _ = fitted(logs, goal, x, part != k, typical, still=still)
            off[part == k] = (goal - ways(logs, own))[part == k]
        left.append(float(np.sqrt(np.mean(off**2))))
    return Predicted(left[0], left[1], float(np.std(goal)), int(part[-1]) + 1, not one)
