"""Noise as white noise plus exponentially correlated noise of several correlation times, and how to make it white.

The spectrum of such a sum falls smoothly, so a resonance or a line that the model misses is never taken for noise. Its
covariance is semiseparable: the Cholesky factor acts in one pass over the samples, however long the log and wherever
samples are missing (Foreman-Mackey, Agol, Ambikasaran, Angus: Fast and scalable Gaussian process modeling, AJ 154, 2017).
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numba
import numpy as np
from numpy.typing import NDArray

from cosim.inference.thresholds import COMPUTED, NEGLIGIBLE, OWN_NOISE, STILL

Array = NDArray[np.float64]
RATIO = 3.0  # between neighbouring correlation times
FACTORS_KEPT = 4  # sets of places whose factor is kept
LARGEST_KEPT = 1_000_000  # numbers in a factor that is kept: 8 MB
LEAST_WHITE = 1e-9  # share of the variance that is white at least: keeps the covariance well conditioned


@dataclass(frozen=True)
class Noise:
    """Stationary noise of one signal.

    Attributes:
        white: variance of its white part, squares of the signal's unit.
        times: (j,) correlation times of its other parts, in samples.
        sizes: (j,) their variances.
    """

    white: float
    times: tuple[float, ...] = ()
    sizes: tuple[float, ...] = ()

    @property
    def rms(self) -> float:
        """Standard deviation of a sample, in the signal's unit."""
        return float(np.sqrt(self.white + sum(self.sizes)))

    def effective(self, count: int) -> float:
        """Number of independent samples whose mean is as uncertain as that of `count` samples of this noise."""
        total = self.white * count
        for tau, size in zip(self.times, self.sizes, strict=True):
            phi = np.exp(-1.0 / tau)
            total += size * (
                count * (1.0 + phi) / (1.0 - phi) - 2.0 * phi * (1.0 - phi**count) / (1.0 - phi) ** 2
            )
        return float(count**2 * (self.white + sum(self.sizes)) / total)

    @cached_property
    def _correlated(self) -> tuple[Array, Array]:
        """Rates, 1/samples, and variances of the parts that are more than negligible at their own rate."""
        rates = 1.0 / np.array(self.times)
        parts = np.array(
            [size * density(tau, rates) for tau, size in zip(self.times, self.sizes, strict=True)]
        )
        parts = parts.reshape(rates.size, rates.size)
        kept = np.diag(parts) > NEGLIGIBLE * (self.white + parts.sum(axis=0))
        return rates[kept], np.array(self.sizes)[kept]

    def whiten(self, rows: Array, places: NDArray[np.int64] | None = None) -> Array:
        """Rows (m, n) in the signal's unit as rows whose noise is independent and of unit size.

        Args:
            rows: values at `places`.
            places: (n,) sample numbers, increasing; gaps are allowed. None where there are none.
        """
        places = every(rows.shape[1]) if places is None else places
        own = np.ascontiguousarray(rows, dtype=np.float64)
        return _whiten(own, *self._factor(places), *self._correlated)

    def log_determinant(self, places: NDArray[np.int64]) -> float:
        """Logarithm of the determinant of the covariance at `places` (n,): what a likelihood pays for larger noise."""
        _, _, roots = self._factor(places)
        return 2.0 * float(np.sum(np.log(roots)))

    def _factor(self, places: NDArray[np.int64]) -> tuple[Array, Array, Array]:
        """Gaps between `places` (n,), and the factor of the covariance there: weights (n, j) and roots (n,)."""
        known = self._factors.get(id(places))
        if known is not None and known[0] is places:
            return known[1]
        total = self.white + sum(self.sizes)
        gaps = np.diff(places, prepend=places[:1]).astype(np.float64)
        factor = gaps, *_factored(gaps, max(self.white, LEAST_WHITE * total), *self._correlated)
        if factor[1].size <= LARGEST_KEPT:
            if len(self._factors) >= FACTORS_KEPT:
                self._factors.clear()
            self._factors[id(places)] = places, factor
        return factor

    @cached_property
    def _factors(self) -> dict[int, tuple[NDArray[np.int64], tuple[Array, Array, Array]]]:
        """Factors of the covariance at the places seen last: a fit whitens at the same ones again and again."""
        return {}


