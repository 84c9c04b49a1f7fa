"""Packages (.ssp) and FMUs of native FMUs: made from the wiring, or from a package of Python FMUs by swapping its FMUs."""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from lxml import etree

from cosim.errors import ModelError, UsageError
from cosim.files import Scratch, write_bytes
from cosim.native.build import TOOL, build_native
from cosim.ssp.archive import open_archive, read_entry
from cosim.ssp.write import (
    NAMESPACES,
    STIMULUS,
    Kept,
    Values,
    changed,
    structure_bytes,
    values_xml,
    write_archive,
    write_ssp,
)
from cosim.ssp.xml import parse
from fmus import registry
from fmus.build import checked_starts, composed_block
from fmus.compose import Composed

PYTHON_TOOL = "slew-cosim with pythonfmu"


@Kept
def native_bytes(
    stem: str,
    starts: tuple[tuple[str, float], ...],
    stimulus: bytes | None,
    fmi: str,
    platforms: tuple[str, ...],
    /,
) -> bytes:
    """The native FMU of a component, as `cosim.ssp.write.fmu_bytes` makes that of pythonfmu.

    Args:
        stem: file name without suffix: a block's name, or a component's that runs another block's FMU.
        starts: start values that differ from the declarations, SI.
        stimulus: CSV that a stimulus plays.
        fmi: version of the standard, 2.0 or 3.0.
        platforms: other platforms whose binaries it gets too (`cosim.native.build.PLATFORMS`).
    """
    resources = {"stimulus.csv": stimulus} if stimulus is not None else None
    composed = composed_block(registry.FMU_OF_COMPONENT.get(stem, stem), stem)
    with Scratch("native_") as scratch:
        file = Path(scratch, f"{stem}.fmu")
        return build_native(
            composed, file, dict(starts), resources, fmi=fmi, platforms=platforms
        ).read_bytes()


def write_native_ssp(
    ssd_path: Path,
    destination: Path,
    *,
    stimulus: bytes | None = None,
    values: Values | None = None,
    open: bool = False,
    fmi: str = "2.0",
    platforms: tuple[str, ...] = (),
) -> Path:
    """Write a package of native FMUs; arguments, result and errors are those of `cosim.ssp.write.write_ssp`.

    With `fmi` the FMUs are of another version, in a package of SSP 1.0 all the same: few of its clients take FMI 3.0.
    `platforms` are those of `cosim.native.build.write_fmu`.

    Raises:
        MissingCompilerError: there is no C compiler.
    """

    def make(stem: str, starts: tuple[tuple[str, float], ...], played: bytes | None) -> bytes:
        return native_bytes(stem, starts, played, fmi, platforms)

    return write_ssp(ssd_path, destination, stimulus=stimulus, values=values, open=open, make=make)


def swapped(source: Path, destination: Path, values: Values | None = None) -> Path:
    """Write a package (or FMU) with a native twin in place of each of our Python FMUs; all else stays.

    An extended package that `cosim diagnose` wrote is one of these: every effect is in the FMUs already, so that it is a
    matter of values.

    Args:
        source: an .ssp or .fmu file.
        destination: the file to write.
        values: what differs from the package: component -> parameter -> value, SI; not for an .fmu.

    Returns:
        `destination`.

    Raises:
        ModelError: the file is bad, or an FMU in it is not ours or has effects that are not installed here.
        UsageError: a value's component or parameter does not exist, or it is out of range.
        MissingCompilerError: there is no C compiler.
    """
    if source.suffix.lower() == ".fmu":
        destination.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(destination, twin(source.read_bytes(), source.stem, source.name, {}))
        return destination
    with open_archive(source, str(source)) as archive:
        entries = {
            name: read_entry(archive, name, str(source)) for name in archive.namelist() if name[-1:] != "/"
        }
    if "SystemStructure.ssd" not in entries:
        raise ModelError(f"{source} has no SystemStructure.ssd")
    root = parse(entries["SystemStructure.ssd"], f"{source}: SystemStructure.ssd")
    components = root.findall(".//ssd:Component", NAMESPACES)
    known = [c.get("name", "") for c in components]
    for name in values or {}:
        if name not in known:
            raise UsageError(f"{source.name} has no component '{name}'; {registry.suggestion(name, known)}")
    for component in components:
        swap_component(entries, component, source.name, (values or {}).get(component.get("name", ""), {}))
    entries["SystemStructure.ssd"] = structure_bytes(root)
    return write_archive(entries, destination)


