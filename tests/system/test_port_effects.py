"""What effects at a port do to signals of known answers; the others: tests/anysystem/test_extended_system.py."""

import numpy as np
import pytest
from scipy.signal import lfilter

from cosim.system.effects import EFFECTS

H = 0.01
T = H * np.arange(300)
WAVE = np.sin(7.0 * T) + 0.3


def acted(effect: str, signal: np.ndarray, **values: float) -> np.ndarray:
    return EFFECTS[effect].act(signal, H, values)


def test_at_their_off_values_effects_do_nothing() -> None:
    for name, effect in EFFECTS.items():
        off = {n: p.off for n, p in effect.parameters.items()}
        assert acted(name, WAVE, **off) == pytest.approx(WAVE, abs=1e-15), name
        assert all(p.low <= p.off <= p.high for p in effect.parameters.values()), name


def test_a_ramp_through_a_lag_is_late_by_the_time_constant_once_the_start_has_died_out() -> None:
    lag = 0.25
    assert acted("port.lag", 1.0 + T, lag=lag) == pytest.approx(
        1.0 + T - lag * -np.expm1(-T / lag), abs=1e-12
    )


def test_a_delay_is_between_samples_too_and_holds_the_first_value() -> None:
    assert acted("port.delay", 2.0 + T, delay=2.5 * H) == pytest.approx(2.0 + np.maximum(T - 2.5 * H, 0.0))


def test_the_far_side_of_a_play_stays_behind_by_half_its_width() -> None:
    there_and_back = np.concatenate([T[:200], T[199] - T[1:100]])
    found = acted("port.play", there_and_back, half_width=0.3)
    top = T[199] - 0.3
    assert found[:200] == pytest.approx(np.maximum(T[:200] - 0.3, 0.0))
    assert found[200:] == pytest.approx(np.minimum(top, there_and_back[200:] + 0.3))
    # it lies where the first value has pushed it to, whatever follows
    assert acted("port.play", np.array([0.5, 2.0]), half_width=0.3) == pytest.approx([0.2, 1.7])
    assert acted("port.play", np.array([-0.5, -2.0]), half_width=0.3) == pytest.approx([-0.2, -1.7])
    assert [acted("port.play", np.full(3, x), half_width=0.3)[-1] for x in (1.0, 0.2, -1.0)] == [
        0.7,
        0.0,
        -0.7,
    ]


def test_a_limited_speed_is_the_same_both_ways() -> None:
    step = np.where(T < 0.5, 1.0, 3.0)
    ramp = np.clip(1.0 + 4.0 * (T - 0.5 + H), 1.0, 3.0)
    assert acted("port.rate_limit", step, rate=4.0) == pytest.approx(ramp)
    assert acted("port.rate_limit", -step, rate=4.0) == pytest.approx(-ramp)


def test_limits_given_the_wrong_way_round_or_of_the_wrong_sign_do_no_harm() -> None:
    assert np.array_equal(acted("port.saturation", WAVE, low=0.5, high=-0.2), np.clip(WAVE, -0.2, 0.5))
    for effect, values in (
        ("port.dead_zone", {"low": 0.2, "high": -0.2}),
        ("port.play", {"half_width": -1.0}),
        ("port.lag", {"lag": -1.0}),
        ("port.quantisation", {"quantum": -1.0}),
    ):
        assert np.array_equal(acted(effect, WAVE, **values), WAVE), effect
    assert np.array_equal(acted("port.rate_limit", WAVE, rate=-1.0), np.full(WAVE.size, WAVE[0]))


def test_readings_are_rounded_to_the_nearest_step_and_drift_from_the_first_on() -> None:
    assert acted("port.quantisation", np.array([0.0, 0.124, 0.126, -0.126]), quantum=0.25) == pytest.approx(
        [0.0, 0.0, 0.25, -0.25]
    )
    assert acted("port.drift", np.ones(300), rate=0.5) == pytest.approx(1.0 + 0.5 * T)


def test_a_lost_reading_is_the_last_one_and_as_many_are_lost_as_is_likely() -> None:
    """The generator is that of Park and Miller (1988), from a seed of its own."""
    seed, numbers = 20190515, []
    for _ in range(4000):
        numbers.append(seed / (2**31 - 1))
        seed = 16807 * seed % (2**31 - 1)
    lost = np.array(numbers) < 0.3
    assert lost.mean() == pytest.approx(0.3, abs=4.0 * np.sqrt(0.3 * 0.7 / 4000))
    signal = 5.0 + np.arange(4000.0)
    last = np.maximum.accumulate(
        np.where(lost, 0, np.arange(4000))
    )  # before the first one there is the first
    assert np.array_equal(acted("port.dropout", signal, probability=0.3), signal[last])


@pytest.mark.parametrize(("effect", "parameter", "unit"), [
    ("port.gain", "gain", "1"), ("port.offset", "offset", "m"), ("port.delay", "delay", "s"),
    ("port.rate_limit", "rate", "m/s"),
])  # fmt: skip
def test_numbers_have_the_units_of_the_signal_they_act_on(effect: str, parameter: str, unit: str) -> None:
    assert EFFECTS[effect].unit(parameter, "m") == unit


def test_of_a_signal_without_a_unit_the_speed_is_per_second() -> None:
    rate = EFFECTS["port.rate_limit"]
    assert [rate.unit("rate", of) for of in ("", "1")] == ["1/s", "1/s"]
    assert EFFECTS["port.offset"].unit("offset", "") == "1"


def test_a_lag_is_the_limit_of_a_filter_of_small_steps() -> None:
    """Independent of the closed form: the straight lines between samples, a thousand steps in each."""
    lag, fine = 0.05, 1000
    at = np.arange((T.size - 1) * fine + 1) / fine
    u = np.interp(at, np.arange(T.size), WAVE)
    a = np.exp(-H / fine / lag)
    y = lfilter([0.5 * (1.0 - a), 0.5 * (1.0 - a)], [1.0, -a], u - u[0]) + u[0]
    assert acted("port.lag", WAVE, lag=lag) == pytest.approx(y[::fine], abs=1e-7)


def test_steps_lost_samples_and_a_drift_are_of_readings_alone() -> None:
    assert {n for n, e in EFFECTS.items() if e.reading} == {"port.quantisation", "port.dropout", "port.drift"}
