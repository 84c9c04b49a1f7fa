"""A cylinder turns the joint through a linkage: the transmission ratio depends on the angle."""

import math

from fmus.contract import QUARTER, Effect, Free, Variable, equation


@equation
def linkage_angle(theta, before, p):
    """Joint angle after the way theta - before of the drive: d(joint)/d(drive) = 1 + e_l cos(joint - theta_l), exact."""
    stretch = math.sqrt((1.0 + p.e_l) / (1.0 - p.e_l))
    y = before - p.theta_l
    turns = math.floor(y / (2.0 * math.pi) + 0.5)
    half = math.atan(math.tan(0.5 * y - turns * math.pi) / stretch) + turns * math.pi
    half = half + 0.5 * math.sqrt(1.0 - p.e_l * p.e_l) * (theta - before)
    turns = math.floor(half / math.pi + 0.5)
    return p.theta_l + 2.0 * (math.atan(stretch * math.tan(half - turns * math.pi)) + turns * math.pi)


@equation
def linkage_velocity(omega, theta, m, p):
    """Velocity of the joint."""
    return omega * (1.0 + p.e_l * math.cos(theta - p.theta_l))


EFFECT = Effect(
    name="mechanical.linkage",
    text="A cylinder turns the joint through a linkage: per way of the cylinder it turns more at some angles than at others.",
    residual="the speed at a constant command changes with the angle, in proportion to the speed and alike in both directions",
    source="first harmonic of a linkage's transmission ratio: Norton, Design of Machinery, 2020, ch. 6",
    key="e_l",
    parameters={
        "e_l": Variable(
            "1",
            "Amplitude of the transmission ratio over the angle",
            0.0,
            -0.95,
            0.95,
            nominal=0.1,
            source="off: rack and pinion, theta = x/r",
        ),
        "theta_l": Variable(
            "rad",
            "Angle at which the joint turns fastest",
            0.0,
            -1e3,
            1e3,
            display="deg",
            source="assumed; acts only where e_l is on",
        ),
    },
    free={
        "e_l": Free(starts=(0.3,), scale=0.2, floor=0.01),
        "theta_l": Free(starts=(0.0, QUARTER), scale=1.0, phase=True),
    },
    fills={"joint_angle": linkage_angle, "seen_velocity": linkage_velocity},
    asked=True,
)
