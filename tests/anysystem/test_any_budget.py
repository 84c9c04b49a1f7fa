"""A diagnosis of any system ends in the time that is allowed, or at Ctrl-C, with the best so far and what was not tried."""

import json
import math
import os
import signal
from pathlib import Path

import pytest
import systems

from benchmarks.systems.truth import Hidden
from cosim.anysystem.pipeline import AnyDiagnosis, diagnose_system
from cosim.anysystem.read import read
from cosim.diagnosis.budget import Budget
from cosim.errors import DataError, OutOfTimeError, SimulationError
from cosim.master import Runner
from cosim.ssp.read import read_system
from cosim.system.graph import Unit
from cosim.system.runs import Runs
from tests.struck import struck

TOP = Path(__file__).resolve().parents[2]
HIDDEN = [
    Hidden("port.dead_zone", "plant.u", "input", {"low": -0.2, "high": 0.3}),
    Hidden("port.gain", "valve.y", "output", {"gain": 1.15}),
]


def test_what_was_not_tried_in_the_time_allowed_is_said(native: Path, command, tmp_path: Path) -> None:
    log = systems.log(tmp_path / "log.csv", HIDDEN, 2)
    code, out, err = command(
        "diagnose", log, "--model", native, "--out", tmp_path / "out", "--json", "--budget", "0.3s"
    )
    assert code == 0, err
    found = json.loads(out)
    for group in ("valve", "plant"):
        (said,) = [
            w
            for w in found["warnings"]
            if w.startswith(f"{group}: the time allowed (0.3 s) was over; not tried")
        ]
        assert said in " ".join(err.split())
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text())["verdict"] == found["verdict"]


def diagnosed(native: Path, folder: Path, seconds: float) -> tuple[AnyDiagnosis, int]:
    """A diagnosis that may take so many runs, and how many it took."""
    log = systems.log(folder / "log.csv", HIDDEN, 2)
    with read_system(native) as system, Runs(system, apart=False) as runs:
        recordings, options, _ = read([log], system, None)
        budget = Budget(seconds, lambda: float(runs.count))  # each run takes a second
        return diagnose_system(system, recordings, runs, options, budget=budget), runs.count


def test_no_run_begins_once_the_time_is_over(native: Path, tmp_path: Path) -> None:
    """A model whose runs are long: those that a component takes to be judged at all went on and on, 138 s of 40 allowed."""
    with pytest.raises(
        DataError, match=r"the time allowed \(8 s\) was over before it could be judged; one run of it"
    ):
        diagnosed(native, tmp_path, 8.0)
    found, count = diagnosed(native, tmp_path, 24.0)
    assert list(found.findings) == ["valve"]
    assert "was over before it could be judged" in found.unjudged["plant"]
    assert count <= 26
    found, count = diagnosed(native, tmp_path, 40.0)
    assert set(found.findings) == {"valve", "plant"}
    assert count <= 44
    assert any("the time allowed (40 s) was over; not tried: " in text for text in found.budget.warnings)


def test_a_run_is_cut_off_at_the_end_of_the_time(native: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def once(self: Runner, *words: object, within: float = math.inf, **more: object) -> None:
        asked.append(within)
        left[0] = 0.0
        raise SimulationError("component 'plant' took longer than 3 s for one run")

    left = [3.0]
    monkeypatch.setattr(Runner, "run", once)
    with read_system(native) as system, Runs(system, apart=False) as runs:
        runs.left = lambda: left[0]
        plant = Unit(("plant",))
        with pytest.raises(OutOfTimeError):
            runs.free_run(plant, 0.0, 0.01, 100, (), {})
        assert asked == [3.0]
        with pytest.raises(OutOfTimeError):  # nothing is left: it is not begun
            runs.free_run(plant, 0.0, 0.01, 101, (), {})
        assert asked == [3.0]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_an_interrupted_diagnosis_leaves_what_it_has(
    native: Path, tmp_path: Path, number: signal.Signals
) -> None:
    log = systems.log(tmp_path / "log.csv", HIDDEN, 2)
    words = ["diagnose", log, "--model", native, "--out", tmp_path / "out"]
    done = struck(number, "judging valve", *words, cwd=TOP)
    assert done.returncode == 130
    assert "interrupted" in done.stderr
    left = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert left["verdict"] == "interrupted"
    assert left["interrupted"] == "judging valve"
    assert left["not_judged"] == {"plant": "it was interrupted"}
