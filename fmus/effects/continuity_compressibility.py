"""Lower effective bulk modulus."""

from fmus.contract import Effect, Free, Range, Variable, equation


@equation
def compressibility_time_constant(T, p):
    """(4.26): V_t/beta grows, L_c stays."""
    return T * (1.0 + p.c_beta)


EFFECT = Effect(
    name="continuity.compressibility",
    text="Entrained air or hoses make the oil softer: a longer time constant, same gain.",
    residual="pressure error during transients only, in phase with the pressure's rate",
    source="(4.26): T = V_t/(beta L_c)",
    key="c_beta",
    parameters={
        "c_beta": Variable(
            "1",
            "Compressibility beyond nominal, relative to nominal",
            0.0,
            -0.9,
            100.0,
            nominal=0.1,
            source="off: T of (4.33)",
        )
    },
    free={"c_beta": Free(starts=(0.2, 1.0), scale=0.3, floor=0.01)},
    fills={"time_constant": compressibility_time_constant},
    ranges={
        "c_beta": Range(
            -0.5,
            20.0,
            "without air and hoses oil is about twice as stiff; with a tenth of air by volume some twenty times softer: Merritt, Hydraulic Control Systems, 1967, section 2-5",
        )
    },
    on={
        "continuity_physical": {  # its equations hold the oil's stiffness itself
            "source": "(4.19), (4.20): beta",
            "key": "beta",
            "parameters": {},
            "free": {"beta": Free(starts=(3.5e8, 6e8), scale=1.5e8)},
            "fills": {},
            "ranges": {
                "beta": Range(
                    0.05,
                    2.0,
                    "without air and hoses oil is about twice as stiff; with a tenth of air by volume some twenty times softer: Merritt, Hydraulic Control Systems, 1967, section 2-5",
                    of="nominal",
                )
            },
        }
    },
)
