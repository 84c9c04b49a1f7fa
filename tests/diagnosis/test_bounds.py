"""A cause that only an impossible value of one of its parameters makes fit is not named."""

from collections.abc import Iterator

import numpy as np
import pytest

from cosim.diagnosis.bounds import beyond, impossible
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.groups import left_out
from cosim.diagnosis.naming import tried
from fmus import registry
from tests.diagnosis.hidden_logs import told

GRAVITY = "mechanical.gravity_load:tau_g=190 N.m,theta_g=-20 deg"
RIPPLE = registry.effects()["mechanical.gear_ripple"]


@pytest.fixture(scope="module")
def without_gravity() -> Iterator[Diagnosis]:
    """Gravity hidden in a log whose diagnosis does not know it: the nearest law is a ripple of too long a period."""
    with left_out("mechanical.gravity_load"):
        yield told(GRAVITY, seed=11, seconds=40.0)


@pytest.mark.slow
def test_a_ripple_at_the_bound_of_its_period_is_not_named(without_gravity: Diagnosis) -> None:
    assert "mechanical.gear_ripple" not in [c.effect.name for c in without_gravity.causes]
    finding = without_gravity.findings["mechanical"]
    ripple = tried(finding.task, (RIPPLE,), 0.01, finding.null.fit)
    # the fit would have it all the same: nothing but the bound speaks against it
    assert ripple.fit.log_likelihood > finding.null.fit.log_likelihood + 1000.0
    assert ripple.fit.values["mechanical.n_r"] == pytest.approx(RIPPLE.parameters["n_r"].low)
    assert impossible(ripple, finding.task.model) == [RIPPLE]


@pytest.mark.slow
def test_a_true_ripple_is_not_at_a_bound() -> None:
    found = told("mechanical.gear_ripple:tau_r=80 N.m,n_r=20,phi_r=0.5", seed=5, seconds=25.0)
    assert [c.effect.name for c in found.causes] == ["mechanical.gear_ripple"]
    finding = found.findings["mechanical"]
    assert beyond(finding.chosen, RIPPLE, finding.task.model) == 0.0


def test_an_effect_that_ends_at_its_off_value_is_only_absent() -> None:
    finding = told(seed=3, seconds=25.0).findings["mechanical"]
    friction = registry.effects()["mechanical.coulomb_friction"]
    trial = tried(finding.task, (friction,), 0.01, finding.null.fit)
    assert np.isfinite(trial.fit.log_likelihood)
    assert impossible(trial, finding.task.model) == []
