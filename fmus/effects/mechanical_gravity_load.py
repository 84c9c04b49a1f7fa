"""A torque that depends on the angle, because the base is not level."""

import math

from fmus.contract import QUARTER, Effect, Free, Range, Variable, equation


@equation
def gravity_torque(s, theta, omega, x, m, p, c):
    """tau_g sin(theta - theta_g) against positive motion."""
    return p.tau_g * math.sin(theta - p.theta_g)


EFFECT = Effect(
    name="mechanical.gravity_load",
    text="A torque that depends on the angle: the base is not level.",
    residual="a missing torque that depends on the angle alone, one period a turn; drift at rest",
    source="component of weight along the tilted base: m g l sin(tilt) sin(theta - theta_g)",
    key="tau_g",
    parameters={
        "tau_g": Variable(
            "N.m",
            "Amplitude of the gravity torque",
            0.0,
            -1e9,
            1e9,
            nominal=100.0,
            source="off: level base in (4.27)",
        ),
        "theta_g": Variable(
            "rad",
            "Angle of rest, where the torque vanishes",
            0.0,
            -1e3,
            1e3,
            display="deg",
            source="assumed; acts only where tau_g is on",
        ),
    },
    free={
        "tau_g": Free(starts=(100.0,), scale=150.0, floor=2.0),
        "theta_g": Free(starts=(0.0, QUARTER), scale=1.0, phase=True),
    },
    fills={"load_torque": gravity_torque},
    sole_form=True,
    ranges={
        "tau_g": Range(
            -5.0,
            5.0,
            "a drive holds its load: beyond a few times its greatest torque it would be carried off",
            of="torque",
        )
    },
)
