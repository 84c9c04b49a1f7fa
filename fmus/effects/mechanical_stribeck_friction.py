"""Friction higher at standstill than in motion, falling with speed."""

import math

from fmus.contract import Effect, Free, Range, Variable, equation
from fmus.effects.mechanical_coulomb_friction import EFFECT as COULOMB

# bearings and gears have one to two, seals of cylinders a few; a far larger ratio is a dead band and no friction
BREAKAWAY = 10.0  # greatest ratio of friction at standstill to friction in motion


@equation
def stribeck_level(omega, m, p):
    """tau_s exp(-|omega/omega_s|^delta), on top of Coulomb friction."""
    ratio = omega / p.omega_s
    if p.delta != 2.0:
        return p.tau_s * math.exp(-(abs(ratio) ** p.delta))
    return p.tau_s * math.exp(-ratio * ratio)


EFFECT = Effect(
    name="mechanical.stribeck_friction",
    text="Friction is higher at standstill than in motion and falls with speed.",
    residual="a missing torque against motion that is largest near standstill; jerky start",
    source="Armstrong-Helouvry et al., Automatica 30(7), 1994: tau_c + tau_s exp(-|omega/omega_s|^delta), delta 1/2 to 2",
    key="tau_s",
    parameters={
        "tau_s": Variable(
            "N.m",
            "Friction at standstill beyond Coulomb friction",
            0.0,
            0.0,
            1e9,
            nominal=100.0,
            source="off: only tau_c in (4.27)",
        ),
        "omega_s": Variable(
            "rad/s",
            "Speed at which it has fallen to 1/e",
            0.01,
            1e-6,
            1e3,
            display="deg/s",
            nominal=0.01,
            source="assumed; acts only where tau_s > 0",
        ),
        "delta": Variable(
            "1",
            "Exponent of the fall with speed",
            2.0,
            0.3,
            2.0,
            nominal=1.0,
            source="off: Gauss; 1 is Tustin's exponential; above 2 the curve has a shoulder and not a fall",
        ),
    },
    free={
        "tau_c": Free(starts=(30.0, 150.0), scale=100.0),
        "tau_s": Free(starts=(100.0, 300.0), scale=150.0, floor=10.0, within=("tau_c", BREAKAWAY - 1.0)),
        "omega_s": Free(starts=(0.003, 0.01), scale=0.005),
    },
    forms={**COULOMB.forms, "delta": Free(starts=(1.0, 0.6), scale=0.5, floor=0.1)},
    fills={"friction_level": stribeck_level},
    ranges={
        "tau_c": Range(
            -5.0,
            5.0,
            "a drive that moves overcomes it: beyond a few times its greatest torque it would stand",
            of="torque",
        ),
        "tau_s": Range(
            -5.0,
            5.0,
            "a drive that moves overcomes it: beyond a few times its greatest torque it would stand",
            of="torque",
        ),
    },
    prior=-1.0,  # three numbers where one or two do as well
)
