"""A batch from the command to its files: results that depend on nothing but the request, failures that cost one run."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

for needed in ("distributed", "xarray", "zarr"):
    pytest.importorskip(needed, reason="needs the extra 'batch'")

import xarray as xr  # noqa: E402

from cosim.batch.cases import plan_batch  # noqa: E402
from cosim.batch.conduct import conduct  # noqa: E402
from cosim.batch.drive import carry_out  # noqa: E402
from cosim.batch.plan import Plan  # noqa: E402
from cosim.batch.store import Coordinates, Store  # noqa: E402
from cosim.batch.workers import Processes  # noqa: E402
from cosim.errors import UsageError  # noqa: E402

TOP = Path(__file__).resolve().parents[2]
MIB = 2.0**20
# the toy's steps: 0.01 s, 0.1 s long
SHORT: dict[str, Any] = {"step_size": "10 ms"}


def plan(model: Path, **more: Any) -> Plan:
    return Plan.model_validate({"model": str(model), **SHORT, **more})


def cube(folder: Path) -> xr.Dataset:
    return xr.open_zarr(folder / "signals.zarr", chunks=None).load()


def same(one: Path, other: Path) -> None:
    """Table and cube, but for who did it and how long it took."""
    tables = [pd.read_parquet(f / "runs.parquet").drop(columns=["seconds", "worker"]) for f in (one, other)]
    pd.testing.assert_frame_equal(*tables, check_exact=True)
    xr.testing.assert_identical(cube(one), cube(other))


def test_a_sweep_gives_table_cube_and_picture(rogue: Path, tmp_path: Path) -> None:
    asked = plan(rogue, sweep={"r.k": "1:3:3", "r.n": [1, 2]}, workers=1)
    report = conduct(asked, tmp_path / "b")
    frame = pd.read_parquet(tmp_path / "b" / "runs.parquet")
    assert list(frame["r.k [1]"]) == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]
    assert list(frame["r.n [1]"]) == [1, 2, 1, 2, 1, 2]
    assert set(frame["status"]) == {"done"}
    assert (frame["seconds"] > 0.0).all()
    expected = frame["r.k [1]"] * frame["r.n [1]"] * 0.01
    assert frame["r.y final [1]"].to_numpy() == pytest.approx(expected.to_numpy(), rel=1e-12)
    data = cube(tmp_path / "b")
    assert data["r.y"].attrs["units"] == "1"
    assert data["time"].attrs["units"] == "s"
    assert data["time"].values == pytest.approx(np.arange(11) * 0.01)
    assert data["r.k"].dims == ("run",)
    squares = data["r.k"] * data["r.n"] * data["time"] ** 2
    np.testing.assert_allclose(data["r.y"], squares.transpose("run", "time"), rtol=1e-12)
    assert (tmp_path / "b" / "summary.png").read_bytes()[1:4] == b"PNG"
    assert report.about["done"] == 6
    assert report.about["sensitivity"]["r.y final [1]"]["r.k"] > 0.5


@pytest.fixture(scope="module")
def reference(rogue: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Path]:
    """Draws done by one process in order."""
    folder = tmp_path_factory.mktemp("reference") / "one"
    asked = plan(rogue, vary={"r.k": "2 +- 1", "r.b": "0:5"}, samples=30, workers=1)
    conduct(asked, folder)
    return asked, folder


def test_results_do_not_depend_on_the_number_of_processes(
    reference: tuple[Plan, Path], tmp_path: Path
) -> None:
    asked, folder = reference
    conduct(asked.model_copy(update={"workers": 3, "runs_per_worker": 8}), tmp_path / "three")
    same(folder, tmp_path / "three")


def test_results_do_not_depend_on_the_order(reference: tuple[Plan, Path], tmp_path: Path) -> None:
    asked, folder = reference
    batch = plan_batch(asked, tmp_path / "mixed")
    mixed = [batch.runs[k] for k in np.random.default_rng(5).permutation(len(batch.runs))]
    store = Store(tmp_path / "mixed")
    columns: dict[str, Any] = {
        name: (list(cube(folder)[name].values), "1" if "." in name else "")
        for name in ("run", "model", "log", "r.k", "r.b")
    }
    store.begin({"identity": batch.identity}, Coordinates(columns, 0.01, 0.0, "time"), fresh=False)
    seen: list[float] = []
    carry_out(batch.job, mixed, Processes(2, 1e10), store, seen.append)
    assert seen[-1] == 30
    table = pd.read_parquet(folder / "runs.parquet")
    frame = store.finish({name: list(table[name]) for name in ("run", "model", "log", "r.k [1]", "r.b [1]")})
    assert list(frame["r.y final [1]"]) == list(table["r.y final [1]"])
    xr.testing.assert_identical(cube(tmp_path / "mixed"), cube(folder))


def test_a_process_that_dies_takes_one_run(rogue: Path, tmp_path: Path, run_cosim: Any) -> None:
    words = ["batch", "--model", rogue, "--step-size", "10 ms", "--design", "zip", "--workers", 2]
    words += [
        "--sweep",
        "r.k=1:12:12",
        "--sweep",
        "r.die=0,0,0,1,0,0,0,0,1,0,0,0",
        "--most-failed",
        2,
        "--out",
        tmp_path / "b",
        "--json",
    ]
    code, found, said = run_cosim(*words)
    assert code == 0, said
    assert (found["done"], found["failed"]) == (10, 2)
    assert [f["run"] for f in found["failures"]] == [3, 8]
    frame = pd.read_parquet(tmp_path / "b" / "runs.parquet")
    assert [r for r in frame["reason"] if r] == ["its process died (SIGABRT)"] * 2
    done = frame["status"] == "done"
    assert frame.loc[done, "r.y final [1]"].to_numpy() == pytest.approx(frame.loc[done, "r.k [1]"] * 0.01)
    data = cube(tmp_path / "b")["r.y"]
    assert np.isnan(data.sel(run=[3, 8])).all()
    assert np.isfinite(data.sel(run=frame.loc[done, "run"].to_numpy())).all()
    assert "2 of 12 runs failed; the first, run 3" in said
    # finished: nothing is done again, and the failed ones only if asked for
    sweep = {"r.k": "1:12:12", "r.die": "0,0,0,1,0,0,0,0,1,0,0,0"}
    asked = plan(rogue, sweep=sweep, design="zip", workers=2, most_failed=1)
    again = conduct(asked, tmp_path / "b").about
    assert (again["runs_before"], again["runs_now"], again["failed"]) == (12, 0, 2)
    again = conduct(asked, tmp_path / "b", retry_failed=True)
    assert (again.about["runs_before"], again.about["runs_now"], again.missed) == (10, 2, True)


@pytest.mark.slow
def test_a_parcel_whose_process_dies_loses_one_run_only(
    rogue: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.setitem(__import__("cosim.batch.drive", fromlist=["TOGETHER"]).TOGETHER, "fmu", 8)
    sweep = {"r.k": "1:64:64", "r.die": [float(k in (5, 40)) for k in range(64)]}
    report = conduct(plan(rogue, sweep=sweep, design="zip", workers=2), tmp_path / "b")
    assert list(report.frame.loc[report.frame["status"] == "failed", "run"]) == [5, 40]


def test_a_run_that_hangs_is_ended_and_the_others_go_on(rogue: Path, tmp_path: Path) -> None:
    sweep: dict[str, Any] = {"r.k": "1:8:8", "r.nap": [0.0, 0.0, 0.0, 3600.0, 0.0, 0.0, 0.0, 0.0]}
    # the first run of a process may take a minute longer, so the one that hangs is not the first
    asked = plan(rogue, sweep=sweep, design="zip", workers=1, time_limit="5 s")
    report = conduct(asked, tmp_path / "b")
    assert list(report.frame["status"]) == ["done"] * 3 + ["failed"] + ["done"] * 4
    assert report.frame["reason"][3] == "it took longer than 5 s"
    assert report.about["workers_replaced"] == 1


def test_a_time_limit_that_makes_no_sense_is_refused(rogue: Path, tmp_path: Path) -> None:
    sweep: dict[str, Any] = {"r.k": "1,2"}
    with pytest.raises(UsageError, match=r"--time-limit: .* is not positive"):
        conduct(plan(rogue, sweep=sweep, time_limit="0 s"), tmp_path / "a")
    with pytest.raises(UsageError, match="a cluster's workers are its own"):
        conduct(plan(rogue, sweep=sweep, time_limit="1 s", scheduler="tcp://127.0.0.1:1"), tmp_path / "b")


def test_a_run_that_fails_says_why_and_the_others_go_on(toys: Any, tmp_path: Path) -> None:
    package = toys.ssp({"w": "wave", "g": "grumbler"}, ["w.y -> g.u"], stop=0.5)
    report = conduct(plan(package, sweep={"g.refuse_at": "0.3, 9, 0.2, 9"}, workers=1), tmp_path / "b")
    failed = report.about["failures"]
    assert [f["run"] for f in failed] == [0, 2]
    assert "the grumbler will not go on" in failed[0]["reason"]
    assert report.about["done"] == 2


def test_all_failed_is_exit_code_4(rogue: Path, tmp_path: Path, run_cosim: Any) -> None:
    words = ["batch", "--model", rogue, "--set", "r.die=1", "--sweep", "r.k=1,2", "--out", tmp_path / "b"]
    code, _, said = run_cosim(*words)
    assert code == 4
    assert "no run was done" in said
    assert "SIGABRT" in said
    assert set(pd.read_parquet(tmp_path / "b" / "runs.parquet")["status"]) == {"failed"}
    assert cube(tmp_path / "b").sizes["run"] == 2


def running(words: list[object]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "cosim", *map(str, words)]
    return subprocess.Popen(command, cwd=TOP, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def until_done(folder: Path, count: int) -> None:
    """Waits until so many runs are in the journal."""
    until = time.monotonic() + 240.0
    journal = folder / "journal.jsonl"
    while not journal.is_file() or len(journal.read_bytes().splitlines()) < count:
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_an_interrupted_batch_goes_on(rogue: Path, tmp_path: Path, how: signal.Signals) -> None:
    words: list[object] = [
        "batch",
        "--model",
        rogue,
        "--step-size",
        "10 ms",
        "--set",
        "r.nap=0.1",
        "--workers",
        2,
    ]
    words += ["--sweep", "r.k=1:60:60", "--out"]
    process = running([*words, tmp_path / "b"])
    until_done(tmp_path / "b", 10)
    before = set(_children(process.pid))
    process.send_signal(how)
    _, said = process.communicate(timeout=120)
    assert process.returncode == (-9 if how == signal.SIGKILL else 130)
    if how == signal.SIGINT:
        assert b"runs are done and kept" in said
    done = (tmp_path / "b" / "journal.jsonl").read_bytes().splitlines()
    assert 10 <= len(done) < 60
    _gone(before)
    report = conduct(plan(rogue, set={"r.nap": "0.1"}, sweep={"r.k": "1:60:60"}, workers=2), tmp_path / "b")
    assert (report.about["runs_before"], report.about["runs_now"]) == (len(done), 60 - len(done))
    # nothing was done twice: what the journal had is there still, line for line
    assert (tmp_path / "b" / "journal.jsonl").read_bytes().splitlines()[: len(done)] == done
    frame, data = report.frame, cube(tmp_path / "b")["r.y"]
    assert frame["r.y final [1]"].to_numpy() == pytest.approx(frame["r.k [1]"].to_numpy() * 0.01)
    assert data.to_numpy() == pytest.approx(np.outer(np.arange(1, 61), (np.arange(11) * 0.01) ** 2))


def _children(pid: int) -> list[int]:
    import psutil

    return [child.pid for child in psutil.Process(pid).children(recursive=True)]


def _gone(pids: set[int]) -> None:
    """Workers whose parent was killed end by themselves."""
    import psutil

    _, alive = psutil.wait_procs([psutil.Process(p) for p in pids if psutil.pid_exists(p)], timeout=60)
    assert not alive


def test_a_process_that_dies_between_two_runs_is_replaced(rogue: Path, tmp_path: Path) -> None:
    batch = plan_batch(plan(rogue, sweep={"r.k": "1,2"}), tmp_path)
    crew = Processes(1, 1e12)
    try:
        first = crew.submit(batch.job, batch.runs[:1])
        (outcome,) = first.result()
        crew.settle(first)
        pid = int(outcome.worker.partition(":")[2])
        os.kill(pid, signal.SIGTERM)
        _gone({pid})
        time.sleep(0.5)
        second = crew.submit(batch.job, batch.runs[1:]).result()
        assert (second[0].status, second[0].number) == ("done", 1)
        assert second[0].worker != outcome.worker
    finally:
        crew.close()


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


def test_processes_are_replaced_before_they_outgrow_their_memory(rogue: Path, tmp_path: Path) -> None:
    asked = plan(rogue, sweep={"r.k": "1:2:2"}, workers=1)
    conduct(asked, tmp_path / "plain")
    plain = _resident(tmp_path / "plain")[-1]
    limit = plain + 160 * MIB
    more = {"set": {"r.leak": 40e6}, "sweep": {"r.k": "1:16:16"}, "worker_memory": f"{limit:.0f} byte"}
    report = conduct(plan(rogue, workers=1, **more), tmp_path / "leaking")
    resident = _resident(tmp_path / "leaking")
    assert report.about["done"] == 16
    assert max(resident) <= limit
    assert max(resident) > plain + 60 * MIB, "the toy leaks, or this test shows nothing"
    assert 3 <= report.about["workers_replaced"] <= 8
    workers = pd.read_parquet(tmp_path / "leaking" / "runs.parquet")["worker"]
    assert 4 <= workers.nunique() <= 9


def _resident(folder: Path) -> list[float]:
    import json

    return [
        float(json.loads(line)["resident"]) for line in (folder / "journal.jsonl").read_text().splitlines()
    ]


def test_instances_are_reused_and_memory_stays(packages: dict[str, Path], tmp_path: Path) -> None:
    more = {
        "vary": {"mechanical.J": "764 +- 80 kg.m2"},
        "samples": 60,
        "stop_time": "0.2 s",
        "record": ["sensor.slew"],
    }
    report = conduct(
        Plan.model_validate({"model": str(packages["full_order"]), "workers": 1, **more}), tmp_path / "b"
    )
    assert report.frame["worker"].nunique() == 1
    resident = _resident(tmp_path / "b")
    assert resident[-1] - resident[9] < 8 * MIB


@pytest.mark.slow
def test_ten_thousand_runs(packages: dict[str, Path], tmp_path: Path) -> None:
    more = {
        "vary": {"mechanical.J": "764 +- 80 kg.m2", "dcv.K": "2.2:2.5 mm"},
        "samples": 10_000,
        "engine": "compiled",
    }
    more |= {"stop_time": "2 s", "record": ["sensor.slew", "dcv.spool"], "design": "latin_hypercube"}
    report = conduct(Plan.model_validate({"model": str(packages["full_order"]), **more}), tmp_path / "b")
    assert report.about["done"] == 10_000
    data = xr.open_zarr(tmp_path / "b" / "signals.zarr", chunks=None)
    assert data["sensor.slew"].shape == (10_000, 201)
    assert np.isfinite(data["sensor.slew"].values).all()
    resident = _resident(tmp_path / "b")
    # straight lines: memory does not grow with the number of runs
    assert max(resident[5000:]) < max(resident[:1000]) + 30 * MIB
