"""Viscous friction that differs between the two directions."""

from fmus.contract import Effect, Free, Variable, equation


@equation
def viscous_difference(s, theta, omega, x, m, p, c):
    """More forwards and less backwards."""
    return p.a_b * p.b * abs(omega)


EFFECT = Effect(
    name="mechanical.viscous_asymmetry",
    text="Viscous friction differs between the two directions: (1 + a_b) b forwards, (1 - a_b) b backwards.",
    residual="a missing torque in proportion to the magnitude of the speed, of one sign in both directions",
    source="Armstrong-Helouvry et al., Automatica 30(7), 1994, section 2: friction that depends on the direction",
    key="a_b",
    parameters={
        "a_b": Variable(
            "1",
            "Part by which viscous friction is larger forwards and smaller backwards",
            0.0,
            -1.0,
            1.0,
            display="%",
            nominal=0.1,
            source="off: symmetric in (4.27)",
        )
    },
    free={"a_b": Free(starts=(-0.15, 0.15), scale=0.1, floor=0.01)},
    fills={"load_torque": viscous_difference},
    alone=True,
    sole_form=True,
)
