"""Dry friction beside a component that nobody here knows: what an input gets, less what rubs against the motion it makes.

    y = u - F;  F = v / (2 a h), within -level .. level

It stands before an input and reads an output of the same component, of which v is the speed. Near rest the friction of one
step h takes half of the speed away, a being by how much the input accelerates it: no step turns the motion round.
"""

import sys
from typing import Annotated, Any, NamedTuple

from fmus.contract import Block, Variable, equation


class Input(NamedTuple):
    """What comes in."""

    u: Annotated[float, Variable("1", "Signal before the friction, in its own unit")]
    x: Annotated[float, Variable("1", "Place or speed of what rubs, in its own unit")]


class Output(NamedTuple):
    """What goes on."""

    y: Annotated[float, Variable("1", "Signal less the friction, in its own unit")]


class State(NamedTuple):
    """What is remembered from step to step."""

    y: Annotated[float, Variable("1", "Signal less the friction")]
    x: Annotated[float, Variable("1", "Place or speed at the last step")]


class Parameters(NamedTuple):
    """How much it rubs."""

    level: Annotated[float, Variable("1", "Dry friction, in the signal's unit", 0.0, 0.0, source="off: 0")]
    acceleration: Annotated[float, Variable("1/s", "Change of the speed per second, over the signal", 1.0, 1e-12, source="the component's own")]  # fmt: skip
    of_place: Annotated[float, Variable("1", "1: x is a place, 0: x is a speed", 1.0, 0.0, 1.0, kind="integer", source="what the output is")]  # fmt: skip


class Coefficients(NamedTuple):
    """The step, s, and the friction over the speed near rest."""

    h: float
    slope: float


@equation
def start(u: Input, p: Parameters) -> State:
    """Nothing has moved yet."""
    return State(u.u, u.x)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """The slope that the step allows."""
    return Coefficients(h, 0.5 / (p.acceleration * h))


@equation
def step(x: State, u: Input, m: Any, p: Parameters, c: Coefficients) -> State:
    """One step: the friction over it is that of the speed at its start."""
    speed = u.x
    if p.of_place > 0.5:
        speed = (u.x - x.x) / c.h
    return State(u.u - min(max(c.slope * speed, -p.level), p.level), u.x)


@equation
def output(x: State, u: Input, m: Any, p: Parameters) -> Output:
    """The state's."""
    return Output(x.y)


BLOCK = Block(
    name="port_friction",
    title="Dry friction before an input, against the motion of an output",
    module=sys.modules[__name__],
    reads={"u": "line", "x": "held"},
)
