"""A flexible mode between column and boom."""

from fmus.contract import Effect, Free, Variable, equation
from fmus.linear import expm2


@equation
def compliance_inertia(J, p):
    """The column's share; the boom has the fraction mu."""
    return J * (1.0 - p.mu)


@equation
def compliance_torque(s, theta, omega, x, m, p, c):
    """Spring and damper torque of the boom on the column, against positive motion; the boom's motion predicted for s = 1."""
    stiffness = p.w_f * p.w_f
    damping = 2.0 * p.zeta_f * p.w_f
    acceleration = stiffness * (x.theta - m.boom_angle) + damping * (x.omega - m.boom_rate)
    t = s * c.h
    angle = m.boom_angle + t * (m.boom_rate + 0.5 * t * acceleration)
    rate = m.boom_rate + t * acceleration
    return p.mu * p.J * (stiffness * (theta - angle) + damping * (omega - rate))


@equation
def compliance_remember(x, x1, u, m, p, c):
    """The boom's angle and velocity while the column moves on a straight line, exact for that."""
    rate = (x1.theta - x.theta) / c.h
    a11, a12, a21, a22 = expm2(0.0, 1.0, -p.w_f * p.w_f, -2.0 * p.zeta_f * p.w_f, c.h)
    e = m.boom_angle - x.theta
    v = m.boom_rate - rate
    return x1.theta + a11 * e + a12 * v, rate + a21 * e + a22 * v


@equation
def compliance_begin(x, u, p):
    """At rest with the column."""
    return x.theta, 0.0


EFFECT = Effect(
    name="mechanical.compliance",
    text="A flexible mode between column and boom; the cylinder drives, and sensor and tracker see, the column.",
    residual="oscillation of one frequency after every transient of the torque",
    source="two-inertia drive: Dresig and Holzweissig, Dynamics of Machinery, 2010, ch. 4",
    key="mu",
    parameters={
        "mu": Variable(
            "1",
            "Fraction of the inertia that is the boom",
            0.0,
            0.0,
            0.9,
            nominal=0.1,
            source="off: rigid column and boom in (4.27)",
        ),
        "w_f": Variable(
            "rad/s",
            "Frequency of the boom with the column locked",
            10.0,
            0.1,
            100.0,
            nominal=10.0,
            source="assumed; acts only where mu > 0",
        ),
        "zeta_f": Variable(
            "1",
            "Damping ratio of that mode",
            0.02,
            0.0,
            0.5,
            nominal=0.02,
            source="assumed; acts only where mu > 0",
        ),
    },
    free={
        "mu": Free(starts=(0.3, 0.6), scale=0.2, floor=0.01),
        "w_f": Free(starts=(5.0, 7.0, 10.0, 14.0, 20.0, 40.0), scale=5.0),
        "zeta_f": Free(starts=(0.03,), scale=0.03),
    },
    fills={"inertia": compliance_inertia, "load_torque": compliance_torque},
    memory={
        "boom_angle": Variable("rad", "Angle of the boom", display="deg"),
        "boom_rate": Variable("rad/s", "Velocity of the boom", display="deg/s", nominal=0.01),
    },
    begin=compliance_begin,
    remember=compliance_remember,
    when="after",
    helpers=(expm2,),
)
