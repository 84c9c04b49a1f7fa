"""Damage: what is mended with a warning, and what stops with an error. docs/logs.md has the same rules in words."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError
from cosim.logs.log import Gap

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LATE = 10
"""Rows may come late by this many places and are put back (UDP reorders); farther back, the clock itself jumped."""

BAD_SHARE = 0.01
"""Share of rows with an unusable stamp above which the file is refused."""

HELD_SPAN = 0.1
"""Longest time [s] for which a missing command is taken as unchanged, or three samples where that is longer."""


class TimeRepair:
    """Makes time strictly increasing, and tells which rows were kept in which order.

    Args:
        time: stamps (n,) [s] as read.
        columns: the other columns (n,), which tell a repeated row from a repeated stamp.
        where: the text ``file: row 12`` for a row index.

    Attributes:
        keep: row indices in their new order, or None where nothing had to change.
        warnings: what was done.

    Raises:
        DataError: the stamps cannot be mended.
    """

    def __init__(self, time: Array, columns: list[Array], where: Callable[[int], str]) -> None:
        self.keep: Index | None = None
        self.warnings: list[str] = []
        self._time, self._columns, self._where = time, columns, where
        if len(time) == 0:
            raise DataError(f"{where(0).rpartition(':')[0]}: there is no data row")
        self._drop_unusable()
        if newest_first(self.time):
            self.keep = self._rows(np.arange(len(self.time))[::-1])
            self.warnings.append("the newest row stands first: the rows are read from the last to the first")
        if (np.diff(self.time) <= 0).any():
            self._reorder()
            self._drop_repeated()
        if len(self.time) < 2:
            raise DataError(f"{where(0).rpartition(':')[0]}: only one usable row; a log needs at least two")

    @property
    def time(self) -> Array:
        """The stamps as mended so far."""
        return self._time if self.keep is None else self._time[self.keep]

    def _rows(self, positions: Index) -> Index:
        return positions if self.keep is None else self.keep[positions]

    def _drop_unusable(self) -> None:
        bad = np.flatnonzero(~np.isfinite(self._time))
        if not bad.size:
            return
        place = self._where(int(bad[0]))
        if bad.size > max(1, BAD_SHARE * len(self._time)):
            raise DataError(
                f"{place}, column time: no usable time stamp; so have {bad.size} of {len(self._time)} rows: "
                "delete them, or, if the log was sampled evenly, say in a mapping how often ([time] step = 0.01)"
            )
        self.keep = np.flatnonzero(np.isfinite(self._time))
        self.warnings.append(
            f"{counted(bad.size, 'row')} without a usable time stamp left out (first: {_short(place)})"
        )

    def _reorder(self) -> None:
        time = self.time
        back = np.flatnonzero(np.diff(time) < 0)
        if not back.size:
            return
        order = np.argsort(time, kind="stable")
        shift = np.abs(order - np.arange(len(order)))
        first = int(back[0])
        if shift.max() > LATE:
            raise DataError(
                f"{self._where(int(self._rows(back[:1] + 1)[0]))}, column time: time goes back from {time[first]:.9g} to"
                f" {time[first + 1]:.9g} s: the clock was set, or two logs were joined; cut the file there"
            )
        place = self._where(int(self._rows(back[:1] + 1)[0]))
        self.keep = self._rows(order)
        self.warnings.append(
            f"{counted(back.size, 'row')} came late, by up to {counted(int(shift.max()), 'place')}, put back in order"
            f" (first: {_short(place)})"
        )

    def _drop_repeated(self) -> None:
        time = self.time
        later = np.flatnonzero(np.diff(time) == 0) + 1
        if not later.size:
            return
        rows, earlier = self._rows(later), self._rows(later - 1)
        same = np.ones(len(later), dtype=bool)
        for column in self._columns:
            a, b = column[rows], column[earlier]
            same &= (a == b) | (np.isnan(a) & np.isnan(b))
        conflicts = later[~same]
        if conflicts.size > max(3, BAD_SHARE * len(time)):
            raise DataError(
                f"{self._where(int(rows[~same][0]))}, column time: time stands still at {time[conflicts[0]]:.9g} s while"
                f" other columns change; so do {conflicts.size} of {len(time)} rows: where samples are equidistant, give"
                " 'time.step' in a mapping"
            )
        for positions, what in (
            (later[same], "repeated row"),
            (conflicts, "differing row at a repeated stamp"),
        ):
            if positions.size:
                place = self._where(int(self._rows(positions[:1])[0]))
                self.warnings.append(
                    f"{counted(positions.size, what)} left out, the first kept (first: {_short(place)})"
                )
        mask = np.ones(len(time), dtype=bool)
        mask[later] = False
        self.keep = self._rows(np.flatnonzero(mask))


def newest_first(stamps: Array) -> bool:
    """Whether nearly all stamps (n,) fall, as in what a plant's historian writes; a clock that was set falls once."""
    steps = np.diff(stamps)
    return bool(steps.size > 1 and np.sum(steps < 0.0) >= (1.0 - BAD_SHARE) * steps.size)


