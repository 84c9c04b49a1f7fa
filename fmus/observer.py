"""Observer of slew angle and velocity, on the simplified model.

    x1' = -a x1 + k u + L1 (y - c x2)                           (2.15), (4.35)-(4.38)
    x2' =    x1       + L2 (y - c x2)
    slew estimate = c x2,   velocity estimate = c x1

L places the observer's poles at p1 and p2: L2 = -(p1 + p2 + a)/c, L1 = (p1 p2 - a c L2)/c. The error e = x - x^ of a plant
that is the model follows e' = (A - L C) e (2.16). The command is held over a step, the measured slew moves on a straight
line; the solution is exact for that. It starts standing at the measured angle, or at slew_0 and rate_0: zero in the source.
"""

import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation
from fmus.linear import expm2


class Input(NamedTuple):
    """What comes in."""

    u: Annotated[float, Variable("1", "Valve command", low=-100.0, high=100.0)]
    slew: Annotated[float, Variable("rad", "Measured slew angle", low=-1e6, high=1e6, display="deg")]


class Output(NamedTuple):
    """What goes out."""

    slew_estimate: Annotated[float, Variable("rad", "Estimated slew angle", display="deg")]
    slew_rate_estimate: Annotated[
        float, Variable("rad/s", "Estimated slew velocity", display="deg/s", nominal=0.01)
    ]


class State(NamedTuple):
    """The model's two states and the measurement at the end of the last step."""

    x1: Annotated[float, Variable("1/s", "Velocity in the observer's coordinates")]
    x2: Annotated[float, Variable("1", "Angle in the observer's coordinates")]
    slew: Annotated[float, Variable("rad", "Measured slew angle", display="deg")]


class Parameters(NamedTuple):
    """Model and poles."""

    a: Annotated[float, Variable("1/s", "Pole of the model", 4.4, 0.0, 1e6, source="(4.35)")]
    k: Annotated[float, Variable("1/s2", "Input gain B1", 4.0, -1e6, 1e6, source="(4.36)")]
    c: Annotated[float, Variable("rad", "Output gain C2", 0.04363323129985824, 1e-9, 1e6, display="deg", source="(4.37): 2.5 deg")]  # fmt: skip
    p1: Annotated[float, Variable("1/s", "First observer pole", -13.2, -1e6, -1e-6, nominal=10.0, source="(2.15): -3 times 4.4")]  # fmt: skip
    p2: Annotated[float, Variable("1/s", "Second observer pole", -6.6, -1e6, -1e-6, nominal=10.0, source="(2.15): -1.5 times 4.4")]  # fmt: skip
    at_reading: Annotated[float, Variable("1", "Start: 1 standing at the measured angle, 0 at slew_0 and rate_0", 1.0, 0.0, 1.0, kind="integer", source="starts where the log does; 0 with slew_0 = rate_0 = 0: the source")]  # fmt: skip
    slew_0: Annotated[float, Variable("rad", "Estimated angle at the start, where at_reading is 0", 0.0, -1e6, 1e6, display="deg", source="(2.15): the source starts at zero")]  # fmt: skip
    rate_0: Annotated[float, Variable("rad/s", "Estimated velocity at the start, where at_reading is 0", 0.0, -1e3, 1e3, display="deg/s", nominal=0.01, source="(2.15): the source starts at zero")]  # fmt: skip


class Coefficients(NamedTuple):
    """x(t+h) = F x + u * held + slew0 * (s1_, s2_) 'old' + slew1 * 'new'."""

    h: float
    f11: float
    f12: float
    f21: float
    f22: float
    u1: float
    u2: float
    old1: float
    old2: float
    new1: float
    new2: float


@equation
def gains(p: Parameters) -> tuple[float, float]:
    """L1 in 1/(s2 rad), L2 in 1/(s rad) that place the poles; 7.744 and 6.16 per 2.5 deg with the source's numbers."""
    l2 = -(p.p1 + p.p2 + p.a) / p.c
    return (p.p1 * p.p2 - p.a * p.c * l2) / p.c, l2


@equation
def solve2(m11: float, m12: float, m21: float, m22: float, b1: float, b2: float) -> tuple[float, float]:
    """Solution of a 2x2 linear system by Cramer's rule."""
    det = m11 * m22 - m12 * m21
    return (b1 * m22 - m12 * b2) / det, (m11 * b2 - m21 * b1) / det


@equation
def start(u: Input, p: Parameters) -> State:
    """Standing at the measured angle, or where it is told to."""
    if p.at_reading == 1.0:
        return State(0.0, u.slew / p.c, u.slew)
    return State(p.rate_0 / p.c, p.slew_0 / p.c, u.slew)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Exact response over the step h, s: exp(M h), M^-1 (exp(M h) - I) B, and the same once more for the ramp."""
    l1, l2 = gains(p)
    m11, m12, m21, m22 = -p.a, -l1 * p.c, 1.0, -l2 * p.c
    f11, f12, f21, f22 = expm2(m11, m12, m21, m22, h)
    u1, u2 = solve2(m11, m12, m21, m22, (f11 - 1.0) * p.k, f21 * p.k)
    g1, g2 = solve2(m11, m12, m21, m22, (f11 - 1.0) * l1 + f12 * l2, f21 * l1 + (f22 - 1.0) * l2)
    r1, r2 = solve2(m11, m12, m21, m22, g1 / h - l1, g2 / h - l2)
    return Coefficients(h, f11, f12, f21, f22, u1, u2, g1 - r1, g2 - r2, r1, r2)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(2.15) over one step of length c.h."""
    return State(
        c.f11 * x.x1 + c.f12 * x.x2 + c.u1 * u.u + c.old1 * x.slew + c.new1 * u.slew,
        c.f21 * x.x1 + c.f22 * x.x2 + c.u2 * u.u + c.old2 * x.slew + c.new2 * u.slew,
        u.slew,
    )


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """Estimates in the sensor's unit."""
    return Output(p.c * x.x2, p.c * x.x1)


BLOCK = Block(
    name="observer",
    title="Observer of slew angle and velocity",
    module=sys.modules[__name__],
    reads={"u": "held", "slew": "line"},
    helpers=(expm2,),
)
