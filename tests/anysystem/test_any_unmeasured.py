"""Inputs that nobody measured stay at their start values or at those of the mapping, or are estimated; it is said."""

import json
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts

MAPPING = """
[time]
column = "time"
unit = "s"
[signals."sum.u"]
column = "u"
unit = "1"
[signals."sum.y"]
column = "y"
unit = "1"
[diagnose]
"""


def written(folder: Path, other: float, gain: float = 1.0) -> tuple[Path, Path]:
    """A native FMU y' = (u + v2 - y), and a log without v2, which was constant; the FMU hears `gain` u."""
    fmu = parts.native("sum", folder)
    rng = np.random.default_rng(3)
    u = systems.command(rng)
    x = np.zeros(u.size)
    for k in range(1, u.size):
        x[k] = x[k - 1] + (1.0 - np.exp(-systems.H)) * (gain * 0.5 * (u[k] + u[k - 1]) + other - x[k - 1])
    y = x + 0.003 * rng.standard_normal(u.size)
    rows = [
        f"{k * systems.H!r},{a!r},{b!r}" for k, (a, b) in enumerate(zip(u.tolist(), y.tolist(), strict=True))
    ]
    log = folder / "log.csv"
    log.write_text("\n".join(["time,u,y", *rows]) + "\n")
    return fmu, log


def diagnosed(command, folder: Path, fmu: Path, log: Path, more: str) -> dict:
    mapping = folder / "m.toml"
    mapping.write_text(MAPPING + more)
    code, out, err = command(
        "diagnose", log, "--model", fmu, "--mapping", mapping, "--out", folder / "o", "--json"
    )
    assert code == 0, err
    return json.loads(out)


@pytest.mark.parametrize(
    ("other", "more"),
    [(0.0, ""), (0.8, 'constant = { "part_sum.v2" = 0.8 }'), (0.8, 'free = ["part_sum.v2"]')],
    ids=["start", "constant", "free"],
)
def test_an_input_that_was_not_measured_keeps_no_cause_from_being_named(
    command, tmp_path: Path, other: float, more: str
) -> None:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    fmu, log = written(tmp_path, other, gain=1.25)
    found = diagnosed(command, tmp_path, fmu, log, more)
    (cause,) = found["causes"]
    assert cause["effect"] == "port.gain"
    # without the constant, or with a free one, a gain of the output does the same
    where = f"port.gain at part_sum.{cause['connector']} ({cause['where']})"
    assert "port.gain at part_sum.u (input)" in {where, *cause["indistinguishable_from"]}
    assert cause["parameters"]["gain"]["value"] == pytest.approx(1.25, rel=0.02)
    said = [w for w in found["warnings"] if "part_sum.v2 (0)" in w and w.startswith("assumed: ")]
    assert len(said) == (0 if more else 1)


def test_the_mapping_gives_an_fmu_by_itself_the_values_of_the_machine(command, tmp_path: Path) -> None:
    """The gain of the FMU's description is 1, the machine's 1.25: known, it is no fault, and trusted from there on."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    fmu, log = written(tmp_path, 0.0, gain=1.25)
    known = 'constant = { "part_sum.K" = 1.25 }\ntrusted = ["part_sum.K"]'
    found = diagnosed(command, tmp_path, fmu, log, known)
    assert (found["verdict"], found["causes"]) == ("adequate", [])
    # trusted at another value it is off from that one
    found = diagnosed(command, tmp_path, fmu, log, known.replace("1.25", "0.9"))
    (cause,) = found["causes"]
    assert "parameter part_sum.K" in {
        f"parameter {cause['component']}.{cause['parameter']}",
        *cause["indistinguishable_from"],
    }


def test_a_constant_that_is_no_open_input_is_told(command, tmp_path: Path) -> None:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    fmu, log = written(tmp_path, 0.0)
    mapping = tmp_path / "m.toml"
    mapping.write_text(MAPPING + 'constant = { "sum.u" = 1.0, "sum.y" = 1.0, "sum.w" = 2.0 }')
    code, _, err = command("diagnose", log, "--model", fmu, "--mapping", mapping, "--out", tmp_path / "o")
    said = " ".join(err.split())
    assert code == 3
    for text in ("'sum.u': it is measured", "'sum.y': it is no input", "no connector 'sum.w'"):
        assert text in said


def test_a_comparison_and_a_run_take_what_a_diagnosis_takes(command, tmp_path: Path) -> None:
    """They said that nothing could be simulated without the input, and knew nothing of `constant`."""
    fmu, log = written(tmp_path, 0.8)
    mapping = tmp_path / "m.toml"
    errors = []
    for more in ("", 'constant = { "part_sum.v2" = 0.8 }'):
        mapping.write_text(MAPPING.replace('"sum.', '"part_sum.') + more)
        code, out, err = command("compare", log, "--model", fmu, "--mapping", mapping, "--json")
        assert code == 0, err
        found = json.loads(out)
        assert not found["not_judged"]
        assert any("assumed: inputs that were not measured" in n for n in found["notes"]) == (not more)
        errors.append(found["signals"]["part_sum.y"]["rmse"])
    assert errors[0] > 0.5
    assert errors[1] < 0.005  # the noise of the reading
    to = tmp_path / "run.csv"
    given = ("--input", log, "--mapping", mapping, "--step-size", f"{systems.H} s")
    code, _, err = command("simulate", fmu, *given, "--out", to)
    assert code == 0, err
    header, *rows = to.read_text().splitlines()
    place = next(k for k, name in enumerate(header.split(",")) if name.startswith("part_sum.y"))
    ran = np.array([float(row.split(",")[place]) for row in rows])
    measured = np.loadtxt(log, delimiter=",", skiprows=1)[: ran.size, 2]
    assert np.sqrt(np.mean((ran - measured) ** 2)) < 0.005
