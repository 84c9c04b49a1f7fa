import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cosim.report.material import Noise
from cosim.report.overview import judged
from cosim.report.series import averaged, binned, bucket, envelope, reversals, steady, steps_of

VALUES = arrays(np.float64, st.integers(1, 300), elements=st.floats(-1e6, 1e6))


@given(VALUES, st.integers(1, 20))
def test_an_envelope_keeps_every_buckets_extremes_in_order(values, size):
    at, kept = envelope(values, size)
    assert np.all(np.diff(at) >= 0)
    assert np.array_equal(values[at.astype(int)], kept)
    full = values[: values.size // size * size]
    if full.size and size > 1:
        rows, pairs = full.reshape(-1, size), kept.reshape(-1, 2)
        assert np.array_equal(rows.max(axis=1), pairs.max(axis=1))
        assert np.array_equal(rows.min(axis=1), pairs.min(axis=1))


def test_a_single_spike_survives_thinning_of_a_minute():
    values = np.zeros(60_000)
    values[31_337] = 5.0
    at, kept = envelope(values, bucket(values.size, 1e-3))
    assert at.size <= 12_000
    assert at[np.argmax(kept)] == 31_337


def test_a_bucket_is_ten_milliseconds_until_the_log_is_longer_than_a_minute():
    assert bucket(60_000, 1e-3) == 10
    assert bucket(600_000, 1e-3) == 100
    assert bucket(1000, 0.05) == 1


def test_means_stand_in_the_middle_of_their_samples():
    at, mean = averaged(np.arange(10.0), 5)
    assert at.tolist() == mean.tolist() == [2.0, 7.0]


def test_bins_follow_a_line_and_their_bars_hold_it_as_often_as_they_should():
    rng = np.random.default_rng(1)
    x = rng.uniform(-1.0, 1.0, 20_000)
    at, mean, error = binned(x, 3.0 * x + rng.normal(0.0, 1.0, x.size), 1.0, 100)
    assert at.size == 100
    assert 0.9 <= np.mean(np.abs(mean - 3.0 * at) < error) <= 1.0


def test_sparse_bins_are_left_out():
    x = np.concatenate([np.zeros(100), [1.0]])
    at, _, _ = binned(x, x, 1.0, 10)
    assert at.tolist() == [0.0]
    assert binned(np.ones(5), np.ones(5), 1.0)[0].size == 0


def test_steps_are_found_where_the_command_stands_before_and_after():
    u = np.concatenate([np.zeros(400), np.ones(400), np.full(100, 0.5), np.zeros(400)])
    found = steps_of(u, 1e-3)
    assert {pair: at.tolist() for pair, at in found.items()} == {(0.0, 1.0): [400]}


def test_a_command_is_steady_but_around_its_jumps():
    u = np.concatenate([np.zeros(500), np.ones(500)])
    still = steady(u, 1e-3)
    assert not still[445:555].any()
    assert still[:430].all()
    assert still[570:].all()


def test_reversals_of_a_sine_are_its_turning_points_and_small_ones_do_not_count():
    time = np.arange(10_000) * 1e-3
    angle = np.sin(2.0 * np.pi * 0.5 * time) + 0.01 * np.sin(2.0 * np.pi * 20.0 * time)
    found = reversals(angle, 0.2)
    assert [d for _, _, d in found] == [-1, 1] * 5
    turning = np.array([k for k, _, _ in found]) * 1e-3
    assert turning == pytest.approx(np.arange(0.5, 10.0, 1.0), abs=0.05)
    assert found[0][1] == found[1][0]


def test_a_motion_without_a_turn_has_no_reversals():
    assert reversals(np.zeros(100), 0.2) == []
    assert reversals(np.linspace(0.0, 0.1, 100), 0.2) == []


def test_a_residual_is_shown_as_it_is_judged():
    residual = np.concatenate([np.full(500, 2.0), np.full(500, -3.0)]) + np.tile([0.1, -0.1], 500)
    at, values = judged(residual, Noise(10, 50, True, 0.1))
    assert at.size == values.size == 102
    assert np.isnan(values).nonzero()[0].tolist() == [50, 101]  # no line joins two windows
    assert np.nanmax(np.abs(values)) < 1e-12
    _, kept = judged(residual, Noise(10, 50, False, 0.1))
    assert kept == pytest.approx(np.repeat([2.0, -3.0], 50))
