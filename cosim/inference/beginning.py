"""How a record begins: whether a signal stands or moves at its first sample, and how fast."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPAN = 0.1  # s from the first sample in which a motion is a parabola
LEAST = 10  # samples
SIGNIFICANT = 5.0  # standard errors beyond which a value or a speed is not noise
PART = 0.3  # of the mean speed: less at the first sample is a motion that only begins


def level(values: Array) -> float:
    """First value (n,), or 0 where it is no more than the signal's noise.

    The noise is that of the first differences, so a signal that moves slowly against its samples counts as still.
    """
    first = values[: 5 * LEAST]
    if first.size < LEAST:
        return 0.0
    noise = float(np.median(np.abs(np.diff(first)))) / (0.6745 * np.sqrt(2.0))
    return float(first[0]) if abs(first[0]) > SIGNIFICANT * noise else 0.0


def speed(time: Array, values: Array) -> float:
    """Speed at the first sample, per s, of values (n,) at increasing times (n,) [s]; 0 where the signal stands there.

    A motion that only begins has its parabola's slope at the first sample small, or against the motion.
    """
    count = max(LEAST, int(np.searchsorted(time, time[0] + SPAN)))
    if values.size < count or not np.isfinite(values[:count]).all():
        return 0.0
    t = (time[:count] - time[0]) / (time[count - 1] - time[0])
    matrix = np.vander(t, 3, increasing=True)
    found = np.linalg.lstsq(matrix, values[:count], rcond=None)[0]
    rest = values[:count] - matrix @ found
    error = float(np.sqrt(rest @ rest / (count - 3) * np.linalg.inv(matrix.T @ matrix)[1, 1]))
    mean = float(np.polyfit(t, values[:count], 1)[0])
    first = float(found[1])
    if abs(first) <= SIGNIFICANT * error or first * mean <= 0.0 or abs(first) < PART * abs(mean):
        return 0.0
    return first / float(time[count - 1] - time[0])
