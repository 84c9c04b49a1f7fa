"""When a log was sampled, and the finer steps in which its model runs between the samples.

A model is simulated in steps of its own, driven by what the log says between the samples, and read at the samples'
true stamps: nothing measured is ever moved or made up.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.thresholds import EVEN_SAMPLING, FINE_STEP_SHARE, WINDOW, WINDOW_SAMPLES

Array = NDArray[np.float64]

LONGEST_STEP = 1e-3  # s, the longest step of a simulation unless another is asked for
EVEN_STAMPS = 1e-6  # of an interval: stamps closer than this to even ones are even
OF_PIECE = "@"  # between a name and the number of the piece whose own it is; of the first piece the name stands alone


@dataclass(frozen=True)
class Grid:
    """The samples of a log and the steps of its simulation.

    Attributes:
        stamps: (m,) s, from zero, increasing.
        step: length of a simulation's step, s.
        lines: a signal that a controller holds over each of its own steps was sampled more rarely than that: what it
            did between the samples lies on straight lines.
    """

    stamps: Array = field(repr=False)
    step: float
    lines: bool = False

    def __post_init__(self) -> None:
        """Prepare where each stamp lies among the steps."""
        count = math.ceil(self.stamps[-1] / self.step - EVEN_STAMPS)
        time = np.arange(count + 1) * self.step
        place = np.clip(self.stamps / self.step, 0.0, count)
        exact = np.round(place)
        place = np.where(np.abs(place - exact) < EVEN_STAMPS, exact, place)
        below = np.minimum(place.astype(np.int64), count - 1)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "_below", below)
        object.__setattr__(self, "_part", place - below)

    time: Array = field(init=False, repr=False, compare=False)
    _below: NDArray[np.int64] = field(init=False, repr=False, compare=False)
    _part: Array = field(init=False, repr=False, compare=False)

    @property
    def even(self) -> bool:
        """True if no stamp is off an even one by more than half an interval: jitter only."""
        return bool(
            np.max(np.abs(self.stamps - np.linspace(0.0, self.stamps[-1], self.stamps.size)))
            < 0.5 * self.stamps[-1] / self.stamps.size
        )

    def driven(self, values: Array, held: bool) -> Array:
        """(n,) what samples (m,) hand over at the steps' times.

        Args:
            values: a signal at the stamps.
            held: each value holds until the next stamp (not with `lines`); the result is then its mean over the step
                that follows.
        """
        if not held or self.lines:
            return np.asarray(np.interp(self.time, self.stamps, values), dtype=np.float64)
        area = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(self.stamps))])
        ends = np.append(self.time, self.time[-1] + self.step)
        last = self.stamps[-1]
        total = np.interp(ends, self.stamps, area) + np.maximum(ends - last, 0.0) * values[-1]
        means = np.diff(total) / self.step
        # a step without a change of the value has that value exactly, not to the rounding of two large sums
        first = np.searchsorted(self.stamps, ends[:-1] + EVEN_STAMPS * self.step, "right") - 1
        final = np.searchsorted(self.stamps, ends[1:] - EVEN_STAMPS * self.step, "left") - 1
        return np.where(first == final, values[first], means)

    def sampled(self, rows: Array) -> Array:
        """(..., m) values at the stamps of rows (..., n) at the steps' times, on straight lines between these."""
        low = rows[..., self._below]
        with np.errstate(invalid="ignore", over="ignore"):  # a trial far off may leave the numbers
            return np.asarray(low + self._part * (rows[..., self._below + 1] - low))


