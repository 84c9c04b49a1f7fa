"""Sizes of kinds of noise by Whittle's likelihood."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.inference.whittle import likeliest

OMEGA = np.linspace(0.02, np.pi, 150)
TAUS = (1.0, 3.0, 10.0, 40.0, 150.0)
# white noise, and noise of each correlation time: Lorentzians of unit size
SHAPES = np.stack([np.ones_like(OMEGA), *(2.0 * tau / (1.0 + (tau * OMEGA) ** 2) for tau in TAUS)])
LEAST = np.full(len(SHAPES), 1e-7)


def cost(sizes: np.ndarray, power: np.ndarray) -> float:
    """Whittle's likelihood, negative."""
    model = sizes @ SHAPES
    return float(np.sum(np.log(model) + power / model))


def drawn(seed: int, looks: int) -> np.ndarray:
    """A periodogram of a few kinds of noise, averaged over so many windows."""
    rng = np.random.default_rng(seed)
    sizes = np.zeros(len(SHAPES))
    sizes[rng.choice(len(SHAPES), 3, replace=False)] = 10.0 ** rng.uniform(-5.0, 0.0, 3)
    return (sizes @ SHAPES) * rng.gamma(looks, 1.0 / looks, OMEGA.size)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 30))
def test_no_other_sizes_are_likelier(seed: int, looks: int) -> None:
    power, rng = drawn(seed, looks), np.random.default_rng(seed + 1)
    total = float(power.mean())
    found = likeliest(SHAPES, power, LEAST * total)
    assert np.all(found >= LEAST * total)
    best = cost(found, power)
    for _ in range(30):
        others = np.maximum(found * np.exp(0.1 * rng.standard_normal(found.size)), LEAST * total)
        others += total * 10.0 ** rng.uniform(-6.0, -1.0) * (rng.random(found.size) < 0.2)
        assert best <= cost(others, power) + 1e-6


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 30))
def test_rounding_does_not_decide_where_the_search_ends(seed: int, looks: int) -> None:
    power, rng = drawn(seed, looks), np.random.default_rng(seed + 1)
    least = LEAST * float(power.mean())
    spectra = [
        likeliest(SHAPES, p, least) @ SHAPES
        for p in (power, power * (1.0 + 1e-13 * rng.standard_normal(power.size)))
    ]
    np.testing.assert_allclose(*spectra, rtol=1e-5)


def test_the_spectrum_expected_gives_the_sizes_back() -> None:
    sizes = np.array([0.3, 0.0, 2.0, 0.0, 0.0, 0.5])
    found = likeliest(SHAPES, sizes @ SHAPES, LEAST)
    np.testing.assert_allclose(found, sizes, atol=2e-3)


def test_what_is_known_beforehand_is_not_sought_again() -> None:
    sizes, known = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.5]), 0.8 * SHAPES[2]
    found = likeliest(SHAPES, sizes @ SHAPES + known, LEAST, known=known)
    np.testing.assert_allclose(found, sizes, atol=2e-3)
