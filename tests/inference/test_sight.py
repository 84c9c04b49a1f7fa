"""What data show of several unknowns: known answers of linear algebra."""

import numpy as np
import pytest

from cosim.inference.sight import sight
from cosim.inference.thresholds import ROUNDING

RNG = np.random.default_rng(1)
SLOPES, OTHERS = RNG.standard_normal((50, 3)) * (1.0, 10.0, 0.1), RNG.standard_normal((50, 2))
NONE = np.empty((50, 0))


def test_the_deviations_of_unknowns_are_those_of_least_squares_with_all_others_unknown() -> None:
    every = np.hstack([OTHERS, SLOPES])
    covariance = np.linalg.inv(every.T @ every)[2:, 2:]
    found = sight(SLOPES, OTHERS)
    assert found.own == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-9)
    assert found.directions @ found.directions.T == pytest.approx(np.eye(3), abs=1e-12)
    sizes = np.einsum("ij,jk,ik->i", found.directions, covariance, found.directions)
    assert found.deviations == pytest.approx(np.sqrt(sizes), rel=1e-9)
    assert (np.diff(found.deviations) > 0.0).all()  # best seen first


def test_of_two_that_act_alike_only_their_sum_is_seen() -> None:
    slopes = SLOPES[:, [0, 0, 1]]
    found = sight(slopes, NONE)
    assert np.isfinite(found.deviations).tolist() == [True, True, False]
    assert np.abs(found.directions[2]) == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0.0], abs=1e-9)
    assert np.isinf(found.own).tolist() == [True, True, False]
    alone = sight(slopes[:, 1:], NONE)  # with the two made one it is as uncertain as before
    assert found.own[2] == pytest.approx(alone.own[1], rel=1e-9)


def test_what_others_make_up_for_is_not_seen_and_no_data_show_nothing() -> None:
    assert np.isinf(sight(OTHERS @ [[1.0], [-2.0]], OTHERS).own).all()
    assert np.isinf(sight(np.zeros((50, 2)), NONE).own).all()
    few = sight(SLOPES[:2], NONE[:2])  # two values for three unknowns
    assert np.isfinite(few.deviations).tolist() == [True, True, False]


@pytest.mark.parametrize("size", [3.0, 1e-3])
@pytest.mark.parametrize(("share", "seen"), [(0.5, False), (2.0, True)])
def test_what_is_smaller_than_rounding_beside_the_largest_is_not_seen(
    share: float, seen: bool, size: float
) -> None:
    jacobian = np.zeros((50, 2))
    jacobian[0, 0], jacobian[1, 1] = size, size * share * ROUNDING
    assert np.isfinite(sight(jacobian, NONE).own[1]) == seen
