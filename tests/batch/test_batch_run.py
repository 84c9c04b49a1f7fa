"""A batch from the command to its files: results that depend on nothing but the request, failures that cost one run."""

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
from cosim.batch.coordinates import Coordinates  # noqa: E402
from cosim.batch.drive import carry_out  # noqa: E402
from cosim.batch.plan import Plan  # noqa: E402
from cosim.batch.store import Store  # noqa: E402
from cosim.batch.workers import Processes  # noqa: E402
from cosim.errors import UsageError  # noqa: E402
from tests.batch.asked import cube, plan  # noqa: E402


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


def test_a_run_that_hangs_is_ended_and_the_others_go_on(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    naps = tmp_path / "naps"
    monkeypatch.setenv("ROGUE_NAPS", str(naps))

    class Clock:
        """An hour passes once the run hangs, and not before: the machine may take any time for the others."""

        sleep = staticmethod(time.sleep)

        @staticmethod
        def monotonic() -> float:
            return time.monotonic() + 3600.0 * naps.exists()

    monkeypatch.setattr("cosim.batch.workers.clock", Clock)
    sweep: dict[str, Any] = {"r.k": "1:8:8", "r.nap": [0.0, 0.0, 0.0, 7200.0, 0.0, 0.0, 0.0, 0.0]}
    # the first run of a process may take a minute longer, so the one that hangs is not the first
    asked = plan(rogue, sweep=sweep, design="zip", workers=1, time_limit="600 s")
    report = conduct(asked, tmp_path / "b")
    assert list(report.frame["status"]) == ["done"] * 3 + ["failed"] + ["done"] * 4
    assert report.frame["reason"][3] == "it took longer than 600 s"
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
