"""Cross-port leakage."""

import math

from fmus.contract import Effect, Free, Range, Variable, equation


@equation
def leakage_gain(K_c, p):
    """(4.26): the gain is the inverse of the leakage."""
    return K_c / (1.0 + p.c_l) if p.k_t == 0.0 else K_c


@equation
def leakage_time_constant(T, p):
    """(4.26): so is the time constant, in proportion."""
    return T / (1.0 + p.c_l) if p.k_t == 0.0 else T


@equation
def leakage_lost(p_load, p):
    """Flow through a gap that turns turbulent: in proportion to small pressures, to the root of large ones; c_l is at 10 bar."""
    share = (1.0 + p.k_t * 1e6) / (1.0 + p.k_t * abs(p_load))
    return p.c_l / p.K_c * p_load * math.sqrt(share) if p.k_t > 0.0 else 0.0


EFFECT = Effect(
    name="continuity.leakage",
    text="More oil passes between the ports: less pressure and a shorter time constant, in proportion.",
    residual="less pressure at rest of the spool, while its initial slope stays",
    source="(4.25), (4.26): PL/Q_L = 1/((V_t/beta) s + L_c)",
    key="c_l",
    parameters={
        "c_l": Variable(
            "1",
            "Leakage beyond nominal, relative to nominal (at 10 bar where it turns turbulent)",
            0.0,
            -0.9,
            100.0,
            nominal=0.1,
            source="off: L_c of (4.33)",
        ),
        "k_t": Variable(
            "1/Pa",
            "Inverse of the load pressure at which the leakage turns turbulent",
            0.0,
            0.0,
            1.0,
            nominal=1e-6,
            source="off: laminar, (4.25)",
        ),
    },
    free={"c_l": Free(starts=(0.1, 0.4), scale=0.2, floor=0.01)},
    forms={"k_t": Free(starts=(1e-6, 1e-5, 1e-4), scale=1e-5, floor=1e-7)},
    fills={"static_gain": leakage_gain, "time_constant": leakage_time_constant, "lost_opening": leakage_lost},
    ranges={
        "c_l": Range(
            0.0,
            10.0,
            "a gap adds to the leakage there is; with eleven times that no pressure is left to drive with",
        )
    },
    on={
        "continuity_physical": {  # its equations hold the leakage itself
            "text": "More oil passes between the ports.",
            "residual": "less speed for the opening under load; what moves the drive dies out faster",
            "source": "(4.19), (4.20), (4.25): L_C PL",
            "key": "C_L",
            "parameters": {},
            "free": {"C_L": Free(starts=(3e-12, 1e-11), scale=2e-12, floor=1e-13)},
            "forms": {},
            "fills": {},
            "ranges": {
                "C_L": Range(
                    1.0,
                    50.0,
                    "a gap adds to the leakage there is; fifty times that swallows what the valve passes",
                    of="nominal",
                )
            },
        }
    },
)
