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

    command: Annotated[float, Variable("1", "Command", low=-1e9, high=1e9)]


class Output(NamedTuple):
    """What goes out."""

    theta: Annotated[float, Variable("rad", "Angle", display="deg")]


class State(NamedTuple):
    """Of each section its part of the angle and what drives that on (observer form); what the delay needs."""

    y_1: Annotated[float, Variable("rad", "First section's part of the angle")]
    z_1: Annotated[
        float, Variable("rad/s", "Its rate, less the command's share, and its damping times itself")
    ]
    y_2: Annotated[float, Variable("rad", "Second section's part of the angle")]
    z_2: Annotated[
        float, Variable("rad/s", "Its rate, less the command's share, and its damping times itself")
    ]
    y_3: Annotated[float, Variable("rad", "Third section's part of the angle")]
    z_3: Annotated[
        float, Variable("rad/s", "Its rate, less the command's share, and its damping times itself")
    ]
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
    offset: Annotated[float, Variable("rad", "Angle at which the sections stand at 0", 0.0, -1e9, 1e9, display="deg", source="starts where the log does")]  # fmt: skip
    u_0: Annotated[float, Variable("1", "Command at which it stands", 0.0, -1e9, 1e9, source="off: at none")]  # fmt: skip
    start_1: Annotated[float, Variable("rad", "First section: its part of the angle at the start", 0.0, -1e9, 1e9, display="deg", source="off: starts at rest")]  # fmt: skip
    rate_1: Annotated[float, Variable("rad/s", "First section: the rate of that part", 0.0, -1e9, 1e9, display="deg/s", source="off: starts at rest")]  # fmt: skip
    start_2: Annotated[float, Variable("rad", "Second section: its part of the angle at the start", 0.0, -1e9, 1e9, display="deg", source="off: starts at rest")]  # fmt: skip
    rate_2: Annotated[float, Variable("rad/s", "Second section: the rate of that part", 0.0, -1e9, 1e9, display="deg/s", source="off: starts at rest")]  # fmt: skip
    start_3: Annotated[float, Variable("rad", "Third section: its part of the angle at the start", 0.0, -1e9, 1e9, display="deg", source="off: starts at rest")]  # fmt: skip
    rate_3: Annotated[float, Variable("rad/s", "Third section: the rate of that part", 0.0, -1e9, 1e9, display="deg/s", source="off: starts at rest")]  # fmt: skip
    settled: Annotated[float, Variable("1", "1: the first command has always been there; 0: there was none", 0.0, 0.0, 1.0, source="off: starts at rest")]  # fmt: skip


class Coefficients(NamedTuple):
    """Step, and of each section the response to a command of 1 held over it, without b1, and its rate."""

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
def began(
    y: float, rate: float, past: float, b1: float, b0: float, a1: float, a0: float
) -> tuple[float, float]:
    """A section that stands on a command and has besides a part of the angle that moves by itself."""
    x = resting(past, a0)
    return (y + b0 * x, rate + a1 * y + (a1 * b0 - a0 * b1) * x)


@equation
def start(u: Input, p: Parameters) -> State:
    """In motion as it began, or settled on the first command."""
    past = p.settled * (u.command - p.u_0)
    y_1, z_1 = began(p.start_1, p.rate_1, past, p.b1_1, p.b0_1, p.a1_1, p.a0_1)
    y_2, z_2 = began(p.start_2, p.rate_2, past, p.b1_2, p.b0_2, p.a1_2, p.a0_2)
    y_3, z_3 = began(p.start_3, p.rate_3, past, p.b1_3, p.b0_3, p.a1_3, p.a0_3)
    return State(y_1, z_1, y_2, z_2, y_3, z_3, past, 0.0, 0.0)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Exact response over the step h, s."""
    s_1, r_1 = held_pair(p.a1_1, p.a0_1, h)
    s_2, r_2 = held_pair(p.a1_2, p.a0_2, h)
    s_3, r_3 = held_pair(p.a1_3, p.a0_3, h)
    return Coefficients(h, s_1, r_1, s_2, r_2, s_3, r_3)


@equation
def advanced(
    y: float, z: float, command: float, b1: float, b0: float, a1: float, a0: float, s: float, r: float
) -> tuple[float, float]:
    """A section after a step with a held command; s is the response x to a command of 1 from rest without b1, r its rate."""
    return (
        (1.0 - a0 * s - a1 * r) * y + r * z + (r * b1 + s * b0) * command,
        (1.0 - a0 * s) * z - a0 * r * y + ((r + a1 * s) * b0 - a0 * s * b1) * command,
    )


@equation
def step(x: State, u: Input, m: Any, p: Parameters, c: Coefficients) -> State:
    """One step of length c.h."""
    i = (int(x.place) + 1) % 16384
    m.ring[i] = u.command - p.u_0
    count = x.steps + 1.0
    late = ago(p.delay / c.h, i, count, x.past, m)
    y_1, z_1 = advanced(x.y_1, x.z_1, late, p.b1_1, p.b0_1, p.a1_1, p.a0_1, c.s_1, c.r_1)
    y_2, z_2 = advanced(x.y_2, x.z_2, late, p.b1_2, p.b0_2, p.a1_2, p.a0_2, c.s_2, c.r_2)
    y_3, z_3 = advanced(x.y_3, x.z_3, late, p.b1_3, p.b0_3, p.a1_3, p.a0_3, c.s_3, c.r_3)
    return State(y_1, z_1, y_2, z_2, y_3, z_3, x.past, float(i), count)


@equation
def output(x: State, u: Input, m: Any, p: Parameters) -> Output:
    """The sum of the sections."""
    return Output(p.offset + x.y_1 + x.y_2 + x.y_3)


BLOCK = Block(
    name="linear_drive",
    title="Linear drive of free order: command to angle as a log shows it",
    module=sys.modules[__name__],
    reads={"command": "held"},
    memory={"ring": Buffer(RING, "Past commands")},
    helpers=(held_pair, ago),
)
