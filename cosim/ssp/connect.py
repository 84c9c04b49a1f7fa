"""Connectors and connections of an IN_SSD, checked against the FMUs and turned into wires."""

from dataclasses import replace
from typing import NamedTuple

from lxml import etree

from cosim.errors import ModelError
from cosim.ssp.hints import did_you_mean
from cosim.ssp.parameters import linear
from cosim.ssp.quantities import UnitDefinition, agree, definition, from_xml
from cosim.ssp.system import NUMERIC, Component, Port, SystemInput, Variable, Wire, alike
from cosim.ssp.xml import IN_SSC, IN_SSD

_CAUSALITIES = {
    "input": "input",
    "output": "output",
    "parameter": "parameter",
    "calculatedParameter": "calculatedParameter",
}


_PLAIN = ("", "1", "-")
"""What exporters write as the unit where they know of none."""

WIDENING = ("Integer", "Real")
"""What a connection may change without loss; SSP leaves conversions to who implements it."""


class Connected(NamedTuple):
    """What `connect` finds, in the order that `System` takes it."""

    wires: tuple[Wire, ...]
    inputs: dict[str, SystemInput]
    outputs: dict[str, Port]
    parameters: dict[str, tuple[Port, ...]]


class _Connector(NamedTuple):
    kind: str
    type: str
    unit: str


def connect(
    system: etree._Element, components: dict[str, Component], problems: list[str], notes: list[str]
) -> Connected:
    """Wires and system connectors.

    Args:
        system: the System element.
        components: by name; where an FMU states no unit, its variable gets that of the connector here.
        problems: what is wrong is appended here.
        notes: what the user should know is appended here.
    """
    return _Wiring(system, components, problems, notes).read()