def swap_component(
    entries: dict[str, bytes], component: etree._Element, package: str, values: Mapping[str, float]
) -> None:
    """Put the twin of a component's FMU into `entries`, and `values` into its parameter binding too."""
    name, file = component.get("name", ""), component.get("source", "")
    if file not in entries:
        raise ModelError(f"{package}: the FMU '{file}' of component '{name}' is missing")
    stem = PurePosixPath(file).stem
    entries[file] = twin(entries[file], stem, f"{package}: {file}", values)
    binding = component.find("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES)
    if not values or binding is None:
        return
    bound = binding.get("source", "")
    _, composed = block_of(description_of(entries[file]), stem, package)
    given = dict(values)
    if bound in entries:
        for node in parse(entries[bound], f"{package}: {bound}").findall(
            "ssv:Parameters/ssv:Parameter", NAMESPACES
        ):
            given.setdefault(node.get("name", ""), float(node[0].get("value", "")))
    entries[bound] = values_xml(composed.parameters, given)


def twin(fmu: bytes, stem: str, where: str, values: Mapping[str, float]) -> bytes:
    """The native twin of one of our FMUs: same variables, same start values but for `values`, same resources.

    Args:
        fmu: the archive.
        stem: name of its file without suffix, which tells a component with effects of its own.
        where: what to call it in messages.
        values: start values that differ, by parameter.
    """
    root = description_of(fmu)
    with zipfile.ZipFile(io.BytesIO(fmu)) as archive:
        played = (
            archive.read("resources/stimulus.csv") if "resources/stimulus.csv" in archive.namelist() else None
        )
    if root.get("generationTool") == TOOL and not values:
        return fmu
    if root.get("fmiVersion") != "2.0":
        raise ModelError(
            f"{where} is of FMI {root.get('fmiVersion')}: values are put into FMUs of FMI 2.0 alone"
        )
    stem, composed = block_of(root, stem, where)
    starts = described_starts(root, composed, where) | dict(values)
    return native_bytes(stem, changed(composed, checked_starts(composed, starts)), played, "2.0", ())


def block_of(root: etree._Element, stem: str, where: str) -> tuple[str, Composed]:
    """The component that one of our FMUs runs, by its description and its file's name, and its block with effects.

    Raises:
        ModelError: it is not ours.
    """
    tool, block = root.get("generationTool", ""), root.get("modelName", "")
    if tool not in (TOOL, PYTHON_TOOL) or block not in registry.BLOCKS:
        raise ModelError(
            f"{where} is no FMU of this project ('{block}' by {tool or 'an unknown tool'}): it has no native twin"
        )
    known = stem if registry.FMU_OF_COMPONENT.get(stem, stem) == block else block
    return known, composed_block(block, known)


def description_of(fmu: bytes) -> etree._Element:
    """The root of an FMU's model description."""
    with zipfile.ZipFile(io.BytesIO(fmu)) as archive:
        return parse(archive.read("modelDescription.xml"), "modelDescription.xml")


def described_starts(root: etree._Element, composed: Composed, where: str) -> dict[str, float]:
    """Start values of the parameters in a model description.

    Raises:
        ModelError: they are not the parameters that the block has here.
    """
    found = {}
    for node in root.findall("ModelVariables/ScalarVariable"):
        if node.get("causality") == "parameter":
            found[node.get("name", "")] = float(node[0].get("start", "nan"))
    if list(found) != list(composed.parameters):
        odd = sorted(set(found) ^ set(composed.parameters)) or ["their order"]
        raise ModelError(
            f"{where} was made with other effects than those installed here ({', '.join(odd)}): "
            "install the package that provides them, or build the model again"
        )
    return found


def values_of(package: Path) -> dict[str, dict[str, float]]:
    """What the FMUs of a package of ours start with beyond the declarations: component -> parameter -> value, SI.

    ``container(wiring, "crane", values_of(extended))`` is the chain of an extended package in one FMU.

    Raises:
        ModelError: the package is bad, or an FMU in it is not ours or has effects that are not installed here.
    """
    found = {}
    with open_archive(package, str(package)) as archive:
        root = parse(
            read_entry(archive, "SystemStructure.ssd", str(package)), f"{package}: SystemStructure.ssd"
        )
        for component in root.findall(".//ssd:Component", NAMESPACES):
            name, file = component.get("name", ""), component.get("source", "")
            if name == STIMULUS:
                continue
            stem, where = PurePosixPath(file).stem, f"{package.name}: {file}"
            description = description_of(read_entry(archive, file, str(package)))
            _, composed = block_of(description, stem, where)
            found[name] = dict(changed(composed, described_starts(description, composed, where)))
    return {name: values for name, values in found.items() if values}
