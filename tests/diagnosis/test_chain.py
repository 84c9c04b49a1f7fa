"""What is not known of a block upstream, handed on as directions of doubt."""

import numpy as np
import pytest

from cosim.diagnosis.fitting.chain import directions
from cosim.diagnosis.fitting.fit import Fit


def fitted(covariance: list[list[float]]) -> Fit:
    """Estimates with this covariance."""
    values = {f"dcv.{name}": float(i + 1) for i, name in enumerate("abcd"[: len(covariance)])}
    return Fit(values, {}, 0.0, 10, {}, np.array(covariance))


def test_directions_add_up_to_the_covariance() -> None:
    covariance = np.array([[4.0, 1e-3], [1e-3, 1e-6]])
    found = fitted(covariance.tolist())
    moves = np.array([[m[n] - found.values[n] for n in found.values] for m in directions(found)])
    assert moves.T @ moves == pytest.approx(covariance)


def test_what_the_data_say_nothing_of_has_no_direction() -> None:
    """A stop that is never met: its row is rounding, its column zero, and a step along it was 1e63 wide."""
    found = fitted([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [-1e-27, -1e-21, 0.0]])
    moves = directions(found)
    assert [set(m) for m in moves] == [{"dcv.a", "dcv.b"}] * 2
    assert all(abs(m[n] - found.values[n]) <= 2.0 for m in moves for n in m)


def test_correlations_beyond_one_by_rounding_do_no_harm() -> None:
    moves = directions(fitted([[1e-40, 1e-20], [1e-20, 1.0]]))
    assert all(np.isfinite(v) and abs(v) < 5.0 for m in moves for v in m.values())


def test_without_estimates_there_is_no_doubt() -> None:
    assert directions(Fit({}, {}, 0.0, 10, {}, np.empty((0, 0)))) == []
