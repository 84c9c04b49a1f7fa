"""What a hypothesis gains on data that had no share in estimating it, from one fit: each block left out in turn.

A least-squares fit with slopes J and residuals r tells, without fitting again, what its residuals in a block b would be
had that block been left out: one Gauss-Newton step on the other blocks moves the estimate by (J'J - Jb'Jb)^-1 Jb'rb
(exact for a linear model; Cook and Weisberg 1982, section 3.5; for nonlinear ones the infinitesimal jackknife).
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from cosim.inference.thresholds import ANCHOR, ASKED_FOR, MANY_BLOCKS, MOST_BLOCKS, OUTSIDE, STANDS

Array = NDArray[np.float64]

TINY = 1e-9  # of a regressor's square: keeps what is nearly collinear solvable
RESAMPLED = 2000  # times the windows, for the interval of a ratio of errors
SPANS = 32  # of a part, over each of which the means of two errors are compared


@dataclass(frozen=True)
class HeldOutGain:
    """Log-likelihood gained on blocks that had no share in the estimate.

    Attributes:
        gain: summed over all blocks.
        deviation: its standard deviation, the excitation taken as given and each block as one repetition; not a number
            where nobody knows it.
        repetitions: blocks of which the deviation was learned; infinite where there are many.
        ends: of the 95 % interval, where that does not follow from the deviation.
        asked_ends: of the interval for what the fitted data ask for (`borne_out`), likewise.
    """

    gain: float
    deviation: float = float("nan")
    repetitions: float = float("inf")
    ends: tuple[float, float] | None = None
    asked_ends: tuple[float, float] | None = None

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval; of few repetitions Student's."""
        if self.ends is not None:
            return self.ends
        return self._interval(OUTSIDE)

    @property
    def asked(self) -> tuple[float, float]:
        """Interval that excludes no gain where one that the fitted data ask for is as sure as `sure` says of any."""
        return self.asked_ends if self.asked_ends is not None else self._interval(outside_asked())

    @property
    def decided(self) -> tuple[float, float]:
        """The interval that decides whether a cause is named: `asked` where other data judge what a log has asked for."""
        return self.ci95 if self.asked_ends is None else self.asked

    def _interval(self, outside: float) -> tuple[float, float]:
        reach = self.deviation * quantile(self.repetitions, outside)
        return self.gain - reach, self.gain + reach

    @property
    def sure(self) -> bool:
        """True if the interval excludes no gain."""
        return self.ci95[0] > 0.0

    @property
    def borne_out(self) -> bool:
        """True if no gain is excluded of what the fitted data ask for.

        Before held-out data are looked at such a cause is likelier than not to help on them (`ASKED_FOR`); by Bayes' rule
        less is needed for the same certainty than of one that nothing speaks for.
        """
        return self.asked[0] > 0.0


def outside_asked() -> float:
    """Share outside the interval for what the fitted data ask for.

    The odds (1 - q) / q of its tail q, times those of such a cause, are those of the tail of a 95 % interval.
    """
    return 2.0 / (1.0 + (2.0 / OUTSIDE - 1.0) * (1.0 - ASKED_FOR) / ASKED_FOR)


def quantile(repetitions: float, outside: float = OUTSIDE) -> float:
    """Deviations of an interval on either side that leaves this share outside; of few repetitions Student's."""
    return float(student.ppf(1.0 - outside / 2.0, repetitions))


def steps_without(rows: Array, slopes: Array, block: NDArray[np.int64]) -> Array:
    """(blocks, k) how far the estimate moves when each block is left out, in the units of the slopes.

    Args:
        rows: (n,) whitened residuals of n values; those of p priors may follow, and move nothing.
        slopes: (n + p, k) their slopes in the k estimates.
        block: (n,) number of the block to which each value belongs, from 0.
    """
    gram = slopes.T @ slopes
    # a straight line does not reach far: what only this block shows stays within its uncertainty
    whole = (1.0 + ANCHOR**-2) * gram + TINY * np.diag(np.maximum(np.diag(gram), 1e-300))
    found = np.zeros((int(block.max(initial=-1)) + 1, slopes.shape[1]))
    for one in np.unique(block):
        mine = np.flatnonzero(block == one)
        own = slopes[mine]
        found[one] = np.linalg.solve(whole - own.T @ own, own.T @ rows[mine])
    return found


