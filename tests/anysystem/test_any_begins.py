"""A parameter that is an initial value takes, in each log, what its signal begins with."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.systems.parts import by_pythonfmu

TANK = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Tank(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.valve, self.level, self.K, self.first = 0.0, 0.0, 0.1, 0.0
        self.register_variable(Real("valve", causality=Fmi2Causality.input))
        self.register_variable(Real("level", causality=Fmi2Causality.output))
        self.register_variable(Real("K", causality=Fmi2Causality.parameter))
        self.register_variable(Real("first", causality=Fmi2Causality.parameter))

    def exit_initialization_mode(self):
        self.level = self.first

    def do_step(self, t, step):
        self.level += step * self.K * self.valve
        return True
"""
MAPPING = """
[time]
column = "time"
unit = "s"
[signals.valve]
column = "valve"
unit = "1"
held = true
[signals."Tank.level"]
column = "level"
unit = "1"
[diagnose]
trusted = ["Tank.K"]
"""


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tank")
    return by_pythonfmu("Tank", TANK, folder)


def log(file: Path, first: float, seed: int) -> Path:
    """A tank of 0.13 instead of 0.1 a second that is filled and emptied from a level on."""
    rng = np.random.default_rng(seed)
    valve = np.repeat(rng.uniform(-1.0, 1.0, 20), 30)
    valve[:30] = 0.0
    level = first + np.concatenate([[0.0], np.cumsum(0.1 * 0.13 * valve)[:-1]])
    table = np.column_stack([0.1 * np.arange(600), valve, level + 0.002 * rng.standard_normal(600)])
    np.savetxt(file, table, "%.9g", delimiter=",", header="time,valve,level", comments="")
    return file


@pytest.mark.parametrize(
    "stated", ['"Tank.first" = "Tank.level"', 'first = "level"', ""], ids=["stated", "in short", "left out"]
)
def test_each_log_begins_where_its_reading_does(command, tank: Path, tmp_path: Path, stated: str) -> None:
    mapping = tmp_path / "m.toml"
    mapping.write_text(f"{MAPPING}[compare.start]\n{stated}\n")
    logs = log(tmp_path / "one.csv", 2.0, 1), "--held-out", log(tmp_path / "two.csv", -1.0, 2)
    words = (*logs, "--model", tank, "--mapping", mapping, "--out", tmp_path / "o", "--json")
    code, out, err = command("diagnose", *words)
    assert code == 0, err
    found = json.loads(out)
    gain = found["gain"].get("Tank.level", found["signals"]["Tank.level"])
    if not stated:
        assert gain.get("rmse_after", 1.0) > 0.5
        return
    (cause,) = found["causes"]
    assert "parameter Tank.K" in {
        f"{cause['effect']} {cause['component']}.{cause['parameter']}",
        *cause["indistinguishable_from"],
    }
    assert gain["rmse_after"] == pytest.approx(0.002, rel=0.2)


def test_a_comparison_begins_there_too(command, tank: Path, tmp_path: Path) -> None:
    mapping, file = tmp_path / "m.toml", log(tmp_path / "one.csv", 2.0, 1)
    errors = []
    for stated in ('"Tank.first" = "Tank.level"', 'first = "Tank.level"', ""):
        mapping.write_text(f"{MAPPING}[compare.start]\n{stated}\n")
        code, out, err = command("compare", file, "--model", tank, "--mapping", mapping, "--json")
        assert code == 0, err
        errors.append(next(iter(json.loads(out)["signals"].values()))["rmse"])
    assert errors[0] == errors[1] < 0.5 < errors[2]


def test_a_beginning_that_cannot_be_is_told(command, tank: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "m.toml"
    starts = '"Tank.none" = "Tank.level"\n"Tank.valve" = "Tank.level"\n"Tank.K" = "Tank.level"\n"Tank.first" = "flow"\n'
    mapping.write_text(f"{MAPPING}[compare.start]\n{starts}")
    words = (
        log(tmp_path / "one.csv", 2.0, 1),
        "--model",
        tank,
        "--mapping",
        mapping,
        "--out",
        tmp_path / "o",
    )
    code, _, err = command("diagnose", *words)
    said = " ".join(err.split())
    assert code == 3
    for text in (
        "'Tank.none': the system has no real parameter of this name",
        "'Tank.valve': the system has no real parameter of this name",
        "'Tank.K': it is trusted or free as well",
        "'Tank.first': 'flow' is not measured",
    ):
        assert text in said
