"""A MATLAB script that builds the Simulink model of a system from its FMUs: Simulink cannot import an SSP.

Each FMU is a block that Simulink imports, or an S-function that is compiled from its C sources (`cosim.export.sfunction`).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cosim.errors import ModelError, UsageError
from cosim.export import sfunction
from cosim.export.model import ExportedFmu, ExportedModel, refuse_other_versions, write_files
from cosim.export.names import (
    MATLAB_KEYWORDS,
    MATLAB_LENGTH,
    SIMULINK_PARAMETER_LENGTH,
    Names,
    identifier,
    is_identifier,
)
from cosim.export.render import number, render
from cosim.packages import project_version
from cosim.ssp.system import Port, Value, Variable, Wire

MATLAB_VERSION = "9.6"
MATLAB_RELEASE = "R2019a"
"""The first release with DebugExecutionForFMUViaOutOfProcess, which runs FMUs in a process of their own."""
SFUNCTION_VERSION, SFUNCTION_RELEASE = "8.1", "R2013a"
"""The first release with strjoin, which the script uses."""
WIDTH, GAP, HEIGHT = 140, 120, 40  # of blocks, in pixels
FMU, SFUNCTION = "fmu", "s-function"


def write_simulink(
    model: ExportedModel, folder: Path, overwrite: bool = False, blocks: str = FMU
) -> list[Path]:
    """Write the script and the FMUs.

    Args:
        model: the prepared system.
        folder: receives ``build_<model>.m`` and one .fmu per FMU; or an S-function in C and its sources for each.
        overwrite: see `write_files`.
        blocks: ``fmu``, Simulink's own import, or ``s-function``.

    Raises:
        ModelError: a name or value cannot be expressed in Simulink, or an FMU has no C sources for an S-function.
        UsageError: the folder holds other files, or cannot be written to; there are no such blocks.
    """
    if blocks not in (FMU, SFUNCTION):
        raise UsageError(f"'{blocks}' are no blocks of Simulink's: take {FMU} or {SFUNCTION}")
    refuse_other_versions(model)
    name = identifier(model.system.name or model.system.path.stem, MATLAB_KEYWORDS, 50)
    if blocks == FMU:
        files = {f"{item.stem}.fmu": item.data for item in model.fmus.values()}
    else:
        functions = Names("MATLAB", MATLAB_KEYWORDS, MATLAB_LENGTH)
        for item in model.fmus.values():
            functions.give(sfunction.function_name(item.stem), f"the S-function of '{item.stem}.fmu'")
        files = {k: v for item in model.fmus.values() for k, v in sfunction.files(item, name).items()}
    script = render("simulink.m.j2", **_context(model, name, blocks == SFUNCTION)).encode()
    return write_files(folder, {f"build_{name}.m": script} | files, overwrite)


def _context(model: ExportedModel, name: str, compiled: bool) -> dict[str, Any]:
    system = model.system
    wiring = sfunction.wiring(model) if compiled else None
    delayed = model.delayed if wiring is None else wiring.delayed
    scope = Names("Simulink", MATLAB_KEYWORDS, MATLAB_LENGTH)
    blocks = {c: scope.give(c, f"component '{c}'") for c in model.order}
    inputs = [
        {
            "name": scope.give(item.name, f"system input '{item.name}'"),
            "unit": item.unit or "1",
            "start": number(_source_start(model, item.targets)),
            "interpolate": "off" if model.is_held(item.name) else "on",
            "wires": [_wire(model, blocks, w, delayed) for w in item.targets],
        }
        for item in system.inputs.values()
    ]
    workspace = Names("the MATLAB workspace", MATLAB_KEYWORDS, MATLAB_LENGTH)
    workspace.reserve("tout", "the time that Simulink logs")
    components = [_block(model, c, block, k, workspace) for k, (c, block) in enumerate(blocks.items())]
    if wiring is not None:
        for item in components:
            item |= _compiled(model, item["component"], wiring)
    return {
        "name": name,
        "source": system.path.name,
        "version": project_version(),
        "step": number(float(model.step)),
        "start": number(float(model.start)),
        "stop": number(float(model.stop)),
        "release": (SFUNCTION_VERSION, SFUNCTION_RELEASE) if compiled else (MATLAB_VERSION, MATLAB_RELEASE),
        "platforms": model.platforms,
        "runs_python": model.runs_python,
        "compiled": [_mex(item) for item in model.fmus.values()] if compiled else [],
        "components": components,
        "inputs": inputs,
        "wires": [_wire(model, blocks, w, delayed) for w in system.wires],
        "constants": [_constant(model, blocks, port) for port in model.open_ports()],
    }


def _block(model: ExportedModel, name: str, block: str, place: int, workspace: Names) -> dict[str, Any]:
    """What the template writes of a component; blocks stand in a row, in stepping order."""
    fmu = _of(model, name)
    declared = [v.name for v in fmu.outputs]
    left = 60 + (place + 1) * (WIDTH + GAP)
    return {
        "component": name,
        "block": block,
        "file": f"{fmu.stem}.fmu",
        "parameters": _parameters(model, name),
        "position": [left, 100, left + WIDTH, 100 + 2 * HEIGHT],
        "inputs": [v.name for v in fmu.inputs],
        "outputs": list(fmu.listed_outputs or declared),
        "same_order": list(fmu.listed_outputs) == declared,
        "logged": [
            (v.name, workspace.give(f"{name}_{v.name}", f"output '{name}.{v.name}'"), v.unit or "1")
            for v in fmu.outputs
        ],
    }


def _compiled(model: ExportedModel, name: str, wiring: sfunction.Wiring) -> dict[str, Any]:
    """What the template writes of a component beside that, where it is an S-function: ports in the order of declaration."""
    fmu, given = _of(model, name), dict(_parameters(model, name))
    own = [(v.name, sfunction.spoken(v), given.get(v.name, _start(v))) for v in sfunction.parameters(fmu)]
    for key, _, _ in own:
        if not is_identifier(key) or key in MATLAB_KEYWORDS:
            raise ModelError(
                f"the parameter '{name}.{key}' would be a variable of the block's mask, which has no such names: "
                "rename it in the FMU"
            )
    return {
        "function": sfunction.function_name(fmu.stem),
        "resources": f"resources/{fmu.stem}",
        "held": wiring.held[name],
        "own": own,
        "outputs": [v.name for v in fmu.outputs],
        "same_order": True,
    }


def _start(variable: Variable) -> str:
    """The start value as a mask holds it: a Boolean is 1 or 0."""
    value = variable.start
    return number(int(value) if isinstance(value, bool) else value) if value is not None else "0"


def _mex(item: ExportedFmu) -> dict[str, Any]:
    """What the template compiles of an FMU."""
    return {
        "function": sfunction.function_name(item.stem),
        "folder": f"sources/{item.stem}",
        "files": sfunction.compiled_files(item),
        "identifier": item.fmu.identifier,
    }


def _of(model: ExportedModel, component: str) -> ExportedFmu:
    return model.fmus[model.system.components[component].fmu.source]


def _wire(
    model: ExportedModel, blocks: Mapping[str, str], wire: Wire, delayed: frozenset[Wire]
) -> dict[str, Any]:
    """A connection; one that closes a loop gets a unit delay with the input's start value."""
    return {
        "source": (blocks.get(wire.source.component, ""), wire.source.variable),
        "target": (blocks[wire.target.component], wire.target.variable),
        "factor": number(float(wire.factor)),
        "offset": number(float(wire.offset)),
        "scaled": (wire.factor, wire.offset) != (1.0, 0.0),
        "delayed": number(model.start_of(wire.target)) if wire in delayed else "",
    }


