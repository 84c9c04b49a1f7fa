"""Commands on a machine that fails: full disk, write-protected or deleted folders, no home, a spoilt cache."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fault_injection import failing_call, full_after

from cosim.compiled import CompiledBlock, cache_folder, load_compiled
from cosim.errors import ModelError
from cosim.logs import write_log
from cosim.rig import as_log, make_log
from fmus import registry
from fmus.build import build_fmu
from fmus.compose import compose

TOP = Path(__file__).resolve().parents[2]
OLD = b"what was there before"
posix = pytest.mark.skipif(sys.platform == "win32", reason="POSIX only")


def run_python(*words, folder, **environment):
    kept = {name: value for name, value in os.environ.items() if environment.get(name, value) is not None}
    known = kept | {name: str(value) for name, value in environment.items() if value is not None}
    return subprocess.run(
        [sys.executable, *map(str, words)], cwd=folder, env=known | {"PYTHONPATH": str(TOP)},
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip


@pytest.fixture
def simulate(command, packages):
    """A short simulation into a file -> exit code and stderr."""

    def run(path):
        code, _, error = command("simulate", packages["simplified"], "--stop-time", "0.05 s", "--out", path)
        return code, error

    return run


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_simulate_leaves_old_or_new_whatever_fails(simulate, tmp_path, suffix):
    path = tmp_path / f"out{suffix}"
    assert simulate(path)[0] == 0
    size = path.stat().st_size
    for at in range(1, 400):
        path.write_bytes(OLD)
        with failing_call(at) as faults:
            code, error = simulate(path)
        assert "internal error" not in error
        assert "Traceback" not in error
        assert code in (0, 2, 3)
        assert path.stat().st_size == size if code == 0 else path.read_bytes() == OLD
        assert [item.name for item in tmp_path.iterdir()] == [path.name]
        if faults.seen < at:
            assert code == 0
            return
    pytest.fail("no end of calls")


def test_build_says_that_the_disk_is_full(command, tmp_path, monkeypatch):
    monkeypatch.setattr("cosim.ssp.build.fmu_bytes", lambda *_: bytes(3000))
    for at in (1, 3, 5, 6, 8):  # a folder, what a file holds, its name
        folder = tmp_path / str(at) / "build"
        with failing_call(at):
            code, _, error = command("build", "--out", folder)
        assert code == 2
        assert "cannot build into" in error
        assert "No space left on device" in error
        assert "name another folder" in error
        assert not list(folder.rglob("*.part*"))


@posix
def test_build_keeps_what_is_good_when_the_disk_fills(command, tmp_path, monkeypatch):
    folder = tmp_path / "build"
    (folder / "fmus").mkdir(parents=True)
    good = folder / "fmus" / "dead_zone.fmu"
    good.write_bytes(OLD)
    monkeypatch.setattr("cosim.ssp.build.fmu_bytes", lambda *_: bytes(3000))
    with full_after(1000):
        code, _, error = command("build", "--out", folder)
    assert code == 2
    assert "cannot build into" in error
    assert "File too large" in error
    assert [item.read_bytes() for item in folder.rglob("*.*")] == [OLD]


def test_a_result_below_a_file_is_refused(command, tmp_path, built):
    (tmp_path / "file").write_bytes(OLD)
    code, _, error = command("build", "--out", tmp_path / "file" / "build")
    assert code == 2
    assert "Not a directory" in error or "exists" in error


@posix
def test_a_deleted_folder_is_named(tmp_path):
    script = (
        "import os, sys; os.rmdir(os.getcwd()); from cosim.cli import main; main(['build', '--out', 'here'])"
    )
    gone = tmp_path / "gone"
    gone.mkdir()
    done = run_python("-c", script, folder=gone)
    assert done.returncode == 2
    assert done.stderr.strip().endswith("the current folder does not exist any more: change to another one")


@posix
def test_a_deleted_folder_is_named_where_fmus_run(tmp_path, packages):
    gone = tmp_path / "gone"
    gone.mkdir()
    words = ["simulate", str(packages["simplified"]), "--stop-time", "0.1 s"]
    script = f"import os, sys; os.rmdir(os.getcwd()); from cosim.cli import main; main({words!r})"
    done = run_python("-c", script, folder=gone)
    assert done.returncode == 2
    assert done.stderr.strip().endswith("the current folder does not exist any more: change to another one")


def sensor():
    return compose(registry.block("sensor"))


USE = """
import numpy as np
from cosim.compiled import CompiledBlock
from fmus import registry
from fmus.build import build_fmu
from fmus.compose import compose
block = CompiledBlock(compose(registry.block("sensor")))
print(repr(float(block.run(np.ones((len(block.composed.block.inputs), 5)), 1e-3, {})[0, -1])))
"""


@pytest.fixture(scope="module")
def answer():
    block = CompiledBlock(sensor())
    return repr(float(block.run(np.ones((len(block.composed.block.inputs), 5)), 1e-3, {})[0, -1]))


@pytest.mark.parametrize("place", ["/dev/null/cache", "file"])
def test_a_cache_that_cannot_be_made_is_done_without(tmp_path, answer, place):
    (tmp_path / "file").write_bytes(OLD)
    where = place if place.startswith("/") else tmp_path / place
    done = run_python("-c", USE, folder=tmp_path, COSIM_CACHE=where, HOME=None)
    assert (done.stdout.strip(), done.stderr) == (answer, "")


def test_a_spoilt_cache_is_made_anew(tmp_path, answer):
    for spoil in (None, b"garbage", b""):
        for file in tmp_path.rglob("*") if spoil is not None else ():
            if file.is_file():
                file.write_bytes(spoil)
        done = run_python("-c", USE, folder=TOP, COSIM_CACHE=tmp_path)
        assert (done.stdout.strip(), done.stderr) == (answer, "")
    assert list(tmp_path.rglob("*.nbi"))


def test_the_folder_of_compiled_code_is_the_caches():
    module = load_compiled(sensor())
    assert Path(module.__file__).parent == cache_folder()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is full")
def test_where_nothing_can_be_said_the_exit_code_says_it(tmp_path):
    log = write_log(as_log(make_log("steps", 2.0)), tmp_path / "log.csv")

    def ran(*words, **where):
        line = [sys.executable, "-m", "cosim", *map(str, words)]
        with Path("/dev/full").open("w") as full:
            streams = {name: full if name in where else subprocess.PIPE for name in ("stdout", "stderr")}
            done = subprocess.run(line, **streams, cwd=TOP, text=True, check=False, timeout=600)
        assert "Traceback" not in (done.stderr or "")
        assert "Exception ignored" not in (done.stderr or "")
        return done

    for words in (["info", log], ["info", log, "--json"]):
        done = ran(*words, stdout="full")
        assert done.returncode == 2
        assert done.stderr == "error: the system refused a file: No space left on device\n"
    assert ran("info", tmp_path / "absent", stderr="full").returncode == 3
    done = ran("info", tmp_path / "absent", "--json", stderr="full")
    assert json.loads(done.stdout)["exit_code"] == done.returncode == 3


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="names of any bytes")
def test_a_name_that_is_no_text_is_refused(command, tmp_path):
    for option in ([], ["--json"]):
        code, out, err = command("info", os.fsdecode(bytes(tmp_path) + b"/b\xff.csv"), *option)
        assert code == 2
        assert "b?.csv' is not in UTF-8: rename it" in err
        assert not option or json.loads(out)["exit_code"] == 2


@posix
@pytest.mark.parametrize("words", [["validate"], ["simulate", "--stop-time", "0.1 s", "--out", "x.csv"]])
def test_no_room_for_temporary_files_is_no_fault_of_the_model(
    command, packages, words, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with full_after(5000):
        code, out, err = command(words[0], packages["simplified"], *words[1:])
    assert code == 2
    assert "no room to unpack" in err
    assert "set TMPDIR to a folder on another disk" in err
    assert "invalid" not in out


@posix
def test_an_fmu_that_finds_no_room_is_told_in_a_line(tmp_path):
    with full_after(40_000), pytest.raises(ModelError, match="pythonfmu could not build") as failed:
        build_fmu(compose(registry.block("sensor")), tmp_path / "sensor.fmu")
    assert "File too large" in str(failed.value)
    assert len(str(failed.value).splitlines()) == 1


@pytest.mark.usefixtures("undrawn")
def test_what_a_command_reads_is_never_a_result(command, packages, tmp_path):
    log = as_log(make_log("steps", 3.0))
    for name in ("series.parquet", "next_experiment.csv", "played.csv"):
        write_log(log, tmp_path / name)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    model = packages["simplified"]
    for words in (
        ["compare", "series.parquet", "--model", model, "--out", tmp_path],
        ["compare", "played.csv", "--model", model, "--calibrate", "--held-out", "series.parquet", "--out", tmp_path],
        ["diagnose", "next_experiment.csv", "--model", "simplified", "--out", tmp_path],
        ["diagnose", "played.csv", "--held-out", "next_experiment.csv", "--model", "simplified", "--out", tmp_path],
        ["simulate", model, "--input", "played.csv", "--out", tmp_path / "played.csv"],
        ["rig", "--excitation", "file", "--input", "played.csv", "--out", tmp_path / "played.csv"],
    ):  # fmt: skip
        read = [str(tmp_path / w) if str(w) in {p.name for p in before} else w for w in words]
        code, _, error = command(*read)
        assert code == 2, (words, error)
        assert "is read, and a result of that name would take its place" in error
        assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.usefixtures("undrawn")
def test_a_parameter_set_among_earlier_results_stays(command, packages, tmp_path):
    log = write_log(as_log(make_log("steps", 3.0)), tmp_path / "log.csv")
    fitted = tmp_path / "out" / "calibrated.ssv"
    fitted.parent.mkdir()
    with zipfile.ZipFile(packages["simplified"]) as archive:
        text = archive.read("resources/simplified.ssv").decode()
    fitted.write_text(
        text.replace('name="', 'name="simplified.').replace('name="simplified.nominal"', 'name="x"')
    )
    stays = fitted.read_bytes()
    words = [
        "compare",
        log,
        "--model",
        packages["simplified"],
        "--parameter-set",
        fitted,
        "--out",
        fitted.parent,
    ]
    code, _, error = command(*words)
    assert code == 0, error
    assert fitted.read_bytes() == stays


@pytest.mark.parametrize("tolerance", ["nan", "inf", "0", "-1"])
def test_a_tolerance_that_makes_no_sense_is_refused(command, tmp_path, tolerance):
    log = write_log(as_log(make_log("steps", 2.0)), tmp_path / "log.csv")
    for words in (["diagnose", log], ["batch", "--diagnose", log]):
        code, _, error = command(*words, "--tolerance", tolerance, "--out", tmp_path / "out")
        assert code == 2, error
        assert "tolerance" in error
        assert not (tmp_path / "out" / "diagnosis.json").exists()
