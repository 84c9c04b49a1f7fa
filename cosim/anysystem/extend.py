"""The extended model: the user's own package with a small FMU in each wire that a cause is in, and the parameters as found.

An effect at an output stands behind it for everybody; one at an input before that input only; one of a reading feeds an
output of the system of its own and changes nothing else. Dry friction before an input reads an output as well. Written
twice: with Python FMUs, and with native ones where there is a C compiler.
"""

import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from lxml import etree

from cosim.anysystem.actions import NEXT, PARAMETER, Action, in_log
from cosim.anysystem.model import Loop
from cosim.anysystem.pipeline import AnyDiagnosis
from cosim.files import Scratch, write_bytes
from cosim.native.build import MissingCompilerError, build_native
from cosim.ssp.effects import kind_of
from cosim.ssp.flatten import flatten
from cosim.ssp.system import FOUND, Port, System, Value
from cosim.ssp.write import NAMESPACES, SSC, SSD, SSV, structure_bytes, write_archive, xml_bytes
from cosim.ssp.xml import parse
from cosim.system.effects import EFFECTS
from fmus import port_effect, port_friction
from fmus.build import build_fmu
from fmus.compose import Composed, compose
from fmus.contract import Block

Starts = Mapping[str, float]
Maker = Callable[[Composed, Path, Starts], Path]
DESCRIPTION = "SystemStructure.ssd"
UNSTATED: Mapping[str, Value] = {}
NONE_READ: Mapping[Action, Port] = {}
STATED = "mapping"  # name of the set of what a mapping says of parameters and of inputs
CONNECTED = ("Real", "Integer", "Boolean")  # types of connectors that need no definition beside them
# effects with an FMU of their own; one holds all others
BLOCKS = {"port.friction": port_friction.BLOCK}
# parameters of an effect that are called otherwise where one FMU holds all effects
NAMES = {
    ("port.dead_zone", "low"): "zone_low",
    ("port.dead_zone", "high"): "zone_high",
    ("port.drift", "rate"): "drift",
}


def starts_of(found: AnyDiagnosis, group: str, action: Action) -> dict[str, float]:
    """Start values of the FMU of one effect, in the units of the FMUs beside it."""
    finding = found.findings[group]
    if action in finding.read:
        shown = finding.read[action]
        return {"quantum": shown.step} if hasattr(shown, "step") else {}
    values = in_log(finding.chosen.fit.values, NEXT)
    prefix = action.key("")
    loop = loop_of(found, group, action)
    return dict(loop.settings if loop else {}) | {
        NAMES.get((action.effect, n.removeprefix(prefix)), n.removeprefix(prefix)): v
        for n, v in values.items()
        if n.startswith(prefix)
    }


def loop_of(found: AnyDiagnosis, group: str, action: Action) -> Loop | None:
    """What is run with a component for an effect, where it is one that depends on what the component then does."""
    return found.findings[group].model.loops.get(f"{action.port}|{action.where}", {}).get(action.effect)


def block_of(effect: str) -> Block:
    """The block of the FMU that has an effect."""
    return BLOCKS.get(effect, port_effect.BLOCK)


def write_extended(found: AnyDiagnosis, folder: Path, where: Callable[[str, Action], Action]) -> list[Path]:
    """Make ``extended.ssp``, ``extended.ssv`` and, with a compiler, ``extended_native.ssp``; none without a cause or a fit.

    Args:
        found: the diagnosis.
        folder: where they are made; they do not say yet what they rest on.
        where: group and cause -> the cause as its neighbours have it.
    """
    placed = [(g, a, where(g, a)) for g, a in found.causes()]
    effects = [(told, starts_of(found, g, a)) for g, a, told in placed if a.effect != PARAMETER]
    numbers = {
        str(a.port): found.findings[g].chosen.fit.values[f"{PARAMETER}|{a.port}"]
        for g, a, _ in placed
        if a.effect == PARAMETER
    }
    for finding in found.findings.values():
        numbers |= {n: value for n, (value, _) in (finding.free | finding.settled).items()}
    if not placed and not numbers:
        return []
    stated = found.stated
    moved = {told: loop.moved for g, a, told in placed if (loop := loop_of(found, g, a))}
    files = [write_package(found.system, effects, numbers, folder / "extended.ssp", build_fmu, stated, moved)]
    everything = numbers | {
        f"{element_name(a)}.{n}": v for a, starts in effects if starts for n, v in starts.items()
    }
    files.append(write_bytes(folder / "extended.ssv", parameter_set(everything)))
    try:
        files.append(
            write_package(
                found.system, effects, numbers, folder / "extended_native.ssp", build_native, stated, moved
            )
        )
    except MissingCompilerError as error:
        found.notes.append(f"no native extended package: {error}")
    return files


