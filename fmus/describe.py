"""The model description and the documentation page of an FMU, from the declarations of its block."""

import hashlib
import uuid
from collections.abc import Collection, Iterable, Mapping, Sequence

from lxml import etree
from lxml.builder import E

from cosim.units import base_exponents, factor
from fmus.compose import Composed
from fmus.contract import UNBOUNDED, Variable
from fmus.dependencies import at_start

GENERATION_DATE = "2026-01-01T00:00:00Z"  # fixed: the same content gives the same bytes
VERSION = "1.0"
TOLERANCE = "1e-06"  # of a solver in model exchange; in co-simulation a step is as exact as it is


def number(value: float, variable: Variable) -> str:
    """A number as FMI writes it: shortest text that reads back as the same value; whole for Integer variables."""
    return str(int(value)) if variable.kind == "integer" else repr(float(value))


def unit_definitions(variables: Iterable[Variable]) -> etree._Element:
    """UnitDefinitions of all units and display units in use."""
    displays: dict[str, set[str]] = {}
    for variable in variables:
        shown = displays.setdefault(variable.unit, set())
        if variable.display:
            shown.add(variable.display)
    root = etree.Element("UnitDefinitions")
    for unit in sorted(displays):
        exponents, scale = base_exponents(unit)
        base = {name: str(power) for name, power in sorted(exponents.items())}
        if scale != 1.0:
            base["factor"] = repr(scale)
        node = E.Unit(E.BaseUnit(**base), name=unit)
        for display in sorted(displays[unit]):
            node.append(E.DisplayUnit(name=display, factor=repr(factor(unit, display))))
        root.append(node)
    return root


TOOL, AT_START = "slew-cosim", "start"  # of a vendor annotation that says how an input is read


def scalar_variable(
    name: str, reference: int, causality: str, variable: Variable, start: float
) -> etree._Element:
    """One ScalarVariable: explicit variability; start on inputs and parameters only; outputs are calculated."""
    attributes = {
        "name": name,
        "valueReference": str(reference),
        "description": variable.text,
        "causality": causality,
    }
    value: dict[str, str] = {}
    if causality == "parameter":
        attributes |= {"variability": "fixed", "initial": "exact"}
    else:
        discrete = variable.discrete or variable.kind == "integer"
        attributes["variability"] = "discrete" if discrete else "continuous"
        if causality == "output":
            attributes["initial"] = "calculated"
    kind = "Integer" if variable.kind == "integer" else "Real"
    if kind == "Real":
        value["unit"] = variable.unit
        if variable.display:
            value["displayUnit"] = variable.display
        if variable.nominal != 1.0:
            value["nominal"] = repr(variable.nominal)
    if variable.low > -UNBOUNDED:
        value["min"] = number(variable.low, variable)
    if variable.high < UNBOUNDED:
        value["max"] = number(variable.high, variable)
    if causality != "output":
        value["start"] = number(start, variable)
    return E.ScalarVariable(etree.Element(kind, value), **attributes)


def table(composed: Composed) -> list[tuple[str, str, Variable]]:
    """(name, causality, declaration) of every FMI variable; the position is its value reference."""
    return (
        [(n, "input", v) for n, v in composed.inputs.items()]
        + [(n, "output", v) for n, v in composed.outputs.items()]
        + [(n, "parameter", v) for n, v in composed.parameters.items()]
    )


def model_description(composed: Composed, starts: Mapping[str, float], content: bytes) -> etree._Element:
    """The modelDescription of a composed block.

    Args:
        composed: the block with its effects.
        starts: start value of each parameter and input that differs from its declaration, in its unit.
        content: everything else that makes the FMU what it is; the GUID follows from it and from the description.
    """
    block = composed.block
    return described(
        block.name,
        block.title,
        table(composed),
        block.feedthrough,
        at_start(composed),
        starts,
        content,
        block.step_size,
        begins=[n for n in composed.inputs if block.reads.get(n) == "start"],
    )


def described(
    name: str,
    title: str,
    rows: Sequence[tuple[str, str, Variable]],
    feedthrough: Mapping[str, tuple[str, ...]],
    initial: Mapping[str, Collection[str]],
    starts: Mapping[str, float],
    content: bytes,
    step_size: float,
    tool: str = "slew-cosim with pythonfmu",
    sources: Sequence[str] = (),
    begins: Sequence[str] = (),
) -> etree._Element:
    """The modelDescription of anything with these variables.

    Args:
        name: model identifier.
        title: one line for people.
        rows: (name, causality, declaration) of every variable; the position is its value reference.
        feedthrough: outputs that depend directly on an input, with those inputs.
        initial: inputs and parameters on which each output depends at initialisation.
        starts: start values that differ from the declarations.
        content: everything else that makes the FMU what it is.
        step_size: default communication step, s.
        tool: what made the FMU.
        sources: C files to compile; an FMU of ours that has them uses derivatives of its inputs.
        begins: inputs of which a step takes the value at its start: our master then hands over that one.
    """
    variables = E.ModelVariables()
    for reference, (own, causality, variable) in enumerate(rows):
        variables.append(
            scalar_variable(own, reference, causality, variable, starts.get(own, variable.start))
        )
    root = etree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=name,
        guid="",
        description=title,
        version=VERSION,
        generationTool=tool,
        generationDateAndTime=GENERATION_DATE,
        variableNamingConvention="structured",
    )
    root.append(co_simulation(name, sources))
    root.append(unit_definitions(v for _, _, v in rows))
    categories = E.LogCategories()
    for category in ("logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal", "logAll"):
        categories.append(E.Category(name=category))
    root.append(categories)
    root.append(
        E.DefaultExperiment(startTime="0", stopTime="10", tolerance=TOLERANCE, stepSize=repr(step_size))
    )
    if begins:
        told = E.Tool(*(E.Input(name=own, taken=AT_START) for own in begins), name=TOOL)
        root.append(E.VendorAnnotations(told))
    root.append(variables)
    root.append(structure(rows, feedthrough, initial))
    root.set("guid", f"{{{uuid.UUID(hashlib.sha256(etree.tostring(root) + content).hexdigest()[:32])}}}")
    return root


