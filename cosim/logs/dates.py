"""Stamps written as date and time of day (``2024-03-01 10:00:00.125``, ``3/1/2024 10:00:00.125 AM``, ``10:00:00,125``)."""

import re
from collections.abc import Sequence
from datetime import date

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_STAMP = re.compile(
    r"(?:(?:(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})"
    r"|(?P<first>\d{1,2})(?P<sign>[-/.])(?P<second>\d{1,2})[-/.](?P<last>\d{4})"
    rf"|(?P<number>\d{{1,2}})[- ](?P<name>{'|'.join(_MONTHS)})[a-z]*[- ](?P<named>\d{{4}}))[T_ ,]\s*)?"
    r"(?P<hours>\d{1,2}):(?P<minutes>\d{2}):(?P<seconds>\d{2}(?:[.,]\d+)?)"
    r"\s*(?P<half>[ap]\.?m\.?)?\s*(?:Z|UTC|GMT|[-+]\d{2}:?\d{2})?",
    re.IGNORECASE,
)
DAY = 86400.0


def is_stamp(text: str) -> bool:
    """Whether a cell holds a time of day to the second, with or without its date."""
    return _STAMP.fullmatch(text.strip()) is not None


def seconds(cells: Sequence[str]) -> Array:
    """Seconds (n,) since the first stamp; NaN for an empty cell.

    Of the two numbers of a date such as ``3/4/2024`` that is the day which changes, or which no month can be. Where there
    are no dates, a time that goes back by more than half a day is of the next day; one that goes on by as much in a log
    whose newest row stands first is of the day before.

    Raises:
        ValueError: a cell is no stamp; its argument is the index of the cell.
    """
    found = [_STAMP.fullmatch(cell.strip()) if cell.strip() else None for cell in cells]
    for k, (cell, match) in enumerate(zip(cells, found, strict=True)):
        if match is None and cell.strip():
            raise ValueError(k)
    matches = [match for match in found if match is not None]
    day_first = _day_first({(m["first"], m["second"], m["sign"]) for m in matches if m["first"]})
    days: dict[tuple[str | None, ...], int] = {}
    stamps = np.full(len(cells), np.nan)
    for k, match in enumerate(found):
        if match is None:
            continue
        key = match.group("year", "month", "day", "first", "second", "last", "number", "name", "named")
        if key not in days:
            try:
                days[key] = _day(match, day_first)
            except ValueError:
                raise ValueError(k) from None
        stamps[k] = (days[key] - next(iter(days.values()))) * DAY + _of_day(match)
    if not any(days.values()):
        there = np.isfinite(stamps)
        steps = np.diff(stamps[there], prepend=stamps[there][:1])
        small = steps[np.abs(steps) <= 0.5 * DAY]
        falls = np.sum(small < 0.0) > np.sum(small > 0.0)
        stamps[there] += DAY * np.cumsum(-1.0 * (steps > 0.5 * DAY) if falls else steps < -0.5 * DAY)
    # to the nanosecond: what is beyond it comes of taking two times of day off each other
    return np.round(stamps - (stamps[np.isfinite(stamps)][:1] if matches else 0.0), 9)


def _day_first(dates: set[tuple[str, str, str]]) -> bool:
    """Whether the day stands before the month in dates such as ``3/4/2024``."""
    firsts, seconds, signs = ({d[k] for d in dates} for k in range(3))
    if any(int(first) > 12 for first in firsts) or any(int(second) > 12 for second in seconds):
        return any(int(first) > 12 for first in firsts)
    return len(firsts) > len(seconds) or (len(firsts) == len(seconds) and signs != {"/"})


def _day(match: re.Match[str], day_first: bool) -> int:
    """Number of the day, 0 where the stamp has no date."""
    if match["year"]:
        return date(int(match["year"]), int(match["month"]), int(match["day"])).toordinal()
    if match["name"]:
        month = _MONTHS.index(match["name"].lower()) + 1
        return date(int(match["named"]), month, int(match["number"])).toordinal()
    if match["first"]:
        numbers = (int(match["first"]), int(match["second"]))
        day, month = numbers if day_first else numbers[::-1]
        return date(int(match["last"]), month, day).toordinal()
    return 0


def _of_day(match: re.Match[str]) -> float:
    hours = int(match["hours"])
    if match["half"]:
        hours = hours % 12 + (12 if match["half"][0] in "pP" else 0)
    return 3600.0 * hours + 60.0 * int(match["minutes"]) + float(match["seconds"].replace(",", "."))
