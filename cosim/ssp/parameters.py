"""Parameter values: .ssv files and the bindings of an IN_SSD, with SSP 1.0's rules of precedence."""

import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import unquote

from lxml import etree

from cosim.errors import ModelError
from cosim.ssp.archive import read_entry
from cosim.ssp.fmu import parse_value
from cosim.ssp.quantities import UnitDefinition, convert, from_xml
from cosim.ssp.system import Fmu, Value, Variable, alike
from cosim.ssp.xml import IN_SSC, IN_SSD, IN_SSM, IN_SSV, number, parse


@dataclass(frozen=True)
class ParameterValue:
    """One value of a parameter set, as written: the unit may differ from that of the variable it is for."""

    name: str
    kind: str
    value: Value
    unit: str
    units: Mapping[str, UnitDefinition]
    set_name: str


def units_of(root: etree._Element, what: str) -> dict[str, UnitDefinition]:
    """Units that a parameter set defines, by name; `what` is its own, for messages."""
    node = root.find(f"{IN_SSV}Units")
    return {} if node is None else from_xml(node, what)


def read_set(root: etree._Element, what: str) -> list[ParameterValue]:
    """The values of an ``ssv:ParameterSet``.

    Raises:
        ModelError: it is no parameter set, holds a value that cannot be read, or a name twice.
    """
    if root.tag != f"{IN_SSV}ParameterSet":
        raise ModelError(
            f"{what} is no SSP 1.0 parameter set: its root element is {root.tag}, "
            f"and not {IN_SSV}ParameterSet: correct its name or namespace"
        )
    units = units_of(root, what)
    label = root.get("name", "")
    found: dict[str, ParameterValue] = {}
    for parameter in root.iterfind(f"{IN_SSV}Parameters/{IN_SSV}Parameter"):
        name = parameter.get("name", "")
        item = next(
            (child for child in parameter if isinstance(child.tag, str) and child.get("value") is not None),
            None,
        )
        if not name or item is None:
            raise ModelError(f"{what}: the parameter '{name}' has no name or no value")
        kind = alike(etree.QName(item).localname)
        if kind not in ("Real", "Integer", "Boolean", "String"):
            raise ModelError(f"{what}: the parameter '{name}' is of type {kind}, which is not supported")
        if name in found:
            raise ModelError(f"{what}: the parameter '{name}' is given twice")
        try:
            value = parse_value(kind, item.get("value", ""))
        except ValueError as error:
            raise ModelError(f"{what}: the parameter '{name}' has a bad value: {error}") from None
        if kind == "Real" and not math.isfinite(float(value)):
            raise ModelError(f"{what}: the parameter '{name}' = {value} is no finite number: correct it")
        found[name] = ParameterValue(name, kind, value, bare(item.get("unit", "")), units, label)
    return list(found.values())


def bare(unit: str) -> str:
    """A unit without the brackets that some tools write about it."""
    return unit[1:-1].strip() if unit.startswith("[") and unit.endswith("]") else unit


