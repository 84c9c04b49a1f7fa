"""Free functions of a signal: what each row holds for signals of which it is known."""

import numpy as np
import pytest

from cosim.inference.freeform import HATS, MEMORIES, features

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


def test_memories_of_a_step_decay_with_their_time_constants() -> None:
    """First order, from rest: what is left of a step of one is exp(-k / length)."""
    n, at = 1600, 400
    rows = features((np.arange(n) >= at).astype(float), 0.01)
    slow, left = rows[MEMORY][::2], rows[MEMORY][1::2]
    since = np.arange(1, n - at + 1)
    lengths = np.geomspace(2.0, n / 8.0, MEMORIES)
    assert slow[:, :at] == pytest.approx(np.full((MEMORIES, at), -0.5))
    assert left[:, :at] == pytest.approx(np.zeros((MEMORIES, at)), abs=1e-12)
    assert left[:, at:] == pytest.approx(np.exp(-since / lengths[:, None]), abs=1e-9)
    assert slow[:, at:] == pytest.approx(0.5 - np.exp(-since / lengths[:, None]), abs=1e-9)
