"""The source's input filter for logs: Butterworth, order 2, on command and response alike."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import butter, freqz, lfilter

from cosim.errors import DataError, UsageError
from cosim.logs import load_log
from cosim.logs.filter import filter_log, input_card, low_pass
from fmus import sensor
from fmus.contract import NoMemory, fields

STEP = 1e-3


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Command and a response that is a linear system of it."""
    t = np.arange(4000) * STEP
    u = np.sign(np.sin(5.0 * t)) * 0.5
    slew = lfilter([0.02], [1.0, -0.98], u) + 3.0
    path = tmp_path_factory.mktemp("filter") / "log.csv"
    rows = "\n".join(f"{a:.3f},{b!r},{c!r}" for a, b, c in zip(t, u.tolist(), slew.tolist(), strict=True))
    path.write_text(f"time [s],u [1],slew [rad]\n{rows}\n")
    return load_log(path)


def test_gain_at_the_cut_off_and_beyond():
    t = np.arange(20000) * STEP
    for f, cutoff in ((5.0, 5.0), (20.0, 5.0), (1.0, 50.0)):
        found = low_pass(np.sin(2 * np.pi * f * t), STEP, cutoff)[10000:]
        b, a = butter(2, cutoff, fs=1000.0)
        expected = abs(freqz(b, a, [f], fs=1000.0)[1][0])
        assert np.sqrt(2.0) * np.std(found) == pytest.approx(expected, rel=1e-3)
    assert abs(freqz(*butter(2, 5.0, fs=1000.0), [5.0], fs=1000.0)[1][0]) == pytest.approx(np.sqrt(0.5))


def test_starts_settled():
    assert low_pass(np.full(50, 7.0), STEP, 10.0) == pytest.approx(np.full(50, 7.0))
    both = low_pass(np.array([np.full(50, 7.0), np.full(50, -2.0)]), STEP, 10.0)
    assert both == pytest.approx(np.array([np.full(50, 7.0), np.full(50, -2.0)]))


def test_alike_leaves_the_relation_between_them_as_it_was(log):
    """The filtered response is what the system makes of the filtered command; with one filtered alone it is not."""
    both = filter_log(log, 8.0)
    made = lfilter([0.02], [1.0, -0.98], both["u"])
    assert np.abs(both["slew"] - 3.0 - made)[2000:].max() < 1e-6
    one = filter_log(log, 8.0, signals=["slew"])
    assert np.abs(one["slew"] - 3.0 - lfilter([0.02], [1.0, -0.98], one["u"]))[2000:].max() > 0.05
    assert np.array_equal(one["u"], log["u"])


def test_what_was_done_is_said_and_the_rest_stays(log):
    found = filter_log(log, 8.0)
    assert "u, slew: filtered, Butterworth of order 2, cut-off 8 Hz" in found.warnings
    assert np.array_equal(found.time, log.time)
    assert found.held == log.held


@pytest.mark.parametrize(
    ("cutoff", "order", "message"),
    [(1000.0, 2, r"half the sampling rate, 500 Hz.*250 kHz"), (0.0, 2, "between 0"), (5.0, 0, "order 0")],
)
def test_filters_that_make_no_sense(log, cutoff, order, message):
    with pytest.raises(UsageError, match=message):
        filter_log(log, cutoff, order)


def test_uneven_sampling_and_missing_signals_are_refused(log):
    time = log.time.copy()
    time[2000:] += 0.01
    with pytest.raises(DataError, match="uneven"):
        filter_log(dataclasses.replace(log, time=time), 8.0)
    with pytest.raises(DataError, match="no signal 'spool'"):
        filter_log(log, 8.0, signals=["spool"])


def test_the_input_card_at_250_khz_is_the_sensor_s_own_filter():
    """2 Fc/Fs = 0.008 (3.1): on straight lines within the bilinear transform's error of the continuous filter."""
    rng = np.random.default_rng(2)
    channel = np.cumsum(rng.normal(0.0, 1e-3, 9000))  # more than two pieces
    found = input_card(channel, STEP)
    p = sensor.Parameters(*(v.start for v in fields(sensor.Parameters).values()))._replace(f_c=1e3)
    c, x, expected = sensor.coefficients(p, STEP), sensor.start(sensor.Input(channel[0]), p), [channel[0]]
    for value in channel[1:]:
        x = sensor.step(x, sensor.Input(value), NoMemory(), p, c)
        expected.append(x.slew)
    # half a sample of 4 us, for what moves some 1e-3 a millisecond
    assert np.abs(found - np.array(expected)).max() < 5e-6
    assert np.abs(found - channel).max() > 1e-4


def test_the_input_card_trails_a_ramp_by_a_quarter_of_a_millisecond():
    found = input_card(np.arange(50) * STEP, STEP)
    assert np.arange(50)[-1] * STEP - found[-1] == pytest.approx(np.sqrt(2.0) / (2e3 * np.pi), abs=2.1e-6)


def test_a_step_that_the_card_does_not_know_is_refused():
    with pytest.raises(UsageError, match=r"no whole number of the card's samples of 4e-06 s"):
        input_card(np.zeros(5), 1.0003e-3)
