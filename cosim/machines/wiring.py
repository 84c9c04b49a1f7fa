"""The wiring (.ssd) and the values (.ssv) of a chain of our blocks."""

from collections.abc import Mapping
from pathlib import Path

from lxml import etree

from cosim.errors import DataError
from cosim.machines.table import MachineTable, block_of
from cosim.ssp.write import NAMESPACES, SSC, SSD, structure_bytes, values_xml
from cosim.units import base_exponents, is_speed
from fmus import registry

Ends = tuple[str, str]


def wires(table: MachineTable, source: object) -> list[tuple[Ends, Ends]]:
    """The connections of the chain as ((component, output), (component, input)).

    Raises:
        DataError: a block cannot follow the one before it.
    """
    found = []
    for before, behind in zip(table.chain, table.chain[1:], strict=False):
        (target, taken), *_ = block_of(behind).inputs.items()
        outputs = block_of(before).outputs
        name = target if target in outputs else next(iter(outputs))
        if outputs[name].unit != taken.unit:
            raise DataError(
                f"{source}: machine.chain: '{behind}' takes {target} [{taken.unit}], which '{before}' does not give "
                f"({name} [{outputs[name].unit}]){between(outputs[name].unit, taken.unit)}"
            )
        found.append(((before, name), (behind, target)))
    return found


def between(given: str, taken: str) -> str:
    """What to say of the blocks that turn one unit into another; empty where none does."""

    def turns(name: str) -> bool:
        inputs, outputs = (list(ports.values()) for ports in (block_of(name).inputs, block_of(name).outputs))
        return bool(inputs) and inputs[0].unit == given and any(v.unit == taken for v in outputs)

    fitting = [repr(name) for name in registry.BLOCKS if turns(name)]
    return f": put {' or '.join(fitting)} between them" if fitting else ""


def entry(table: MachineTable) -> Ends:
    """(component, input) that the machine's input drives."""
    return table.chain[0], next(iter(block_of(table.chain[0]).inputs))


def outlet(table: MachineTable, unit: str | None = None) -> Ends:
    """(component, output) that the machine's output shows: the last block's first, or its speed where that has the unit."""
    outputs = block_of(table.chain[-1]).outputs
    held = table.places or (unit is not None and is_speed(unit))
    rates = [n for n, v in outputs.items() if v.unit == "rad/s"] if held else []
    return table.chain[-1], (rates or list(outputs))[0]


def wiring_xml(
    table: MachineTable, name: str, description: str, source: object, last: Ends | None = None
) -> bytes:
    """The .ssd of the open system: one input, one output, each component bound to ``<component>.ssv``.

    Raises:
        DataError: a block cannot follow the one before it.
    """
    root = etree.Element(
        f"{{{SSD}}}SystemStructureDescription",
        nsmap={p: NAMESPACES[p] for p in ("ssd", "ssc", "ssv")},
        version="1.0",
        name=name,
    )
    system = etree.SubElement(root, f"{{{SSD}}}System", name=name, description=description)
    first, last = entry(table), last or outlet(table)
    ends = etree.SubElement(system, f"{{{SSD}}}Connectors")
    units = {_connector(ends, table.input, "input", block_of(first[0]).inputs[first[1]].unit)}
    units.add(_connector(ends, table.output, "output", block_of(last[0]).outputs[last[1]].unit))
    elements = etree.SubElement(system, f"{{{SSD}}}Elements")
    for component in table.chain:
        stem = component if component in registry.FMU_OF_COMPONENT else block_of(component).name
        node = etree.SubElement(
            elements, f"{{{SSD}}}Component", name=component, source=f"resources/{stem}.fmu"
        )
        connectors = etree.SubElement(node, f"{{{SSD}}}Connectors")
        block = block_of(component)
        for kind, variables in (("input", block.inputs), ("output", block.outputs)):
            units |= {
                _connector(connectors, n, kind, v.unit) for n, v in variables.items() if v.kind == "real"
            }
        bindings = etree.SubElement(node, f"{{{SSD}}}ParameterBindings")
        etree.SubElement(bindings, f"{{{SSD}}}ParameterBinding", source=f"{component}.ssv")
    connections = etree.SubElement(system, f"{{{SSD}}}Connections")
    listed = [(("", table.input), first), *wires(table, source), (last, ("", table.output))]
    for (start, output), (end, taken) in listed:
        given = {"startElement": start, "startConnector": output, "endElement": end, "endConnector": taken}
        etree.SubElement(connections, f"{{{SSD}}}Connection", {k: v for k, v in given.items() if v})
    listed_units = etree.SubElement(root, f"{{{SSD}}}Units")
    for unit in sorted(units):
        exponents, _ = base_exponents(unit)
        node = etree.SubElement(listed_units, f"{{{SSC}}}Unit", name=unit)
        etree.SubElement(node, f"{{{SSC}}}BaseUnit", {n: str(p) for n, p in sorted(exponents.items())})
    return structure_bytes(root)


def _connector(parent: etree._Element, name: str, kind: str, unit: str) -> str:
    """Add a connector; returns its unit."""
    node = etree.SubElement(parent, f"{{{SSD}}}Connector", name=name, kind=kind)
    etree.SubElement(node, f"{{{SSC}}}Real", unit=unit)
    return unit


def files(
    table: MachineTable,
    values: Mapping[str, float],
    name: str,
    description: str,
    source: object,
    last: Ends | None = None,
) -> dict[str, bytes]:
    """File name -> content of the wiring and the values.

    Args:
        table: the machine.
        values: ``component.parameter`` -> SI.
        name: of the system, and stem of its .ssd.
        description: of the system.
        source: the mapping file, for messages.
        last: (component, output) that the machine's output shows; by default `outlet`.

    Raises:
        DataError: a block cannot follow the one before it.
    """
    found = {f"{name}.ssd": wiring_xml(table, name, description, source, last)}
    for component in table.chain:
        own = {n.partition(".")[2]: v for n, v in values.items() if n.partition(".")[0] == component}
        found[f"{component}.ssv"] = values_xml(block_of(component).parameters, own)
    return found


def write_files(content: Mapping[str, bytes], folder: Path) -> None:
    """Write what is not there yet, each file at once."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in content.items():
        file = folder / name
        if not file.is_file() or file.read_bytes() != data:
            temporary = file.with_name(file.name + ".part")
            temporary.write_bytes(data)
            temporary.replace(file)
