"""The counterbalance valve opens only above a pressure."""

from fmus.contract import Effect, Free, Variable, equation


@equation
def cracking_pressure(p_load, m, p):
    """A dead zone of half-width p_c in the load pressure that the mechanics feel.

    With s_c its corners are round, PL (1 - (1 + |PL/p_c|^(1/s_c))^-s_c): closed it holds, far beyond p_c is missing.
    """
    if p.s_c > 0.0 and p.p_c > 0.0:
        ratio = abs(p_load) / p.p_c
        # the smaller of ratio and its inverse: powers of it never overflow
        if ratio > 1.0:
            held = (1.0 + ratio ** (-1.0 / p.s_c)) ** -p.s_c / ratio
        else:
            held = (1.0 + ratio ** (1.0 / p.s_c)) ** -p.s_c
        return p_load * (1.0 - held)
    if p_load > p.p_c:
        return p_load - p.p_c
    if p_load < -p.p_c:
        return p_load + p.p_c
    return 0.0


EFFECT = Effect(
    name="continuity.cracking_pressure",
    text="The counterbalance valve opens only above a pressure: the mechanics feel a dead zone in the load pressure.",
    residual="the slew stands still at small load pressure; above it a torque is missing that is constant and has the pressure's sign",
    source="the overcentre valve between valve and cylinder (SYSTEM section 1)",
    key="p_c",
    prior=-1.0,  # without the pressures dry friction reads the same, and every machine has it
    parameters={
        "p_c": Variable(
            "Pa",
            "Cracking pressure",
            0.0,
            0.0,
            1e8,
            display="bar",
            nominal=1e5,
            source="off: no counterbalance valve in (4.27)",
        ),
        "s_c": Variable(
            "1",
            "Softness of the opening",
            0.0,
            0.0,
            1.0,
            nominal=0.3,
            source="off: the valve opens at one pressure, all at once",
        ),
    },
    free={"p_c": Free(starts=(5e4, 2e5), scale=1e5, floor=3e3)},
    forms={"s_c": Free(starts=(0.2, 0.5), scale=0.2, floor=0.03)},
    fills={"driving_pressure": cracking_pressure},
    on={"continuity_physical": {}},
)
