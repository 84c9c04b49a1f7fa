"""What one native FMU holds: a block, or a chain of blocks with the wires between them; and its C text."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cosim.native.kinds import c_name
from cosim.native.translate import Program, program_of
from fmus.compose import Composed
from fmus.contract import Buffer, Variable
from fmus.dependencies import at_start, through
from fmus.describe import table

Row = tuple[str, str, Variable]  # name, causality, declaration


@dataclass(frozen=True)
class Part:
    """A component: a block with its effects, and the values it starts with, SI."""

    name: str
    composed: Composed
    starts: Mapping[str, float]

    @cached_property
    def program(self) -> Program:
        """Its equations in C; ModelError if they have no translation."""
        return program_of(self.composed, f"{c_name(self.name)}_")


@dataclass(frozen=True)
class Wire:
    """An input of a component and what feeds it: (component, output), or ("", input of the whole)."""

    target: tuple[str, str]
    source: tuple[str, str]


@dataclass(frozen=True)
class Model:
    """Everything that a native FMU is made from.

    Attributes:
        name: model identifier.
        title: one line for people.
        parts: components in the order of stepping.
        rows: variables by value reference: inputs, outputs, parameters.
        places: (component, own name) of each output and parameter, by name.
        wires: one for each input of each component.
        begin: components in the order of initialisation.
        loop: wires form a loop, so that start values are iterated.
        feedthrough: outputs that depend directly on inputs, with those inputs.
        step_size: default communication step, s.
    """

    name: str
    title: str
    parts: tuple[Part, ...]
    rows: tuple[Row, ...]
    places: Mapping[str, tuple[str, str]]
    wires: tuple[Wire, ...]
    begin: tuple[str, ...]
    loop: bool = False
    feedthrough: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    step_size: float = 1e-3

    def of(self, causality: str) -> list[tuple[str, Variable]]:
        """Variables of one causality."""
        return [(n, v) for n, c, v in self.rows if c == causality]

    def part(self, name: str) -> Part:
        """The component `name`."""
        return next(p for p in self.parts if p.name == name)

    @cached_property
    def starts(self) -> dict[str, float]:
        """Start value of every input and parameter."""
        found = {}
        for name, causality, variable in self.rows:
            if causality == "parameter":
                part, own = self.places[name]
                found[name] = self.part(part).starts.get(own, variable.start)
            elif causality == "input":
                found[name] = variable.start
        return found

    @cached_property
    def behind(self) -> dict[str, frozenset[str]]:
        """What each output depends on at initialisation: inputs, parameters, and ``component.input`` for the time."""
        outputs = {
            (p.name, n): names
            for p in self.parts
            for n, names in at_start(p.composed, time=True).items()
            if n in p.composed.outputs
        }
        found = through(outputs, {w.target: w.source for w in self.wires})
        names = {f"{part}.{own}": name for name, (part, own) in self.places.items()}
        return {n: frozenset(names.get(k, k) for k in found[self.places[n]]) for n, _ in self.of("output")}

    @property
    def clocks(self) -> frozenset[str]:
        """Inputs of components that are the communication time, as ``component.input``."""
        return frozenset(
            f"{p.name}.{n}"
            for p in self.parts
            for n, v in p.composed.block.inputs.items()
            if v.kind == "time"
        )

    @cached_property
    def initial(self) -> dict[str, frozenset[str]]:
        """Inputs and parameters on which each output depends at initialisation."""
        return {name: names - self.clocks for name, names in self.behind.items()}

    @property
    def timed(self) -> frozenset[str]:
        """Outputs on which the time itself acts."""
        return frozenset(name for name, names in self.behind.items() if names & self.clocks)

    @cached_property
    def tables(self) -> list[tuple[str, int]]:
        """(file, column) of the resources that components play."""
        found = [
            b.resource.partition(":") for p in self.parts for b in buffers(p.composed).values() if b.resource
        ]
        return [(file, int(column)) for file, _, column in found]

    def is_direct(self, part: str, output: str) -> bool:
        """True if an input of the whole acts on an output of a component at once."""
        return any(self.places[n] == (part, output) and knowns for n, knowns in self.feedthrough.items())

    @property
    def takes_time(self) -> bool:
        """True if a component wants the communication time."""
        return any(p.composed.takes_time for p in self.parts)


def buffers(composed: Composed) -> dict[str, Buffer]:
    """The lists that a block and its effects remember."""
    return {n: b for n, b in composed.memory.items() if isinstance(b, Buffer)}


def single(composed: Composed, starts: Mapping[str, float]) -> Model:
    """The model of one block, with the variables of its Python twin."""
    block = composed.block
    rows = tuple(table(composed))
    return Model(
        name=block.name,
        title=block.title,
        parts=(Part(block.name, composed, starts),),
        rows=rows,
        places={n: (block.name, n) for n, c, _ in rows if c != "input"},
        wires=tuple(Wire((block.name, n), ("", n)) for n in composed.inputs),
        begin=(block.name,),
        feedthrough=block.feedthrough,
        step_size=block.step_size,
    )


def inner_inputs(model: Model) -> list[tuple[Part, str, Variable]]:
    """Inputs that another component feeds, which the model itself must check."""
    return [
        (model.part(w.target[0]), w.target[1], model.part(w.target[0]).composed.inputs[w.target[1]])
        for w in model.wires
        if w.source[0]
    ]


def numbers(part: Part) -> list[str]:
    """Places of the plain numbers of state and memory within a component's struct."""
    lists = buffers(part.composed)
    state = [f"x.{c_name(n)}" for n in part.program.layouts["State"].names]
    return state + [f"m.{c_name(n)}" for n in part.program.layouts["Memory"].names if n not in lists]


def room(part: Part) -> int:
    """How many numbers the lists hold that a component changes."""
    return sum(b.length for b in buffers(part.composed).values() if not b.resource)
