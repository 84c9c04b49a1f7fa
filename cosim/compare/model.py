"""Finds the package to compare with, and builds it where that is ours to do."""

from pathlib import Path

from cosim.errors import ModelError, UsageError
from cosim.paths import build_folder, ssp_folder
from cosim.ssp.build import SYSTEMS
from cosim.ssp.write import (
    STIMULUS,
    add_component,
    fmu_bytes,
    read_xml,
    structure_bytes,
    write_archive,
    write_ssp,
)

NAMES = {"ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription"}


def open_model(model: str, folder: Path | None = None) -> Path:
    """The file to simulate: an .ssp or .fmu as it is; one of our systems, or an .ssd of our blocks, built if need be.

    Args:
        model: name of one of our systems, or a file.
        folder: relative files are looked for here too (that of the mapping file which names the model).

    Raises:
        UsageError: there is no such model.
        ModelError: an .ssd cannot be built.
    """
    if model in SYSTEMS:
        built = build_folder() / "ssp" / f"{model}_open.ssp"
        if not built.is_file():
            write_ssp(ssp_folder() / f"{model}.ssd", built, open=True)
        return built
    path = Path(model)
    if not path.is_file() and folder is not None and (folder / path).is_file():
        path = folder / path
    suffix = path.suffix.lower()
    if suffix not in (".ssp", ".fmu", ".ssd"):
        hint = "; an .ssv goes with --parameter-set" if suffix == ".ssv" else ""
        raise UsageError(
            f"'{model}' is no model: give an .ssp, .fmu or .ssd file, or one of {', '.join(SYSTEMS)}{hint}"
        )
    if not path.is_file():
        raise ModelError(f"there is no model '{path}'")
    return build_wiring(path) if suffix == ".ssd" else path


def build_wiring(wiring: Path) -> Path:
    """Build the package of an .ssd whose components are our blocks; a stimulus in it is left out.

    Returns:
        ``<build folder>/ssp/<name>_open.ssp``, or ``<name>.ssp`` where the system has inputs of its own.

    Raises:
        ModelError: the wiring or an .ssv file is bad.
    """
    document = read_xml(wiring)
    components = document.findall(".//ssd:Component", NAMES)
    if any(component.get("name") == STIMULUS for component in components):
        return write_ssp(wiring, build_folder() / "ssp" / f"{wiring.stem}_open.ssp", open=True)
    return package_of(wiring, build_folder() / "ssp" / f"{wiring.stem}.ssp")


def package_of(wiring: Path, destination: Path) -> Path:
    """Write the package of an .ssd of our blocks that has inputs of its own; returns `destination`.

    Raises:
        ModelError: the wiring or an .ssv file is bad.
    """
    document = read_xml(wiring)
    entries: dict[str, bytes] = {}
    for component in document.findall(".//ssd:Component", NAMES):
        add_component(entries, component, wiring, {}, None, fmu_bytes)
    entries["SystemStructure.ssd"] = structure_bytes(document)
    return write_archive(entries, destination)
