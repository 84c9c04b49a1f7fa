"""Lines that loggers write above a table: title, operator, date; and a row of units below that of the names.

    Messung vom 24.11.2026;Pruefstand 3;;
    Zeit;Kolbenposition;pA;
    ms;mm;bar;
    0,0;0,01;85,2;

The table begins at the first two rows of numbers of one width. Above it stands the row of names, or one of units and then
that of names. Where this is not so (a bad cell in the first row of data), nothing is taken for a preamble.

Amplifiers and recorders write several rows of names; then a column is called by its cells in all of them:

    Axis1
    Sampling time interval(ms),0.667        Interval,0.0005,Interval,0.0005
    Time,Analog 1,Digital 1                 Channel name,Force,Channel name,Input 1
    ms,Servo motor speed,Not selected       Unit,V,Unit,V
"""

import csv
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from cosim.errors import UsageError
from cosim.logs.blanks import BLANK, SIGNS, cells, uncommented
from cosim.logs.source import Label, parse_label
from cosim.units import parse_unit

MOST_TITLES = 200  # lines in which the table must begin
_LONGEST_UNIT = 12
_BREAK = re.compile(r"\r\n|\r|\n")
_SEVERAL = re.compile(r"[ \t]{2,}")
_UNIT_KEYS = ("unit", "units", "einheit", "einheiten", "unite", "unidad", "unita", "enhet")
_NO_UNIT = ("", "-", "--", "1", "[]", "[-]")
_SIGNS = ("°", "°/s")  # read as deg elsewhere


@dataclass(frozen=True)
class Preamble:
    """Where the table begins.

    Attributes:
        before: lines before the row of names.
        blank: whether nothing stands in them.
        lines: lines before the first row of numbers.
        separator: column separator.
        labels: one for each column.
        has_units: whether a row of units stands below the names.
        several: whether all rows from that of the names on name the columns together.
        named: cells in the row of the names, which may have more than rows of numbers: a last column for remarks.
    """

    before: int
    blank: bool
    lines: int
    separator: str
    labels: tuple[Label, ...]
    has_units: bool
    named: int
    several: bool = False


def read_preamble(head: str, separator: str | None, number: Callable[[str], bool]) -> Preamble | None:
    """What stands above the table, or None where it is a row of names alone, as it should be.

    Args:
        head: the first lines of the file.
        separator: column separator, None where it is to be found out.
        number: whether a cell holds a number, or says that one is missing.
    """
    lines = _BREAK.split(head)[:MOST_TITLES]  # splitlines takes more for a line's end than a file of rows has
    for sign in SIGNS if separator is None else (separator,):
        try:
            rows = [cells(line, sign) for line in lines]
        except csv.Error:
            continue
        found = _table(rows, number)
        if found is not None:
            width = _usual(rows[found:])
            for k in range(found if sign == BLANK else 0):  # names of several words, parted by several blanks
                apart = _SEVERAL.split(uncommented(lines[k]))
                rows[k] = apart if len(rows[k]) != width == len(apart) else rows[k]
            return _preamble(rows, found, sign)
    return None


def _table(rows: Sequence[Sequence[str]], number: Callable[[str], bool]) -> int | None:
    """Index of the first of two rows of numbers, at least two of one width; a row of numbers above may end in a remark."""
    for k, (row, below) in enumerate(pairwise(rows)):
        if len(row) == len(below) > 1 and all(_numbers(cells, number) for cells in (row, below)):
            width = len(row)
            while k > 0 and len(rows[k - 1]) > width and _numbers(rows[k - 1][:width], number):
                k -= 1
            return k
    return None


def _numbers(row: Sequence[str], number: Callable[[str], bool]) -> bool:
    cells = [cell.strip() for cell in row]
    return any(cells) and all(number(cell) for cell in cells)


