"""The slew sensor lags."""

from fmus.contract import Effect, Free, Variable, equation
from fmus.linear import phi_functions


@equation
def lag_remember(x, x1, u, m, p, c):
    """First-order lag of an angle on a straight line, exact; the lagging angle and the input it saw last."""
    decay, phi1, _, _ = phi_functions(c.h / p.tau_l)
    return decay * m.lag_angle + (phi1 - decay) * m.lag_input + (1.0 - phi1) * u.theta, u.theta


@equation
def lag_begin(x, u, p):
    """Settled."""
    return u.theta, u.theta


@equation
def lagging_angle(theta, m, p):
    """The lagging angle."""
    return m.lag_angle


EFFECT = Effect(
    name="sensor.lag",
    text="The slew sensor follows the angle with a first-order lag.",
    residual="angle error in proportion to the velocity",
    source="draw-wire elasticity and input filter (2.1): first order at low frequency",
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
        )
    },
    free={"tau_l": Free(starts=(0.02, 0.1), scale=0.05, floor=0.001)},
    fills={"sensed_angle": lagging_angle},
    memory={
        "lag_angle": Variable("rad", "Lagging angle", display="deg"),
        "lag_input": Variable("rad", "Angle at the end of the last step", display="deg"),
    },
    begin=lag_begin,
    remember=lag_remember,
    helpers=(phi_functions,),
)
