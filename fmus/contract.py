"""What a block is.

A block file declares four named tuples and a handful of equations::

    class Input(NamedTuple):  ...      each field: Annotated[float, Variable(unit, text, start, low, high, ...)]
    class Output(NamedTuple): ...
    class State(NamedTuple):  ...
    class Parameters(NamedTuple): ...
    class Coefficients(NamedTuple): ... what depends on parameters and step size alone, computed once

    start(u, p) -> State                   state at initialisation
    coefficients(p, h) -> Coefficients
    step(x, u, m, p, c) -> State           one communication step of length c.h
    output(x, u, m, p) -> Output

Equations use `math` and plain scalars only, so that one text serves the FMU (standard library), the compiled twin
(numba) and a C export. ``m`` is the memory of effects (empty without any). A `@slot` is a place where effects act: a
function that without effects returns its neutral value.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import ModuleType
from typing import Any, Literal, NamedTuple, TypeVar, get_type_hints

UNBOUNDED = 1e12  # beyond any physical value here, yet a number that every FMI client reads

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True)
class Variable:
    """One quantity, declared once.

    Attributes:
        unit: SI unit in FMI's spelling, "1" if dimensionless.
        text: what it is, one line.
        start: default value, in `unit`; for a parameter of an effect its "off" value.
        low, high: smallest and largest admissible value, in `unit`.
        display: unit shown to people, or None for `unit` itself.
        nominal: typical magnitude, in `unit`.
        source: equation, table or paper that the value comes from (required for parameters).
        kind: "real" or "integer"; "time" marks an input filled with the communication time, not an FMI variable.
        discrete: the value is held between communication points (FMI variability ``discrete``).
    """

    unit: str
    text: str
    start: float = 0.0
    low: float = -UNBOUNDED
    high: float = UNBOUNDED
    display: str | None = None
    nominal: float = 1.0
    source: str = ""
    kind: Literal["real", "integer", "time"] = "real"
    discrete: bool = False

    @property
    def frequency(self) -> bool:
        """True of an angular frequency: it stays one where a travel stands for the angle."""
        return self.unit == "rad/s" and "frequency" in self.text.lower()


@dataclass(frozen=True)
class Buffer:
    """Memory of an effect or block that is an array of `length` numbers, changed in place (length 0: filled from `resource`)."""

    length: int
    text: str
    resource: str = ""


class NoMemory(NamedTuple):
    """The memory of a block without effects."""


def equation(function: F) -> F:
    """Mark a function as part of a block's equations: it goes into the composed text. Changes nothing else."""
    function.__dict__["is_equation"] = True
    return function


def slot(rule: Literal["sum", "chain"]) -> Callable[[F], F]:
    """Mark a function as a place where effects act.

    ``sum``: effects' terms are added to the function's own value. ``chain``: the first argument is a value that each
    effect in turn replaces.
    """

    def mark(function: F) -> F:
        function.__dict__["is_equation"] = True
        function.__dict__["slot_rule"] = rule
        return function

    return mark


def fields(layout: type) -> dict[str, Variable]:
    """The `Variable` of each field of a named tuple declared with ``Annotated[float, Variable(...)]``, in order."""
    return dict(_declared(layout))


