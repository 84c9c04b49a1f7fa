"""JSON of everything a command may return; tables."""

import dataclasses
import datetime
import enum
import json
import math
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
