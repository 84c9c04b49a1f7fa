"""Residuals turned into numbers that are independent and of unit size, by one rule for all candidates.

A residual is averaged over bins (the drive has no news above some 10 Hz) and cut into windows. Its noise is white noise
plus exponentially correlated noise of several correlation times, the longest standing for the random walk that
integrated pressure noise makes of an angle; sizes are fitted to the spectrum (Whittle's likelihood). Sums of such spectra
fall smoothly, so a resonance or a line that the model misses is never taken for noise. Where the group integrates, each
window has a free offset.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, toeplitz
from scipy.linalg.lapack import dtrtri
from scipy.signal.windows import hann

from cosim.diagnosis.thresholds import FEWEST_FREQUENCIES, REMAINING, SLOW_NOISE, UNEQUAL_LOGS
from cosim.inference.pieces import Cuts
from cosim.inference.whittle import likeliest

Array = NDArray[np.float64]

CORRELATION_TIMES = (1.0, 2.5, 6.0, 15.0, 40.0, 120.0, 400.0, 2000.0)  # in bins
QUICK_KINDS = 1 + sum(
    tau < SLOW_NOISE for tau in CORRELATION_TIMES
)  # kinds of noise that are not, the white one first
SIZE_ROUNDS = (
    3  # rounds of spectrum and sizes in turn at most, until the sizes change by less than SIZES_SETTLED
)
SIZES_SETTLED = 0.03
NO_NOISE = 1e-12  # SI: smaller noise than any signal's last digit, where nothing at all is left
SMALLEST_SHARE = 1e-7  # smallest share of each kind of noise: keeps the covariance well conditioned


@dataclass(frozen=True)
class Windows:
    """Whole windows of a log, or of several one behind the other: none reaches from one log into the next.

    Attributes:
        size: samples in a window.
        skip: samples at the start of each log that lie in none.
        cuts: first sample of each log but the first.
    """

    size: int
    skip: int = 0
    cuts: Cuts = ()

    def spans(self, count: int) -> list[slice]:
        """Of `count` samples, those in windows, log by log."""
        firsts = [a + self.skip for a in (0, *self.cuts)]
        lengths = [max(b - a, 0) // self.size for a, b in zip(firsts, (*self.cuts, count), strict=True)]
        return [slice(a, a + n * self.size) for a, n in zip(firsts, lengths, strict=True)]

    def inside(self, count: int) -> NDArray[np.int64]:
        """Of `count` samples, the numbers of those in windows."""
        return np.concatenate([np.arange(own.start, own.stop) for own in self.spans(count)])

    def rows(self, values: Array) -> Array:
        """(n,) values to (windows, samples a window)."""
        parts = [values[own] for own in self.spans(values.size)]
        return (parts[0] if len(parts) == 1 else np.concatenate(parts)).reshape(-1, self.size)

    def numbers(self, count: int) -> NDArray[np.int64]:
        """(count,) window of each sample, -1 for none."""
        found, inside = np.full(count, -1), self.inside(count)
        found[inside] = np.arange(inside.size) // self.size
        return found

    def log_of(self, count: int) -> NDArray[np.int64]:
        """(windows,) number of the log in which each window of `count` samples lies."""
        spans = self.spans(count)
        return np.concatenate([np.full((s.stop - s.start) // self.size, i) for i, s in enumerate(spans)])


@dataclass(frozen=True)
class Whitener:
    """The rule for one signal.

    Attributes:
        bins: samples averaged into one.
        window: bins in a window.
        demean: each window has a free offset.
        sizes: variance of the white and of each correlated noise, in squares of the signal's unit.
        skip: samples at the start that do not count: the state in which the log begins is not known.
        propagated: (window, window) covariance of what the noise of a measured drive leaves in the bins of a window, in
            squares of the signal's unit; None for nothing.
        cuts: first sample of each log but the first, where several are behind one another: no window reaches across, and
            `skip` samples at the start of each do not count.
        scales: size of the noise in each log over that of all, on average one; empty where all are the same.
    """

    bins: int
    window: int
    demean: bool
    sizes: tuple[float, ...]
    skip: int = 0
    propagated: Array | None = field(default=None, repr=False, compare=False)
    cuts: Cuts = ()
    scales: tuple[float, ...] = ()

    @cached_property
    def matrix(self) -> Array:
        """(window, window) what whitens the bins of a window, a row."""
        if self.propagated is None:
            return whitening(self.window, self.sizes)
        return inverted(covariance_of(self.window, self.sizes) + self.propagated)

    @cached_property
    def whole(self) -> Array:
        """The same with the window's offset taken out, where it is free."""
        if not self.demean:
            return self.matrix
        ones = self.matrix.sum(axis=0)
        offset = ones / np.linalg.norm(ones)
        return np.asarray(self.matrix - np.outer(self.matrix @ offset, offset))

    @property
    def sigma(self) -> float:
        """Size of what cannot be predicted from the past, in the signal's unit."""
        return float(1.0 / self.matrix[-1, -1])

    @property
    def rms(self) -> float:
        """Size of the noise of one bin, the slowest kinds (which an offset takes up) left out."""
        return float(np.sqrt(sum(self.sizes[:QUICK_KINDS])))

    def larger(self, by: float) -> "Whitener":
        """The rule for noise of `by` times the variance."""
        return replace(self, sizes=tuple(by * size for size in self.sizes))

    @property
    def layout(self) -> Windows:
        """Where the windows lie among the samples."""
        return Windows(self.bins * self.window, self.skip, self.cuts)

    def windows(self, residual: Array) -> Array:
        """(n,) residual to (windows, bins a window)."""
        # a product: numpy's mean over a short axis takes ten times as long
        means = self.layout.rows(residual).reshape(-1, self.bins) @ np.full(self.bins, 1.0 / self.bins)
        return np.asarray(means.reshape(-1, self.window))

    def log_of(self, count: int) -> NDArray[np.int64]:
        """(windows,) number of the log in which each window of `count` samples lies."""
        return self.layout.log_of(count)

    def sizes_of(self, count: int) -> Array:
        """(windows, 1) size of the noise in each window of `count` samples, over that of all."""
        return np.asarray(self.scales)[self.log_of(count), None]

    def of_any_log(self) -> "Whitener":
        """The rule for a log with the noise that these have on average."""
        return replace(self, cuts=(), scales=())

    def each(self, residuals: Sequence[Array]) -> Array:
        """Residuals (n,) to (residuals, windows, independent values of unit size): one product for all."""
        rows = np.stack([self.windows(residual) for residual in residuals])
        white = (rows.reshape(-1, self.window) @ self.whole).reshape(rows.shape)
        return np.asarray(white / self.sizes_of(residuals[0].size) if self.scales else white)

    def __call__(self, residual: Array) -> Array:
        """(n,) residual to (windows, independent values of unit size)."""
        return np.asarray(self.each([residual])[0])