def counted(number: int, noun: str) -> str:
    """``1 place``, ``2 places``; ``2 repeated rows``."""
    plural = noun.replace("row", "rows", 1) if "row" in noun else f"{noun}s"
    return f"{number} {noun if number == 1 else plural}"


def _short(place: str) -> str:
    return place.rpartition(": ")[2]


def wide_intervals(intervals: Array) -> tuple[NDArray[np.intp], bool]:
    """Places of the intervals (n,) in which samples are missing, and whether the others are regular.

    In a log that is regular but for gaps that is one of more than 1.5 median ones; in an irregular one, of more than ten.
    """
    step = float(np.median(intervals))
    regular = bool(np.count_nonzero(np.abs(intervals - step) <= 0.1 * step) >= 0.95 * len(intervals))
    return np.flatnonzero(intervals > (1.5 if regular else 10.0) * step), regular


def sampling(time: Array, place: Callable[[int], str], unit: str = "s") -> tuple[tuple[Gap, ...], list[str]]:
    """Gaps as `wide_intervals` has them, and sentences on missing samples, jitter and irregular sampling.

    Args:
        time: stamps (n,), strictly increasing.
        place: the text ``row 12`` for a position.
        unit: of time, for the text.
    """
    intervals = np.diff(time)
    step = float(np.median(intervals))
    wide, regular = wide_intervals(intervals)
    gaps = tuple(Gap(float(time[k]), float(time[k + 1])) for k in wide)
    notes = []
    if wide.size:
        lost = int((np.rint(intervals[wide] / step) - 1).sum())
        what = f"{counted(lost, 'sample')} missing" if regular else "pauses of more than ten median intervals"
        notes.append(
            f"{what} in {counted(wide.size, 'place')} (longest {intervals[wide].max():.4g} {unit};"
            f" first after {place(int(wide[0]))})"
        )
    others = np.delete(intervals, wide) if wide.size else intervals
    if not regular:
        notes.append(
            f"irregular sampling: intervals from {others.min():.4g} to {others.max():.4g} {unit}, median {step:.4g} {unit}"
        )
    elif max(others.max() - step, step - others.min()) > 0.01 * step:
        notes.append(
            f"jitter: intervals from {others.min():.6g} to {others.max():.6g} {unit}, median {step:.6g} {unit}"
        )
    return gaps, notes


def fill(
    name: str, time: Array, values: Array, held: bool, where: Callable[[int], str]
) -> tuple[NDArray[np.bool_] | None, str]:
    """Fills missing (NaN, infinite) values of one signal in place: held ones by the last value, others by straight lines.

    At the ends the nearest value is kept.

    Args:
        name: the signal, for messages.
        time: stamps (n,) [s].
        values: (n,), changed in place; at least one is finite.
        held: whether the signal is constant between samples.
        where: the text ``file: row 12`` for a position.

    Returns:
        Mask (n,) that is False where a value was filled, and a sentence; None and empty where nothing was missing.

    Raises:
        DataError: a held signal, which drives the models, is missing for too long.
    """
    valid = np.isfinite(values)
    if valid.all():
        return None, ""
    edges = np.diff(np.concatenate(([True], valid, [True])).astype(np.int8))
    starts, stops = np.flatnonzero(edges == -1), np.flatnonzero(edges == 1)
    spans = time[np.minimum(stops, len(time) - 1)] - time[np.maximum(starts - 1, 0)]
    worst = int(spans.argmax())
    if held and spans[worst] > HELD_SPAN * (1 + 1e-9) and stops[worst] - starts[worst] > 3:
        raise DataError(
            f"{where(int(starts[worst]))}, column '{name}': {stops[worst] - starts[worst]} values are missing in a row"
            f" ({spans[worst]:.4g} s), too long to take the signal as unchanged: cut the log there"
        )
    good = np.flatnonzero(valid)
    bad = np.flatnonzero(~valid)
    if held:
        values[bad] = values[good[np.maximum(np.searchsorted(good, bad) - 1, 0)]]
    else:
        values[bad] = np.interp(time[bad], time[good], values[good])
    way = "by the value before" if held else "by straight lines"
    return valid, (
        f"{name}: {counted(bad.size, 'missing value')} in {counted(starts.size, 'place')} filled {way}"
        f" (longest {spans[worst]:.4g} s; first: {_short(where(int(starts[0])))}); valid is False there"
    )
