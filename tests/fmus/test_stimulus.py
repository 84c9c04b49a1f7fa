"""Stimulus: a table played, held or on straight lines."""

import numpy as np
import pytest
from fmu_bench import Run, bare, run
from hypothesis import given
from hypothesis import strategies as st

BLOCK = bare("stimulus")
TIMES = [0.0, 0.1, 0.25, 1.0]
VALUES = [0.5, -1.0, 0.75, 0.0]


def player(**parameters: float) -> Run:
    return run(BLOCK, 1e-3, [0.0], parameters, [TIMES, VALUES])


def test_holds_each_sample_until_the_next() -> None:
    r = player()
    found = [r.step(t)[0] for t in (0.05, 0.0999, 0.1, 0.2, 0.25, 0.9, 1.0, 7.0)]
    assert found == [0.5, 0.5, -1.0, -1.0, 0.75, 0.75, 0.0, 0.0]


@given(st.lists(st.floats(-0.5, 2.0), min_size=1, max_size=20).map(sorted))
def test_straight_lines(times: list[float]) -> None:
    r = player(hold=0.0)
    found = [r.step(t)[0] for t in times]
    assert found == pytest.approx(
        np.interp(times, TIMES, VALUES), abs=2e-8
    )  # a nanosecond of grace, times the slope


def test_gain() -> None:
    assert player(gain=0.75).step(0.1)[0] == -0.75


def test_a_sample_is_not_missed_for_rounding_of_the_masters_clock() -> None:
    """k * h of a master lies a few bits beside the table's stamp: each sample still begins with its own step."""
    stamps = [round(k * 1e-3, 6) for k in range(2000)]
    values = [float(k % 7) for k in range(2000)]
    r = run(BLOCK, 1e-3, [0.0], {}, [stamps, values])
    time, accumulated = 0.0, []
    for _ in range(1999):
        time += 1e-3  # accumulated, as poor masters do
        accumulated.append(r.step(time)[0])
    assert accumulated == values[1:]


def test_starts_with_the_sample_at_the_start_time() -> None:
    module = BLOCK.module
    r = player()
    assert module.output(r.x, module.Input(0.12), r.m, r.p).u == -1.0
