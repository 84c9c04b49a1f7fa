"""The travel ends at a stop."""

from fmus.contract import Effect, Free

EFFECT = Effect(
    name="mechanical.end_stop",
    text="The travel ends at a stop, each side its own: the drive pushes and nothing moves, until it is reversed.",
    residual="the measured angle stays at one value, from either speed, while the model goes on",
    source="unilateral constraint, impact without rebound: Brogliato, Nonsmooth Mechanics, 2016",
    key="theta_max",
    free={
        "theta_max": Free(starts=(1e9,), scale=0.1, limits="theta"),
        "theta_min": Free(starts=(-1e9,), scale=0.1, limits="theta"),
    },
    sole_form=True,
    bends=True,
)
