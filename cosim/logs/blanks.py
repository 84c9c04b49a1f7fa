"""Tables whose columns are parted by blanks, one or several, as programs write that align their numbers (``.dat``).

0.000   -0.1524    12
0.002   -0.5873   -41
"""

import csv
import io
import re
from collections.abc import Callable
from pathlib import Path

from cosim.logs.window import Window

BLANK = " "
SIGNS = (";", "\t", "|", ",")  # that part columns, in the order they are looked for
LOOKED_AT, LAST = 200, 12  # lines, of which the last ones are looked at: the first may be a title
COMMENT = ("#", "%", "//")  # before the names, as numpy.savetxt and MATLAB write them, or before a remark
_RUN, _EDGES = re.compile(rb"[ \t]+"), re.compile(rb"(?m)^\t|\t(?=\r?$)")
_GLUED, _HELD = re.compile(r"[ \t]+(?=[\[(])"), "\0"  # "slew [deg]" is one cell


def cells(line: str, separator: str) -> list[str]:
    """The cells of a row; between blanks a unit in brackets belongs to the name before it.

    Raises:
        csv.Error: quotes or the sign itself make no row of it.
    """
    if separator != BLANK:
        return next(csv.reader([line], delimiter=separator), [])
    text = uncommented(line)
    return [cell.replace(_HELD, BLANK) for cell in _GLUED.sub(_HELD, text).split()]


def uncommented(line: str) -> str:
    """A line without the sign that makes it a comment, and without blanks around it."""
    text = line.strip()
    for sign in COMMENT:
        text = text.removeprefix(sign).lstrip()
    return text


def remark(line: str) -> bool:
    """Whether a line is a remark, such as ``// restarted``, or blank."""
    text = line.strip()
    return not text or text.startswith(COMMENT)


def parted(head: str, number: Callable[[str], bool]) -> bool:
    """Whether blanks and no other sign part the numbers of a table.

    Args:
        head: the first lines of the file.
        number: whether a cell holds a number, or says that one is missing.
    """
    lines = [line for line in head.splitlines()[:LOOKED_AT] if line.strip()][-LAST:]
    lines = lines[:-1] or lines  # the last of the head may be cut short

    def numbers(row: list[str]) -> bool:
        return len(row) > 1 and all(number(cell.strip()) for cell in row)

    rows = [cells(line, BLANK) for line in lines]
    width = max((len(row) for row in rows), default=0)
    whole = sum(len(row) == width and numbers(row) for row in rows)
    if 2 * whole <= len(rows):  # a bad cell is named later
        return False
    return not any(numbers(cells(lines[-1], sign)) for sign in SIGNS)


def squeezed(path: Path, start: int, end: int) -> bytes:
    """A part of a file with one tab in place of each run of blanks, and none at the ends of its lines."""
    with io.BufferedReader(Window(path, start, end)) as file:
        return _EDGES.sub(b"", _RUN.sub(b"\t", file.read()))
