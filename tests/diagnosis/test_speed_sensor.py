"""A machine that measures its speed: a gyroscope alone, or beside the angle."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cosim.diagnosis.answer.remarks import zero_of_speed
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.model.groups import Group, merged
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.logs import load_log
from cosim.rig import make_log
from tests.diagnosis.hidden_logs import off

NOISE = 1e-3  # rad/s, of a MEMS gyroscope over some 100 Hz
UNITS = {
    "u": "1",
    "spool": "m",
    "p_a": "Pa",
    "p_b": "Pa",
    "p_supply": "Pa",
    "slew": "rad",
    "slew_rate": "rad/s",
}
PRESSURES = ("u", "spool", "p_a", "p_b", "p_supply")


def files(
    folder: Path, columns: tuple[str, ...], *hidden: str, bias: float = 0.0, seed: int = 5, lines: str = ""
) -> tuple[Path, Path]:
    """A synthetic log with a gyroscope, as files."""
    run = make_log("steps", 10.0, hidden, seed=seed, settings=off(seed, *hidden))
    gyro = run.true["omega"] + bias + NOISE * np.random.default_rng(seed).standard_normal(run.time.size)
    values = {n: gyro if n == "slew_rate" else getattr(run, n) for n in columns}
    log, mapping = folder / "log.csv", folder / "map.toml"
    pd.DataFrame({"time": run.time, **values}).to_csv(log, index=False)
    tables = [f'[signals.{n}]\ncolumn = "{n}"\nunit = "{UNITS[n]}"\n' for n in columns]
    bound = '[compare.signals.slew_rate]\nvariable = "mechanical.omega"\n'
    mapping.write_text("\n".join(['[time]\ncolumn = "time"\nunit = "s"\n', *tables, bound, lines]))
    return log, mapping


def diagnosed(
    folder: Path, columns: tuple[str, ...], *hidden: str, bias: float = 0.0, lines: str = ""
) -> Diagnosis:
    """Diagnosis of the mechanics, alone where the pressures that drive them were measured."""
    path, mapping = files(folder, columns, *hidden, bias=bias, lines=lines)
    log = load_log(path, mapping)
    machine = machine_of("full_order", log, mapping)
    if set(PRESSURES) <= set(columns):
        machine = replace(machine, groups=machine.groups[-1:])
        assert machine.groups[0].name == "mechanical"
    return diagnose(log, model=machine)


def mechanics(folder: Path, columns: tuple[str, ...]) -> Group:
    path, mapping = files(folder, columns)
    log = load_log(path, mapping)
    machine = machine_of("full_order", log, mapping)
    return merged(machine.groups, prepare(log, machine).signals)[-1]


def test_with_a_gyroscope_alone_the_group_ends_at_the_mechanics(tmp_path: Path) -> None:
    group = mechanics(tmp_path, (*PRESSURES, "slew_rate"))
    assert (group.components, group.observed) == (("mechanical",), ("slew_rate",))
    assert group.is_speed("slew_rate")
    assert group.reading is None


def test_a_gyroscope_beside_the_angle_shows_the_same_group(tmp_path: Path) -> None:
    group = mechanics(tmp_path, (*PRESSURES, "slew", "slew_rate"))
    assert (group.components, group.observed) == (("mechanical", "sensor"), ("slew", "slew_rate"))
    assert not group.is_speed("slew")
    assert group.reading == "slew"
    assert group.shows("mechanical", "omega") == "slew_rate"


@pytest.mark.parametrize(
    "columns",
    [
        (*PRESSURES, "slew_rate"),
        pytest.param(("u", "slew_rate"), marks=pytest.mark.slow),
        pytest.param((*PRESSURES, "slew", "slew_rate"), marks=pytest.mark.slow),
    ],
)
def test_friction_is_found_in_a_speed(tmp_path: Path, columns: tuple[str, ...]) -> None:
    found = diagnosed(tmp_path, columns, "mechanical.coulomb_friction:tau_c=400 N.m")
    assert [c.effect.name for c in found.causes] == ["mechanical.coulomb_friction"]
    assert found.causes[0].parameters["tau_c"][0] == pytest.approx(400.0, rel=0.05)
    assert found.verdict == "explained"


def test_a_gyroscope_whose_zero_is_off_looks_as_a_constant_load_does(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, (*PRESSURES, "slew_rate"), bias=0.01)
    assert [c.effect.name for c in found.causes] == ["mechanical.constant_load"]
    (said,) = zero_of_speed(found)
    assert re.search(r"mechanical.constant_load moves slew_rate by 0\.010?\d* throughout", said), said
    assert "`drifting`" in said


@pytest.mark.slow
def test_the_zero_of_a_gyroscope_that_drifts_is_no_cause(tmp_path: Path) -> None:
    drifting = '[diagnose]\ndrifting = ["slew_rate"]\n'
    found = diagnosed(tmp_path, (*PRESSURES, "slew_rate"), bias=0.01, lines=drifting)
    assert found.causes == []
    assert found.verdict == "adequate"


def test_the_speed_tells_that_the_angle_sensor_is_wrong(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, (*PRESSURES, "slew", "slew_rate"), "sensor.drift")
    assert [c.effect.name for c in found.causes] == ["sensor.drift"]
