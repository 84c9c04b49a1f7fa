"""How much of a signal a fit leaves in the windows by which a search is judged."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.noise import plain
from cosim.diagnosis.fitting.trials import Trial
from cosim.diagnosis.hypotheses.naming import remaining

FIT = Fit({}, {}, 0.0, 0, {}, np.empty((0, 0)))


def leaving(residual: np.ndarray) -> Fit:
    return replace(FIT, residuals={"slew": residual})


def task(count: int, demean: bool = False) -> SimpleNamespace:
    return SimpleNamespace(measured={"slew": np.zeros(count)}, rules={"slew": plain(10, 50, demean)})


def test_what_is_constant_over_a_window_counts_only_where_it_is_to() -> None:
    ripple = np.random.default_rng(6).normal(size=5000)
    still, off = leaving(ripple), leaving(0.3 * ripple + np.repeat(np.arange(10.0), 500))
    assert remaining(task(5000, True), Trial((), off, 0)) < remaining(task(5000, True), Trial((), still, 0))  # type: ignore[arg-type]
    assert remaining(task(5000), Trial((), off, 0)) > 3.0  # type: ignore[arg-type]
