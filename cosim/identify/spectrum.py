"""Residuals by frequency: there coloured noise is independent from bin to bin, and its size is a smooth curve.

A series of n samples becomes real numbers, one for the mean and two for each frequency, by short means and an orthonormal
transform cut off at a highest frequency: a linear map of data and model alike, so nothing is biased by the cut. The
noise's density is the curve S(f) that makes the residual's periodogram most likely (Whittle, 1953): log S is piecewise
straight over log f.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import prev_fast_len

Array = NDArray[np.float64]

OVERSAMPLING = 4.0  # means a period of the highest frequency
KNOTS_PER_DECADE = 2.0
BINS_PER_KNOT = 12  # fewer would let the curve follow single bins
FLOOR = 1e-12  # of the mean density: keeps a residual of a log without any noise from dividing by zero


@dataclass(frozen=True)
class Bins:
    """The frequencies of a series.

    Attributes:
        count: means m of the series that are transformed; each is over `group` samples, to no loss below `highest`.
        step: between means [s].
        last: highest bin used, at ``last / (count step)`` Hz.
        group: samples in a mean.
    """

    count: int
    step: float
    last: int
    group: int

    @classmethod
    def up_to(cls, count: int, step: float, highest: float) -> "Bins":
        """The bins of `count` samples every `step` s up to `highest` [Hz], or to half the rate."""
        group = max(1, int(1.0 / (OVERSAMPLING * highest * step)))
        means = prev_fast_len(count // group, real=True) if count >= group else 0
        rate = group * step
        return cls(means, rate, max(min(int(highest * means * rate), (means - 1) // 2), 0), group)

    @property
    def frequencies(self) -> Array:
        """Frequency [Hz] of each bin but the mean, (last,)."""
        return np.arange(1, self.last + 1) / (self.count * self.step)

    @property
    def size(self) -> int:
        """Real numbers into which a series turns."""
        return 2 * self.last + 1

    def __call__(self, series: Array) -> Array:
        """Series (..., n) as real numbers (..., size): white noise of variance v gives each the variance v / group."""
        data = series[..., : self.count * self.group]
        if self.group > 1:
            data = data.reshape(*data.shape[:-1], self.count, self.group).mean(axis=-1)
        full = np.fft.rfft(data, axis=-1)[..., : self.last + 1]
        scale = np.sqrt(2.0 / self.count)
        mean = full[..., :1].real / np.sqrt(self.count)
        return np.concatenate([mean, scale * full[..., 1:].real, scale * full[..., 1:].imag], axis=-1)

    def spread(self, density: Array) -> Array:
        """A density for each bin but the mean (last,) put to each real number (size,); the mean has the lowest bin's."""
        return np.concatenate([density[:1], density, density])

    def power(self, numbers: Array) -> Array:
        """Mean square of the two numbers of each bin but the mean: (size,) -> (last,)."""
        pair = numbers[1:] ** 2
        return 0.5 * (pair[: self.last] + pair[self.last :])


@dataclass(frozen=True)
class Density:
    """Power density of a noise.

    Attributes:
        values: at each bin but the mean, (last,), in squared units of the series.
        basis: (last, m): how the logarithm follows each of the m knots.
    """

    values: Array
    basis: Array

    def relative_error(self, shares: Array) -> float:
        """Variance of ``sum(shares * error of log S)``, shares (last,), by the knots' Fisher information."""
        slope = self.basis.T @ shares
        # two squared normals a bin: the information on log S is one
        return float(slope @ np.linalg.solve(self.basis.T @ self.basis, slope))


def knots(bins: Bins) -> Array:
    """Basis (last, m) of functions that are piecewise straight over the logarithm of the frequency."""
    x = np.log10(bins.frequencies)
    wanted = max(2, round(KNOTS_PER_DECADE * (x[-1] - x[0])) + 1)
    places = np.linspace(x[0], x[-1], min(wanted, max(2, bins.last // BINS_PER_KNOT)))
    # the lowest decade holds few bins: knots with too few of them on either side are dropped
    keep, seen = [places[0]], 0
    for place in places[1:-1]:
        below = int(np.searchsorted(x, place))
        if below - seen >= BINS_PER_KNOT and bins.last - below >= BINS_PER_KNOT:
            keep.append(place)
            seen = below
    spots = np.array([*keep, places[-1]])
    return np.column_stack([np.interp(x, spots, row) for row in np.eye(spots.size)])


def density(bins: Bins, numbers: Array, absorbed: Array | None = None) -> Density:
    """The smooth density of a residual.

    Args:
        bins: its frequencies.
        numbers: the residual as real numbers (size,).
        absorbed: share of each number's variance that the fit took up (size,): the leverage; 0 without it.
    """
    basis = knots(bins)
    left = np.ones(bins.last)
    if absorbed is not None:
        pair = 1.0 - absorbed[1:]
        left = np.clip(0.5 * (pair[: bins.last] + pair[bins.last :]), 0.05, 1.0)
    power = bins.power(numbers) / left
    floor = FLOOR * float(np.mean(power)) or np.finfo(float).tiny
    power = np.maximum(power, floor)
    beta = np.linalg.lstsq(basis, np.log(power) + 0.27, rcond=None)[
        0
    ]  # mean of -log(chi2_2 / 2) is 0.577, of both halves less
    for _ in range(50):  # Fisher scoring of the Whittle likelihood, whose optimum is unique
        excess = power / np.exp(basis @ beta) - 1.0
        move = np.linalg.solve(basis.T @ (basis * left[:, None]), basis.T @ (left * excess))
        size = float(np.abs(move).max())
        beta = beta + move * min(1.0, 1.0 / max(size, 1e-300))
        if size < 1e-8:
            break
    return Density(np.exp(basis @ beta), basis)


def effective_samples(residual: Array) -> float:
    """How many independent values a series (n,) is worth for its mean: n over the sum of its autocorrelations.

    The sum ends where pairs of neighbouring correlations turn negative (Geyer's initial positive sequence, 1992).
    """
    n = residual.size
    centred = residual - residual.mean()
    spectrum = np.fft.rfft(centred, 2 * n)
    correlation = np.fft.irfft(spectrum * spectrum.conj())[:n]
    if correlation[0] <= 0.0:
        return float(n)
    correlation = correlation / correlation[0]
    pairs = correlation[: n // 2 * 2].reshape(-1, 2).sum(axis=1)
    stop = np.flatnonzero(pairs <= 0.0)
    total = 2.0 * float(pairs[: stop[0] if stop.size else None].sum()) - 1.0
    return n / max(total, 1.0)
