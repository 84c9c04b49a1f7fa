"""A cause that only an impossible value of one of its parameters makes fit is not named."""

from collections.abc import Iterator

import numpy as np
import pytest

from benchmarks.labels import MISTAKES
from cosim.diagnosis.fitting.bounds import absurd, beyond, impossible
from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.trials import tried
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.hypotheses.naming import nominal
from cosim.diagnosis.model.groups import left_out
from cosim.diagnosis.pipeline import diagnose as pipeline
from cosim.rig import make_log
from cosim.rig.write import as_log
from fmus import registry
from tests.diagnosis.hidden_logs import diagnosed, off, only

GRAVITY = "mechanical.gravity_load:tau_g=190 N.m,theta_g=-20 deg"
RIPPLE = registry.effects()["mechanical.gear_ripple"]
STRIBECK = registry.effects()["mechanical.stribeck_friction"]


@pytest.fixture(scope="module")
def without_gravity() -> Iterator[Diagnosis]:
    """Gravity hidden in a log whose diagnosis does not know it: the nearest law is a ripple of too long a period."""
    with left_out("mechanical.gravity_load"):
        yield diagnosed(GRAVITY, seed=11, seconds=40.0)


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
    found = diagnosed("mechanical.gear_ripple:tau_r=80 N.m,n_r=20,phi_r=0.5", seed=5, seconds=25.0)
    assert [c.effect.name for c in found.causes] == ["mechanical.gear_ripple"]
    finding = found.findings["mechanical"]
    assert beyond(finding.chosen, RIPPLE, finding.task.model) == 0.0


def test_an_effect_that_ends_at_its_off_value_is_only_absent() -> None:
    machine = only("mechanical")
    record = pipeline.prepare(as_log(make_log("mixed", 25.0, [], seed=3, settings=off(3))), machine)
    task = task_for(machine.groups[0], record, [])
    null = nominal(task, record, 0.01)
    trial = tried(task, (registry.effects()["mechanical.coulomb_friction"],), 0.01, null.fit)
    assert np.isfinite(trial.fit.log_likelihood)
    assert impossible(trial, task.model) == []


@pytest.mark.slow
def test_friction_that_is_nearly_nothing_in_motion_is_another_law() -> None:
    found = diagnosed(
        "mechanical.stribeck_friction:tau_c=0 N.m,tau_s=150 N.m,omega_s=0.01",
        seed=12,
        seconds=12.0,
        excitation="steps",
        blocks=("mechanical",),
    )
    assert "mechanical.stribeck_friction" not in [c.effect.name for c in found.causes]
    finding = found.findings["mechanical"]
    trial = tried(finding.task, (STRIBECK,), 0.01, finding.null.fit)
    size = {p: trial.fit.values[f"mechanical.{p}"] for p in ("tau_c", "tau_s")}
    assert size["tau_s"] > 50.0  # it would explain the log nearly
    assert size["tau_s"] == pytest.approx(STRIBECK.free["tau_s"].within[1] * size["tau_c"])
    assert impossible(trial, finding.task.model) == [STRIBECK]


@pytest.mark.parametrize(
    ("name", "sizes", "nominal", "wanted"),
    [
        ("continuity.leakage", {"c_l": -0.46}, {"c_l": 0.0}, True),
        ("continuity.leakage", {"c_l": 0.0}, {"c_l": 0.0}, False),
        ("continuity.leakage", {"c_l": 0.7}, {"c_l": 0.0}, False),
        ("sensor.gain", {"gain": 0.069}, {"gain": 1.0}, True),
        ("sensor.gain", {"gain": 57.3}, {"gain": 1.0}, True),
        ("sensor.gain", {"gain": -1.0}, {"gain": 1.0}, True),
        ("sensor.gain", {"gain": 2.0}, {"gain": 1.0}, True),
        ("sensor.gain", {"gain": 1.12}, {"gain": 1.0}, False),
        ("mechanical.coulomb_friction", {"tau_c": 14670.0}, {"tau_c": 0.0}, True),
        ("mechanical.coulomb_friction", {"tau_c": 280.0}, {"tau_c": 0.0}, False),
        ("dcv.offset", {"x_0": 0.01}, {"x_0": 0.0}, True),
        ("dcv.offset", {"x_0": 0.0099}, {"x_0": 0.0}, True),
        ("dcv.offset", {"x_0": 0.0015}, {"x_0": 0.0}, False),
        ("mechanical.linkage", {"e_l": -0.8, "theta_l": 0.3}, {"e_l": 0.0, "theta_l": 0.0}, True),
        ("dead_zone.mismatch", {"b_r": 0.0, "b_l": -0.4}, {"b_r": 0.45, "b_l": -0.4}, False),
        ("dcv.stroke_limit", {"x_max": 1.0, "x_min": -1e-3}, {"x_max": 1.0, "x_min": -1.0}, False),
    ],
)
def test_a_size_beyond_or_at_the_end_of_what_it_can_be_is_another_law(name, sizes, nominal, wanted) -> None:
    assert absurd(registry.effects()[name], sizes, nominal, torque=470.0, travel=2.4e-3) == wanted


@pytest.mark.parametrize(
    ("at_rest", "wanted"), [(0.0, False), (500.0, False), (890.0, False), (899.0, True), (900.0, True)]
)
def test_friction_that_all_but_ends_in_motion_is_a_dead_band(at_rest, wanted) -> None:
    sizes = {"tau_c": 100.0, "tau_s": at_rest, "omega_s": 0.01}
    off = {"tau_c": 0.0, "tau_s": 0.0, "omega_s": 0.01}
    assert absurd(registry.effects()["mechanical.stribeck_friction"], sizes, off) == wanted


def test_a_torque_is_held_against_nothing_where_the_drive_is_not_known() -> None:
    assert not absurd(registry.effects()["mechanical.coulomb_friction"], {"tau_c": 1e6}, {"tau_c": 0.0})


@pytest.mark.slow
@pytest.mark.parametrize("mistake", ["psi labelled bar", "deg labelled rad", "rad labelled deg"])
def test_no_absurd_cause_is_named_even_where_nobody_looks_at_the_labels(
    mistake: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for check in ("contradictions", "clock"):
        monkeypatch.setattr(pipeline, check, lambda *_: [])
    log = as_log(make_log("mixed", 21.0, [], seed=3))
    found = pipeline.diagnose(MISTAKES[mistake][0](log, np.random.default_rng(0)))
    assert found.verdict == "unexplained"
    assert found.causes == []
