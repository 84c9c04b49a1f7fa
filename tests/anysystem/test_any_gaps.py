"""Pauses and missing values of a log are no evidence: nothing is judged where nothing was read."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.systems import parts
from cosim.anysystem.model import Segment
from cosim.compare.metrics import noise_floor

H, N = 0.01, 3000
NOISE = 0.004
PAUSES = ((6.0, 8.4), (13.0, 14.2), (20.0, 25.0))


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    return parts.native("lag", tmp_path_factory.mktemp("lag"))


def table(gain: float = 1.0) -> np.ndarray:
    """Time, command and reading of a lag: steps of 2.4 s, so that straight lines through a pause are far off."""
    rng = np.random.default_rng(4)
    u = np.repeat(rng.uniform(-1.0, 1.0, N // 60), 60)
    u[:60] = 0.0
    for start, stop in PAUSES:  # the command stands meanwhile, as what was read before and after says
        inside = (np.arange(N) * H >= start - 0.4) & (np.arange(N) * H < stop + 0.1)
        u[inside] = -np.sign(u[round((start - 0.5) / H)])
    y = np.zeros(N)
    for k in range(1, N):
        y[k] = y[k - 1] + (1.0 - np.exp(-H)) * (0.5 * gain * (u[k] + u[k - 1]) - y[k - 1])
    return np.column_stack([H * np.arange(N), u, y + NOISE * rng.standard_normal(N)])


def written(file: Path, rows: np.ndarray) -> Path:
    lines = [",".join("" if np.isnan(v) else f"{v:.9g}" for v in row) for row in rows]
    file.write_text("\n".join(["time [s],part_lag.u [1],part_lag.y [1]", *lines]) + "\n", encoding="utf-8")
    return file


def damaged(rows: np.ndarray, way: str) -> np.ndarray:
    """Without the rows of the pauses, or without their readings."""
    inside = np.any([(rows[:, 0] > a) & (rows[:, 0] < b) for a, b in PAUSES], axis=0)
    if way == "pauses":
        return rows[~inside]
    rows = rows.copy()
    rows[inside, 2] = np.nan
    return rows


@pytest.mark.parametrize("way", ["pauses", "missing values"])
@pytest.mark.parametrize("gain", [1.0, 1.2], ids=["sound", "gain"])
def test_nothing_is_judged_where_nothing_was_read(
    command, fmu: Path, tmp_path: Path, way: str, gain: float
) -> None:
    """Straight lines through the pauses were a fault of the model, and the noise that of the lines."""
    path, out = written(tmp_path / "log.csv", damaged(table(gain), way)), tmp_path / "o"
    code, told, err = command("diagnose", path, "--model", fmu, "--out", out, "--json")
    assert code == 0, err
    found = json.loads(told)
    shown = found["signals"]["part_lag.y"]
    if gain == 1.0:
        assert (found["verdict"], found["causes"]) == ("adequate", [])
        assert shown["rmse"] == pytest.approx(NOISE, rel=0.1)
    else:
        (cause,) = found["causes"]
        assert cause["parameters"]["gain"]["value"] == pytest.approx(1.2, rel=0.01)
        assert found["gain"]["part_lag.y"]["rmse_after"] == pytest.approx(NOISE, rel=0.15)
    assert shown["noise_floor"] == pytest.approx(NOISE, rel=0.15)
    assert any("pauses (3)" in w and "not judged there" in w for w in found["warnings"]) == (way == "pauses")


@pytest.mark.parametrize("way", ["pauses", "missing values"])
def test_a_comparison_leaves_them_out_too(command, fmu: Path, tmp_path: Path, way: str) -> None:
    path = written(tmp_path / "log.csv", damaged(table(), way))
    code, told, err = command("compare", path, "--model", fmu, "--json")
    assert code == 0, err
    assert json.loads(told)["signals"]["part_lag.y"]["rmse"] == pytest.approx(NOISE, rel=0.35)


def test_the_noise_of_a_reading_is_that_of_what_was_read_as_a_comparison_tells_it() -> None:
    """Straight lines between uneven stamps took off a third of it, and a diagnosis told another noise than a comparison."""
    rng = np.random.default_rng(1)
    stamps = np.arange(N) + rng.uniform(0.0, 0.6, N)
    read = np.sin(0.01 * stamps) + NOISE * rng.standard_normal(N)
    grid = np.interp(np.arange(N, dtype=np.float64), stamps, read)
    segment = Segment(
        0.0, H, {"y": grid}, np.ones(N, bool), np.zeros(N, np.int64), recorded={"y": read}, stamps=stamps
    )
    assert segment.noise("y") == pytest.approx(noise_floor(read, H), rel=0.02)
    assert segment.noise("y") == pytest.approx(NOISE, rel=0.15)
    assert noise_floor(grid, H) < 0.85 * NOISE
