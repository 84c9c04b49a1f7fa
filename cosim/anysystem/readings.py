"""What a reading shows by itself, without a model: a grid on which all its values lie, samples that repeat the last one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import white_noise
from cosim.diagnosis.record.signatures import resting, rounded
from cosim.diagnosis.thresholds import RESTING_RUN

Array = NDArray[np.float64]
Index = NDArray[np.int64]
COARSE = 4e-3  # of the range: a finer grid is the file's decimals
ON = 0.02  # of the step: so near to the grid a value lies on it
FEW = 0.2  # distinct values per sample at most
STALE = 0.01  # share of repeated samples from which they are no accident
MISSED = 0.5  # of a reading's usual change: less than that at the end of repeated samples is nothing missed
SHAKES = 3.0  # times the usual change at most by which a reading goes on that has missed nothing
NEAR_BY = 100  # samples of about one size, in which a file's digits show
WHOLE = 0.05  # of the last digit: changes are so near to whole ones where readings are written with that many digits,
ON_DIGITS = 0.95  # of them
DIGITS = 3  # last digits: noise that spans many changes by one, two or three of them each about as often as by none
CHANCE = 4.0  # standard deviations of a count by which repeated samples must be more than chance makes them
NOISY = 3e-4  # of the spread: with this much noise no two samples are alike


@dataclass(frozen=True)
class Grid:
    """All values are multiples of a step."""

    step: float
    samples: int

    @property
    def gain(self) -> float:
        """Log-likelihood against values anywhere."""
        return -self.samples * float(np.log(2.0 * ON))


@dataclass(frozen=True)
class Stale:
    """Samples that repeat the last one.

    Attributes:
        held: for each log the (n,) places whose values the samples hold.
        share: of repeated samples.
        samples: their number.
    """

    held: tuple[Index, ...]
    share: float
    samples: int

    @property
    def gain(self) -> float:
        """Log-likelihood against samples of which no two are alike."""
        return self.share * self.samples * 5.0

    @property
    def deviation(self) -> float:
        """Standard deviation of the share."""
        return float(np.sqrt(self.share * (1.0 - self.share) / self.samples))


def grid_of(series: list[Array]) -> Grid | None:
    """The grid of a reading in one or several logs."""
    whole = np.concatenate(series)
    values = np.unique(whole)
    if values.size < 3 or values.size > FEW * whole.size:
        return None
    gaps = np.diff(values)
    near = gaps[gaps < 1.5 * gaps.min()]
    step = float(np.median(near))
    if step < COARSE * float(np.ptp(values)):
        return None
    ratio = gaps / step
    return Grid(step, whole.size) if float(np.max(np.abs(ratio - np.round(ratio)))) < ON else None


def _tells(kept: Array, speed: Array, repeats: NDArray[np.bool_]) -> bool:
    """Whether repeated samples of a log are no accident: its other samples are noisy, or its model moves meanwhile."""
    if not repeats.any():
        return False
    if kept.size and white_noise(kept) > NOISY * float(np.std(kept)):
        return True
    return bool(np.median(speed[repeats]) > 0.5 * np.median(speed) > 0.0)


def jumps_after(series: Array, repeats: NDArray[np.bool_]) -> Array:
    """By how much a reading changes where it ends to repeat itself, over its usual change."""
    change = np.abs(np.diff(series))
    usual = float(np.median(change[~repeats[1:]])) if not repeats.all() else 0.0
    ends = np.flatnonzero(repeats[:-1] & ~repeats[1:])
    return change[ends] / usual if usual > 0.0 else np.zeros(0)


def standing(series: Array) -> NDArray[np.bool_]:
    """(n,) True where a reading repeats itself for long and has missed nothing, and at the ends, where nothing would show.

    A machine whose motion shakes its sensor is noisy under way and stands without noise.
    """
    same = np.concatenate([[False], np.diff(series) == 0.0, [False]])
    edges = np.flatnonzero(same[1:] != same[:-1])
    change = np.abs(np.diff(series))
    usual = float(np.median(change[change > 0.0])) if change.any() else 0.0
    found = np.zeros(series.size, dtype=bool)
    for first, last in zip(edges[::2], edges[1::2], strict=True):  # of the readings that are alike
        at_end = first == 0 or last == series.size - 1
        if at_end or (last - first >= RESTING_RUN and change[last] <= SHAKES * usual):
            found[first : last + 1] = True
    return found


def by_chance(series: Array) -> float:
    """How many samples of a noisy reading repeat the last one because of the digits with which it is written.

    Noise that spans many last digits changes by one of them as often as by none; what is held repeats, and does not.
    """
    # a file may write fewer decimals of large numbers
    change = np.abs(np.diff(series))[np.argsort(np.abs(series[1:]), kind="stable")]
    expected = 0.0
    for start in range(0, change.size, NEAR_BY):
        own = change[start : start + NEAR_BY]
        moved = own[own > 0.0]
        if not moved.size:
            continue
        digit = float(moved.min())
        steps = moved / digit
        if np.mean(np.abs(steps - np.round(steps)) < WHOLE) >= ON_DIGITS:
            expected += float(np.sum(np.round(steps) <= DIGITS)) / (2 * DIGITS)
    return expected


def stale_of(series: list[Array], model: list[Array]) -> Stale | None:
    """Repeated samples of a reading that is noisy, or whose model moves meanwhile; those of a machine at rest are none."""
    repeats = [
        np.concatenate([[False], np.diff(s) == 0.0]) & ~(resting(s) | rounded(s) | standing(s))
        for s in series
    ]
    speed = [np.abs(np.diff(m, prepend=m[:1])) for m in model]
    for s, own, v in zip(series, repeats, speed, strict=True):
        if not _tells(s[~own], v, own):  # a machine at rest in one log says nothing of its sensor in another
            own[:] = False
    count = sum(r.size for r in repeats if r.any())
    if not count:
        return None
    many = sum(int(r.sum()) for r in repeats)
    chance = sum(by_chance(s) for s, r in zip(series, repeats, strict=True) if r.any())
    if many <= chance + CHANCE * np.sqrt(max(chance, 1.0)):
        return None
    share = many / count
    if not STALE < share < 0.9:
        return None
    # what was missed meanwhile shows at once; a machine that stands, or begins to move, has missed nothing
    after = np.concatenate([jumps_after(s, r) for s, r in zip(series, repeats, strict=True)])
    if after.size and float(np.median(after)) < MISSED:
        return None
    kept = np.concatenate([s[~r] for s, r in zip(series, repeats, strict=True)])
    if np.unique(kept).size < 0.5 * kept.size:
        return None
    held = tuple(np.maximum.accumulate(np.where(r, 0, np.arange(r.size))) for r in repeats)
    return Stale(held, share, count)
