"""Correlations of estimates from their covariance."""

import numpy as np
import pytest

from cosim.correlation import correlations


def test_a_variance_that_rounding_made_negative_or_nobody_knows_has_no_correlation() -> None:
    covariance = np.array(
        [
            [4.0, 1.0, 0.5, np.nan],
            [1.0, 1.0, 0.1, np.nan],
            [0.5, 0.1, -1e-18, 0.0],
            [np.nan, np.nan, 0.0, np.nan],
        ]
    )
    assert correlations(["a", "b", "c", "d"], covariance) == {("a", "b"): pytest.approx(0.5)}


def test_none_is_beyond_one() -> None:
    covariance = np.array([[1.0, -1.0 - 1e-12], [-1.0 - 1e-12, 1.0]])
    assert correlations(["a", "b"], covariance) == {("a", "b"): -1.0}
