"""`cosim diagnose` on a system of strangers: what is hidden is named at its connector, a clean log is adequate."""

import json
from pathlib import Path

import pytest
import systems

from benchmarks.systems.truth import Hidden


def diagnosed(command, log: Path, model: Path, tmp_path: Path, *words) -> dict:
    """The answer of the command line."""
    code, out, err = command("diagnose", log, "--model", model, "--out", tmp_path / "out", "--json", *words)
    assert code == 0, err
    return json.loads(out)


def test_a_clean_log_is_adequate(native: Path, command, tmp_path: Path) -> None:
    found = diagnosed(command, systems.log(tmp_path / "log.csv", [], 1), native, tmp_path)
    assert found["verdict"] == "adequate"
    assert found["causes"] == []
    assert found["unexplained"] == []


@pytest.mark.parametrize(
    ("hidden", "parameter", "tolerance"),
    [
        (Hidden("port.dead_zone", "plant.u", "input", {"low": -0.2, "high": 0.3}), "high", 0.05),
        (Hidden("port.saturation", "valve.u", "input", {"low": -0.6, "high": 0.5}), "low", 0.05),
        (Hidden("port.gain", "valve.y", "output", {"gain": 1.15}), "gain", 0.02),
    ],
    ids=lambda item: item.effect if isinstance(item, Hidden) else None,
)
def test_a_hidden_effect_is_named_at_its_connector(
    native: Path, command, tmp_path: Path, hidden: Hidden, parameter: str, tolerance: float
) -> None:
    found = diagnosed(command, systems.log(tmp_path / "log.csv", [hidden], 2), native, tmp_path)
    assert found["verdict"] == "explained"
    (cause,) = found["causes"]
    assert cause["effect"] == hidden.effect
    assert f"{cause['component']}.{cause['connector']}" == hidden.port
    assert cause["where"] == hidden.where
    told = cause["parameters"][parameter]
    assert told["value"] == pytest.approx(hidden.values[parameter], rel=tolerance)
    assert told["ci95"][0] < told["value"] < told["ci95"][1]
    assert found["localisation"][0]["block"] == cause["component"]


def test_a_reading_that_is_off_is_told_from_an_output_by_what_it_drives(
    native: Path, command, tmp_path: Path
) -> None:
    hidden = Hidden("port.gain", "valve.y", "sensor", {"gain": 1.15})
    found = diagnosed(command, systems.log(tmp_path / "log.csv", [hidden], 3), native, tmp_path)
    (cause,) = found["causes"]
    assert (cause["component"], cause["connector"], cause["where"]) == ("valve", "y", "sensor")
    assert not any("valve.y (output)" in other for other in cause["indistinguishable_from"])


def test_what_is_not_in_the_vocabulary_stays_unexplained_in_its_component(
    native: Path, command, tmp_path: Path
) -> None:
    hidden = Hidden("strange.square", "plant.y", "output", {"size": 0.4})
    found = diagnosed(command, systems.log(tmp_path / "log.csv", [hidden], 4), native, tmp_path)
    assert found["verdict"] == "unexplained"
    assert {item["block"] for item in found["unexplained"]} == {"plant"}