def left_out(rows: Array, slopes: Array, block: NDArray[np.int64]) -> Array:
    """(n,) residuals of each block with the estimate that all other blocks and the priors give; as `steps_without`."""
    n = block.size
    if slopes.shape[1] == 0:
        return rows[:n].copy()
    steps = steps_without(rows, slopes, block)
    return np.asarray(rows[:n] + np.einsum("ij,ij->i", slopes[:n], steps[block]))


def squares_by_block(errors: Array, block: NDArray[np.generic]) -> Array:
    """(blocks,) sums of the squares of errors (n,), by the number (n,) of the block to which each belongs."""
    return np.bincount(np.unique(block, return_inverse=True)[1], weights=errors**2).astype(np.float64)


def gain_between(richer: Array, poorer: Array, block: NDArray[np.int64]) -> HeldOutGain:
    """What one hypothesis gains over another on left-out blocks.

    With d the difference of the residuals and e those of the richer hypothesis, a block gains d'd/2 + d'e: the first
    part the excitation decides, only the second is chance. So an effect that shows in one block only is not held to be
    unsure for that, and one that leaves much in the blocks where it acts is (sandwich estimator; White 1982).

    Args:
        richer: (n,) residuals from `left_out` with the effect.
        poorer: (n,) the same without it.
        block: (n,) number of the block to which each value belongs.
    """
    change = poorer - richer
    sums = np.bincount(np.unique(block, return_inverse=True)[1], weights=change * richer)
    repetitions = float(sums.size) if sums.size < MANY_BLOCKS else float("inf")
    gain = 0.5 * float(poorer @ poorer - richer @ richer)
    return HeldOutGain(gain, float(np.sqrt(np.sum(sums**2))), repetitions)


def contrast(one: Array, other: Array) -> Array:
    """(parts,) half the logarithm of how much smaller the error of `one` is in each part of the data, from mean squares.

    By how many times it is smaller counts, and not by how much: once in a log somebody pushes the machine, and a mean of
    squares would hear nothing but that. Below what the better of the two leaves in half of the parts no difference counts
    (the likelihood of Student's t, whose scale that is).

    Args:
        one: (parts,) mean squares of an error.
        other: the same of another.
    """
    scale = max(min(float(np.median(one)), float(np.median(other))), 1e-300)
    return np.asarray(0.5 * (np.log(other + scale) - np.log(one + scale)))


@lru_cache(maxsize=MOST_BLOCKS)
def resampled(parts: int) -> NDArray[np.int64]:
    """(RESAMPLED, parts) which parts each resampling has; the same each time, so that an answer does not change."""
    rows = np.random.default_rng(1).integers(0, parts, (RESAMPLED, parts))
    rows.setflags(write=False)
    return rows


def smaller_by(one: Array, other: Array, outside: float = OUTSIDE) -> tuple[float, tuple[float, float]]:
    """Mean `contrast` of two errors, and its interval by resampling parts, those side by side kept together."""
    found = contrast(one, other)
    blocks = np.array_split(found, min(found.size, MOST_BLOCKS))
    sums, sizes = (np.array([f(b) for b in blocks], float) for f in (np.sum, np.size))
    rows = resampled(sums.size)
    means = sums[rows].sum(axis=1) / sizes[rows].sum(axis=1)
    low, high = np.quantile(means, [outside / 2.0, 1.0 - outside / 2.0])
    return float(found.mean()), (float(low), float(high))


def smaller_in_size(one: Array, other: Array, outside: float = OUTSIDE) -> tuple[float, tuple[float, float]]:
    """As `smaller_by`, by the logarithm of the ratio of the two RMSE: for the parts of one run whose place counts."""
    low, high = ratio_interval(one, other, outside)
    gain, least, most = (-float(np.log(max(r, 1e-300))) for r in (ratio_of_sizes(one, other), high, low))
    return gain, (least, most)


def as_excited(richer: Array, poorer: Array, apart: Array, outside: float = OUTSIDE) -> tuple[float, float]:
    """Interval of the logarithm of the ratio of two RMSE, the excitation taken as given.

    As in `gain_between` a part gains d'd/2 + d'e, and only the second is chance: an end of travel that a machine meets in
    one part of the data is there, though resampled parts often lack that one. Errors of one run are slow: within a part
    d'e is held to be as large as it can be, |d||e|, with a sign of its own in each part. Student's quantile is that of as
    many repetitions as there are parts that matter (Satterthwaite, Biometrics Bulletin 2, 1946): where one decides, what is
    left of the error there must be very small.

    Args:
        richer: (parts,) mean square of the error e with the effect.
        poorer: (parts,) the same without it.
        apart: (parts,) mean square of the difference d of the two errors, or of what is slow of it.
        outside: share that the interval leaves outside.
    """
    # they differ at least by the difference of their sizes
    spread = richer * np.maximum(apart, (np.sqrt(poorer) - np.sqrt(richer)) ** 2)
    repetitions = float(spread.sum() ** 2 / max(np.sum(spread**2), 1e-300))
    reach = float(np.sqrt(spread.sum())) * quantile(max(repetitions, 1.0), outside)
    gain, left = 0.5 * float(np.sum(poorer - richer)), max(float(np.sum(richer)), 1e-300)
    low, high = (0.5 * float(np.log(max(1.0 + 2.0 * g / left, 1e-300))) for g in (gain - reach, gain + reach))
    return low, high


