"""The valve is more damped in small motion than in large."""

import math

from fmus.contract import Effect, Free, Range, Variable, equation


@equation
def damped_more_when_near(zeta, e, m, p):
    """The damping ratio, zeta (1 + c_a exp(-(e/x_a)^2)), e the spool's distance from its goal."""
    return zeta * (1.0 + p.c_a * math.exp(-(e / p.x_a) * (e / p.x_a)))


EFFECT = Effect(
    name="dcv.amplitude_damping",
    text="Damping, and with it the bandwidth, changes with the amplitude: the valve is more damped and slower in small motion.",
    residual="spool error at small steps and at the end of large ones: slower, with less overshoot; large motion fits",
    source="fig. 5.6: the measured valve is more damped than (5.3), above all at small amplitudes; the source gives no law",
    key="c_a",
    parameters={
        "c_a": Variable(
            "1",
            "Damping added in small motion, of zeta",
            0.0,
            0.0,
            20.0,
            source="off: (4.16) damps alike at every amplitude",
        ),
        "x_a": Variable(
            "m",
            "Distance from the demanded position over which it fades",
            0.5e-3,
            1e-6,
            0.1,
            display="mm",
            nominal=1e-3,
            source="a fifth of the stroke; fig. 5.6 has amplitudes of 35 to 100 %",
        ),
    },
    free={
        "c_a": Free(starts=(0.5, 2.0), scale=1.0, floor=0.05),
        "x_a": Free(starts=(0.3e-3, 1e-3), scale=0.3e-3),
    },
    fills={"damping_ratio": damped_more_when_near},
    ranges={
        "c_a": Range(
            0.0, 10.0, "beyond ten times the damping the valve would creep for seconds at small commands"
        ),
    },
)
