"""The parts as FMUs (C by the compiler on the path, or plain pythonfmu) and systems of them as packages."""

import shutil
import subprocess
import sys
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import fmpy

HERE = Path(__file__).resolve().parent
COMPILER = shutil.which("cc")
KINDS = ("lag", "second", "saturating", "damped", "sum", "stiffening")
NUMBERS = {"K": 3, "T": 4, "W": 5, "ZETA": 6, "C": 7}
USES = {
    "lag": ("K", "T"),
    "second": ("K", "W", "ZETA"),
    "saturating": ("K", "T", "C"),
    "damped": ("K", "T", "C"),
    "sum": ("K", "C", "T"),
    "stiffening": ("K", "W", "ZETA", "C"),
}

SCRIPT = """from math import tanh

from pythonfmu import Fmi2Causality as Causality, Fmi2Slave, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x, self.v = 0.0, 0.0
        for name in {inputs}:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Causality.input))
        for name, value in {values}.items():
            setattr(self, name, value)
            self.register_variable(Real(name, causality=Causality.parameter))
        self.y = 0.0
        self.register_variable(Real("y", causality=Causality.output))

    def do_step(self, t, step):
        h = step / 8
        for _ in range(8):
            k1 = self.rate(self.x, self.v)
            k2 = self.rate(self.x + 0.5 * h * k1[0], self.v + 0.5 * h * k1[1])
            self.x += h * k2[0]
            self.v += h * k2[1]
        self.y = self.x
        return True

    def rate(self, x, v):
        {equation}
"""
EQUATIONS = {
    "lag": "return (self.K * self.u - x) / self.T, 0.0",
    "second": "return v, self.W**2 * (self.K * self.u - x) - 2 * self.ZETA * self.W * v",
    "saturating": "return (self.K * tanh(self.u / self.C) - x) / self.T, 0.0",
    "damped": "return (self.K * self.u - x - self.C * x**3) / self.T, 0.0",
    "sum": "return (self.K * self.u + self.C * self.v2 - x) / self.T, 0.0",
    "stiffening": "return v, self.W**2 * (self.K * self.u - x - self.C * x**3) - 2 * self.ZETA * self.W * v",
}


def inputs_of(kind: str) -> tuple[str, ...]:
    """Names of a part's inputs."""
    return ("u", "v2") if kind == "sum" else ("u",)


def described(name: str, inputs: Mapping[str, int], parameters: Mapping[str, tuple[int, float]]) -> str:
    """The model description of a native slave with the output ``y``.

    Args:
        name: of the model.
        inputs: name -> value reference.
        parameters: name -> value reference and start.
    """
    rows = [
        '<ScalarVariable name="y" valueReference="0" causality="output" initial="calculated"><Real/></ScalarVariable>'
    ]
    rows += [
        f'<ScalarVariable name="{n}" valueReference="{k}" causality="input"><Real start="0.0"/></ScalarVariable>'
        for n, k in inputs.items()
    ]
    rows += [
        f'<ScalarVariable name="{n}" valueReference="{k}" causality="parameter" variability="fixed">'
        f'<Real start="{value}"/></ScalarVariable>'
        for n, (k, value) in parameters.items()
    ]
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{{{name}}}" numberOfEventIndicators="0">
<CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>
<ModelVariables>{"".join(rows)}</ModelVariables>
<ModelStructure><Outputs><Unknown index="1" dependencies=""/></Outputs>
<InitialUnknowns><Unknown index="1" dependencies=""/></InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""


def library(source: Path, folder: Path, *defined: str) -> Path:
    """Compile a slave that includes ``slave.h``; `defined` as ``KIND=LAG``."""
    target = folder / f"{source.stem}{fmpy.sharedLibraryExtension}"
    flags = ["-shared", "-fPIC", "-O2", f"-I{HERE}", *(f"-D{text}" for text in defined)]
    subprocess.run(
        [str(COMPILER), *flags, "-o", str(target), str(source), "-lm"], check=True, capture_output=True
    )
    return target


def packed(folder: Path, name: str, description: str, binary: Path) -> Path:
    """``folder/NAME.fmu`` of a description and a library."""
    target = folder / f"{name}.fmu"
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.writestr(f"binaries/{fmpy.platform}/{name}{binary.suffix}", binary.read_bytes())
    return target


