"""The valve is more damped in small motion than in large."""

import math

from fmus.contract import Effect, Free, Range, Variable, equation


@equation
def damped_more_when_near(zeta, e, m, p):
    """The damping ratio, zeta (1 + c_a exp(-(e/(u_a K))^2)), e the spool's distance from its goal."""
    part = e / (p.u_a * p.K)
    return zeta * (1.0 + p.c_a * math.exp(-part * part))


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
        "u_a": Variable(
            "1",
            "Distance from the goal, in demand, over which it fades",
            0.2,
            1e-3,
            10.0,
            display="%",
            nominal=0.1,
            source="fig. 5.6 has amplitudes of 35 to 100 %: half of the smallest",
        ),
    },
    free={
        "c_a": Free(starts=(0.5, 2.0), scale=1.0, floor=0.05),
        "u_a": Free(starts=(0.12, 0.4), scale=0.12),
    },
    alone=True,
    fills={"damping_ratio": damped_more_when_near},
    ranges={
        "u_a": Range(
            0.05,
            3.0,
            "beyond three fifths of full command no motion is large, and the damping is one number: dcv.damping",
            of="nominal",
        ),
        "c_a": Range(
            0.0, 10.0, "beyond ten times the damping the valve would creep for seconds at small commands"
        ),
    },
)
