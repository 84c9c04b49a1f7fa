"""The unknown causes do what docs/rig.md says they do."""

import numpy as np
import pytest
from rig_helpers import LEVER, B, J, clean, follows, held, lively
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

K, K_C, P_S = 2.375e-3, 5.28e8, 170e5
TORQUE = K * K_C * LEVER


def test_quadratic_drag_settles_at_the_root():
    run = clean(held((-0.8, 5.0)), "unknown.quadratic_drag:q_drag=3e5")
    root = brentq(lambda w: 0.8 * TORQUE - B * w - 3e5 * w * w, 0.0, 0.1, xtol=1e-15)
    assert run.true["omega"][-1] == pytest.approx(-root, rel=1e-6)


def test_valve_gain_warms_exponentially():
    run = clean(held((0.6, 20.0)), "unknown.warming_valve:g_warm=0.2,tau_warm=6 s")
    x = run.true["spool"]
    for k in (8000, 14000, 19999):
        t = k * 1e-3 - 2 * 0.545 / 25.23  # the valve follows a slow ramp late by 2 zeta / w0
        assert x[k] == pytest.approx(0.6 * K * (1 + 0.2 * (1 - np.exp(-t / 6.0))), rel=2e-5)


def test_burst_is_confined_and_is_the_stated_torque():
    t = np.arange(8001) * 1e-3
    hidden = "unknown.torque_burst:tau_burst=500 N.m,t_burst=2 s,d_burst=3 s,w_burst=7 rad/s"
    run, quiet = clean(np.full(t.size, 0.5), hidden), clean(np.full(t.size, 0.5))
    assert np.array_equal(run.slew[:2001], quiet.slew[:2001])
    age = t - 2.0
    inside = (age > 0) & (age < 3.0)
    torque = np.where(inside, 500 * np.sin(np.pi * age / 3.0) ** 2 * np.cos(7.0 * (age - 1.5)), 0.0)
    expected = follows([1.0], [J, B, 0.0], torque)
    assert np.max(np.abs(run.slew - quiet.slew - expected)) < 2e-8  # the reference joins the torque by lines
    assert np.max(np.abs(expected)) > 1e-4


def test_pressure_friction_takes_its_share_of_the_torque():
    run = clean(held((0.8, 4.0)), "unknown.pressure_friction:kappa=0.3")
    assert run.true["omega"][-1] == pytest.approx(0.7 * 0.8 * TORQUE / B, rel=1e-6)


def test_inertia_over_angle_obeys_lagrange():
    run = clean(lively(3.0), "unknown.angle_inertia:j_theta=0.6,n_theta=60", start=0.2)
    t, load = run.time, run.true["p_load"]

    def rates(s, y):
        inertia = J * (1 + 0.6 * np.sin(60 * y[0]))
        slope = J * 0.6 * 60 * np.cos(60 * y[0])
        return y[1], (np.interp(s, t, load) * LEVER - B * y[1] - 0.5 * slope * y[1] ** 2) / inertia

    truth = solve_ivp(rates, (0, t[-1]), (0.2, 0.0), max_step=2e-3, rtol=1e-9, atol=1e-12).y[0, -1]
    assert run.slew[-1] == pytest.approx(truth, abs=1e-6)
    assert abs(run.slew[-1] - clean(lively(3.0), start=0.2).slew[-1]) > 1e-5


def test_small_motion_is_damped_more_than_large():
    def overshoot(low, high, *hidden):
        x = clean(held((low, 1.5), (high, 1.5)), *hidden).true["spool"] / K
        return (x[1500:].max() - high) / (high - low)

    hidden = "dcv.amplitude_damping:c_a=2,u_a=0.17"
    assert overshoot(0.5, 0.55) == pytest.approx(overshoot(-0.5, 0.5), rel=1e-6)
    assert overshoot(0.5, 0.55, hidden) < 0.1 * overshoot(0.5, 0.55)
    assert overshoot(0.5, 0.55, hidden) < overshoot(-0.5, 0.5, hidden) < overshoot(-0.5, 0.5)


@pytest.mark.parametrize("sign", [1, -1])
def test_orifice_flow_balances(sign):
    run = clean(held((sign * 0.9, 5.0)), "continuity.flow_pressure:c_q=2.5e-7")
    root = brentq(lambda p: K_C * 0.9 * K * np.sqrt(1 - p / 40e5) - p, 0.0, 40e5)
    assert run.true["p_load"][-1] == pytest.approx(sign * root, rel=1e-6)
