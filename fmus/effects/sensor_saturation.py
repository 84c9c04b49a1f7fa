"""The slew sensor's reading saturates."""

from fmus.contract import Effect, Free

EFFECT = Effect(
    name="sensor.saturation",
    text="The sensor saturates: beyond its range it shows the end of it, while the drive moves on.",
    residual="the reading stays at one value while the model goes on, and comes back later than the drive reverses",
    source="saturation of a sensor or an amplifier: Isermann, Fault-Diagnosis Systems, 2006, ch. 4",
    key="high",
    free={
        "high": Free(starts=(1e6,), scale=0.1, limits="slew"),
        "low": Free(starts=(-1e6,), scale=0.1, limits="slew"),
    },
    sole_form=True,
    prior=-2.0,  # a machine that rests at the end of its travel reads the same, and every machine has ends
)
