"""Constant friction torque against motion, with true sticking."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="mechanical.coulomb_friction",
    text="A constant friction torque acts against motion and holds the column at rest up to its own size.",
    residual="a missing torque of constant size and the sign of the velocity; standstill at small torque",
    source="(4.27): tau_c sign(theta')",
    key="tau_c",
    free={"tau_c": Free(starts=(50.0, 300.0), scale=150.0, floor=3.0)},
    forms={
        "omega_v": Free(starts=(3e-4, 2e-3), scale=5e-4, floor=5e-5),
        "z_s": Free(starts=(2e-5, 1e-4), scale=2e-5, floor=2e-6),
    },
    ranges={
        "tau_c": Range(
            -5.0,
            5.0,
            "a drive that moves overcomes it: beyond a few times its greatest torque it would stand",
            of="torque",
        )
    },
)
