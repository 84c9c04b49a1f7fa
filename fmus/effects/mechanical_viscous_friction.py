"""The viscous friction differs from nominal."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="mechanical.viscous_friction",
    text="Friction in proportion to speed differs from nominal.",
    residual="a missing torque in proportion to the velocity",
    source="(4.27): b theta'",
    key="b",
    free={"b": Free(starts=(22000.0, 32000.0), scale=4000.0)},
    ranges={
        "b": Range(
            0.1,
            10.0,
            "the viscosity of oil, in proportion to which it is, spans two decades from cold to hot",
            of="nominal",
        )
    },
)
