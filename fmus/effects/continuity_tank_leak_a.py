"""Leakage of chamber A to the tank."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="continuity.tank_leak_a",
    text="Oil passes from chamber A to the tank.",
    residual="less speed and load pressure while chamber A drives; at rest the load pressure falls on that side",
    source="(4.19): L_A",
    key="C_A",
    free={"C_A": Free(starts=(1e-12, 5e-12), scale=1e-12, floor=2e-14)},
    sole_form=True,
    ranges={
        "C_A": Range(
            0.0, 1e-10, "fifty times the nominal leakage across the ports swallows what the valve passes"
        )
    },
    only="continuity_physical",
)
