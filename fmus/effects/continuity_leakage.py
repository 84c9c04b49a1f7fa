"""Cross-port leakage."""

from fmus.contract import Effect, Free, Variable, equation


@equation
def leakage_gain(K_c, p):
    """(4.26): the gain is the inverse of the leakage."""
    return K_c / (1.0 + p.c_l)


@equation
def leakage_time_constant(T, p):
    """(4.26): so is the time constant, in proportion."""
    return T / (1.0 + p.c_l)


EFFECT = Effect(
    name="continuity.leakage",
    text="More oil passes between the ports: less pressure and a shorter time constant, in proportion.",
    residual="less pressure at rest of the spool, while its initial slope stays",
    source="(4.25), (4.26): PL/Q_L = 1/((V_t/beta) s + L_c)",
    key="c_l",
    parameters={
        "c_l": Variable(
            "1",
            "Leakage beyond nominal, relative to nominal",
            0.0,
            -0.9,
            100.0,
            nominal=0.1,
            source="off: L_c of (4.33)",
        )
    },
    free={"c_l": Free(starts=(0.1, 0.4), scale=0.2, floor=0.01)},
    fills={"static_gain": leakage_gain, "time_constant": leakage_time_constant},
)
