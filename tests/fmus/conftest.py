"""FMUs of all blocks, built once a run."""

from pathlib import Path

import pytest
from fmpy import extract
from fmu_raw import STIMULUS

from fmus import registry
from fmus.build import build_blocks


@pytest.fixture(scope="session")
def fmu_files(made_once) -> dict[str, Path]:
    """Every block's .fmu by name."""
    folder = made_once("fmus", lambda folder: build_blocks(folder, STIMULUS))
    return {name: folder / f"{name}.fmu" for name in registry.BLOCKS}


@pytest.fixture(scope="session")
def unpacked(fmu_files: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every FMU unpacked, by name."""
    folder = tmp_path_factory.mktemp("unpacked")
    return {name: Path(extract(str(path), str(folder / name))) for name, path in fmu_files.items()}


@pytest.fixture(params=registry.BLOCKS)
def name(request: pytest.FixtureRequest) -> str:
    """Each block's name in turn."""
    return request.param