def size_of_gain(richer: Array, poorer: Array, placed: bool = False) -> float:
    """What `gain_of_errors` tells, without its intervals: log-likelihood; the arguments are as there."""
    parts = min(richer.size, MOST_BLOCKS)
    if placed:
        return -parts * float(np.log(max(ratio_of_sizes(richer, poorer), 1e-300)))
    return parts * float(contrast(richer, poorer).mean())


def ratio_of_sizes(one: Array, other: Array) -> float:
    """Ratio of two RMSE, from mean squares (parts,)."""
    return float(np.sqrt(one.sum() / max(float(other.sum()), 1e-300)))


def gain_of_errors(
    richer: Array, poorer: Array, placed: bool = False, apart: Array | None = None
) -> HeldOutGain:
    """What one hypothesis gains over another on data that had no share in either estimate.

    Args:
        richer: (windows,) mean square of the error with the effect.
        poorer: (windows,) the same without it.
        placed: the parts are those of one run whose place counts: its error is compared by size.
        apart: (windows,) mean square of the difference of the two errors, where it is known. Then what all parts show a
            little, and what one shows by far, are both sure: of the two intervals that with the higher lower end holds.
    """
    parts = min(richer.size, MOST_BLOCKS)
    found = []
    for outside in (OUTSIDE, outside_asked()):
        gain, ends = (smaller_in_size if placed else smaller_by)(richer, poorer, outside)
        if placed and apart is not None:
            ends = max(ends, as_excited(richer, poorer, apart, outside))
        found.append((parts * ends[0], parts * ends[1]))
    return HeldOutGain(parts * gain, ends=found[0], asked_ends=found[1])


def course_of(error: Array, parts: int) -> Array:
    """(parts, SPANS) means of an error over short spans of equal parts of the data: what two errors are told apart by."""
    spans = (np.array_split(part, SPANS) for part in np.array_split(np.asarray(error, float), parts))
    return np.array([[span.mean() if span.size else 0.0 for span in part] for part in spans])


def mean_squares(error: Array, parts: int, anew: bool = False, cuts: tuple[int, ...] = ()) -> Array:
    """(parts,) mean square of the error of a free run in equal parts of the data.

    Args:
        error: (n,) measured less predicted.
        parts: how many.
        anew: the prediction begins anew in each part where the machine stands: the error there is taken off.
        cuts: first sample of each log but the first: it begins anew there, too.
    """
    starts = np.array([part[0] for part in np.array_split(np.arange(error.size), parts)])
    left = np.asarray(error, float).copy()
    if anew:
        edges = np.unique(
            np.concatenate([starts, [c for c in cuts if 0 < c < error.size], [error.size]])
        ).astype(int)
        for low, high in pairwise(edges):
            left[low:high] -= left[low : low + max(1, round(STANDS * (high - low)))].mean()
    return np.asarray(np.add.reduceat(left**2, starts) / np.diff(np.append(starts, error.size)))


def ratio_ci95(one: Array, other: Array) -> tuple[float, float]:
    """As `ratio_interval`, of 95 %."""
    return ratio_interval(one, other, OUTSIDE)


def ratio_interval(one: Array, other: Array, outside: float) -> tuple[float, float]:
    """Interval of the ratio of two RMSE, from paired mean squares (windows,), windows side by side kept together."""
    parts = min(one.size, MOST_BLOCKS)
    sums = [np.array([part.sum() for part in np.array_split(values, parts)]) for values in (one, other)]
    rows = resampled(parts)
    above, below = (total[rows].sum(axis=1) for total in sums)
    # of errors that are none a ratio is large, and a number all the same
    ratios = np.sqrt(above / np.maximum(below, np.maximum(1e-30 * above, 1e-300)))
    low, high = np.quantile(ratios, [outside / 2.0, 1.0 - outside / 2.0])
    return float(low), float(high)
