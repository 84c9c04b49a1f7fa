"""Estimates of a diagnosis, a calibration or a parameter set, from their file to the draws of a batch."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.batch.cases import plan_batch
from cosim.batch.plan import Plan
from cosim.batch.sources import read_estimates
from cosim.errors import DataError, ModelError, UsageError
from cosim.ssp.xml import parse, schema_problems
from tests.batch.texts import write


def answer(**more: Any) -> dict[str, Any]:
    lists = (
        "localisation",
        "causes",
        "unexplained",
        "not_exercised",
        "isolability",
        "helpful_signals",
        "warnings",
    )
    tables = ("signals", "gain", "not_judged", "nominal", "made")
    found: dict[str, Any] = {name: [] for name in lists} | {name: {} for name in tables}
    found |= {
        "verdict": "explained",
        "synthetic": True,
        "model": "full_order",
        "extended": None,
        "next_experiment": None,
    }
    return found | more


def test_intervals_of_a_diagnosis_are_varied(packages: dict[str, Path], tmp_path: Path) -> None:
    cause = {"effect": "mechanical.coulomb_friction", "block": "mechanical", "evidence": {}, "rivals": []}
    cause |= {
        "indistinguishable_from": [],
        "parameters": {"tau_c": {"value": 120.0, "unit": "N.m", "ci95": [110.0, 130.0]}},
    }
    seam = {
        **cause,
        "effect": "tracker.seam",
        "block": "tracker",
        "parameters": {"seam": {"value": 1.0, "unit": "deg", "ci95": [0.9, 1.1]}},
    }
    nominal = {
        "dcv.K": {"value": 2.38, "unit": "mm", "ci95": [2.36, 2.40]},
        "mechanical.theta_0": {"value": 10.0, "unit": "deg", "ci95": [10.0, 10.0]},
    }
    extended = {"ssp": "elsewhere/extended.ssp", "ssv": "elsewhere/extended.ssv"}
    package = tmp_path / "extended.ssp"
    package.write_bytes(packages["full_order"].read_bytes())
    together = [{"parameters": ["dcv.K", "mechanical.tau_c"], "correlation": -0.9}]
    content = answer(causes=[cause, seam], nominal=nominal, extended=extended, correlations=together)
    file = write(tmp_path / "diagnosis.json", json.dumps(content))
    batch = plan_batch(Plan.model_validate({"from": str(file), "samples": 50}), tmp_path)
    assert batch.job.models[0].file.path == str(package), "the package beside the diagnosis"
    assert batch.job.models[0].fixed == {"mechanical.theta_0": pytest.approx(0.17453292519943295)}
    assert [p.name for p in batch.varied] == ["dcv.K", "mechanical.tau_c"]
    drawn = [float(run.parameters["mechanical.tau_c"]) for run in batch.runs]
    assert len(drawn) == 50
    assert 100.0 < min(drawn) < 115.0 < 125.0 < max(drawn) < 140.0
    gains = [float(run.parameters["dcv.K"]) for run in batch.runs]
    assert np.corrcoef(gains, drawn)[0, 1] == pytest.approx(-0.9, abs=0.08)
    kept = plan_batch(Plan.model_validate({"from": str(file), "set": {"dcv.K": "2.4 mm"}}), tmp_path)
    assert [p.name for p in kept.varied] == ["mechanical.tau_c"]


def test_intervals_of_a_calibration_are_varied(packages: dict[str, Path], tmp_path: Path) -> None:
    parameters = [
        {"name": "mechanical.J", "unit": "kg.m2", "value": 800.0, "ci95": [780.0, 820.0], "determined": True},
        {
            "name": "mechanical.b",
            "unit": "N.m.s/rad",
            "value": 27e3,
            "ci95": [26e3, 28e3],
            "determined": True,
        },
        {"name": "mechanical.tau_c", "unit": "N.m", "value": 0.0, "ci95": None, "determined": True},
        {"name": "dcv.K", "unit": "m", "value": 1.0, "ci95": [0.0, 2.0], "determined": False},
    ]
    covariance = np.full((4, 4), np.nan)
    covariance[:2, :2] = np.outer([10.0, 500.0], [10.0, 500.0]) * [[1.0, 0.97], [0.97, 1.0]]
    content = {
        "parameters": parameters,
        "covariance": [[None if np.isnan(v) else v for v in row] for row in covariance],
        "start_values": {"mechanical.theta_0": 0.2},
    }
    file = write(tmp_path / "calibration.json", json.dumps(content))
    asked = {"model": str(packages["full_order"]), "from": str(file), "samples": 400}
    batch = plan_batch(Plan.model_validate(asked), tmp_path)
    assert [p.name for p in batch.varied] == ["mechanical.J", "mechanical.b"]
    assert batch.job.models[0].fixed == {"mechanical.tau_c": 0.0, "mechanical.theta_0": 0.2}
    drawn = np.array([[run.parameters[p.name] for p in batch.varied] for run in batch.runs])
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.97, abs=0.02)
    assert np.std(drawn, axis=0) == pytest.approx([10.2, 510.0], rel=0.1)
    asked["vary"] = {
        "mechanical.b": "27000 +- 1000 N.m.s/rad"
    }  # the user's own: of that no correlation is known
    batch = plan_batch(Plan.model_validate(asked), tmp_path)
    drawn = np.array([[run.parameters[p.name] for p in batch.varied] for run in batch.runs])
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 0.2
    content["covariance"] = [[1.0]]
    with pytest.raises(DataError, match="its covariance is not that of its 4 parameters"):
        read_estimates(write(file, json.dumps(content)))
    del parameters[0]["ci95"]
    with pytest.raises(
        DataError, match=r"calibration\.json is no diagnosis\.json or calibration\.json.*ci95"
    ):
        read_estimates(write(file, json.dumps(content)))


SSV = """<ssv:ParameterSet xmlns:ssv='http://ssp-standard.org/SSP1/SystemStructureParameterValues'
 xmlns:ssc='http://ssp-standard.org/SSP1/SystemStructureCommon' version='1.0' name='fitted'><ssv:Parameters>
 <ssv:Parameter name='mechanical.J'><ssv:Real value='800' unit='kg.m2'/>{note}</ssv:Parameter>
 <ssv:Parameter name='mechanical.b'><ssv:Real value='27000' unit='N.m.s/rad'/></ssv:Parameter>
 </ssv:Parameters></ssv:ParameterSet>"""
NOTE = """<ssv:Annotations><ssc:Annotation type='slew-cosim.ci95'><ci95 low='780' high='830'/>
 </ssc:Annotation></ssv:Annotations>"""


def test_intervals_of_a_parameter_set_are_varied(packages: dict[str, Path], tmp_path: Path) -> None:
    text = SSV.format(note=NOTE)
    assert schema_problems(parse(text.encode(), "x")) == []
    file = write(tmp_path / "fitted.ssv", text)
    asked = {"model": str(packages["full_order"]), "from": str(file), "samples": 9}
    batch = plan_batch(Plan.model_validate(asked), tmp_path)
    assert [p.name for p in batch.varied] == ["mechanical.J"]
    assert batch.job.models[0].fixed == {"mechanical.b": 27000.0}
    with pytest.raises(UsageError, match="no parameter with a 95 % interval"):
        read_estimates(write(tmp_path / "plain.ssv", SSV.format(note="")))
    with pytest.raises(ModelError, match=r"annotation of 'mechanical\.J' should hold"):
        read_estimates(write(tmp_path / "bad.ssv", SSV.format(note=NOTE.replace("low='780'", ""))))


@pytest.mark.parametrize("text", ["{", "{}", "[1]"])
def test_what_is_no_diagnosis_is_told(tmp_path: Path, text: str) -> None:
    with pytest.raises(DataError, match=r"diagnosis\.json is no diagnosis"):
        read_estimates(write(tmp_path / "diagnosis.json", text))
