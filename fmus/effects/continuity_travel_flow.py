"""The moving load takes up flow: the travel term of the continuity equation, which the identified form leaves out."""

from fmus.contract import Effect, Free, Variable, equation
from fmus.linear import phi_functions


@equation
def travel_opening(opening, m, p):
    """Opening less what the load's travel swallows, in metres of opening."""
    return opening - m.travel_ahead


@equation
def travel_remember(x, x1, u, m, p, c):
    """The load's speed, in metres of opening, after the step and as expected after the next; exact for a straight pressure.

    y' = w_l^2 T/K_c PL - d_l y: the load's mass and viscous friction, scaled by what a speed takes of the flow.
    """
    drive = p.w_l * p.w_l * p.T / p.K_c
    decay, phi1, phi2, _ = phi_functions(p.d_l * c.h)
    rise = x1.p_load - x.p_load
    speed = decay * m.travel + drive * c.h * (phi1 * x.p_load + phi2 * rise)
    ahead = decay * speed + drive * c.h * (phi1 * x1.p_load + phi2 * rise)
    return speed, ahead


@equation
def travel_begin(x, u, p):
    """At rest."""
    return 0.0, 0.0


EFFECT = Effect(
    name="continuity.travel_flow",
    text="The moving load takes up flow and its mass builds up pressure: oil column and load oscillate.",
    residual="the pressure rings at one frequency after every change of the opening, and overshoots it",
    source="(4.25): the term A dx/dt; load m dv/dt = A PL - b v as in (5.6)",
    key="w_l",
    parameters={
        "w_l": Variable(
            "rad/s",
            "Frequency of the load's mass on the oil column",
            0.0,
            0.0,
            1e4,
            nominal=10.0,
            source="off: no travel in (5.4)",
        ),
        "d_l": Variable(
            "1/s",
            "Viscous friction of the load over its mass",
            1.0,
            0.0,
            1e4,
            nominal=1.0,
            source="assumed; acts only where w_l > 0",
        ),
    },
    free={
        "w_l": Free(starts=(2.0, 5.0, 12.0), scale=3.0, floor=0.3),
        "d_l": Free(starts=(1.0, 5.0), scale=2.0),
    },
    fills={"opening": travel_opening},
    memory={
        "travel": Variable("m", "Speed of the load as metres of opening", display="mm", nominal=1e-3),
        "travel_ahead": Variable(
            "m", "The same, expected at the end of the next step", display="mm", nominal=1e-3
        ),
    },
    begin=travel_begin,
    remember=travel_remember,
    when="after",
    helpers=(phi_functions,),
    asked=True,
)
