"""Finds the package to compare with, and builds it where that is ours to do."""

from pathlib import Path

from cosim.errors import ModelError, UsageError
from cosim.paths import build_folder
from cosim.ssp.build import SYSTEMS, built_package
from cosim.ssp.write import STIMULUS, read_xml, write_as_wired, write_ssp

NAMESPACE = {"ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription"}


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
        return built_package(model, open_package=True)
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


def build_wiring(wiring: Path, folder: Path | None = None) -> Path:
    """Build the package of an .ssd whose components are our blocks; a stimulus in it is left out.

    Args:
        wiring: the .ssd.
        folder: of the package; by default ``ssp`` in the build folder.

    Returns:
        ``<name>_open.ssp`` in the folder, or ``<name>.ssp`` where the system has inputs of its own.

    Raises:
        ModelError: the wiring or an .ssv file is bad.
    """
    document = read_xml(wiring)
    folder = folder or build_folder() / "ssp"
    components = document.findall(".//ssd:Component", NAMESPACE)
    if any(component.get("name") == STIMULUS for component in components):
        return write_ssp(wiring, folder / f"{wiring.stem}_open.ssp", open=True)
    return write_as_wired(wiring, folder / f"{wiring.stem}.ssp")
