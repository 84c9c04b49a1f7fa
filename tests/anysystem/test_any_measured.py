"""FMUs with rough numbers beside logs of real hydraulic machines: what the machine has instead, borne out by another log."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.systems import parts

pytestmark = [
    pytest.mark.slow,
    pytest.mark.data,
    pytest.mark.skipif("COSIM_DATA" not in os.environ, reason="no measured data: COSIM_DATA"),
]
DATA = Path(os.environ.get("COSIM_DATA", "."))
SWING = """
model = "axis.fmu"
[time]
column = "Time"
unit = "s"
[signals.u]
column = "Swing Cmd"
unit = "1"
held = true
[signals.y]
column = "Swing Ms"
unit = "rad"
[compare.start]
"axis.start" = "y"
[diagnose]
trusted = ["axis.dz_up", "axis.dz_down", "axis.k_up", "axis.k_down", "axis.lag"]
[diagnose.constant]
"axis.neutral" = 7.4695
"axis.dz_up" = 0.05
"axis.dz_down" = 0.05
"axis.k_up" = 0.4
"axis.k_down" = 0.4
"axis.end" = 100.0
"""
BOOM = """
model = "axis.fmu"
[file]
encoding = "cp949"
[time]
column = "time"
unit = "s"
[signals.u]
column = "Model Root/ERRP pressure(22.03.23)/Boom_Up_eppr_P"
unit = "1"
held = true
[signals.y]
column = "Joint_Angles(22.03.28)/Boom_ang"
unit = "1"
[compare.start]
"axis.start" = "y"
[diagnose]
trusted = ["axis.dz_up", "axis.k_up", "axis.lag", "axis.end"]
[diagnose.constant]
"axis.dz_up" = 6.0
"axis.end" = 40.0
"axis.lag" = 0.2
"""


def diagnosed(axis: Path, folder: Path, mapping: str, logs: list[Path], held_out: Path) -> dict:
    """The answer, as a user gets it."""
    (folder / "axis.fmu").write_bytes(axis.read_bytes())
    (folder / "mapping.toml").write_text(mapping)
    command = ["diagnose", *map(str, logs), "--held-out", str(held_out), "--mapping", "mapping.toml"]
    run = subprocess.run(
        [sys.executable, "-m", "cosim", *command, "--out", "out"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode in (0, 1), run.stderr
    return json.loads((folder / "out" / "diagnosis.json").read_text())


@pytest.fixture(scope="module")
def axis(made_once) -> Path:
    """The FMU of ``axis.c``."""
    from test_any_axis import build

    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    return made_once("cylinder_axis", build) / "axis.fmu"


def by_name(answer: dict) -> dict[str, dict]:
    return {c["parameter"] or c["effect"]: c["parameters"] for c in answer["causes"]}


def test_the_swing_of_the_small_excavator_moves_later_and_within_limits(axis: Path, tmp_path: Path) -> None:
    """The servo ends at the same duties in each log: commands beyond move it no faster."""
    logs = DATA / "mini_excavator"
    answer = diagnosed(
        axis, tmp_path, SWING, [logs / "manual_1101_2326.csv"], logs / "manual_mitch_1101_2333.csv"
    )
    found = by_name(answer)
    assert {"dz_up", "port.saturation"} <= found.keys()
    assert found["dz_up"]["dz_up"]["value"] == pytest.approx(0.6, abs=0.15)
    assert found["port.saturation"]["high"]["value"] == pytest.approx(9.2, abs=0.2)
    (gain,) = answer["gain"].values()  # of the model's own run, which drifts
    assert gain["rmse_after"] < 0.6 * gain["rmse_before"]


def test_the_boom_of_the_excavator_needs_more_pilot_pressure_and_ends_later(
    axis: Path, tmp_path: Path
) -> None:
    """The model lacks the linkage and the pump; by noise that was learned of them no number is sure."""
    logs = [DATA / "excavator" / f"boom-up-{n}-H-single.csv" for n in (50, 90, 70)]
    answer = diagnosed(axis, tmp_path, BOOM, logs[:2], logs[2])
    found = by_name(answer)
    assert found["dz_up"]["dz_up"]["value"] == pytest.approx(13.3, abs=1.0)
    assert found["end"]["end"]["ci95"][0] > 40.0
    (gain,) = answer["gain"].values()
    assert gain["rmse_after"] < 0.5 * gain["rmse_before"]
    assert gain["ci95_of_ratio"][1] < 1.0
