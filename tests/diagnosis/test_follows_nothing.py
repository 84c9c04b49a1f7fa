"""A model that errs as much as a constant reading would is not adequate, whatever passes for noise."""

from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis.answer.answer import localisation
from cosim.diagnosis.residuals.freeform import Leftover
from cosim.diagnosis.verdict.verdict import unfollowed

TIME = np.arange(1000) * 0.02
NOISE = 0.02 * np.random.default_rng(1).normal(size=TIME.size)


def found(measured, residual):
    """What is known of a group whose model leaves this of a signal."""
    rule = SimpleNamespace(demean=False, windows=lambda x: x.reshape(10, -1))
    group = SimpleNamespace(name="mechanical")
    task = SimpleNamespace(
        rules={"speed": rule},
        measured={"speed": measured},
        model=SimpleNamespace(h=0.02, group=group),
        predicted=lambda fit: {"speed": measured - residual},
    )
    chosen = SimpleNamespace(fit=SimpleNamespace(residuals={"speed": residual}))
    return SimpleNamespace(task=task, chosen=chosen, after={})


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
