"""A MATLAB script that builds the Simulink model of a system from its FMUs: Simulink cannot import an SSP."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cosim.errors import ModelError
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
WIDTH, GAP, HEIGHT = 140, 120, 40  # of blocks, in pixels


def write_simulink(model: ExportedModel, folder: Path, overwrite: bool = False) -> list[Path]:
    """Write the script and the FMUs.

    Args:
        model: the prepared system.
        folder: receives ``build_<model>.m`` and one .fmu per FMU.
        overwrite: see `write_files`.

    Raises:
        ModelError: a name or value cannot be expressed in Simulink.
        UsageError: the folder holds other files, or cannot be written to.
    """
    refuse_other_versions(model)
    name = identifier(model.system.name or model.system.path.stem, MATLAB_KEYWORDS, 50)
    files = {f"build_{name}.m": render("simulink.m.j2", **_context(model, name)).encode()}
    files |= {f"{item.stem}.fmu": item.data for item in model.fmus.values()}
    return write_files(folder, files, overwrite)


def _context(model: ExportedModel, name: str) -> dict[str, Any]:
    system = model.system
    scope = Names("Simulink", MATLAB_KEYWORDS, MATLAB_LENGTH)
    blocks = {c: scope.give(c, f"component '{c}'") for c in model.order}
    inputs = [
        {
            "name": scope.give(item.name, f"system input '{item.name}'"),
            "unit": item.unit or "1",
            "start": number(_source_start(model, item.targets)),
            "interpolate": "off" if model.is_held(item.name) else "on",
            "wires": [_wire(model, blocks, w) for w in item.targets],
        }
        for item in system.inputs.values()
    ]
    workspace = Names("the MATLAB workspace", MATLAB_KEYWORDS, MATLAB_LENGTH)
    workspace.reserve("tout", "the time that Simulink logs")
    components = [_block(model, c, block, k, workspace) for k, (c, block) in enumerate(blocks.items())]
    return {
        "name": name,
        "source": system.path.name,
        "version": project_version(),
        "step": number(float(model.step)),
        "start": number(float(model.start)),
        "stop": number(float(model.stop)),
        "release": (MATLAB_VERSION, MATLAB_RELEASE),
        "platforms": model.platforms,
        "runs_python": model.runs_python,
        "components": components,
        "inputs": inputs,
        "wires": [_wire(model, blocks, w) for w in system.wires],
        "constants": [_constant(model, blocks, port) for port in model.open_ports()],
    }


def _block(model: ExportedModel, name: str, block: str, place: int, workspace: Names) -> dict[str, Any]:
    """What the template writes of a component; blocks stand in a row, in stepping order."""
    fmu = _of(model, name)
    declared = [v.name for v in fmu.outputs]
    left = 60 + (place + 1) * (WIDTH + GAP)
    return {
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


def _of(model: ExportedModel, component: str) -> ExportedFmu:
    return model.fmus[model.system.components[component].fmu.source]


def _wire(model: ExportedModel, blocks: Mapping[str, str], wire: Wire) -> dict[str, Any]:
    """A connection; one that closes a loop gets a unit delay with the input's start value."""
    return {
        "source": (blocks.get(wire.source.component, ""), wire.source.variable),
        "target": (blocks[wire.target.component], wire.target.variable),
        "factor": number(float(wire.factor)),
        "offset": number(float(wire.offset)),
        "scaled": (wire.factor, wire.offset) != (1.0, 0.0),
        "delayed": number(model.start_of(wire.target)) if wire in model.delayed else "",
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
