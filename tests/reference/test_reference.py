"""Each FMU gives its committed reference result (see make.py)."""

import csv
from pathlib import Path

import numpy as np
import pytest
from make import FOLDER, STIMULUS, simulate

from fmus import registry
from fmus.build import build_blocks


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {p.stem: p for p in build_blocks(tmp_path_factory.mktemp("reference"), STIMULUS)}


def read(path: Path) -> np.ndarray:
    with path.open(encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    return np.array([tuple(map(float, row)) for row in rows], dtype=[(n, float) for n in header])


@pytest.mark.parametrize("name", registry.BLOCKS)
def test_reference_result(built, name) -> None:
    options = dict(line.split(",") for line in (FOLDER / f"{name}_ref.opt").read_text().splitlines())
    table = FOLDER / f"{name}_in.csv"
    result = simulate(
        built[name],
        read(table) if table.exists() else None,
        float(options["StopTime"]),
        float(options["StepSize"]),
    )
    expected = read(FOLDER / f"{name}_ref.csv")
    assert result.dtype.names == expected.dtype.names
    assert set(expected.dtype.names[1:]) == set(registry.block(name).outputs)
    for column in expected.dtype.names:
        size = np.abs(expected[column]).max()
        # exp, sin and cos differ between C libraries in the last bit (1e-16), which 500 steps may add up; far below any
        # change of the equations that matters
        assert np.abs(result[column] - expected[column]).max() <= float(options["RelTol"]) * size, column


@pytest.mark.parametrize("name", registry.BLOCKS)
def test_reference_is_small_and_lively(name) -> None:
    expected = read(FOLDER / f"{name}_ref.csv")
    assert len(expected) <= 501
    assert (FOLDER / f"{name}_in.csv").exists() == (name != "stimulus")
    # of the extended observer the sensor error moves with readings of a tracker only, off by default
    still = {"time", "p_supply", "automatic", "sensor_error"}
    for column in set(expected.dtype.names) - still:
        moving = np.count_nonzero(np.diff(expected[column]))
        assert moving >= (3 if name == "stimulus" else 50), f"{column} hardly moves"
