"""Small FMUs by strangers (plain pythonfmu slaves), and SSPs around them: the master must run what it did not build."""

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from benchmarks.systems.parts import by_pythonfmu
from cosim import trust

# every slave: units on all Reals, direct dependencies of its outputs, value of x as register("x", causality) declares
HEAD = """
from xml.etree.ElementTree import SubElement
from pythonfmu.enums import Fmi2Status
from pythonfmu import Boolean, Fmi2Causality as C, Fmi2Initial, Fmi2Slave
from pythonfmu import Fmi2Variability as V, Integer, Real, String


class {name}(Fmi2Slave):
    units = {{}}
    direct = None  # names of the inputs the outputs depend on directly

    def declare(self, **variables):
        for name, (kind, causality, variability, value) in variables.items():
            setattr(self, name, value)
            self.register_variable(kind(name, causality=causality, variability=variability))

    def to_xml(self, model_options=dict()):
        root = super().to_xml(model_options)
        names = [v.name for v in self.vars.values()]
        definitions = SubElement(root, "UnitDefinitions")
        root.remove(definitions)
        root.insert(1, definitions)
        for unit, base in {{"m": {{"m": "1"}}, "mm": {{"m": "1", "factor": "0.001"}}, "1": {{}}}}.items():
            SubElement(SubElement(definitions, "Unit", name=unit), "BaseUnit", base)
        for variable in root.iter("ScalarVariable"):
            if variable.get("name") in self.units:
                variable.find("Real").set("unit", self.units[variable.get("name")])
        if self.direct is not None:
            for unknown in root.iter("Unknown"):
                unknown.set("dependencies", " ".join(str(names.index(n) + 1) for n in self.direct))
        initial = SubElement(root.find("ModelStructure"), "InitialUnknowns")
        for unknown in root.findall("ModelStructure/Outputs/Unknown"):
            SubElement(initial, "Unknown", unknown.attrib)
        return root

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
"""

