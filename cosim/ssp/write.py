"""Write an SSP package: wiring (.ssd), parameter values (.ssv) and FMUs in one archive, the same byte for byte each time.

The FMUs' own start values equal the .ssv, because some clients (fmpy's simulate_ssp) ignore parameter bindings. So a
component whose values differ from its block's declarations has an FMU file of its own inside the package.
"""

import io
import zipfile
from collections.abc import Callable, Mapping
from functools import lru_cache, update_wrapper
from pathlib import Path, PurePosixPath

from lxml import etree

from cosim.errors import ModelError, UsageError
from cosim.files import Scratch, write_bytes
from cosim.ssp.read import FMU_TYPES
from cosim.ssp.stimulus import stop_time
from cosim.ssp.xml import safe_parser
from cosim.units import base_exponents
from fmus import registry
from fmus.build import ARCHIVE_DATE, build_fmu, checked_starts, composed_block
from fmus.compose import Composed
from fmus.contract import Variable
from fmus.describe import number

SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
NAMESPACES = {"ssd": SSD, "ssc": SSC, "ssv": SSV, "oms": OMS, "osp": OSP}
PARAMETER_SET = "nominal"  # the same name everywhere: ecos applies the bindings of one name
STIMULUS = "stimulus"
# system-level outputs of an open package: the signals of a log, and where they come from
OUTPUTS = {
    "slew": "sensor",
    "spool": "dcv",
    "p_a": "continuity",
    "p_b": "continuity",
    "p_supply": "continuity",
    "slew_estimate": "observer",
    "slew_rate_estimate": "observer",
}
Values = Mapping[str, Mapping[str, float]]
# makes the FMU of a component, as `fmu_bytes` does
FmuMaker = Callable[[str, tuple[tuple[str, float], ...], bytes | None], bytes]


def write_ssp(
    ssd_path: Path,
    destination: Path,
    *,
    stimulus: bytes | None = None,
    values: Values | None = None,
    open: bool = False,
    make: FmuMaker | None = None,
) -> Path:
    """Write a package from a wiring file and the .ssv files it binds.

    Args:
        ssd_path: the wiring of the closed system; the sources of its parameter bindings are relative to it.
        destination: the .ssp file to write.
        stimulus: CSV that the stimulus plays (`cosim.ssp.stimulus.stimulus_csv`); the experiment ends with it.
        values: what differs from the .ssv files: component -> parameter -> value in the parameter's SI unit. Parameters
            of effects are among them.
        open: leave the stimulus out; the system then has an input ``u`` and the signals of a log as outputs.
        make: makes the FMUs; by default `fmu_bytes`, which makes those of pythonfmu.

    Returns:
        `destination`.

    Raises:
        UsageError: a component or parameter of `values` does not exist, or a value is out of range.
        ModelError: the wiring or an .ssv file is bad, or a closed package has no stimulus.
        DataError: the stimulus is bad.
    """
    document = read_xml(ssd_path)
    if open:
        open_system(document, ssd_path)
    else:
        if stimulus is None:
            raise ModelError(
                f"{destination.name}: a closed package needs a stimulus, or write it with open=True"
            )
        set_stop_time(document, stop_time(stimulus))
    return _packed(document, ssd_path, destination, values, stimulus, make or fmu_bytes)


def write_as_wired(ssd_path: Path, destination: Path, values: Values | None = None) -> Path:
    """Write the package of a wiring that needs neither a stimulus nor connectors beside its own.

    Args:
        ssd_path: the wiring; the sources of its parameter bindings are relative to it.
        destination: the .ssp file to write.
        values: as `write_ssp` takes them.

    Returns:
        `destination`.

    Raises:
        UsageError, ModelError: as `write_ssp`.
    """
    return _packed(read_xml(ssd_path), ssd_path, destination, values, None, fmu_bytes)


def _packed(
    document: etree._Element,
    ssd_path: Path,
    destination: Path,
    values: Values | None,
    stimulus: bytes | None,
    make: FmuMaker,
) -> Path:
    components = document.findall(".//ssd:Component", NAMESPACES)
    wanted = {name: dict(parameters) for name, parameters in (values or {}).items()}
    known = [component.get("name", "") for component in components]
    for name in wanted:
        if name not in known:
            raise UsageError(f"{ssd_path.name} has no component '{name}'; {registry.suggestion(name, known)}")
    entries: dict[str, bytes] = {}
    for component in components:
        add_component(entries, component, ssd_path, wanted.get(component.get("name", ""), {}), stimulus, make)
    entries["SystemStructure.ssd"] = structure_bytes(document)
    return write_archive(entries, destination)


