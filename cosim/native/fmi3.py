"""What an FMU of FMI 3.0 says in other words than one of FMI 2.0: its description, made from that one, and its terminals."""

import hashlib
import uuid

from lxml import etree
from lxml.builder import E

from cosim.native.model import Model
from fmus.contract import Variable
from fmus.describe import unit_definitions

TYPES = {"Real": "Float64", "Integer": "Int32"}
STRUCTURE = {
    "Outputs": "Output",
    "Derivatives": "ContinuousStateDerivative",
    "InitialUnknowns": "InitialUnknown",
}
TIME = Variable("s", "Time")
SHARED = (
    "needsExecutionTool",
    "canBeInstantiatedOnlyOncePerProcess",
    "canHandleVariableCommunicationStepSize",
)
# steps end where they are asked to, and inputs are taken at their ends: nothing happens within a step that a host could use
NOT_PROVIDED = (
    "providesIntermediateUpdate",
    "mightReturnEarlyFromDoStep",
    "canReturnEarlyAfterIntermediateUpdate",
    "hasEventMode",
)


def description(root: etree._Element, model: Model, content: bytes) -> etree._Element:
    """The model description of FMI 3.0 that says what one of FMI 2.0 says, and what only 3.0 has: the time as a variable.

    Value references stay those of FMI 2.0; the time comes behind all others.

    Args:
        root: of FMI 2.0, with whole lists of dependencies; it is used up.
        model: what it describes.
        content: everything else that makes the FMU what it is; the instantiation token follows from it.
    """
    nodes = list(root.find("ModelVariables"))
    time = len(nodes)
    if any(n.get("name") == "time" for n in nodes):
        raise ValueError(f"{model.name} has a variable 'time', which in FMI 3.0 is that of the time")
    made = etree.Element("fmiModelDescription", fmiVersion="3.0", instantiationToken="")
    for name, value in root.items():
        if name not in ("fmiVersion", "guid"):
            made.set(name, value)
    made.extend(kind(node) for node in root if node.tag in ("ModelExchange", "CoSimulation"))
    units = root.find("UnitDefinitions")
    if not any(u.get("name") == TIME.unit for u in units):
        units.extend(unit_definitions([TIME]))
    made.extend([units, root.find("LogCategories"), root.find("DefaultExperiment")])
    clock = {
        "name": "time",
        "valueReference": str(time),
        "causality": "independent",
        "variability": "continuous",
    }
    variables = E.ModelVariables(etree.Element("Float64", clock, description=TIME.text, unit=TIME.unit))
    variables.extend(variable(node) for node in nodes)
    indicators = [str(time + 1 + k) for k in range(int(made.attrib.pop("numberOfEventIndicators", "0")))]
    variables.extend(indicator(k, reference) for k, reference in enumerate(indicators, 1))
    made.append(variables)
    outputs = {str(k) for k, n in enumerate(nodes) if n.get("name") in model.timed}
    structure = E.ModelStructure()
    for section in root.find("ModelStructure"):
        structure.extend(unknown(node, STRUCTURE[section.tag], time, outputs) for node in section)
    structure.extend(etree.Element("EventIndicator", valueReference=reference) for reference in indicators)
    made.append(structure)
    if (own := root.find("VendorAnnotations")) is not None:
        made.append(E.Annotations(*(E.Annotation(*tool, type=tool.get("name")) for tool in own)))
    token = hashlib.sha256(etree.tostring(made) + content).hexdigest()
    made.set("instantiationToken", f"{{{uuid.UUID(token[:32])}}}")
    return made


def kind(node: etree._Element) -> etree._Element:
    """What the FMU can do for co-simulation or for model exchange."""
    made = etree.Element(node.tag, modelIdentifier=node.get("modelIdentifier"))
    for name in SHARED:
        if node.get(name) is not None:
            made.set(name, node.get(name))
    made.set("canGetAndSetFMUState", node.get("canGetAndSetFMUstate"))
    made.set("canSerializeFMUState", node.get("canSerializeFMUstate"))
    if node.tag == "CoSimulation":
        for name in NOT_PROVIDED:
            made.set(name, "false")
    else:
        for name in ("providesDirectionalDerivatives", "providesAdjointDerivatives"):
            made.set(name, node.get("providesDirectionalDerivative"))
        made.set("needsCompletedIntegratorStep", "false")
    return made


def variable(node: etree._Element) -> etree._Element:
    """A variable; one that is a derivative names its state by value reference."""
    made = etree.Element(TYPES[node[0].tag], dict(node.items()) | dict(node[0].items()))
    if made.get("derivative") is not None:
        made.set("derivative", str(int(made.get("derivative")) - 1))
    return made


def indicator(number: int, reference: str) -> etree._Element:
    """The variable of an event indicator, which FMI 3.0 wants to see."""
    made = {"name": f"event.indicator_{number}", "valueReference": reference, "causality": "local"}
    return etree.Element(
        "Float64", made, variability="continuous", description="What an event makes negative"
    )


def unknown(node: etree._Element, name: str, time: int, timed: set[str]) -> etree._Element:
    """An entry of ModelStructure, by value references; an output on which the time acts depends on it too."""
    reference = str(int(node.get("index")) - 1)
    known = [str(int(k) - 1) for k in node.get("dependencies").split()]
    known += [str(time)] if reference in timed else []
    return etree.Element(name, valueReference=reference, dependencies=" ".join(known))


def terminals(model: Model, drawn: bool) -> bytes:
    """terminalsAndIcons.xml: inputs and outputs as buses, and that icon.png beside it is the picture if the model is drawn.

    What one block gives and another takes has the same name, so that hosts can connect blocks bus by bus.
    """
    buses = E.Terminals()
    for name, causality in (("inputs", "input"), ("outputs", "output")):
        members = [
            E.TerminalMemberVariable(variableName=n, memberName=n, variableKind="signal")
            for n, _ in model.of(causality)
        ]
        if members:
            buses.append(E.Terminal(*members, name=name, matchingRule="bus"))
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    shape = E.GraphicalRepresentation(E.CoordinateSystem(**corners, suggestedScalingFactorTo_mm="0.1"))
    if drawn:
        shape.append(E.Icon(**corners))
    root = E.fmiTerminalsAndIcons(shape, buses, fmiVersion="3.0")
    text: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True, pretty_print=True)
    return text
