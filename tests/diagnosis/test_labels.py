"""Labels that the data contradict are the verdict, before any cause is looked for (CONTRACT section 9)."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.labels import MISTAKES, changed, said
from cosim.diagnosis.answer import answer
from cosim.diagnosis.story import diagnose
from cosim.logs import Log
from cosim.report.deliver import delivered
from cosim.rig import make_log
from cosim.rig.write import as_log


@pytest.fixture(scope="module")
def log() -> Log:
    """A synthetic log with dry friction."""
    return as_log(make_log("mixed", 21.0, ["mechanical.coulomb_friction:tau_c=100"], seed=3))


@pytest.mark.parametrize("name", MISTAKES)
def test_each_wrong_label_is_told(log: Log, name: str) -> None:
    make, signals = MISTAKES[name]
    told = said(make(log, np.random.default_rng(1)))
    assert {t.signal for t in told} <= signals
    assert told
    assert all(t.remedy for t in told)


def test_the_unit_and_its_factor_are_named(log: Log) -> None:
    (told,) = said(changed(log, slew=log.signals["slew"] * 180.0 / np.pi))
    assert told.finding == "slew: looks like deg labelled rad"
    assert told.factor == pytest.approx(180.0 / np.pi)


@pytest.mark.parametrize(
    "hidden",
    [
        [],
        ["mechanical.coulomb_friction:tau_c=400"],
        ["continuity.leakage:c_l=0.6"],
        ["dcv.stroke_limit:x_max=1.0 mm,x_min=-1.0 mm"],
        ["mechanical.backlash:gap=2 deg"],
    ],
    ids=str,
)
def test_right_labels_are_left_alone_whatever_is_wrong_with_the_machine(hidden: list[str]) -> None:
    assert said(as_log(make_log("mixed", 21.0, hidden, seed=5))) == []


def test_the_finding_is_the_verdict_and_nothing_physical_stands_beside_it(log: Log, tmp_path) -> None:
    wrong = changed(log, p_a=14.5038 * log.signals["p_a"], p_b=14.5038 * log.signals["p_b"])
    found = diagnose(wrong)
    assert (found.verdict, found.causes) == ("implausible_data", [])
    assert answer(found, wrong, None).data[0].finding == "p_a and p_b: looks like psi labelled bar"
    delivered(found, wrong, tmp_path)
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert written["verdict"] == "implausible_data"
    assert "looks like psi" in (tmp_path / "report.html").read_text()


def test_signs_are_all_that_is_asked_of_a_machine_whose_gains_are_not_known(log: Log) -> None:
    scaled = replace(log, signals=log.signals | {"slew": 30.0 * log.signals["slew"]})
    from cosim.diagnosis.labels import contradictions
    from cosim.diagnosis.machine import our_machine
    from cosim.diagnosis.story import prepare

    machine = our_machine("full_order")
    assert contradictions(scaled, prepare(scaled, machine), machine, trusted=False) == []