def covariance_of(window: int, sizes: tuple[float, ...]) -> Array:
    """(window, window) covariance of the bins of a window: noise of these variances."""
    return np.asarray(np.tensordot(np.array(sizes), kinds(window), axes=1))


def inverted(covariance: Array) -> Array:
    """(n, n) upper triangular, what makes rows of noise of this covariance (n, n) white."""
    inverse, _ = dtrtri(cholesky(covariance, lower=True), lower=1)
    return np.ascontiguousarray(inverse.T)


# rules differ in much else: how large the noise is in each log, or where a log ends
@lru_cache(maxsize=8)
def whitening(window: int, sizes: tuple[float, ...]) -> Array:
    """(window, window) what makes the bins of a window white where the noise has these variances."""
    return inverted(covariance_of(window, sizes))


@cache
def kinds(window: int) -> Array:
    """(kinds, window, window) covariance of unit noise: white, then each correlation time."""
    return np.stack([np.eye(window)] + [toeplitz(averaged(tau, window)) for tau in CORRELATION_TIMES])


def averaged(tau: float, count: int) -> Array:
    """(count,) correlation of bin means of exponentially correlated noise, `tau` in bins: smoother than its samples'."""
    step = np.exp(-1.0 / tau)
    others = (tau * (1.0 - step)) ** 2 * step ** np.arange(count - 1)
    return np.concatenate([[1.0], others / of_means(tau)])


def of_means(tau: float) -> float:
    """Variance of bin means of exponentially correlated noise over that of its samples, `tau` in bins."""
    return float(2.0 * tau**2 * (1.0 / tau - 1.0 + np.exp(-1.0 / tau)))


@cache
def expected(window: int, demean: bool) -> Array:
    """(kinds, frequencies) mean tapered periodogram of each kind, leakage included."""
    return np.stack([periodogram(kind, demean) for kind in kinds(window)])


