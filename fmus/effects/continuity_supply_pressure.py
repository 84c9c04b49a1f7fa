"""The supply delivers another pressure than nominal."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="continuity.supply_pressure",
    text="The supply pressure without flow differs from nominal.",
    residual="the measured supply stands off by a constant; flow goes with the root of the supply",
    source="(4.17), (4.18): Ps",
    key="p_s",
    free={"p_s": Free(starts=(1.5e7, 1.9e7), scale=1e6)},
    sole_form=True,
    ranges={"p_s": Range(0.1, 3.0, "beyond it is another pump", of="nominal")},
    only="continuity_physical",
)
