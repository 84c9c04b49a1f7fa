"""``cosim machine``, ``compare``, ``simulate`` and ``identify drive`` with a machine in one file."""

import json

import numpy as np
import pandas as pd
import pytest

from cosim.cli import main
from cosim.compare import load_mapping
from cosim.machines import in_package
from cosim.request import model_path
from cosim.ssp.read import read_system

MACHINE = """
name = "small drive"
time = { column = "t", unit = "s" }
[signals]
u = { column = "duty", unit = "1", zero = 50.0, gain = 0.02 }
slew = { column = "angle", unit = "rad" }
[machine]
chain = ["simplified"]
"""


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.setenv("COSIM_BUILD", str(tmp_path / "build"))
    rng = np.random.default_rng(2)
    command = np.repeat(rng.uniform(-1.0, 1.0, 40), 25)
    angle = np.concatenate([[0.0], np.cumsum(0.6 * command * 0.02)[:-1]])
    table = np.column_stack([0.02 * np.arange(command.size), 50.0 + 50.0 * command, angle])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,duty,angle", comments="", fmt="%.9g")
    (tmp_path / "machine.toml").write_text(MACHINE)
    return tmp_path / "machine.toml", tmp_path / "log.csv"


def run(capsys, *words):
    with pytest.raises(SystemExit) as stop:
        main([*map(str, words)])
    captured = capsys.readouterr()
    return stop.value.code, captured.out, captured.err


def test_machine_writes_what_other_tools_take(capsys, files, tmp_path):
    mapping, log = files
    code, out, _ = run(capsys, "machine", mapping, "--log", log, "--out", tmp_path / "out", "--json")
    found = json.loads(out)
    assert code == 0
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "small_drive.ssd",
        "small_drive.ssp",
        "simplified.ssv",
    }
    values = {n: v["value"] for n, v in found["parameters"].items()}
    assert values["simplified.k"] / values["simplified.a"] == pytest.approx(0.6, rel=0.02)
    assert {v["source"] for v in found["parameters"].values()} == {"from the log"}


def test_machine_without_a_log_says_what_is_missing(capsys, files, tmp_path):
    code, _, err = run(capsys, "machine", files[0], "--out", tmp_path / "out")
    assert code == 2
    assert "simplified.k and simplified.a" in err
    assert "--log LOG" in err


def test_compare_and_simulate_make_it_by_themselves(capsys, files):
    mapping, log = files
    code, out, _ = run(capsys, "compare", log, "--mapping", mapping, "--json")
    assert code == 0
    assert json.loads(out)["signals"]["slew"]["fit_percent"] > 95.0
    code, out, _ = run(capsys, "simulate", mapping, "--input", log, "--json")
    assert code == 0
    assert json.loads(out)["model"] == "small_drive"


def test_each_command_says_that_a_number_has_no_unit(capsys, files):
    mapping, log = files
    mapping.write_text(MACHINE + 'speed = "0.6"\nlag = "300 ms"\n')
    said = "speed = 0.6 as 0.6 rad/s; write the unit"
    code, out, _ = run(capsys, "compare", log, "--mapping", mapping, "--json")
    assert code == 0
    assert any(said in note for note in json.loads(out)["notes"])
    code, _, err = run(capsys, "simulate", mapping, "--input", log)
    assert (code, said in " ".join(err.split())) == (0, True)


@pytest.mark.parametrize("travels", [False, True], ids=["turns", "travels"])
def test_a_simulation_begins_where_the_mapping_says(capsys, files, tmp_path, travels):
    mapping, log = files
    header, *rows = log.read_text().splitlines()
    place = header.lstrip("# ").split(",").index("angle")
    table = np.array([[float(v) for v in row.split(",")] for row in rows])
    table[:, place] += 0.7
    np.savetxt(log, table, "%.9g", ",", header=header, comments="")
    text = MACHINE + 'speed = "?"\nlag = "?"\n'
    if travels:
        text = text.replace("slew = ", "travel = ").replace('"rad"', '"m"')
    shown = "travel" if travels else "slew"
    mapping.write_text(text + f'[compare.start]\n"simplified.theta_0" = "{shown}"\n')
    code, _, err = run(capsys, "simulate", mapping, "--input", log, "--si", "--out", tmp_path / "run.csv")
    assert code == 0, err
    found = pd.read_csv(tmp_path / "run.csv", comment="#")
    (name,) = [n for n in found if n.startswith("simplified.theta")]
    assert found[name].iloc[0] == pytest.approx(table[0, place], abs=0.02)