def grid_of(time: Array, step: float | None = None, lines: bool = False) -> tuple[Grid | None, float]:
    """The grid of a log, and its interval between samples, s.

    Args:
        time: (m,) stamps, s.
        step: longest step of a simulation, s; by default `LONGEST_STEP`, or more where sampling is slow.
        lines: as in `Grid`.

    Returns:
        None in place of the grid where each sample is a step: even sampling, fast enough.
    """
    stamps = np.asarray(time - time[0], dtype=np.float64)
    mean = float(f"{stamps[-1] / (stamps.size - 1):.10g}")
    middle = float(f"{np.median(np.diff(stamps)):.10g}")
    even = bool(np.max(np.abs(stamps - np.arange(stamps.size) * mean)) <= EVEN_SAMPLING * mean)
    interval = mean if even else middle
    longest = max(LONGEST_STEP, FINE_STEP_SHARE * interval) if step is None else step
    if even:
        stamps = np.asarray(np.arange(stamps.size) * interval, dtype=np.float64)
        if interval <= longest * (1.0 + EVEN_STAMPS):
            return None, interval
    return Grid(stamps, interval / math.ceil(interval / longest - EVEN_STAMPS), lines), interval


def window_span(interval: float) -> float:
    """Length of a window of a log sampled every `interval` s, s: `WINDOW`, or more where sampling is slow."""
    return max(WINDOW, WINDOW_SAMPLES * interval)


@dataclass(frozen=True)
class Pieces:
    """The samples of several logs of one machine, one behind the other: each is simulated by itself, from its own start.

    Attributes:
        counts: samples of each.
        intervals: s between the samples of each, the usual one where it varies.
        grids: the grid of each; None where each sample is a step.
    """

    counts: tuple[int, ...]
    intervals: tuple[float, ...]
    grids: tuple[Grid | None, ...]

    @cached_property
    def cuts(self) -> tuple[int, ...]:
        """First sample of each piece but the first."""
        return tuple(np.cumsum(self.counts[:-1]).tolist())

    @cached_property
    def stamps(self) -> Array:
        """(n,) s from the start of the first; each piece begins one interval behind the end of the one before."""
        found, begin = [], 0.0
        for count, h, grid in zip(self.counts, self.intervals, self.grids, strict=True):
            own = np.arange(count) * h if grid is None else grid.stamps
            found.append(begin + own)
            begin = float(found[-1][-1]) + h
        return np.concatenate(found)

    @property
    def starts(self) -> list[float]:
        """When each piece begins, s from the start of the first."""
        return [float(self.stamps[k]) for k in (0, *self.cuts)]

    @property
    def step(self) -> float:
        """Length of a simulation's step, s."""
        steps = (h if g is None else g.step for h, g in zip(self.intervals, self.grids, strict=True))
        return float(np.median(list(steps)))

    @property
    def lines(self) -> bool:
        """As in `Grid`, of any piece."""
        return any(grid is not None and grid.lines for grid in self.grids)

    @property
    def even(self) -> bool:
        """As in `Grid`, of every piece."""
        return all(grid is None or grid.even for grid in self.grids)

    @cached_property
    def step_cuts(self) -> tuple[int, ...]:
        """First step of each piece but the first."""
        steps = [c if g is None else g.time.size for c, g in zip(self.counts, self.grids, strict=True)]
        return tuple(np.cumsum(steps[:-1]).tolist())

    def sampled(self, rows: Array) -> Array:
        """(..., m) values at the stamps of rows (..., n) at the steps' times."""
        parts = np.split(rows, self.step_cuts, axis=-1)
        found = [p if g is None else g.sampled(p) for p, g in zip(parts, self.grids, strict=True)]
        return np.concatenate(found, axis=-1)


def cuts_of(grid: Grid | Pieces | None) -> tuple[int, ...]:
    """First sample of each piece but the first; none of one log."""
    return grid.cuts if isinstance(grid, Pieces) else ()


def plain_name(name: str) -> str:
    """A name without the number of the piece whose own it is."""
    return name.partition(OF_PIECE)[0]


def of_piece(values: Mapping[str, float], piece: int) -> dict[str, float]:
    """Values as one piece has them: what is its own, under the plain name, in the place of what the first has."""
    own = f"{OF_PIECE}{piece}"
    found = {name: value for name, value in values.items() if OF_PIECE not in name}
    return found | {name.removesuffix(own): value for name, value in values.items() if name.endswith(own)}
