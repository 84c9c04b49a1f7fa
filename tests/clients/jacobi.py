"""The same blocks in plain Python under the scheme of fmpy, ecos, libcosim and FMUContainer, to compare their results with.

All are Jacobi masters: every component steps from t to t + h with the outputs that the others had at t, so each
connection delays by one step. They differ at the start and in the stamps:

    fmpy       components are initialised alone; every input of the first step is 0; the row of a step bears its start time
    ecos       outputs are handed on during initialisation, once for each component; rows from t = 0; clock accumulated;
               a row is asked for after the outputs were handed on, so that what follows an input at once shows the new input
    libcosim   as ecos; rows from the end of the first step; clock in whole nanoseconds
    FMUContainer   as ecos, without its question after the hand-over; parameters of the .ssv are not read
"""

import io
import zipfile
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from fmpy.ssp.ssd import read_ssd

from fmus import registry
from fmus.build import composed_block
from fmus.contract import Buffer

SCHEMES = {
    "fmpy": {"first_input_zero": True},
    "ecos": {"first_input_zero": False, "asked_after_sets": True},
    "libcosim": {"first_input_zero": False},
    "fmucontainer": {"first_input_zero": False},
}


@dataclass
class Part:
    """One component as plain equations, with the calls that a slave offers."""

    composed: Any
    parameters: dict[str, float]
    buffers: list[Any]
    inputs: dict[str, float] = field(default_factory=dict)
    outputs: dict[str, float] = field(default_factory=dict)
    stepped: dict[str, float] = field(default_factory=dict)  # inputs of the last step

    def __post_init__(self):
        self.equations = self.composed.module
        self.p = self.equations.Parameters(**self.parameters)
        self.inputs = {name: v.start for name, v in self.composed.inputs.items()}

    def u(self, time):
        extra = (time,) if self.composed.takes_time else ()
        return self.equations.Input(*self.inputs.values(), *extra)

    def begin(self):
        u = self.u(0.0)
        self.x = self.equations.start(u, self.p)
        self.m = self.equations.begin(self.x, u, self.p, [list(b) for b in self.buffers])
        self.publish(u)

    def step(self, time, h):
        u, self.stepped = self.u(time + h), dict(self.inputs)
        self.x, self.m = self.equations.advance(self.x, self.m, u, self.p, self.c)
        self.publish(u)

    def now(self, name):
        """An output as an FMU answers after its inputs changed: what follows them at once by a step of length 0."""
        if name not in self.composed.direct or self.inputs == self.stepped:
            return self.outputs[name]
        u, none = self.u(0.0), self.equations.coefficients(self.p, 0.0)
        x, m = self.equations.advance(self.x, self.m, u, self.p, none)
        return getattr(self.equations.output(x, u, m, self.p), name)

    def publish(self, u):
        self.outputs = self.equations.output(self.x, u, self.m, self.p)._asdict()


def read_parts(package: Path, values=None):
    """Components and connections of a closed package, read with fmpy; parameters of the .ssv files, then of `values`."""
    system = read_ssd(str(package)).system
    parts = {}
    for component in system.elements:
        stem = PurePosixPath(component.source).stem
        composed = composed_block(registry.FMU_OF_COMPONENT.get(stem, stem), stem)
        parameters = {name: v.start for name, v in composed.parameters.items()}
        (binding,) = component.parameterBindings
        (bound,) = binding.parameterValues
        parameters |= {p.name: float(p.value) for p in bound.parameters}
        parameters |= (values or {}).get(component.name, {})
        parts[component.name] = Part(
            composed, parameters, list(read_buffers(package, component.source, composed))
        )
    wires = [(c.startElement, c.startConnector, c.endElement, c.endConnector) for c in system.connections]
    return parts, wires


def read_buffers(package: Path, source: str, composed):
    """Arrays that the block and its effects remember; those from a table are read out of the FMU."""
    for item in composed.memory.values():
        if not isinstance(item, Buffer):
            continue
        if not item.resource:
            yield [0.0] * item.length
            continue
        name, _, column = item.resource.partition(":")
        with zipfile.ZipFile(package) as outer, zipfile.ZipFile(io.BytesIO(outer.read(source))) as fmu:
            lines = fmu.read(f"resources/{name}").decode().splitlines()[1:]
        yield [float(line.split(",")[int(column)]) for line in lines]


def simulate(
    package: Path,
    steps: int,
    h: float,
    signals,
    *,
    first_input_zero: bool,
    asked_after_sets=False,
    values=None,
):
    """Results of the Jacobi scheme: an array of shape (steps + 1,) for each signal, the first at initialisation."""
    parts, wires = read_parts(package, values)

    def transfer():
        for start, output, end, entry in wires:
            parts[end].inputs[entry] = parts[start].outputs[output]

    for _ in range(1 if first_input_zero else len(parts) + 1):
        for part in parts.values():
            part.begin()
        if not first_input_zero:
            transfer()
    places = [name.partition(".")[::2] for name in signals]
    table = np.empty((steps + 1, len(places)))
    table[0] = [parts[a].outputs[b] for a, b in places]
    for part in parts.values():
        part.c = part.equations.coefficients(part.p, h)
    for k in range(steps):
        for part in parts.values():
            part.step(k * h, h)
        transfer()
        table[k + 1] = [parts[a].now(b) if asked_after_sets else parts[a].outputs[b] for a, b in places]
    return dict(zip(signals, table.T, strict=True))
