"""Whether a record begins in motion, and how fast."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.signal import lfilter
from scipy.stats import norm

from cosim.inference.beginning import level, parabola, rests, speed
from cosim.inference.thresholds import START_LACK, START_SAMPLES, START_SPAN, START_STILL, START_SURE

TIME = np.arange(500) * 1e-3


def noise(size: float, seed: int = 1) -> np.ndarray:
    return size * np.random.default_rng(seed).standard_normal(TIME.size)


@given(st.floats(-5.0, 5.0).filter(lambda v: abs(v) > 0.5), st.floats(-3.0, 3.0))
def test_the_speed_of_a_parabola_is_its_slope_at_the_first_sample(v: float, a: float) -> None:
    """Where it does not turn within the span; noise a hundred times smaller than the way."""
    if abs(a) * 0.1 < 0.5 * abs(v):
        assert speed(TIME, v * TIME + 0.5 * a * TIME**2 + noise(1e-4)) == pytest.approx(v, abs=0.02)


@pytest.mark.parametrize("power", [2, 3])
@pytest.mark.parametrize("late", [0.0, 0.02, 0.05])
def test_a_motion_that_only_begins_starts_at_rest(power: int, late: float) -> None:
    assert speed(TIME, np.maximum(TIME - late, 0.0) ** power + noise(1e-6)) == 0.0


def test_a_parabola_s_slope_and_error_are_those_of_least_squares() -> None:
    values = 0.3 - 2.0 * TIME[:7] + noise(1e-3)[:7]
    t, slope, error, left = parabola(TIME[:7], values)
    found, covariance = np.polyfit(t, values, 2, cov=True)
    assert (slope, error) == pytest.approx((found[1], np.sqrt(covariance[1, 1])))
    assert left == pytest.approx(np.sqrt(np.sum((values - np.polyval(found, t)) ** 2) / (7 - 3)))
    later = parabola(TIME[:7] + 5.0, values)  # a record may begin at any time
    assert later[0] == pytest.approx(t)
    assert later[1:] == pytest.approx((slope, error, left))


def test_the_span_stays_whole_where_all_but_a_parabola_is_noise() -> None:
    """The speeds found scatter as the slope of the whole span does: of half of it they would scatter three times as much."""
    size, count = 1e-3, round(START_SPAN * 1e3)
    found = [speed(TIME, 2.0 * TIME + noise(size, seed)) for seed in range(200)]
    matrix = np.vander(TIME[:count], 3, increasing=True)
    error = size * np.sqrt(np.linalg.inv(matrix.T @ matrix)[1, 1])
    assert np.std(found) == pytest.approx(error, rel=0.15)


@pytest.mark.parametrize(("share", "whole"), [(0.85, True), (1.15, False)])
def test_the_span_is_halved_where_a_parabola_leaves_more_than_so_many_times_the_noise(share, whole) -> None:
    t = TIME[: round(START_SPAN * 1e3)]
    values, cubic = 2.0 * t + noise(1e-4)[: t.size], t**3 - 0.1 * t**2
    size = np.sqrt(np.mean(np.diff(values, 3) ** 2) / 20.0)  # of white noise, by its third differences

    def left(bend: float) -> float:
        return parabola(t, values + bend * cubic)[3] / size

    bend = brentq(lambda b: left(b) - share * START_LACK, 0.0, 100.0)
    bent = np.concatenate([values + bend * cubic, np.zeros(400)])
    slope = parabola(t, bent[: t.size])[1] / (t[-1] - t[0])
    assert (speed(TIME, bent) == pytest.approx(slope)) == whole


def test_noise_is_no_speed() -> None:
    found = [speed(TIME, noise(1.0, seed)) for seed in range(300)]
    assert np.count_nonzero(found) <= 1  # 5 standard errors


def wandering(samples: float, seed: int) -> np.ndarray:
    """Noise of unit size that hangs together for so many samples, as of filtered readings."""
    step = np.exp(-1.0 / samples)
    white = np.random.default_rng(seed).standard_normal(TIME.size + 400) * np.sqrt(1.0 - step**2)
    return lfilter([1.0], [1.0, -step], white)[400:]


@pytest.mark.parametrize("samples", [3.0, 10.0, 20.0])
def test_noise_that_hangs_together_is_neither_a_speed_nor_a_level(samples: float) -> None:
    """By neighbours alone 6 to 18 % of such logs would begin in motion."""
    each = [wandering(samples, seed) for seed in range(300)]
    assert sum(speed(TIME, own) != 0.0 for own in each) <= 12
    assert sum(level(own, 1e-3) != 0.0 for own in each) <= 12


def test_a_speed_beyond_noise_that_hangs_together_is_found() -> None:
    found = np.array([speed(TIME, 5.0 * TIME + 3e-3 * wandering(10.0, seed)) for seed in range(50)])
    assert np.mean(found > 0.0) > 0.9
    assert np.median(found) == pytest.approx(5.0, rel=0.1)


def test_a_signal_that_stands_off_zero_has_a_level_and_noise_has_none() -> None:
    assert level(3.0 + noise(0.1), 1e-3) == pytest.approx(3.0, abs=0.5)
    assert [level(noise(0.1, seed), 1e-3) for seed in range(50)] == [0.0] * 50


def test_of_too_few_samples_nothing_is_said() -> None:
    assert speed(TIME[:5], TIME[:5]) == 0.0
    assert level(np.ones(5), 1e-3) == 0.0


def test_samples_far_apart_take_ten_of_them() -> None:
    slow = np.arange(40) * 0.053
    assert speed(slow, 2.0 * slow) == pytest.approx(2.0)


def test_a_motion_that_bends_within_the_span_keeps_its_own_first_speed() -> None:
    """An axis under servo control: 6.5 mm/s at the first sample, 42 mm/s from 50 ms on."""
    fast = np.minimum(0.0065 + 0.77 * TIME, 0.042)
    position = np.cumsum(fast) * 1e-3
    assert speed(TIME, position + noise(5e-8)) == pytest.approx(0.0065, rel=0.15)


def test_a_record_rests_where_nothing_moves_until_the_input_changes() -> None:
    u = np.where(TIME < 0.1, 0.4, 1.0)
    moved = np.maximum(TIME - 0.12, 0.0)
    assert rests(u, 3.0 + moved)
    assert rests(u, 3.0 + moved + noise(1e-3))
    assert not rests(u, 3.0 + moved + 0.5 * TIME), "it moves already"
    assert not rests(u, 3.0 + moved + 0.01 * np.cos(90.0 * TIME)), "it swings still"
    assert not rests(u[round(0.1 * 1e3) :], moved[round(0.1 * 1e3) :]), "an input that never changes"
    assert not rests(u[101 - START_SAMPLES :], moved[101 - START_SAMPLES :]), "too few samples before"
    assert rests(u[100 - START_SAMPLES :], moved[100 - START_SAMPLES :])


def test_noise_that_hangs_together_is_no_motion_up_to_a_part_of_what_moves_in_a_time_as_long() -> None:
    u, moved = np.where(TIME < 0.1, 0.0, 1.0), np.maximum(TIME - 0.1, 0.0)
    usual = np.sqrt(np.mean(np.var(moved.reshape(5, 100), axis=1)))
    slow = np.sin(60.0 * TIME) * START_STILL * usual / np.std(np.sin(60.0 * TIME[:100]))
    assert rests(u, moved + 0.9 * slow)
    assert not rests(u, moved + 1.2 * slow)


def test_a_motion_that_begins_with_the_record_is_no_rest_though_the_way_of_a_minute_is_long_beside_it() -> (
    None
):
    time = np.arange(3000) * 0.02
    u = np.repeat(np.random.default_rng(7).uniform(-1.0, 1.0, 120), 25)
    slew = np.cumsum(np.convolve(u, np.exp(-np.arange(200) / 10.0))[:3000]) * 0.02
    assert np.std(slew[:25]) < 0.01 * np.ptp(slew)
    assert not rests(u, slew + 2e-4 * np.random.default_rng(8).standard_normal(time.size))


def test_a_level_is_the_first_value_itself() -> None:
    values = 30.0 + np.arange(50.0) % 7.0
    values[1] = 0.0
    assert level(values, 1e-3) == 30.0


# a zigzag by 1 has differences of that size: of white noise they are as often larger as smaller at this standard deviation
ZIGZAG = np.where(np.arange(TIME.size) % 2, -0.5, 0.5)
NOISE = 1.0 / (norm.ppf(0.75) * np.sqrt(2.0))


@pytest.mark.parametrize(("share", "stands"), [(0.99, True), (1.01, False)])
def test_a_first_value_counts_from_so_many_times_the_noise_on(share: float, stands: bool) -> None:
    first = share * START_SURE * 4.0 / (norm.ppf(0.75) * np.sqrt(20.0))  # its third differences are 4
    assert level(first - 0.5 + ZIGZAG, 1e-3) == (0.0 if stands else pytest.approx(first))
    assert level(-first - 0.5 + ZIGZAG, 1e-3) == (0.0 if stands else pytest.approx(-first))


@pytest.mark.parametrize(("share", "rest"), [(0.99, True), (1.01, False)])
def test_a_record_rests_up_to_so_many_times_its_noise(share: float, rest: bool) -> None:
    """One small step amid the noise of its first part, as large as makes its deviation this share of the limit."""
    step = 2.0 * np.sqrt((share * START_LACK * NOISE) ** 2 - 0.25)
    y = ZIGZAG + np.where(np.arange(TIME.size) < 50, 0.0, step)
    assert rests(np.where(TIME < 0.1, 0.0, 1.0), y) == rest


def test_a_span_that_is_too_long_is_halved_and_no_more() -> None:
    """A speed that jumps in the second half of the span: the first half has a parabola, and all of it tells."""
    values = 2.0 * TIME + 3.0 * np.maximum(TIME - 0.6 * START_SPAN, 0.0) + noise(1e-5)
    half = TIME[: round(0.5 * START_SPAN * 1e3)]
    assert speed(TIME, values) == pytest.approx(parabola(half, values[: half.size])[1] / half[-1])
