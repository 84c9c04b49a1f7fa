"""An FMU as an S-function of Simulink: C around the FMU's own C sources, which `mex` compiles on the host."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from cosim.errors import ModelError
from cosim.export.model import ExportedFmu, ExportedModel
from cosim.export.names import MATLAB_KEYWORDS, MATLAB_LENGTH, identifier
from cosim.export.render import one_line, render
from cosim.native.build import standard_headers
from cosim.packages import project_version
from cosim.ssp.archive import open_archive, read_entry
from cosim.ssp.system import Port, Variable, Wire
from cosim.ssp.xml import parse

KINDS = {"Real": "REAL", "Integer": "INTEGER", "Enumeration": "INTEGER", "Boolean": "BOOLEAN"}
HEADERS = "sources/fmi2"  # of the standard, for FMUs that bring their sources alone


@dataclass(frozen=True)
class Wiring:
    """How values reach S-functions: each steps up to the present time, so a wire hands over the value of the same time.

    Attributes:
        delayed: wires that pass a Unit Delay, because they close a loop.
        held: component -> 1 for each input that takes the value of one step before, else 0.
    """

    delayed: frozenset[Wire]
    held: Mapping[str, tuple[int, ...]]


def wiring(model: ExportedModel) -> Wiring:
    """Delays and held inputs that give the numbers of our own master."""
    system = model.system
    ahead: dict[str, set[str]] = {name: set() for name in system.components}
    for wire in system.wires:
        if wire not in model.delayed:
            ahead[wire.source.component].add(wire.target.component)

    def reached(name: str) -> set[str]:
        found, todo = set[str](), [name]
        while todo:
            new = ahead[todo.pop()] - found
            found |= new
            todo += new
        return found

    loops = {
        w for w in model.late if w.source.component in reached(w.target.component) | {w.target.component}
    }
    marked = {w.target for w in model.late - loops}
    marked |= {w.target for name, item in system.inputs.items() if model.is_held(name) for w in item.targets}
    held = {
        c.name: tuple(int(Port(c.name, v.name) in marked) for v in model.inputs_of(c))
        for c in system.components.values()
    }
    return Wiring(model.delayed | loops, held)


def function_name(stem: str) -> str:
    """Of the S-function, its C file and what `mex` makes of them."""
    return identifier(f"{stem}_sfun", MATLAB_KEYWORDS, MATLAB_LENGTH)


def parameters(item: ExportedFmu) -> tuple[Variable, ...]:
    """Parameters of an FMU that an S-function takes: its numbers."""
    return tuple(v for v in item.parameters if v.kind in KINDS and v.start is not None)


def spoken(variable: Variable) -> str:
    """A variable as a dialog names it."""
    return f"{variable.name} [{variable.unit or '1'}]"


def comment(text: str) -> str:
    """A text that ends no comment of C."""
    return one_line(text).replace("*/", "* /")


def compiled_files(item: ExportedFmu) -> tuple[str, ...]:
    """Names of the C files that are compiled with the S-function, below ``sources/<stem>``.

    Raises:
        ModelError: the FMU names none: it has no sources.
    """
    with open_archive(item.data, item.fmu.source) as archive:
        text = read_entry(archive, "modelDescription.xml", item.fmu.source)
    named = [
        file.get("name", "") for file in parse(text, item.fmu.source).findall("CoSimulation/SourceFiles/File")
    ]
    if not named:
        raise ModelError(
            f"{item.fmu.source} brings no C sources, of which an S-function is made: take native FMUs (cosim build "
            "--native, then build/native/ssp/<system>.ssp), or FMU blocks (--blocks fmu)"
        )
    return tuple(named)


def files(item: ExportedFmu, script: str) -> dict[str, bytes]:
    """The files of an FMU's S-function, by path: the C around it, its sources and resources.

    Args:
        item: the FMU.
        script: name of the model, whose script compiles them.

    Raises:
        ModelError: a port is no number.
    """
    for variable in (*item.inputs, *item.outputs):
        if variable.kind not in KINDS:
            raise ModelError(
                f"{item.fmu.source}: '{variable.name}' is a {variable.kind}, and wires of an S-function carry numbers"
            )
    found = {f"{function_name(item.stem)}.c": render("sfunction.c.j2", **_context(item, script)).encode()}
    with open_archive(item.data, item.fmu.source) as archive:
        for name in archive.namelist():
            top, _, rest = name.partition("/")
            if top in ("sources", "resources") and rest and not name.endswith("/"):
                path = str(PurePosixPath(top, item.stem, rest))
                found[path] = read_entry(archive, name, item.fmu.source)
    return found | {f"{HEADERS}/{name}": data for name, data in standard_headers("2.0").items()}


def _context(item: ExportedFmu, script: str) -> dict[str, Any]:
    def lines(variables: tuple[Variable, ...]) -> list[dict[str, Any]]:
        return [
            {"name": v.name, "reference": v.reference, "kind": KINDS[v.kind], "said": comment(spoken(v))}
            for v in variables
        ]

    return {
        "said": comment(item.stem),
        "file": f"{item.stem}.fmu",
        "function": function_name(item.stem),
        "identifier": item.fmu.identifier,
        "guid": item.fmu.guid,
        "model": script,
        "version": project_version(),
        "inputs": lines(item.inputs),
        "outputs": lines(item.outputs),
        "parameters": lines(parameters(item)),
    }
