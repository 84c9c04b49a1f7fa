"""A Modelica package that runs the FMUs of a system, for tools that cannot read an SSP.

OpenModelica's importFMU refuses FMUs that are for co-simulation only, so the package calls FMI itself, through C that the
tool compiles. Components are stepped in the order and with the delays of our own master, by the data flow of the events.
"""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cosim.errors import ModelError
from cosim.export.model import ExportedFmu, ExportedModel, refuse_other_versions, write_files
from cosim.export.names import MODELICA_KEYWORDS, Names, identifier
from cosim.export.render import modelica_text, number, render, template_bytes
from cosim.export.source import SourceBlock, is_stimulus, modifiers, played, source_block
from cosim.packages import project_version
from cosim.ssp.archive import open_archive
from cosim.ssp.system import Component, Value, Variable, Wire

RESERVED = (
    *("fmu", "started", "initialised", "instanceName", "named", "y"),
    *("begin", "step", "time", "Internal"),
)
"""Names that the component models use themselves."""


def write_modelica(
    model: ExportedModel, folder: Path, overwrite: bool = False, *, equations: bool = False
) -> list[Path]:
    """Write the package with its unpacked FMUs, or with the blocks' equations, and a script for OpenModelica.

    Args:
        model: the prepared system.
        folder: receives ``<package>/package.mo``, ``<package>/Resources`` and ``simulate.mos``.
        overwrite: see `write_files`.
        equations: write the blocks themselves, which needs no FMUs; all have to be ours.

    Raises:
        ModelError: a name, type or value cannot be expressed in Modelica, or a block's equations are not known.
        UsageError: the folder holds other files, or cannot be written to.
    """
    refuse_other_versions(model)
    name = identifier(model.system.name or model.system.path.stem, MODELICA_KEYWORDS)
    context = _context(model, name, equations)
    template = "source.mo.j2" if equations else "package.mo.j2"
    files = {
        f"{name}/package.mo": render(template, **context).encode(),
        "simulate.mos": render("simulate.mos.j2", **context).encode(),
    }
    if model.system.inputs:
        files[f"{name}/Resources/inputs.txt"] = _table(model).encode()
    if equations:
        for stimulus in context["stimuli"]:
            files[f"{name}/Resources/{stimulus['file']}"] = stimulus["table"].encode()
        return write_files(folder, files, overwrite)
    files[f"{name}/Resources/Include/cosim_fmi2.h"] = template_bytes("cosim_fmi2.h")
    for item in model.fmus.values():
        with open_archive(item.data, item.stem) as archive:
            for entry in archive.namelist():
                if not entry.endswith("/"):
                    files[f"{name}/Resources/FMUs/{item.stem}/{entry}"] = archive.read(entry)
    return write_files(folder, files, overwrite)


