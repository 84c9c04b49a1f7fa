"""Slew sensor: a draw-wire over a disc. Nominally the angle itself (CONTRACT section 6); its faults are effects.

slew = theta
"""

import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation, slot


class Input(NamedTuple):
    """What comes in."""

    theta: Annotated[float, Variable("rad", "Slew angle", low=-1e6, high=1e6, display="deg")]


class Output(NamedTuple):
    """What goes out."""

    slew: Annotated[float, Variable("rad", "Measured slew angle", display="deg")]


class State(NamedTuple):
    """Memoryless but for the reading taken last."""

    slew: Annotated[float, Variable("rad", "Measured slew angle", display="deg")]


class Parameters(NamedTuple):
    """Scaling, (3.2): value = gain * angle + bias."""

    gain: Annotated[float, Variable("1", "Reading per angle", 1.0, -1e3, 1e3, source="(3.2); nominal 1 (CONTRACT section 6)")]  # fmt: skip
    bias: Annotated[float, Variable("rad", "Reading at angle zero", 0.0, -1e3, 1e3, display="deg", source="(3.2); nominal 0 (CONTRACT section 6)")]  # fmt: skip


class Coefficients(NamedTuple):
    """Nothing but the step."""

    h: float


@slot("chain")
def sensed_angle(theta: float, m: NoMemory, p: Parameters) -> float:
    """The angle as the sensing element sees it, rad; effects such as a lag act here."""
    return theta


@slot("chain")
def transmitted(slew: float, m: NoMemory, p: Parameters) -> float:
    """The reading as it arrives in the log, rad; effects such as quantisation and lost packets act here."""
    return slew


@equation
def start(u: Input, p: Parameters) -> State:
    """The first reading."""
    return State(p.gain * u.theta + p.bias)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Nothing depends on the step."""
    return Coefficients(h)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(3.2): the reading at the end of the step."""
    return State(transmitted(p.gain * sensed_angle(u.theta, m, p) + p.bias, m, p))


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The reading."""
    return Output(x.slew)


BLOCK = Block(
    name="sensor",
    title="Slew sensor",
    module=sys.modules[__name__],
    feedthrough={"slew": ("theta",)},
)
