"""Pressure per spool opening differs from nominal."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="continuity.flow_gain",
    text="Pressure per spool opening differs from nominal, with the same time constant.",
    residual="proportional to the load pressure, both directions alike",
    source="(4.33); Table 4.4 spreads K over 4.6..5.7",
    key="K_c",
    free={"K_c": Free(starts=(4.5e8, 6.2e8), scale=0.6e8)},
    sole_form=True,
    ranges={"K_c": Range(0.2, 5.0, "beyond it is another valve or another unit", of="nominal")},
)
