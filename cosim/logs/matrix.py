"""A matrix in a text file, as MATLAB writes one into a script (``.m``) and laboratory plants into a log.

% time  u  angle
data = [
0.00, 0.5, 1.2;
0.01, 0.5, 1.3 ];
plot(data(:, 1), data(:, 3))

The longest matrix of the file becomes a plain table in a temporary folder, below the remarks and names that stand above it,
each row in the line where it was.
"""

import re
from pathlib import Path
from typing import Any

from cosim.logs.packed import beside
from cosim.logs.text import TextSource

_LOOKED_AT = 1 << 16  # bytes in which a matrix must begin
_OPENS = re.compile(
    rb"(?m)^[ \t]*(?:[A-Za-z_][\w.]*[ \t]*=[ \t]*)?\[[ \t]*(?=(?:\.\.\.[^\r\n]*|%[^\r\n]*)?\r?$|[-+.\d])"
)
_ENDS = re.compile(rb"[\[\]]")
_REMARK = re.compile(rb"%.*|\.\.\.[ \t]*$")
_PARTED = re.compile(rb"[ \t]*,[ \t]*|[ \t]+")
_CODE = re.compile(rb"[=(].*|.*;\s*$")


class MatrixText(TextSource):
    """A text file whose table is a matrix in brackets.

    Args:
        path: the file.
        options: of `TextSource`.

    Raises:
        DataError: it has no data rows.
    """

    def __init__(self, path: Path, **options: Any) -> None:
        text = beside(self)
        text.write_bytes(table(path.read_bytes()))
        super().__init__(path, text=text, **options)


def holds_matrix(path: Path) -> bool:
    """Whether a line of a text file begins a matrix that ends in another line.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        if not _OPENS.search(file.read(_LOOKED_AT)):
            return False
        file.seek(0)
        return _longest(file.read()) is not None


def table(text: bytes) -> bytes:
    """The longest matrix of a text as rows of numbers parted by blanks, with what stands above it and is no code."""
    found = _longest(text)
    assert found is not None
    begin, first, last = found
    above = [b"" if _is_code(line) else line for line in text[:begin].splitlines()]
    rows: list[bytes] = []
    for line in text[first:last].splitlines():
        parts = [_PARTED.sub(b"  ", part.strip()) for part in _REMARK.sub(b"", line).split(b";")]
        rows += [part for part in parts if part] or [b""]
    return b"\n".join([*above, *rows, b""])


def _longest(text: bytes) -> tuple[int, int, int] | None:
    """Where the line of the longest matrix begins, where its numbers begin and where they end; None without a matrix."""
    found = []
    for opened in _OPENS.finditer(text):
        end = _ENDS.search(text, opened.end())
        if end is not None and end.group() == b"]" and b"\n" in text[opened.end() : end.start()].strip():
            found.append((opened.start(), opened.end(), end.start()))
    return max(found, key=lambda place: place[2] - place[1], default=None)


def _is_code(line: bytes) -> bool:
    """Whether a line says something to MATLAB, not to a reader."""
    text = line.strip()
    return not text.startswith(b"%") and _CODE.search(text) is not None
