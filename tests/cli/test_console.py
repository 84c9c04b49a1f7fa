"""JSON of everything a command may return; tables."""

import dataclasses
import datetime
import enum
import io
import json
import math
import os
import shutil
import subprocess
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np
import pydantic
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from cosim import console


class _Colour(enum.StrEnum):
    RED = "red"


@dataclasses.dataclass
class _Pair:
    a: float
    b: Any


class _Model(pydantic.BaseModel):
    x: float


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (float("nan"), None),
        (float("-inf"), None),
        (np.float64("nan"), None),
        (np.float32(0.5), 0.5),
        (np.int64(3), 3),
        (np.bool_(True), True),
        (np.array([[1.0, math.inf], [2.0, 3.0]]), [[1.0, None], [2.0, 3.0]]),
        (_Colour.RED, "red"),
        (_Pair(1.0, (1, 2)), {"a": 1.0, "b": [1, 2]}),
        (_Model(x=2.0), {"x": 2.0}),
        ({1: {"b", "a"}}, {"1": ["a", "b"]}),
        (PureWindowsPath("a\\b"), "a/b"),
        (PurePosixPath("a/b"), "a/b"),
        (datetime.date(2024, 2, 29), "2024-02-29"),
        (True, True),
    ],
)
def test_to_jsonable(value: Any, expected: Any) -> None:
    result = console.to_jsonable(value)
    assert result == expected
    assert type(result) is type(expected)


def test_what_has_no_json_form_is_refused() -> None:
    with pytest.raises(TypeError, match="object has no JSON form"):
        console.to_jsonable({"a": [object()]})


_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.tuples(inner, inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@given(_values)
def test_result_is_always_strict_json_and_stays_as_it_is(value: Any) -> None:
    plain = console.to_jsonable(value)
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert console.to_jsonable(plain) == plain


def test_emit_json_writes_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    console.emit_json({"x": np.arange(2)})
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {"x": [0, 1]}
    assert captured.err == ""


def test_table_shows_markup_and_aligns_numbers() -> None:
    recorder = Console(width=60)
    with recorder.capture() as captured:
        recorder.print(console.table("t", ["name [unit]", "value"], [["[red]a", 1.23456], ["b", 1234567.0]]))
    text = captured.get()
    assert "name [unit]" in text
    short, long = (
        next(line for line in text.splitlines() if name in line).rstrip() for name in ("[red]a", " b ")
    )
    assert short.endswith("    1.235")
    assert long.endswith("1.235e+06")
    assert len(short) == len(long)


def test_progress_is_silent_where_nobody_watches(capsys: pytest.CaptureFixture[str]) -> None:
    with console.progress("working", 10.0) as advance:
        advance(5.0)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "working" not in captured.err


@pytest.mark.skipif(shutil.which("bash") is None, reason="a shell that reads what is shown")
@pytest.mark.parametrize(
    "name",
    ["-log.csv", "new\nline.csv", "\x1b[2Jcleared.csv", "it's\t\\n.csv", "\x85.csv", "März 🚜.csv", "a b"],
)
def test_a_name_as_it_is_shown_can_be_typed(name: str) -> None:
    shown = console.typed(name)
    assert shown.isprintable()
    given = subprocess.run(["bash", "-c", f"printf %s {shown}"], capture_output=True, check=True, text=False)
    assert given.stdout.decode().removeprefix("./") == name
    assert not given.stdout.startswith(b"-")


@pytest.mark.parametrize("which", [console.stdout_console, console.stderr_console])
def test_no_name_moves_the_cursor(which: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    own = which()
    monkeypatch.setattr(own, "_file", io.StringIO())
    own.print("a\x1b[2Jb\nc\x9b1mlog.csv", markup=False)
    assert own.file.getvalue() == "a�[2Jb\nc�1mlog.csv\n"


def test_a_narrow_terminal_gets_every_number_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    own = console.stdout_console()
    monkeypatch.setattr(own, "_file", io.StringIO())
    monkeypatch.setattr(own, "_width", 40)
    numbers = [1.2345e-5, -67.89, 1234.0, 0.5432, 98.76]
    own.print(console.table("", ["signal", *"abcde"], [["a signal of some length", *numbers]]))
    text = own.file.getvalue()
    assert all(f"{number:.4g}" in text for number in numbers)
    assert own.width == 40


def test_a_width_in_which_nothing_fits_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    for width, kept in (
        ("0", False),
        ("1", False),
        ("20", False),
        ("30", True),
        ("200", True),
        ("wide", True),
    ):
        monkeypatch.setenv("COLUMNS", width)
        console.believable_width()
        assert ("COLUMNS" in os.environ) == kept, width
