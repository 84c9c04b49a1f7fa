"""The command that a closed package plays."""

import csv
import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import DataError
from cosim.ssp.stimulus import default_command, stimulus_csv, stop_time


def test_default_command_is_a_sine_then_steps():
    times, command = default_command()
    assert times.shape == command.shape == (20001,)
    np.testing.assert_allclose(np.diff(times), 1e-3, rtol=0.0, atol=1e-12)
    sine = times < 4.0 * math.pi
    np.testing.assert_array_equal(command[sine], 0.5 * np.sin(times[sine]))
    assert [command[round(1000 * t)] for t in (13.0, 14.5, 15.0, 16.499, 16.5, 17.5, 18.6, 19.5, 20.0)] == [
        0.0, 0.0, 0.5, 0.5, 0.0, -0.5, 0.25, -0.75, 0.0
    ]  # fmt: skip


def test_default_command_starts_again():
    _, command = default_command(60.0)
    assert command.shape == (60001,)
    # stamps are k / 1000, so their remainders are equal to rounding only
    np.testing.assert_allclose(command[20000:40000], command[:20000], rtol=0.0, atol=1e-12)


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=50), st.floats(1e-4, 0.1))
def test_numbers_read_back_exactly(values, h):
    times, command = np.arange(len(values)) * h, np.array(values)
    data = stimulus_csv(times, command)
    rows = list(csv.reader(io.StringIO(data.decode())))
    assert rows[0] == ["time [s]", "u [1]"]
    np.testing.assert_array_equal(np.array(rows[1:], dtype=float), np.column_stack([times, command]))
    assert stop_time(data) == times[-1]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "no sample"),
        (b"time [s],u [1]\n", "no sample"),
        (b"t,u\n0,1\n0,2\n", "row 3: time must increase"),
        (b"t,u\n0,1\n1\n", "row 3: expected a time and a command"),
        (b"t,u\n0,1,2\n", "row 2: expected a time and a command"),
        (b"t,u\n0,x\n", "row 2: expected a time and a command"),
        (b"t,u\n0,inf\n", "row 2: time and command must be finite"),
    ],
)
def test_bad_data_are_refused_with_their_row(data, message):
    with pytest.raises(DataError, match=message):
        stop_time(data)


def test_shapes_must_agree():
    with pytest.raises(DataError, match="as many times as commands"):
        stimulus_csv(np.zeros(2), np.zeros(3))
