"""The flow through the open valve falls with the load pressure."""

import math

from fmus.contract import Effect, Free, Variable, equation


@equation
def throttled_opening(opening, m, p):
    """Root of the pressure left to drive the flow: (4.22) in its standard form, SYSTEM section 9.5."""
    left = 1.0 - p.c_q * math.copysign(1.0, opening) * m.throttled_pressure
    return opening * math.sqrt(max(left, 0.0))


@equation
def throttled_remember(x, x1, u, m, p, c):
    """Load pressure expected at the end of the next step, on a straight line."""
    return (2.0 * x1.p_load - x.p_load,)


@equation
def throttled_begin(x, u, p):
    """The load pressure at the start."""
    return (x.p_load,)


EFFECT = Effect(
    name="continuity.flow_pressure",
    text="The flow through the open valve falls with the load pressure against it: an orifice between supply and load.",
    residual="pressure error that grows with opening and load pressure together; oscillations die out faster with the valve open",
    source="(4.22) in the standard form of SYSTEM section 9.5: Q = Cd A sqrt((Ps - sign(x_v) PL)/rho)",
    key="c_q",
    parameters={
        "c_q": Variable(
            "1/Pa",
            "Inverse of the load pressure at which the flow ends (of the supply pressure)",
            0.0,
            0.0,
            1e6,
            nominal=1e-7,
            source="off: flow in proportion to the opening (5.4)",
        )
    },
    free={"c_q": Free(starts=(3e-8, 1e-7), scale=6e-8, floor=1e-9)},
    fills={"opening": throttled_opening},
    memory={
        "throttled_pressure": Variable(
            "Pa", "Load pressure expected at the end of the next step", display="bar", nominal=1e5
        )
    },
    begin=throttled_begin,
    remember=throttled_remember,
    when="after",
    alone=True,
)
