"""The slew sensor lags."""

from fmus.contract import Effect, Free, Variable, equation
from fmus.linear import expm2, phi_functions


@equation
def lag_remember(x, x1, u, m, p, c):
    """Lag of an angle on a straight line, exact: the lagging angle, the input it saw last, and the lagging angle's velocity.

    First order, or q_l tau_l^2 y'' + tau_l y' + y = theta: behind a straight line by tau_l either way.
    """
    if p.q_l > 0.0:
        rate = (u.theta - m.lag_input) / c.h
        stiffness = 1.0 / (p.q_l * p.tau_l * p.tau_l)
        a11, a12, a21, a22 = expm2(0.0, 1.0, -stiffness, -stiffness * p.tau_l, c.h)
        e = m.lag_angle - m.lag_input + p.tau_l * rate
        v = m.lag_rate - rate
        return u.theta - p.tau_l * rate + a11 * e + a12 * v, u.theta, rate + a21 * e + a22 * v
    decay, phi1, _, _ = phi_functions(c.h / p.tau_l)
    return decay * m.lag_angle + (phi1 - decay) * m.lag_input + (1.0 - phi1) * u.theta, u.theta, 0.0


@equation
def lag_begin(x, u, p):
    """Settled."""
    return u.theta, u.theta, 0.0


@equation
def lagging_angle(theta, m, p):
    """The lagging angle."""
    return m.lag_angle


EFFECT = Effect(
    name="sensor.lag",
    text="The slew sensor follows the angle with a lag.",
    residual="angle error in proportion to the velocity",
    source="draw-wire elasticity and input filter (2.1), a Butterworth of order 2: first order at low frequency",
    key="tau_l",
    parameters={
        "tau_l": Variable(
            "s",
            "Time constant of the lag",
            0.0,
            0.0,
            10.0,
            display="ms",
            nominal=0.01,
            source="off: (3.2) is instantaneous",
        ),
        "q_l": Variable(
            "1",
            "Share of a second order: 0.25 two equal lags, 0.5 Butterworth",
            0.0,
            0.0,
            1.0,
            nominal=0.25,
            source="off: first order",
        ),
    },
    free={"tau_l": Free(starts=(0.02, 0.1), scale=0.05, floor=0.001)},
    forms={"q_l": Free(starts=(0.25, 0.5), scale=0.2, floor=0.02)},
    fills={"sensed_angle": lagging_angle},
    memory={
        "lag_angle": Variable("rad", "Lagging angle", display="deg"),
        "lag_input": Variable("rad", "Angle at the end of the last step", display="deg"),
        "lag_rate": Variable("rad/s", "Velocity of the lagging angle", display="deg/s", nominal=0.01),
    },
    begin=lag_begin,
    remember=lag_remember,
    helpers=(expm2, phi_functions),
)
