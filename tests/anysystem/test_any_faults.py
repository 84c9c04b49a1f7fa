"""FMUs that misbehave: what fails in a candidate's run costs that candidate, what differs from run to run is said."""

import json
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts

COUNT = 600


def changed(folder: Path, name: str, old: str, new: str) -> Path:
    """A native lag, y' = u - y, with another line in its C source."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    plain = parts.native("lag", folder)
    text = (parts.HERE / "part.c").read_text()
    assert text.count(old) == 1
    source, library = folder / f"{name}.c", folder / f"{name}.so"
    source.write_text("#include <stdio.h>\n" + text.replace(old, new))
    words = [parts.COMPILER, "-shared", "-fPIC", "-O2", "-DKIND=LAG", "-o", library, source, "-lm"]
    subprocess.run(list(map(str, words)), check=True)
    with zipfile.ZipFile(plain) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    target = folder / f"{name}.fmu"
    with zipfile.ZipFile(target, "w") as archive:
        for entry, content in entries.items():
            archive.writestr(entry, library.read_bytes() if entry.startswith("binaries") else content)
    return target


def log(path: Path, gain: float) -> tuple[Path, float]:
    """A log of the lag that hears `gain` u, and the largest u."""
    rng = np.random.default_rng(3)
    u = systems.command(rng, COUNT)
    y = np.zeros(COUNT)
    for k in range(1, COUNT):
        y[k] = y[k - 1] + (1.0 - np.exp(-systems.H)) * (gain * 0.5 * (u[k] + u[k - 1]) - y[k - 1])
    table = np.column_stack([systems.H * np.arange(COUNT), u, y + 0.003 * rng.standard_normal(COUNT)])
    np.savetxt(path, table, "%.12g", delimiter=",", header="time [s],u [1],y [1]", comments="")
    return path, float(np.abs(u).max())


def diagnosed(command, fmu: Path, path: Path, out: Path) -> dict:
    code, told, err = command("diagnose", path, "--model", fmu, "--out", out, "--json")
    assert code == 0, err
    return json.loads(told)


@pytest.mark.parametrize("way", ["status", "crash"])
def test_an_fmu_that_fails_in_a_candidates_run_costs_that_candidate(
    command, tmp_path: Path, way: str
) -> None:
    path, largest = log(tmp_path / "log.csv", 0.8)
    fails = "return 3" if way == "status" else "abort()"
    line = f"double h = step / 4; if (p->r[U] > {1.02 * largest!r} || p->r[U] < {-1.02 * largest!r}) {fails};"
    fmu = changed(tmp_path, f"touchy_{way}", "double h = step / 4;", line)
    found = diagnosed(command, fmu, path, tmp_path / "out")
    (cause,) = found["causes"]
    assert "port.gain" in cause["effect"]
    assert cause["parameters"]["gain"]["value"] == pytest.approx(0.8, rel=0.02)
    refused = [w for w in found["warnings"] if "a candidate was refused" in w]
    assert refused
    assert any(f"component 'touchy_{way}'" in w for w in refused)


def test_a_system_that_differs_from_run_to_run_is_measured_and_said(command, tmp_path: Path) -> None:
    path, _ = log(tmp_path / "log.csv", 1.0)
    noisy = "v[i] = r[i] == Y ? ((Part *)c)->x[0] + 0.02 * (rand() / (double)RAND_MAX - 0.5)"
    fmu = changed(tmp_path, "dice", "v[i] = r[i] == Y ? ((Part *)c)->x[0]", noisy)
    found = diagnosed(command, fmu, path, tmp_path / "out")
    (said,) = [w for w in found["warnings"] if "not deterministic" in w]
    # RMS of the difference of two numbers, each even over 0.02
    size = float(said.partition("differ by ")[2].split()[0])
    assert size == pytest.approx(0.02 / np.sqrt(6.0), rel=0.2)
    assert found["causes"] == []


def test_an_fmu_that_needs_its_tool_is_told_and_run_all_the_same(command, tmp_path: Path) -> None:
    path, _ = log(tmp_path / "log.csv", 1.0)
    fmu = changed(tmp_path, "tool", "double h = step / 4;", "double h = step / 4.0;")
    with zipfile.ZipFile(fmu) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    with zipfile.ZipFile(fmu, "w") as archive:
        for name, content in entries.items():
            archive.writestr(
                name, content.replace(b"<CoSimulation ", b'<CoSimulation needsExecutionTool="true" ')
            )
    found = diagnosed(command, fmu, path, tmp_path / "out")
    assert found["verdict"] == "adequate"
    assert any("needsExecutionTool" in w for w in found["warnings"])
