"""The folder of a batch on a disk that fails: it begins again, and its journal never holds half a line."""

import asyncio
import contextlib
import os
import shutil
import signal
import sys
import threading
import time
from unittest import mock

import pytest
from fault_injection import failing_call, full_after

for needed in ("xarray", "zarr"):
    pytest.importorskip(needed, reason="needs the extra 'batch'")

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
import zarr  # noqa: E402

from cosim.batch.coordinates import Coordinates  # noqa: E402
from cosim.batch.job import Outcome, Signal  # noqa: E402
from cosim.batch.lasting import LastingStore  # noqa: E402
from cosim.batch.store import LOCK, Store  # noqa: E402
from cosim.errors import DataError, UsageError  # noqa: E402
from cosim.files import write_text  # noqa: E402
from cosim.interrupts import ended_in_order  # noqa: E402


def outcome(number):
    return Outcome(number=number, status="done", seconds=0.1, worker="w", scores={"rmse": 1.0})


def coordinates():
    return Coordinates({"run": ([0, 1, 2], "")}, 0.001, 0.0, "time")


AWAY = (
    "Directory not empty",
    "No such file or directory",
)  # files come and go under the hands of who clears up


def begun(folder):
    """Begins once zarr's threads, which outlive a failed write within one process, have let go of the folder."""
    for left in reversed(range(600)):
        settled()
        try:
            return Store(folder).begin({"identity": "x"}, coordinates(), fresh=False)
        except UsageError as error:
            if not left or not any(text in str(error) for text in AWAY):
                raise
            time.sleep(0.1)
    return None


def test_a_batch_whose_beginning_fails_begins_again(tmp_path):
    for at in range(1, 200):
        folder = tmp_path / str(at)
        with failing_call(at) as faults, contextlib.suppress(UsageError):  # nothing else
            Store(folder).begin({"identity": "x"}, coordinates(), fresh=False)
        assert begun(folder) == 0
        if faults.seen < at:
            return
    pytest.fail("no end of calls")


@pytest.mark.skipif(sys.platform == "win32", reason="a limit of POSIX")
def test_half_a_line_never_stays_in_the_journal(tmp_path):
    store = Store(tmp_path)
    store.begin({"identity": "x"}, coordinates(), fresh=False)
    store.add([outcome(0)])
    store.flush()
    size = store.path("journal").stat().st_size
    store.add([outcome(1)])
    with full_after(size + 20), pytest.raises(OSError, match=r"space|large"):
        store.flush()
    assert store.path("journal").stat().st_size == size
    store.flush()
    assert Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=False) == 2
    with failing_call(1), pytest.raises(OSError, match="No space"):
        write_text(store.path("runs"), "half")
    assert isinstance(store.finish({"run": [0, 1, 2]}), pd.DataFrame)


def simulated(number):
    signals = {name: Signal(np.full(4, 1.0 * number), "rad", ("deg", 57.3, 0.0)) for name in ("a.x", "a.y")}
    return Outcome(number=number, status="done", seconds=0.1, worker="w", scores={}, signals=signals)


def settled():
    """Waits for what zarr goes on with though one of its writes has failed."""
    until = time.monotonic() + 60.0
    while (loop := zarr.core.sync.loop[0]) is not None and asyncio.all_tasks(loop):
        assert time.monotonic() < until
        time.sleep(0.01)


def described(folder):
    """What the cube says of itself, by file."""
    cube = folder / "signals.zarr"
    return {p.relative_to(cube).as_posix(): p.read_text() for p in cube.rglob(".z*")}


def gone_on(folder):
    """What the cube of a batch says that goes on, to its end."""
    begun(folder)
    store = Store(folder)
    for number in range(store.begin({"identity": "x"}, coordinates(), fresh=False), 3):
        store.add([simulated(number)])
        store.flush()
    store.finish({"run": [0, 1, 2]})
    return described(folder)


def test_a_batch_that_ends_while_a_signal_gets_its_place_goes_on_to_the_same_cube(tmp_path):
    """A kill between the list of signals and the signal named it twice; one before its attributes left it without."""
    whole = gone_on(tmp_path / "whole")
    assert len(whole) > 8
    for at in range(1, 200):
        folder = tmp_path / str(at)
        begun(folder)
        store = Store(folder)
        store.begin({"identity": "x"}, coordinates(), fresh=False)
        with failing_call(at) as faults, contextlib.suppress(OSError):
            store.add([simulated(0)])
            store.flush()
        assert gone_on(folder) == whole, at
        if faults.seen < at:
            return
    pytest.fail("no end of calls")


