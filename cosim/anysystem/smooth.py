"""What drives a model is the quantity itself, not its reading: the noise of a reading is taken out where that is safe."""

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from cosim.compare.metrics import white_noise

Array = NDArray[np.float64]
NEIGHBOURS = 8  # samples to each side
NEAR = 3.5  # deviations within which a neighbour is the same value
MATTERS = 5e-4  # of a signal's reach: less noise is left alone
SLOW = 25.0  # samples: a model's error is followed no faster


def still(series: Array) -> Array:
    """The series without its white noise: the mean of near neighbours of like value, so that jumps stay."""
    sigma = white_noise(series)
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