def co_simulation(name: str, sources: Sequence[str]) -> etree._Element:
    """What the FMU can do as a co-simulation slave."""
    flags = {"canHandleVariableCommunicationStepSize": "true", "canInterpolateInputs": "true" if sources else "false",
             "canBeInstantiatedOnlyOncePerProcess": "false", "canNotUseMemoryManagementFunctions": "true",
             "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true", "needsExecutionTool": "false"}  # fmt: skip
    slave = etree.Element("CoSimulation", modelIdentifier=name, **flags)
    if sources:
        slave.append(E.SourceFiles(*(E.File(name=file) for file in sources)))
    return slave


def structure(
    rows: Sequence[tuple[str, str, Variable]],
    feedthrough: Mapping[str, tuple[str, ...]],
    initial: Mapping[str, Collection[str]],
) -> etree._Element:
    """Outputs, with the inputs that they depend on directly, and with what they depend on at initialisation.

    An empty list means that there are none; without a list a master has to assume all, and sees loops that there are not.
    """
    index = {own: i + 1 for i, (own, _, _) in enumerate(rows)}
    outputs, unknowns = E.Outputs(), E.InitialUnknowns()
    for output in [own for own, causality, _ in rows if causality == "output"]:
        outputs.append(unknown(index[output], [index[i] for i in feedthrough.get(output, ())]))
        unknowns.append(unknown(index[output], [index[i] for i in initial[output]]))
    return E.ModelStructure(outputs, unknowns)


def unknown(index: int, dependencies: Iterable[int]) -> etree._Element:
    """An entry of ModelStructure."""
    return E.Unknown(index=str(index), dependencies=" ".join(map(str, sorted(dependencies))))


READS = {
    "held": "{names}: held. The value set before a step from t to t + h acts from t to t + h (zero-order hold).",
    "line": "{names}: a straight line. The value set before a step from t to t + h is taken as that at t + h, joined to that of "
    "the step before.",
    "start": "{names}: the value set before a step from t to t + h is taken as that at t, from which it goes on in the straight "
    "line of the step before. A wire that closes a loop brings just that.",
    "instant": "{names}: as it is. The value set before a step from t to t + h is taken as that at t + h.",
}
LATE = (
    "A master that steps the components in the order of the wires hands over the value that is meant. One that exchanges all "
    "values between the steps (Jacobi, as simulate_ssp of fmpy, ecos and libcosim do) hands over the value at t of every "
    "continuous output: each wire from such an output to {names} then lags by one step."
)


def over_a_step(composed: Composed) -> list[str]:
    """Which step convention inputs and outputs follow, one sentence each."""
    block = composed.block
    said = []
    for way, text in READS.items():
        names = ", ".join(name for name in composed.inputs if block.reads.get(name) == way)
        if names:
            said.append(text.format(names=names))
    for discrete, text in (
        (False, "{names}: read after the step, the value at t + h."),
        (True, "{names}: read after the step, the value that is held over the step that follows."),
    ):
        names = ", ".join(name for name, v in composed.outputs.items() if v.discrete == discrete)
        if names:
            said.append(text.format(names=names))
    late = [name for name in composed.inputs if block.reads.get(name) != "start"]
    if late:
        said.append(LATE.format(names=", ".join(late)))
    return said


def documentation(composed: Composed, starts: Mapping[str, float]) -> bytes:
    """The documentation page (HTML): equations, variables, effects."""
    block = composed.block
    body = E.body(
        E.h1(block.title), E.img(src="../model.png", alt=block.title), E.pre(block.module.__doc__ or "")
    )
    headings = ("name", "causality", "unit", "start", "from", "to", "meaning", "source")
    rows = [E.tr(*(E.th(h) for h in headings))]
    for name, causality, v in table(composed):
        start = "" if causality == "output" else f"{starts.get(name, v.start):.10g}"
        low, high = (f"{b:g}" if abs(b) < UNBOUNDED else "" for b in (v.low, v.high))
        rows.append(E.tr(*(E.td(t) for t in (name, causality, v.unit, start, low, high, v.text, v.source))))
    body.append(E.table(*rows, border="1"))
    body.append(E.h2("A step"))
    body.extend(E.p(text) for text in over_a_step(composed))
    for effect in composed.effects:
        body.append(E.h2(effect.name))
        body.append(
            E.p(f"{effect.text} Off at {effect.key} = its start value. In the data: {effect.residual}")
        )
    page = E.html(E.head(E.meta(charset="utf-8"), E.title(block.title)), body)
    text: bytes = etree.tostring(
        page, method="html", encoding="utf-8", doctype="<!DOCTYPE html>", pretty_print=True
    )
    return text
