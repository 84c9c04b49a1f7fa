"""Reference of the position loop: goes to the commanded angle at limited speed and acceleration.

    target = theta_r + scale command;   |rate| <= w_max,   |d rate/dt| <= a_max

Before t_switch the drive is in manual: the reference stands at the measured angle, so that the loop closes without an error.
The braking speed that stops at the target in whole steps h is sqrt((a h / 2)^2 + 2 a |distance|) - a h / 2.
"""

import math
import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation


class Input(NamedTuple):
    """What comes in."""

    command: Annotated[float, Variable("1", "Commanded angle, as a share of the scale", low=-100.0, high=100.0)]  # fmt: skip
    slew: Annotated[float, Variable("rad", "Measured slew angle", low=-1e6, high=1e6, display="deg")]
    time: Annotated[float, Variable("s", "Communication time", kind="time")]


class Output(NamedTuple):
    """What goes out."""

    reference: Annotated[float, Variable("rad", "Reference of the slew angle", display="deg")]
    reference_rate: Annotated[float, Variable("rad/s", "Its rate", display="deg/s", nominal=0.01)]
    automatic: Annotated[float, Variable("1", "1 from t_switch on, 0 before")]


class State(NamedTuple):
    """Where the reference is."""

    angle: Annotated[float, Variable("rad", "Reference of the slew angle", display="deg")]
    rate: Annotated[float, Variable("rad/s", "Its rate", display="deg/s", nominal=0.01)]
    automatic: Annotated[float, Variable("1", "1 from t_switch on, 0 before")]


class Parameters(NamedTuple):
    """Scale, limits and the time of the switch."""

    theta_r: Annotated[float, Variable("rad", "Angle at no command", 0.0, -1e3, 1e3, display="deg", source="convention: the angle at which the drive starts")]  # fmt: skip
    scale: Annotated[float, Variable("rad", "Angle for a command of 1", 0.17453292519943295, -1e3, 1e3, display="deg", source="choice: 10 deg")]  # fmt: skip
    w_max: Annotated[float, Variable("rad/s", "Largest rate", 0.03141592653589793, 1e-9, 1e3, display="deg/s", nominal=0.01, source="choice: 1.8 deg/s, four fifths of the drive's top speed (5.12)")]  # fmt: skip
    a_max: Annotated[float, Variable("rad/s2", "Largest acceleration", 0.05235987755982988, 1e-9, 1e6, display="deg/s2", nominal=0.01, source="choice: 3 deg/s2, reaches w_max in 0.6 s")]  # fmt: skip
    t_switch: Annotated[float, Variable("s", "Time at which manual ends", 0.0, -1e9, 1e9, source="off: automatic from the start")]  # fmt: skip


class Coefficients(NamedTuple):
    """Nothing but the step."""

    h: float


@equation
def toward(angle: float, rate: float, target: float, p: Parameters, h: float) -> tuple[float, float]:
    """Angle, rad, and rate, rad/s, one step of h s nearer to the target."""
    distance = target - angle
    half = 0.5 * p.a_max * h
    brake = math.sqrt(half * half + 2.0 * p.a_max * abs(distance)) - half
    wanted = math.copysign(min(p.w_max, brake, abs(distance) / h), distance)
    new = max(rate - p.a_max * h, min(rate + p.a_max * h, wanted))
    return angle + h * new, new


@equation
def start(u: Input, p: Parameters) -> State:
    """Standing at the measured angle."""
    return State(u.slew, 0.0, 1.0 if u.time >= p.t_switch - 1e-9 else 0.0)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Nothing depends on the step."""
    return Coefficients(h)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """One step of length c.h."""
    if u.time < p.t_switch - 1e-9:
        return State(u.slew, 0.0, 0.0)
    angle, rate = toward(x.angle, x.rate, p.theta_r + p.scale * u.command, p, c.h)
    return State(angle, rate, 1.0)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """Where the reference is."""
    return Output(x.angle, x.rate, x.automatic)


BLOCK = Block(
    name="reference",
    title="Reference of the position loop",
    module=sys.modules[__name__],
    reads={"command": "instant", "slew": "instant"},
)
