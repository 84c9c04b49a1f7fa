"""`cosim simulate`: options, units, files, and the exit codes."""

import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import toy_fmus
from typer.testing import CliRunner, Result

from cosim.cli import make_app
from cosim.commands.simulate import _without_rests
from cosim.errors import ModelError, SimulationError, UsageError

TOP = Path(__file__).resolve().parents[2]
WIRES = ["w.y -> g.u", "g.y -> l.u"]


@pytest.fixture(scope="module")
def chain(toys: Any) -> Path:
    return toys.ssp({"w": "wave", "g": "gain", "l": "lag"}, WIRES, stop=0.5)


def simulate(*arguments: object) -> Result:
    return CliRunner().invoke(make_app(), ["simulate", *map(str, arguments)], catch_exceptions=False)


def test_json_holds_signals_and_facts_and_nothing_else_is_on_stdout(chain: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "cosim",
        "simulate",
        str(chain),
        "--set",
        "g.k=3",
        "--estimate-error",
        "--json",
    ]
    done = subprocess.run(command, cwd=TOP, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["label"], found["steps"], found["stop_time"]) == ("simulated", 500, 0.5)
    assert found["parameters"] == {"g.k": 3.0}
    assert found["signals"]["g.y"]["final"] == pytest.approx(3.0 * np.sin(0.5), rel=1e-12)
    assert found["signals"]["l.y"]["order"] == pytest.approx(2.0, abs=0.01)


