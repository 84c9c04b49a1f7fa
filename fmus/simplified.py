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
def driven(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> tuple[float, float]:
    """Angle and velocity after the step where no end of the travel is met."""
    command = acting_command(u.command, m, p)
    return x.theta + c.t_w * x.omega + c.t_u * command, c.w_w * x.omega + c.w_u * command


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(4.15) over one step of length c.h."""
    theta, omega = driven(x, u, m, p, c)
    theta, omega = stopped(theta, omega, p.theta_min, p.theta_max)
    return State(theta, omega)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The state itself."""
    return Output(x.theta, x.omega)


# In model exchange. The motion is 0.0: held at an end of the travel; 1.0: free. It changes at events only. 1e-12 rad and
# rad/s2 are below anything that matters: by so much an indicator is away from zero where a motion begins.


@equation
def motion_from(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> float:
    """The motion that begins in this state."""
    push = p.k * acting_command(u.command, m, p)
    into = (x.theta >= p.theta_max and push > 1e-12) or (x.theta <= p.theta_min and push < -1e-12)
    return 0.0 if x.omega == 0.0 and into else 1.0


@equation
def after_event(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients, motion: float) -> State:
    """The state after an event: an end of the travel takes the speed into it."""
    theta, omega = stopped(x.theta, x.omega, p.theta_min, p.theta_max)
    return State(theta, omega)


@equation
def indicators(
    x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients, motion: float
) -> tuple[float, float]:
    """Numbers that an event makes negative: angles left until it stops, or what still holds it there."""
    if motion == 0.0:
        push = p.k * acting_command(u.command, m, p)
        return push if x.theta >= p.theta_max else -push, 1.0
    return p.theta_max - x.theta + 1e-12, x.theta - p.theta_min + 1e-12


@equation
def step_without_event(
    x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients, motion: float
) -> State:
    """(4.15) over a step of length c.h in which the motion stays as it is."""
    if motion == 0.0:
        return State(x.theta, 0.0)
    theta, omega = driven(x, u, m, p, c)
    return State(theta, omega)


BLOCK = Block(
    name="simplified",
    title="Simplified drive: command to angle in one transfer function",
    module=sys.modules[__name__],
    reads={"command": "held"},
    helpers=(phi_functions, stopped),
)
