"""The spool's speed is limited."""

from fmus.contract import Effect, Free

EFFECT = Effect(
    name="dcv.rate_limit",
    text="The spool's speed is limited.",
    residual="spool error only in fast, large moves; ramps of one constant slope in the measured spool",
    source="limited pilot flow of the PVES actuator; saturation of x' in (4.16)",
    key="v_max",
    free={
        "v_max": Free(
            starts=(0.005, 0.008, 0.012, 0.017, 0.024, 0.035), scale=0.01, limits="spool", rate=True
        ),
    },
    forms={"r_v": Free(starts=(0.5, 0.75, 1.33, 2.0), scale=0.1)},
    form_of_place="r_v",
)
