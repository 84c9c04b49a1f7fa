"""The built packages, in a virtual environment that has nothing else: every command is there and works."""

import json
import os
import subprocess
import sys
import tarfile
import urllib.request
import zipfile
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[1]
FOREIGN = ("PYTHONPATH", "COSIM_BUILD", "VIRTUAL_ENV")


def run(*words, cwd, check=True):
    environment = {name: value for name, value in os.environ.items() if name not in FOREIGN}
    return subprocess.run(
        [*map(str, words)], cwd=cwd, env=environment, capture_output=True, text=True, encoding="utf-8",
        timeout=1500, check=check,
    )  # fmt: skip


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """The interpreter of a new environment with hatchling in it."""
    folder = tmp_path_factory.mktemp("bare") / "venv"
    run(sys.executable, "-m", "venv", folder, cwd=TOP)
    found = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if run(found, "-m", "pip", "install", "-q", "hatchling>=1.25", cwd=TOP, check=False).returncode:
        pytest.skip("no package registry in reach")
    return found


@pytest.fixture(scope="module")
def built(python, tmp_path_factory):
    """Folder with wheel and sdist."""
    folder = tmp_path_factory.mktemp("dist")
    run(python, "-m", "hatchling", "build", "-d", folder, cwd=TOP)
    return folder


@pytest.mark.slow
def test_wheel_and_sdist_hold_what_an_installation_needs(built):
    (wheel,), (sdist,) = built.glob("*.whl"), built.glob("*.tar.gz")
    names = zipfile.ZipFile(wheel).namelist()
    for needed in ("cosim/py.typed", "cosim/_ssp/full_order.ssd", "cosim/_examples/synthetic_demo.csv",
                   "cosim/report/phrases.toml", "cosim/report/page.html.j2", "fmus/registry.py", "cosim/browser/page.html",
                   "cosim/browser/page.css", "cosim/browser/page.js", "cosim/browser/de.toml"):  # fmt: skip
        assert needed in names, needed
    assert not [name for name in names if name.startswith(("tests/", ".ci", "benchmarks/"))]
    with tarfile.open(sdist) as archive:
        inner = {name.partition("/")[2] for name in archive.getnames()}
    assert {"pyproject.toml", "README.md", "LICENSE", "cosim/__init__.py", "ssp/full_order.ssd"} <= inner
    assert not [name for name in inner if name.startswith(".ci")]


@pytest.fixture(scope="module")
def cosim(python, built, tmp_path_factory):
    """The command of the wheel, installed alone: no extra is there."""
    (wheel,) = built.glob("*.whl")
    run(python, "-m", "pip", "install", "-q", wheel, cwd=tmp_path_factory.mktemp("install"))
    return python.with_name("cosim.exe" if os.name == "nt" else "cosim")


@pytest.mark.slow
def test_a_bare_environment_has_every_command_and_compares_a_log(cosim, python, tmp_path):
    assert "diagnose" in run(cosim, "--help", cwd=tmp_path).stdout
    commands = (
        "from cosim.cli import make_app; import typer; print(*typer.main.get_command(make_app()).commands)"
    )
    names = run(python, "-c", commands, cwd=tmp_path).stdout.split()
    assert {"info", "init", "compare", "diagnose", "demo", "simulate", "batch", "identify", "open"} <= set(
        names
    )
    for name in names:
        assert "Usage" in run(cosim, name, "--help", cwd=tmp_path).stdout, name
    assert run(cosim, "--show-completion", "bash", cwd=tmp_path, check=False).stderr.count("Traceback") == 0
    made = tmp_path / "log.csv"
    run(cosim, "rig", "--excitation", "steps", "--duration", "5 s", "--out", made, cwd=tmp_path)
    found = json.loads(run(cosim, "compare", made, "--json", cwd=tmp_path).stdout)
    assert found["signals"]["slew"]["error_to_noise"] < 1.5
    script = "import cosim; print(cosim.__file__); cosim.simulate('full_order', 1.0, inputs=cosim.make_log('steps', 2.0))"
    where = Path(run(python, "-c", script, cwd=tmp_path).stdout.strip())
    assert TOP not in where.parents


@pytest.mark.slow
def test_a_bare_environment_looks_at_the_host_and_a_log_and_runs_the_demo(cosim, python, tmp_path):
    host = json.loads(run(cosim, "doctor", "--json", cwd=tmp_path).stdout)
    assert (host["exit_code"], host["counts"]["missing"]) == (0, 0)
    place = "from cosim.paths import examples_folder; print(examples_folder() / 'synthetic_demo.csv')"
    example = run(python, "-c", place, cwd=tmp_path).stdout.strip()
    assert json.loads(run(cosim, "info", example, "--json", cwd=tmp_path).stdout)["samples"] == 15001
    told = run(cosim, "demo", cwd=tmp_path).stdout
    assert "Cause: dry friction (mechanical.coulomb_friction): 99.8 N m" in told
    assert (tmp_path / "build" / "demo" / "diagnosis.json").is_file(), (
        "below the folder in which it was called"
    )


@pytest.mark.slow
def test_a_bare_environment_opens_its_page(cosim, tmp_path):
    with subprocess.Popen(
        [cosim, "open", "--no-browser"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            url = process.stdout.readline().strip()
            for name in ("", "page.css", "page.js", "state"):
                with urllib.request.urlopen(url + name, timeout=30) as answer:
                    assert len(answer.read()) > 100, name
        finally:
            process.terminate()
            process.communicate(timeout=30)
    if os.name != "nt":
        assert process.returncode == 0
