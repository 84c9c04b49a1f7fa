"""The processes that carry out runs: how they end, when they are replaced, what memory they take."""

import contextlib
import gc
import json
import multiprocessing
import multiprocessing.connection
import multiprocessing.util
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, process
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import forkserver
from multiprocessing.context import BaseContext, SpawnContext
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import psutil
import pytest

for needed in ("distributed", "xarray", "zarr"):
    pytest.importorskip(needed, reason="needs the extra 'batch'")

import xarray as xr  # noqa: E402

from cosim.batch.cases import plan_batch  # noqa: E402
from cosim.batch.conduct import conduct  # noqa: E402
from cosim.batch.plan import Plan  # noqa: E402
from cosim.batch.store import Store  # noqa: E402
from cosim.batch.workers import Processes, SharedContext, _gone, how_it_ended  # noqa: E402
from cosim.errors import UsageError  # noqa: E402
from tests.batch.asked import plan  # noqa: E402

MIB = 2.0**20


def test_a_process_that_dies_between_two_runs_is_replaced(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before its pool has noted it, too."""
    known = threading.Event()
    noted = process._ExecutorManagerThread.terminate_broken  # type: ignore[attr-defined]

    def late(*words: Any) -> None:
        known.wait(60.0)
        noted(*words)

    monkeypatch.setattr(process._ExecutorManagerThread, "terminate_broken", late)  # type: ignore[attr-defined]
    batch = plan_batch(plan(rogue, sweep={"r.k": "1,2"}), tmp_path)
    crew = Processes(1, 1e12)
    try:
        first = crew.submit(batch.job, batch.runs[:1])
        (outcome,) = first.result()
        crew.settle(first)
        pid = int(outcome.worker.partition(":")[2])
        (child,) = [child for child in multiprocessing.active_children() if child.pid == pid]
        os.kill(pid, signal.SIGTERM)
        child.join(60.0)
        second = crew.submit(batch.job, batch.runs[1:]).result(timeout=60.0)
        assert (second[0].status, second[0].number) == ("done", 1)
        assert second[0].worker != outcome.worker
    finally:
        known.set()
        crew.close()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nothing stands between")
def test_without_the_process_that_forks_them_others_take_over_and_what_is_given_up_removes_nothing(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "cosim.batch.workers.GONE", 0.5
    )  # s, of 5: what is given up waits so long before it ends
    batch = plan_batch(plan(rogue, sweep={"r.k": "1,2,3"}), tmp_path)
    crew = Processes(1, 1e12)
    try:
        first = crew.submit(batch.job, batch.runs[:1])
        (outcome,) = first.result()
        crew.settle(first)
        os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)  # type: ignore[attr-defined]
        given_up = psutil.Process(int(outcome.worker.partition(":")[2]))
        multiprocessing.connection.wait([crew._lanes[0].process.sentinel], 60.0)  # type: ignore[union-attr]
        second = crew.submit(batch.job, batch.runs[1:2])
        assert second.result(timeout=60.0)[0].status == "done"
        crew.settle(second)
        gc.collect()
        given_up.wait(60.0)
        assert Path(crew._folder.name).is_dir()
        assert Path(multiprocessing.util.get_temp_dir()).is_dir()
        assert crew.submit(batch.job, batch.runs[2:]).result(timeout=60.0)[0].status == "done"
    finally:
        crew.close()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nothing stands between")
def test_a_process_begins_though_the_one_that_forks_it_dies_meanwhile(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch = plan_batch(plan(rogue, sweep={"r.k": "1"}), tmp_path)
    read, killed = forkserver.read_signed, []  # type: ignore[attr-defined]

    def dying(channel: int) -> int:
        if not killed:
            killed.append(forkserver._forkserver._forkserver_pid)  # type: ignore[attr-defined]
            os.kill(killed[0], signal.SIGKILL)
            raise EOFError("unexpected EOF")
        return int(read(channel))

    monkeypatch.setattr(forkserver, "read_signed", dying)
    crew = Processes(1, 1e12)
    try:
        assert crew.submit(batch.job, batch.runs).result(timeout=60.0)[0].status == "done"
    finally:
        crew.close()
    assert killed


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX")
def test_a_process_is_gone_that_nobody_has_collected_and_one_that_lives_is_not() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    try:
        assert _gone(ended.pid, 60.0)
    finally:
        ended.wait()
    assert _gone(ended.pid, 0.0)
    assert not _gone(os.getpid(), 0.05)


def dies_at_once(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGABRT)


class KnownLate(ProcessPoolExecutor):
    """A pool that answers when its process is dead already, as where we get no processor for a while."""

    def submit(self, *words: Any, **options: Any) -> Future[Any]:
        future = super().submit(*words, **options)
        future.exception(timeout=60.0)
        return future


def test_how_a_process_died_is_told_though_it_died_before_we_looked(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cosim.batch.workers.execute", dies_at_once)
    monkeypatch.setattr("cosim.batch.workers.ProcessPoolExecutor", KnownLate)
    batch = plan_batch(plan(rogue, sweep={"r.k": "1,2"}), tmp_path)
    crew = Processes(1, 1e12)
    try:
        assert crew.settle(crew.submit(batch.job, batch.runs[:1])) == "its process died (SIGABRT)"
    finally:
        crew.close()


def test_no_thread_of_a_pool_is_left_that_closes_its_pipes_while_python_ends(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python writes into these pipes when it ends: "Exception ignored ... Bad file descriptor"."""
    closes = process._ExecutorManagerThread.join_executor_internals  # type: ignore[attr-defined]
    seen: list[threading.Thread] = []

    def late(thread: threading.Thread) -> None:
        seen.append(thread)
        time.sleep(0.5)
        closes(thread)

    monkeypatch.setattr(process._ExecutorManagerThread, "join_executor_internals", late)  # type: ignore[attr-defined]
    batch = plan_batch(plan(rogue, sweep={"r.k": "1,2"}), tmp_path)
    crew = Processes(2, 1e12)
    crew.settle(done := crew.submit(batch.job, batch.runs[:1]))
    assert done.done()
    crew.submit(batch.job, batch.runs[1:])
    crew.close()
    assert seen
    assert not any(thread.is_alive() for thread in seen)
    assert not any(thread.is_alive() for lane in crew._lanes for thread in lane.ending)


@pytest.mark.parametrize("error", [KeyboardInterrupt, UsageError("the disk is full")])
def test_no_process_or_thread_is_left_where_the_results_cannot_be_flushed(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException | type[BaseException]
) -> None:
    """A signal strikes there too: Python ended with the pools open, and woke threads that closed their pipes just then."""
    crews: list[Processes] = []

    def crew(*words: Any) -> Processes:
        crews.append(Processes(*words))
        return crews[-1]

    def struck(store: Store) -> None:
        raise error

    monkeypatch.setattr("cosim.batch.workers.Processes", crew)
    monkeypatch.setattr(Store, "flush", struck)
    before = set(multiprocessing.active_children())
    with pytest.raises(error if isinstance(error, type) else type(error)):
        conduct(plan(rogue, sweep={"r.k": "1,2"}, workers=2), tmp_path / "b")
    (used,) = crews
    assert not any(lane.pool for lane in used._lanes)
    assert not any(thread.is_alive() for lane in used._lanes for thread in lane.ending)
    assert set(multiprocessing.active_children()) <= before


def test_a_process_ends_that_was_begun_as_a_signal_came(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody knew it yet, so it went on with its run, and its pool outlived the command."""
    gate = tmp_path / "gate"
    gate.touch()
    monkeypatch.setenv("ROGUE_WAITS_FOR_THE_END_OF", str(gate))

    @contextlib.contextmanager
    def struck() -> Iterator[None]:
        yield
        raise KeyboardInterrupt

    batch = plan_batch(plan(rogue, sweep={"r.k": "9,10"}), tmp_path)
    crew = Processes(1, 1e12)
    before = set(multiprocessing.active_children())
    with monkeypatch.context() as patched:
        patched.setattr("cosim.batch.workers.uninterrupted", struck)
        with pytest.raises(KeyboardInterrupt):
            crew.submit(batch.job, batch.runs[:1])
    (begun,) = set(multiprocessing.active_children()) - before
    crew.close()
    alive = begun.is_alive()
    gate.unlink()
    assert not alive


class Answer:
    """An answer of 128 MB, whose process dies once the length that goes ahead of it has been written."""

    def __reduce__(self) -> tuple[type[bytes], tuple[bytes]]:
        threading.Thread(target=self.die, args=(self.written(),), daemon=True).start()
        return bytes, (bytes(1 << 27),)

    @staticmethod
    def written() -> int:
        return int(psutil.Process().io_counters().write_chars)

    def die(self, before: int) -> None:
        while self.written() == before:
            pass
        os.kill(os.getpid(), signal.SIGKILL)


def dies_while_it_answers(*_: object) -> list[object]:
    return [Answer()]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts what a process writes as Linux does")
def test_a_process_killed_within_its_answer_is_known_to_be_dead(
    rogue: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pool waited for ever for the other half of the answer."""
    batch = plan_batch(plan(rogue, sweep={"r.k": "1,2"}), tmp_path)
    crew = Processes(1, 1e12)
    try:
        with monkeypatch.context() as patched:
            patched.setattr("cosim.batch.workers.execute", dies_while_it_answers)
            lost = crew.submit(batch.job, batch.runs[:1])
        assert isinstance(lost.exception(timeout=60.0), BrokenProcessPool)
        assert crew.settle(lost) == "its process died (SIGKILL)"
        (outcome,) = crew.submit(batch.job, batch.runs[1:]).result(timeout=60.0)
        assert outcome.status == "done"
    finally:
        crew.close()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes as they are made on Linux")
@pytest.mark.parametrize("made", [SharedContext, SpawnContext], ids=["as workers are", "spawned"])
def test_how_a_process_died_is_told_though_another_thread_collects_it(
    made: type[BaseContext], monkeypatch: pytest.MonkeyPatch
) -> None:
    child = made().Process(target=os.abort)  # type: ignore[attr-defined]
    child.start()
    collected = threading.Event()

    def slowly(collect: Callable[..., Any]) -> Callable[..., Any]:
        def slow(*words: int) -> Any:
            found = collect(*words)
            if threading.current_thread() is other and found not in {0, (0, 0)}:
                collected.set()
                time.sleep(0.1)  # the status has been given away; multiprocessing has not noted it yet
            return found

        return slow

    monkeypatch.setattr(os, "waitpid", slowly(os.waitpid))
    monkeypatch.setattr(forkserver, "read_signed", slowly(forkserver.read_signed))
    other = threading.Thread(target=child.join)
    other.start()
    assert collected.wait(60.0)
    assert how_it_ended(child) == "its process died (SIGABRT)"
    other.join()


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
