"""Commands that write many files: each call of the system failing in turn, or killed at any moment: all old or new."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fault_injection import failing_call

from cosim.files import is_left_over
from cosim.logs import write_log
from cosim.rig import make_log
from cosim.rig.write import as_log

TOP = Path(__file__).resolve().parents[2]
MOST = 16  # calls of the system that fail in turn, spread over those that a command makes
WHEN_KILLED = 8  # moments for each command and signal
TIMES = ("seconds", "written", "created", "time")  # of a machine: they differ from run to run


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A log, the same with its angle in another unit than it says, and the folder of a diagnosis of that."""
    folder = tmp_path_factory.mktemp("logs")
    log = as_log(make_log("mixed", 21.0, ["mechanical.coulomb_friction:tau_c=100"], seed=3))
    wrong = replace(log, signals=log.signals | {"slew": log.signals["slew"] * 180.0 / np.pi})
    return {"log": write_log(log, folder / "log.csv"), "wrong": write_log(wrong, folder / "wrong.csv")}


@pytest.fixture(scope="module")
def diagnosed(logs, tmp_path_factory):
    """The folder of a diagnosis."""
    folder = tmp_path_factory.mktemp("diagnosed") / "out"
    words = [sys.executable, "-m", "cosim", "diagnose", logs["wrong"], "--out", folder]
    subprocess.run(words, cwd=TOP, check=True, capture_output=True)
    return folder


COMMANDS = (
    "diagnose",
    "report",
    "export",
    "identify",
    "calibrate",
    "rig",
    "simulate",
    "build",
    "batch",
)


@pytest.fixture(params=COMMANDS)
def words(request, logs, packages, tmp_path):
    """A command line, and the folder into which it writes."""
    out = tmp_path / "out"
    if request.param == "report":
        shutil.copytree(request.getfixturevalue("diagnosed"), out)
    return {
        "diagnose": ["diagnose", logs["wrong"], "--out", out],
        "report": ["report", out],
        "export": ["export-modelica", packages["simplified"], "--out", out, "--overwrite"],
        "identify": ["identify", "dead-zone", logs["log"], "--out", out],
        "calibrate": ["compare", logs["log"], "--model", packages["simplified"], "--calibrate", "--out", out],
        "rig": ["rig", "--excitation", "steps", "--duration", "2 s", "--out", out / "log.csv"],
        "simulate": ["simulate", packages["simplified"], "--stop-time", "2 s", "--out", out / "result.csv"],
        "build": ["build", "--out", out],
        "batch": [
            *("batch", "--model", packages["simplified"], "--sweep", "simplified.a=2.5,3,3.5 1/s"),
            *("--stop-time", "2 s", "--workers", "1", "--out", out),
        ],
    }[request.param], out


def sizes(folder):
    """Every file of a folder with what it holds: a page and a picture by their size, which times change little."""
    return {
        str(item.relative_to(folder)): item.stat().st_size
        for item in sorted(folder.rglob("*"))
        if item.is_file()
    }


def whole(folder):
    """True if every file can be read to its end."""
    for item in folder.rglob("*"):
        if not item.is_file() or is_left_over(item):
            continue
        content = item.read_bytes()
        ends = {
            ".html": b"</html>",
            ".json": b"}",
            ".png": b"IEND\xaeB`\x82",
            ".parquet": b"PAR1",
            ".svg": b"</svg>",
        }
        end = ends.get(item.suffix)
        assert end is None or content.rstrip().endswith(end), item
        if item.suffix == ".json":
            json.loads(content)
        if item.suffix in (".fmu", ".ssp"):
            assert zipfile.ZipFile(item).testzip() is None, item
        if item.suffix == ".csv":
            assert content.endswith(b"\n"), item
    return True


@pytest.mark.slow
def test_whatever_call_fails_each_file_is_old_or_new(command, words, tmp_path):
    line, out = words
    first, _, said = command(*line)
    assert first == 0, said
    good = sizes(out)
    kept = tmp_path / "kept"
    shutil.copytree(out, kept)
    with failing_call(sys.maxsize) as faults:
        assert command(*line)[0] == 0
    assert faults.seen > 2
    for at in sorted({round(at) for at in np.linspace(1, faults.seen, MOST)}):
        shutil.rmtree(out)
        shutil.copytree(kept, out)
        with failing_call(at):
            code, _, error = command(*line)
        assert "internal error" not in error, (at, error)
        assert "Traceback" not in error, (at, error)
        assert code in (0, 2, 3), (at, error)
        # an answer without its report says so, and no earlier report is left beside it
        missing = set(good) - set(sizes(out))
        assert not missing or (code == 0 and "the report failed" in error and "No space left" in error), at
        assert set(sizes(out)) <= set(good), at
        assert whole(out)
        assert code == 0 or "No space left" in error, (at, error)


def child(line):
    return subprocess.Popen(
        [sys.executable, "-m", "cosim", *map(str, line)],
        cwd=TOP,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM], ids=["kill", "term"])
def test_ended_at_any_moment_each_file_is_old_or_new(words, how):
    line, out = words
    begun = time.monotonic()
    process = child(line)
    _, said = process.communicate(timeout=900)
    assert process.returncode == 0, said
    lasted = time.monotonic() - begun
    good = sizes(out)
    chance = random.Random(f"{line[0]} {how}")
    for _ in range(WHEN_KILLED):
        process = child(line)
        time.sleep(chance.uniform(0.3, 1.0) * lasted)
        process.send_signal(how)
        _, said = process.communicate(timeout=900)
        assert b"Traceback" not in said, said
        assert b"internal error" not in said, said
        assert process.returncode in (0, -how, 130, 143), (process.returncode, said)
        assert whole(out)
        assert {n for n in sizes(out) if not is_left_over(Path(n))} >= set(good)


@pytest.mark.skipif(
    sys.platform == "win32" or os.geteuid() == 0, reason="rights of POSIX, which root does not feel"
)
def test_a_folder_that_cannot_be_written_to_is_named(command, words, tmp_path):
    line, out = words
    if not out.exists():
        out.mkdir()
    out.chmod(0o500)
    try:
        code, _, error = command(*line)
    finally:
        out.chmod(0o700)
    assert code == 2
    assert "Permission denied" in error


@pytest.mark.slow
def test_two_writers_in_one_folder_leave_whole_files(words):
    line, out = words
    both = [child(line), child(line)]
    ends = []
    for process in both:
        _, said = process.communicate(timeout=900)
        # two batches in one folder would do each run twice, and one could throw away the other
        refused = line[0] == "batch" and process.returncode == 2 and b"another batch writes into" in said
        assert process.returncode == 0 or refused, said
        ends.append(process.returncode)
    assert 0 in ends
    assert whole(out)
    assert not [item for item in out.rglob("*") if is_left_over(item)]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX")
def test_without_home_and_cache_it_runs_all_the_same(words, tmp_path):
    line, out = words
    environment = {n: v for n, v in os.environ.items() if n not in ("HOME", "XDG_CACHE_HOME", "MPLCONFIGDIR")}
    done = subprocess.run(
        [sys.executable, "-m", "cosim", *map(str, line)],
        cwd=TOP, env=environment | {"COSIM_CACHE": "/dev/null/cache"},
        capture_output=True, text=True, check=False, timeout=900,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert whole(out)
