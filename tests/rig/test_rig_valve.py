"""Dead zone and valve effects, each by an independent look at the log."""

import numpy as np
import pytest
from rig_helpers import SPOOL, clean, held, lively
from scipy.signal import correlate

K = 2.375e-3


def settled(run, seconds):
    return run.true["spool"][round(seconds / 1e-3) - 1]


def test_dead_zone_mismatch_costs_its_width_on_each_side():
    run = clean(held((0.6, 2.0), (-0.6, 2.0)), "dead_zone.mismatch:b_r=0.53,b_l=-0.43")
    assert settled(run, 2.0) == pytest.approx(K * (0.6 + 0.45 - 0.53), rel=1e-9)
    assert settled(run, 4.0) == pytest.approx(K * (-0.6 - 0.40 + 0.43), rel=1e-9)


def test_narrow_dead_zone_jumps():
    run = clean(held((0.2, 2.0)), "dead_zone.mismatch:b_r=0.40")
    assert settled(run, 2.0) == pytest.approx(K * (0.2 + 0.45 * np.tanh(10) - 0.40), rel=1e-9)


@pytest.mark.parametrize(("k", "w0", "zeta"), [(2.0e-3, 25.23, 0.545), (K, 15.0, 0.545), (K, 25.23, 0.3)])
def test_step_response_has_the_hidden_gain_frequency_and_damping(k, w0, zeta):
    hidden = [f"dcv.gain:K={k}", f"dcv.bandwidth:w0={w0}", f"dcv.damping:zeta={zeta}"]
    x = clean(held((0.6, 3.0)), *hidden, settings={"dcv.x_max": 0.1}).true["spool"]
    final, peak = x[-1], np.argmax(x)
    root = np.sqrt(1 - zeta**2)
    assert final == pytest.approx(0.6 * k, rel=1e-6)
    assert x[peak] / final - 1 == pytest.approx(np.exp(-np.pi * zeta / root), rel=1e-3)
    assert peak * 1e-3 == pytest.approx(np.pi / (w0 * root), abs=1e-3)


@pytest.mark.parametrize("delay", [0.020, 0.0075, 0.0203])
def test_delay_is_found_by_cross_correlation(delay):
    # a burst that starts and ends at rest, so that nothing is cut off at the edges
    u = np.pad(0.9 * np.hanning(6000) * np.sin(np.cumsum(np.linspace(2.0, 30.0, 6000)) * 1e-3), 1000)
    late = clean(u, f"dcv.delay:tau_d={delay} s").true["spool"]
    prompt = clean(u).true["spool"]
    cross = correlate(late, prompt, mode="full")
    top = int(np.argmax(cross))
    left, mid, right = cross[top - 1 : top + 2]
    lag = (top - (prompt.size - 1) + 0.5 * (left - right) / (left - 2 * mid + right)) * 1e-3
    assert lag == pytest.approx(delay, abs=0.05e-3)


def test_whole_and_broken_delays_are_exact_shifts():
    u = held((0.7, 0.5), (-0.5, 0.5))
    prompt = clean(u).true["spool"]
    assert np.max(np.abs(clean(u, "dcv.delay:tau_d=20 ms").true["spool"][20:] - prompt[:-20])) < 1e-15
    twice = clean(np.repeat(u, 2), "dcv.delay:tau_d=0.5 ms").true["spool"]
    # half a millisecond late: between the two neighbouring samples of the prompt one, to second order in the step
    prompt = clean(np.repeat(u, 2)).true["spool"]
    assert np.max(np.abs(twice[1:] - 0.5 * (prompt[1:] + prompt[:-1]))) < 3.0 * 1e-6 / 8 * 2


def test_rate_is_never_exceeded_and_is_reached():
    x = clean(lively(), "dcv.rate_limit:v_max=8 mm/s").true["spool"]
    speed = np.abs(np.diff(x)) / 1e-3
    assert speed.max() <= 8e-3 * (1 + 1e-9)
    assert np.sum(speed > 8e-3 * (1 - 1e-9)) > 100


def test_limited_speed_state_does_not_wind_up():
    # after a long limited travel the spool brakes with its own dynamics: overshoot stays that of speed v_max
    x = clean(held((-0.9, 2.0), (0.9, 3.0)), "dcv.rate_limit:v_max=5 mm/s").true["spool"]
    reference = clean(held((0.9, 3.0)), "dcv.rate_limit:v_max=5 mm/s").true["spool"]
    assert x.max() == pytest.approx(reference.max(), abs=SPOOL)


def test_hard_stops_hold_position_and_take_all_speed():
    u = held((1.0, 1.0), (-1.0, 1.0), (0.9, 0.5), (0.7, 0.5))
    x = clean(u, "dcv.stroke_limit:x_max=1.9 mm,x_min=-1.5 mm").true["spool"]
    assert x.max() == 1.9e-3
    assert x.min() == -1.5e-3
    assert np.all(x[400:1000] == 1.9e-3)
    # released from rest at the stop: x = stop - (stop - target) (1 - cos ...) of a second-order system at zero speed
    w0, zeta, target = 25.23, 0.545, -1.0 * K
    t = np.arange(30) * 1e-3
    wd = w0 * np.sqrt(1 - zeta**2)
    free = target + (1.9e-3 - target) * np.exp(-zeta * w0 * t) * (
        np.cos(wd * t) + zeta * w0 / wd * np.sin(wd * t)
    )
    assert np.allclose(x[1000:1030], free, atol=1e-12)


def test_play_loop_has_twice_the_half_width():
    levels = [0.5, 0.7, 0.9, 0.7, 0.5]
    run = clean(held(*[(level, 2.0) for level in levels]), "dcv.hysteresis:play=0.03")
    found = [settled(run, 2.0 * (i + 1)) / K for i in range(5)]
    assert np.allclose(found, [0.47, 0.67, 0.87, 0.73, 0.53], atol=1e-8)
    assert found[3] - found[1] == pytest.approx(2 * 0.03, abs=1e-8)


def test_offset_moves_the_neutral_but_not_the_stops():
    run = clean(held((0.0, 2.0), (1.0, 2.0)), "dcv.offset:x_0=0.4 mm")
    assert settled(run, 2.0) == pytest.approx(0.4e-3, rel=1e-9)
    assert settled(run, 4.0) == 2.6e-3