def test_values_take_units_and_come_from_files_too(chain: Path, tmp_path: Path) -> None:
    values = tmp_path / "v.ssv"
    values.write_text(toy_fmus.ssv({"g.k": 5.0, "w.a": 2.0}), encoding="utf-8")
    out = tmp_path / "out.csv"
    done = simulate(
        chain, "--parameter-set", values, "--set", "w.a=0.5", "--stop-time", "200 ms", "--step-size", "10 ms",
        "--record", "g.y", "--out", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    frame = pd.read_csv(out)
    assert list(frame) == ["time [s]", "g.y [m]"]
    assert len(frame) == 21
    assert frame["g.y [m]"].iloc[-1] == pytest.approx(5.0 * 0.5 * np.sin(0.2), rel=1e-12)


def test_inputs_come_from_a_table_in_any_unit(toys: Any, tmp_path: Path) -> None:
    file = tmp_path / "in.csv"
    t = np.arange(101) * 0.01
    pd.DataFrame({"time [ms]": t * 1e3, "level [mm]": 1e3 * t}).to_csv(file, index=False)
    path = toys.ssp({"g": "gain"}, ["level -> g.u"], units={"level": "m", "g.u": "m"})
    out = tmp_path / "out.parquet"
    done = simulate(path, "--input", file, "--step-size", "10 ms", "--out", out)
    assert done.exit_code == 0, done.output
    frame = pd.read_parquet(out)
    assert len(frame) == 101
    assert np.allclose(frame["g.y [m]"], 2.0 * t, atol=1e-15)
    pd.DataFrame({"time [s]": t, "level": t}).to_csv(file, index=False)
    with pytest.raises(Exception, match=r"'level' has no unit: head it 'level \[m\]'"):
        simulate(path, "--input", file)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (["--set", "g.kk=1"], UsageError, r"closest: 'g\.k'"),
        (["--set", "g.k"], UsageError, "should read name=value"),
        (["--set", "g.u=3 s"], UsageError, "wrong dimension"),
        (["--set", "g.n=two"], UsageError, "no Integer"),
        (["--stop-time", "3 m"], UsageError, "--stop-time"),
        (["--step-size", "0.3"], UsageError, "no multiple"),
        (["--out", "x.xlsx"], UsageError, "none of them"),
        (["--record", "g.z"], UsageError, "no variable"),
        (["--mapping", "m.toml"], UsageError, "needs --input"),
        (["--input", "in.csv"], UsageError, "has no inputs"),
        (["--parameter-set", "lost.ssv"], ModelError, "cannot be read"),
    ],
)
def test_bad_requests_are_answered(
    chain: Path, arguments: list[str], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        simulate(chain, *arguments)


def test_models_are_files_or_known_names(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("COSIM_BUILD", str(tmp_path))
    with pytest.raises(UsageError, match="one of simplified, full_order, physical"):
        simulate("full_ordr")
    simulate("simplified", "--stop-time", "10 ms")  # is built when it is missing
    assert (tmp_path / "ssp" / "simplified.ssp").is_file()
    with pytest.raises(ModelError, match="does not exist"):
        simulate(tmp_path / "lost.ssp")


def test_a_failed_simulation_has_exit_code_4(toys: Any) -> None:
    with pytest.raises(SimulationError, match="refuses limit") as caught:
        simulate(toys.fmu("grumbler"), "--set", "grumbler.limit=-1", "--stop-time", "1")
    assert caught.value.exit_code == 4


def experiment(source: Path, target: Path, attributes: str) -> Path:
    """A copy of an FMU with another default experiment."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for item in old.infolist():
            data = old.read(item)
            if item.filename == "modelDescription.xml":
                text, count = re.subn(r"<DefaultExperiment[^>]*/>", "", data.decode())
                assert count <= 1
                data = text.replace(
                    "<ModelVariables", f"<DefaultExperiment {attributes}/><ModelVariables"
                ).encode()
            new.writestr(item, data)
    return target


@pytest.mark.parametrize(
    ("attributes", "options", "expected", "own"),
    [
        ('startTime="1" stopTime="3" stepSize="0.25" tolerance="1e-5"', [], (1.0, 3.0, 8),
         "start 1 s, stop 3 s, step 0.25 s, tolerance 1e-05"),
        ('startTime="1" stopTime="3" stepSize="0.25"', ["--stop-time", "2 s"], (1.0, 2.0, 4), "start 1 s, step 0.25 s"),
        ('startTime="1" stopTime="3" stepSize="0.25"', ["--step-size", "0.5 s"], (1.0, 3.0, 4), "start 1 s, stop 3 s"),
        ('startTime="1" stopTime="3" stepSize="0.25"', ["--start-time", "2 s"], (2.0, 3.0, 4), "stop 3 s, step 0.25 s"),
        ('startTime="0" stopTime="1" stepSize="0.3"', [], (0.0, 1.0, 4), "start 0 s, stop 1 s, step 0.3 s"),  # 0.1 s left
        ('stopTime="0.0005"', [], (0.0, 0.0005, 1000), "stop 0.0005 s"),  # shorter than a step of 1 ms
        ('stopTime="1e5"', [], (0.0, 1e5, 1000), "stop 100000 s"),  # a hundred million steps of 1 ms
        ('stopTime="0.5"', [], (0.0, 0.5, 500), "stop 0.5 s"),
    ],
)  # fmt: skip
def test_an_fmu_alone_runs_its_own_default_experiment_and_says_so(
    toys: Any,
    tmp_path: Path,
    attributes: str,
    options: list[str],
    expected: tuple[float, float, int],
    own: str,
) -> None:
    fmu = experiment(toys.fmu("wave"), tmp_path / "wave.fmu", attributes)
    done = simulate(fmu, *options, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert (found["start_time"], found["stop_time"], found["steps"]) == expected
    assert [n for n in found["notes"] if n.startswith("by the FMU's own")] == [
        f"by the FMU's own default experiment: {own}"
    ]


def test_nothing_of_the_default_experiment_is_said_where_all_was_given(toys: Any, tmp_path: Path) -> None:
    fmu = experiment(toys.fmu("wave"), tmp_path / "wave.fmu", 'startTime="1" stopTime="3" stepSize="0.25"')
    done = simulate(fmu, "--start-time", "0 s", "--stop-time", "1 s", "--step-size", "0.5 s", "--json")
    found = json.loads(done.stdout)
    assert (found["start_time"], found["stop_time"], found["steps"]) == (0.0, 1.0, 2)
    assert not [n for n in found["notes"] if "default experiment" in n]


def test_a_signal_that_turns_nan_leaves_what_was_before(toys: Any, tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "cosim", "simulate", str(toys.fmu("lag")), "--set", "lag.start=1e308"),
            *(
                "--set",
                "lag.T=-0.5",
                "--stop-time",
                "1 s",
                "--step-size",
                "0.1 s",
                "--out",
                str(out),
                "--json",
            ),
        ],
        cwd=TOP,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 4, done.stderr
    found = json.loads(done.stdout)
    assert found["exit_code"] == 4
    assert "component 'lag': 'lag.y' is not a finite number" in found["error"]
    assert found["partial"]["complete"] is False
    table = pd.read_csv(tmp_path / "out.partial.csv")
    assert np.isfinite(table.to_numpy()).all()
    assert len(table) == found["partial"]["steps"] + 1 > 1
    assert not out.exists()


def test_a_table_has_no_rests_of_rounding_and_ends_with_what_to_type(chain: Path) -> None:
    assert _without_rests({"unit": "mm", "min": -2.5, "max": 2.5, "final": 3.4e-23})["final"] == 0.0
    assert _without_rests({"unit": "mm", "min": 1e-13, "max": 3e-13, "final": 2e-13})["final"] == 2e-13
    said = simulate(chain).stdout
    assert said.splitlines()[-1] == "Next: the same with --out run.csv writes the signals over time"
