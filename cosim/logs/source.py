"""What every file format offers to the loader: labelled columns of float64, read only when chosen."""

import contextlib
import gc
import hashlib
import logging
import re
import sys
import traceback
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import CosimError, DataError

Array = NDArray[np.float64]

_HEADER = re.compile(r"\s*(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\]|\((?P<round>[^()]*)\))?\s*")
_SAID = re.compile(
    r"^(?:in|units?|einheit)\b(?!/)[\s:]+", re.IGNORECASE
)  # before a unit: "Force (in N)"; "(in)" is inches
_BLOCK = 1 << 22
_LOGGERS = ("asammdf", "nptdms", "h5py")
_INNER = tuple(f"{name}." for name in _LOGGERS)


@dataclass(frozen=True)
class Label:
    """Heading of one column.

    Attributes:
        text: as it stands in the file, for messages and mappings.
        name: the name without the unit; in files with folders or structs the whole path.
        unit: unit as written, None where there is none.
        alias: last part of the path, where the format has paths.
        others: further names by which a mapping may call it.
    """

    text: str
    name: str
    unit: str | None
    alias: str | None = None
    others: tuple[str, ...] = ()

    @property
    def shown(self) -> str:
        """How a person reads it: its own part of a path, else the heading as it stands in the file."""
        return self.alias or self.text

    @property
    def short(self) -> str:
        """Its own part of a path, else the name without the unit."""
        return self.alias or self.name

    def called(self, name: str) -> bool:
        """Whether `name` is this column's text, name, alias or one of its other names."""
        return name in (self.text, self.name, self.alias, *self.others)


def parse_label(text: str, unit: str | None = None, path: str = "") -> Label:
    """A label from a heading such as ``slew [deg]``.

    Args:
        text: the heading.
        unit: unit known from elsewhere in the file, used where the heading has none.
        path: folder or struct it lies in, with its separator at the end.
    """
    found = _HEADER.fullmatch(text.strip())
    if found is None:  # a line break within the name
        return Label(text, " ".join(text.split()), unit)
    name = found["name"]
    written = found["unit"] if found["unit"] is not None else found["round"]
    if found["round"] is not None and (not name or ":" in written):  # MATLAB's data(:,2) is an index, no unit
        name, written = text.strip(), None
    chosen = _SAID.sub("", (written or "").strip()) or (unit or "").strip() or None
    return Label(path + text.strip(), path + name, chosen, name if path else None)


class Source(ABC):
    """An opened file.

    Attributes:
        path: the file.
        labels: its columns, in their order.
        constants: single numbers stored beside the columns (MAT files), which a mapping may use as gains.
        warnings: what the reader had to do to the file.
        settled: columns whose unit the user has said, by their index.
    """

    row_word = "row"

    def __init__(
        self, path: Path, labels: Sequence[Label], constants: dict[str, float] | None = None
    ) -> None:
        self.path = path
        self.labels = tuple(labels)
        self.constants = constants or {}
        self.warnings: list[str] = []
        self.settled: set[int] = set()

    @abstractmethod
    def read(self, indices: Sequence[int]) -> list[Array]:
        """The columns with these indices, each float64 (n,), owned by the caller; missing values are NaN.

        Raises:
            DataError: a value cannot be read, with its row and column.
        """

    def clock(self, index: int) -> Array | None:
        """The time stamps [s] that belong to one column alone, or None where all share a time column."""
        return None

    def row(self, index: int) -> int:
        """Number, as an editor or the writing program would count it, of the row with this index from 0."""
        return index + 1

    def at(self, index: int) -> str:
        """``row 12``, for messages."""
        return f"{self.row_word} {self.row(index)}"


def closest(name: str, known: Sequence[str]) -> str:
    """``; did you mean 'slew'?`` where a known name is near, else empty."""
    lowered = {candidate.lower(): candidate for candidate in known}
    near = get_close_matches(name.lower(), list(lowered), n=1, cutoff=0.6)
    return f"; did you mean '{lowered[near[0]]}'?" if near else ""


def digest(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextlib.contextmanager
def translated(path: Path, kind: str, notes: list[str] | None = None) -> Iterator[None]:
    """Turns whatever a format library raises on a damaged file into a `DataError`, and its warnings into notes.

    Raises:
        DataError: the library failed.
    """
    reason, before = "", _made_old()
    with warnings.catch_warnings(record=True) as caught, _logged() as logged:
        warnings.simplefilter("always")
        try:
            yield
        except CosimError:
            raise
        except Exception as error:  # a parser that meets damaged bytes fails in any way
            reason = _line(error) or type(error).__name__
            _dispose(error, before)
    if (
        reason
    ):  # not from within the handler: the error's frames would keep the parser's half-made objects alive
        raise DataError(f"{path}: cannot be read as a {kind} file: {reason}")
    if notes is not None:
        said = dict.fromkeys([*(_line(item.message) for item in caught), *logged])
        notes += [text for text in said if text not in notes]


def _line(message: object) -> str:
    return " ".join(str(message).split())[:200]


class _Collector(logging.Handler):
    def __init__(self, texts: list[str]) -> None:
        super().__init__(logging.WARNING)
        self.texts = texts

    def emit(self, record: logging.LogRecord) -> None:
        text, _, trace = record.getMessage().partition("Traceback")
        self.texts.append(
            f"{_line(text).rstrip(':')} ({_line(trace.splitlines()[-1])})" if trace else _line(text)
        )


@contextlib.contextmanager
def _logged() -> Iterator[list[str]]:
    """What the format libraries log at level warning and above, kept off stderr."""
    texts: list[str] = []
    handler = _Collector(texts)
    named = [*_LOGGERS, *(name for name in logging.root.manager.loggerDict if name.startswith(_INNER))]
    loggers = [logging.getLogger(name) for name in named]
    before = [(logger, logger.handlers, logger.propagate, logger.level) for logger in loggers]
    for logger in loggers:
        logger.handlers, logger.propagate = [handler], False
        logger.setLevel(
            logging.WARNING
        )  # asammdf asks for errors only, and warns of channels that it leaves out
    try:
        yield texts
    finally:
        for logger, handlers, propagate, level in before:
            logger.handlers, logger.propagate = handlers, propagate
            logger.setLevel(level)


def _made_old() -> int:
    """How often the collector has made objects old, which it then looks at only when it looks at all there are."""
    return sum(generation["collections"] for generation in gc.get_stats()[1:])


def _dispose(error: BaseException, before: int) -> None:
    """Frees what a parser that failed half-way has made; where its destructor fails too, nobody needs to hear of it.

    Args:
        error: with which it failed.
        before: `_made_old` when it began. What it has made is young as long as that has not changed, and young objects are
            few: in a large process a look at all of them takes half a second.
    """
    hook = sys.unraisablehook
    sys.unraisablehook = lambda event: None
    try:
        link: BaseException | None = error
        while link is not None:
            traceback.clear_frames(link.__traceback__)
            link.__traceback__, link = None, link.__cause__ or link.__context__
        gc.collect(1 if _made_old() == before else 2)
    finally:
        sys.unraisablehook = hook
