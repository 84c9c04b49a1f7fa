"""The inertia differs from nominal (payload, boom out)."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="mechanical.inertia",
    text="The inertia differs from nominal: payload, or boom out.",
    residual="a missing torque in proportion to the acceleration",
    source="(4.27): J theta''",
    key="J",
    free={"J": Free(starts=(600.0, 1100.0, 2000.0), scale=300.0)},
    sole_form=True,
    ranges={
        "J": Range(0.1, 10.0, "a boom of three times the length has nine times the inertia", of="nominal")
    },
)
