"""Every package that we write says of each component that it is an FMU, which OMSimulatorPython does not assume."""

import shutil
import zipfile
from pathlib import Path

import pytest
from lxml import etree

from cosim.anysystem.extend import write_package
from cosim.native.package import swapped
from cosim.paths import examples_folder
from cosim.ssp.read import read_system
from cosim.ssp.write import NAMESPACES, write_archive, write_as_wired
from fmus.build import build_fmu

SWING = examples_folder() / "models" / "swing.ssd"  # a machine of five components


def types(package: Path) -> set[str | None]:
    """The types of a package's components."""
    with zipfile.ZipFile(package) as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))
    return {c.get("type") for c in root.findall(".//ssd:Component", NAMESPACES)}


@pytest.fixture(scope="module")
def without(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package whose components have no type, as older ones and those of others."""
    folder = tmp_path_factory.mktemp("types")
    with zipfile.ZipFile(write_as_wired(SWING, folder / "swing.ssp")) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    entries["SystemStructure.ssd"] = entries["SystemStructure.ssd"].replace(
        b' type="application/x-fmu-sharedlibrary"', b""
    )
    return write_archive(entries, folder / "without.ssp")


def test_packages_of_machines_and_extended_ones_have_types(without: Path, tmp_path: Path) -> None:
    known = {"application/x-fmu-sharedlibrary"}
    assert types(without) == {None}
    assert types(write_as_wired(SWING, tmp_path / "machine.ssp")) == known
    assert types(write_as_wired(SWING, tmp_path / "extended.ssp", {"dcv": {"K": 3e-3}})) == known
    with read_system(without) as system:
        assert len(system.components) == 5
        assert types(write_package(system, [], {"dcv.K": 3e-3}, tmp_path / "any.ssp", build_fmu)) == known


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_swapped_packages_have_types(without: Path, tmp_path: Path) -> None:
    assert types(swapped(without, tmp_path / "native.ssp")) == {"application/x-fmu-sharedlibrary"}
