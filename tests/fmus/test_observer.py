"""Observer (2.15), (4.35)-(4.38): gains, poles, exactness, and that it finds the true state."""

import math

import numpy as np
import pytest
from fmu_bench import bare, ramp_response, run
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.signal import place_poles

BLOCK = bare("observer")
A = np.array([[-4.4, 0.0], [1.0, 0.0]])  # (4.35)
B = np.array([4.0, 0.0])  # (4.36)
C = np.array([0.0, 2.5])  # (4.37), deg
C_RAD = np.radians(C)
L_SOURCE = np.array([7.744, 6.16])  # per deg


def gains() -> np.ndarray:
    """L as the block computes it, per degree."""
    return np.radians(BLOCK.module.gains(run(BLOCK, 1e-3, [0.0, 0.0]).p))


def test_gains_are_the_printed_ones() -> None:
    assert gains() == pytest.approx(L_SOURCE, abs=5e-13)


def test_gains_are_those_of_scipys_pole_placement() -> None:
    placed = place_poles(A.T, C[:, None], [-13.2, -6.6]).gain_matrix[0]
    assert gains() == pytest.approx(placed, rel=1e-9)


@given(st.floats(-50.0, -1.0), st.floats(-50.0, -1.0))
def test_poles_are_where_they_were_chosen(p1: float, p2: float) -> None:
    p = run(BLOCK, 1e-3, [0.0, 0.0], {"p1": p1, "p2": p2}).p
    closed = A - np.outer(BLOCK.module.gains(p), C_RAD)
    # by trace and determinant: the roots themselves are ill-conditioned where the two poles meet
    assert np.trace(closed) == pytest.approx(p1 + p2, rel=1e-12)
    assert np.linalg.det(closed) == pytest.approx(p1 * p2, rel=1e-11)


@pytest.mark.parametrize("h", [1e-4, 1e-3, 0.03, 1.0])
def test_exact_for_a_held_command_and_a_slew_on_straight_lines(h: float) -> None:
    rng = np.random.default_rng(5)
    inputs = np.column_stack([rng.uniform(-1, 1, 60), rng.uniform(0, 1, 60)])
    L = np.radians(L_SOURCE) * (180 / math.pi) ** 2  # per rad
    states = ramp_response(
        A - np.outer(L, C_RAD),
        np.column_stack([B, L]),
        [0.0, inputs[0, 1] / C_RAD[1]],
        inputs,
        h,
        [True, False],
    )
    found = run(BLOCK, h, inputs[0]).play(inputs[1:])
    expected = C_RAD[1] * states[:, ::-1]
    # the ramp's weight is a difference of two numbers of size 1 over h: rounding / (6.6 h)
    assert np.abs(found - expected).max() < 1e-14 * (10.0 + 10.0 / (6.6 * h))


def test_one_step_equals_many() -> None:
    for n in (2, 7, 40):
        whole = run(BLOCK, 0.2, [0.0, 0.1]).step(0.5, 0.3)
        rows = np.column_stack([np.full(n, 0.5), np.linspace(0.1, 0.3, n + 1)[1:]])
        parts = run(BLOCK, 0.2 / n, [0.0, 0.1]).play(rows)[-1]
        assert whole == pytest.approx(tuple(parts), rel=1e-12)


def test_a_wrong_estimate_decays_with_the_chosen_poles() -> None:
    """The plant stands at 0.3 rad; the error follows exp((A - L C) t), so its slowest part is exp(-6.6 t)."""
    h, angle, wrong = 1e-3, 0.3, np.array([0.5, -4.0])
    r = run(BLOCK, h, [0.0, angle], x1=wrong[0], x2=angle / C_RAD[1] + wrong[1])
    found = r.play([[0.0, angle]] * 2000) - [angle, 0.0]
    closed = A - np.outer(L_SOURCE, C)
    for k in (1, 100, 500, 2000):
        expected = C_RAD[1] * (expm(closed * h * k) @ wrong)[::-1]
        assert found[k - 1] == pytest.approx(expected, abs=1e-12)
    late = found[1000:1500:100, 0]
    assert np.log(late[1:] / late[:-1]) / (100 * h) == pytest.approx(-6.6, rel=1e-2)


def test_it_starts_at_zero_as_in_the_source_and_the_error_follows_2_16() -> None:
    """Plant and observer see the same command; the plant starts turning at 2 deg, the estimate at rest at zero."""
    h, n = 1e-3, 1500
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-1, 1, 15), 101)[: n + 1]
    x0 = np.array([0.4, 0.8])
    plant = ramp_response(A, B[:, None], x0, u[:, None], h, [True])
    slew = C_RAD[1] * np.concatenate([[x0[1]], plant[:, 1]])
    start = {"at_reading": 0.0, "slew_0": 0.0, "rate_0": 0.0}
    r = run(BLOCK, h, [u[0], slew[0]], start)
    assert r.x[:2] == (0.0, 0.0)
    found = r.play(np.column_stack([u[1:], slew[1:]]))
    e = C_RAD[1] * plant[:, ::-1] - found
    closed = A - np.outer(L_SOURCE, C)
    for k in (1, 50, 200, 700):
        # the plant's angle bends where the block takes chords: (h/2)^2/3 of its acceleration, held by the slowest pole
        assert e[k - 1] == pytest.approx(C_RAD[1] * (expm(closed * h * k) @ x0)[::-1], abs=2e-7)


def test_a_start_of_its_own_is_where_it_begins() -> None:
    first = run(BLOCK, 1e-3, [0.0, 0.5], {"at_reading": 0.0, "slew_0": 0.2, "rate_0": -0.1})
    assert BLOCK.module.output(first.x, None, None, first.p) == pytest.approx((0.2, -0.1))


def test_it_finds_the_plant_it_was_made_for() -> None:
    """Plant (4.35)-(4.37) under a stepped command, observer started at a wrong velocity: the error dies out."""
    h, n = 1e-3, 3000
    u = np.where(np.arange(n + 1) % 1000 < 500, 1.0, -0.6)
    plant = ramp_response(A, B[:, None], [0.7, 1.0], u[:, None], h, [True])
    slew = C_RAD[1] * plant[:, 1]
    found = run(BLOCK, h, [0.0, C_RAD[1]]).play(np.column_stack([u[1:], slew]))
    error = found - C_RAD[1] * plant[:, ::-1]
    assert np.abs(error[0]).max() > 1e-3 * abs(found).max()
    # the plant's angle bends between samples where the block takes a chord: h^2/8 of the acceleration remains
    assert np.abs(error[-1]).max() < 1e-6
