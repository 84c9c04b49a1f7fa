"""Which directions of several unknowns data show, and how well, beside what else is estimated and may make up for them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.inference.thresholds import ROUNDING

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sight:
    """What the data alone, without priors, show of some unknowns.

    Attributes:
        directions: (k, p) orthonormal directions, best seen first.
        deviations: (k,) standard deviation of a step along each; infinite where nothing moves.
    """

    directions: Array
    deviations: Array

    @property
    def own(self) -> Array:
        """(p,) standard deviation of each unknown, all others unknown too; infinite where nothing tells."""
        parts = np.abs(self.directions) > 1e-4
        seen = np.isfinite(self.deviations)
        total = np.sum((self.directions[seen] * self.deviations[seen, None]) ** 2, axis=0)
        return np.where(parts[~seen].any(axis=0), np.inf, np.sqrt(total))


def sight(jacobian: Array, others: Array) -> Sight:
    """What is seen of unknowns.

    Args:
        jacobian: (rows, p) their whitened slopes, without priors.
        others: (rows, q) those of what is estimated beside them and may make up for their changes.
    """
    p = jacobian.shape[1]
    q = others.shape[1]
    upper = np.asarray(np.linalg.qr(np.hstack([others, jacobian]), mode="r"))[q:, q:]
    _, values, directions = np.linalg.svd(upper)
    sizes = np.zeros(p)
    sizes[: values.size] = values
    largest = max(float(np.linalg.norm(jacobian, axis=0).max(initial=0.0)), 1e-300)
    deviations = np.where(sizes > ROUNDING * largest, 1.0 / np.maximum(sizes, 1e-300), np.inf)
    return Sight(directions, deviations)
