"""Meta data of a package by SSP Traceability: what its values rest on, as a file of Simulation Resource Meta Data inside.

SSP Traceability 1.0 (https://ssp-standard.org) leaves to the tool which classifications it gives, each a list of keywords
and texts; ours begin with ``slew-cosim.``. The file lies where FMUs carry theirs: in ``extra``, under the standard's name.
"""

import zipfile
from collections.abc import Mapping
from pathlib import Path

from lxml import etree
from lxml.builder import ElementMaker

from cosim.ssp.write import archive_bytes
from cosim.ssp.xml import parse

ENTRY = "extra/org.ssp-standard.ssp-traceability.srmd/resourceMetaData.srmd"
SPACE = "http://ssp-standard.org/SSPTraceability1"
RECORD_NAMESPACES = {"srmd": f"{SPACE}/SimulationResourceMetaData", "stc": f"{SPACE}/SSPTraceabilityCommon"}
PREFIX = "slew-cosim."

Sections = Mapping[str, Mapping[str, str]]


def meta_data(name: str, tool: str, sections: Sections) -> bytes:
    """A file of Simulation Resource Meta Data for what it lies in.

    No date is in it, so that the same content makes the same bytes.

    Args:
        name: of the resource, for people.
        tool: name and version of what made it.
        sections: classification -> keyword -> text; empty ones are left out.
    """
    stc = ElementMaker(namespace=RECORD_NAMESPACES["stc"])
    root = ElementMaker(
        namespace=RECORD_NAMESPACES["srmd"], nsmap=RECORD_NAMESPACES
    ).SimulationResourceMetaData(version="1.0.0", name=name, generationTool=tool)
    for section, entries in sections.items():
        if entries:
            listed = [stc.ClassificationEntry(text, keyword=keyword) for keyword, text in entries.items()]
            root.append(stc.Classification(*listed, type=PREFIX + section))
    data: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True, pretty_print=True)
    return data


def embedding(package: Path, data: bytes) -> bytes:
    """An .ssp file with meta data in it, in place of what of ours was there."""
    with zipfile.ZipFile(package) as archive:
        entries = {n: archive.read(n) for n in archive.namelist() if not n.endswith("/")}
    return archive_bytes({**entries, ENTRY: data})


def embedded(package: Path) -> dict[str, dict[str, str]] | None:
    """The meta data of ours in an .ssp file, as `meta_data` took it; None if there is none.

    Raises:
        ModelError: the file in it is no XML.
    """
    with zipfile.ZipFile(package) as archive:
        if ENTRY not in archive.namelist():
            return None
        root = parse(archive.read(ENTRY), f"{package}: {ENTRY}")
    return {
        node.get("type", "").removeprefix(PREFIX): {
            entry.get("keyword", ""): entry.text or ""
            for entry in node.findall("stc:ClassificationEntry", RECORD_NAMESPACES)
        }
        for node in root.findall("stc:Classification", RECORD_NAMESPACES)
        if node.get("type", "").startswith(PREFIX)
    }
