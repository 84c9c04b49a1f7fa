"""A wrong scale of the slew sensor."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="sensor.gain",
    text="The slew sensor's scale is wrong.",
    residual="a difference between sensor and tracker in proportion to the angle; without the tracker like a change of J, b and flow together",
    source="(3.2): max engineering value / max voltage",
    key="gain",
    free={"gain": Free(starts=(0.95, 1.05), scale=0.05, floor=0.002)},
    sole_form=True,
    ranges={
        "gain": Range(
            0.5,
            2.0,
            "a sensor is scaled to show its range; beyond it is another unit, and below zero another sign",
            of="nominal",
        )
    },
)
