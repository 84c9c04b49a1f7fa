"""What a person can say, and what is refused."""

import os
import time

import pytest

from cosim.errors import DataError, UsageError
from cosim.live.operator import Lines, Operator, read_script


def after(*lines):
    operator = Operator()
    for line in lines:
        operator.obey(line)
    return operator


def test_commands_modes_enables_and_target() -> None:
    operator = after("0.3", "u2 -0.5", " U3 1 ", "auto", "target 0.5 rad", "enable 3", "disable 1")
    assert operator.manual == [0.3, -0.5, 1.0]
    assert operator.automatic
    assert operator.target == pytest.approx(28.6479, rel=1e-5)
    assert operator.enables == [False, False, True]
    assert not after("auto", "manual").automatic


def test_an_emergency_stop_stays_until_reset_which_wants_nothing() -> None:
    operator = after("u 0.7", "auto", "stop", "u 0.2", "auto")
    assert operator.stopped
    operator.obey("reset")
    assert (operator.stopped, operator.automatic, operator.manual) == (False, False, [0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("u 1.01", "a command lies within -1 to 1"),
        ("u nan", "a command lies within -1 to 1"),
        ("u", "cannot be read"),
        ("fly", "a line is one of u, u2"),
        ("stop now", "'stop' stands alone"),
        ("enable 4", "enable 1, 2 or 3"),
        ("target", "target ANGLE"),
        ("target 999 deg", "from -30 to 280 deg"),
        ("target 3 bar", "bar"),
    ],
)
def test_what_cannot_be_read_changes_nothing(line, message) -> None:
    operator = after("u 0.25")
    before = vars(operator).copy()
    with pytest.raises(UsageError, match=message):
        operator.obey(line)
    assert vars(operator) == before


def test_a_script_has_times(tmp_path) -> None:
    path = tmp_path / "script.txt"
    path.write_text("# a run\n0 u 0.2\n\n1.5 auto  # closed\n1.5 target 20 deg\n")
    assert read_script(path) == [(0.0, "u 0.2"), (1.5, "auto"), (1.5, "target 20 deg")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 u 0.2\nsoon auto\n", "row 2: 'soon' is no time in s"),
        ("2 auto\n1 manual\n", "row 2: times start at 0 and rise"),
        ("0 u 7\n", "row 1: .*within -1 to 1"),
    ],
)
def test_a_bad_script_is_refused_with_its_row(tmp_path, text, message) -> None:
    path = tmp_path / "script.txt"
    path.write_text(text)
    with pytest.raises(DataError, match=message):
        read_script(path)


def test_lines_come_whole_however_they_are_cut() -> None:
    reader, writer = os.pipe()
    lines = Lines(reader)
    assert lines.take() is None
    for part in (b"u 0", b".5\nau", b"to\n\n"):
        os.write(writer, part)
        time.sleep(0.01)
    os.close(writer)
    found, until = [], time.monotonic() + 60.0
    while len(found) < 2 and time.monotonic() < until:
        line = lines.take()
        found += [line] if line else []
    assert found == ["u 0.5", "auto"]
