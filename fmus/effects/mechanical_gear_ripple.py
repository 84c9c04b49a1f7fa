"""A torque that repeats with the tooth pitch."""

import math

from fmus.contract import QUARTER, Effect, Free, Range, Variable, equation


@equation
def ripple_torque(s, theta, omega, x, m, p, c):
    """-tau_r sin(n_r theta + phi_r) against positive motion."""
    return -p.tau_r * math.sin(p.n_r * theta + p.phi_r)


EFFECT = Effect(
    name="mechanical.gear_ripple",
    text="A torque that repeats with the tooth pitch, periodic in the angle.",
    residual="a missing torque that is periodic in the angle, many periods a turn",
    source="meshing of rack and pinion: one period a tooth",
    key="tau_r",
    parameters={
        "tau_r": Variable(
            "N.m",
            "Amplitude of the ripple",
            0.0,
            0.0,
            1e9,
            nominal=100.0,
            source="off: smooth pinion in (4.27)",
        ),
        "n_r": Variable(
            "1",
            "Periods a turn: teeth of the pinion",
            20.0,
            6.0,
            1000.0,
            nominal=10.0,
            source="assumed; acts only where tau_r > 0",
        ),
        "phi_r": Variable(
            "rad",
            "Phase at angle zero",
            0.0,
            -1e3,
            1e3,
            display="deg",
            source="assumed; acts only where tau_r > 0",
        ),
    },
    free={
        "tau_r": Free(starts=(100.0,), scale=100.0, floor=2.0),
        "n_r": Free(starts=(12.0, 18.0, 20.0, 24.0, 30.0), scale=5.0),
        "phi_r": Free(starts=(0.0, QUARTER), scale=1.0, phase=True),
    },
    fills={"load_torque": ripple_torque},
    ranges={
        "tau_r": Range(
            -5.0,
            5.0,
            "a drive holds its load: beyond a few times its greatest torque it would be carried off",
            of="torque",
        )
    },
    repeats=True,
)