def _context(model: ExportedModel, name: str, equations: bool) -> dict[str, Any]:
    system = model.system
    package = Names("the Modelica package", MODELICA_KEYWORDS)
    for word in ("Internal", "Equations", "System", "Driven", "begin", "step"):
        package.reserve(word, "a part of every export")
    scopes = {source: _Scope(item) for source, item in model.fmus.items()}
    blocks: dict[str, SourceBlock] = {}
    stimuli: list[dict[str, Any]] = []
    models = {}
    for source, item in model.fmus.items():
        if not equations:
            models[source] = package.give(f"{item.stem}_cs_FMU", f"FMU '{source}'")
        elif is_stimulus(item):
            models[source] = package.give(item.stem.capitalize(), f"FMU '{source}'")
            ports = {v.name: scopes[source].port(v) for v in item.exported}
            stimuli.append({
                "name": models[source], "file": f"{item.stem}.txt", "table": played(item),
                "hold": ports["hold"]["value"], "gain": ports["gain"]["value"], "output": ports["u"]["name"],
            })  # fmt: skip
        else:
            blocks[source] = source_block(model, source, item, scopes[source].names, package)
            models[source] = blocks[source].name
    scope = Names("Modelica", MODELICA_KEYWORDS)
    instances = {c: scope.give(c, f"component '{c}'") for c in model.order}
    inputs = {n: scope.give(n, f"system input '{n}'") for n in system.inputs}
    wiring = _Wiring(model, scopes, instances, inputs, scope)
    return {
        "name": name,
        "model": "Driven" if inputs else "System",
        "source": system.path.name,
        "version": project_version(),
        "step": number(float(model.step)),
        "start": number(float(model.start)),
        "stop": number(float(model.stop)),
        "intervals": round((model.stop - model.start) / model.step),
        "fmus": [scopes[s].described(models[s]) for s in model.fmus],
        "components": [
            _instance(
                model, system.components[c], scopes, models, instances[c], k, blocks if equations else None
            )
            for k, c in enumerate(model.order)
        ],
        "inputs": [{"name": inputs[n], "unit": _unit(i.unit)} for n, i in system.inputs.items()],
        "all_held": all(model.is_held(n) for n in system.inputs),
        "holds": wiring.holds,
        "connections": wiring.connections,
        "equations": wiring.equations,
        "references": lambda ports: _array([str(p["reference"]) for p in ports]),
        "blocks": [block.described() for block in blocks.values()],
        "stimuli": stimuli,
        "pre": lambda names: ", ".join(f"pre({n})" for n in names.split(", ")),
        "assigned_names": _assigned,
        "names": lambda ports: _array([p["name"] for p in ports], "0.0"),
        "wholes": lambda ports: _array([p["name"] for p in ports]),
        "flags": lambda ports: _array([f"(if {p['name']} then 1 else 0)" for p in ports]),
        "assigned": lambda ports: _assigned([p["name"] for p in ports]),
    }


def _array(cells: Sequence[str], empty: str = "0") -> str:
    """An array constructor; Modelica has none for an empty array, whose type is that of `empty`: 0 Integer, 0.0 Real."""
    return "{" + ", ".join(cells) + "}" if cells else f"fill({empty}, 0)"


def _assigned(names: Sequence[str]) -> str:
    """What an equation gives the results of a function to."""
    return names[0] if len(names) == 1 else f"({', '.join(names)})"


def _unit(unit: str) -> str:
    return f"(unit = {modelica_text(unit)})" if unit else ""


def _literal(value: Value) -> str:
    return ("true" if value else "false") if isinstance(value, bool) else number(value)


class _Scope:
    """Identifiers of one FMU's variables, and what its model needs."""

    def __init__(self, item: ExportedFmu) -> None:

        self.item = item
        self.exported = item.exported
        for variable in self.exported:
            _refuse(variable, item.fmu.source)
        if not item.outputs:
            raise ModelError(
                f"{item.fmu.source} has no outputs, so a Modelica tool would never step it: leave it out"
            )
        # letter case tells variables apart in Modelica; `Names` is stricter because files and Simulink are
        taken: dict[str, str] = {}
        for variable in self.exported:
            text = identifier(variable.name, MODELICA_KEYWORDS)
            text += "_" if text in RESERVED else ""
            other = taken.setdefault(text, variable.name)
            if other != variable.name:
                raise ModelError(
                    f"{item.fmu.source}: the variables '{other}' and '{variable.name}' would both be named '{text}' in "
                    "Modelica: rename one of them"
                )
        self.names = {name: text for text, name in taken.items()}

    def port(self, variable: Variable) -> dict[str, Any]:
        """What the template writes of a variable."""
        start = variable.start
        if start is None:
            start = False if variable.kind == "Boolean" else 0 if variable.kind == "Integer" else 0.0
        return {
            "name": self.names[variable.name],
            "reference": variable.reference,
            "type": variable.kind,
            "unit": _unit(variable.unit) if variable.kind == "Real" else "",
            "value": _literal(start),
        }

    def described(self, model: str) -> dict[str, Any]:
        """The model of the FMU."""
        item = self.item
        parameters = [self.port(v) for v in item.parameters]
        return {
            "name": model,
            "stem": item.stem,
            "description": f"FMU {item.stem} for co-simulation",
            "identifier": item.fmu.identifier,
            "guid": item.fmu.guid,
            "parameters": parameters,
            "reals": [p for p in parameters if p["type"] == "Real"],
            "integers": [p for p in parameters if p["type"] == "Integer"],
            "booleans": [p for p in parameters if p["type"] == "Boolean"],
            "inputs": [self.port(v) for v in item.inputs],
            "direct": [self.port(v) for v in item.inputs if v.name in item.direct],
            "outputs": [self.port(v) for v in item.outputs],
        }


