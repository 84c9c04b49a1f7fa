"""The error of a free run in parts, with and without a new start in each."""

import numpy as np
import pytest

from cosim.inference.held_out import mean_squares


def test_parts_of_a_free_run_as_it_is() -> None:
    error = np.repeat([1.0, 2.0, 3.0], 100)
    np.testing.assert_allclose(mean_squares(error, 3), [1.0, 4.0, 9.0])


def test_what_was_off_before_a_part_does_not_count_in_it_anew() -> None:
    # a push in the second part: the third goes on beside the truth, and errs no more
    error = np.concatenate([np.zeros(100), np.linspace(0.0, 5.0, 100), np.full(100, 5.0)])
    found = mean_squares(error, 3, anew=True)
    assert found[0] == found[2] == 0.0
    assert found[1] == pytest.approx(25.0 / 3.0, rel=0.05)
    assert mean_squares(error, 3)[2] == pytest.approx(25.0)


def test_another_log_begins_anew_within_a_part() -> None:
    error = np.repeat([0.0, 7.0], 50)
    assert mean_squares(error, 1, anew=True)[0] == pytest.approx(24.5)
    assert mean_squares(error, 1, anew=True, cuts=(50,))[0] == 0.0


def test_a_gain_off_by_a_hundredth_shows_in_every_part_and_not_as_its_sum() -> None:
    """A ramp of ten parts: the free run errs most at its end, the parts all alike."""
    ramp = 0.01 * np.linspace(0.0, 10.0, 1000)
    whole, anew = mean_squares(ramp, 10), mean_squares(ramp, 10, anew=True)
    assert whole[-1] > 200.0 * whole[0]
    np.testing.assert_allclose(anew, anew[0], rtol=1e-6)
