"""Ends of the travel of both mechanics, the range of the sensor, and the states at the start."""

import math

import numpy as np
import pytest
from fmu_bench import bare, run
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

MECHANICAL, SIMPLIFIED, SENSOR = bare("mechanical"), bare("simplified"), bare("sensor")
AR = 8.4193e-3 * 0.1
ENDS = {"theta_min": -0.02, "theta_max": 0.03}
pressures = st.lists(st.floats(-12e5, 12e5), min_size=2, max_size=40)


@given(pressures, st.sampled_from([0.0, 80.0]), st.floats(1e-3, 0.3))
def test_the_column_stays_between_the_ends_and_rests_on_them(p: list[float], tau_c: float, h: float) -> None:
    r = run(MECHANICAL, h, [p[0]], ENDS | {"tau_c": tau_c}, torque=AR * p[0])
    for value in p[1:]:
        theta, omega = r.step(value)
        assert ENDS["theta_min"] <= theta <= ENDS["theta_max"]
        assert theta < ENDS["theta_max"] or omega <= 0.0
        assert theta > ENDS["theta_min"] or omega >= 0.0


@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=40), st.floats(1e-3, 0.3))
def test_so_does_the_simplified_drive(u: list[float], h: float) -> None:
    found = run(SIMPLIFIED, h, [u[0]], ENDS).play([[v] for v in u[1:]])
    assert np.all((found[:, 0] >= ENDS["theta_min"]) & (found[:, 0] <= ENDS["theta_max"]))


def test_it_leaves_an_end_as_soon_as_the_torque_turns() -> None:
    """Against LSODA from the end, at rest: only the way from the instant at which the torque turns counts."""
    r = run(MECHANICAL, 1e-3, [1e5], ENDS, torque=AR * 1e5)
    r.play([[1e5]] * 20000)
    assert r.x.theta == ENDS["theta_max"]
    assert r.x.omega == 0.0
    found = r.play([[-1e5]] * 500)[-1]
    p = r.p
    exact = solve_ivp(
        lambda _, y: [y[1], (-1e5 * AR - p.b * y[1]) / p.J], (0.0, 0.5), [0.03, 0.0], "LSODA", rtol=1e-10
    )
    # the first step holds the turn of the torque: half a step of motion at most
    assert found == pytest.approx(exact.y[:, -1], abs=1e-3 * 1e5 * AR / p.b)


@pytest.mark.parametrize("block", [MECHANICAL, SIMPLIFIED])
def test_an_end_out_of_reach_changes_no_bit(block) -> None:
    rng = np.random.default_rng(1)
    rows = rng.uniform(-1.0, 1.0, (200, 1)) * (1e6 if block is MECHANICAL else 1.0)
    plain, ended = (run(block, 0.01, rows[0], p).play(rows) for p in ({}, {"theta_max": 900.0}))
    assert np.array_equal(plain, ended)


@given(st.floats(-3.0, 3.0), st.floats(-1.0, 0.0), st.floats(0.0, 1.0))
def test_the_sensor_saturates(theta: float, low: float, high: float) -> None:
    r = run(SENSOR, 1e-3, [theta], {"low": low, "high": high})
    assert r.x.slew == r.step(theta)[0] == min(high, max(low, theta))


def test_states_at_the_start() -> None:
    assert run(MECHANICAL, 1e-3, [0.0], {"theta_0": 0.1, "omega_0": -0.2}).x[:2] == (0.1, -0.2)
    assert run(SIMPLIFIED, 1e-3, [0.0], {"theta_0": 0.1, "omega_0": -0.2}).x[:2] == (0.1, -0.2)
    assert run(bare("dcv"), 1e-3, [0.0], {"spool_0": 1e-3}).x.spool == 1e-3
    assert run(bare("continuity"), 1e-3, [1e-3], {"p_load_0": 3e5}).x.p_load == 3e5


def test_a_velocity_at_the_start_dies_out_as_viscous_friction_says() -> None:
    r = run(MECHANICAL, 1e-3, [0.0], {"omega_0": 0.05})
    found = r.play([[0.0]] * 40)[-1]
    assert found[1] == pytest.approx(0.05 * math.exp(-34.9 * 0.04), rel=1e-9)
