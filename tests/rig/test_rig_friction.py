"""Dry friction: true sticking, breakaway, sliding, and the bristle form of the same."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_helpers import LEVER, B, J, clean, held
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

K, K_C = 2.375e-3, 5.28e8
TORQUE = K * K_C * LEVER  # N.m at full command
RAMP = np.linspace(0.05, 1.0, 8000)


@pytest.mark.parametrize("sign", [1, -1])
def test_breaks_away_at_the_level_in_both_directions(sign):
    run = clean(sign * RAMP, "mechanical.coulomb_friction:tau_c=300 N.m")
    moving = np.flatnonzero(run.true["omega"] != 0.0)[0]
    torque = np.abs(run.true["p_load"]) * LEVER
    assert torque[moving - 1] <= 300.0 < torque[moving]
    assert np.all(run.true["theta"][:moving] == run.true["theta"][0])
    assert np.all(sign * run.true["omega"][moving:] > 0)


def test_static_friction_holds_for_ever_without_creep():
    run = clean(held((0.25, 20.0)), "mechanical.coulomb_friction:tau_c=300 N.m", start=0.1)
    assert 250 < run.true["p_load"][-1] * LEVER < 300
    assert np.all(run.true["omega"] == 0.0)
    assert np.all(run.slew == 0.1)


@settings(max_examples=25, deadline=None)
@given(level=st.floats(5.0, 900.0), u=st.floats(0.1, 1.0))
def test_settled_speed_is_the_excess_over_friction(level, u):
    run = clean(held((u, 4.0)), f"mechanical.coulomb_friction:tau_c={level} N.m")
    demand = u + 0.45 * np.tanh(50 * u) - 0.45
    expected = max(K * K_C * demand * LEVER - level, 0.0) / B
    assert run.true["omega"][-1] == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_coasts_to_an_exact_stop_and_stays():
    run = clean(held((0.8, 3.0), (0.0, 3.0)), "mechanical.coulomb_friction:tau_c=300 N.m")
    omega, load = run.true["omega"], run.true["p_load"]
    first = 3000 + np.flatnonzero(omega[3000:] == 0.0)[0]
    assert np.all(omega[first:] == 0.0)
    # the stop by an integrator with event detection, driven by the log's pressure
    t = np.arange(load.size) * 1e-3
    stop = solve_ivp(
        lambda s, w: (np.interp(s, t, load) * LEVER - B * w - 300.0) / J,
        (3.0, 6.0), [omega[3000]], events=_zero, rtol=1e-10, atol=1e-12, max_step=1e-3,
    )  # fmt: skip
    assert first * 1e-3 == pytest.approx(stop.t_events[0][0], abs=1e-3)


def _zero(_, w):
    return w[0]


_zero.terminal = True


def test_friction_reverses_with_the_motion():
    run = clean(held((0.8, 3.0), (-0.8, 3.0)), "mechanical.coulomb_friction:tau_c=200 N.m")
    assert run.true["omega"][2999] == pytest.approx((0.8 * TORQUE - 200.0) / B, rel=1e-6)
    assert run.true["omega"][-1] == pytest.approx(-(0.8 * TORQUE - 200.0) / B, rel=1e-6)


def test_stribeck_breaks_away_high_and_slides_low():
    run = clean(RAMP, "mechanical.stribeck_friction:tau_c=100 N.m,tau_s=200 N.m,omega_s=0.002 rad/s")
    torque = run.true["p_load"] * LEVER
    moving = np.flatnonzero(run.true["omega"] != 0.0)[0]
    assert torque[moving - 1] <= 300.0 < torque[moving]
    assert run.true["omega"][-1] * B == pytest.approx(torque[-1] - 100.0, rel=0.02)


@pytest.mark.parametrize("friction", ["sharp", "lugre", "smooth"])
@pytest.mark.parametrize("u", [0.4, 0.6, 1.0])
def test_settled_sliding_is_on_the_stribeck_curve(friction, u):
    hidden = "mechanical.stribeck_friction:tau_c=100 N.m,tau_s=80 N.m,omega_s=0.02 rad/s"
    run = clean(held((1.0, 1.0), (u, 6.0)), hidden, friction=friction)
    expected = brentq(
        lambda w: u * TORQUE - B * w - 100.0 - 80.0 * np.exp(-((w / 0.02) ** 2)), 0.0, 0.1, xtol=1e-14
    )
    assert run.true["omega"][-1] == pytest.approx(expected, rel=1e-5)


def test_bristles_give_before_they_break_away_and_spring_back():
    run = clean(held((0.25, 4.0), (0.0, 4.0)), "mechanical.coulomb_friction:tau_c=300 N.m", friction="lugre")
    travel = run.slew - run.slew[0]
    torque = run.true["p_load"][3999] * LEVER
    assert 0.5 * 2e-5 * torque / 300 < travel[3999] < 2e-3  # the bristles' own travel, and their known drift
    nearer = np.abs(travel[-1]) < np.abs(travel[3999])
    assert nearer


def test_bristle_and_sharp_friction_agree_beyond_the_bristles():
    u = held((0.8, 3.0), (-0.6, 3.0), (0.0, 2.0))
    sharp, lugre = (
        clean(u, "mechanical.coulomb_friction:tau_c=300 N.m", friction=form).slew
        for form in ("sharp", "lugre")
    )
    # a few bristle travels (2e-5 rad) a reversal, well below the sensor's noise of 1.7e-4 rad
    assert 2e-6 < np.max(np.abs(sharp - lugre)) < 1.2e-4


def test_smooth_friction_creeps_where_sharp_friction_holds():
    u = held((0.25, 4.0))
    sharp, smooth = (
        clean(u, "mechanical.coulomb_friction:tau_c=300 N.m", friction=form) for form in ("sharp", "smooth")
    )
    assert np.ptp(sharp.slew) == 0.0
    torque = smooth.true["p_load"][-1] * LEVER
    # the speed at which 300 tanh(w/5e-4) and what is viscous take up the torque
    expected = brentq(lambda w: torque - B * w - 300.0 * np.tanh(w / 5e-4), 0.0, 0.01, xtol=1e-15)
    assert smooth.true["omega"][-1] == pytest.approx(expected, rel=1e-3)
