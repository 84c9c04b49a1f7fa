"""Leakage of chamber B to the tank."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="continuity.tank_leak_b",
    text="Oil passes from chamber B to the tank.",
    residual="less speed and load pressure while chamber B drives; at rest the load pressure falls on that side",
    source="(4.20): L_B",
    key="C_B",
    free={"C_B": Free(starts=(1e-12, 5e-12), scale=1e-12, floor=2e-14)},
    sole_form=True,
    ranges={
        "C_B": Range(
            0.0, 1e-10, "fifty times the nominal leakage across the ports swallows what the valve passes"
        )
    },
    only="continuity_physical",
)
