"""The valve's damping ratio differs from nominal."""

from fmus.contract import Effect, Free

EFFECT = Effect(
    name="dcv.damping",
    text="The valve overshoots more or less than nominal.",
    residual="spool error around the overshoot of a step",
    source="fig. 5.6: the measured step response is more damped than the model",
    key="zeta",
    free={"zeta": Free(starts=(0.4, 0.9), scale=0.15, floor=0.0)},
)
