"""Correlations of estimates from their covariance."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def correlations(names: Sequence[str], covariance: NDArray[np.float64]) -> dict[tuple[str, str], float]:
    """Correlation of each pair of estimates, (earlier, later); none where one has no spread or an unknown one.

    Args:
        names: of the estimates.
        covariance: (p, p) in their order, NaN where it is not known.
    """
    # a variance that rounding made negative is none
    sizes = np.sqrt(np.fmax(np.diag(covariance), 0.0))
    found = {}
    for i in range(len(names)):
        for k in range(i):
            size = sizes[i] * sizes[k]
            if np.isfinite(size) and size > 0.0 and np.isfinite(covariance[i, k]):
                found[names[k], names[i]] = float(np.clip(covariance[i, k] / size, -1.0, 1.0))
    return found
