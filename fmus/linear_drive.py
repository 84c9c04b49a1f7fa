"""Linear drive of free order: command to angle, as a log shows it where a linear model predicts better than the blocks do.

    theta(s)/(u(s) - u_0) = exp(-delay s) sum over k of (b1_k s + b0_k) / (s^2 + a1_k s + a0_k)

Three sections side by side (partial fractions), so up to order 6; a section whose b are 0 is not there. The command is held
over a step; the solution is exact for any step, the delay straight between steps.
"""

import sys
from typing import Annotated, Any, NamedTuple

from fmus.contract import Block, Buffer, Variable, equation
from fmus.linear import held_pair
from fmus.ring import RING, ago

FITTED = "off: the diagnosis fits it to a log"


class Input(NamedTuple):
    """What comes in."""

    command: Annotated[float, Variable("1", "Command", low=-100.0, high=100.0)]


class Output(NamedTuple):
    """What goes out."""

    theta: Annotated[float, Variable("rad", "Angle", display="deg")]


class State(NamedTuple):
    """Of each section the response to the command and its rate; what the delay needs."""

    x_1: Annotated[float, Variable("s2", "Response of the first section")]
    v_1: Annotated[float, Variable("s", "Its rate")]
    x_2: Annotated[float, Variable("s2", "Response of the second section")]
    v_2: Annotated[float, Variable("s", "Its rate")]
    x_3: Annotated[float, Variable("s2", "Response of the third section")]
    v_3: Annotated[float, Variable("s", "Its rate")]
    past: Annotated[float, Variable("1", "Command before the start")]
    place: Annotated[float, Variable("1", "Place of the newest command in the ring")]
    steps: Annotated[float, Variable("1", "Steps made")]


class Parameters(NamedTuple):
    """Sections, delay and start."""

    b1_1: Annotated[
        float, Variable("rad/s", "First section: gain on the rate", 0.0, -1e9, 1e9, source=FITTED)
    ]
    b0_1: Annotated[float, Variable("rad/s2", "First section: gain", 0.17453292519943295, -1e9, 1e9, source="(4.15): 10 deg/s2")]  # fmt: skip
    a1_1: Annotated[float, Variable("1/s", "First section: damping", 4.4, 0.0, 1e9, source="(4.15)")]
    a0_1: Annotated[float, Variable("1/s2", "First section: stiffness, 0 for an integrator", 0.0, 0.0, 1e9, source="(4.15)")]  # fmt: skip
    b1_2: Annotated[
        float, Variable("rad/s", "Second section: gain on the rate", 0.0, -1e9, 1e9, source=FITTED)
    ]
    b0_2: Annotated[float, Variable("rad/s2", "Second section: gain", 0.0, -1e9, 1e9, source=FITTED)]
    a1_2: Annotated[float, Variable("1/s", "Second section: damping", 1.0, 0.0, 1e9, source=FITTED)]
    a0_2: Annotated[float, Variable("1/s2", "Second section: stiffness", 1.0, 0.0, 1e9, source=FITTED)]
    b1_3: Annotated[
        float, Variable("rad/s", "Third section: gain on the rate", 0.0, -1e9, 1e9, source=FITTED)
    ]
    b0_3: Annotated[float, Variable("rad/s2", "Third section: gain", 0.0, -1e9, 1e9, source=FITTED)]
    a1_3: Annotated[float, Variable("1/s", "Third section: damping", 1.0, 0.0, 1e9, source=FITTED)]
    a0_3: Annotated[float, Variable("1/s2", "Third section: stiffness", 1.0, 0.0, 1e9, source=FITTED)]
    delay: Annotated[float, Variable("s", "Transport delay", 0.0, 0.0, 1e6, source=FITTED)]
    theta_0: Annotated[float, Variable("rad", "Angle at which the sections stand at 0", 0.0, -1e9, 1e9, display="deg", source="starts where the log does")]  # fmt: skip
    u_0: Annotated[float, Variable("1", "Command at which it stands", 0.0, -100.0, 100.0, source="off: at none")]  # fmt: skip
    x_0: Annotated[float, Variable("s2", "First section's response at the start", 0.0, -1e9, 1e9, source="off: starts at rest")]  # fmt: skip
    v_0: Annotated[float, Variable("s", "Its rate at the start", 0.0, -1e9, 1e9, source="off: starts at rest")]  # fmt: skip
    settled: Annotated[float, Variable("1", "1: the first command has always been there; 0: there was none", 0.0, 0.0, 1.0, source="off: starts at rest")]  # fmt: skip


class Coefficients(NamedTuple):
    """Step, and the responses of each section to a command held over it."""

    h: float
    s_1: float
    r_1: float
    s_2: float
    r_2: float
    s_3: float
    r_3: float


@equation
def resting(command: float, a0: float) -> float:
    """Response of a section to a command that has always been there; none where it integrates."""
    if a0 > 0.0:
        return command / a0
    return 0.0


@equation
def start(u: Input, p: Parameters) -> State:
    """At rest, or settled on the first command."""
    past = p.settled * (u.command - p.u_0)
    x_1, x_2, x_3 = resting(past, p.a0_1), resting(past, p.a0_2), resting(past, p.a0_3)
    return State(p.x_0 + x_1, p.v_0, x_2, 0.0, x_3, 0.0, past, 0.0, 0.0)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Exact response over the step h, s."""
    s_1, r_1 = held_pair(p.a1_1, p.a0_1, h)
    s_2, r_2 = held_pair(p.a1_2, p.a0_2, h)
    s_3, r_3 = held_pair(p.a1_3, p.a0_3, h)
    return Coefficients(h, s_1, r_1, s_2, r_2, s_3, r_3)


@equation
def advanced(
    x: float, v: float, command: float, a1: float, a0: float, s: float, r: float
) -> tuple[float, float]:
    """Response of a section and its rate after a step with a held command; s and r are those to a command of 1 from rest."""
    return (
        x + r * v + s * (command - a0 * x),
        v - a1 * r * v - a0 * s * v + r * (command - a0 * x),
    )


@equation
def step(x: State, u: Input, m: Any, p: Parameters, c: Coefficients) -> State:
    """One step of length c.h."""
    i = (int(x.place) + 1) % 16384
    m.ring[i] = u.command - p.u_0
    count = x.steps + 1.0
    late = ago(p.delay / c.h, i, count, x.past, m)
    x_1, v_1 = advanced(x.x_1, x.v_1, late, p.a1_1, p.a0_1, c.s_1, c.r_1)
    x_2, v_2 = advanced(x.x_2, x.v_2, late, p.a1_2, p.a0_2, c.s_2, c.r_2)
    x_3, v_3 = advanced(x.x_3, x.v_3, late, p.a1_3, p.a0_3, c.s_3, c.r_3)
    return State(x_1, v_1, x_2, v_2, x_3, v_3, x.past, float(i), count)


@equation
def output(x: State, u: Input, m: Any, p: Parameters) -> Output:
    """The sum of the sections."""
    theta = p.theta_0 + p.b0_1 * x.x_1 + p.b1_1 * x.v_1 + p.b0_2 * x.x_2 + p.b1_2 * x.v_2
    theta = theta + p.b0_3 * x.x_3 + p.b1_3 * x.v_3
    return Output(theta)


BLOCK = Block(
    name="linear_drive",
    title="Linear drive of free order: command to angle as a log shows it",
    module=sys.modules[__name__],
    reads={"command": "held"},
    memory={"ring": Buffer(RING, "Past commands")},
    helpers=(held_pair, ago),
)
