"""Exact responses against scipy's simulation, and the exponential against scipy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.signal import lsim

from cosim.identify.linear import (
    _decay,
    _exponential,
    _march,
    delayed,
    free_responses,
    responses,
    simulate,
)

H = 1e-3
rates = st.floats(0.3, 300.0)


def lively(count=400):
    t = np.arange(count) * H
    return np.sin(9.0 * t) + 0.3 * np.sign(np.sin(31.0 * t))


@given(st.lists(rates, min_size=1, max_size=4), st.booleans())
@settings(max_examples=25, deadline=None)
def test_responses_are_those_of_scipy(poles, integrates):
    """First-order hold, each power of s in the numerator; with and without an integrator."""
    denominator = np.poly([-p for p in poles])
    denominator = np.append(denominator, 0.0) if integrates else denominator
    u = lively()
    found = responses(denominator, u, H, held=False)
    for j in range(denominator.size - 1):
        expected = lsim(([1.0] + [0.0] * j, denominator), u, np.arange(u.size) * H)[1]
        # scipy's own state space of many far poles is good to 1e-8 of the response's size
        assert np.abs(found[j] - expected).max() <= 1e-7 * (np.abs(expected).max() + 1e-12), j


def test_held_input_steps_exactly():
    """K w0^2 / (s^2 + 2 zeta w0 s + w0^2) to a step: the textbook response."""
    w0, zeta = 25.23, 0.545
    found = simulate([w0**2], [1.0, 2 * zeta * w0, w0**2], np.ones(600), H, held=True)
    t = np.arange(600) * H
    wd = w0 * np.sqrt(1 - zeta**2)
    expected = 1 - np.exp(-zeta * w0 * t) * (np.cos(wd * t) + zeta * w0 / wd * np.sin(wd * t))
    assert np.abs(found - expected).max() < 1e-12


def test_what_marches_over_a_log_is_compiled_once():
    for order in (1, 3):
        for held_input in (False, True):
            responses(np.poly([-2.0] * order), lively(), H, held_input)
        free_responses(np.poly([-2.0] * order), 10, H)
    assert [len(f.signatures) for f in (_march, _decay)] == [1, 1]


def test_free_responses_span_what_is_left_of_the_past():
    denominator = np.poly([-2.0, -30.0, 0.0])
    rows = free_responses(denominator, 500, H)
    t = np.arange(500) * H
    past = 0.3 * np.exp(-2.0 * t) - 1.1 * np.exp(-30.0 * t) + 0.7
    factors = np.linalg.lstsq(rows.T, past, rcond=None)[0]
    assert np.abs(factors @ rows - past).max() < 1e-9


@pytest.mark.parametrize("steps", [0.0, 0.4, 3.0, 7.25])
def test_delay_moves_a_straight_line_by_its_length(steps):
    u = 2.0 * np.arange(100.0)
    found = delayed(u, steps)
    assert np.allclose(found[10:], 2.0 * (np.arange(100.0) - steps)[10:])
    assert np.array_equal(delayed(u, -1e-9), u)


@given(st.integers(1, 6), st.floats(1e-3, 300.0), st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_exponential_is_that_of_scipy(n, size, seed):
    a = np.random.default_rng(seed).normal(size=(n, n))
    a = size * (a - 3.0 * np.eye(n))
    assert np.allclose(_exponential(a), expm(a), rtol=1e-9, atol=1e-12)
