"""Native FMUs of all blocks and chains, built once a session without speed but with every warning an error."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

# instances, benches and client schemes are those of the Python FMUs
sys.path.append(str(Path(__file__).resolve().parents[1] / "fmus"))
sys.path.append(str(Path(__file__).resolve().parents[1] / "clients"))

from fmpy import extract
from fmu_raw import STIMULUS

from cosim.native import build as native_build
from cosim.native.build import MissingCompilerError, build_native, compiler, write_fmu
from cosim.native.container import container
from cosim.native.package import native_bytes
from cosim.paths import ssp_folder
from fmus import registry
from fmus.build import composed_block

QUICK = "-O1 -Wall -Wextra -pedantic -Werror -Wno-strict-prototypes"


@pytest.fixture(scope="session", autouse=True)
def quick() -> Iterator[None]:
    """Skip everything where there is no C compiler; compile without speed, so that each source is compiled once."""
    try:
        compiler()
    except MissingCompilerError as error:
        pytest.skip(str(error))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native_build, "OPTIMISED", QUICK)
        native_bytes.cache_clear()  # what other tests of this process have compiled for speed
        yield


@pytest.fixture(scope="session")
def fmu_files(made_once) -> dict[str, Path]:
    """Every block's native .fmu by name."""
    played = {"stimulus": {"stimulus.csv": STIMULUS}}

    def make(folder: Path) -> None:
        for name in registry.BLOCKS:
            build_native(composed_block(name), folder / f"{name}.fmu", resources=played.get(name))

    folder = made_once("native", make)
    return {name: folder / f"{name}.fmu" for name in registry.BLOCKS}


@pytest.fixture(scope="session")
def chains(made_once) -> dict[str, Path]:
    """Every system's chain as one .fmu, by the system's name."""
    names = ("full_order", "physical", "simplified")

    def make(folder: Path) -> None:
        for name in names:
            model = container(ssp_folder() / f"{name}.ssd")
            (folder / name).mkdir()
            write_fmu(model, folder / name / f"{model.name}.fmu")

    folder = made_once("chains", make)
    return {name: next((folder / name).iterdir()) for name in names}


@pytest.fixture(scope="session")
def unpacked(fmu_files: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every block's FMU unpacked, by name."""
    folder = tmp_path_factory.mktemp("unpacked")
    return {name: Path(extract(str(path), str(folder / name))) for name, path in fmu_files.items()}


@pytest.fixture(params=registry.BLOCKS)
def name(request: pytest.FixtureRequest) -> str:
    """Each block's name in turn."""
    return request.param
