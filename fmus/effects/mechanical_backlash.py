"""Lost motion between rack and column."""

import math

from fmus.contract import Effect, Free, Variable, equation


@equation
def backlash_remember(x, x1, u, m, p, c):
    """The far side follows once the near side has crossed the gap; its angle and velocity.

    At once, or with a lag of tau_b on the straight line along which the flank moves within the step.
    """
    half = 0.5 * p.gap
    seen = max(x1.theta - half, min(x1.theta + half, m.backlash_angle))
    if p.tau_b > 0.0:
        before = max(x.theta - half, min(x.theta + half, m.backlash_angle))
        behind = p.tau_b * (seen - before) / c.h
        seen += (m.backlash_angle - before + behind) * math.exp(-c.h / p.tau_b) - behind
    return seen, (seen - m.backlash_angle) / c.h


@equation
def backlash_begin(x, u, p):
    """In the middle of the gap, at rest."""
    return x.theta, 0.0


@equation
def backlash_angle(theta, m, p):
    """The far side's angle."""
    return m.backlash_angle


@equation
def backlash_velocity(omega, theta, m, p):
    """The far side's velocity."""
    return m.backlash_rate


EFFECT = Effect(
    name="mechanical.backlash",
    text="Lost motion between rack and column: after a reversal the column waits until the gap is crossed.",
    residual="angle error that changes by the gap at each reversal and stays until the next",
    source="kinematic play; play operator: Visintin, Differential Models of Hysteresis, 1994",
    key="gap",
    parameters={
        "gap": Variable(
            "rad",
            "Full width of the gap",
            0.0,
            0.0,
            1.0,
            display="deg",
            nominal=0.01,
            source="off: rigid pinion, theta = x/r",
        ),
        "tau_b": Variable(
            "s",
            "Time in which the far side creeps up to the flank (oil film, worn flanks)",
            0.0,
            0.0,
            10.0,
            display="ms",
            nominal=0.01,
            source="off: kinematic play",
        ),
    },
    free={"gap": Free(starts=(0.003, 0.01), scale=0.006, floor=1e-4)},
    forms={"tau_b": Free(starts=(0.02, 0.1), scale=0.05, floor=0.002)},
    fills={"seen_angle": backlash_angle, "seen_velocity": backlash_velocity},
    memory={
        "backlash_angle": Variable("rad", "Angle of the far side", display="deg"),
        "backlash_rate": Variable("rad/s", "Velocity of the far side", display="deg/s", nominal=0.01),
    },
    begin=backlash_begin,
    remember=backlash_remember,
    when="after",
)
