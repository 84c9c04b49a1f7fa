"""Slew sensor, observer and tracker, each by an independent look at the log."""

import numpy as np
import pytest
from rig_helpers import ANGLE, clean, follows, held, lively
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from cosim.rig import Noise, make_log
from cosim.rig.parameters import DEG

U = lively()
TIME = np.arange(U.size) * 1e-3


def test_scale_bias_and_drift_are_a_straight_line_of_the_angle():
    run = clean(U, "sensor.bias:bias=2 deg", "sensor.gain:gain=1.05", "sensor.drift:drift=0.1 deg/s")
    (gain, bias, drift), *_ = np.linalg.lstsq(
        np.column_stack([run.true["theta"], np.ones_like(TIME), TIME]), run.slew, rcond=None
    )
    assert gain == pytest.approx(1.05, rel=1e-9)
    assert bias / DEG == pytest.approx(2.0, rel=1e-9)
    assert drift / DEG == pytest.approx(0.1, rel=1e-9)


def test_lag_is_first_order_of_what_the_sensor_sees():
    run = clean(U, "sensor.lag:tau_l=80 ms", "mechanical.backlash:gap=0.3 deg", "sensor.gain:gain=1.1")
    seen = 1.1 * run.true["seen"]  # lag and gain commute
    assert np.max(np.abs(run.slew - follows([1.0], [0.08, 1.0], seen - seen[0], seen[0]))) < ANGLE
    assert np.max(np.abs(run.slew - seen)) > 100 * ANGLE


def test_quantised_values_are_whole_multiples_within_half_a_step():
    run = clean(U, "sensor.quantisation:quantum=0.25 deg")
    steps = run.slew / (0.25 * DEG)
    assert np.allclose(steps, np.round(steps), atol=1e-9)
    assert np.max(np.abs(run.slew - run.true["seen"])) <= 0.125 * DEG * (1 + 1e-9)
    assert len(set(np.round(steps))) > 5


@pytest.mark.parametrize("p_drop", [0.05, 0.3])
def test_dropout_repeats_the_last_sample_with_its_probability(p_drop):
    run = make_log("steps", 40.0, [f"sensor.dropout:p_drop={p_drop}"], seed=3)
    fresh = make_log("steps", 40.0, seed=3).slew
    stale = np.flatnonzero(np.diff(run.slew) == 0.0) + 1  # noise never repeats by itself
    spread = np.sqrt(p_drop * (1 - p_drop) / 40000)
    assert stale.size / 40000 == pytest.approx(p_drop, abs=4 * spread)
    alive = np.setdiff1d(np.arange(run.slew.size), stale)
    assert np.array_equal(run.slew[alive], fresh[alive])
    assert 0 not in stale


def test_observer_solves_its_differential_equation_and_finds_the_angle():
    run = make_log("sweep", 8.0, noise=0, observer=True)
    y, a, gain = run.slew / DEG, np.array([[-4.4, 0.0], [1.0, 0.0]]), np.array([7.744, 6.16])

    def rates(t, x):
        k = min(int(t / 1e-3 + 1e-9), y.size - 1)
        return a @ x + np.array([4.0 * run.u[k], 0.0]) + gain * (y[k] - 2.5 * x[1])

    x = np.array([0.0, y[0] / 2.5])
    for k in range(2000):  # one exact step a sample would be the code under test; this is Runge-Kutta
        x = solve_ivp(rates, (k * 1e-3, (k + 1) * 1e-3 - 1e-9), x, rtol=1e-8, atol=1e-10, method="RK23").y[
            :, -1
        ]
    assert run.slew_estimate[2000] / DEG == pytest.approx(2.5 * x[1], abs=1e-5)
    assert run.slew_rate_estimate[2000] / DEG == pytest.approx(2.5 * x[0], abs=1e-5)
    assert np.max(np.abs(run.slew_estimate - run.slew)) < 0.5 * DEG


def test_tracker_runs_at_80_hz_on_the_nominal_clock():
    run = clean(U, tracker=True)
    stamps, angle = run.tracker
    assert np.allclose(np.diff(stamps), 1 / 80)
    assert stamps[0] == 0.0
    assert np.allclose(angle, np.interp(stamps, TIME, run.true["seen"]))


