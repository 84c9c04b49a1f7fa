"""The end of a process that ran FMUs, and runs repeated by reset.

pythonfmu 0.7.0 releases a static object twice at exit, the second time on freed memory, which aborts the process now and
then. A library laid before the C library's own `free` makes that certain: it ends the process at any second release.
"""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from fmpy import read_model_description

from benchmarks.plain_host import compiled_host, libpython, run_host
from cosim.export import prepare
from cosim.ssp.read import read_system

HERE = Path(__file__).resolve().parent
COMPILER = shutil.which("cc")
pytestmark = pytest.mark.skipif(
    COMPILER is None or not sys.platform.startswith("linux"), reason="needs Linux and a C compiler"
)


def compiled(source: str, out: Path, *flags: str) -> Path:
    subprocess.run(
        [str(COMPILER), *flags, "-o", str(out), str(HERE / source), "-ldl"], check=True, capture_output=True
    )
    return out


@pytest.fixture(scope="session")
def watch(tmp_path_factory) -> Path:
    """The library that watches `free`."""
    return compiled(
        "second_release.c", tmp_path_factory.mktemp("watch") / "watch.so", "-shared", "-fPIC", "-O1"
    )


@pytest.mark.parametrize("how", ["open", "closed", "deleted"])
def test_a_python_host_ends_cleanly(unpacked, tmp_path, watch, how) -> None:
    folders = [shutil.copytree(unpacked[n], tmp_path / n) for n in ("stimulus", "dcv", "mechanical")]
    command = [sys.executable, str(HERE / "fmu_scenarios.py"), "leave", how, *map(str, folders)]
    done = subprocess.run(
        command, env={"LD_PRELOAD": str(watch)}, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr


def test_the_watch_sees_a_second_release(unpacked, tmp_path, watch) -> None:
    """With our own release taken out the same process is aborted."""
    folder = shutil.copytree(unpacked["dcv"], tmp_path / "dcv")
    script = next((folder / "resources").glob("dcv_*.py"))
    text = script.read_text(encoding="utf-8")
    assert "        self.settle_at_exit()\n" in text
    script.write_text(text.replace("        self.settle_at_exit()\n", ""), encoding="utf-8")
    command = [sys.executable, str(HERE / "fmu_scenarios.py"), "leave", "open", str(folder)]
    done = subprocess.run(
        command, env={"LD_PRELOAD": str(watch)}, capture_output=True, text=True, check=False
    )
    assert done.stdout == "done\n", done.stderr
    assert done.returncode == -6


@pytest.mark.parametrize("how", ["f", "fc", "-"])
def test_a_host_that_is_not_python_ends_cleanly(unpacked, tmp_path, watch, how) -> None:
    """It frees the instance, also closes the library, or does neither; Python's library is laid before it (PITFALLS)."""
    python = Path(sysconfig.get_config_var("LIBDIR"), sysconfig.get_config_var("INSTSONAME") or "")
    if not python.is_file() or ".so" not in python.name:
        pytest.skip("this Python has no shared library")
    host = compiled("host.c", tmp_path / "host")
    folder = unpacked["stimulus"]
    description = read_model_description(str(folder), validate=False)
    library = next((folder / "binaries" / "linux64").iterdir())
    packages = sysconfig.get_paths()["purelib"]
    done = subprocess.run(
        [str(host), str(library), f"file://{folder}/resources", description.guid, how],
        env={"LD_PRELOAD": f"{python}:{watch}", "PYTHONPATH": packages},
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr


def test_a_host_that_is_not_python_ends_cleanly_with_several_fmus(packages, tmp_path) -> None:
    """Each library is released before any is destroyed; Python ends with the first library, which is the last to end."""
    python, host = libpython(), compiled_host(tmp_path)
    if python is None or host is None:
        pytest.skip("this Python has no shared library")
    signals = ["mechanical.theta"]
    with read_system(packages["full_order"]) as system:
        found = [run_host(host, prepare(system), 20, 1e-3, signals, python) for _ in range(3)]
    assert [len(each["time"]) for each in found] == [21, 21, 21]


def test_a_reset_does_not_read_the_table_again(unpacked, tmp_path) -> None:
    folder = shutil.copytree(unpacked["stimulus"], tmp_path / "stimulus")
    rows = "".join(f"{0.001 * k!r},{k % 7}\n" for k in range(60_000))
    (folder / "resources" / "stimulus.csv").write_text("time,u\n" + rows)
    command = [sys.executable, str(HERE / "fmu_scenarios.py"), "resets", str(folder), "40"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    growth, reads = done.stdout.split()
    assert int(reads) == 2, "once for each column"
    assert float(growth) < 1000, "KiB over 20 runs; one table is 4 MiB"


def test_a_changed_table_is_read_again(unpacked, tmp_path) -> None:
    import os

    from fmu_raw import Instance

    folder = shutil.copytree(unpacked["stimulus"], tmp_path / "stimulus")
    table = folder / "resources" / "stimulus.csv"
    table.write_text("time,u\n0,0.25\n")
    slave = Instance(folder)
    assert slave.initialise().get("u") == [0.25]
    stamp = table.stat().st_mtime_ns + 1_000_000
    table.write_text("time,u\n0,0.75\n")
    os.utime(table, ns=(stamp, stamp))
    slave.fmu.reset()
    assert slave.initialise().get("u") == [0.75]
    slave.close()


def test_an_instance_leaves_next_to_nothing_behind(fmu_files) -> None:
    """pythonfmu keeps every class it finds; were it a new one for each instance, that would be 160 kB each."""
    command = [sys.executable, "benchmarks/instances.py", "--count", "150", "--json"]
    done = subprocess.run(
        [*command, "--fmu", str(fmu_files["mechanical"])],
        cwd=HERE.parents[1],
        env={**os.environ, "PYTHONPATH": "."},
        check=True,
        capture_output=True,
    )
    assert json.loads(done.stdout)["kB_each"] < 10.0  # 10 000 instances within 100 MiB
