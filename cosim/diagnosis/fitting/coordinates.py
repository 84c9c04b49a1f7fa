"""Coordinates of a search in which valleys are straight and physical ratios are bounds.

A torque that is a sine of the angle looks, over a small range of angles, like a constant and a slope: amplitude and phase
then lie in a long curved minimum in which a search creeps. In the sizes of sine and cosine the same valley is straight.
Where one size cannot be more than so many times another, what that other has beyond its least is the coordinate.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NO_AMPLITUDE = 1e-9  # typical sizes: an amplitude below it has no phase


class Coordinates:
    """Unknowns x as coordinates z of a search: in typical changes, but for sines and bounded ratios.

    Args:
        pairs: places of amplitude and phase of one sine among the unknowns.
        scales: (n,) size of a typical change of each unknown, SI.
        start: (n,) where the search begins, SI: amplitudes keep its sign, phases stay within half a turn of it.
        most: (n,) largest size of each unknown, SI; of an amplitude what is beyond counts as this much. None for any size.
        shares: (place of a size, place of another, most of the first in parts of the other); none is negative.
        ratios: places of positive unknowns of which hardly the order of magnitude is known: they go by their logarithm.
    """

    def __init__(
        self,
        pairs: Sequence[tuple[int, int]],
        scales: Array,
        start: Array,
        most: Array | None = None,
        shares: Sequence[tuple[int, int, float]] = (),
        ratios: Sequence[int] = (),
    ) -> None:
        self.pairs, self.shares, self.scales, self.ratios = tuple(pairs), tuple(shares), scales, list(ratios)
        self.most = np.full(scales.size, np.inf) if most is None else most
        self.start = start

    @property
    def transformed(self) -> bool:
        """True if they are more than the unknowns in typical changes."""
        return bool(self.pairs or self.shares or self.ratios)

    def sought(self, x: Array) -> Array:
        """(n,) coordinates of unknowns (n,), SI: a pair's both in typical changes of the amplitude."""
        z = x / self.scales
        for i, k in self.pairs:
            z[i], z[k] = z[i] * np.cos(x[k]), z[i] * np.sin(x[k])
        for i, k, ratio in self.shares:
            z[k] = max(x[k] - x[i] / ratio, 0.0) / self.scales[k]
        z[self.ratios] = 1.0 + np.log(z[self.ratios])
        return z

    def reported(self, z: Array) -> Array:
        """(n,) unknowns, SI, at coordinates (n,)."""
        x = z * self.scales
        x[self.ratios] = np.exp(z[self.ratios] - 1.0) * self.scales[self.ratios]
        for i, k in self.pairs:
            sign = -1.0 if self.start[i] < 0.0 else 1.0
            turned = np.arctan2(sign * z[k], sign * z[i]) - self.start[k]
            x[i] = sign * min(float(np.hypot(z[i], z[k])) * self.scales[i], self.most[i])
            x[k] = self.start[k] + np.arctan2(np.sin(turned), np.cos(turned))
        for i, k, ratio in self.shares:
            x[k] += x[i] / ratio
        return x

    def bounds(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds (n,) of the coordinates for bounds of the unknowns, SI; a sine has none."""
        low, high = low / self.scales, high / self.scales
        low[self.ratios], high[self.ratios] = 1.0 + np.log(low[self.ratios]), 1.0 + np.log(high[self.ratios])
        for pair in self.pairs:
            low[list(pair)], high[list(pair)] = -np.inf, np.inf
        return low, high

    def turn(self, z: Array) -> Array:
        """(n, n) change of the unknowns, in typical changes of each, with the coordinates."""
        found = np.eye(z.size)
        found[self.ratios, self.ratios] = np.exp(z[self.ratios] - 1.0)
        for i, k in self.pairs:
            amplitude = max(float(np.hypot(z[i], z[k])), NO_AMPLITUDE)
            sign = -1.0 if self.start[i] < 0.0 else 1.0
            cosine, sine = z[i] / amplitude, z[k] / amplitude
            found[i, [i, k]] = sign * cosine, sign * sine
            found[k, [i, k]] = np.array([-sine, cosine]) / (amplitude * self.scales[k])
        for i, k, ratio in self.shares:
            found[k, i] = self.scales[i] / (ratio * self.scales[k])
        return found