def test_a_batch_that_is_done_stays_whole_where_a_disk_is_full_as_it_is_asked_again(tmp_path):
    whole = gone_on(tmp_path / "whole")
    assert "time/.zarray" in whole
    for at in range(1, 200):
        folder = tmp_path / str(at)
        shutil.copytree(tmp_path / "whole", folder)
        store = Store(folder)
        with failing_call(at) as faults, contextlib.suppress(OSError, UsageError):
            assert store.begin({"identity": "x"}, coordinates(), fresh=False) == 3
            store.finish({"run": [0, 1, 2]})
        settled()
        assert described(folder) == whole, at
        assert (folder / "signals.zarr" / "time" / "0").exists(), at
        if faults.seen < at:
            return
    pytest.fail("no end of calls")


@contextlib.contextmanager
def killed_at(at):
    """Ends in the place of the n-th file or folder that would be taken away; says whether there was one."""
    seen = []

    def instead(call):
        def removed(*arguments, **options):
            if threading.current_thread() is threading.main_thread():  # one of zarr's that ends hangs it
                seen.append(arguments)
                if len(seen) == at:
                    raise SystemExit
            return call(*arguments, **options)

        return removed

    with contextlib.ExitStack() as stack:
        for name in ("unlink", "rmdir"):
            stack.enter_context(mock.patch.object(os, name, instead(getattr(os, name))))
        yield seen


def test_a_batch_that_ends_while_another_is_thrown_away_goes_on(tmp_path):
    """Killed between its plan and its journal, the folder held no batch, and was refused ever after."""
    old, new = {"identity": "old"}, {"identity": "new"}
    whole = gone_on(tmp_path / "whole")
    for at in range(1, 200):
        folder = tmp_path / str(at)
        gone_on(folder)
        with killed_at(at) as seen, contextlib.suppress(SystemExit):
            Store(folder).begin(new, coordinates(), fresh=True)
        with contextlib.suppress(UsageError):  # the old batch is still there as such
            assert Store(folder).begin(old, coordinates(), fresh=False) in (0, 3)
        store = Store(folder)
        assert store.begin(new, coordinates(), fresh=True) == 0
        for number in range(3):
            store.add([simulated(number)])
        store.flush()
        store.finish({"run": [0, 1, 2]})
        assert described(folder) == whole
        if len(seen) < at:
            return
    pytest.fail("no end of calls")


def test_what_zarr_was_killed_beside_goes_when_the_batch_goes_on(tmp_path):
    whole = gone_on(tmp_path)
    left = tmp_path / "signals.zarr" / "a.x" / f"0.{'ab' * 16}.partial"
    fresh = left.with_name(f"0.{'cd' * 16}.partial")
    left.write_bytes(b"half")
    fresh.write_bytes(b"of another process that writes now")
    os.utime(left, (time.time() - 5.0,) * 2)
    assert Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=False) == 3
    assert not left.exists()
    assert fresh.exists()
    assert described(tmp_path) == whole


@pytest.mark.parametrize("what", [".", ".zattrs", ".zgroup", "a.x/.zarray", "a.x/.zattrs"])
def test_a_damaged_cube_is_named_with_a_way_out(tmp_path, what):
    gone_on(tmp_path)
    lost = tmp_path / "signals.zarr" / what
    if lost.is_dir():
        shutil.rmtree(lost)
    else:
        lost.write_bytes(b"")
    with pytest.raises(DataError, match=r"signals.zarr is damaged .*--fresh"):
        Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=False)
    assert Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=True) == 0


def test_of_two_batches_in_one_folder_the_second_is_told_who_writes_there(tmp_path):
    with Store(tmp_path).alone():
        Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=False)
        with pytest.raises(UsageError, match=rf"another batch writes into .*process {os.getpid()} on"):
            Store(tmp_path).alone().__enter__()
    assert [item.name for item in tmp_path.iterdir() if "lock" in item.name] == []
    (tmp_path / LOCK).write_text("process 1 on a host, killed")
    with Store(tmp_path).alone():
        assert Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=False) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="asks of an open file which it is")
def test_a_line_of_the_journal_comes_after_its_signals_are_on_the_disk(tmp_path, monkeypatch):
    """After a power cut a name may stand for an empty file unless it was synced before."""
    synced, checked, sync = set(), [], os.fsync

    def counted(handle):
        about = os.fstat(handle)
        if store.path("journal").exists() and os.path.samestat(about, store.path("journal").stat()):
            stats = {path: path.stat() for path in (tmp_path / "signals.zarr").rglob("*")}
            checked.append([path for path, s in stats.items() if (s.st_ino, s.st_mtime_ns) not in synced])
        synced.add((about.st_ino, about.st_mtime_ns))
        sync(handle)

    store = Store(tmp_path)
    monkeypatch.setattr(os, "fsync", counted)
    store.begin({"identity": "x"}, coordinates(), fresh=False)
    for number in range(3):
        store.add([simulated(number)])
        store.flush()
    assert checked == [[], [], []]