@lru_cache(maxsize=32)
def every(count: int) -> NDArray[np.int64]:
    """(count,) numbers of samples without gaps, the same array each time."""
    return np.arange(count)


def quietest(signal: Array) -> float:
    """Smallest noise that a signal (n,) is taken to have, in its unit.

    A computed log has none, which its fourth differences show: they leave nothing of a smooth motion, and 70 times the
    variance of noise. Between two programs there is still what they integrate differently.
    """
    least = max(STILL * float(np.max(np.abs(signal), initial=0.0)), 1e-12)
    if signal.size <= 4:
        return least
    differ = COMPUTED * float(np.sqrt(np.mean(np.diff(signal) ** 2)))
    own = float(np.sqrt(np.mean(np.diff(signal, 4) ** 2) / 70.0))
    return max(differ, least) if own < OWN_NOISE * differ else least


def density(tau: float, w: Array) -> Array:
    """Spectrum of exponentially correlated noise of unit variance at w (rad a sample); that of white noise is 1."""
    phi = np.exp(-1.0 / tau)
    return np.asarray((1.0 - phi**2) / (1.0 - 2.0 * phi * np.cos(w) + phi**2))


def correlation_times(count: int) -> tuple[float, ...]:
    """Correlation times in samples for a log of `count` samples: from one sample to the log's length."""
    return tuple(RATIO ** np.arange(0.0, np.log(max(count, 3)) / np.log(RATIO)))


@numba.njit(cache=True)
def _factored(gaps: Array, white: float, rates: Array, sizes: Array) -> tuple[Array, Array]:
    """The factor L with L L' the covariance: weights (n, j) of its parts, and roots (n,) of its diagonal."""
    n, j = gaps.size, rates.size
    weights, roots = np.empty((n, j)), np.empty(n)
    s = np.zeros((j, j))
    w = np.zeros(j)
    phi = np.exp(-rates)
    own = np.ones(j)
    variance = white + sizes.sum()
    d = variance
    last_gap = 1.0
    for k in range(n):
        if k > 0:
            if gaps[k] != last_gap:
                phi = np.exp(-rates * gaps[k])
                last_gap = gaps[k]
            for a in range(j):
                for b in range(j):
                    s[a, b] = phi[a] * phi[b] * (s[a, b] + d * w[a] * w[b])
        d = variance
        for a in range(j):
            own[a] = 1.0
            for b in range(j):
                own[a] -= sizes[b] * s[b, a]
        for a in range(j):
            d -= sizes[a] * (1.0 - own[a])
        for a in range(j):
            w[a] = own[a] / d
        weights[k], roots[k] = w, np.sqrt(d)
    return weights, roots


@numba.njit(cache=True)
def _whiten(rows: Array, gaps: Array, weights: Array, roots: Array, rates: Array, sizes: Array) -> Array:
    """Solve L z = rows, one sample after the other."""
    m, n = rows.shape
    j = sizes.size
    result = np.empty_like(rows)
    f = np.zeros((m, j))
    phi = np.exp(-rates)
    last_gap = 1.0
    for k in range(n):
        if k > 0 and gaps[k] != last_gap:
            phi = np.exp(-rates * gaps[k])
            last_gap = gaps[k]
        for i in range(m):  # within, because no row waits for another: four times as fast
            if k > 0:
                z = result[i, k - 1] * roots[k - 1]
                for a in range(j):
                    f[i, a] = phi[a] * (f[i, a] + weights[k - 1, a] * z)
            z = rows[i, k]
            for a in range(j):
                z -= sizes[a] * f[i, a]
            result[i, k] = z / roots[k]
    return result
