"""Whether one fit leaves less than another by more than the choice of windows may have made."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.noise import plain
from cosim.diagnosis.fitting.trials import Trial
from cosim.diagnosis.hypotheses.naming import remaining
from cosim.diagnosis.residuals.cross_validation import errs_less

FIT = Fit({}, {}, 0.0, 0, {}, np.empty((0, 0)))


def leaving(residual: np.ndarray) -> Fit:
    return replace(FIT, residuals={"slew": residual})


def task(count: int, demean: bool = False) -> SimpleNamespace:
    return SimpleNamespace(measured={"slew": np.zeros(count)}, rules={"slew": plain(10, 50, demean)})


@pytest.mark.parametrize("windows", [1, 2, 20])
@pytest.mark.parametrize(("share", "expected"), [(0.5, True), (1.0, False), (2.0, False)])
def test_half_the_error_is_clearly_less_also_in_one_window(
    windows: int, share: float, expected: bool
) -> None:
    rng = np.random.default_rng(5)
    one, other = (rng.normal(size=500 * windows) for _ in range(2))
    assert errs_less(task(500 * windows), leaving(share * one), leaving(other), demean=False) is expected  # type: ignore[arg-type]


def test_what_is_constant_over_a_window_counts_only_where_it_is_to() -> None:
    rng = np.random.default_rng(6)
    ripple = rng.normal(size=5000)
    still, off = leaving(ripple), leaving(0.3 * ripple + np.repeat(np.arange(10.0), 500))
    assert errs_less(task(5000), still, off, demean=False)  # type: ignore[arg-type]
    assert errs_less(task(5000), off, still, demean=True)  # type: ignore[arg-type]
    assert remaining(task(5000, True), Trial((), off, 0)) < remaining(task(5000, True), Trial((), still, 0))  # type: ignore[arg-type]
    assert remaining(task(5000), Trial((), off, 0)) > 3.0  # type: ignore[arg-type]