def _source_start(model: ExportedModel, wires: tuple[Wire, ...]) -> float:
    """The value of a system input that gives its first target the start value there."""
    wire = wires[0]
    return (float(model.start_of(wire.target)) - wire.offset) / wire.factor


def _parameters(model: ExportedModel, name: str) -> list[tuple[str, str]]:
    """Name and value of each parameter that the package gives, as set_param takes them."""
    component = model.system.components[name]
    found = []
    for key, value in model.values(component).items():
        if not is_identifier(key) or len(key) > SIMULINK_PARAMETER_LENGTH:
            raise ModelError(
                f"the parameter '{name}.{key}' has a value in the package, but Simulink imports only parameters whose "
                f"names are identifiers of at most {SIMULINK_PARAMETER_LENGTH} characters: shorten its name in the FMU"
            )
        found.append((key, _value(component.fmu.variables[key], value, f"{name}.{key}")))
    return found


def _value(variable: Variable, value: Value, what: str) -> str:
    """A value as the text that Simulink's dialogs hold: numbers as typed, a check box as on or off."""
    if variable.kind == "Boolean":
        return "on" if value else "off"
    if variable.kind == "Enumeration":
        raise ModelError(
            f"the parameter '{what}' is an enumeration, which this export does not set: set it in the block's dialog"
        )
    return str(value) if variable.kind == "String" else number(value)


def _constant(model: ExportedModel, blocks: Mapping[str, str], port: Port) -> dict[str, Any]:
    """A Constant block for an input that nothing drives."""
    kind, value = model.system.variable(port).kind, model.start_of(port)
    if kind == "String":
        raise ModelError(
            f"the input '{port}' is a text and not connected, which cannot be exported: connect it"
        )
    text = {"Boolean": "true" if value else "false", "Real": number(value)}.get(kind, f"int32({value})")
    return {"target": (blocks[port.component], port.variable), "value": text}
