"""Slew sensor: a draw-wire over a disc, and the filter of its input. Nominally the angle itself.

    reading = gain * theta + bias, between low and high               (3.2)
    slew'' + sqrt(2) w slew' + w^2 slew = w^2 reading,  w = 2 pi f_c    (2.1), (3.1): Butterworth, order 2

The reading moves on a straight line over a step, and the filter's solution is exact for that. At f_c = 0 there is no
filter: slew = reading. Faults of the sensor are effects.
"""

import math
import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation, slot
from fmus.linear import expm2


class Input(NamedTuple):
    """What comes in."""

    theta: Annotated[float, Variable("rad", "Slew angle", low=-1e6, high=1e6, display="deg")]


class Output(NamedTuple):
    """What goes out."""

    slew: Annotated[float, Variable("rad", "Measured slew angle", display="deg")]


class State(NamedTuple):
    """The reading taken last, before and behind the filter."""

    slew: Annotated[float, Variable("rad", "Measured slew angle", display="deg")]
    reading: Annotated[float, Variable("rad", "Reading before the filter", display="deg")]
    filtered: Annotated[float, Variable("rad", "Reading behind the filter", display="deg")]
    filtered_rate: Annotated[float, Variable("rad/s", "Its rate", display="deg/s")]


class Parameters(NamedTuple):
    """Scaling, (3.2): value = gain * angle + bias; and the input filter's cut-off."""

    gain: Annotated[float, Variable("1", "Reading per angle", 1.0, -1e3, 1e3, source="(3.2); nominal 1")]  # fmt: skip
    bias: Annotated[float, Variable("rad", "Reading at angle zero", 0.0, -1e3, 1e3, display="deg", source="(3.2); nominal 0")]  # fmt: skip
    low: Annotated[float, Variable("rad", "Lowest reading, where the sensor saturates; -1e6 rad is out of reach", -1e6, -1e6, 1e6, display="deg", source="off: (3.2) has no limit")]  # fmt: skip
    high: Annotated[float, Variable("rad", "Highest reading, where the sensor saturates; 1e6 rad is out of reach", 1e6, -1e6, 1e6, display="deg", source="off: (3.2) has no limit")]  # fmt: skip
    f_c: Annotated[float, Variable("Hz", "Cut-off of the input filter; 0: none", 0.0, 0.0, 1e6, nominal=1e3, source="(2.1), (3.1): 1 kHz on the rig; nominal off, the angle itself")]  # fmt: skip


class Coefficients(NamedTuple):
    """Of the filter: transition matrix of (deviation from the lagging line, rate) over the step, and that lag, s."""

    h: float
    lag: float
    a11: float
    a12: float
    a21: float
    a22: float


@slot("chain")
def sensed_angle(theta: float, m: NoMemory, p: Parameters) -> float:
    """The angle as the sensing element sees it, rad; effects such as a lag act here."""
    return theta


@slot("chain")
def transmitted(slew: float, m: NoMemory, p: Parameters) -> float:
    """The reading as it arrives in the log, rad; effects such as quantisation and lost packets act here."""
    return slew


@equation
def read(theta: float, p: Parameters) -> float:
    """(3.2), rad, between the readings at which the sensor saturates."""
    return max(p.low, min(p.high, p.gain * theta + p.bias))


@equation
def start(u: Input, p: Parameters) -> State:
    """The first reading, the filter settled."""
    reading = read(u.theta, p)
    return State(reading, reading, reading, 0.0)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """The filter over a step of length h, s: a Butterworth of order 2 lags a line by sqrt(2)/w."""
    if p.f_c == 0.0:
        return Coefficients(h, 0.0, 0.0, 0.0, 0.0, 0.0)
    w = 2.0 * math.pi * p.f_c
    a11, a12, a21, a22 = expm2(0.0, 1.0, -w * w, -math.sqrt(2.0) * w, h)
    return Coefficients(h, math.sqrt(2.0) / w, a11, a12, a21, a22)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(3.2), and (2.1): the reading at the end of the step, behind the filter where there is one."""
    reading = read(sensed_angle(u.theta, m, p), p)
    if p.f_c == 0.0:
        return State(transmitted(reading, m, p), reading, reading, 0.0)
    slope = (reading - x.reading) / c.h
    behind = reading - slope * c.lag
    e = x.filtered - (x.reading - slope * c.lag)
    v = x.filtered_rate - slope
    filtered = behind + c.a11 * e + c.a12 * v
    return State(transmitted(filtered, m, p), reading, filtered, slope + c.a21 * e + c.a22 * v)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The reading."""
    return Output(x.slew)


BLOCK = Block(
    name="sensor",
    title="Slew sensor",
    module=sys.modules[__name__],
    feedthrough={"slew": ("theta",)},
    reads={"theta": "line"},
    helpers=(expm2,),
)
