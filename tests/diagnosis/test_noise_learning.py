"""Noise is learned in its colour and size, and whitening makes it independent and of unit size."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from cosim.diagnosis.fitting.noise import kinds, learned, plain
from cosim.rig import Noise

H = 1e-3
BINS, WINDOW = 10, 495


def coloured(kind: str, seed: int, seconds: float = 60.0) -> np.ndarray:
    """A minute of the rig's noise of the slew sensor, rad."""
    count = round(seconds / H)
    return Noise(kind=kind, correlation_time=0.05).draw("slew", count, seed)


@pytest.mark.parametrize("kind", ["white", "ar1", "pink"])
@pytest.mark.parametrize("demean", [True, False])
def test_whitened_noise_is_white_and_of_unit_size(kind: str, demean: bool) -> None:
    noise = coloured(kind, seed=3)
    rule = learned(plain(BINS, WINDOW, demean), noise, np.empty((0, noise.size)))
    white = rule(noise)
    # 5940 values: their variance is known to 2 %; four of these, and as much for what the kinds cannot follow
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.12)
    for lag in (1, 2, 5, 20):
        correlation = np.mean(white[:, lag:] * white[:, :-lag])
        assert abs(correlation) < 0.08, (lag, correlation)


@pytest.mark.parametrize("demean", [True, False])
def test_a_window_is_whitened_by_the_cholesky_factor_of_its_covariance(demean: bool) -> None:
    """Of several residuals at once as of one."""
    rule = replace(plain(4, 30, demean), sizes=(0.5, 0.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    residuals = np.random.default_rng(5).standard_normal((3, 500))
    factor = np.linalg.cholesky(np.tensordot(rule.sizes, kinds(30), axes=1))
    together = rule.each(list(residuals))
    assert together.shape == (3, 4, 30)
    for residual, white in zip(residuals, together, strict=True):
        means = residual[:480].reshape(4, 30, 4).mean(axis=2)
        expected = np.linalg.solve(factor, means.T)
        if demean:  # what an offset of the window would explain
            level = np.linalg.solve(factor, np.ones(30))
            expected -= np.outer(level, level @ expected) / (level @ level)
        np.testing.assert_allclose(white, expected.T, atol=1e-11)
        np.testing.assert_allclose(rule(residual), white, atol=1e-12)


def test_size_of_white_noise_is_recovered() -> None:
    rng = np.random.default_rng(1)
    noise = 3e-4 * rng.normal(size=60_000)
    rule = learned(plain(BINS, WINDOW, True), noise, np.empty((0, noise.size)))
    assert rule.sigma == pytest.approx(3e-4 / np.sqrt(BINS), rel=0.05)


def test_what_free_functions_absorb_does_not_make_the_noise_smaller() -> None:
    rng = np.random.default_rng(2)
    noise = lfilter([1.0], [1.0, -0.98], rng.normal(size=60_000))
    time = np.arange(noise.size) * H
    absorbed = np.stack([np.sin(0.3 * k * time) for k in range(1, 13)])
    free = learned(plain(BINS, WINDOW, True), noise, np.empty((0, noise.size)))
    behind = learned(plain(BINS, WINDOW, True), noise, absorbed)
    assert behind.sigma == pytest.approx(free.sigma, rel=0.05)


def test_a_model_error_in_the_span_of_free_functions_is_not_taken_for_noise() -> None:
    rng = np.random.default_rng(4)
    noise = rng.normal(size=60_000)
    time = np.arange(noise.size) * H
    shapes = np.stack([np.sin(2.0 * time), np.cos(2.0 * time)])
    wrong = noise + 20.0 * shapes[0]
    with_error = learned(plain(BINS, WINDOW, False), wrong, shapes)
    without = learned(plain(BINS, WINDOW, False), noise, shapes)
    assert with_error.sigma == pytest.approx(without.sigma, rel=0.01)


def test_samples_at_the_start_are_left_out() -> None:
    rule = plain(BINS, 100, False, skip=500)
    signal = np.zeros(6_500)
    signal[:500] = 1e9
    assert np.all(rule.windows(signal) == 0.0)
    assert rule.windows(signal).shape == (6, 100)
