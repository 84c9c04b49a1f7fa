"""The log is whole whatever happens: killed, cut, on a full disk."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from fault_injection import full_after

from cosim.errors import DataError, UsageError
from cosim.live.link import STALE
from cosim.live.recorder import CHUNK, Recorder
from cosim.logs import load_log

COLUMNS = ["u [1]", "slew [deg]", "synthetic [1]"]


def filled(path, rows):
    recorder = Recorder(path, COLUMNS, 1e-3)
    for k in range(rows):
        recorder.add(k, [0.001 * k, None if k % 100 == 50 else 10.0 + 0.01 * k, 1.0])
    recorder.close()
    return recorder


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_what_is_recorded_is_read_back(tmp_path, suffix) -> None:
    recorder = filled(tmp_path / f"log{suffix}", 1234)
    assert (recorder.rows, recorder.rows_lost, recorder.error) == (1234, 0, "")
    log = load_log(recorder.path)
    assert log.time == pytest.approx(np.arange(1234) * 1e-3)
    assert log.synthetic
    assert log["u"] == pytest.approx(np.arange(1234) * 1e-3)
    assert np.degrees(log["slew"]) == pytest.approx(10.0 + 0.01 * np.arange(1234))
    assert int((~log.valid_mask("slew")).sum()) == 12
    assert [path.name for path in tmp_path.iterdir()] == [recorder.path.name]


def test_a_row_can_be_changed_for_a_while(tmp_path) -> None:
    recorder = Recorder(tmp_path / "log.csv", COLUMNS, 1e-3)
    for k in range(300):
        recorder.add(k, [0.0, None, 0.0])
    assert recorder.row(300 - STALE - 1) is None
    row = recorder.row(300 - STALE)
    assert row is not None
    row[1] = 77.0
    assert recorder.row(300) is None
    recorder.close()
    lines = recorder.path.read_text().splitlines()
    assert lines[1 + 300 - STALE] == "0.200000,0,77,0"
    assert sum(",77," in line for line in lines) == 1


# a kill takes nothing that was written, so a disk that is slow to keep it for good has no say here; after a pause of the
# machine the rows go on one a millisecond, as the thread that writes them had the same pause
KILLED = """
import os, sys, time
from pathlib import Path
from cosim.live.recorder import Recorder
os.fsync = lambda file: None
recorder = Recorder(Path(sys.argv[1]), ["u [1]", "slew [deg]"], 1e-3)
for k in range(100_000):
    begun = time.perf_counter()
    while time.perf_counter() < begun + 1e-3:
        time.sleep(2e-4)
    recorder.add(k, [0.5, 12.0])
    if k % 100 == 0:
        print(k, flush=True)
"""


def test_a_kill_leaves_all_but_the_last_second(tmp_path) -> None:
    path = tmp_path / "log.csv"
    with subprocess.Popen([sys.executable, "-c", KILLED, path], stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        reached = 0
        while reached < 1500:
            reached = int(child.stdout.readline())
        child.send_signal(signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
        child.wait(60)
    log = load_log(path)
    assert len(log) >= reached - 1000
    assert log.uniform
    assert (log["u"] == 0.5).all()


def test_a_log_cut_within_a_line_loads_without_that_line(tmp_path) -> None:
    path = filled(tmp_path / "log.csv", 400).path
    content = path.read_bytes()
    path.write_bytes(content[:-15])
    log = load_log(path)
    assert len(log) == 399
    assert any("cut short" in warning for warning in log.warnings)


def test_a_full_disk_leaves_whole_lines_and_is_told(tmp_path) -> None:
    with full_after(10_000):
        recorder = filled(tmp_path / "log.csv", 1500)
    content = recorder.path.read_bytes()
    assert 9_900 < len(content) <= 10_000
    assert content.endswith(b"\n")
    assert len(load_log(recorder.path)) == 1500 - recorder.rows_lost
    assert recorder.error


def test_what_did_not_fit_is_written_when_there_is_room_again(tmp_path) -> None:
    recorder = Recorder(tmp_path / "log.csv", COLUMNS, 1e-3)
    with full_after(4_000):
        for k in range(2 * CHUNK + STALE):
            recorder.add(k, [0.1, 1.0, 0.0])
        until = time.monotonic() + 60.0
        while not recorder.error and time.monotonic() < until:
            time.sleep(0.01)
    for k in range(2 * CHUNK + STALE, 1000):
        recorder.add(k, [0.1, 1.0, 0.0])
    recorder.close()
    assert recorder.rows_lost == 0
    log = load_log(recorder.path)
    assert len(log) == 1000
    assert log.uniform


def test_a_parquet_that_cannot_be_made_leaves_its_journal(tmp_path) -> None:
    recorder = Recorder(tmp_path / "log.parquet", COLUMNS, 1e-3)
    for k in range(500):
        recorder.add(k, [0.1, 1.0, 0.0])
    (tmp_path / "log.parquet").mkdir()
    with pytest.raises(DataError, match=r"all rows are in .*log\.live\.csv"):
        recorder.close()
    assert len(load_log(tmp_path / "log.live.csv")) == 500


def test_other_file_types_are_refused(tmp_path) -> None:
    with pytest.raises(UsageError, match=r"a live log is written as \.csv or \.parquet, not '\.mat'"):
        Recorder(tmp_path / "log.mat", COLUMNS, 1e-3)


def test_a_place_that_cannot_be_written_is_named(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match=r"log\.csv: cannot be written"):
        Recorder(tmp_path / "file" / "log.csv", COLUMNS, 1e-3)
