"""The spool's travel is limited, each side its own."""

from fmus.contract import Effect, Free

EFFECT = Effect(
    name="dcv.stroke_limit",
    text="A stop ends the spool's travel earlier than nominal, each side its own.",
    residual="the measured spool stays at one value while the model goes on",
    source="two bolts restrict the spool (SYSTEM section 1); Tables 3.5, 3.6",
    key="x_max",
    free={
        "x_max": Free(starts=(1.2e-3, 1.8e-3, 2.2e-3), scale=0.4e-3, limits="spool"),
        "x_min": Free(starts=(-1.2e-3, -1.8e-3, -2.2e-3), scale=0.4e-3, limits="spool"),
    },
    bends=True,
)
