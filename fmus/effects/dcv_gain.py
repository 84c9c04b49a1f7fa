"""The valve's spool travel per command differs from nominal."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="dcv.gain",
    text="The spool travels further or less far per command than nominal.",
    residual="proportional to the spool position, at every frequency within the bandwidth",
    source="(4.29)-(4.31); Table 4.3 spreads K over 2.30..2.47",
    key="K",
    free={"K": Free(starts=(2.2e-3, 2.6e-3), scale=0.2e-3, floor=0.0)},
    sole_form=True,
    ranges={"K": Range(0.2, 5.0, "beyond it is another valve or another unit", of="nominal")},
)
