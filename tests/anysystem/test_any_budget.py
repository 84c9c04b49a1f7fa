"""A diagnosis of any system ends in the time that is allowed, or at Ctrl-C, with the best so far and what was not tried."""

import json
import os
import signal
from pathlib import Path

import pytest
import systems

from benchmarks.systems.truth import Hidden
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