def read_ssv(path: Path) -> list[ParameterValue]:
    """The values of an .ssv file; names are ``component.variable`` or those of system connectors.

    Raises:
        ModelError: the file is missing or no parameter set.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path} cannot be read: {error.strerror or error}") from None
    return read_set(parse(data, str(path)), str(path))


def bindings(
    element: etree._Element, archive: zipfile.ZipFile, fmu: zipfile.ZipFile | None, what: str
) -> list[tuple[str, list[ParameterValue]]]:
    """Parameter sets bound to a component or system, later ones taking priority.

    Args:
        element: the Component or System.
        archive: the SSP.
        fmu: the component's own archive, for sources inside it.
        what: the element's name, for messages.

    Returns:
        (name of the set, its values with the binding's prefix put before their names) in the order of the file.

    Raises:
        ModelError: a source is missing, remote or of another type.
    """
    found = []
    for binding in element.iterfind(f"{IN_SSD}ParameterBindings/{IN_SSD}ParameterBinding"):
        if binding.get("type", "application/x-ssp-parameter-set") != "application/x-ssp-parameter-set":
            raise ModelError(f"{what}: parameter bindings of type {binding.get('type')} are not supported")
        root, label = _binding_root(binding, archive, fmu, what)
        values = read_set(root, label)
        mapping = binding.find(f"{IN_SSD}ParameterMapping")
        if mapping is not None:
            values = mapped(values, *_mapping_root(mapping, archive, fmu, what))
        prefix = binding.get("prefix", "")
        found.append((root.get("name", ""), [replace(v, name=prefix + v.name) for v in values]))
    return found


def mapped(values: Sequence[ParameterValue], root: etree._Element, what: str) -> list[ParameterValue]:
    """The values under the names that an ``ssm:ParameterMapping`` gives them; one that it does not name is left out.

    Raises:
        ModelError: it is no mapping, or changes a value otherwise than linearly.
    """
    if root.tag != f"{IN_SSM}ParameterMapping":
        raise ModelError(f"{what} is no parameter mapping: its root element is {root.tag}")
    known = {v.name: v for v in values}
    found = []
    for entry in root.iterfind(f"{IN_SSM}MappingEntry"):
        value = known.get(entry.get("source", ""))
        if value is None:
            continue  # the set need not hold every name
        factor, offset = linear(entry, f"{what}: '{value.name}'")
        number_ = value.value
        if (factor, offset) != (1.0, 0.0):
            if value.kind != "Real":
                raise ModelError(f"{what}: '{value.name}' is a {value.kind}: only a Real can be transformed")
            number_ = factor * float(number_) + offset
        found.append(replace(value, name=entry.get("target", ""), value=number_))
    return found


def _mapping_root(
    mapping: etree._Element, archive: zipfile.ZipFile, fmu: zipfile.ZipFile | None, what: str
) -> tuple[etree._Element, str]:
    """The mapping of a binding, inline or in a file, and its name for messages."""
    inline = mapping.find(f"{IN_SSM}ParameterMapping")
    if mapping.get("source") is None:
        if inline is None:
            raise ModelError(f"{what}: a parameter mapping has neither a source nor entries")
        return inline, f"{what}: inline mapping"
    return _source_root(mapping, archive, fmu, what)


def _binding_root(
    binding: etree._Element, archive: zipfile.ZipFile, fmu: zipfile.ZipFile | None, what: str
) -> tuple[etree._Element, str]:
    if binding.get("source") is None:
        inline = binding.find(f"{IN_SSD}ParameterValues/{IN_SSV}ParameterSet")
        if inline is None:
            raise ModelError(f"{what}: a parameter binding has neither a source nor values")
        return inline, f"{what}: inline values"
    return _source_root(binding, archive, fmu, what)


def _source_root(
    binding: etree._Element, archive: zipfile.ZipFile, fmu: zipfile.ZipFile | None, what: str
) -> tuple[etree._Element, str]:
    """The document that a binding or mapping names as its source."""
    source = binding.get("source", "")
    name = local_source(source, what)
    if binding.get("sourceBase", "SSD") == "component":
        if fmu is None:
            raise ModelError(
                f"{what}: the parameter source '{source}' is relative to a component, but there is none"
            )
        return parse(read_entry(fmu, name, what), f"{what}: {name}"), f"{what}: {name}"
    return parse(read_entry(archive, name, what), name), name


def local_source(source: str, what: str) -> str:
    """Archive entry that a relative URI names.

    Raises:
        ModelError: the URI has a scheme, or is a reference within the document.
    """
    if "://" in source or source.startswith(("#", "/")) or source.split(":")[0] in ("http", "https", "file"):
        raise ModelError(
            f"{what}: the source '{source}' is not inside the archive: only relative paths are supported"
        )
    return unquote(source).removeprefix("./")


def fitted(value: ParameterValue, variable: Variable, fmu: Fmu, what: str) -> Value:
    """A value as the FMU takes it: of the variable's type and in its unit.

    Raises:
        ModelError: the variable cannot be set, or type or dimension do not fit.
    """
    if not variable.can_be_set:
        raise ModelError(
            f"{what}: '{variable.name}' is a {variable.variability} {variable.causality} and cannot be given a start value"
        )
    number = value.value
    if variable.kind == "Real" and value.kind in ("Real", "Integer"):
        try:
            return convert(float(number), value.unit, value.units, variable.unit, fmu.units)
        except ModelError as error:
            raise ModelError(f"{what}: '{variable.name}' = {number!r} {value.unit}: {error}") from None
    if variable.kind in ("Integer", "Enumeration") and value.kind == "Real" and float(number).is_integer():
        return int(number)
    if value.kind == variable.kind or (value.kind == "Integer" and variable.kind == "Enumeration"):
        return number
    raise ModelError(
        f"{what}: '{variable.name}' is of type {variable.kind}, but {number!r} is of type {value.kind}"
    )


def linear(connection: etree._Element, what: str) -> tuple[float, float]:
    """Factor and offset of a connection's transformation: (1, 0) if it has none.

    Raises:
        ModelError: it has a transformation of another kind, or a bad number.
    """
    for child in connection:
        if child.tag == f"{IN_SSC}LinearTransformation":
            factor, offset = number(child, "factor", what, 1.0), number(child, "offset", what, 0.0)
            return 1.0 if factor is None else factor, offset or 0.0
        if isinstance(child.tag, str) and child.tag.endswith("Transformation"):
            raise ModelError(
                f"{what}: a {etree.QName(child).localname} is not supported: only linear ones are"
            )
    return 1.0, 0.0