@lru_cache(maxsize=1024)
def _declared(layout: type) -> tuple[tuple[str, Variable], ...]:
    hints = get_type_hints(layout, include_extras=True)
    return tuple((name, hints[name].__metadata__[0]) for name in layout._fields)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Block:
    """A block: its name, declarations and equations, read from a module of this package.

    Attributes:
        name: file name of the FMU and its model identifier.
        title: one line for people.
        module: the module that declares it.
        feedthrough: outputs that depend directly on an input, with those inputs.
        reads: what each input stands for over a step from t to t + h. "held": its value from t to t + h; "line": its value at
            t + h, joined by a straight line to that of the step before; "instant": its value at t + h, read as it is;
            "start": its value at t, from which it goes on as in the step before (a wire that closes a loop).
        memory: arrays that the block itself remembers (a table it plays).
        helpers: equations of other modules that this block's equations call.
        step_size: default communication step, s.
    """

    name: str
    title: str
    module: ModuleType
    feedthrough: dict[str, tuple[str, ...]] = field(default_factory=dict)
    reads: dict[str, Literal["held", "line", "instant", "start"]] = field(default_factory=dict)
    memory: dict[str, Buffer] = field(default_factory=dict)
    helpers: tuple[Callable[..., Any], ...] = ()
    step_size: float = 1e-3

    @property
    def commanded(self) -> bool:
        """True if it is made for a command: it takes that as held, or hands it on as it comes."""
        return set(self.reads.values()) <= {"held", "instant"}

    @property
    def inputs(self) -> dict[str, Variable]:
        """Input variables by name, in order; one of kind "time" is not an FMI variable."""
        return fields(self.module.Input)

    @property
    def outputs(self) -> dict[str, Variable]:
        """Output variables by name, in order."""
        return fields(self.module.Output)

    @property
    def states(self) -> dict[str, Variable]:
        """State variables by name, in order."""
        return fields(self.module.State)

    @property
    def parameters(self) -> dict[str, Variable]:
        """Parameters by name, in order, without those of effects."""
        return fields(self.module.Parameters)

    @property
    def equations(self) -> tuple[Callable[..., Any], ...]:
        """The block's own equations in the order of its file, without those of `helpers`."""
        found = [f for f in vars(self.module).values() if getattr(f, "is_equation", False)]
        return tuple(f for f in found if f.__module__ == self.module.__name__)

    @property
    def slots(self) -> dict[str, Literal["sum", "chain"]]:
        """Places where effects act, with their rule."""
        return {f.__name__: f.__dict__["slot_rule"] for f in self.equations if "slot_rule" in f.__dict__}


QUARTER = 0.5 * math.pi  # rad, of a turn


@dataclass(frozen=True)
class Free:
    """How a parameter of an effect is estimated from data.

    Attributes:
        starts: values from which searches begin, SI.
        scale: typical size of a moderate deviation from the off value, SI.
        floor: deviation from the off value that is too small to matter in practice, SI; 0 where the size alone does not tell.
        limits: measured signal that the parameter limits, above if its starts are positive: searches begin at its extremes
            too, because where a limit is out of reach nothing leads to it.
        rate: it limits that signal's rate of change.
        phase: the parameter is the phase of a sine whose amplitude is the effect's key: any sine is a sum of two of them,
            so amplitude and phase are found from two starts a quarter of a turn apart.
        within: another free parameter of the effect, of the same unit, and how many times as large as it this one can
            physically be; both are sizes and never negative.
    """

    starts: tuple[float, ...]
    scale: float
    floor: float = 0.0
    limits: str = ""
    rate: bool = False
    phase: bool = False
    within: tuple[str, float] | None = None


@dataclass(frozen=True)
class Range:
    """Where a parameter of a cause can physically be, on any machine: beyond it something else is wrong, a label or the law.

    Attributes:
        low, high: its edges, SI, or in parts of what `of` says.
        reason: why it ends there.
        of: "nominal": in parts of its nominal value; "torque": of the greatest torque with which the log drives the machine;
            "travel": of the spool's travel at full command.
    """

    low: float
    high: float
    reason: str
    of: Literal["", "nominal", "torque", "travel"] = ""

    def edges(
        self, nominal: float, torque: float = math.nan, travel: float = math.nan
    ) -> tuple[float, float]:
        """Lowest and highest value, SI, by the nominal value, the greatest torque and the travel; NaN where these are not known.

        Nor is a nominal value of zero, of which any part is zero.
        """
        whole = {"": 1.0, "nominal": nominal or math.nan, "torque": torque, "travel": travel}[self.of]
        low, high = sorted((self.low * whole, self.high * whole))
        return low, high


