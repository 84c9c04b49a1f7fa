"""Loads, backlash, compliance and ripple, each by an independent look at the log."""

import numpy as np
import pytest
from rig_helpers import ANGLE, LEVER, B, J, clean, follows, held, lively
from scipy.signal import lsim

TORQUE = 2.375e-3 * 5.28e8 * LEVER


@pytest.mark.parametrize(
    ("hidden", "j", "b"),
    [
        ("mechanical.inertia:J=1500 kg.m2", 1500.0, B),
        ("mechanical.viscous_friction:b=40000 N.m.s/rad", J, 40e3),
    ],
)
def test_angle_follows_the_pressure_with_the_hidden_inertia_and_friction(hidden, j, b):
    run = clean(lively(), hidden)
    expected = follows([LEVER], [j, b, 0.0], run.true["p_load"], run.slew[0])
    assert np.max(np.abs(run.slew - expected)) < 2 * ANGLE


def test_constant_load_against_positive_motion():
    run = clean(held((0.5, 4.0)), settings={"mechanical.tau_load": 80.0})
    assert run.true["omega"][-1] * B == pytest.approx(0.5 * TORQUE - 80.0, rel=1e-6)


@pytest.mark.parametrize("command", [0.5, -0.5])
def test_viscous_friction_that_differs_between_the_directions(command):
    run = clean(held((command, 4.0)), settings={"mechanical.a_b": 0.15})
    friction = B * (1.0 + np.sign(command) * 0.15)
    assert run.true["omega"][-1] * friction == pytest.approx(command * TORQUE, rel=1e-6)


def test_gravity_pulls_to_its_zero_as_a_damped_pendulum():
    run = clean(
        np.zeros(6000), "mechanical.gravity_load:tau_g=50000 N.m,theta_g=20 deg", start=np.radians(20.5)
    )
    roots = np.roots([J, B, 50e3])
    slow = max(roots.real)
    away = run.true["theta"] - np.radians(20.0)
    assert np.log(away[2000] / away[4000]) / 2.0 == pytest.approx(-slow, rel=1e-4)


def test_gravity_at_a_settled_speed():
    run = clean(held((0.5, 6.0)), "mechanical.gravity_load:tau_g=150 N.m,theta_g=-30 deg", start=0.0)
    theta, omega = run.true["theta"], run.true["omega"]
    assert omega[-1] * B == pytest.approx(0.5 * TORQUE - 150 * np.sin(theta[-1] + np.pi / 6), rel=1e-3)


def test_backlash_is_a_play_operator_on_the_angle():
    gap = np.radians(0.4)
    run = clean(held((0.8, 2.0), (-0.8, 2.0), (0.8, 1.5)), "mechanical.backlash:gap=0.4 deg")
    theta, seen = run.true["theta"], run.true["seen"]
    expected = np.empty_like(theta)
    expected[0] = theta[0]
    for k in range(1, theta.size):
        expected[k] = min(max(expected[k - 1], theta[k] - gap / 2), theta[k] + gap / 2)
    assert np.max(np.abs(seen - expected)) < ANGLE
    assert np.array_equal(run.slew, seen)
    turn = 1500 + np.argmax(theta[1500:3000])
    still = np.flatnonzero(seen[turn:4000] < seen[turn] - 1e-12)[0] + turn
    assert theta[turn] - theta[still] == pytest.approx(gap, rel=0.02)  # lost motion: the full gap
    assert (
        run.true["omega"].tolist() == clean(run.u).true["omega"].tolist()
    )  # kinematic: no torque comes back


def test_compliance_is_two_inertias_and_a_spring():
    mu, w_f, zeta = 0.4, 12.0, 0.05
    run = clean(lively(), f"mechanical.compliance:mu={mu},w_f={w_f},zeta_f={zeta}")
    boom, column = mu * J, (1 - mu) * J
    k, c = boom * w_f**2, 2 * zeta * w_f * boom
    a = [[0, 1, 0, 0], [-k / column, -(B + c) / column, k / column, c / column],
         [0, 0, 0, 1], [k / boom, c / boom, -k / boom, -c / boom]]  # fmt: skip
    matrices = (np.array(a), np.array([[0], [LEVER / column], [0], [0]]), np.eye(4)[:1], np.zeros((1, 1)))
    t = np.arange(run.time.size) * 1e-3
    angle = lsim(matrices, run.true["p_load"], t)[1]
    assert np.max(np.abs(run.slew - run.slew[0] - angle)) < 2 * ANGLE


def test_boom_rings_at_its_frequency_when_the_column_sticks():
    w_f, zeta = 9.0, 0.02
    hidden = [
        f"mechanical.compliance:mu=0.3,w_f={w_f},zeta_f={zeta}",
        "mechanical.coulomb_friction:tau_c=400 N.m",
    ]
    run = clean(held((0.9, 3.0), (0.0, 5.0)), *hidden)
    stuck = 3000 + np.flatnonzero(run.true["omega"][3000:] == 0.0)[0]
    assert np.all(run.true["omega"][stuck:] == 0.0)
    swing = (run.true["boom"] - run.true["theta"])[stuck + 200 :]
    up = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0))
    crossing = up + swing[up] / (swing[up] - swing[up + 1])
    period = np.mean(np.diff(crossing)) * 1e-3
    assert 2 * np.pi / period == pytest.approx(w_f * np.sqrt(1 - zeta**2), rel=1e-3)


def test_ripple_repeats_with_the_tooth_pitch():
    run = clean(held((0.9, 30.0)), "mechanical.gear_ripple:tau_r=60 N.m,n_r=36,phi_r=0.5 rad")
    theta, omega = run.true["theta"][3000:], run.true["omega"][3000:]
    # at 1.3 rad/s the mechanics (35 rad/s) follow: omega b = torque + tau_r sin(n theta + phi)
    basis = np.column_stack([np.ones_like(theta), np.sin(36 * theta), np.cos(36 * theta)])
    (mean, sine, cosine), *_ = np.linalg.lstsq(basis, omega * B, rcond=None)
    assert mean == pytest.approx(0.9 * TORQUE, rel=1e-3)
    assert np.hypot(sine, cosine) == pytest.approx(60.0, rel=0.01)
    assert np.arctan2(cosine, sine) == pytest.approx(0.5, abs=0.05)
