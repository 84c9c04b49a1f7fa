"""A model that errs as much as a constant reading would is not adequate, whatever passes for noise."""

from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis.answer.answer import left_too_much, localisation
from cosim.diagnosis.residuals.freeform import Leftover
from cosim.diagnosis.thresholds import LAW_KNOWN_TO
from cosim.diagnosis.verdict.verdict import negligible, unfollowed
from fmus import registry

TIME = np.arange(1000) * 0.02
NOISE = 0.02 * np.random.default_rng(1).normal(size=TIME.size)


def found(measured, residual):
    """What is known of a group whose model leaves this of a signal."""
    rule = SimpleNamespace(demean=False, windows=lambda x: x.reshape(10, -1))
    group = SimpleNamespace(name="mechanical")
    task = SimpleNamespace(
        rules={"speed": rule},
        measured={"speed": measured},
        model=SimpleNamespace(h=0.02, cuts=(), group=group),
        predicted=lambda fit: {"speed": measured - residual},
    )
    chosen = SimpleNamespace(fit=SimpleNamespace(residuals={"speed": residual}))
    return SimpleNamespace(task=task, chosen=chosen, null=chosen, after={})


@pytest.mark.parametrize(
    ("measured", "residual", "told"),
    [
        # a meter without direction, as on two motors coupled by a belt: "nothing is wrong", of an error of 141 %
        (np.abs(np.sin(3.0 * TIME)) + NOISE, np.abs(np.sin(3.0 * TIME)) - np.sin(3.0 * TIME) + NOISE, True),
        (np.sin(3.0 * TIME) + NOISE, 0.3 * np.cos(3.0 * TIME) + NOISE, False),
        (NOISE, NOISE, False),  # nothing moves
        # a supply pressure that wanders, and is constant in the model
        (0.2 * np.sin(0.3 * TIME) + NOISE, 0.2 * np.sin(0.3 * TIME) + NOISE, False),
    ],
)
def test_what_moves_must_be_followed(measured, residual, told):
    """Noise learned of errors that are as slow and as large as the motion took them all for noise."""
    assert unfollowed(found(measured, residual), "speed") is told


def test_a_cause_that_brings_the_model_to_a_stand_explains_nothing():
    """Friction beyond any torque stood in for the weight of an arm: all that moved was left, and passed for noise."""
    still = found(np.sin(3.0 * TIME) + NOISE, np.sin(3.0 * TIME) + NOISE)
    runs_away = SimpleNamespace(residuals={"speed": np.sin(3.0 * TIME) - TIME**2})
    still.task.predicted = lambda fit: {"speed": still.task.measured["speed"] - fit.residuals["speed"]}
    assert not unfollowed(still, "speed")  # a model that stands still by itself takes the signal for constant
    still.null = SimpleNamespace(fit=runs_away)
    assert unfollowed(still, "speed")


def test_what_matters_beside_a_model_that_runs_away_is_measured_by_the_motion(monkeypatch):
    """Its error of 42 000 deg made one of 20 deg too small to matter."""
    monkeypatch.setattr("cosim.diagnosis.verdict.verdict.rounding", lambda finding, signal: 0.0)
    motion = np.sin(3.0 * TIME)
    finding = found(motion, 0.1 * motion)
    finding.task.rules["speed"].rms = 1e-6
    finding.chosen.effects = (SimpleNamespace(sole_form=False),)
    finding.before = {"speed": SimpleNamespace(rms=700.0)}
    assert negligible(finding, "speed") == pytest.approx(LAW_KNOWN_TO * np.std(motion), rel=0.01)
    finding.before["speed"].rms = 0.1
    assert negligible(finding, "speed") == pytest.approx(LAW_KNOWN_TO * 0.1)


def test_the_block_that_follows_nothing_has_the_error(monkeypatch):
    """It was unexplained, and its block had "0 % of the error"."""
    belt = np.abs(np.sin(3.0 * TIME))
    finding = found(belt + NOISE, belt - np.sin(3.0 * TIME) + NOISE)
    finding.task.rules["speed"].rms = 1.0
    finding.chosen.fit.log_likelihood, finding.chosen.effects = 0.0, ()
    finding.null, finding.events = finding.chosen, {}
    finding.before = {"speed": Leftover(1.0, 0.0, 0.5, belt, {}, {}, 0.0)}
    monkeypatch.setattr("cosim.diagnosis.answer.answer.at_first", lambda finding, signal: 0.5)
    (place,) = localisation(SimpleNamespace(findings={"mechanical": finding}))
    assert place.share == 1.0


@pytest.mark.parametrize(("after", "told"), [(2.0, True), (60.0, False)])
def test_what_comes_nearest_is_told_where_it_leaves_too_much_to_be_named(monkeypatch, after, told):
    """The weight of an arm took 220 deg of error to 3: not named beside trusted numbers, nothing was said of it."""
    effect = registry.effects()["mechanical.gravity_load"]
    names = {"mechanical.tau_g": 2.2, "mechanical.theta_g": 0.0}
    fit = SimpleNamespace(values=names, deviations=dict.fromkeys(names, 0.1))
    left = {
        part: {"slew": SimpleNamespace(rms=np.radians(v), gain=1.0)}
        for part, v in (("before", 50.0), ("after", after))
    }
    finding = SimpleNamespace(chosen=SimpleNamespace(effects=(effect,), fit=fit), **left)
    diagnosis = SimpleNamespace(findings={"mechanical": finding}, between={})
    monkeypatch.setattr("cosim.diagnosis.answer.answer.stands", lambda finding: False)
    found = left_too_much(diagnosis)
    assert [item.effect for item in found] == ["mechanical.gravity_load"] * told
    for item in found:
        assert "falls from 50 to 2 deg" in item.why
        assert item.parameters["tau_g"].value == pytest.approx(2.2)
    monkeypatch.setattr("cosim.diagnosis.answer.answer.stands", lambda finding: True)
    assert left_too_much(diagnosis) == []