@dataclass(frozen=True, eq=False)
class Effect:
    """One physical effect of the library. Effects of one name are equal, whatever is free in them.

    Attributes:
        name: "block.effect", which no version changes; the first part is the block it is reported under.
        text: what happens, one line.
        residual: what its residual looks like in the data.
        source: where its form comes from.
        acts_on: component of the system whose equations it changes (mostly the block it is reported under).
        key: the parameter which, at its off value, switches the effect off.
        parameters: new parameters of the block, `start` being the off value.
        free: how each parameter that the effect changes is estimated; it may be the block's own (J, K, tau_c).
        forms: parameters each of which gives its law another form, with how it is estimated: tried, one at a time, only
            where the effect explains much and its simplest law leaves something.
        form_of_place: the form that it has from the beginning where a drive holds a demanded place; empty if none.
        fills: slot name -> equation with the slot's signature.
        memory: what it remembers between steps: `Variable` or `Buffer` by name.
        begin: equation (x, u, p) -> tuple of initial memory values (of the Variables only), or None without memory.
        remember: equation (x, x1, u, m, p, c) -> tuple of the new values of the Variables.
        when: "before" the block's step (x1 is x then) or "after" it.
        helpers: further equations that these call.
        asked: the diagnosis considers it only where a mapping file asks for it.
        alone: without being asked, only where its block is judged by itself: among others its law is not told from theirs.
        ends: without being asked, only where its block is the last with dynamics before what is measured.
        repeats: its law repeats within a small part of the travel: without being asked, only where a place is measured.
        bends: it bends the static curve of the drive, or ends its travel: such effects are sought together.
        sole_form: its law can have no other form (an offset, a factor, an inertia): what it leaves is none of its own.
        ranges: where those of its parameters can physically be whose declaration admits more.
        prior: log odds against the other effects before a log is seen.
        on: another block that runs under the same component -> what of the above is otherwise there; the effect has no place
            in one that is not named.
        only: the one block that has it, where that is not the usual one of its component.
    """

    name: str
    text: str
    residual: str
    source: str
    key: str
    acts_on: str = ""
    parameters: dict[str, Variable] = field(default_factory=dict)
    free: dict[str, Free] = field(default_factory=dict)
    forms: dict[str, Free] = field(default_factory=dict)
    form_of_place: str = ""
    fills: dict[str, Callable[..., Any]] = field(default_factory=dict)
    memory: dict[str, Variable | Buffer] = field(default_factory=dict)
    begin: Callable[..., Any] | None = None
    remember: Callable[..., Any] | None = None
    when: Literal["before", "after"] = "before"
    helpers: tuple[Callable[..., Any], ...] = ()
    asked: bool = False
    alone: bool = False
    ends: bool = False
    repeats: bool = False
    bends: bool = False
    sole_form: bool = False
    ranges: dict[str, Range] = field(default_factory=dict)
    prior: float = 0.0
    on: dict[str, dict[str, Any]] = field(default_factory=dict)
    only: str = ""

    @property
    def block(self) -> str:
        """The block it is reported under, e.g. "mechanical"."""
        return self.name.partition(".")[0]

    @property
    def component(self) -> str:
        """The component whose equations it changes, e.g. "dead_zone" for dcv.hysteresis."""
        return self.acts_on or self.block

    def formed(self, parameter: str) -> "Effect":
        """The effect with the parameter of another form of its law free as well."""
        return replace(self, free={**self.free, parameter: self.forms[parameter]})

    @property
    def plain(self) -> "Effect":
        """The effect in its simplest form."""
        return replace(self, free={n: f for n, f in self.free.items() if n not in self.forms})

    @property
    def is_formed(self) -> bool:
        """True if the parameter of another form of its law is free."""
        return any(parameter in self.free for parameter in self.forms)

    def __eq__(self, other: object) -> bool:
        """True for an effect of the same name."""
        return isinstance(other, Effect) and other.name == self.name

    def __hash__(self) -> int:
        """Of the name."""
        return hash(self.name)