def _preamble(rows: Sequence[Sequence[str]], first: int, separator: str) -> Preamble | None:
    width = _usual(rows[first:])
    # a separator at the end of every line makes an empty column, which has no name
    above = [[cell.strip() for cell in row] for row in rows[:first]]
    names = next((k for k in range(first - 1, -1, -1) if any(above[k])), -1)  # blank lines may stand below
    named = width
    if names >= 0 and len(above[names]) > width and _are_names(above[names], len(above[names])):
        # the last columns are for remarks, and most rows end before them
        named = len(above[names])
        above[names] = above[names][:width]
    units: Sequence[str] = [""] * width
    has_units = False
    if (
        names >= 1
        and len(above[names]) == width
        and _are_units(above[names])
        and _are_names(above[names - 1], width)
    ):
        units, names, has_units = above[names], names - 1, True
    if names < 0 or (names == 0 and first == 1 and named == width):
        return None
    rivals = [row for row in above[:names] if _are_names(row, width)]
    several = any(_with_units(row) >= _with_units(above[names]) for row in rivals)
    if several or not _are_names(above[names], width):
        return _joined(above, first, width, separator)
    labels = tuple(
        parse_label(name, None if unit in _NO_UNIT else unit.strip("[]()"))
        for name, unit in zip(above[names], units, strict=True)
    )
    return Preamble(names, not any(map(any, above[:names])), first, separator, labels, has_units, named)


def _usual(rows: Sequence[Sequence[str]]) -> int:
    """The width that most rows have."""
    return Counter(len(row) for row in rows if any(row)).most_common(1)[0][0]


def _joined(above: Sequence[Sequence[str]], first: int, width: int, separator: str) -> Preamble | None:
    """A table whose columns are named by several rows; None where the first row of the file may be that of the names.

    What stands in one row more than once is a key, such as "Channel name", and names no column.
    """
    if first < 2 or _are_names(above[0], width):
        return None  # the rows below it may be damaged data
    top = first
    while top > 0 and len(above[top - 1]) == width:
        top -= 1
    names: list[list[str]] = [[] for _ in range(width)]
    units = [""] * width
    for row in above[top:first]:
        of_units = row[0].strip(":").lower() in _UNIT_KEYS or _are_units(row)
        for k, cell in enumerate(row):
            own = bool(cell) and row.count(cell) == 1 and not _is_number(cell)
            short = cell.strip("[]() ")
            if (
                len(short) <= _LONGEST_UNIT
                and short not in _NO_UNIT
                and _is_unit(short)
                and (of_units or names[k])
            ):
                units[k] = short
            elif own and not of_units:
                names[k].append(cell)
    if not any(names):
        return None
    labels = tuple(
        parse_label(" ".join(parts) or above[top][k], unit or None)
        for k, (parts, unit) in enumerate(zip(names, units, strict=True))
    )
    return Preamble(top, not any(map(any, above[:top])), first, separator, labels, False, width, several=True)


def _is_number(cell: str) -> bool:
    return cell.replace(",", ".").replace(".", "", 1).lstrip("+-").isdecimal()


def _are_names(row: Sequence[str], width: int) -> bool:
    """Whether a row names its columns: each but the last has a name of its own, and none is a number."""
    filled = row if row[-1:] != [""] else row[:-1]
    return (
        len(row) == width
        and all(filled)
        and len(set(filled)) == len(filled)
        and not any(map(_is_number, filled))
    )


def _with_units(row: Sequence[str]) -> int:
    """How many names have a unit with them, as ``time [s]``."""
    return sum(parse_label(cell).unit is not None for cell in row)


def _are_units(row: Sequence[str]) -> bool:
    """Whether a row holds units: short cells, of which most can be read as a unit."""
    filled = [cell.strip("[]() ") for cell in row if cell not in _NO_UNIT]
    if not filled or any(len(cell) > _LONGEST_UNIT for cell in filled):
        return False
    return sum(map(_is_unit, filled)) > 0.5 * len(filled)


def _is_unit(text: str) -> bool:
    if text in _SIGNS:
        return True
    try:
        parse_unit(text)
    except UsageError:
        return False
    return True
