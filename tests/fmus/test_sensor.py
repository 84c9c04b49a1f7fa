"""Slew sensor, (3.2): reading = gain * angle + bias, nominally the angle itself; the input filter (2.1)."""

import numpy as np
import pytest
from fmu_bench import bare, ramp_response, run
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, tf2ss

from fmus import registry
from fmus.compose import compose

BLOCK = bare("sensor")
LAGGING = compose(registry.block("sensor"), [registry.effects()["sensor.lag"]])
angles = st.floats(-10.0, 10.0)


@given(st.lists(angles, min_size=1, max_size=20), st.floats(1e-4, 1.0))
def test_nominally_the_angle_itself(theta: list[float], h: float) -> None:
    found = run(BLOCK, h, [0.0]).play([[t] for t in theta])[:, 0]
    assert np.array_equal(found, theta)


@given(angles, st.floats(-2.0, 2.0), st.floats(-1.0, 1.0))
def test_scaling_of_3_2(theta: float, gain: float, bias: float) -> None:
    r = run(BLOCK, 1e-3, [theta], {"gain": gain, "bias": bias})
    assert r.x.slew == r.step(theta)[0] == pytest.approx(gain * theta + bias, rel=1e-14, abs=1e-15)


def ramp_and_rest(h: float) -> np.ndarray:
    """Angles: still, a ramp, a stop."""
    t = np.arange(0.0, 1.0, h)
    return np.interp(t, [0.0, 0.2, 0.6, 1.0], [0.1, 0.1, 0.5, 0.5])


@given(st.lists(angles, min_size=2, max_size=30), st.floats(-2.0, 2.0), st.floats(-1.0, 1.0))
def test_without_a_cut_off_there_is_no_filter(theta: list[float], gain: float, bias: float) -> None:
    """Bit for bit the block of (3.2) alone, whatever the angle does."""
    found = run(BLOCK, 1e-3, [theta[0]], {"gain": gain, "bias": bias, "f_c": 0.0}).play([[t] for t in theta])
    assert [float(y).hex() for y in found[:, 0]] == [(gain * t + bias).hex() for t in theta]


@pytest.mark.parametrize(("h", "f_c"), [(1e-3, 20.0), (1e-3, 1000.0), (0.02, 5.0)])
def test_filter_is_the_butterworth_of_2_1_and_exact(h: float, f_c: float) -> None:
    """Against scipy's analogue Butterworth, solved by its matrix exponential for a reading on straight lines."""
    theta = ramp_and_rest(h)
    b, a = butter(2, 2.0 * np.pi * f_c, analog=True)
    A, B, C, D = tf2ss(b, a)
    start = np.linalg.solve(A, -B[:, 0] * theta[0])
    states = ramp_response(A, B, start, theta[:, None], h, [False])
    expected = states @ C[0] + D[0, 0] * theta[1:]
    found = run(BLOCK, h, [theta[0]], {"f_c": f_c}).play(theta[1:, None])[:, 0]
    # the companion form of scipy loses digits with w^2
    assert np.abs(found - expected).max() < 1e-9


def test_filter_lags_a_ramp_by_sqrt_2_over_w() -> None:
    f_c, rate = 10.0, 0.3
    theta = rate * np.arange(2000) * 1e-3
    found = run(BLOCK, 1e-3, [0.0], {"f_c": f_c}).play(theta[1:, None])[:, 0]
    assert found[-1] == pytest.approx(theta[-1] - rate * np.sqrt(2.0) / (2.0 * np.pi * f_c), rel=1e-9)


def test_filter_acts_on_the_scaled_reading() -> None:
    theta = ramp_and_rest(1e-3)
    plain = run(BLOCK, 1e-3, [theta[0]], {"f_c": 15.0}).play(theta[1:, None])[:, 0]
    scaled = run(BLOCK, 1e-3, [theta[0]], {"f_c": 15.0, "gain": 2.0, "bias": 0.3}).play(theta[1:, None])[:, 0]
    assert scaled == pytest.approx(2.0 * plain + 0.3, abs=1e-12)


@pytest.mark.parametrize("q_l", [1e-4, 0.1, 0.25, 0.5, 1.0])
def test_a_lag_of_second_order_is_exact(q_l: float) -> None:
    """Against scipy's matrix exponential, from overdamped by two equal lags and Butterworth to ringing."""
    theta, tau = ramp_and_rest(1e-3), 0.05
    A = np.array([[0.0, 1.0], [-1.0 / (q_l * tau**2), -1.0 / (q_l * tau)]])
    B = np.array([[0.0], [1.0 / (q_l * tau**2)]])
    states = ramp_response(A, B, np.array([theta[0], 0.0]), theta[:, None], 1e-3, [False])
    found = run(LAGGING, 1e-3, [theta[0]], {"tau_l": tau, "q_l": q_l}).play(theta[1:, None])[:, 0]
    assert np.abs(found - states[:, 0]).max() < 1e-9


@pytest.mark.parametrize("q_l", [0.0, 0.3])
def test_a_lag_of_either_order_is_behind_a_ramp_by_its_time(q_l: float) -> None:
    theta = 0.3 * np.arange(2000) * 1e-3
    found = run(LAGGING, 1e-3, [0.0], {"tau_l": 0.05, "q_l": q_l}).play(theta[1:, None])[:, 0]
    assert found[-1] == pytest.approx(theta[-1] - 0.3 * 0.05, rel=1e-9)


def test_a_vanishing_share_of_the_second_order_is_the_first_order() -> None:
    theta = ramp_and_rest(1e-3)
    one, two = (
        run(LAGGING, 1e-3, [theta[0]], {"tau_l": 0.05, "q_l": q}).play(theta[1:, None])[:, 0]
        for q in (0.0, 1e-6)
    )
    assert np.abs(one - two).max() < 1e-6
