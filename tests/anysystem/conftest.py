"""The system of two strangers' FMUs, built once."""

from functools import partial
from pathlib import Path

import pytest
import systems

from benchmarks.systems import parts


def packed(build, folder: Path) -> None:
    """Write the package with FMUs that `build` makes of a kind."""
    fmus = {name: build(kind, folder) for name, kind in systems.KINDS.items()}
    parts.write_ssp(folder / "drive.ssp", fmus, systems.WIRES, systems.VALUES)


@pytest.fixture(scope="session")
def native(made_once) -> Path:
    """The package with native FMUs."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    return made_once("foreign_native", partial(packed, parts.native)) / "drive.ssp"


def compiled(folder: Path) -> None:
    """Every kind of part."""
    for kind in parts.KINDS:
        parts.native(kind, folder)


@pytest.fixture(scope="session")
def fmus(made_once) -> dict[str, Path]:
    """Every kind of part as a native FMU."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    folder = made_once("native_parts", compiled)
    return {kind: folder / f"part_{kind}.fmu" for kind in parts.KINDS}


@pytest.fixture(scope="session")
def plain(made_once) -> Path:
    """The package with FMUs as plain pythonfmu makes them."""
    return made_once("foreign_plain", partial(packed, parts.python)) / "drive.ssp"