def native(kind: str, folder: Path) -> Path:
    """Compile ``folder/part_KIND.fmu``."""
    name = f"part_{kind}"
    inputs = {n: k + 1 for k, n in enumerate(inputs_of(kind))}
    parameters = {p: (NUMBERS[p], 0.5 if p == "ZETA" else 1.0) for p in USES[kind]}
    binary = library(HERE / "part.c", folder, f"KIND={kind.upper()}")
    return packed(folder, name, described(name, inputs, parameters), binary)


def python(kind: str, folder: Path) -> Path:
    """Build ``folder/py_KIND.fmu`` as a user of plain pythonfmu would."""
    name = f"py_{kind}"
    values = {p: 0.5 if p == "ZETA" else 1.0 for p in USES[kind]}
    text = SCRIPT.format(name=name, inputs=inputs_of(kind), values=values, equation=EQUATIONS[kind])
    return by_pythonfmu(name, text, folder)


def by_pythonfmu(name: str, script: str, folder: Path) -> Path:
    """Build ``folder/NAME.fmu`` of the class NAME in a script, by plain pythonfmu in a process of its own.

    Raises:
        RuntimeError: pythonfmu does not build it.
    """
    (folder / f"{name}.py").write_text(script, encoding="utf-8")
    options = ("-f", f"{name}.py", "-d", ".", "--no-external-tool")
    command = [sys.executable, "-m", "pythonfmu", "build", *options]
    done = subprocess.run(command, check=False, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return folder / f"{name}.fmu"


def write_ssp(
    target: Path,
    fmus: Mapping[str, Path],
    wires: Sequence[tuple[str, str]],
    values: Mapping[str, Mapping[str, float]],
    inputs: Sequence[str] = ("command",),
    outputs: Sequence[str] = (),
) -> Path:
    """A package.

    Args:
        target: the .ssp file.
        fmus: component -> FMU.
        wires: (source, target), ``component.connector`` or an input of the system.
        values: component -> parameters.
        inputs: of the system.
        outputs: ``component.connector`` that no wire takes; of a component without any it is ``y``.
    """
    connectors: dict[str, dict[str, str]] = {name: {} for name in fmus}
    rows = []
    for port in outputs:
        component, _, connector = port.partition(".")
        connectors[component][connector] = "output"
    for source, end in wires:
        attributes = ""
        for label, port, kind in (("start", source, "output"), ("end", end, "input")):
            component, _, connector = port.rpartition(".")
            if component:
                connectors[component][connector] = kind
                attributes += f' {label}Element="{component}"'
            attributes += f' {label}Connector="{connector}"'
        rows.append(f"<ssd:Connection{attributes}/>")
    parts = []
    for name, own in connectors.items():
        if "output" not in own.values():
            own["y"] = "output"
        ports = "".join(
            f'<ssd:Connector name="{n}" kind="{k}"><ssc:Real/></ssd:Connector>' for n, k in own.items()
        )
        numbers = "".join(
            f'<ssv:Parameter name="{n}"><ssv:Real value="{v!r}"/></ssv:Parameter>'
            for n, v in values[name].items()
        )
        parts.append(
            f'<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" source="resources/{fmus[name].name}">'
            f"<ssd:Connectors>{ports}</ssd:Connectors><ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
            f'<ssv:ParameterSet version="1.0" name="own"><ssv:Parameters>{numbers}</ssv:Parameters></ssv:ParameterSet>'
            "</ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings></ssd:Component>"
        )
    outer = "".join(f'<ssd:Connector name="{n}" kind="input"><ssc:Real/></ssd:Connector>' for n in inputs)
    outer = f"<ssd:Connectors>{outer}</ssd:Connectors>" if outer else ""
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="random"
 xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
 xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
<ssd:System name="random">{outer}<ssd:Elements>{"".join(parts)}</ssd:Elements>
<ssd:Connections>{"".join(rows)}</ssd:Connections></ssd:System></ssd:SystemStructureDescription>"""
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        for file in set(fmus.values()):
            archive.write(file, f"resources/{file.name}")
    return target
