"""Slew mechanics (4.27), (4.28) without dry friction; test_friction.py has the rest."""

import math

import numpy as np
import pytest
from fmu_bench import bare, orders, ramp_response, run, with_fill
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from fmus.contract import Variable, equation

BLOCK = bare("mechanical")
J, B, AR = 763.9437268410978, 26661.636066754313, 8.4193e-3 * 0.1


@pytest.mark.parametrize("b", [0.0, 1.0, B, 100 * B])
@pytest.mark.parametrize("h", [1e-3, 0.05, 2.0])
def test_exact_for_a_pressure_on_straight_lines(b: float, h: float) -> None:
    pressure = np.random.default_rng(7).uniform(-12e5, 12e5, (60, 1))
    A = np.array([[0.0, 1.0], [0.0, -b / J]])
    expected = ramp_response(A, np.array([[0.0], [AR / J]]), [0.3, 0.0], pressure, h, [False])
    found = run(BLOCK, h, pressure[0], {"b": b, "theta_0": 0.3}).play(pressure[1:])
    # scipy's exponential squares its matrix up to ten times, and the angle of a drive without friction grows without bound
    assert np.abs(found - expected).max(axis=0) == pytest.approx(
        [0, 0], abs=1e-12 * (1 + np.abs(expected).max())
    )


@given(
    st.floats(-12e5, 12e5), st.floats(-12e5, 12e5), st.floats(-0.1, 0.1), st.floats(1e-4, 2.0), st.integers(2, 20)
)  # fmt: skip
def test_one_step_equals_many(old: float, new: float, omega: float, h: float, n: int) -> None:
    whole = run(BLOCK, h, [old], omega=omega).step(new)
    line = np.linspace(old, new, n + 1)[1:, None]
    assert whole == pytest.approx(tuple(run(BLOCK, h / n, [old], omega=omega).play(line)[-1]), abs=1e-14)


def test_gain_and_pole_of_the_identified_form() -> None:
    """7.5e-6/(s(s + 34.9)), deg per bar mm3 (SYSTEM section 6 and 9.1)."""
    p = run(BLOCK, 1e-3, [0.0]).p
    assert p.b / p.J == pytest.approx(34.9, rel=1e-12)
    assert math.degrees(1e-4 / p.J) == pytest.approx(7.5e-6, rel=1e-12)
    assert round(p.b, -1) == 26660
    r = run(BLOCK, 1.0, [1e5], torque=AR * 1e5)
    torque_in_source_units = 8419.3 * 100.0 * 1.0  # 1 bar
    assert math.degrees(r.step(1e5)[1]) == pytest.approx(torque_in_source_units * 7.5e-6 / 34.9, rel=1e-12)


def test_constant_load_is_a_torque_against_motion() -> None:
    """The drive rests where A r PL = tau_load."""
    outputs = run(BLOCK, 0.01, [1e5], {"tau_load": AR * 1e5}).play([[1e5]] * 100)
    assert np.abs(outputs).max() < 1e-18
    sinking = run(BLOCK, 2.0, [0.0], {"tau_load": 100.0}).step(0.0)
    assert sinking[1] == pytest.approx(-100.0 / B, rel=1e-12)


@equation
def trial_pendulum(s, theta, omega, x, m, p, c):
    """A torque that depends on the angle."""
    return p.trial * math.sin(theta - 0.3)


@equation
def trial_drag(s, theta, omega, x, m, p, c):
    """A torque that depends on the velocity."""
    return p.trial * omega * abs(omega)


@pytest.mark.parametrize(
    ("fill", "size", "load"),
    [
        (trial_pendulum, 3000.0, lambda theta, omega: 3000.0 * math.sin(theta - 0.3)),
        (trial_drag, 2e5, lambda theta, omega: 2e5 * omega * abs(omega)),
    ],
    ids=["angle", "velocity"],
)
def test_second_order_with_a_torque_that_depends_on_the_state(fill, size, load) -> None:
    """The torque at the step's end is predicted, so the error falls by four when the step is halved."""
    block = with_fill("mechanical", "load_torque", fill, trial=Variable("N.m", "size", 0.0, source="test"))
    end, top = 0.8, 20e5

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [y[1], (AR * top * t / end - load(*y) - 0.1 * B * y[1]) / J]

    exact = solve_ivp(rates, (0, end), [0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    errors = []
    for n in (20, 40, 80, 160):
        line = np.linspace(0.0, top, n + 1)[1:, None]
        last = run(block, end / n, [0.0], {"trial": size, "b": 0.1 * B}).play(line)[-1]
        errors.append(np.abs(last - exact)[0])
    assert errors[0] > 1e-7, "the term acts"
    assert orders(errors).min() > 1.75
