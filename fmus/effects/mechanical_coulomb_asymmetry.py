"""Dry friction that differs between the two directions."""

import math

from fmus.contract import Effect, Free, Range, Variable, equation


@equation
def asymmetric_level(omega, m, p):
    """More by tau_d forwards and less by tau_d backwards, never less than none; at rest both directions hold alike."""
    if omega == 0.0:
        return 0.0
    return math.copysign(1.0, omega) * max(-p.tau_c, min(p.tau_c, p.tau_d))


EFFECT = Effect(
    name="mechanical.coulomb_asymmetry",
    text="Coulomb friction differs between the two directions: tau_c + tau_d forwards, tau_c - tau_d backwards.",
    residual="a missing torque that is constant in each direction of motion, of another size in each; sliding, like a constant load",
    source="Armstrong-Helouvry et al., Automatica 30(7), 1994, section 2: friction that depends on the direction",
    key="tau_d",
    parameters={
        "tau_d": Variable(
            "N.m",
            "Half the difference of Coulomb friction between the directions",
            0.0,
            -1e9,
            1e9,
            nominal=30.0,
            source="off: symmetric in (4.27)",
        )
    },
    free={"tau_d": Free(starts=(-30.0, 30.0), scale=30.0, floor=3.0)},
    fills={"friction_level": asymmetric_level},
    asked=True,
    ranges={
        "tau_d": Range(
            -5.0,
            5.0,
            "a drive that moves overcomes it: beyond a few times its greatest torque it would stand",
            of="torque",
        )
    },
)
