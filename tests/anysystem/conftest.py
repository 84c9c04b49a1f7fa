"""The system of two strangers' FMUs, built once."""

from pathlib import Path

import pytest
import systems

from benchmarks.systems import parts


@pytest.fixture(scope="session")
def native(tmp_path_factory) -> Path:
    """The package with native FMUs."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("native")
    fmus = {name: parts.native(kind, folder) for name, kind in systems.KINDS.items()}
    return parts.write_ssp(folder / "drive.ssp", fmus, systems.WIRES, systems.VALUES)


@pytest.fixture(scope="session")
def plain(tmp_path_factory) -> Path:
    """The package with FMUs as plain pythonfmu makes them."""
    folder = tmp_path_factory.mktemp("plain")
    fmus = {name: parts.python(kind, folder) for name, kind in systems.KINDS.items()}
    return parts.write_ssp(folder / "drive.ssp", fmus, systems.WIRES, systems.VALUES)
