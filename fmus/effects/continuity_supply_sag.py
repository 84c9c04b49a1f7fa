"""The supply falls with the flow drawn."""

import math

from fmus.contract import Effect, Free, Variable, equation


@equation
def sag_root(supply, p):
    """Root of the supply over its value without flow: what the flow goes with."""
    return math.sqrt(max(supply, 0.0) / p.p_s)


@equation
def sag_remember(x, x1, u, m, p, c):
    """First-order lag of the supply towards p_s - k_s |spool| sqrt(Ps/p_s), with the mean flow of the step (Heun)."""
    decay = math.exp(-c.h / p.tau_s)
    before = abs(m.sag_spool) * sag_root(m.sag_supply, p)
    goal = p.p_s - p.k_s * 0.5 * (before + abs(u.spool) * sag_root(m.sag_supply, p))
    ahead = goal + (m.sag_supply - goal) * decay
    goal = p.p_s - p.k_s * 0.5 * (before + abs(u.spool) * sag_root(ahead, p))
    return goal + (m.sag_supply - goal) * decay, u.spool


@equation
def sag_begin(x, u, p):
    """No flow yet."""
    return p.p_s, u.spool


@equation
def sag_opening(opening, m, p):
    """Flow falls with the root of the supply."""
    return opening * sag_root(m.sag_supply, p)


@equation
def sag_supply(p_s, m, p):
    """The supply as it is now."""
    return m.sag_supply


EFFECT = Effect(
    name="continuity.supply_sag",
    text="The supply pressure falls with the flow drawn, and the flow with the root of the supply.",
    residual="p_supply dips while the spool is open; load pressure falls short at large openings",
    source="(4.17): flow goes with the root of the supply; first-order lag of the power unit",
    key="k_s",
    parameters={
        "k_s": Variable(
            "Pa/m",
            "Fall of the supply per opening",
            0.0,
            0.0,
            1e12,
            display="bar/mm",
            nominal=1e9,
            source="off: stiff supply",
        ),
        "tau_s": Variable(
            "s",
            "Time constant of the supply",
            0.1,
            1e-3,
            10.0,
            nominal=0.1,
            source="assumed; acts only where k_s > 0",
        ),
    },
    free={
        "k_s": Free(starts=(5e8, 2.5e9), scale=1.5e9, floor=2e7),
        "tau_s": Free(starts=(0.1, 0.4), scale=0.1),
    },
    fills={"opening": sag_opening, "supply_pressure": sag_supply},
    memory={
        "sag_supply": Variable("Pa", "Supply pressure", display="bar", nominal=1e5),
        "sag_spool": Variable("m", "Spool position at the end of the last step", display="mm", nominal=1e-3),
    },
    begin=sag_begin,
    remember=sag_remember,
    helpers=(sag_root,),
    on={
        "continuity_physical": {  # its equations hold the supply's own
            "key": "R_s",
            "parameters": {},
            "free": {
                "R_s": Free(starts=(3e9, 2e10), scale=1e10, floor=1e8),
                "tau_p": Free(starts=(0.1, 0.4), scale=0.1),
            },
            "fills": {},
            "memory": {},
            "begin": None,
            "remember": None,
            "helpers": (),
        }
    },
)
