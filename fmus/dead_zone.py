"""Dead zone and its two inverses, one block used twice: as compensator in the controller and as the valve's dead zone.

    form 1   DZ(x) = m_r (x - b_r), x >= b_r;  0, b_l < x < b_r;  m_l (x - b_l), x <= b_l       (2.2)
    form 2   DZ^-1(x) = x/m_r + b_r, x > 0;  0, x = 0;  x/m_l + b_l, x < 0                        (2.3)
    form 3   x + d_plus tanh(S x), x > 0;  0, x = 0;  x + d_minus tanh(S x), x < 0               (4.9)

The result is limited to +-limit. Form 2 undoes form 1 exactly. Form 3 does so only where tanh has reached 1: with the numbers
of Table 4.1 and S = 50, commands between -3.18 % and +3.28 % leave the demand inside the dead zone, and of 7 % still 0.08 %
are lost.
"""

import math
import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation, slot


class Input(NamedTuple):
    """What comes in."""

    command: Annotated[float, Variable("1", "Command", low=-100.0, high=100.0)]


class Output(NamedTuple):
    """What goes out."""

    demand: Annotated[float, Variable("1", "Command behind the dead zone or its inverse")]


class State(NamedTuple):
    """Memoryless but for the value it applied last."""

    demand: Annotated[float, Variable("1", "Command behind the dead zone or its inverse")]


class Parameters(NamedTuple):
    """Which of the three forms, and their numbers."""

    form: Annotated[float, Variable("1", "1: dead zone (2.2), 2: inverse (2.3), 3: smooth inverse (4.9)", 1.0, 1.0, 3.0, kind="integer", source="(2.2), (2.3), (4.9)")]  # fmt: skip
    m_r: Annotated[float, Variable("1", "Slope on the right", 1.0, 1e-3, 1e3, source="(2.2); nominal 1")]
    b_r: Annotated[
        float, Variable("1", "Break point on the right", 0.45, 0.0, 10.0, display="%", source="Table 4.1")
    ]
    m_l: Annotated[float, Variable("1", "Slope on the left", 1.0, 1e-3, 1e3, source="(2.2); nominal 1")]
    b_l: Annotated[
        float, Variable("1", "Break point on the left", -0.40, -10.0, 0.0, display="%", source="Table 4.1")
    ]
    d_plus: Annotated[float, Variable("1", "Compensation to the right (form 3)", 0.45, 0.0, 10.0, display="%", source="Table 4.1")]  # fmt: skip
    d_minus: Annotated[float, Variable("1", "Compensation to the left (form 3)", 0.40, 0.0, 10.0, display="%", source="Table 4.1")]  # fmt: skip
    S: Annotated[float, Variable("1", "Sharpness of tanh (form 3); not given in the source", 50.0, 1e-3, 1e6, source="SYSTEM section 3")]  # fmt: skip
    limit: Annotated[float, Variable("1", "Largest magnitude of the result", 1.0, 1e-6, 100.0, source="full opening")]  # fmt: skip


class Coefficients(NamedTuple):
    """Nothing but the step."""

    h: float


@slot("chain")
def incoming_command(command: float, m: NoMemory, p: Parameters) -> float:
    """The command as it reaches the dead zone, 1; effects such as play act here."""
    return command


@equation
def characteristic(x: float, p: Parameters) -> float:
    """The static curve (2.2), (2.3) or (4.9), before the limit; x and result dimensionless."""
    if p.form == 1.0:
        if x >= p.b_r:
            return p.m_r * (x - p.b_r)
        if x <= p.b_l:
            return p.m_l * (x - p.b_l)
        return 0.0
    if x == 0.0:
        return 0.0
    if p.form == 2.0:
        return x / p.m_r + p.b_r if x > 0.0 else x / p.m_l + p.b_l
    return x + (p.d_plus if x > 0.0 else p.d_minus) * math.tanh(p.S * x)


@equation
def limited(x: float, p: Parameters) -> float:
    """The static curve, limited to +-limit."""
    return max(-p.limit, min(p.limit, characteristic(x, p)))


@equation
def start(u: Input, p: Parameters) -> State:
    """State at initialisation."""
    return State(limited(u.command, p))


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Nothing depends on the step."""
    return Coefficients(h)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """The value applied over the step; x.demand of the step before is forgotten."""
    return State(limited(incoming_command(u.command, m, p), p))


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The value applied."""
    return Output(x.demand)


BLOCK = Block(
    name="dead_zone",
    title="Dead zone of the valve, or its inverse in the controller",
    module=sys.modules[__name__],
    feedthrough={"demand": ("command",)},
    reads={"command": "instant"},
)
