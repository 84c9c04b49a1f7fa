"""Several logs behind one another: what is done to them is done to each by itself."""

import numpy as np
import pytest

from cosim.inference.pieces import by_piece, slope

CUTS = (3, 7)
ROW = np.array([1.0, 4.0, 2.0, 9.0, 5.0, 5.0, 8.0, 0.0, 7.0])


def test_a_sum_begins_anew_in_each_log_of_one_row_and_of_many() -> None:
    wanted = np.concatenate([np.cumsum(part) for part in (ROW[:3], ROW[3:7], ROW[7:])])
    assert np.array_equal(by_piece(np.cumsum, CUTS, ROW), wanted)
    rows = np.stack([ROW, 2.0 * ROW, -ROW])
    found = by_piece(lambda part: np.cumsum(part, axis=-1), CUTS, rows)
    assert np.array_equal(found, np.stack([wanted, 2.0 * wanted, -wanted]))
    assert np.array_equal(by_piece(np.cumsum, (), ROW), np.cumsum(ROW))
    assert np.array_equal(by_piece(np.add, CUTS, ROW, ROW), 2.0 * ROW)


def test_a_slope_does_not_reach_across_a_cut() -> None:
    time = np.array([0.0, 1.0, 3.0, 0.0, 2.0, 3.0, 4.0, 0.0, 5.0])
    ramps = np.repeat([2.0, -1.0, 4.0], (3, 4, 2))
    values = ramps * time + np.repeat([10.0, 20.0, 30.0], (3, 4, 2))
    assert slope(values, time, CUTS) == pytest.approx(ramps)
    even = ramps * np.concatenate([np.arange(3), np.arange(4), np.arange(2)]) * 0.1
    assert slope(even, 0.1, CUTS) == pytest.approx(ramps)
    assert slope(3.0 * np.arange(5.0), 0.5) == pytest.approx(np.full(5, 6.0))
