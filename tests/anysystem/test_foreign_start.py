"""The log that a benchmark makes of FMUs of other people begins where its components agree."""

from types import SimpleNamespace

import fmpy
import fmpy.fmi2
import numpy as np
import pytest

from benchmarks.systems.foreign import own_parts, step_by_fmpy

GAINS = {"one": 2.0, "two": -0.5, "three": 3.0}


class Straight:
    """y = gain u, handed on at once; the gain is told by the name."""

    def __init__(self, instanceName, **_):
        self.gain, self.u = GAINS[instanceName], 0.0

    def setReal(self, numbers, values):
        (self.u,) = values

    def getReal(self, numbers):
        return [self.gain * self.u]

    def instantiate(self):
        pass

    def setupExperiment(self, **_):
        pass

    enterInitializationMode = exitInitializationMode = instantiate
    doStep = setupExperiment


@pytest.fixture(autouse=True)
def straight(monkeypatch):
    """fmpy with such components."""
    variables = [
        SimpleNamespace(name=n, valueReference=k, type="Real", causality=c)
        for k, (n, c) in enumerate([("u", "input"), ("y", "output")])
    ]
    description = SimpleNamespace(
        guid="",
        coSimulation=SimpleNamespace(modelIdentifier="straight"),
        modelVariables=variables,
        defaultExperiment=None,
    )
    monkeypatch.setattr(fmpy, "extract", lambda *_: None)
    monkeypatch.setattr(fmpy, "read_model_description", lambda *_, **__: description)
    monkeypatch.setattr(fmpy.fmi2, "FMU2Slave", Straight)


def spec(tmp_path, hidden=(), first="u"):
    return {
        "fmus": dict.fromkeys(GAINS, "no.fmu"), "h": 0.1, "count": 12, "fine": 2, "values": {}, "tolerance": None,
        "scratch": str(tmp_path), "hidden": list(hidden), "record": ["one.y", "two.y", "three.y"],
        "feeds": {"one.u": first, "two.u": "one.y", "three.u": "two.y"},
    }  # fmt: skip


def test_what_is_handed_straight_on_has_gone_through_the_chain_at_the_first_sample(tmp_path):
    found = step_by_fmpy(spec(tmp_path), {"u": np.linspace(4.0, 5.0, 12)})
    assert [found[n][0] for n in ("one.y", "two.y", "three.y")] == [8.0, -4.0, -12.0]


def test_an_effect_in_a_wire_is_there_at_the_first_sample_and_remembers_it_once(tmp_path):
    delay = {"effect": "port.delay", "port": "two.u", "where": "input", "values": {"delay": 0.2}}
    offset = {"effect": "port.offset", "port": "three.y", "where": "output", "values": {"offset": 1.0}}
    drift = {"effect": "port.drift", "port": "one.y", "where": "output", "values": {"rate": 1.0}}
    u = np.arange(12.0)
    clean, found = (step_by_fmpy(spec(tmp_path, h), {"u": 4.0 + u}) for h in ((), (delay, offset)))
    assert found["three.y"][0] == clean["three.y"][0] + 1.0
    late = np.concatenate([np.full(2, clean["two.y"][0]), clean["two.y"][:-2]])
    np.testing.assert_allclose(found["two.y"], late)
    drifting = step_by_fmpy(spec(tmp_path, [drift]), {"u": 4.0 + u})
    np.testing.assert_allclose(drifting["one.y"] - clean["one.y"], 0.1 * u, atol=1e-12)


def test_a_start_on_which_the_components_do_not_agree_is_an_error(tmp_path):
    offset = {"effect": "port.offset", "port": "one.u", "where": "input", "values": {"offset": 1.0}}
    with pytest.raises(RuntimeError, match="no fixed point"):
        step_by_fmpy(spec(tmp_path, [offset], first="three.y"), {"u": np.zeros(12)})


@pytest.mark.parametrize(
    ("declared", "parts"), [(None, 1), ("0.001", 1), ("0.004", 5), ("0.005", 5), ("0.01", 10), ("0.1", 10)]
)
def test_an_fmu_is_not_asked_for_shorter_steps_than_it_declares(declared, parts):
    model = SimpleNamespace(defaultExperiment=SimpleNamespace(stepSize=declared))
    assert own_parts(model, 0.001, 10) == parts