def periodogram(covariance: Array, demean: bool) -> Array:
    """(frequencies,) mean tapered periodogram of noise of this covariance (window, window), leakage included."""
    window = len(covariance)
    taper = np.diag(hann(window, sym=False))
    if demean:
        taper = taper @ (np.eye(window) - 1.0 / window)
    spectrum = np.fft.rfft(taper, axis=0)[1:]
    return np.asarray(((spectrum @ covariance) * spectrum.conj()).sum(axis=1).real)


def plain(bins: int, window: int, demean: bool, skip: int = 0, cuts: Cuts = ()) -> Whitener:
    """The rule before anything is known of the noise: white, of unit size."""
    return Whitener(bins, window, demean, (1.0,) + (0.0,) * len(CORRELATION_TIMES), skip, cuts=cuts)


def broad(rule: Whitener, residual: Array) -> Whitener:
    """The rule for white noise as large as all of a residual (n,), each bin as so many values as its correlation leaves.

    The variance is that of the residual times twice its correlation time in bins, so that a sum over bins has the weight of
    that many independent values.
    """
    rows = centred(rule, residual)
    power = np.abs(np.fft.rfft(rows, 2 * rule.window, axis=1)) ** 2
    covariance = np.fft.irfft(power.mean(axis=0))[: rule.window] / np.arange(rule.window, 0, -1)
    share = covariance / max(float(covariance[0]), 1e-300)
    ends = np.flatnonzero(share < 1.0 / np.e)
    length = float(share[: ends[0] if ends.size else rule.window].sum())
    size = max(float(covariance[0]), NO_NOISE**2) * max(1.0, 2.0 * length)
    return replace(rule, sizes=(size,) + (0.0,) * len(CORRELATION_TIMES), propagated=None, scales=())


def learned(rule: Whitener, residual: Array, absorbed: Iterable[Array], least: float = 0.0) -> Whitener:
    """The rule with the noise of `residual` (n,), at least of size `least`: the variances of largest Whittle likelihood.

    What the rows (n,) of `absorbed` explain of the residual is taken out first, and the spectra expected of each kind
    of noise are those that remain behind the same projection: slow noise has few degrees of freedom, and free functions
    absorb many of them. What the drive's noise leaves is known beforehand and not sought. Several logs have one spectrum,
    each at a size of its own, sought in turns.
    """
    if not rule.cuts:
        return learned_at(rule, residual, absorbed, least)[0]
    columns = list(absorbed)
    rule = rule if rule.scales else roughly_sized(rule, residual)
    for _ in range(SIZE_ROUNDS):
        before = rule.scales
        rule, rows, freedom = learned_at(rule, residual, columns, least)
        rule = resized(rule, rows, freedom, rule.log_of(residual.size))
        if np.allclose(rule.scales, before, rtol=SIZES_SETTLED, atol=0.0):
            break
    return rule


def roughly_sized(rule: Whitener, residual: Array) -> Whitener:
    """The rule with the size of each log's noise from what changes between neighbouring bins: little of that is motion."""
    steps, log = np.diff(rule.windows(residual), 2, axis=1), rule.log_of(residual.size)
    sizes = np.array([np.sqrt(np.mean(steps[log == i] ** 2)) for i in range(len(rule.cuts) + 1)])
    sizes = np.maximum(sizes, max(float(sizes.max()), 1e-300) / UNEQUAL_LOGS)
    return replace(rule, scales=tuple((sizes / np.sqrt(np.mean(sizes**2))).tolist()))


def resized(rule: Whitener, rows: Array, freedom: Array, log: NDArray[np.int64]) -> Whitener:
    """The rule with the size of each log's noise from what is left of its residual.

    Args:
        rule: spectrum, and sizes so far.
        rows: (windows, bins) what is left, each log's over its size so far.
        freedom: (windows,) share of each window's freedom that is left.
        log: (windows,) log of each.
    """
    white = rows @ rule.whole
    count = rule.window - (1 if rule.demean else 0)
    squares = [
        float(np.sum(white[log == i] ** 2)) / max(count * float(freedom[log == i].sum()), 1.0)
        for i in range(len(rule.cuts) + 1)
    ]
    before = np.array(rule.scales or [1.0] * len(squares))
    sizes = before * np.sqrt(np.maximum(squares, UNEQUAL_LOGS**-2))
    share = np.bincount(log, minlength=sizes.size) / log.size
    mean = float(np.sqrt(share @ sizes**2))
    found = replace(rule, scales=tuple((sizes / mean).tolist()))
    return found.larger(mean**2)


