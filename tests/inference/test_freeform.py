"""Free functions of a signal: what each row holds for signals of which it is known."""

import numpy as np
import pytest

from cosim.inference.freeform import HATS, MEMORIES, MOST_SAMPLES, Explained, explained, features

U = np.sin(np.arange(2000) * 0.01) + 0.5 * np.sin(np.arange(2000) * 0.037)
HAT = slice(5, 5 + HATS - 2)
MEMORY = slice(-2 * MEMORIES, None)


@pytest.mark.parametrize(("scale", "shift"), [(1.0, 7.0), (1e6, -3e6), (1e-6, 0.0)])
def test_unit_and_zero_of_a_signal_do_not_matter(scale: float, shift: float) -> None:
    assert features(scale * U + shift, 0.01) == pytest.approx(features(U, 0.01), abs=1e-8)


def test_a_signal_that_stands_has_no_features() -> None:
    assert features(np.full(500, 3.0), 0.01).shape == (0, 500)


def test_values_are_centred_and_speeds_are_of_size_one() -> None:
    rows = features(U, 0.01)
    low, high = np.quantile(rows[0], [0.005, 0.995])
    assert (low, high) == pytest.approx((-0.5, 0.5))
    assert np.mean(rows[1] ** 2) == pytest.approx(1.0)
    assert rows[2] == pytest.approx(np.tanh(3.0 * rows[1]))
    assert rows[3] == pytest.approx(rows[1] * np.abs(rows[0]))
    assert rows[4] == pytest.approx(rows[0] * rows[2])


def test_hats_begin_at_equal_shares_of_the_samples() -> None:
    rows = features(np.linspace(0.0, 1.0, 2001) ** 3, 0.01)
    shares = np.mean(rows[HAT] > 0.0, axis=1)
    assert shares == pytest.approx(1.0 - np.arange(1, HATS - 1) / (HATS - 1), abs=1e-3)


@pytest.mark.parametrize(("n", "at"), [(1600, 400), (24, 6)])
def test_memories_of_a_step_decay_with_their_time_constants(n: int, at: int) -> None:
    """First order, from rest: what is left of a step of one is exp(-k / length); the longest an eighth of the log."""
    rows = features((np.arange(n) >= at).astype(float), 0.01)
    slow, left = rows[MEMORY][::2], rows[MEMORY][1::2]
    since = np.arange(1, n - at + 1)
    lengths = np.geomspace(2.0, max(n / 8.0, 4.0), MEMORIES)
    assert slow[:, :at] == pytest.approx(np.full((MEMORIES, at), -0.5))
    assert left[:, :at] == pytest.approx(np.zeros((MEMORIES, at)), abs=1e-12)
    assert left[:, at:] == pytest.approx(np.exp(-since / lengths[:, None]), abs=1e-9)
    assert slow[:, at:] == pytest.approx(0.5 - np.exp(-since / lengths[:, None]), abs=1e-9)


def test_memories_begin_where_the_signal_does() -> None:
    rows = features(U + 3.0 * np.exp(-np.arange(U.size) / 2.0), 0.01)
    slow, left = rows[MEMORY][::2], rows[MEMORY][1::2]
    assert slow[:, 0] == pytest.approx(np.full(MEMORIES, rows[0][0]))
    assert left[:, 0] == pytest.approx(np.zeros(MEMORIES), abs=1e-12)


def told(residual, signals) -> Explained:
    """Of ten windows every third is held out."""
    windows = np.arange(residual.size) * 10 // residual.size
    return explained(residual, signals, windows % 3 != 1, windows, 0.01)


def test_what_depends_on_a_signal_is_told_by_it_to_the_noise() -> None:
    rng = np.random.default_rng(1)
    other = np.cumsum(rng.standard_normal(U.size)) * 0.05
    law, noise = np.abs(U) * U, 0.1 * rng.standard_normal(U.size)
    found = told(law + noise, {"u": U, "other": other})
    held = np.arange(U.size) * 10 // U.size % 3 == 1
    assert found.before == pytest.approx(np.sqrt(np.mean((law + noise)[held] ** 2)))
    assert 0.095 < found.after < 0.14  # the noise, and what a walk outside the range it was fitted in adds
    assert found.size == pytest.approx(np.sqrt(found.before**2 - found.after**2))
    assert found.sure
    assert found.ci95[0] < found.after / found.before < found.ci95[1] < 0.3
    assert found.by["u"] > 0.9
    assert sum(found.by.values()) == pytest.approx(1.0)
    assert np.sqrt(np.mean((found.series - law) ** 2)) < 0.05


def test_of_noise_nothing_is_told() -> None:
    found = told(np.random.default_rng(2).standard_normal(U.size), {"u": U})
    assert not found.sure
    assert found.after > 0.97 * found.before


@pytest.mark.parametrize(
    ("count", "looked_at"), [(900, 900), (MOST_SAMPLES, MOST_SAMPLES), (MOST_SAMPLES + 1, 6001)]
)
def test_of_a_long_log_every_so_many_samples_are_looked_at(count, looked_at) -> None:
    signal = np.sin(np.arange(count) * 0.01)
    assert told(signal**2, {"u": signal}).series.size == looked_at
