"""What was found is never lost: parts fail by themselves, odd logs end in an answer or a clear refusal."""

import errno
import json
from pathlib import Path

import numpy as np
import pytest
from hidden_logs import only

from benchmarks import odd_machines
from benchmarks.odd_logs import Odd, drawn, run_case, wrong
from cosim.diagnosis.answer.experiment import Rehearsal
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.pipeline import diagnose as pipeline
from cosim.diagnosis.pipeline.parts import part
from cosim.errors import DataError
from cosim.report import deliver
from cosim.rig import make_log
from cosim.rig.write import as_log


def test_a_part_that_fails_leaves_a_note_and_ctrl_c_passes() -> None:
    notes: list[str] = []
    with part(notes, "the picture"):
        raise ValueError("no ink")
    with part(notes, "the table"):
        raise DataError("row 3 is empty")
    assert "the picture failed" in notes[0]
    assert "ValueError: no ink" in notes[0]
    assert notes[1] == "the table failed, the rest stands: row 3 is empty"
    with pytest.raises(KeyboardInterrupt), part(notes, "the rest"):
        raise KeyboardInterrupt


def test_a_full_disk_is_no_defect_to_be_reported() -> None:
    notes: list[str] = []
    with part(notes, "the extended package"):
        raise OSError(errno.ENOSPC, "No space left on device")
    with part(notes, "the report"):
        raise OSError(errno.ENOSPC, "No space left on device", "out/report.html")
    assert notes == [
        "the extended package failed, the rest stands: No space left on device",
        "the report failed, the rest stands: out/report.html: No space left on device",
    ]


def test_the_answer_is_there_though_everything_after_it_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object, **named: object) -> None:
        raise RuntimeError("broken on purpose")

    for room, name in ((pipeline, "gain_by_fmus"), (deliver, "proposal_for"), (deliver, "save_and_report")):
        monkeypatch.setattr(room, name, broken)
    log = as_log(make_log("steps", 8.0, ["mechanical.coulomb_friction:tau_c=300 N.m"], seed=2))
    answer = deliver.diagnose_into(tmp_path, log, None, None, 0.01, False)
    assert [c.effect for c in answer.causes] == ["mechanical.coulomb_friction"]
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert written["verdict"] == "explained"
    failed = [w for w in written["warnings"] if "broken on purpose" in w]
    assert len(failed) == 3
    assert set(written["signals"]) == {"spool", "p_load", "p_supply", "slew"}


def test_a_block_whose_judging_fails_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = pipeline.begun

    def but_one(found, group, *arguments, **named):
        if group.name == "continuity":
            raise FloatingPointError("no number")
        return begun(found, group, *arguments, **named)

    monkeypatch.setattr(pipeline, "begun", but_one)
    run = make_log("steps", 12.0, ["dcv.gain"], seed=3)
    found = pipeline.diagnose(as_log(run), model=only("dcv", "continuity"))
    assert [c.effect.name for c in found.causes] == ["dcv.gain"]
    assert found.verdict == "partly_explained"
    assert "FloatingPointError" in found.failed["continuity"]


@pytest.mark.parametrize("interval", [1e-3, 0.02, 0.053])
def test_what_readings_add_is_told_for_every_step_of_an_experiment(interval: float) -> None:
    """Readings every 53 ms end before a command of 30 s does."""
    command = np.zeros(30001)
    played = Rehearsal(MODELS["simplified"], command, {"simplified.theta_0": 0.0}, 1e-3, interval)
    readings = np.ones(played.grid.stamps.size)
    assert played.spread(readings).shape == command.shape
    assert played.spread(readings).sum() == pytest.approx(readings.sum(), rel=1e-3)


def cheap() -> list[Odd]:
    """The first short cases of a seed."""
    return [c for c in drawn(60, 11) if 60 < c.duration * c.rate < 4000 and c.duration < 25.0][:4]


@pytest.mark.parametrize("case", cheap(), ids=lambda c: str(c.seed))
def test_an_odd_log_ends_in_an_answer_or_a_refusal(case: Odd) -> None:
    row = run_case(case)
    assert "error" not in row, row["error"]
    assert not row.get("failed")
    assert row.get("report", True)


@pytest.mark.parametrize(
    "case",
    [
        # shorter than what is left out at the start, at a rate that leaves thousands of samples
        Odd(100191, "simplified", "sweep", 0.54, 3837.0, 0.0, ("slew",), "simplified.theta", True, False, ""),
        pytest.param(
            Odd(100475, "simplified", "small_steps", 0.55, 2712.0, 0.0, ("slew",), "", True, False, ""),
            marks=pytest.mark.slow,
        ),
        # a limit whose starts come twice: at the signal's extreme, which is its nominal value
        Odd(100127, "full_order", "sweep", 1.1, 155.2, 0.0, ("p_a", "slew"), "mechanical.theta", True, False, "slew"),
    ],
)  # fmt: skip
def test_a_log_of_half_a_second_ends_in_an_answer(case: Odd) -> None:
    row = run_case(case)
    assert "error" not in row, row["error"]
    assert not row.get("failed")


@pytest.mark.slow
def test_hundreds_of_odd_logs_end_in_an_answer_or_a_refusal() -> None:
    bad = [r for r in map(run_case, drawn(200, 12)) if "error" in r or r.get("failed")]
    assert bad == []


@pytest.mark.slow
def test_odd_machines_end_in_an_answer_or_a_refusal_as_for_a_new_user() -> None:
    """From `cosim init --machine` on; a pole just too slow to be told from an integrator made one answer incomplete."""
    rows = [odd_machines.run_case(case, "30s") for case in odd_machines.drawn(20, 12)]
    assert [wrong(row) for row in rows if wrong(row)] == []
    assert sum("verdict" in row for row in rows) > len(rows) // 2
