"""The error that the communication step causes, from three runs with halved steps.

With y(h) = y + C h^p + ... : 2^p = |y(h) - y(h/2)| / |y(h/2) - y(h/4)|, and the error of y(h) is
(y(h) - y(h/2)) 2^p / (2^p - 1) (Richardson's extrapolation; Hairer, Norsett, Wanner: Solving Ordinary Differential
Equations I, section II.4).
"""

import math

import numpy as np
from numpy.typing import NDArray

from cosim.results import ErrorEstimate

Array = NDArray[np.float64]
ROUNDING = 64 * np.finfo(np.float64).eps


def estimate(coarse: Array, middle: Array, fine: Array) -> ErrorEstimate:
    """Estimate the error of `coarse`.

    Args:
        coarse: the signal with step h, shape (n,).
        middle: with h/2, at the same times.
        fine: with h/4, at the same times.

    Returns:
        Error and observed order. Where the runs agree to rounding the difference itself is the error and the order is
        NaN; where halving the step does not help, the difference is taken as it is and the order is NaN.
    """
    first, second = coarse - middle, middle - fine
    rms = [float(np.sqrt(np.mean(d * d))) for d in (first, second)]
    floor = ROUNDING * float(np.max(np.abs(fine), initial=0.0))
    if rms[0] <= floor or rms[1] <= floor or rms[0] <= rms[1]:
        return ErrorEstimate(float(np.max(np.abs(first))), rms[0], math.nan)
    ratio = rms[0] / rms[1]
    scale = ratio / (ratio - 1.0)
    return ErrorEstimate(scale * float(np.max(np.abs(first))), scale * rms[0], math.log2(ratio))
