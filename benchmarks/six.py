"""The six blocks from compensator to observer alone: no FMU plays the command, none stands for the sensor."""

import shutil
from pathlib import Path

from lxml import etree

from cosim.paths import ssp_folder
from cosim.ssp.write import NAMESPACES, write_ssp


def six_blocks(folder: Path, file: Path) -> Path:
    """Write a package of compensator, dead zone, valve, continuity, mechanics and observer with an input ``u``.

    Args:
        folder: for a copy of our wiring files.
        file: where the package goes.
    """
    wiring = shutil.copytree(ssp_folder(), folder / "six_blocks") / "full_order.ssd"
    document = etree.parse(wiring)
    for component in document.findall(".//ssd:Component[@name='sensor']", NAMESPACES):
        component.getparent().remove(component)
    for wire in document.findall(".//ssd:Connection", NAMESPACES):
        if wire.get("endElement") == "sensor":
            wire.getparent().remove(wire)
        elif wire.get("startElement") == "sensor":
            wire.set("startElement", "mechanical")
            wire.set("startConnector", "theta")
    document.write(wiring)
    return write_ssp(wiring, file, open=True)
