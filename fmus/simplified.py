"""Simplified drive: command to angle in one transfer function.

    theta(s)/u(s) = k / (s (s + a))                             (4.15), (5.1)

Ends of the travel clamp the angle and take the speed into them. The command is held over a step; the solution is exact
for any step that meets no end.
"""

import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation, slot
from fmus.linear import phi_functions
from fmus.motion import stopped


class Input(NamedTuple):
    """What comes in."""

    command: Annotated[float, Variable("1", "Command", low=-100.0, high=100.0)]


class Output(NamedTuple):
    """What goes out."""

    theta: Annotated[float, Variable("rad", "Slew angle", display="deg")]
    omega: Annotated[float, Variable("rad/s", "Slew velocity", display="deg/s", nominal=0.01)]


class State(NamedTuple):
    """Second order."""

    theta: Annotated[float, Variable("rad", "Slew angle", display="deg")]
    omega: Annotated[float, Variable("rad/s", "Slew velocity", display="deg/s", nominal=0.01)]


class Parameters(NamedTuple):
    """The identified transfer function."""

    k: Annotated[float, Variable("rad/s2", "Gain: angular acceleration per unit of command", 0.17453292519943295, -1e6, 1e6, display="deg/s2", nominal=0.1, source="(4.15): 10 deg/s2")]  # fmt: skip
    a: Annotated[float, Variable("1/s", "Pole", 4.4, 0.0, 1e6, nominal=1.0, source="(4.15)")]
    theta_0: Annotated[float, Variable("rad", "Angle at the start", 0.0, -1e9, 1e9, display="deg", source="starts where the log does")]  # fmt: skip
    omega_0: Annotated[float, Variable("rad/s", "Velocity at the start", 0.0, -1e3, 1e3, display="deg/s", nominal=0.01, source="starts at rest")]  # fmt: skip
    theta_min: Annotated[float, Variable("rad", "Lower end of the travel; -1e9 rad is out of reach", -1e9, -1e9, 1e9, display="deg", source="off: (4.15) has no end")]  # fmt: skip
    theta_max: Annotated[float, Variable("rad", "Upper end of the travel; 1e9 rad is out of reach", 1e9, -1e9, 1e9, display="deg", source="off: (4.15) has no end")]  # fmt: skip


class Coefficients(NamedTuple):
    """omega1 = w_w omega0 + w_u u;  theta1 = theta0 + t_w omega0 + t_u u."""

    h: float
    w_w: float
    w_u: float
    t_w: float
    t_u: float


@slot("chain")
def acting_command(command: float, m: NoMemory, p: Parameters) -> float:
    """The command as it acts, 1; effects act here."""
    return command


@equation
def start(u: Input, p: Parameters) -> State:
    """At the start angle, nominally at rest."""
    theta, omega = stopped(p.theta_0, p.omega_0, p.theta_min, p.theta_max)
    return State(theta, omega)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Exact response over the step h, s."""
    decay, phi1, phi2, _ = phi_functions(p.a * h)
    return Coefficients(h, decay, p.k * h * phi1, h * phi1, p.k * h * h * phi2)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(4.15) over one step of length c.h."""
    command = acting_command(u.command, m, p)
    theta = x.theta + c.t_w * x.omega + c.t_u * command
    theta, omega = stopped(theta, c.w_w * x.omega + c.w_u * command, p.theta_min, p.theta_max)
    return State(theta, omega)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The state itself."""
    return Output(x.theta, x.omega)


BLOCK = Block(
    name="simplified",
    title="Simplified drive: command to angle in one transfer function",
    module=sys.modules[__name__],
    reads={"command": "held"},
    helpers=(phi_functions, stopped),
)