def add_component(
    entries: dict[str, bytes],
    component: etree._Element,
    ssd_path: Path,
    values: Mapping[str, float],
    stimulus: bytes | None,
    make: FmuMaker,
) -> None:
    """Put a component's FMU and .ssv into `entries`, and bind that .ssv in the component's element."""
    name, source = component.get("name", ""), component.get("source", "")
    stem = PurePosixPath(source).stem
    binding = component.find("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES)
    if binding is None or not binding.get("source"):
        raise ModelError(
            f"{ssd_path.name}: component '{name}' binds no .ssv file; give it one ParameterBinding with a source"
        )
    try:
        composed = composed_block(registry.FMU_OF_COMPONENT.get(stem, stem), stem)
    except KeyError as error:
        raise ModelError(f"{ssd_path.name}: component '{name}' runs {source}: {error.args[0]}") from None
    starts = checked_starts(composed, read_values(ssd_path.parent / binding.get("source", "")) | dict(values))
    binding.set("source", f"resources/{name}.ssv")
    entries[f"resources/{name}.ssv"] = values_xml(composed.parameters, starts)
    fmu = make(stem, changed(composed, starts), stimulus if stem == STIMULUS else None)
    if entries.setdefault(source, fmu) != fmu:
        raise ModelError(
            f"{ssd_path.name}: two components with different values run '{source}'; give each a file of its own"
        )


def changed(composed: Composed, starts: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """The start values that differ from their declarations, in order of the declarations."""
    declared = composed.parameters
    return tuple((n, starts[n]) for n in declared if n in starts and starts[n] != declared[n].start)


class Kept:
    """A maker of FMUs that keeps the last it made; few of those that play a command, each as large as its log."""

    def __init__(self, make: Callable[..., bytes]) -> None:
        update_wrapper(self, make)
        self._still = lru_cache(maxsize=32)(make)
        self._playing = lru_cache(maxsize=2)(make)

    def __call__(
        self,
        stem: str,
        starts: tuple[tuple[str, float], ...] = (),
        stimulus: bytes | None = None,
        *further: object,
    ) -> bytes:
        """As the maker."""
        return (self._still if stimulus is None else self._playing)(stem, starts, stimulus, *further)

    def cache_clear(self) -> None:
        """Forget all."""
        self._still.cache_clear()
        self._playing.cache_clear()


@Kept
def fmu_bytes(stem: str, starts: tuple[tuple[str, float], ...], stimulus: bytes | None) -> bytes:
    """The FMU of a component, built once for the same content.

    Args:
        stem: file name without suffix: a block's name, or a component's that runs another block's FMU.
        starts: start values that differ from the declarations, SI.
        stimulus: CSV that a stimulus plays.
    """
    resources = {"stimulus.csv": stimulus} if stimulus is not None else None
    composed = composed_block(registry.FMU_OF_COMPONENT.get(stem, stem), stem)
    with Scratch("fmu_") as scratch:
        return build_fmu(composed, Path(scratch, f"{stem}.fmu"), dict(starts), resources).read_bytes()


def read_xml(file: Path) -> etree._Element:
    """The root of an XML file, without blanks between elements.

    Raises:
        ModelError: there is no such file, or it is not well-formed.
    """
    try:
        return etree.parse(file, safe_parser(remove_blank_text=True)).getroot()
    except OSError:
        raise ModelError(f"there is no file '{file}'") from None
    except etree.XMLSyntaxError as error:
        raise ModelError(f"'{file}' is not well-formed XML: {error}") from None


def read_values(file: Path) -> dict[str, float]:
    """Parameter values of an .ssv file, in the order of the file; its units are those of the declarations.

    Raises:
        ModelError: the file is bad or a parameter is no number.
    """
    values: dict[str, float] = {}
    for parameter in read_xml(file).findall("ssv:Parameters/ssv:Parameter", NAMESPACES):
        name = parameter.get("name", "")
        try:
            values[name] = float(parameter[0].get("value", ""))
        except (IndexError, ValueError):
            raise ModelError(f"'{file}': parameter '{name}' has no number as its value") from None
    return values


def values_xml(declared: Mapping[str, Variable], values: Mapping[str, float]) -> bytes:
    """An .ssv with `values`, SI, by name, in the units and the order of their declarations."""
    root = etree.Element(
        f"{{{SSV}}}ParameterSet", nsmap={"ssv": SSV, "ssc": SSC}, version="1.0", name=PARAMETER_SET
    )
    parameters = etree.SubElement(root, f"{{{SSV}}}Parameters")
    used = set()
    for name, variable in declared.items():
        if name not in values:
            continue
        node = etree.SubElement(parameters, f"{{{SSV}}}Parameter", name=name)
        text = number(values[name], variable)
        if variable.kind == "integer":
            etree.SubElement(node, f"{{{SSV}}}Integer", value=text)
        else:
            etree.SubElement(node, f"{{{SSV}}}Real", value=text, unit=variable.unit)
            used.add(variable.unit)
    units = etree.SubElement(root, f"{{{SSV}}}Units")
    for unit in sorted(used or {"1"}):
        exponents, scale = base_exponents(unit)
        base = {name: str(power) for name, power in sorted(exponents.items())}
        if scale != 1.0:
            base["factor"] = repr(scale)
        etree.SubElement(etree.SubElement(units, f"{{{SSC}}}Unit", name=unit), f"{{{SSC}}}BaseUnit", base)
    return xml_bytes(root)


def set_stop_time(document: etree._Element, time: float) -> None:
    """Let the default experiment end at `time`, s."""
    experiment = document.find("ssd:DefaultExperiment", NAMESPACES)
    if experiment is not None:
        experiment.set("stopTime", f"{time:g}")


def open_system(document: etree._Element, ssd_path: Path) -> None:
    """Turn a closed system into an open one: no stimulus, system-level input ``u`` and the outputs of `OUTPUTS` that exist.

    Raises:
        ModelError: there is no stimulus to leave out.
    """
    system = document.find("ssd:System", NAMESPACES)
    found = {c.get("name"): c for c in document.findall(".//ssd:Component", NAMESPACES)}
    if system is None or STIMULUS not in found:
        raise ModelError(
            f"{ssd_path.name} has no component '{STIMULUS}', so no open package can be derived from it"
        )
    connections = system.find("ssd:Connections", NAMESPACES)
    command = found[STIMULUS].find("ssd:Connectors/ssd:Connector", NAMESPACES)
    found[STIMULUS].getparent().remove(found[STIMULUS])
    connectors = etree.Element(f"{{{SSD}}}Connectors")
    system.insert(0, connectors)
    add_connector(connectors, "u", "input", command)
    for connection in connections.findall("ssd:Connection[@startElement='stimulus']", NAMESPACES):
        del connection.attrib["startElement"]
    for name, element in OUTPUTS.items():
        inner = None
        if element in found:
            inner = found[element].find(f"ssd:Connectors/ssd:Connector[@name='{name}']", NAMESPACES)
        if inner is not None:
            add_connector(connectors, name, "output", inner)
            ends = {"startElement": element, "startConnector": name, "endConnector": name}
            etree.SubElement(connections, f"{{{SSD}}}Connection", ends)


def add_connector(connectors: etree._Element, name: str, kind: str, like: etree._Element) -> None:
    """Add a connector with the type and unit of another."""
    connector = etree.SubElement(connectors, f"{{{SSD}}}Connector", name=name, kind=kind)
    etree.SubElement(connector, like[0].tag, dict(like[0].attrib))


def structure_bytes(document: etree._Element) -> bytes:
    """A SystemStructure.ssd; components without a type get that of FMUs, a default that OMSimulator does not assume."""
    for component in document.iterfind(".//ssd:Component", NAMESPACES):
        if component.get("type") is None:
            component.set("type", FMU_TYPES[0])
    return xml_bytes(document)


def xml_bytes(root: etree._Element) -> bytes:
    """The element as an indented file; its prefixes stay, because ecos and libcosim look for ssd:, ssc:, ssv: literally."""
    etree.indent(root, "  ")
    text: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def write_archive(entries: Mapping[str, bytes], destination: Path) -> Path:
    """Write a zip archive, all at once."""
    destination.parent.mkdir(parents=True, exist_ok=True)
    return write_bytes(destination, archive_bytes(entries))


def archive_bytes(entries: Mapping[str, bytes]) -> bytes:
    """A zip archive with fixed dates and rights; FMUs are compressed already."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name in sorted(entries):
            info = zipfile.ZipInfo(name, ARCHIVE_DATE)
            info.compress_type = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            info.create_system = 3  # the same on every platform
            archive.writestr(info, entries[name])
    return buffer.getvalue()