def test_a_travel_is_compared_with_a_package_of_its_machine(capsys, files, tmp_path):
    """Such as the extended model of a diagnosis, whose connectors have the blocks' units."""
    mapping, log = files
    text = MACHINE.replace("slew = ", "travel = ").replace('"rad"', '"mm"')
    mapping.write_text(text + 'motion = "travel"\noutput = "travel"\n')
    assert run(capsys, "machine", mapping, "--log", log, "--out", tmp_path / "out")[0] == 0
    found = []
    for model in ([], ["--model", tmp_path / "out" / "small_drive.ssp"]):
        code, out, err = run(capsys, "compare", log, "--mapping", mapping, *model, "--json")
        assert code == 0, err
        found.append(json.loads(out)["signals"]["travel"])
    assert found[0]["fit_percent"] > 95.0
    assert found[1]["fit_percent"] == pytest.approx(found[0]["fit_percent"], rel=1e-6)
    package, many = tmp_path / "out" / "small_drive.ssp", tmp_path / "many"
    code, out, err = run(
        capsys, "batch", log, "--mapping", mapping, "--model", package, "--workers", 1, "--out", many
    )
    assert code == 0, out + err
    scores = pd.read_parquet(many / "runs.parquet").iloc[0]
    assert scores["travel fit [%]"] == pytest.approx(found[0]["fit_percent"], rel=1e-6)
    with read_system(tmp_path / "out" / "small_drive.ssp") as system:
        assert in_package(system, *load_mapping(mapping))["travel"].factor == "1 rad/(m)"
        mapping.write_text(MACHINE)
        assert in_package(system, *load_mapping(mapping)) == {}


def test_a_machine_of_another_log_does_not_take_the_place_of_the_first(files, tmp_path):
    """Two commands at once made one file each for the other."""
    mapping, log = files
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    table[:, 2] *= 0.5
    other = tmp_path / "other.csv"
    np.savetxt(other, table, delimiter=",", header="t,duty,angle", comments="", fmt="%.9g")
    first, second = (model_path(str(mapping), log=file) for file in (log, other))
    assert first.name == second.name == "small_drive.ssp"
    assert first.read_bytes() != second.read_bytes()


def test_identify_drive(capsys, files):
    mapping, log = files
    code, out, _ = run(capsys, "identify", "drive", log, "--mapping", mapping, "--json")
    found = json.loads(out)["drive_curve"]
    assert code == 0
    # no dead zone was put in
    assert abs(found["dead_zone"]["high"]["value"]) < 0.03
    assert found["dead_zone"]["high"]["reading"]["column"] == "duty"


def test_a_simulated_machine_has_the_units_of_its_mapping(capsys, monkeypatch, tmp_path):
    """Of a motor that its torque drives: "torque [bar]" stood there, 5e-7 of it, and the speed in deg/s."""
    monkeypatch.setenv("COSIM_BUILD", str(tmp_path / "build"))
    time = 0.01 * np.arange(300)
    table = np.column_stack([time, np.full(300, 0.06), np.zeros(300)])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,tau,w", comments="", fmt="%.9g")
    mapping = tmp_path / "motor.toml"
    mapping.write_text(
        """
time = { column = "t", unit = "s" }
[signals]
torque = { column = "tau", unit = "N.m" }
speed = { column = "w", unit = "rad/s" }
[machine]
chain = ["mechanical"]
parameters = { "mechanical.J" = "1.2e-4 kg.m2", "mechanical.b" = "1.2e-4 N.m.s/rad" }
"""
    )
    out = tmp_path / "run.csv"
    code, _, err = run(capsys, "simulate", mapping, "--input", tmp_path / "log.csv", "--out", out)
    assert code == 0, err
    found = pd.read_csv(out)
    assert found["torque [N.m]"].to_numpy() == pytest.approx(0.06)
    speed = 0.06 / 1.2e-4 * (1.0 - np.exp(-found["time [s]"].to_numpy()))
    assert found["mechanical.omega [rad/s]"].to_numpy() == pytest.approx(speed, abs=1.0)