def damaged(file, how):
    if how == "gone":
        file.unlink()
    else:
        file.write_bytes({"empty": b"", "half": file.read_bytes()[:20], "zeros": bytes(500)}[how])


@pytest.mark.parametrize("how", ["gone", "empty", "half", "zeros", "older"])
def test_runs_whose_signals_a_disk_has_lost_are_done_again(tmp_path, how):
    store = Store(tmp_path)
    store.begin({"identity": "x"}, coordinates(), fresh=False)
    chunk = tmp_path / "signals.zarr" / "a.y" / "0.0"
    kept = b""
    for number in range(3):
        store.add([simulated(number)])
        store.flush()
        kept = kept or chunk.read_bytes()
    store.finish({"run": [0, 1, 2]})
    whole = chunk.read_bytes()
    if how == "older":
        chunk.write_bytes(kept)
    else:
        damaged(chunk, how)
    again = Store(tmp_path)
    done = again.begin({"identity": "x"}, coordinates(), fresh=False)
    assert (done, again.spoilt) == ((1, 2) if how == "older" else (0, 3))
    again.add([simulated(number) for number in range(3) if number not in again.rows])
    again.flush()
    again.finish({"run": [0, 1, 2]})
    assert chunk.read_bytes() == whole
    assert Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=False) == 3


@pytest.mark.parametrize("how", ["gone", "empty", "half", "zeros"])
@pytest.mark.parametrize("what", ["run/0", "run/.zarray", ".zattrs"])
def test_an_axis_that_a_disk_has_lost_is_named(tmp_path, how, what):
    gone_on(tmp_path)
    damaged(tmp_path / "signals.zarr" / what, how)
    with pytest.raises(DataError, match=r"signals.zarr is damaged .*--fresh"):
        Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=False)


def test_a_line_of_the_journal_without_what_every_line_has_is_named(tmp_path):
    gone_on(tmp_path)
    journal = tmp_path / "journal.jsonl"
    journal.write_text(journal.read_text().replace('"reason"', '"reasom"', 1))
    with pytest.raises(DataError, match=r"journal.jsonl, line 1 is damaged"):
        Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=False)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_signal_waits_until_zarr_has_written(tmp_path, monkeypatch):
    """Else Python says as it ends that tasks were destroyed, or that none can be begun any more."""
    store, write, struck = Store(tmp_path), LastingStore.set, []

    async def interrupted(self, key, value):
        if not struck:
            struck.append(key)
            signal.pthread_kill(threading.main_thread().ident, signal.SIGTERM)
            await asyncio.sleep(0.2)
        await write(self, key, value)

    store.begin({"identity": "x"}, coordinates(), fresh=False)
    monkeypatch.setattr(LastingStore, "set", interrupted)
    with pytest.raises(KeyboardInterrupt), ended_in_order():  # noqa: PT012
        store._group().attrs["label"] = "asked twice"
        time.sleep(5.0)
    assert struck
    assert not asyncio.all_tasks(zarr.core.sync.loop[0])
    assert '"asked twice"' in (tmp_path / "signals.zarr" / ".zattrs").read_text()


def test_axes_and_signals_of_any_kind_are_known_again(tmp_path):
    kinds = {
        "model": (["a", "ä", ""], ""),
        "p.on": ([True, False, True], ""),
        "p.x": ([0.1, np.nan, 2.0], "kg"),
    }
    axes = Coordinates({"run": ([0, 1, 2], ""), **kinds}, 0.001, 0.0, "time")
    store = Store(tmp_path)
    store.begin({"identity": "x"}, axes, fresh=False)
    for number, values in enumerate(([1.0, np.nan, -0.0, np.inf], [0.1, 0.2], [])):
        signal_ = Signal(np.array(values, dtype=np.float32), "rad", ("deg", 57.3, 0.0))
        store.add([Outcome(number, "done", seconds=0.1, worker="w", signals={"a.x": signal_})])
    store.flush()
    again = Store(tmp_path)
    assert (again.begin({"identity": "x"}, axes, fresh=False), again.spoilt) == (3, 0)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_signal_as_the_journal_is_synced_writes_no_line_twice(tmp_path, monkeypatch):
    store, sync = Store(tmp_path), os.fsync
    store.begin({"identity": "x"}, coordinates(), fresh=False)
    store.add([outcome(0)])

    def struck(handle):
        sync(handle)
        if store.path("journal").exists():
            monkeypatch.undo()
            signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(os, "fsync", struck)
    with pytest.raises(KeyboardInterrupt), ended_in_order():  # noqa: PT012
        try:
            store.flush()
        finally:
            store.flush()  # as a batch does that is ended
    assert len(store.path("journal").read_bytes().splitlines()) == 1
