"""A constant error of the slew sensor."""

from fmus.contract import Effect, Free

EFFECT = Effect(
    name="sensor.bias",
    text="The slew sensor reads a constant too much or too little.",
    residual="a constant difference between slew sensor and tracker; without the tracker it hides in the start angle",
    source="(3.2): offset of the potentiometer",
    key="bias",
    free={"bias": Free(starts=(-0.01, 0.01), scale=0.01, floor=2e-4)},
    sole_form=True,
)