def element_name(action: Action) -> str:
    """Name of the component that holds an effect."""
    return f"{action.effect.partition('.')[2]}_{kind_of(action.port)}_{action.where}"


def write_package(
    system: System,
    effects: Sequence[tuple[Action, Starts]],
    numbers: Mapping[str, float],
    destination: Path,
    make: Maker,
    stated: Mapping[str, Value] = UNSTATED,
    moved: Mapping[Action, Port] = NONE_READ,
) -> Path:
    """A system's package with effects in its wires.

    Args:
        system: as it was read; of an FMU a package is made around it.
        effects: with the start values of their FMUs; those without are left out.
        numbers: ``component.parameter`` -> value, as found.
        destination: the file.
        make: makes the FMU of an effect.
        stated: what the mapping says of parameters, and of inputs that were not measured, likewise.
        moved: effects that read an output beside their signal, with that.
    """
    entries, root = opened(system)
    node = root.find("ssd:System", NAMESPACES)
    with Scratch("extended_") as scratch:
        for action, starts in in_turn(effects):
            if not starts:
                continue
            name = element_name(action)
            file = make(compose(block_of(action.effect)), Path(scratch, f"{name}.fmu"), starts)
            entries[f"resources/{name}.fmu"] = file.read_bytes()
            insert(node, action, name, moved.get(action))
            state_unit(node, action.port, system.variable(action.port).unit)
    for label, values in ((STATED, stated), (FOUND, numbers)):
        for full, value in values.items():
            component, _, parameter = full.partition(".")
            element = node.find(f"ssd:Elements/ssd:Component[@name='{component}']", NAMESPACES)
            bind(element, {parameter: value}, label)
    entries[DESCRIPTION] = structure_bytes(root)
    return write_archive(entries, destination)


def in_turn(effects: Sequence[tuple[Action, Starts]]) -> list[tuple[Action, Starts]]:
    """Effects in the turn in which they go into the wires, so that the signal passes those at one port as it did in the fit.

    Each goes next to its port: at an input the last one comes last, at an output first. Those of a reading follow another.
    """
    turn = {effect: k for k, effect in enumerate(EFFECTS)}
    return sorted(effects, key=lambda e: turn[e[0].effect] * (-1 if e[0].where == "output" else 1))


def opened(system: System) -> tuple[dict[str, bytes], etree._Element]:
    """Entries of a system's package, and its description; of an FMU those of a package around it."""
    if system.path.suffix.lower() == ".ssp":
        with zipfile.ZipFile(system.path) as archive:
            entries = {n: archive.read(n) for n in archive.namelist() if not n.endswith("/")}
        root = parse(entries.pop(DESCRIPTION), DESCRIPTION)
        flatten(root.find("ssd:System", NAMESPACES))
        return entries, root
    (name, component), *_ = system.components.items()
    root = etree.Element(
        f"{{{SSD}}}SystemStructureDescription",
        nsmap={p: NAMESPACES[p] for p in ("ssd", "ssc", "ssv")},
        version="1.0",
        name=name,
    )
    node = etree.SubElement(root, f"{{{SSD}}}System", name=name)
    outer = etree.SubElement(node, f"{{{SSD}}}Connectors")
    elements = etree.SubElement(node, f"{{{SSD}}}Elements")
    wires = etree.SubElement(node, f"{{{SSD}}}Connections")
    file = f"resources/{system.path.name}"
    element = etree.SubElement(elements, f"{{{SSD}}}Component", name=name, source=file)
    inner = etree.SubElement(element, f"{{{SSD}}}Connectors")
    for variable in component.fmu.variables.values():
        if variable.kind in CONNECTED and variable.causality in ("input", "output"):
            for place in (outer, inner):
                connector(place, variable.name, variable.causality, variable.unit, variable.kind)
            inside = {"Element": name, "Connector": variable.name}
            ends = [{"Connector": variable.name}, inside]
            connect(wires, *(ends if variable.causality == "input" else reversed(ends)))
    return {file: system.path.read_bytes()}, root


def connector(parent: etree._Element, name: str, kind: str, unit: str = "", of_type: str = "Real") -> None:
    """Add a connector."""
    one = etree.SubElement(parent, f"{{{SSD}}}Connector", name=name, kind=kind)
    etree.SubElement(one, f"{{{SSC}}}{of_type}", {"unit": unit} if unit and of_type == "Real" else {})


