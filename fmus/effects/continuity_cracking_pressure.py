"""The counterbalance valve opens only above a pressure."""

from fmus.contract import Effect, Free, Variable, equation


@equation
def cracking_pressure(p_load, m, p):
    """A dead zone of half-width p_c in the load pressure that the mechanics feel."""
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
        )
    },
    free={"p_c": Free(starts=(5e4, 2e5), scale=1e5, floor=3e3)},
    fills={"driving_pressure": cracking_pressure},
)
