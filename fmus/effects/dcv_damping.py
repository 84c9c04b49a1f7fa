"""The valve's damping ratio differs from nominal."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="dcv.damping",
    text="The valve overshoots more or less than nominal.",
    residual="spool error around the overshoot of a step",
    source="fig. 5.6: the measured step response is more damped than the model",
    key="zeta",
    free={"zeta": Free(starts=(0.4, 0.9), scale=0.15, floor=0.0)},
    ranges={
        "zeta": Range(
            0.1,
            10.0,
            "the viscosity of oil, in proportion to which it damps, spans two decades from cold to hot",
            of="nominal",
        )
    },
)
