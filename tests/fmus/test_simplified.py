"""Simplified drive: theta/u = 10/(s(s + 4.4)) deg (4.15), (5.1)."""

import math

import numpy as np
import pytest
from fmu_bench import bare, ramp_response, run
from hypothesis import given
from hypothesis import strategies as st

BLOCK = bare("simplified")
K, POLE = math.radians(10.0), 4.4


@pytest.mark.parametrize("h", [1e-3, 0.1, 3.0])
@pytest.mark.parametrize("pole", [0.0, 1e-9, 4.4, 300.0])
def test_exact_for_a_held_command(h: float, pole: float) -> None:
    u = np.random.default_rng(4).uniform(-1, 1, (50, 1))
    A, B = np.array([[0.0, 1.0], [0.0, -pole]]), np.array([[0.0], [K]])
    expected = ramp_response(A, B, [0.2, 0.0], u, h, [True])
    found = run(BLOCK, h, u[0], {"a": pole, "theta_0": 0.2}).play(u[1:])
    # rounding of the angle grows with the angle
    assert np.abs(found - expected).max() < 1e-13 * (1.0 + np.abs(expected).max())


@given(st.floats(-1, 1), st.floats(-0.1, 0.1), st.floats(1e-4, 5.0), st.integers(2, 20))
def test_one_step_equals_many(u: float, omega: float, h: float, n: int) -> None:
    whole = run(BLOCK, h, [0.0], omega=omega).step(u)
    parts = run(BLOCK, h / n, [0.0], omega=omega).play([[u]] * n)[-1]
    assert whole == pytest.approx(tuple(parts), rel=1e-13, abs=1e-14)


def test_low_frequency_gain() -> None:
    """10/4.4 = 2.27 deg/s per unit command (SYSTEM section 7)."""
    omega = run(BLOCK, 0.01, [0.0]).play([[1.0]] * 1000)[-1, 1]
    assert math.degrees(omega) == pytest.approx(10 / 4.4, rel=1e-12)
    assert round(math.degrees(omega), 2) == 2.27


def test_starts_at_theta_0_and_rests_without_a_command() -> None:
    outputs = run(BLOCK, 0.01, [0.0], {"theta_0": 0.7}).play([[0.0]] * 100)
    assert np.all(outputs[:, 0] == 0.7)
    assert np.all(outputs[:, 1] == 0.0)