class _Wiring:
    def __init__(
        self,
        system: etree._Element,
        components: dict[str, Component],
        problems: list[str],
        notes: list[str],
    ) -> None:
        self.system, self.components, self.problems, self.notes = system, components, problems, notes
        node = system.getparent().find(f"{IN_SSD}Units") if system.getparent() is not None else None
        self.units: dict[str, UnitDefinition] = {} if node is None else from_xml(node, "the system's Units")
        self.wired = {
            Port(connection.get(f"{end}Element", ""), connection.get(f"{end}Connector", ""))
            for connection in system.iterfind(f"{IN_SSD}Connections/{IN_SSD}Connection")
            for end in ("start", "end")
        }
        self.connectors = {"": self.declared(system, "the system")}
        for element in system.iterfind(f"{IN_SSD}Elements/{IN_SSD}Component"):
            name = element.get("name", "")
            self.connectors[name] = self.declared(element, f"component '{name}'")
        self.wires: list[Wire] = []
        self.targets: dict[str, list[Wire]] = {
            n: [] for n, c in self.connectors[""].items() if c.kind == "input"
        }
        self.outputs: dict[str, Port] = {}
        self.parameters: dict[str, list[Port]] = {
            n: [] for n, c in self.connectors[""].items() if c.kind == "parameter"
        }
        self.fed: dict[Port, str] = {}

    def declared(self, element: etree._Element, what: str) -> dict[str, _Connector]:
        """Connectors of an element, checked against its FMU."""
        found: dict[str, _Connector] = {}
        for connector in element.iterfind(f"{IN_SSD}Connectors/{IN_SSD}Connector"):
            name = connector.get("name", "")
            if name in found:
                self.problems.append(f"{what} has two connectors named '{name}'")
            kind, unit = "", ""
            for child in connector:
                if isinstance(child.tag, str) and child.tag.startswith(IN_SSC):
                    kind, unit = etree.QName(child).localname, child.get("unit", "")
            found[name] = _Connector(connector.get("kind", ""), kind, unit)
            if element is not self.system:
                self.check_connector(element.get("name", ""), name, found[name])
        return found

    def check_connector(self, component: str, name: str, connector: _Connector) -> None:
        fmu = self.components[component].fmu
        variable = fmu.variables.get(name)
        if variable is None:
            hint = did_you_mean(name, fmu.variables)
            text = f"connector {component}.{name}: {fmu.source} has no such variable"
            if Port(component, name) in self.wired:
                self.problems.append(text + hint)
            else:  # Dymola writes its own settings so, such as fmi_StartTime
                self.notes.append(f"{text}{hint}; nothing is connected to it, and it is left out")
            return
        if connector.kind in _CAUSALITIES and variable.causality != connector.kind:
            self.problems.append(
                f"connector {component}.{name} is of kind {connector.kind}, but the FMU's variable is a {variable.causality}"
            )
        # Binary is what SSP leaves to others to read (Dymola: text/x-modelica; path=Modelica.Units.SI.Time)
        if connector.type not in ("", "Binary") and alike(connector.type) != alike(variable.kind):
            text = f"connector {component}.{name} is of type {connector.type}, but the FMU's variable is {variable.kind}"
            if (alike(variable.kind), alike(connector.type)) == WIDENING:
                self.notes.append(f"{text}, which is handed on")
            else:
                self.problems.append(text)
        if not agree(connector.unit, self.units, variable.unit, fmu.units):
            self.problems.append(
                f"connector {component}.{name} is in '{connector.unit}', but its variable in '{variable.unit}': correct it"
            )
        self.adopt(Port(component, name), connector.unit)

    def adopt(self, port: Port, unit: str) -> None:
        """Give a variable of which the FMU states no unit the one that the package states."""
        part = self.components[port.component]
        variable = part.fmu.variables[port.variable]
        meant = definition(unit, self.units)
        if variable.unit or variable.kind != "Real" or unit in _PLAIN or meant is None:
            return
        known = {**part.fmu.variables, port.variable: replace(variable, unit=unit)}
        fmu = replace(part.fmu, variables=known, units={unit: meant, **part.fmu.units})
        self.components[port.component] = replace(part, fmu=fmu)

    def read(self) -> Connected:
        for connection in self.system.iterfind(f"{IN_SSD}Connections/{IN_SSD}Connection"):
            ends = [
                Port(connection.get(f"{end}Element", ""), connection.get(f"{end}Connector", ""))
                for end in ("start", "end")
            ]
            label = " -> ".join(str(p) if p.component else p.variable for p in ends)
            known = [self.known(port, label) for port in ends]
            if all(known):
                try:
                    self.add(connection, ends[0], ends[1], label)
                except ModelError as error:
                    self.problems.append(str(error))
        for name in [
            n for n, c in self.connectors[""].items() if c.kind == "output" and n not in self.outputs
        ]:
            self.notes.append(f"output '{name}' of the system is not connected and is left out")
        inputs = {n: self.system_input(n, targets) for n, targets in self.targets.items()}
        return Connected(
            tuple(self.wires), inputs, self.outputs, {n: tuple(ports) for n, ports in self.parameters.items()}
        )

    def known(self, port: Port, label: str) -> bool:
        if port.component not in self.connectors:
            hint = did_you_mean(port.component, self.components)
            self.problems.append(f"connection {label}: there is no component '{port.component}'{hint}")
        elif port.variable not in self.connectors[port.component]:
            where = f"component '{port.component}'" if port.component else "the system"
            hint = did_you_mean(port.variable, self.connectors[port.component])
            self.problems.append(f"connection {label}: {where} has no connector '{port.variable}'{hint}")
        else:
            return True
        return False

    def add(self, connection: etree._Element, start: Port, end: Port, label: str) -> None:
        """One connection, in whichever direction it is drawn: start and end are not source and target (SSP 1.0, 5.3.2)."""
        what = f"connection {label}"
        factor, offset = linear(connection, what)
        checked = connection.get("suppressUnitConversion", "false") not in ("true", "1")
        if start.component and end.component:
            self.add_wire(start, end, factor, offset, checked, what)
        elif start.component or end.component:
            outer, inner = (start, end) if end.component else (end, start)
            self.add_outer(outer, inner, factor, offset, checked, what)
        else:
            raise ModelError(f"{what} joins two connectors of the system itself, which is not supported")

    def add_wire(
        self, start: Port, end: Port, factor: float, offset: float, checked: bool, what: str
    ) -> None:
        kinds = (
            self.connectors[start.component][start.variable].kind,
            self.connectors[end.component][end.variable].kind,
        )
        if kinds == ("input", "output"):
            start, end = end, start
        elif kinds != ("output", "input"):
            raise ModelError(
                f"{what} joins kinds {kinds[0]} and {kinds[1]}: only output and input can be connected"
            )
        source, target = self.variable(start), self.variable(end)
        if source is None or target is None:
            return  # said already, at the connector
        self.numbers(what, source, (factor, offset))
        types = alike(source.kind), alike(target.kind)
        if types == WIDENING:
            self.notes.append(f"{what} hands a whole number on as a Real")
        elif types[0] != types[1]:
            raise ModelError(
                f"{what} joins the types {source.kind} and {target.kind}: put a component between them that converts"
            )
        fmus = self.components[start.component].fmu, self.components[end.component].fmu
        if checked and not agree(source.unit, fmus[0].units, target.unit, fmus[1].units):
            raise ModelError(
                f"{what}: units '{source.unit}' and '{target.unit}' differ, and masters convert differently: make them equal"
            )
        self.feed(end, str(start))
        self.wires.append(Wire(start, end, factor, offset))

    def add_outer(
        self, outer: Port, inner: Port, factor: float, offset: float, checked: bool, what: str
    ) -> None:
        connector = self.connectors[""][outer.variable]
        kind, inner_kind = connector.kind, self.connectors[inner.component][inner.variable].kind
        if kind != inner_kind:
            raise ModelError(
                f"{what} joins the system's {kind} with a component's {inner_kind}: they must be the same"
            )
        variable = self.variable(inner)
        if variable is None:
            return
        if checked and not agree(
            connector.unit, self.units, variable.unit, self.components[inner.component].fmu.units
        ):
            raise ModelError(
                f"{what}: units '{connector.unit}' and '{variable.unit}' differ: give both ends the same"
            )
        if (factor, offset) == (1.0, 0.0):
            self.adopt(inner, connector.unit)
        if kind == "input":
            self.numbers(what, variable, (factor, offset))
            self.feed(inner, f"system input '{outer.variable}'")
            self.targets[outer.variable].append(Wire(outer, inner, factor, offset))
            return
        if (factor, offset) != (1.0, 0.0):
            raise ModelError(
                f"{what}: a transformation is supported between components and at system inputs only"
            )
        if kind == "output":
            if outer.variable in self.outputs:
                raise ModelError(
                    f"{what}: the system's output has two sources, {self.outputs[outer.variable]} and {inner}"
                )
            self.outputs[outer.variable] = inner
        elif kind == "parameter":
            self.parameters[outer.variable].append(inner)

    @staticmethod
    def numbers(what: str, variable: Variable, transformation: tuple[float, float]) -> None:
        """Refuse a connection of texts, and one of whole numbers that changes them."""
        if variable.kind not in NUMERIC:
            raise ModelError(f"{what}: '{variable.name}' is a {variable.kind}; only numbers can be connected")
        if variable.kind != "Real" and transformation != (1.0, 0.0):
            raise ModelError(
                f"{what}: '{variable.name}' is of type {variable.kind} and cannot be transformed"
            )

    def variable(self, port: Port) -> Variable | None:
        return self.components[port.component].fmu.variables.get(port.variable)

    def feed(self, target: Port, source: str) -> None:
        if target in self.fed:
            raise ModelError(
                f"input {target} has two sources, {self.fed[target]} and {source}: remove one connection"
            )
        self.fed[target] = source

    def system_input(self, name: str, targets: list[Wire]) -> SystemInput:
        unit = self.connectors[""][name].unit
        if not unit and targets:
            unit = self.components[targets[0].target.component].fmu.variables[targets[0].target.variable].unit
        return SystemInput(name, unit, tuple(targets))
