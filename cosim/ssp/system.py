"""What reading an SSP or FMU gives: plain data about components, wires and values. Nothing here loads a library."""

import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from cosim.ssp.quantities import UnitDefinition

Value = float | int | bool | str
"""A value of an FMI variable: Real, Integer or Enumeration, Boolean, String."""


NUMERIC = ("Real", "Integer", "Enumeration", "Boolean")


def alike(kind: str) -> str:
    """A type by how it is handed on: an Enumeration is a whole number, and SSP 2.0 has the types of FMI 3.0."""
    if kind in ("Float64", "Float32"):
        return "Real"
    return "Integer" if kind == "Enumeration" or "Int" in kind else kind


"""Kinds of variables whose values are numbers, and can be signals; those that are not Real are held over each step."""


class Port(NamedTuple):
    """A variable of a component; as text ``component.variable``."""

    component: str
    variable: str

    def __str__(self) -> str:
        return f"{self.component}.{self.variable}"


@dataclass(frozen=True)
class Variable:
    """One scalar variable of an FMU.

    Attributes:
        name: its name in the FMU.
        reference: its value reference.
        kind: Real, Integer, Boolean, String or Enumeration.
        causality, variability, initial: as in FMI 2.0, with the standard's defaults filled in.
        start: start value of the model description, or None.
        unit: unit of its numbers; empty if none is declared.
        display_unit: unit to show it in; empty if none is declared.
        display_factor, display_offset: shown = factor * value + offset.
        low, high: declared bounds, in `unit`.
        type: by which functions of FMI it is set and got: of 2.0 Real, Integer, Boolean or String, of 3.0 Float64, Float32,
            Int8 to UInt64, Boolean or String; the `kind` of these is Real, Integer, Enumeration, Boolean or String.
        description: what the FMU says of it.
    """

    name: str
    reference: int
    kind: str
    causality: str
    variability: str
    initial: str
    start: Value | None
    unit: str
    display_unit: str
    display_factor: float
    display_offset: float
    low: float
    high: float
    type: str = "Real"
    description: str = ""

    @property
    def can_be_set(self) -> bool:
        """Whether a start value may be given before initialisation (FMI 2.0, section 2.2.7; 3.0, section 2.4.7.4)."""
        return (
            self.variability != "constant"
            and self.causality != "structuralParameter"
            and (self.causality in ("input", "parameter") or self.initial in ("exact", "approx"))
        )


@dataclass(frozen=True)
class Fmu:
    """An unpacked co-simulation FMU of FMI 2.0 or 3.0.

    Attributes:
        source: its name in the archive, for messages.
        folder: where it is unpacked.
        guid, identifier: of the model description; FMI 3.0 calls the first an instantiation token.
        variables: by name.
        dependencies: output name -> names of the inputs it depends on directly; an output not listed depends on all.
        units: its unit definitions by name.
        start_time, stop_time, step_size: of the default experiment [s], or None.
        variable_steps: it accepts steps of any size.
        module: (name, digest) of the Python module that pythonfmu will import, or None.
        ours: this installation built it (`cosim.trust`).
        tolerance: of the default experiment, for the FMU's own step-size control, or None.
        keeps_state: it says that its state can be read and set.
        restarts: its runs begin by setting the state that it had when it was instantiated; for callers who have made sure
            that this gives what a new instance gives.
        begins: inputs of which a step takes the value at its start.
        oddities: rules of FMI that it breaks and that stop nobody from running it, with words.
        version: of FMI, 2.0 or 3.0.
        left_out: variables of FMI 3.0 that are no single number or text: arrays, clocks, binary data. They keep their start.
        misshown: display units whose factor contradicts their name: numbers are shown in the unit itself.
        house: this project exported it, on whatever machine.
    """

    source: str
    folder: Path
    guid: str
    identifier: str
    variables: Mapping[str, Variable]
    dependencies: Mapping[str, frozenset[str]]
    units: Mapping[str, UnitDefinition]
    step_size: float | None
    variable_steps: bool
    module: tuple[str, str] | None
    ours: bool = False
    start_time: float | None = None
    stop_time: float | None = None
    tolerance: float | None = None
    oddities: tuple[str, ...] = ()
    keeps_state: bool = False
    restarts: bool = False
    begins: frozenset[str] = frozenset()
    version: str = "2.0"
    left_out: tuple[str, ...] = ()
    misshown: tuple[str, ...] = ()
    house: bool = False


@dataclass(frozen=True)
class Component:
    """An instance of an FMU in a system; `starts` are the values that its parameter bindings give, in the FMU's units."""

    name: str
    fmu: Fmu
    starts: Mapping[str, Value]


@dataclass(frozen=True)
class Wire:
    """A connection: target = factor * source + offset."""

    source: Port
    target: Port
    factor: float = 1.0
    offset: float = 0.0

    def __str__(self) -> str:
        return f"{self.source} -> {self.target}"


FOUND = "diagnosis"  # name of a parameter set with the numbers that a diagnosis has found


@dataclass(frozen=True)
class SystemInput:
    """An input connector of the system and the component inputs it feeds (the source of each wire is the system)."""

    name: str
    unit: str
    targets: tuple[Wire, ...]


@dataclass
class System:
    """A flat system, ready to be simulated; use it as a context manager, or `close` it: its FMUs lie in a temporary folder.

    Attributes:
        name: of the system.
        path: the file it was read from.
        components: by name, in the order of the file.
        wires: connections between components.
        inputs: input connectors of the system by name.
        outputs: output connectors of the system: name -> the component's variable behind it.
        parameters: parameter connectors of the system: name -> the components' variables behind it.
        found: ``component.variable`` of numbers that a diagnosis has put into an extended model.
        notes: what the user should know, such as inputs that are not connected.
        start_time, stop_time: default experiment [s], or None.
    """

    name: str
    path: Path
    components: dict[str, Component]
    wires: tuple[Wire, ...]
    inputs: dict[str, SystemInput] = field(default_factory=dict)
    outputs: dict[str, Port] = field(default_factory=dict)
    parameters: dict[str, tuple[Port, ...]] = field(default_factory=dict)
    found: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    start_time: float | None = None
    stop_time: float | None = None
    folder: "tempfile.TemporaryDirectory[str] | None" = None

    def variable(self, port: Port) -> Variable:
        """The declaration of a component's variable (KeyError if there is none)."""
        return self.components[port.component].fmu.variables[port.variable]

    def places(self, ports: Iterable[Port]) -> set[tuple[str, int]]:
        """Component and reference of each variable: aliases, which FMI 3.0 lists, share them."""
        return {(port.component, self.variable(port).reference) for port in ports}

    @property
    def step_size(self) -> float | None:
        """Smallest step that an FMU's default experiment asks for [s], or None."""
        steps = [c.fmu.step_size for c in self.components.values() if c.fmu.step_size]
        return min(steps) if steps else None

    def close(self) -> None:
        """Delete the unpacked FMUs; no Runner of this system may still be open."""
        if self.folder is not None:
            self.folder.cleanup()
            self.folder = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