BODIES = {
    # y = a sin(w t) at the end of the step
    "wave": """
        self.declare(a=(Real, C.parameter, V.fixed, 1.0), w=(Real, C.parameter, V.fixed, 1.0),
                     y=(Real, C.output, V.continuous, 0.0))

    def do_step(self, t, h):
        import math
        self.y = self.a * math.sin(self.w * (t + h))
        return True
""",
    # a staircase: y = number of the step that begins at this time; held between communication points
    "stairs": """
        self.declare(period=(Real, C.parameter, V.fixed, 0.1), y=(Real, C.output, V.discrete, 0.0))

    def do_step(self, t, h):
        self.y = float(int((t + h) / self.period + 1e-9))
        return True
""",
    "gain": """
        self.direct = ["u"]
        self.units = {"u": "m", "y": "m"}
        self.declare(k=(Real, C.parameter, V.fixed, 2.0), n=(Integer, C.parameter, V.fixed, 1),
                     on=(Boolean, C.parameter, V.fixed, True), label=(String, C.parameter, V.fixed, "plain"),
                     u=(Real, C.input, V.continuous, 0.0), y=(Real, C.output, V.continuous, 0.0))

    def exit_initialization_mode(self):
        self.y = self.n * self.k * self.u if self.on else 0.0
        if self.label != "plain":
            self.log("label is " + self.label)

    def do_step(self, t, h):
        self.exit_initialization_mode()
        return True
""",
    # T y' = u - y, exact for the straight line from the previous input to the new one
    "lag": """
        self.direct = []
        self.units = {"u": "m", "y": "m"}
        self.last = None
        self.declare(T=(Real, C.parameter, V.fixed, 0.5), start=(Real, C.parameter, V.fixed, 0.0),
                     u=(Real, C.input, V.continuous, 0.0), y=(Real, C.output, V.continuous, 0.0))

    def exit_initialization_mode(self):
        self.y = self.start
        self.last = self.u

    def do_step(self, t, h):
        import math
        z = h / self.T
        e = math.exp(-z)
        slope = (self.u - self.last) / z
        self.y = e * self.y + (1.0 - e) * self.last + slope * (z - 1.0 + e)
        self.last = self.u
        return True
""",
    # x' = u with the straight line from the previous input to the new one
    "integrator": """
        self.direct = []
        self.last = 0.0
        self.declare(start=(Real, C.parameter, V.fixed, 0.0), u=(Real, C.input, V.continuous, 0.0),
                     y=(Real, C.output, V.continuous, 0.0))

    def exit_initialization_mode(self):
        self.y = self.start
        self.last = self.u

    def do_step(self, t, h):
        self.y += 0.5 * h * (self.last + self.u)
        self.last = self.u
        return True
""",
    # y = k u + c in initialisation mode too: an algebraic loop with another of its kind
    "affine": """
        self.direct = ["u"]
        self.value = 0.0
        self.declare(k=(Real, C.parameter, V.fixed, 0.5), c=(Real, C.parameter, V.fixed, 1.0),
                     u=(Real, C.input, V.continuous, 0.0))
        self.register_variable(Real("y", causality=C.output, getter=lambda: self.k * self.u + self.c))

    def do_step(self, t, h):
        return True
""",
    # y = how often the input was set
    "counter": """
        self.declare(u=(Real, C.input, V.continuous, 0.0), y=(Real, C.output, V.continuous, 0.0))

    def set_real(self, refs, values):
        self.y += 1.0

    def do_step(self, t, h):
        return True
""",
    # ends as asked: a refused parameter, discarded steps, an exception
    # a lag behind a gear box with a clutch; tells the gear and whether it moves
    "gearbox": """
        self.declare(u=(Real, C.input, V.continuous, 0.0), gear=(Integer, C.input, V.discrete, 1),
                     on=(Boolean, C.input, V.discrete, True), y=(Real, C.output, V.continuous, 0.0),
                     shown=(Integer, C.output, V.discrete, 0), moves=(Boolean, C.output, V.discrete, False))

    def do_step(self, t, h):
        import math
        new = self.gear * self.u if self.on else 0.0
        self.y += (1.0 - math.exp(-h / 0.2)) * (new - self.y)
        self.shown, self.moves = self.gear, abs(self.y) > 0.5
        return True
""",
    "grumbler": """
        self.declare(limit=(Real, C.parameter, V.fixed, 1.0), refuse_at=(Real, C.parameter, V.fixed, 1e9),
                     raise_at=(Real, C.parameter, V.fixed, 1e9), u=(Real, C.input, V.continuous, 0.0),
                     y=(Real, C.output, V.continuous, 0.0), forget_at=(Real, C.parameter, V.fixed, 1e9))

    def set_real(self, refs, values):
        for r, v in zip(refs, values):
            if r == 0 and v < 0.0:
                self.log(f"limit = {v} is refused: it must not be negative", Fmi2Status.error)
                continue
            self.vars[r].setter(v)

    def do_step(self, t, h):
        if t >= self.raise_at:
            raise RuntimeError("the grumbler fell over")
        if t >= self.refuse_at:
            self.log("the grumbler will not go on", Fmi2Status.error)
            return False
        self.y = t + h
        return True if t < self.forget_at else None
""",
}


def build(kind: str, folder: Path, name: str | None = None) -> Path:
    """Build one of BODIES as ``folder/kind.fmu``, in a process of its own; its module gets a name no other test uses."""
    name = name or f"toy_{kind}"
    built = by_pythonfmu(name, HEAD.format(name=name) + BODIES[kind], folder)
    target = folder / f"{kind}.fmu"
    built.rename(target)
    # what the tests of the loop need to run it in their own process
    trust.remember(target)
    return target


Ends = tuple[str, str]


