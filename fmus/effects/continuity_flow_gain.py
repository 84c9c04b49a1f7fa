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
    on={
        "continuity_physical": {
            "text": "The orifices are wider or narrower than nominal: flow per spool opening.",
            "residual": "speed and load pressure in proportion to nominal, both directions alike",
            "source": "(4.17), (4.18)",
            "key": "w",
            "free": {"w": Free(starts=(1.45e-4, 2.0e-4), scale=0.2e-4)},
            "ranges": {"w": Range(0.2, 5.0, "beyond it is another valve or another unit", of="nominal")},
        }
    },
)
