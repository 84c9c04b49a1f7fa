"""Logs of hours: signals handed out in pieces and laid into a file are the same numbers, in bounded memory."""

import io
import json
import subprocess
import sys
import zipfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim.beside import run
from cosim.compare import Comparator, open_model, picture, present, recording
from cosim.compare.recording import Recording
from cosim.errors import SimulationError
from cosim.logs import write_log
from cosim.master import engine
from cosim.native.build import MissingCompilerError, compiler
from cosim.native.package import native_bytes


def found(log, folder, name):
    """A comparison's scores and its series as a file."""
    with Comparator(log, open_model("full_order")) as comparator:
        comparison = comparator.run()
    path = present.write_series(comparison, folder / name)
    blocks = [(b.name, {s: asdict(x.score) for s, x in b.signals.items()}) for b in comparison.blocks]
    return {s: asdict(x.score) for s, x in comparison.signals.items()}, blocks, path


@pytest.mark.parametrize("suffix", ["parquet", "csv"])
def test_pieces_and_files_change_no_bit(built, clean, tmp_path, monkeypatch, suffix):
    whole = found(clean, tmp_path, f"whole.{suffix}")
    monkeypatch.setattr(engine, "PIECE", 377)
    monkeypatch.setattr(recording, "MOST_KEPT", 100)
    monkeypatch.setattr(present, "ROWS", 1001)
    pieces = found(clean, tmp_path, f"pieces.{suffix}")
    assert pieces[:2] == whole[:2]
    if suffix == "csv":
        assert pieces[2].read_bytes() == whole[2].read_bytes()
    else:
        files = [pq.ParquetFile(path) for path in (whole[2], pieces[2])]
        assert files[1].num_row_groups > files[0].num_row_groups == 1
        assert files[1].read().equals(files[0].read(), check_metadata=True)


@pytest.mark.slow
def test_long_logs_are_run_by_native_fmus_with_the_same_numbers(built, clean, monkeypatch):
    try:
        compiler()
    except MissingCompilerError as error:
        pytest.skip(str(error))
    seen = []

    def watched(log, source, **more):
        seen.append(source)
        assert is_native(source) == (run.LONG == 1)
        return Comparator(log, source, **more)

    monkeypatch.setattr(run, "Comparator", watched)
    by_python = run.beside(clean)
    monkeypatch.setattr(run, "LONG", 1)
    by_native = run.beside(clean)
    assert [f.name for f in seen] == ["full_order_open.ssp"] * 2
    assert seen[0] == by_python.source == by_native.source
    assert not seen[1].exists()  # the copy is gone
    assert by_native.as_data() == by_python.as_data()
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setattr(run, "LONG", 0)
    native_bytes.cache_clear()
    assert run.beside(clean).as_data() == by_python.as_data()  # without a compiler by Python
    assert seen[2] == seen[0]


def is_native(package):
    """Whether the FMUs of a package are native."""
    with (
        zipfile.ZipFile(package) as archive,
        zipfile.ZipFile(io.BytesIO(archive.read("resources/dcv.fmu"))) as fmu,
    ):
        return "sources/fmu.c" in fmu.namelist()


@pytest.mark.parametrize("most_kept", [0, 100])
def test_a_recording_gives_back_what_was_put(most_kept):
    values = {name: np.random.default_rng(seed).normal(size=100) for seed, name in enumerate("ab")}
    held = Recording(values, 100, most_kept)
    for first in (40, 0, 99, 33):  # pieces need not come in order
        last = {0: 33, 33: 40, 40: 99, 99: 100}[first]
        held.put(first, {name: row[first:last] for name, row in values.items()})
    for name, row in values.items():
        assert np.array_equal(held.read(name), row)
        assert np.array_equal(held.read(name, slice(30, 45)), row[30:45])
        assert np.array_equal(held.read(name, slice(95, 200)), row[95:])
        assert held.read(name, slice(0, 0)).size == 0


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a device that is always full")
def test_a_full_disk_is_told_with_its_remedy(monkeypatch):
    with Path("/dev/full").open("r+b", buffering=0) as full:
        monkeypatch.setattr(recording.tempfile, "TemporaryFile", lambda **_: full)
        held = Recording(["a"], 1000, 0)
        with pytest.raises(SimulationError, match=r"No space left on device.*TMPDIR"):
            held.put(0, {"a": np.zeros(1000)})


def test_a_thinned_line_keeps_every_peak():
    time = np.arange(1_000_001) * 1e-3
    values = np.random.default_rng(1).normal(size=time.size)
    values[[123_456, 987_654]] = 40.0, -50.0
    values[5000:8000] = np.nan
    at, shown = picture.drawn(time, values)
    assert len(at) == len(shown) == 2 * picture.BINS
    assert np.nanmax(shown) == 40.0
    assert np.nanmin(shown) == -50.0
    assert abs(at[np.nanargmax(shown)] - 123.456) <= 0.1
    assert np.all(np.diff(at) >= 0.0)
    gap = (at >= 5.1) & (at < 7.9)
    assert np.isnan(shown[gap]).all()
    few = picture.drawn(time[:1000], values[:1000])
    assert few[0] is not None
    assert np.array_equal(few[1], values[:1000])


@pytest.mark.parametrize("width", [1, 2, 7, 100])
def test_a_moving_sum_is_a_convolution(width):
    values = np.random.default_rng(width).normal(size=100)
    wanted = np.convolve(values, np.ones(width), "same")
    np.testing.assert_allclose(picture._moving_sum(values, width), wanted, rtol=0.0, atol=1e-12)


PEAK = """
import json, resource, sys
from pathlib import Path
from cosim.beside.run import beside
from cosim.compare import recording
recording.MOST_KEPT = 0
beside(Path(sys.argv[1]), out=Path(sys.argv[2]))
print(json.dumps(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss in KiB is Linux's")
def test_memory_per_row(built, rig_log, tmp_path):
    """A row costs twenty numbers at most: ten of the log, the rest for the signal that is scored, drawn or written."""
    rows, peaks = (300_000, 1_200_000), []
    for count in rows:
        log = tmp_path / f"{count}.parquet"
        write_log(rig_log(seconds=count / 1000, observer=True), log)
        done = subprocess.run(
            [sys.executable, "-c", PEAK, str(log), str(tmp_path / str(count))],
            capture_output=True,
            check=True,
        )
        peaks.append(json.loads(done.stdout))
    assert (peaks[1] - peaks[0]) / (rows[1] - rows[0]) < 20 * 8
