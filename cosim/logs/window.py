"""A first quick pass over a text file, and a view of a part of it as a file of its own."""

import codecs
import dataclasses
import io
from dataclasses import dataclass
from pathlib import Path

from cosim.errors import DataError

_BLOCK = 1 << 22
_LONGEST_LINE = 1 << 20


@dataclass(frozen=True)
class Survey:
    """What the first pass finds.

    Attributes:
        start: offset of the header, after a byte order mark.
        end: file size.
        lines: lines in the file, blank ones too.
        header_lines: lines up to and including the header.
        first_line: the header as text.
        last_line: the last line as text, without its end.
        last_start: offset of the last line.
        ends_cleanly: whether the last line has its end.
    """

    start: int
    end: int
    lines: int
    header_lines: int
    first_line: str
    last_line: str
    last_start: int
    ends_cleanly: bool

    def without_last(self) -> "Survey":
        """The same file without its last line."""
        return dataclasses.replace(self, end=self.last_start, lines=self.lines - 1, ends_cleanly=True)


def survey(path: Path, encoding: str | None = None, shown: Path | None = None) -> Survey:
    """Looks at a text file's size, first and last line, and counts its lines.

    Args:
        path: the file.
        encoding: of its text; by default UTF-8, or Windows-1252 where it is none.
        shown: the file that messages name; by default `path`.

    Raises:
        DataError: the file is empty or is no text.
    """
    shown = path if shown is None else shown
    with path.open("rb") as file:
        head = file.read(_LONGEST_LINE)
        if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise DataError(f"{shown}: the text is in UTF-16: save it as UTF-8")
        start = len(codecs.BOM_UTF8) if head.startswith(codecs.BOM_UTF8) else 0
        if not head[start:].strip():
            raise DataError(f"{shown}: the file is empty")
        if b"\0" in head:
            raise DataError(f"{shown}: this is no text file, but its name ends in '{shown.suffix}'")
        file.seek(0)
        feeds = returns = 0
        while block := file.read(_BLOCK):
            feeds += block.count(b"\n")
            returns += block.count(b"\r")
        size = file.tell()
        tail_start = max(start, size - _LONGEST_LINE)
        file.seek(tail_start)
        tail = file.read()
    line_end = b"\n" if feeds else b"\r"
    blank, first = _first_line(head[start:], line_end, shown, encoding)
    clean = tail.endswith(line_end)
    body = tail.rstrip(b"\r\n") if not clean else tail[:-1]
    cut = body.rfind(line_end) + 1
    return Survey(
        start=start,
        end=size,
        lines=(feeds or returns) + (not clean),
        header_lines=blank + 1,
        first_line=first,
        last_line=_decoded(body[cut:], encoding).rstrip("\r\n"),
        last_start=tail_start + cut,
        ends_cleanly=clean,
    )


def head_text(path: Path, found: Survey, encoding: str | None = None) -> str:
    """The first megabyte of the file as text."""
    with path.open("rb") as file:
        file.seek(found.start)
        return _decoded(file.read(_LONGEST_LINE), encoding)


def _first_line(head: bytes, line_end: bytes, path: Path, encoding: str | None) -> tuple[int, str]:
    """Number of blank lines at the top, and the first line that is not blank."""
    rest, blank = head, 0
    while rest:
        line, found, rest = rest.partition(line_end)
        if not found and len(head) == _LONGEST_LINE:
            break
        if line.strip():
            return blank, _decoded(line, encoding).rstrip("\r\n")
        blank += 1
    raise DataError(f"{path}: no line end in the first megabyte: this is no table")


def _decoded(line: bytes, encoding: str | None) -> str:
    if encoding is not None:
        return line.decode(encoding, errors="replace")
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace")  # what Windows programs write a degree sign in


class Window(io.RawIOBase):
    """The bytes ``start <= position < end`` of a file, as a file to read from."""

    def __init__(self, path: Path, start: int, end: int) -> None:
        self._file = path.open("rb", buffering=0)
        self._file.seek(start)
        self._left = end - start

    def readable(self) -> bool:
        """True."""
        return True

    def readinto(self, buffer: object) -> int:
        """Fills a writable buffer with what is left and returns the number of bytes."""
        view = memoryview(buffer)[: self._left]  # type: ignore[arg-type]
        count = self._file.readinto(view)
        self._left -= count
        return count

    def close(self) -> None:
        """Closes the file."""
        self._file.close()
        super().close()
