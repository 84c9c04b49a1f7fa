"""Position controller of the slew drive, a digital one: its output is held over the step that follows.

    law    = a (k_p (reference - slew) + k_f reference_rate - k_d slew_rate + integral) + (1 - a) manual
    v      = law + bias, its change limited to r_max h, its size to u_max
    u      = v + d tanh(S v), d = d_plus for v > 0 and d_minus for v < 0                           (4.9)

The input `automatic` is a, the share of the automatic law: 0 is manual, 1 automatic. Where it changes, bias takes up the
difference to the last v, so that u does not jump, and dies out over T_bias. The integral stands still while a limit holds v
back in the direction of the error (anti-windup), and is empty in manual. With k_f, k_d, k_i at 0 this is (5.2).
"""

import math
import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation


class Input(NamedTuple):
    """What comes in."""

    reference: Annotated[float, Variable("rad", "Reference of the slew angle", low=-1e6, high=1e6, display="deg")]  # fmt: skip
    reference_rate: Annotated[float, Variable("rad/s", "Its rate", low=-1e6, high=1e6, display="deg/s", nominal=0.01)]  # fmt: skip
    slew: Annotated[float, Variable("rad", "Slew angle, measured or estimated", low=-1e6, high=1e6, display="deg")]  # fmt: skip
    slew_rate: Annotated[float, Variable("rad/s", "Slew velocity", low=-1e6, high=1e6, display="deg/s", nominal=0.01)]  # fmt: skip
    manual: Annotated[float, Variable("1", "Command in manual", low=-100.0, high=100.0)]
    automatic: Annotated[float, Variable("1", "Share of the automatic law, 0 to 1", low=-100.0, high=100.0)]


class Output(NamedTuple):
    """What goes out."""

    u: Annotated[float, Variable("1", "Valve command", discrete=True)]


class State(NamedTuple):
    """What the controller remembers from step to step."""

    v: Annotated[float, Variable("1", "Command before the inverse dead zone")]
    bias: Annotated[float, Variable("1", "What keeps a switch from jumping")]
    integral: Annotated[float, Variable("1", "Integral part")]
    automatic: Annotated[float, Variable("1", "Share of the automatic law in the last step")]


class Parameters(NamedTuple):
    """Gains and limits."""

    k_p: Annotated[float, Variable("1/rad", "Gain on the angle", 57.29577951308232, 0.0, 1e6, nominal=10.0, source="1 per deg; the full-order loop (5.2) is stable below 6.345 per deg")]  # fmt: skip
    k_i: Annotated[float, Variable("1/(rad.s)", "Gain on the integral of the error", 0.0, 0.0, 1e6, nominal=10.0, source="off: the drive integrates by itself (4.28)")]  # fmt: skip
    k_f: Annotated[float, Variable("s/rad", "Feed-forward of the reference's rate", 25.26, 0.0, 1e6, nominal=10.0, source="1 / (2.268 deg/s), the drive's speed at full command (5.12)")]  # fmt: skip
    k_d: Annotated[float, Variable("s/rad", "Gain on the slew velocity", 5.0, 0.0, 1e6, nominal=10.0, source="a fifth of k_f: damps the loop with k_p = 1 per deg")]  # fmt: skip
    u_max: Annotated[float, Variable("1", "Largest command before the inverse dead zone", 1.0, 0.0, 100.0, source="Table 3.8")]  # fmt: skip
    r_max: Annotated[float, Variable("1/s", "Largest rate of that command", 1e9, 1e-6, 1e12, nominal=10.0, source="off")]  # fmt: skip
    T_bias: Annotated[float, Variable("s", "Time in which a switch fades", 0.5, 1e-6, 1e6, source="about the settling of the loop with k_p = 1 per deg")]  # fmt: skip
    d_plus: Annotated[float, Variable("1", "Inverse dead zone to the right", 0.0, 0.0, 10.0, display="%", source="off: the compensator (4.9) is a component of its own")]  # fmt: skip
    d_minus: Annotated[float, Variable("1", "Inverse dead zone to the left", 0.0, 0.0, 10.0, display="%", source="off: the compensator (4.9) is a component of its own")]  # fmt: skip
    S: Annotated[float, Variable("1", "Its sharpness", 50.0, 1e-3, 1e6, source="SYSTEM section 3")]  # fmt: skip


class Coefficients(NamedTuple):
    """Step, and what is left of the bias after it."""

    h: float
    fading: float


@equation
def share(u: Input) -> float:
    """Share of the automatic law, kept within 0 to 1."""
    return max(0.0, min(1.0, u.automatic))


@equation
def law(u: Input, integral: float, p: Parameters) -> float:
    """The command that the law asks for, before bias and limits, 1."""
    feedback = p.k_p * (u.reference - u.slew) - p.k_d * u.slew_rate
    a = share(u)
    return a * (feedback + p.k_f * u.reference_rate + integral) + (1.0 - a) * u.manual


@equation
def inverse(v: float, p: Parameters) -> float:
    """(4.9) with the controller's own widths; `v` itself where they are 0."""
    return v + (p.d_plus if v > 0.0 else p.d_minus) * math.tanh(p.S * v)


@equation
def start(u: Input, p: Parameters) -> State:
    """The law's own command, limited in size."""
    return State(max(-p.u_max, min(p.u_max, law(u, 0.0, p))), 0.0, 0.0, share(u))


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Of the step h, s."""
    return Coefficients(h, math.exp(-h / p.T_bias))


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """One sample: the command for the step that follows."""
    a = share(u)
    integral = x.integral if a > 0.0 else 0.0
    wanted = law(u, integral, p)
    bias = x.v - wanted if a != x.automatic else c.fading * x.bias
    free = wanted + bias
    v = max(x.v - p.r_max * c.h, min(x.v + p.r_max * c.h, free))
    v = max(-p.u_max, min(p.u_max, v))
    error = u.reference - u.slew
    if a > 0.0 and not (free > v and error > 0.0) and not (free < v and error < 0.0):
        integral += p.k_i * error * c.h
    return State(v, bias, integral, a)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The command that is held."""
    return Output(inverse(x.v, p))


BLOCK = Block(
    name="controller",
    title="Position controller",
    module=sys.modules[__name__],
    feedthrough={"u": ("reference", "reference_rate", "slew", "slew_rate", "manual")},
    reads=dict.fromkeys(Input._fields, "instant"),
)
