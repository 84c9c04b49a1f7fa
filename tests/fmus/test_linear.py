"""phi functions and the 2x2 exponential, against sums of their series in 60 to 400 decimal digits and against scipy."""

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.linalg import expm

from fmus.linear import expm2, phi_functions

ROUNDING = 2e-15  # a handful of roundings in double precision


def phi_reference(a: float) -> tuple[float, ...]:
    """exp(-a) and phi1..phi3 with enough digits that cancellation does not show."""
    with localcontext() as context:
        context.prec = 60
        x = Decimal(a)
        if x == 0:
            return 1.0, 1.0, 0.5, float(Decimal(1) / 6)
        context.prec = 120  # phi3 cancels three times where a is small
        values = [(-x).exp()]
        for term in (Decimal(1), Decimal(1), Decimal(1) / 2):
            values.append((term - values[-1]) / x)
        return tuple(float(v) for v in values)


@given(st.floats(1e-12, 700.0) | st.floats(0.9, 1.1))
@example(0.0)
@example(1.0)
@example(math.nextafter(1.0, 0.0))
@example(1e-30)
def test_phi_functions_to_rounding(a: float) -> None:
    assert phi_functions(a) == pytest.approx(phi_reference(a), rel=5 * ROUNDING, abs=0.0)


def test_phi_functions_of_a_very_fast_pole() -> None:
    decay, phi1, phi2, phi3 = phi_functions(1e15)
    assert decay == 0.0
    assert (phi1, phi2, phi3) == pytest.approx((1e-15, 1e-15, 0.5e-15), rel=1e-14)


def expm_reference(entries: tuple[float, ...], t: float) -> np.ndarray:
    """exp(M t) by its Taylor series in 400 digits: no scaling, no closed form."""
    with localcontext() as context:
        context.prec = 400
        m = np.array([Decimal(e) * Decimal(t) for e in entries], dtype=object).reshape(2, 2)
        term = np.array([[Decimal(1), Decimal(0)], [Decimal(0), Decimal(1)]], dtype=object)
        total = term.copy()
        for k in range(1, 600):
            term = term.dot(m) / Decimal(k)
            total = total + term
        return total.astype(float)


entry = st.floats(-30.0, 30.0).filter(lambda v: v == 0.0 or abs(v) > 1e-6)


@given(st.tuples(entry, entry, entry, entry), st.floats(1e-4, 1.0))
@example((0.0, 1.0, -25.0, -10.0), 0.3)  # two equal eigenvalues
@example((0.0, 1.0, 0.0, 0.0), 1.0)  # nilpotent
@example((-4.4, -7.744 * 2.5, 1.0, -6.16 * 2.5), 0.1)  # the observer
def test_expm2_to_rounding(entries: tuple[float, ...], t: float) -> None:
    expected = expm_reference(entries, t)
    found = np.array(expm2(*entries, t)).reshape(2, 2)
    size = np.linalg.norm(entries) * t
    # the argument of exp is itself rounded: relative error eps times its size
    assert np.abs(found - expected).max() <= ROUNDING * (2.0 + size) * np.linalg.norm(expected)


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.545, 1.0, 1.0 + 1e-9, 1.25, 10.0, 100.0])
@pytest.mark.parametrize("w0_t", [1e-4, 0.025, 1.0, 30.0])
def test_expm2_of_an_oscillator_against_scipy(zeta: float, w0_t: float) -> None:
    w0 = 25.23
    M = np.array([[0.0, 1.0], [-(w0**2), -2 * zeta * w0]])
    t = w0_t / w0
    expected = expm(M * t)
    found = np.array(expm2(*M.ravel(), t)).reshape(2, 2)
    scale = np.array([[1.0, 1.0 / w0], [w0, 1.0]])  # deviation and speed in their own sizes
    # the slow pole of a strongly damped pair is the difference of two large numbers, in scipy's matrix as well as here
    limit = 3e-14 * max(1.0, w0_t, 2.0 * zeta * w0_t)
    assert np.abs((found - expected) / scale).max() < limit


def test_expm2_does_not_overflow_where_the_fast_pole_is_extreme() -> None:
    """zeta = 100, w0 = 1e4 rad/s and a step of 1 s lie within the valve's bounds; cosh would overflow."""
    w0, zeta = 1e4, 100.0
    a11, a12, a21, a22 = expm2(0.0, 1.0, -w0 * w0, -2.0 * zeta * w0, 1.0)
    slow = w0 / (zeta + math.sqrt(zeta**2 - 1.0))  # without cancellation
    assert a11 == pytest.approx(math.exp(-slow), rel=1e-3, abs=1e-12)
    assert all(map(math.isfinite, (a11, a12, a21, a22)))


@given(st.floats(0.0, 50.0), st.floats(0.0, 3.0), st.floats(1e-3, 0.2), st.integers(2, 9))
def test_expm2_of_a_sum_of_times_is_the_product(w0: float, zeta: float, t: float, n: int) -> None:
    M = (0.0, 1.0, -w0 * w0, -2.0 * zeta * w0)
    part = np.array(expm2(*M, t / n)).reshape(2, 2)
    whole = np.array(expm2(*M, t)).reshape(2, 2)
    # repeated multiplication adds up rounding: n steps of a matrix whose norm is at most w0^2
    assert np.abs(np.linalg.matrix_power(part, n) - whole).max() < 1e-14 * n * (1.0 + w0 * w0)
