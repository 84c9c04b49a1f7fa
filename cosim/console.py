"""What every command shares for talking to a person (stderr) and to a program (one JSON object on stdout).

Heavy imports stay inside the functions, so that ``cosim --help`` is quick.
"""

import contextlib
import dataclasses
import datetime
import json
import math
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from enum import Enum
from functools import cache
from io import TextIOWrapper
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_NARROWEST, _WIDEST = 30, 1000  # characters
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")

Advance = Callable[[float], None]
"""Tells a progress bar how much is done by now, from 0 to its total."""


class OutputClosedError(Exception):
    """The reader of stdout went away, as ``head`` does; `cosim.cli` gives it an exit code of its own."""


@dataclasses.dataclass
class _JsonChannel:
    """Where the JSON object goes, and whether it went: `cosim.cli.main` opens it, `emit_json` fills it."""

    stream: TextIO | None = None
    used: bool = False


_channel = _JsonChannel()


Heard = Callable[[str, float], None]
"""Told what is going on, in a few words, and the share that is done, 0 to 1."""


@dataclasses.dataclass
class _Listener:
    """Who hears of progress and warnings in place of a person at a terminal."""

    progress: Heard | None
    warnings: list[str]


_listener: ContextVar[_Listener | None] = ContextVar("listener", default=None)
_on_screen: ContextVar[bool] = ContextVar("on_screen", default=False)


@contextlib.contextmanager
def on_screen() -> Iterator[None]:
    """Within this context `heard_by` changes nothing: the command line shows progress and warnings itself."""
    token = _on_screen.set(True)
    try:
        yield
    finally:
        _on_screen.reset(token)


@contextlib.contextmanager
def heard_by(progress: Heard | None) -> Iterator[list[str]]:
    """Within this context nothing is printed on stderr: `progress` is told, and warnings go into the list.

    The command line is left as it is.
    """
    warnings: list[str] = []
    token = _listener.set(None if _on_screen.get() else _Listener(progress, warnings))
    try:
        yield warnings
    finally:
        _listener.reset(token)


def told(description: str, share: float) -> bool:
    """Tell a listener of progress; True if there is one, so that nothing is to be shown."""
    listener = _listener.get()
    if listener is not None and listener.progress is not None:
        listener.progress(description, min(max(share, 0.0), 1.0))
    return listener is not None


@cache
def stderr_console() -> "Console":
    """The rich console on stderr: messages, tables and progress that must not mix with a JSON result."""
    return _plain_console()(stderr=True, highlight=False)


@cache
def stdout_console() -> "Console":
    """The rich console on stdout: a command's result for a person."""

    class PipedConsole(_plain_console()):  # type: ignore[misc]
        def on_broken_pipe(self) -> None:
            raise OutputClosedError  # rich's own would exit with 1

    return PipedConsole(highlight=False)


@cache
def _plain_console() -> "type[Console]":
    """A console on which no file's name and no file's content moves the cursor, and no number is cut off."""
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table

    class PlainConsole(Console):
        def print(self, *objects: Any, **options: Any) -> None:
            width = self.width
            for item in objects:
                if isinstance(
                    item, Table
                ):  # a narrow terminal breaks its lines; rich would leave columns out
                    own = self.options.update(width=_WIDEST)
                    self.width = max(self.width, Measurement.get(self, own, item).minimum)
            super().print(*(printable(o) if isinstance(o, str) else o for o in objects), **options)
            self.width = width

    return PlainConsole


def believable_width() -> None:
    """Forget a width of the terminal in which nothing fits: rich would print nothing but blanks."""
    if os.environ.get("COLUMNS", "").isdigit() and int(os.environ["COLUMNS"]) < _NARROWEST:
        del os.environ["COLUMNS"]


