"""A Modelica package of the blocks themselves: their equations as functions, one model a block, the system with its wires.

It needs no FMU. The functions are those that our FMUs run, effects included (`cosim/export/equations.py`); a block makes
a step of its FMU at each sample, and the wires are those of the package that runs the FMUs (`cosim/export/modelica.py`).
"""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from cosim.errors import ModelError
from cosim.export.equations import Library, name_of
from cosim.export.model import ExportedFmu, ExportedModel
from cosim.export.names import Names
from cosim.export.render import modelica_text, number
from cosim.native.package import block_of, described_starts, description_of
from cosim.native.translate import Program
from cosim.ssp.archive import open_archive, read_entry
from cosim.ssp.system import Value
from fmus.compose import Composed, compose
from fmus.contract import UNBOUNDED, Buffer, Variable
from fmus.dependencies import at_start

STIMULUS = "stimulus"


@dataclass(frozen=True)
class SourceBlock:
    """A block of the package.

    Attributes:
        name: of its model and of its package of equations.
        composed: the block with the effects that are woven in.
        starts: values that its parameters start with, SI.
        names: identifiers of its inputs, outputs and parameters.
    """

    name: str
    composed: Composed
    starts: Mapping[str, float]
    names: Mapping[str, str]

    def described(self) -> dict[str, Any]:
        """What the template writes."""
        composed = self.composed
        library = Library(Program(composed, f"{composed.block.name}_"))
        taken = {*self.names.values(), "step", "begin", "time"}

        def unique(name: str) -> str:
            while name in taken:
                name += "_"
            taken.add(name)
            return name

        parameters = [
            (self.names[n], variable, self.starts[n]) for n, variable in composed.parameters.items()
        ]
        state = {f"x.{name_of(n)}": unique(f"state_{name_of(n)}") for n in composed.block.states}
        memory = {f"m.{name_of(n)}": unique(f"memory_{name_of(n)}") for n in composed.memory}
        sizes = {
            unique_: composed.memory[n].length  # type: ignore[union-attr]
            for (n, unique_) in zip(composed.memory, memory.values(), strict=True)
            if isinstance(composed.memory[n], Buffer)
        }
        fields = ["time" if v.kind == "time" else self.names[n] for n, v in composed.block.inputs.items()]
        held = state | memory
        # inputs on which outputs depend at the start; were all named, wires that close a loop would close one there
        depends = at_start(composed)
        acting = frozenset().union(*(depends[n] for n in composed.outputs))
        return {
            "name": self.name,
            "title": composed.block.title,
            "effects": ", ".join(e.name for e in composed.effects),
            "parameters": [
                {"type": "Integer" if v.kind == "integer" else "Real", "name": n, "unit": attributes(v),
                 "value": number(int(value) if v.kind == "integer" else float(value)), "text": v.text}
                for n, v, value in parameters
            ],
            "inputs": [{"name": self.names[n], "unit": attributes(v), "text": v.text} for n, v in composed.inputs.items()],
            "outputs": [{"name": self.names[n], "unit": attributes(v), "text": v.text} for n, v in composed.outputs.items()],
            "fields": [self.names[n] for n in composed.parameters],
            "given": fields,
            "acting": [
                own if v.kind == "time" or n in acting else number(float(v.start))
                for own, (n, v) in zip(fields, composed.block.inputs.items(), strict=True)
            ],
            "held": [(name, f"[{sizes[name]}]" if name in sizes else "") for name in held.values()],
            "outside": list(held.items()),
            "results": [(name_of(n), self.names[n]) for n in composed.outputs],
            "p": unique("given"),
            "c": unique("coefficients"),
            "records": library.records(),
            "functions": list(library.texts.values()),
            "remembers": library.remembers,
            "lists": [(n, size) for n, size in library.sizes.items()],
            "state": ", ".join(state.values()),
            "memory": ", ".join(memory.values()),
            "start": library.call("start", "u", "p"),
            "begin": library.call("begin", "x", "u", "p", ", ".join(library.sizes)) if library.remembers else "",
            "advance": (
                library.call("advance", "x", "m", "u", "p", "c") if library.remembers
                else library.call("step", "x", "u", "m", "p", "c")
            ),
            "output": library.call("output", "x", "u", "m", "p"),
            "coefficients": library.call("coefficients", "P", "step"),
        }  # fmt: skip


def attributes(variable: Variable) -> str:
    """Unit and bounds of a variable as a modification."""
    listed = [f"unit = {modelica_text(variable.unit)}"]
    listed += [
        f"{name} = {number(int(value) if variable.kind == 'integer' else float(value))}"
        for name, value in (("min", variable.low), ("max", variable.high))
        if abs(value) < UNBOUNDED
    ]
    return f"({', '.join(listed if variable.kind != 'integer' else listed[1:])})"


def source_block(
    model: ExportedModel, source: str, item: ExportedFmu, names: Mapping[str, str], package: Names
) -> SourceBlock:
    """The block that an FMU of the package runs.

    Effects that remember a list (a delay) are woven in only where the package switches them on: a tool would have to carry
    thousands of numbers from step to step for nothing.

    Raises:
        ModelError: the FMU is not ours, or has effects that are not installed.
    """
    where = f"{model.system.path.name}: {source}"
    root = description_of(item.data)
    try:
        _, composed = block_of(root, PurePosixPath(source).stem, where)
    except ModelError:
        raise ModelError(
            f"{where} is no FMU of this project, so its equations are not known: "
            "export without --source, which runs the FMU itself"
        ) from None
    starts = described_starts(root, composed, where)
    given = [
        {**starts, **{n: float(v) for n, v in model.values(c).items()}}
        for c in model.system.components.values()
        if c.fmu.source == source
    ]
    off = [
        e
        for e in composed.effects
        if any(isinstance(m, Buffer) for m in e.memory.values())
        and all(values[e.key] == composed.parameters[e.key].start for values in given)
    ]
    if off:
        composed = compose(composed.block, [e for e in composed.effects if e not in off])
    title = "".join(part.capitalize() for part in item.stem.split("_"))
    name = package.give(title, f"FMU '{source}'")
    return SourceBlock(name, composed, starts, {n: names[n] for n in item.fmu.variables if n in names})


def is_stimulus(item: ExportedFmu) -> bool:
    """True for an FMU of ours that plays a recorded command."""
    return description_of(item.data).get("modelName") == STIMULUS


def played(item: ExportedFmu) -> str:
    """The command that a stimulus plays, as a table for CombiTimeTable."""
    with open_archive(item.data, item.stem) as archive:
        text = read_entry(archive, "resources/stimulus.csv", item.stem).decode()
    rows = list(csv.reader(io.StringIO(text)))[1:]
    lines = [f"#1\n# time [s], u [1]\ndouble stimulus({len(rows)}, 2)"]
    return "\n".join([*lines, *(" ".join(row) for row in rows)]) + "\n"


def modifiers(block: SourceBlock | None, values: Mapping[str, Value]) -> dict[str, Value]:
    """The values of a component that its model has parameters for."""
    if block is None:
        return {n: v for n, v in values.items() if n in ("hold", "gain")}
    return {n: v for n, v in values.items() if n in block.composed.parameters}
