"""Free functions explain what is systematic and do not explain noise."""

import numpy as np
import pytest
from scipy.stats import kstest

from cosim.diagnosis.fitting.noise import plain
from cosim.diagnosis.residuals.freeform import changing, explain, families, hats

H, N = 1e-3, 30_000
TIME = np.arange(N) * H
DRIVER = np.sin(1.3 * TIME) + 0.5 * np.sin(0.41 * TIME)
TRANSFER = ([1.0], [0.1, 1.0])


def leftover(residual: np.ndarray):
    """What is left of a residual with unit white noise a bin."""
    rule = plain(10, 500, False)
    bases = families({"x": DRIVER}, TRANSFER, H, "force", "N") + changing(
        "x", DRIVER, "time", TIME, TRANSFER, H, "force", "N"
    )
    # values of another signal of the same task, which is silent here, stand behind
    window = np.repeat(np.arange(12), 500)
    return explain(residual, bases, rule, lambda r: np.concatenate([rule(r).ravel(), np.zeros(3000)]), window)


def test_hats_are_a_partition_of_unity() -> None:
    _, columns = hats(DRIVER)
    assert columns.sum(axis=0) == pytest.approx(np.ones(N))


def test_a_constant_signal_offers_no_hats() -> None:
    knots, columns = hats(np.ones(100))
    assert knots.size == 0
    assert columns.shape == (0, 100)


@pytest.mark.slow
def test_probabilities_on_pure_noise_are_never_too_small() -> None:
    rng = np.random.default_rng(5)
    values = [leftover(rng.normal(size=N) * np.sqrt(10.0)).p_value for _ in range(40)]
    # a bound over several tests: at most as many small values as uniform ones, and not far fewer
    assert kstest(values, "uniform", alternative="greater").pvalue > 1e-3
    assert np.median(values) < 0.999


def test_a_missing_force_is_found_and_named_by_its_signal() -> None:
    rng = np.random.default_rng(6)
    missing = np.abs(DRIVER) * 0.5
    found = leftover(missing + rng.normal(size=N) * np.sqrt(10.0))
    assert found.p_value < 1e-12
    assert found.held_out > 100.0
    assert next(iter(found.by_signal)) == "force(x)"
    assert found.rms == pytest.approx(np.sqrt(np.mean(missing**2)), rel=0.1)


def test_a_gain_that_changes_with_time_is_found() -> None:
    rng = np.random.default_rng(7)
    missing = DRIVER * 1.5 * (TIME / TIME[-1] - 0.5)
    found = leftover(missing + rng.normal(size=N) * np.sqrt(10.0))
    assert found.p_value < 1e-12
    assert next(iter(found.by_signal)) == "force(x, changing with time)"