def _refuse(variable: Variable, source: str) -> None:
    known = ("Real", "Integer", "Boolean") if variable.causality == "parameter" else ("Real",)
    if variable.kind not in known:
        raise ModelError(
            f"{source}: the {variable.causality} '{variable.name}' is of type {variable.kind}, which this export cannot "
            f"write to Modelica; it can for {', '.join(known)}"
        )


def _instance(
    model: ExportedModel,
    component: Component,
    scopes: dict[str, _Scope],
    models: dict[str, str],
    name: str,
    place: int,
    blocks: dict[str, SourceBlock] | None,
) -> dict[str, Any]:
    source = component.fmu.source
    names = scopes[source].names
    values = model.values(component)
    if blocks is not None:
        values = modifiers(blocks.get(source), values)
    given = [(names[key], _literal(value)) for key, value in values.items()]
    return {
        "name": name,
        "model": models[source],
        "modifiers": given if blocks is not None else [*given, ("instanceName", modelica_text(name))],
        "x": -100 + 40 * place,
    }


class _Wiring:
    """Connections of the system model: direct, through a Hold, or as an equation where the wire scales or is open."""

    def __init__(
        self,
        model: ExportedModel,
        scopes: dict[str, _Scope],
        instances: dict[str, str],
        inputs: dict[str, str],
        scope: Names,
    ) -> None:
        self.model, self.scopes, self.instances, self.scope = model, scopes, instances, scope
        self.holds: list[dict[str, str]] = []
        self.connections: list[tuple[str, str]] = []
        self.equations: list[tuple[str, str]] = []
        for wire in model.system.wires:
            why = "closes a loop" if wire in model.delayed else "is discrete" if wire in model.late else ""
            self.add(self.port(wire.source.component, wire.source.variable), wire, why)
        for name, item in model.system.inputs.items():
            for wire in item.targets:
                self.add(inputs[name], wire, "is held over a step" if model.is_held(name) else "")
        for port in model.open_ports():
            start = number(float(model.start_of(port)))
            self.equations.append((self.port(port.component, port.variable), start))

    def port(self, component: str, variable: str) -> str:
        source = self.model.system.components[component].fmu.source
        return f"{self.instances[component]}.{self.scopes[source].names[variable]}"

    def add(self, source: str, wire: Wire, why: str) -> None:
        """Wire a source, by way of a Hold where our master hands over the value of the step before."""
        if why:
            name = self.scope.give(
                f"{wire.target.component}_{wire.target.variable}_hold", f"the hold of '{wire.target}'"
            )
            self.holds.append({"name": name, "why": f"{source} {why}"})
            self.connections.append((source, f"{name}.u"))
            source = f"{name}.y"
        target = self.port(wire.target.component, wire.target.variable)
        if (wire.factor, wire.offset) == (1.0, 0.0):
            self.connections.append((source, target))
        else:
            factor, offset = number(float(wire.factor)), number(float(wire.offset))
            self.equations.append((target, f"({factor}) * {source} + ({offset})"))


def _table(model: ExportedModel) -> str:
    """A table for CombiTimeTable that keeps the start values."""
    starts = []
    for item in model.system.inputs.values():
        wire = item.targets[0]
        starts.append(number((float(model.start_of(wire.target)) - wire.offset) / wire.factor))
    text = io.StringIO()
    text.write(
        f"#1\n# time [s], {', '.join(f'{i.name} [{i.unit or 1}]' for i in model.system.inputs.values())}\n"
    )
    text.write(f"double inputs(2, {1 + len(starts)})\n")
    for time in (model.start, model.stop):
        text.write(" ".join([number(float(time)), *starts]) + "\n")
    return text.getvalue()