def learned_at(
    rule: Whitener, residual: Array, absorbed: Iterable[Array], least: float
) -> tuple[Whitener, Array, Array]:
    """The rule with the noise of `residual`; what is left of it (windows, bins), and of each window's freedom (windows,)."""
    over = rule.sizes_of(residual.size) if rule.scales else 1.0
    rows: Array = centred(rule, residual) / over
    freedom = np.ones(rows.shape[0])
    shapes = expected(rule.window, rule.demean)
    there = np.zeros((1, shapes.shape[1]))
    if rule.propagated is not None:
        there = periodogram(rule.propagated, rule.demean)[None]
    kept = np.ones(shapes.shape[1], dtype=bool)
    each = [(centred(rule, column) / over).ravel() for column in absorbed]
    # of a command that is zero throughout nothing is left
    listed = [column for column in each if column.any()]
    if listed:
        columns = np.stack(listed, axis=1)
        left, values, _ = np.linalg.svd(
            columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), full_matrices=False
        )
        q = left[:, values > 1e-3 * values[0]]
        flat = rows.ravel()
        rows = (flat - q @ (q.T @ flat)).reshape(rows.shape)
        q = q.reshape(*rows.shape, -1)
        freedom = 1.0 - np.sum(q**2, axis=(1, 2)) / rule.window
        remaining = behind(q, rule.demean, kinds(rule.window), shapes)
        if rule.propagated is not None:
            there = behind(q, rule.demean, rule.propagated[None], there)
        # where the projection leaves little, little can be learned, and what is left there is far from independent
        kept = np.asarray((remaining > REMAINING * shapes).all(axis=0))
        if kept.sum() < FEWEST_FREQUENCIES:  # windows too short for anything better
            kept[:] = True
        shapes = remaining
    taper = hann(rule.window, sym=False)
    power = np.mean(np.abs(np.fft.rfft(rows * taper, axis=1)[:, 1:]) ** 2, axis=0)[kept]
    shapes, known = shapes[:, kept], there[0, kept]
    total = max(float(np.mean(rows**2)), 1e-300)
    least = max(least, NO_NOISE)
    if total < least**2:
        power = power + (least**2 - total) * shapes[0]
        total = least**2

    sizes = likeliest(shapes, power, np.full(len(shapes), SMALLEST_SHARE * total), known)
    return replace(rule, sizes=tuple(sizes.tolist())), rows, freedom


def centred(rule: Whitener, residual: Array) -> Array:
    """Windows of a residual, without their mean where each has a free offset."""
    rows = rule.windows(residual)
    return rows - (rows.mean(axis=1, keepdims=True) if rule.demean else 0.0)


def off_mean(covariance: Array) -> Array:
    """Covariance (window, window) of noise without its mean over the window."""
    rows = covariance - covariance.mean(axis=0)
    return np.asarray(rows - rows.mean(axis=1, keepdims=True))


def behind(q: Array, demean: bool, covariances: Iterable[Array], shapes: Iterable[Array]) -> Array:
    """(kinds, frequencies) mean tapered periodogram of each kind of noise behind the projection off `q`.

    Args:
        q: (windows, window, k), its columns orthonormal over all windows together.
        demean: each window has a free offset.
        covariances: (window, window) of each kind.
        shapes: (frequencies,) periodogram of each before the projection.
    """
    windows, window, count = q.shape
    taper = hann(window, sym=False)[None, :, None]
    seen = np.fft.rfft(q * taper, axis=1)[:, 1:]  # (windows, frequencies, k)
    flat = q.reshape(-1, count)
    parts = np.concatenate([seen.real, seen.imag]).transpose(1, 0, 2)  # (frequencies, 2 windows, k)
    pairs = parts.transpose(0, 2, 1) @ parts  # of two columns at a frequency, the same for every kind
    found = []
    for base, kind in zip(shapes, covariances, strict=True):
        moved = (off_mean(kind) if demean else kind) @ q  # (windows, window, k)
        cross = np.fft.rfft(moved * taper, axis=1)[:, 1:]
        inner = flat.T @ moved.reshape(-1, count)
        less = 2.0 * ((cross.real * seen.real).sum(axis=(0, 2)) + (cross.imag * seen.imag).sum(axis=(0, 2)))
        more = np.tensordot(pairs, inner, axes=2)
        found.append(np.maximum(base + (more - less) / windows, 1e-9 * base))
    return np.stack(found)
