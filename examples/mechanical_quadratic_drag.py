"""A hypothesis of your own in one file: drag that grows with the square of the speed (docs/effects.md)."""

from fmus.contract import Effect, Free, Range, Variable, equation


@equation
def drag_torque(s, theta, omega, x, m, p, c):
    """Against the motion: q omega abs(omega)."""
    return p.q_drag * omega * abs(omega)


EFFECT = Effect(
    name="mechanical.quadratic_drag",
    text="Drag that grows with the square of the speed: air, or turbulent oil.",
    residual="a missing torque against the motion that grows with the square of the speed",
    source="drag of a body at high Reynolds number: F = c A rho v^2 / 2",
    key="q_drag",
    parameters={
        "q_drag": Variable(
            "N.m.s2/rad2",
            "Torque of the drag at 1 rad/s",
            0.0,
            0.0,
            1e9,
            nominal=1e5,
            source="off: no such term in (4.27)",
        ),
    },
    free={"q_drag": Free(starts=(5e4, 2e5), scale=1e5, floor=1e3)},
    fills={"load_torque": drag_torque},
    ranges={"q_drag": Range(0.0, 1e7, "beyond, the drag at a tenth of a rad/s would be 100 kN m")},
)
