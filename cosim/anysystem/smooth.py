"""What drives a model is the quantity itself, not its reading: the noise of a reading is taken out where that is safe."""

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Array = NDArray[np.float64]
NEIGHBOURS = 8  # samples to each side
NEAR = 3.5  # deviations within which a neighbour is the same value
MATTERS = 5e-4  # of a signal's reach: less noise is left alone
SLOW = 25.0  # samples: a model's error is followed no faster


def white(series: Array) -> float:
    """Standard deviation of what is independent from sample to sample in a series (n,); 0 where most samples repeat.

    Fourth differences leave nothing of a smooth motion and 70 times the variance of noise; the median leaves jumps out.
    """
    if series.size < 20:
        return 0.0
    return float(np.median(np.abs(np.diff(series, 4)))) / (0.6745 * np.sqrt(70.0))


def still(series: Array) -> Array:
    """The series without its white noise: the mean of near neighbours of like value, so that jumps stay."""
    sigma = white(series)
    if sigma <= MATTERS * float(np.ptp(series)):
        return series
    return _bilateral(np.ascontiguousarray(series), NEAR * sigma, NEIGHBOURS)


@numba.njit(cache=True)
def _bilateral(x: Array, near: float, reach: int) -> Array:
    y = np.empty_like(x)
    for k in range(x.size):
        # as far to both sides: a slope then stays where it is
        total, count = x[k], 1.0
        for j in range(1, reach + 1):
            if k - j < 0 or k + j >= x.size:
                break
            if abs(x[k - j] - x[k]) > near or abs(x[k + j] - x[k]) > near:
                break
            total += x[k - j] + x[k + j]
            count += 2.0
        y[k] = total / count
    return y


def followed(model: Array, left: Array) -> Array:
    """The model's series brought slowly to the reading, of which it leaves a rest: without noise and drift."""
    return np.asarray(model + gaussian_filter1d(left, SLOW, mode="nearest"))