@pytest.mark.parametrize(("offset", "rate"), [(0.37, 1.002), (-1.1, 0.999)])
def test_tracker_clock_is_found_by_a_fit(offset, rate):
    run = clean(U, f"tracker.clock:offset={offset} s,rate={rate}", tracker=True)
    stamps, angle = run.tracker

    def misfit(x):
        return np.interp(x[0] + x[1] * stamps, TIME, run.true["theta"]) - angle

    found = least_squares(misfit, [offset + 0.05, 1.0], x_scale=[0.1, 0.001], xtol=1e-14, ftol=1e-14).x
    assert found == pytest.approx([offset, rate], abs=1e-5)
    inside = offset + rate * stamps
    assert inside.min() >= -1e-9
    assert inside.max() <= TIME[-1] + 1e-9
    assert (inside.min() - 0) < rate / 80
    assert (TIME[-1] - inside.max()) < rate / 80


def test_seam_steps_at_twelve_degrees():
    run = clean(U, "tracker.seam:seam=0.5 deg", tracker=True, start=12 * DEG)
    stamps, angle = run.tracker
    straight = np.interp(stamps, TIME, run.true["seen"])
    below = straight < 12 * DEG
    assert 20 < below.sum() < below.size - 20
    assert np.allclose(angle[below] - straight[below], 0.5 * DEG)
    assert np.allclose(angle[~below], straight[~below])
    assert np.array_equal(run.slew, run.true["seen"])  # the slew sensor has no seam


def test_tracker_sees_past_the_slew_sensor():
    hidden = ["sensor.bias:bias=5 deg", "sensor.lag:tau_l=0.2 s", "mechanical.backlash:gap=0.5 deg"]
    run = clean(U, *hidden, tracker=True)
    assert np.allclose(run.tracker[1], np.interp(run.tracker[0], TIME, run.true["seen"]))


def test_tracker_effect_without_tracker_is_noted():
    assert "tracker" in make_log(held((0.5, 0.1)), hidden=["tracker.seam"]).notes[0]
    assert make_log(held((0.5, 0.1)), hidden=["tracker.seam"], tracker=True).notes == []


def test_tracker_noise_is_its_own():
    noisy = make_log(U, noise=Noise(sizes={"slew_external": 0.1 * DEG}), tracker=True, seed=4)
    error = noisy.tracker[1] - np.interp(noisy.tracker[0], TIME, noisy.true["seen"])
    assert np.std(error) == pytest.approx(0.1 * DEG, rel=0.15)


def test_every_channel_passes_the_input_card_noise_included():
    """(2.1), (3.1) at 250 kHz against the continuous filter on straight lines; the command is no analogue channel."""
    plain, behind = (make_log("steps", 4.0, seed=5, noise=1.0, card=card) for card in (False, True))
    w = 2e3 * np.pi
    channels = ("spool", "p_supply", "p_a", "p_b", "slew")
    for name in channels:
        raw = getattr(plain, name)
        expected = raw[0] + follows([1.0], [1.0 / w**2, np.sqrt(2.0) / w, 1.0], raw - raw[0])
        # the bilinear transform at 250 kHz moves the corner by 5e-5 and the phase by half a sample of 4 us
        assert np.max(np.abs(getattr(behind, name) - expected)) < 0.02 * np.max(np.abs(np.diff(raw))), name
        assert np.std(getattr(behind, name) - raw) > 0.1 * np.std(np.diff(raw)), name
    assert np.array_equal(behind.u, plain.u)
    assert np.array_equal(behind.true["theta"], plain.true["theta"])
    assert behind.truth["card"] is True
    assert plain.truth["card"] is False


def test_what_the_card_passed_is_rounded_and_lost_afterwards():
    hidden = ["sensor.quantisation:quantum=0.25 deg", "sensor.dropout:p_drop=0.3"]
    run = make_log("steps", 4.0, hidden, seed=5, card=True)
    steps = run.slew / (0.25 * DEG)
    assert np.allclose(steps, np.round(steps), atol=1e-9)
