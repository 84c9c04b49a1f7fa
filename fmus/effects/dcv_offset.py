"""The spool's neutral is shifted."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="dcv.offset",
    text="The spool's neutral is shifted: the demand gets an offset after the dead zone, the stops stay.",
    residual="a constant spool error, also at rest",
    source="Table 3.5: neutral shifted by the mechanical restriction",
    key="x_0",
    free={"x_0": Free(starts=(-1e-4, 1e-4), scale=1e-4, floor=4e-6)},
    sole_form=True,
    ranges={
        "x_0": Range(
            -1.0,
            1.0,
            "shifted by all of its travel a spool has no neutral, and no command stops the drive",
            of="travel",
        )
    },
)
