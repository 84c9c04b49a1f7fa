"""XML from strangers: no entities, no DTD, no network; and the standard's own schemas."""

from functools import cache
from pathlib import Path

from lxml import etree

from cosim.errors import ModelError

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"

_SCHEMAS = {
    f"{SSD}SystemStructureDescription": "SystemStructureDescription.xsd",
    f"{SSV}ParameterSet": "SystemStructureParameterValues.xsd",
}


def parse(data: bytes, what: str) -> etree._Element:
    """Root element of an XML document.

    Args:
        data: the document.
        what: its name, for messages.

    Raises:
        ModelError: it is not well formed, or holds a DOCTYPE (entities could read files or exhaust the memory).
    """
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, remove_pis=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise ModelError(f"{what} is not well-formed XML: {error}") from None
    if root.getroottree().docinfo.doctype:
        raise ModelError(f"{what} has a DOCTYPE, which is refused: remove it, FMI and SSP files need none")
    return root


@cache
def _schema(name: str) -> etree.XMLSchema:
    import fmpy.ssp

    return etree.XMLSchema(file=str(Path(fmpy.ssp.__file__).parent / "schema" / name))


def schema_problems(root: etree._Element) -> list[str]:
    """What the SSP 1.0 schema objects to, one line each; empty for a valid document.

    Raises:
        ModelError: the root element is neither a SystemStructureDescription nor a ParameterSet.
    """
    if root.tag not in _SCHEMAS:
        raise ModelError(
            f"the root element {root.tag} is none of SSP 1.0: expected one of {', '.join(_SCHEMAS)}"
        )
    schema = _schema(_SCHEMAS[root.tag])
    schema.validate(root)
    return [f"line {entry.line}: {entry.message}" for entry in schema.error_log]
