"""A batch that was interrupted, cut short or asked for in another batch's folder."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

for needed in ("distributed", "xarray", "zarr"):
    pytest.importorskip(needed, reason="needs the extra 'batch'")

from cosim.batch.cases import plan_batch  # noqa: E402
from cosim.batch.conduct import conduct  # noqa: E402
from cosim.errors import UsageError  # noqa: E402
from tests.batch.asked import cube, plan  # noqa: E402

TOP = Path(__file__).resolve().parents[2]


def running(words: list[object]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "cosim", *map(str, words)]
    return subprocess.Popen(command, cwd=TOP, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def until_done(folder: Path, count: int) -> None:
    """Waits until so many runs are in the journal."""
    until = time.monotonic() + 900.0
    journal = folder / "journal.jsonl"
    while not journal.is_file() or len(journal.read_bytes().splitlines()) < count:
        assert time.monotonic() < until
        time.sleep(0.05)


def _gone(processes: list[psutil.Process]) -> None:
    """Workers whose parent was killed end by themselves."""
    _, alive = psutil.wait_procs(processes, timeout=600)
    assert not alive


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(
    "how",
    [
        signal.SIGKILL,
        pytest.param(signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
    ],
)
def test_an_interrupted_batch_goes_on(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: signal.Signals
) -> None:
    gate = tmp_path / "gate"
    gate.touch()
    monkeypatch.setenv("ROGUE_WAITS_FOR_THE_END_OF", str(gate))  # it cannot be done before it is interrupted
    words: list[object] = ["batch", "--model", rogue, "--step-size", "10 ms", "--workers", 2]
    words += ["--sweep", "r.k=1:30:30", "--out"]
    process = running([*words, tmp_path / "b"])
    until_done(tmp_path / "b", 4)
    before = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(how)
    _, said = process.communicate(timeout=600)
    assert process.returncode == (-9 if how == signal.SIGKILL else 130)
    if how != signal.SIGKILL:
        assert b"runs are done and kept" in said
    done = (tmp_path / "b" / "journal.jsonl").read_bytes().splitlines()
    assert 4 <= len(done) < 30
    _gone(before)
    gate.unlink()
    report = conduct(plan(rogue, sweep={"r.k": "1:30:30"}, workers=2), tmp_path / "b")
    assert (report.about["runs_before"], report.about["runs_now"]) == (len(done), 30 - len(done))
    # nothing was done twice: what the journal had is there still, line for line
    assert (tmp_path / "b" / "journal.jsonl").read_bytes().splitlines()[: len(done)] == done
    frame, data = report.frame, cube(tmp_path / "b")["r.y"]
    assert frame["r.y final [1]"].to_numpy() == pytest.approx(frame["r.k [1]"].to_numpy() * 0.01)
    assert data.to_numpy() == pytest.approx(np.outer(np.arange(1, 31), (np.arange(11) * 0.01) ** 2))


def test_a_line_cut_short_is_done_again(rogue: Path, tmp_path: Path) -> None:
    asked = plan(rogue, sweep={"r.k": "1:4:4"}, workers=1)
    conduct(asked, tmp_path / "b")
    journal = tmp_path / "b" / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-20])
    report = conduct(asked, tmp_path / "b")
    assert (report.about["runs_before"], report.about["runs_now"], report.about["done"]) == (3, 1, 4)


def test_another_batch_in_the_folder_is_refused(rogue: Path, tmp_path: Path) -> None:
    one, other = (plan(rogue, sweep={"r.k": text}, workers=1) for text in ("1,2", "1,3"))
    conduct(one, tmp_path / "b")
    with pytest.raises(UsageError, match="holds another batch"):
        conduct(other, tmp_path / "b")
    (tmp_path / "b" / "mine.txt").write_text("mine")
    assert conduct(other, tmp_path / "b", fresh=True).about["runs_before"] == 0
    assert (tmp_path / "b" / "mine.txt").read_text() == "mine"
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("mine")
    with pytest.raises(UsageError, match="holds no batch"):
        conduct(one, tmp_path / "full", fresh=True)
    assert (tmp_path / "full" / "thesis.txt").read_text() == "mine"


def test_a_changed_model_is_another_batch(toys: Any, rogue: Path, tmp_path: Path) -> None:
    package = tmp_path / "m.ssp"
    package.write_bytes(rogue.read_bytes())
    asked = plan(package, sweep={"r.k": "1,2"}, workers=1)
    first = plan_batch(asked, tmp_path).identity
    assert plan_batch(asked.model_copy(update={"workers": 2}), tmp_path / "x").identity == first
    assert plan_batch(asked.model_copy(update={"output_step": "20 ms"}), tmp_path).identity != first
    assert plan_batch(asked.model_copy(update={"set": {"r.b": "1"}}), tmp_path).identity != first
    (tmp_path / "moved").mkdir()
    moved = package.rename(tmp_path / "moved" / "m.ssp")
    again = asked.model_copy(update={"model": (str(moved),)})
    assert plan_batch(again, tmp_path).identity == first, "where the file lies is no matter"
    moved.write_bytes(toys.ssp({"r": "rogue"}, [], stop=0.2).read_bytes())
    assert plan_batch(again, tmp_path).identity != first
