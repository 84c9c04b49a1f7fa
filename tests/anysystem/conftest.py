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


@pytest.fixture(scope="session")
def plain(made_once) -> Path:
    """The package with FMUs as plain pythonfmu makes them."""
    return made_once("foreign_plain", partial(packed, parts.python)) / "drive.ssp"
