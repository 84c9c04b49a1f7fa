"""What a signal was some time ago: its values at the steps, straight between them, the first before them."""

from types import SimpleNamespace

import numpy as np
import pytest

from fmus.ring import RING, ago

FIRST = -7.0
LONGEST = RING - 4  # steps that a delay may have


@pytest.mark.parametrize("count", [1, 2, 50, RING - 1, RING, RING + 3, 3 * RING + 11])
def test_values_lie_on_straight_lines_however_often_the_ring_is_full(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    memory = SimpleNamespace(ring=[np.nan] * RING)  # nothing is read that was not written
    place = 0
    for value in values[-RING:]:
        place = (place + 1) % RING
        memory.ring[place] = float(value)
    known = np.concatenate([[FIRST], values])
    for steps in (
        0.0,
        0.25,
        1.0,
        1.5,
        2.75,
        count - 1.5,
        count - 1.0,
        count - 0.75,
        count,
        count + 4.5,
        LONGEST - 0.5,
    ):
        if 0.0 <= steps <= LONGEST:
            expected = np.interp(count - steps, np.arange(count + 1), known)
            assert ago(float(steps), place, float(count), FIRST, memory) == pytest.approx(expected, abs=1e-12)


def test_a_delay_longer_than_the_ring_is_as_long_as_the_ring() -> None:
    memory = SimpleNamespace(ring=np.arange(float(RING)).tolist())
    found = [ago(steps, 10, 1e6, FIRST, memory) for steps in (LONGEST, LONGEST + 0.5, 1e12)]
    assert found == [float((10 - LONGEST) % RING)] * 3