def utf8_streams() -> None:
    """Writes UTF-8 on stdout and stderr whatever the locale: a Windows pipe would fail on the first degree sign."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and (stream.encoding or "").lower().replace("-", "") != "utf8":
            stream.reconfigure(encoding="utf-8", errors="replace")


def to_jsonable(value: Any) -> Any:
    """A value as plain JSON types: NaN and infinity become None, arrays lists, paths text with forward slashes.

    Accepts mappings, sequences, sets, dataclasses, pydantic models, enums, dates, paths, numpy scalars and arrays.

    Raises:
        TypeError: a value has no JSON form; better a defect report than a silent ``repr``.
    """
    if value is None or (isinstance(value, (bool, str, int)) and not isinstance(value, Enum)):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    for kind, convert in _CONVERSIONS:
        if isinstance(value, kind):
            return convert(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_jsonable(getattr(value, field.name)) for field in dataclasses.fields(value)}
    for method in (
        "model_dump",
        "tolist",
    ):  # pydantic models; numpy arrays and scalars, without importing either
        if hasattr(value, method):
            return to_jsonable(getattr(value, method)())
    raise TypeError(f"a {type(value).__name__} has no JSON form: {value!r}")


_CONVERSIONS: tuple[tuple[Any, Callable[[Any], Any]], ...] = (
    (Enum, lambda value: to_jsonable(value.value)),
    (Mapping, lambda value: {str(key): to_jsonable(item) for key, item in value.items()}),
    ((set, frozenset), lambda value: sorted(to_jsonable(item) for item in value)),
    ((list, tuple), lambda value: [to_jsonable(item) for item in value]),
    (PurePath, lambda value: value.as_posix()),
    ((datetime.date, datetime.time), lambda value: value.isoformat()),
)


def emit_json(value: Any) -> None:
    """Prints one JSON object on stdout: the whole result of a command run with ``--json``, called once."""
    stream = _channel.stream or sys.stdout
    stream.write(json.dumps(to_jsonable(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    stream.flush()
    _channel.used = True


def json_emitted() -> bool:
    """Whether the running command has printed its JSON object."""
    return _channel.used


@contextlib.contextmanager
def json_only_stdout() -> Iterator[None]:
    """Keeps stdout for `emit_json` alone: what else is printed there, by libraries or native code too, goes to stderr.

    Native code writes to file descriptor 1, so that is moved as well where stdout is a real file.
    """
    original = sys.stdout
    with contextlib.ExitStack() as stack:
        stream: TextIO = original
        if original is sys.__stdout__ and original is not None:
            original.flush()
            kept = os.dup(1)
            stack.callback(os.close, kept)
            stream = open(kept, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            stack.callback(_closed, stream)
            os.dup2(2, 1)
            stack.callback(os.dup2, kept, 1)
            stack.callback(_flush_native)
            stack.callback(original.flush)
        stack.enter_context(contextlib.redirect_stdout(sys.stderr))
        _channel.stream, _channel.used = stream, False
        try:
            yield
        finally:
            _channel.stream = None


def _closed(stream: TextIO) -> None:
    """Close a stream of which `emit_json` has said already that it cannot be written."""
    with contextlib.suppress(OSError):
        stream.close()


def _flush_native() -> None:
    """Empties C's own buffers: what native code printed there would otherwise reach the real stdout at exit."""
    import ctypes

    (ctypes.CDLL("ucrtbase") if os.name == "nt" else ctypes.CDLL(None)).fflush(None)


@contextlib.contextmanager
def progress(description: str, total: float) -> Iterator[Advance]:
    """A progress bar on stderr, gone when done; nothing is drawn where stderr is no terminal.

    Args:
        description: what is going on, in a few words.
        total: the amount of work, in any unit.

    Yields:
        A function that takes the amount done so far.
    """
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    if told(description, 0.0):

        def tell(done: float) -> None:
            told(description, done / total if total else 1.0)

        yield tell
        return
    console = stderr_console()
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(description, total=total)
        yield lambda done: bar.update(task, completed=done)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> "Table":
    """A rich table of plain cells (markup in them is shown, not obeyed); floats get four significant digits."""
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    cells = [list(row) for row in rows]
    result = Table(title=escape(title) or None, box=SIMPLE_HEAD, title_justify="left")
    for index, name in enumerate(columns):
        numeric = bool(cells) and all(isinstance(row[index], (int, float)) for row in cells)
        # a name that is cut off cannot be typed
        result.add_column(
            escape(name),
            justify="right" if numeric else "left",
            overflow="fold" if index == 0 else "ellipsis",
            no_wrap=numeric,
        )
    for row in cells:
        shown = (f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row)
        result.add_row(*(escape(printable(cell)) for cell in shown))
    return result


def warn(message: str) -> None:
    """One line on stderr that starts with a yellow ``warning:``; a listener keeps it instead."""
    listener = _listener.get()
    if listener is not None:
        listener.warnings.append(message)
        return
    _line("warning:", "yellow", message)


def fail(message: str) -> None:
    """One line on stderr that starts with a red ``error:``."""
    _line("error:", "red", message)


def typed(path: object) -> str:
    """A path as it is typed at a prompt: in quotation marks where a shell would take a part of it for something else."""
    text = str(path)
    if os.name == "nt":
        return f'"{text}"' if re.search(r"[\s&()^;,]", text) else text
    if text.startswith("-"):
        text = f"./{text}"  # no option
    if not text.isprintable():  # a line's end or an escape sequence, as the shell writes them
        return f"$'{''.join(map(_escaped, text))}'"
    # letters of any language need no quotation marks, unlike in shlex.quote
    return text if re.fullmatch(r"[\w@%+=:,./~-]+", text) else shlex.quote(text)


def _escaped(letter: str) -> str:
    if letter in "\\'":
        return f"\\{letter}"
    if letter.isprintable():
        return letter
    return f"\\x{ord(letter):02x}" if ord(letter) < 0x80 else f"\\U{ord(letter):08x}"


def printable(text: str) -> str:
    """The text with its control characters as a sign: of a file of others they would move a terminal's cursor."""
    return _CONTROL.sub("\N{REPLACEMENT CHARACTER}", text.replace("\r\n", "\n"))


def _line(label: str, colour: str, message: str) -> None:
    from rich.text import Text

    stderr_console().print(Text.assemble((label, f"bold {colour}"), " ", printable(message)), soft_wrap=True)
