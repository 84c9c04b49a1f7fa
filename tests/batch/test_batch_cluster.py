"""The same work on a Dask cluster that runs already: a scheduler and two workers of this machine."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

for needed in ("distributed", "xarray", "zarr"):
    pytest.importorskip(needed, reason="needs the extra 'batch'")

import xarray as xr  # noqa: E402

from cosim.batch.conduct import conduct  # noqa: E402
from cosim.batch.plan import Plan  # noqa: E402
from cosim.batch.workers import Cluster  # noqa: E402
from cosim.errors import UsageError  # noqa: E402


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a cluster of two worker processes, of one thread each, that are started again when they die."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as cluster:
        yield cluster.scheduler_address


def plan(model: Path, **more: Any) -> Plan:
    return Plan.model_validate({"model": str(model), "step_size": "10 ms", **more})


@pytest.mark.slow
def test_a_cluster_gives_what_this_machine_gives(rogue: Path, scheduler: str, tmp_path: Path) -> None:
    asked = plan(rogue, vary={"r.k": "2 +- 1"}, samples=20, workers=1)
    conduct(asked, tmp_path / "here")
    report = conduct(asked.model_copy(update={"scheduler": scheduler}), tmp_path / "there")
    assert report.about["workers"] == 2
    tables = [pd.read_parquet(tmp_path / f / "runs.parquet") for f in ("here", "there")]
    assert not set(tables[0]["worker"]) & set(tables[1]["worker"])
    assert tables[1]["worker"].nunique() == 2
    plain = [t.drop(columns=["seconds", "worker"]) for t in tables]
    pd.testing.assert_frame_equal(*plain, check_exact=True)
    cubes = [xr.open_zarr(tmp_path / f / "signals.zarr", chunks=None).load() for f in ("here", "there")]
    xr.testing.assert_identical(*cubes)


@pytest.mark.slow
def test_a_worker_that_dies_takes_one_run(rogue: Path, scheduler: str, tmp_path: Path) -> None:
    sweep = {"r.k": "1:8:8", "r.die": "0,0,1,0,0,0,0,0"}
    report = conduct(plan(rogue, sweep=sweep, design="zip", scheduler=scheduler), tmp_path / "b")
    assert list(report.frame.loc[report.frame["status"] == "failed", "run"]) == [2]
    assert report.frame["reason"][2] == "its worker died, more often than the scheduler allows"
    assert report.about["done"] == 7


def test_a_scheduler_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosim.batch.workers.CONNECT", 0.5)
    with pytest.raises(UsageError, match="no Dask scheduler answers"):
        Cluster("tcp://127.0.0.1:1")


def test_a_scheduler_without_workers_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    from cosim.errors import SimulationError

    monkeypatch.setattr("cosim.batch.workers.ARRIVE", 0.5)
    with (
        LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as empty,
        pytest.raises(SimulationError, match="has no workers"),
    ):
        Cluster(empty.scheduler_address)