def ssd(
    components: Mapping[str, str],
    connections: Sequence[str],
    *,
    kinds: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    inside: Mapping[str, str] | None = None,
    extra: str = "",
    connection_extra: Mapping[str, str] | None = None,
    system_bindings: str = "",
    stop: float = 1.0,
) -> str:
    """An SSD: components name -> FMU kind, connections ``"a.y -> b.u"`` (no dot: a connector of the system).

    Args:
        components: name -> kind (file resources/kind.fmu).
        connections: as text.
        kinds: kind of a connector, where it is neither ``y`` (output) nor anything else (input).
        units: unit of a connector by ``component.name``.
        inside: XML put inside a component, after its connectors.
        extra: XML put behind the elements.
        connection_extra: XML put inside a connection, by its text.
        system_bindings: XML of the system's own ParameterBindings.
        stop: of the default experiment.
    """
    ends = [tuple(end.strip() for end in c.split("->")) for c in connections]
    connectors: dict[str, dict[str, str]] = {name: {} for name in ("", *components)}
    for start, end in ends:
        for port, outer_kind in ((start, "input"), (end, "output")):
            owner, _, variable = port.rpartition(".")
            kind = outer_kind if not owner else ("output" if variable == "y" else "input")
            connectors.setdefault(owner, {})[variable] = (kinds or {}).get(port, kind)
    parts = []
    for name, kind in components.items():
        body = _connectors(name, connectors[name], units or {}) + (inside or {}).get(name, "")
        parts.append(
            f"<ssd:Component name={quoteattr(name)} source='resources/{kind}.fmu'>{body}</ssd:Component>"
        )
    wires = []
    for text, (start, end) in zip(connections, ends, strict=True):
        attributes = ""
        for label, port in (("start", start), ("end", end)):
            owner, _, variable = port.rpartition(".")
            attributes += f" {label}Element={quoteattr(owner)}" if owner else ""
            attributes += f" {label}Connector={quoteattr(variable)}"
        wires.append(f"<ssd:Connection{attributes}>{(connection_extra or {}).get(text, '')}</ssd:Connection>")
    joined = f"<ssd:Connections>{''.join(wires)}</ssd:Connections>" if wires else ""
    outer = _connectors("", connectors[""], units or {})
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="toy"
 xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
 xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
<ssd:System name="toy">{outer}{system_bindings}<ssd:Elements>{"".join(parts)}</ssd:Elements>{joined}{extra}</ssd:System>
<ssd:Units><ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>
<ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit></ssd:Units>
<ssd:DefaultExperiment startTime="0" stopTime="{stop}"/></ssd:SystemStructureDescription>"""


def _connectors(owner: str, kinds: Mapping[str, str], units: Mapping[str, str]) -> str:
    nodes = []
    for variable, kind in kinds.items():
        unit = units.get(f"{owner}.{variable}" if owner else variable)
        real = f"<ssc:Real unit='{unit}'/>" if unit else "<ssc:Real/>"
        nodes.append(f"<ssd:Connector name={quoteattr(variable)} kind='{kind}'>{real}</ssd:Connector>")
    return f"<ssd:Connectors>{''.join(nodes)}</ssd:Connectors>" if nodes else ""


def ssv(
    values: Mapping[str, float | str], name: str = "nominal", unit: Mapping[str, str] | None = None
) -> str:
    """A parameter set; text values are written as they are (``Integer value='2'``), numbers as Reals."""
    rows = []
    for key, value in values.items():
        u = f" unit='{(unit or {})[key]}'" if key in (unit or {}) else ""
        item = value if isinstance(value, str) else f"Real value='{value!r}'{u}"
        rows.append(f"<ssv:Parameter name='{key}'><ssv:{item}/></ssv:Parameter>")
    return (
        "<ssv:ParameterSet xmlns:ssv='http://ssp-standard.org/SSP1/SystemStructureParameterValues' version='1.0'"
        f" name='{name}'>"
        f"<ssv:Parameters>{''.join(rows)}</ssv:Parameters></ssv:ParameterSet>"
    )


def binding(values: str, prefix: str = "") -> str:
    """Inline ParameterBindings around a parameter set."""
    p = f" prefix='{prefix}'" if prefix else ""
    return (
        f"<ssd:ParameterBindings><ssd:ParameterBinding{p}><ssd:ParameterValues>{values}</ssd:ParameterValues>"
        "</ssd:ParameterBinding></ssd:ParameterBindings>"
    )


def pack(
    path: Path, description: str, fmus: Mapping[str, Path], files: Mapping[str, str | bytes] | None = None
) -> Path:
    """An SSP of a description, the FMUs (kind -> file) and further files."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", description)
        for kind, file in fmus.items():
            archive.write(file, f"resources/{kind}.fmu")
        for name, content in (files or {}).items():
            archive.writestr(name, content)
    return path