def connect(wires: etree._Element, start: Mapping[str, str], end: Mapping[str, str]) -> None:
    """Add a connection; masters that convert units leave it alone: the effect has its neighbours' unit."""
    attributes = {f"start{n}": v for n, v in start.items()} | {f"end{n}": v for n, v in end.items()}
    etree.SubElement(wires, f"{{{SSD}}}Connection", attributes, suppressUnitConversion="true")


def insert(system: etree._Element, action: Action, name: str, moved: Port | None = None) -> None:
    """Put the FMU of an effect into the wires at its port; it may read an output as well."""
    elements = system.find("ssd:Elements", NAMESPACES)
    wires = system.find("ssd:Connections", NAMESPACES)
    if wires is None:
        wires = etree.SubElement(system, f"{{{SSD}}}Connections")
    element = etree.SubElement(
        elements,
        f"{{{SSD}}}Component",
        name=name,
        source=f"resources/{name}.fmu",
    )
    own = etree.SubElement(element, f"{{{SSD}}}Connectors")
    connector(own, "u", "input")
    connector(own, "y", "output")
    if moved is not None:
        connector(own, "x", "input")
        read = {"Element": moved.component, "Connector": moved.variable}
        connect(wires, read, {"Element": name, "Connector": "x"})
    port = {"Element": action.port.component, "Connector": action.port.variable}
    if action.where == "sensor":
        shown = f"{name}_reading"
        outer = system.find("ssd:Connectors", NAMESPACES)
        if outer is None:
            outer = etree.Element(f"{{{SSD}}}Connectors")
            system.insert(0, outer)
        connector(outer, shown, "output")
        ending = f"_{kind_of(action.port)}_sensor"
        before = [n for e in elements if (n := e.get("name", "")).endswith(ending) and n != name]
        source = {"Element": before[-1], "Connector": "y"} if before else port
        connect(wires, source, {"Element": name, "Connector": "u"})
        connect(wires, {"Element": name, "Connector": "y"}, {"Connector": shown})
        return
    other = "u" if action.where == "input" else "y"
    for wire in wires.findall("ssd:Connection", NAMESPACES):
        for end in ("start", "end"):
            if (wire.get(f"{end}Element", ""), wire.get(f"{end}Connector")) == tuple(port.values()):
                wire.set(f"{end}Element", name)
                wire.set(f"{end}Connector", other)
                wire.set("suppressUnitConversion", "true")
    inside = {"Element": name, "Connector": "y" if action.where == "input" else "u"}
    connect(wires, *((inside, port) if action.where == "input" else (port, inside)))


def state_unit(system: etree._Element, port: Port, unit: str) -> None:
    """Say at a component's connector in which unit its numbers are, where nothing says so and a wire told it before."""
    path = f"ssd:Elements/ssd:Component[@name='{port.component}']/ssd:Connectors/ssd:Connector[@name='{port.variable}']"
    own = system.find(path, NAMESPACES)
    if own is None or not unit:
        return
    kind = own.find("ssc:Real", NAMESPACES)
    if kind is None and len(own) == 0:
        kind = etree.SubElement(own, f"{{{SSC}}}Real")
    if kind is not None and not kind.get("unit"):
        kind.set("unit", unit)


def bind(element: etree._Element, values: Mapping[str, Value], label: str) -> None:
    """Bind values to a component, after those that it has: the last one counts."""
    bindings = element.find("ssd:ParameterBindings", NAMESPACES)
    if bindings is None:
        bindings = etree.Element(f"{{{SSD}}}ParameterBindings")
        ports = element.find("ssd:Connectors", NAMESPACES)
        element.insert(0 if ports is None else list(element).index(ports) + 1, bindings)
    binding = etree.SubElement(bindings, f"{{{SSD}}}ParameterBinding")
    inside = etree.SubElement(binding, f"{{{SSD}}}ParameterValues")
    inside.append(etree.fromstring(parameter_set(values, label)))


def parameter_set(values: Mapping[str, Value], label: str = FOUND) -> bytes:
    """A parameter set of values in the FMUs' units."""
    root = etree.Element(f"{{{SSV}}}ParameterSet", nsmap={"ssv": SSV, "ssc": SSC}, version="1.0", name=label)
    parent = etree.SubElement(root, f"{{{SSV}}}Parameters")
    for name, value in values.items():
        node = etree.SubElement(parent, f"{{{SSV}}}Parameter", name=name)
        kind = "Boolean" if isinstance(value, bool) else "Integer" if isinstance(value, int) else "Real"
        text = str(value).lower() if kind == "Boolean" else repr(value)
        etree.SubElement(node, f"{{{SSV}}}{kind}", value=text)
    return xml_bytes(root)
