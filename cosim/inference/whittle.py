"""Sizes of kinds of noise by Whittle's likelihood of a spectrum."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]

FISHER_STEPS = 60  # at most; some five are needed
HALVED = 12  # times at most that a step is halved
LAST_GAIN = 1e-11  # of the likelihood of a frequency: a step that gains less is the last
PIVOTS = 1000  # of a step's least squares


def likeliest(shapes: Array, power: Array, least: Array, known: Array | float = 0.0) -> Array:
    """(kinds,) sizes of largest Whittle likelihood, each at least its `least`.

    By Fisher scoring: for a sum of spectra each step is a least-squares problem in the sizes, weighted by the spectrum so
    far, which non-negative least squares solve exactly. A search in logarithms ends where it is flat, beside the best
    sizes, and where that is rounding decides.

    Args:
        shapes: (kinds, frequencies) spectrum of each kind of size 1.
        power: (frequencies,) the periodogram.
        least: (kinds,) smallest sizes, positive.
        known: (frequencies,) spectrum of what is known beforehand.
    """

    def cost(sizes: Array) -> float:
        model = known + sizes @ shapes
        return float(np.sum(np.log(model) + power / model))

    sizes = np.maximum(least, np.mean(power / np.mean(shapes, axis=0)) / len(shapes))
    here = cost(sizes)
    for _ in range(FISHER_STEPS):
        over = 1.0 / (known + sizes @ shapes)
        columns, wanted = (shapes * over).T, (power - known - least @ shapes) * over
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        step = least + nnls(columns / scale, wanted, maxiter=PIVOTS)[0] / scale - sizes
        share, gain = 1.0, -np.inf
        for _ in range(HALVED):
            gain = here - cost(sizes + share * step)
            if gain > 0.0:
                break
            share /= 2.0
        if gain <= 0.0:
            break
        sizes, here = sizes + share * step, here - gain
        if gain < LAST_GAIN * power.size:
            break
    return np.asarray(sizes)
