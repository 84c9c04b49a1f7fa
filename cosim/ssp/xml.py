"""XML from strangers: no entities, no DTD, no network; and the standard's own schemas."""

import math
from functools import cache
from pathlib import Path

from lxml import etree

from cosim.errors import ModelError

IN_SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
IN_SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
IN_SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
IN_SSM = "{http://ssp-standard.org/SSP1/SystemStructureParameterMapping}"

_SCHEMAS = {
    f"{IN_SSD}SystemStructureDescription": "SystemStructureDescription.xsd",
    f"{IN_SSV}ParameterSet": "SystemStructureParameterValues.xsd",
}


def safe_parser(**options: bool) -> etree.XMLParser:
    """A parser that resolves no entity, loads no DTD and asks no network; `options` are lxml's."""
    return etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=False,
        **options,
    )


def parse(data: bytes, what: str) -> etree._Element:
    """Root element of an XML document.

    Args:
        data: the document.
        what: its name, for messages.

    Raises:
        ModelError: it is not well formed, or holds a DOCTYPE (entities could read files or exhaust the memory).
    """
    parser = safe_parser(remove_pis=True)
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        if any(entry.type != etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE for entry in parser.error_log):
            raise ModelError(f"{what} is not well-formed XML: {error}") from None
        # annotations of a tool whose prefix nobody declared: others read on, and so can we
        root = etree.fromstring(data, safe_parser(remove_pis=True, recover=True))
    if root.getroottree().docinfo.doctype:
        raise ModelError(f"{what} has a DOCTYPE, which is refused: remove it, FMI and SSP files need none")
    return root


def number(element: etree._Element, name: str, what: str, usual: float | None = None) -> float | None:
    """A finite number from an attribute; `usual` where it is missing or empty.

    Args:
        element: holds the attribute.
        name: of the attribute.
        what: where the element is, for messages.
        usual: the standard's default.

    Raises:
        ModelError: it is no finite number.
    """
    text = element.get(name)
    if not text:
        return usual
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ModelError(f"{what}: {name}='{text}' is no finite number: correct it")
    return value


@cache
def _schema(name: str) -> etree.XMLSchema:
    import fmpy.ssp

    return etree.XMLSchema(file=str(Path(fmpy.ssp.__file__).parent / "schema" / name))


def schema_problems(root: etree._Element) -> list[str]:
    """What the SSP 1.0 schema objects to, one line each; empty for a valid document, and for one of SSP 2.

    Raises:
        ModelError: the root element is neither a SystemStructureDescription nor a ParameterSet.
    """
    if root.tag not in _SCHEMAS:
        raise ModelError(
            f"the root element {root.tag} is none of SSP 1.0: expected one of {', '.join(_SCHEMAS)}"
        )
    if root.get("version", "").startswith("2."):
        return []  # its schema is not at hand
    schema = _schema(_SCHEMAS[root.tag])
    schema.validate(root)
    return [*undeclared(root), *(f"line {entry.line}: {entry.message}" for entry in schema.error_log)]


def undeclared(root: etree._Element) -> list[str]:
    """Prefixes of elements and attributes that the document does not declare, which no XML with namespaces may hold."""
    found: dict[str, str] = {}
    for element in root.iter(etree.Element):
        for name in (element.tag, *element.attrib):
            prefix, colon, _ = str(name).partition(":")
            if colon and not str(name).startswith("{"):
                found.setdefault(
                    prefix,
                    f"line {element.sourceline}: the prefix '{prefix}' is not declared: add xmlns:{prefix}",
                )
    return list(found.values())
