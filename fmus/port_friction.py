"""Dry friction beside a component that nobody here knows: what an input gets, less what rubs against the motion it makes.

    y = u - F;  F = e / (2 a h^2) + v / (2 a h), within -level .. level

It stands before an input and reads an output of the same component, of which v is the speed. A bristle gives by the way e
until it slips at the level (Prandtl, Dahl), so that what rubs stays where it is held. Bristle and damping are as stiff as
steps of h allow, a being by how much the input accelerates: half of a speed near rest is left after a step, and half of the
way.
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
    e: Annotated[float, Variable("1", "Way by which the bristle gives")]


class Parameters(NamedTuple):
    """How much it rubs."""

    level: Annotated[float, Variable("1", "Dry friction, in the signal's unit", 0.0, 0.0, source="off: 0")]
    acceleration: Annotated[float, Variable("1/s", "Change of the speed per second, over the signal", 1.0, 1e-12, source="the component's own")]  # fmt: skip
    of_place: Annotated[float, Variable("1", "1: x is a place, 0: x is a speed", 1.0, 0.0, 1.0, kind="integer", source="what the output is")]  # fmt: skip


class Coefficients(NamedTuple):
    """The step, s, and the friction over the speed near rest and over the way."""

    h: float
    slope: float
    stiffness: float


@equation
def start(u: Input, p: Parameters) -> State:
    """Nothing has moved yet."""
    return State(u.u, u.x, 0.0)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """What the step allows."""
    return Coefficients(h, 0.5 / (p.acceleration * h), 0.5 / (p.acceleration * h * h))


@equation
def step(x: State, u: Input, m: Any, p: Parameters, c: Coefficients) -> State:
    """One step: the friction over it is that of the motion until its start."""
    way = u.x * c.h
    if p.of_place > 0.5:
        way = u.x - x.x
    most = p.level / c.stiffness
    e = min(max(x.e + way, -most), most)
    force = min(max(c.stiffness * e + c.slope * way / c.h, -p.level), p.level)
    return State(u.u - force, u.x, e)


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
