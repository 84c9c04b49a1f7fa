"""RMSE, fit, windows and noise floor against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, lfilter, sosfilt

from cosim.compare import fit_percent, noise_floor, rms
from cosim.compare.metrics import score, without_offsets


def test_fit_is_matlabs():
    # goodnessOfFit's NRMSE by hand: |y - yhat| = sqrt(2), |y - mean| = sqrt(5)
    y, yhat = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 3.0, 3.0, 5.0])
    assert fit_percent(y, yhat) == pytest.approx(100.0 * (1.0 - np.sqrt(2.0 / 5.0)), rel=1e-14)
    assert fit_percent(y, y) == 100.0
    assert fit_percent(y, np.full(4, 2.5)) == pytest.approx(0.0, abs=1e-12)
    assert fit_percent(np.ones(4), y) is None


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=30),
    st.floats(-100.0, 100.0),
    st.floats(0.1, 10.0),
    st.integers(0, 2**31),
)
def test_fit_does_not_depend_on_unit_or_zero(values, offset, scale, seed):
    y = np.array(values)
    if np.std(y) < 1e-3:
        return
    yhat = y + np.random.default_rng(seed).standard_normal(len(y))
    one, two = fit_percent(y, yhat), fit_percent(scale * y + offset, scale * yhat + offset)
    assert one == pytest.approx(two, rel=1e-6, abs=1e-6)


def test_windows_have_free_offsets():
    time = np.arange(10001) * 1e-3
    drift = np.where(time < 5.0, 3.0, -1.0)
    assert rms(without_offsets(drift, time)) < 0.06  # but for one sample on the edge
    ramp = 0.1 * time
    assert rms(without_offsets(ramp, time)) == pytest.approx(0.5 / np.sqrt(12.0), rel=1e-3)


def test_score_leaves_filled_samples_out_and_says_where_it_is_worst():
    time = np.arange(100) * 0.1
    y = np.sin(time)
    yhat = y - 2.0
    yhat[40] -= 1.0
    valid = np.ones(100, dtype=bool)
    valid[10:20] = False
    yhat[10:20] = 1e6
    found = score(y, yhat, time, valid, 0.1, drifts=False, free_offset=False)
    assert found.samples == 90
    assert found.rmse == pytest.approx(np.sqrt((89 * 4.0 + 9.0) / 90))
    assert (found.max_error, found.max_time) == (pytest.approx(3.0), pytest.approx(4.0))
    assert found.rmse_windows is None
    assert found.offset is None
    free = score(y, yhat, time, valid, 0.1, drifts=True, free_offset=True)
    assert free.offset == pytest.approx(2.0 + 1.0 / 90)
    assert free.rmse < 0.12
    assert free.ratio == pytest.approx(free.rmse_windows / 0.1)


@pytest.mark.parametrize("size", [0.0, 1e-3, 1.0])
def test_noise_floor_of_a_moving_signal(size):
    rng = np.random.default_rng(1)
    time = np.arange(20000) * 1e-3
    motion = 10.0 * np.sin(1.5 * time) + np.where(time > 10.0, 5.0, 0.0)
    found = noise_floor(motion + size * rng.standard_normal(len(time)), 1e-3)
    # 36 windows of 500 samples: half a percent; the quiet ones are chosen, and the sine is no cubic by 1e-4
    assert found == pytest.approx(size, rel=0.04, abs=3e-4)


def test_noise_floor_of_a_log_shorter_than_ten_windows():
    """One start and stop in 0.7 s, as a servo drive records it: no window of half a second is a cubic."""
    time = np.arange(1024) / 1500.0
    motion = np.interp(time, [0.0, 0.05, 0.28, 0.52, 0.7], [0.0, 0.0, -2000.0, 0.0, 0.0])
    noise = np.random.default_rng(2).standard_normal(time.size)
    # ten windows of 102 samples, the quietest of which is the smallest of ten with 98 degrees of freedom: 11 % low
    assert noise_floor(motion + noise, 1.0 / 1500.0) == pytest.approx(1.0, rel=0.2)


@pytest.mark.parametrize("rate", [1.0, 20.0, 1000.0, 5000.0])
@pytest.mark.parametrize("part", [0.01, 0.1])
@pytest.mark.parametrize("kind", ["sine of 40 samples", "speed of a motor", "slow, repeated"])
def test_noise_floor_beside_a_motion_faster_than_its_windows(kind, part, rate):
    """At any rate of sampling: what moves within a dozen samples is no noise, and readings repeated four times are one."""
    rng = np.random.default_rng(3)
    count = int(np.clip(20.0 * rate, 2400, 40000))
    sample = np.arange(count)
    noise = part * rng.standard_normal(count)
    if kind == "sine of 40 samples":
        measured = np.sin(2.0 * np.pi * sample / 40.0) + noise
    elif kind == "speed of a motor":  # a lag of 12 samples, another command every 60
        steps = np.repeat(rng.uniform(-2.0, 2.0, count // 60 + 1), 60)[:count]
        measured = lfilter([1.0 - np.exp(-1.0 / 12.0)], [1.0, -np.exp(-1.0 / 12.0)], steps) + noise
    else:
        measured = np.repeat((np.sin(6.0 * np.pi * sample / count) + noise)[::4], 4)[:count]
    found = noise_floor(measured, 1.0 / rate)
    # a motion is told from noise where it lets the spread grow too fast: it then adds a fifth to it, and a kink every 60
    # samples a little more; the sine itself is 71 or 7 times the noise
    assert 0.85 * part < found < 1.5 * part


def test_noise_that_was_filtered_before_it_was_sampled_is_noise():
    """Smooth from sample to sample as a motion is, but no larger in half a second than in an eighth of it."""
    time = np.arange(20000) * 1e-3
    smooth = sosfilt(
        butter(2, 50.0, fs=1000.0, output="sos"), np.random.default_rng(4).standard_normal(time.size)
    )
    noise = smooth / np.std(smooth)
    # the quietest windows hold 25 independent values of it each
    assert noise_floor(100.0 * np.sin(time) + noise, 1e-3) == pytest.approx(1.0, rel=0.15)


def test_noise_floor_is_at_least_the_resolution():
    time = np.arange(5000) * 1e-3
    rounded = np.round(np.sin(time) / 0.01) * 0.01
    assert noise_floor(rounded, 1e-3) >= 0.01 / np.sqrt(12.0) * 0.999
    assert noise_floor(np.zeros(5000), 1e-3) == 0.0
    assert noise_floor(np.zeros(5), 1e-3) == 0.0
