"""The wiring of a model as the diagnosis reads it: components, their blocks and what feeds what."""

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from cosim.errors import ModelError
from cosim.ssp.read import read_system
from cosim.ssp.system import Port, System
from cosim.ssp.write import NAMESPACES, read_values, read_xml
from fmus import registry


@dataclass(frozen=True)
class Loop:
    """The wires of two components that feed back.

    Attributes:
        forth: input of the second that the first one's first output feeds.
        back: input of the first that the second feeds, which the first reads as that of the step before.
    """

    forth: Port
    back: Port

    @property
    def ports(self) -> tuple[Port, Port]:
        """Both inputs."""
        return self.forth, self.back


@dataclass(frozen=True)
class Wiring:
    """A system of our blocks.

    Attributes:
        name: of the system.
        blocks: component -> block, in the order of the file.
        wires: input of a component -> the output that feeds it.
        inputs: connector of the system -> the component inputs it feeds.
        outputs: connector of the system -> the output behind it.
        values: ``component.parameter`` -> SI as the package sets it.
    """

    name: str
    blocks: dict[str, str]
    wires: dict[Port, Port]
    inputs: dict[str, tuple[Port, ...]]
    outputs: dict[str, Port]
    values: dict[str, float] = field(default_factory=dict)

    def unit(self, port: Port) -> str:
        """Unit of a component's variable."""
        block = registry.block(self.blocks[port.component])
        return (block.inputs | block.outputs)[port.variable].unit

    def loops(self) -> dict[str, Loop]:
        """Components whose last input the one behind them feeds back, each with the two wires."""
        found = {}
        for component, name in self.blocks.items():
            block = registry.block(name)
            for variable in (n for n, way in block.reads.items() if way == "start"):
                back = Port(component, variable)
                source = self.wires.get(back)
                ahead = Port(component, next(iter(block.outputs)))
                fed = [
                    t
                    for t, s in self.wires.items()
                    if source and s == ahead and t.component == source.component
                ]
                if fed:
                    found[component] = Loop(fed[0], back)
        return found

    def has(self, port: Port) -> bool:
        """True if there is such a variable."""
        if port.component not in self.blocks:
            return False
        block = registry.block(self.blocks[port.component])
        return port.variable in block.inputs or port.variable in block.outputs


def wiring_of_file(ssd: Path) -> Wiring:
    """The wiring of an .ssd whose components are our blocks, with the values of the .ssv files that it binds.

    Raises:
        ModelError: it cannot be read, or a component is none of our blocks.
    """
    document = read_xml(ssd)
    system = document.find("ssd:System", NAMESPACES)
    if system is None:
        raise ModelError(f"{ssd} holds no System")
    blocks: dict[str, str] = {}
    values: dict[str, float] = {}
    for component in system.findall("ssd:Elements/ssd:Component", NAMESPACES):
        name, stem = component.get("name", ""), PurePosixPath(component.get("source", "")).stem
        blocks[name] = known_block(ssd, name, registry.FMU_OF_COMPONENT.get(stem, stem))
        for binding in component.findall("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
            found = read_values(ssd.parent / binding.get("source", ""))
            values |= {f"{name}.{parameter}": value for parameter, value in found.items()}
    wires: dict[Port, Port] = {}
    inputs: dict[str, tuple[Port, ...]] = {}
    outputs: dict[str, Port] = {}
    for wire in system.findall("ssd:Connections/ssd:Connection", NAMESPACES):
        start = Port(wire.get("startElement", ""), wire.get("startConnector", ""))
        end = Port(wire.get("endElement", ""), wire.get("endConnector", ""))
        if not start.component:
            inputs[start.variable] = (*inputs.get(start.variable, ()), end)
        elif not end.component:
            outputs[end.variable] = start
        else:
            wires[end] = start
    return Wiring(system.get("name", ssd.stem), blocks, wires, inputs, outputs, values)


def wiring_of_system(system: System) -> Wiring:
    """The wiring of a package that was read.

    Raises:
        ModelError: a component is none of our blocks, or a wire converts.
    """
    blocks = {n: known_block(system.path, n, c.fmu.identifier) for n, c in system.components.items()}
    converting = [w for w in system.wires if w.factor != 1.0 or w.offset != 0.0]
    if converting:
        raise ModelError(
            f"{system.path}: {converting[0]} converts its signal; wire equal units for a diagnosis"
        )
    wires = {w.target: w.source for w in system.wires}
    inputs = {n: tuple(w.target for w in item.targets) for n, item in system.inputs.items()}
    values: dict[str, float] = {}
    for name, component in system.components.items():
        starts = {n: v.start for n, v in component.fmu.variables.items() if v.causality == "parameter"}
        for parameter, value in (starts | dict(component.starts)).items():
            if isinstance(value, (int, float)) and not isinstance(value, bool):
                values[f"{name}.{parameter}"] = float(value)
    return Wiring(system.name, blocks, wires, inputs, dict(system.outputs), values)


def wiring_of(path: Path) -> Wiring:
    """The wiring of an .ssd or .ssp."""
    if path.suffix.lower() == ".ssd":
        return wiring_of_file(path)
    with read_system(path) as system:
        return wiring_of_system(system)


def known_block(path: Path, component: str, block: str) -> str:
    """`block`, if it is one of ours and the component bears the name that its effects go by.

    Raises:
        ModelError: it is not.
    """
    if block not in registry.BLOCKS:
        raise ModelError(
            f"{path}: component '{component}' runs '{block}', which is none of our blocks ({', '.join(registry.BLOCKS)}); "
            "only systems of these can be diagnosed"
        )
    if block not in registry.blocks_of(component) or component in registry.COMPONENT_OF:
        name = registry.COMPONENT_OF.get(block, block)
        raise ModelError(
            f"{path}: component '{component}' runs the block '{block}': name it '{name}', the name its effects go by"
        )
    return block
