"""The valve's natural frequency differs from nominal."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="dcv.bandwidth",
    text="The valve is faster or slower than nominal.",
    residual="spool error during transients only, in phase with the spool's speed",
    source="(4.29)-(4.31); Table 4.3 spreads w0 over 23.2..27.6",
    key="w0",
    free={"w0": Free(starts=(18.0, 35.0), scale=4.0, floor=0.0)},
    ranges={
        "w0": Range(
            0.2,
            5.0,
            "cold oil or low pilot pressure slow a valve down by a few times; beyond it is another valve",
            of="nominal",
        )
    },
)
