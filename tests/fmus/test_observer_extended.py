"""Extended observer: exactness of its prediction, error dynamics, what its estimates settle at, readings that are late."""

import math

import numpy as np
import pytest
from fmu_bench import bare, ramp_response, run

BLOCK = bare("observer_extended")
P = {name: v.start for name, v in BLOCK.parameters.items()}
J, B, AREA = P["J"], P["b"], P["A"] * P["r"]
NONE = (0.0, -1.0)  # no reading of the tracker
OPEN = {"l_theta": 0.0, "l_omega": 0.0, "l_tau": 0.0}
DEG = math.pi / 180.0


def dynamics() -> np.ndarray:
    """A of (theta, omega, tau)."""
    return np.array([[0.0, 1.0, 0.0], [0.0, -B / J, 1.0 / J], [0.0, 0.0, -1.0 / P["T_tau"]]])


def gain() -> np.ndarray:
    """L of (theta, omega, tau), per second."""
    return np.array([P["l_theta"], P["l_omega"], P["l_tau"]])


@pytest.mark.parametrize("h", [1e-3, 0.02])
def test_prediction_is_exact_for_a_pressure_on_straight_lines(h):
    rng = np.random.default_rng(1)
    p_load = rng.uniform(-10e5, 10e5, (80, 1))
    states = ramp_response(dynamics()[:2, :2], np.array([[0.0], [AREA / J]]), [0.1, 0.0], p_load, h, [False])
    rows = np.column_stack([p_load[1:, 0], np.full(79, 0.1), np.zeros(79), np.full(79, -1.0)])
    found = run(BLOCK, h, [p_load[0, 0], 0.1, *NONE], OPEN).play(rows)
    assert np.abs(found[:, :2] - states).max() < 1e-14


def test_error_dies_out_as_the_sampled_error_dynamics_say():
    """(2.16) in samples: e+ = (I - h L C) exp(A h) e, from a wrong start of every state; the plant stands still."""
    from scipy.linalg import expm

    h, start = 1e-3, np.array([0.02, -0.03, 40.0])
    wrong = {"at_reading": 0.0, "slew_0": start[0], "rate_0": start[1], "tau_0": start[2]}
    found = run(BLOCK, h, [0.0, 0.0, *NONE], wrong).play([[0.0, 0.0, *NONE]] * 1000)[:, :3]
    once = (np.eye(3) - h * np.outer(gain(), [1.0, 0.0, 0.0])) @ expm(dynamics() * h)
    e = start
    for k in range(1000):
        e = once @ e
        # the block's torque falls on a straight line within a step: (h/T)^2/12 of it a step, in some 100 steps of memory
        assert np.all(np.abs(found[k] - e) < 2e-5 * np.abs(start)), k
    assert np.abs(found[-1] / start).max() < 1e-3


def test_a_constant_load_is_found_but_for_what_the_correlation_time_forgets():
    """The plant creeps under -80 N.m: with a random walk the estimate is the load itself, with T = 1 s a little less."""
    load, h = -80.0, 1e-3
    t = np.arange(1, 3001) * h
    lag = J / B
    slew = load / B * (t - lag * (1.0 - np.exp(-t / lag)))
    rows = np.column_stack([0 * t, slew, 0 * t, 0 * t - 1.0])
    walk = run(BLOCK, h, [0.0, 0.0, *NONE], {"T_tau": 1e9}).play(rows)[-1]
    assert walk[2] == pytest.approx(load, rel=1e-4)
    assert walk[1] == pytest.approx(load / B, rel=1e-4)
    short = run(BLOCK, h, [0.0, 0.0, *NONE]).play(rows)[-1]
    assert 0.85 < short[2] / load < 0.99


def test_it_starts_standing_at_the_reading_or_where_it_is_told():
    assert run(BLOCK, 1e-3, [0.0, 0.3, *NONE], {"beta_0": 0.01}).x[:2] == (pytest.approx(0.29), 0.0)
    told = run(BLOCK, 1e-3, [0.0, 0.3, *NONE], {"at_reading": 0.0, "slew_0": 0.1, "rate_0": 0.02})
    assert told.x[:2] == (0.1, 0.02)


FUSED = {
    "T_beta": 10.0, "l_theta": 18.2, "l_omega": 362.0, "l_tau": 1.0988e7, "l_beta": 125.6,
    "k_theta": 0.246, "k_omega": 2.59, "k_tau": 71958.0, "k_beta": -0.228,
}  # fmt: skip


@pytest.mark.parametrize("age", [0.0, 0.02])
def test_tracker_shows_the_error_of_the_sensor_also_where_it_is_late(age):
    """The column turns at 1 deg/s under the pressure that it takes; the sensor reads 0.3 deg too much, the tracker right."""
    h, n, speed, error = 1e-3, 4000, 1.0 * DEG, 0.3 * DEG
    t = np.arange(1, n + 1) * h
    p_load = B * speed / AREA
    fresh = np.arange(1, n + 1) % 12 == 0
    rows = np.column_stack(
        [
            np.full(n, p_load),
            speed * t + error,
            np.where(fresh, speed * (t - age), 99.0),
            np.where(fresh, age, -1.0),
        ]
    )
    start = FUSED | {"at_reading": 0.0, "rate_0": speed}
    found = run(BLOCK, h, [p_load, error, *NONE], start).play(rows)[-1]
    # the error is forgotten over 10 s while readings bring it back every 12 ms
    assert found[3] == pytest.approx(error, rel=0.03)
    assert found[0] == pytest.approx(speed * t[-1], abs=0.03 * error)
    assert found[1] == pytest.approx(speed, rel=0.02)


def test_a_late_reading_taken_for_a_fresh_one_is_off_by_the_way_made():
    """What `external_age` is for: the same reading without its age draws the angle back."""
    h, speed = 1e-3, 2.0 * DEG
    start = FUSED | {"at_reading": 0.0, "rate_0": speed}
    p_load = B * speed / AREA
    one = run(BLOCK, h, [p_load, 0.0, *NONE], start).step(p_load, h * speed, h * speed - 0.02 * speed, 0.02)
    other = run(BLOCK, h, [p_load, 0.0, *NONE], start).step(p_load, h * speed, h * speed - 0.02 * speed, 0.0)
    assert one[0] == pytest.approx(h * speed, rel=1e-6)
    assert other[0] - one[0] == pytest.approx(-FUSED["k_theta"] * 0.02 * speed, rel=1e-6)
