"""Flow and pressure, as identified: spool position to load pressure, first order.

    T dPL/dt = K_c x_v - PL                                    (4.26), (4.33), (5.4)
    PA = (Ps + PL)/2,   PB = (Ps - PL)/2                       (4.21)

Within a step the spool moves on a straight line from its previous to its new position; the solution is exact for that.
"""

import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation, slot
from fmus.linear import phi_functions


class Input(NamedTuple):
    """What comes in."""

    spool: Annotated[float, Variable("m", "Spool position", low=-1.0, high=1.0, display="mm", nominal=1e-3)]


class Output(NamedTuple):
    """What goes out."""

    p_load: Annotated[
        float, Variable("Pa", "Load pressure that drives the mechanics", display="bar", nominal=1e5)
    ]
    p_a: Annotated[float, Variable("Pa", "Pressure at port A", display="bar", nominal=1e5)]
    p_b: Annotated[float, Variable("Pa", "Pressure at port B", display="bar", nominal=1e5)]
    p_supply: Annotated[float, Variable("Pa", "Supply pressure", display="bar", nominal=1e5)]


class State(NamedTuple):
    """First order, and the opening at the end of the last step."""

    p_load: Annotated[float, Variable("Pa", "Load pressure PA - PB", display="bar", nominal=1e5)]
    opening: Annotated[float, Variable("m", "Effective opening", display="mm", nominal=1e-3)]


class Parameters(NamedTuple):
    """The identified first order."""

    K_c: Annotated[float, Variable("Pa/m", "Load pressure per spool opening", 5.28e8, 1.0, 1e12, display="bar/mm", nominal=1e8, source="(5.4), Table 4.4 TF4; unit from SYSTEM section 9.2")]  # fmt: skip
    T: Annotated[
        float, Variable("s", "Time constant", 0.11, 1e-6, 1e3, nominal=0.1, source="(5.4), Table 4.4 TF4")
    ]
    p_s: Annotated[float, Variable("Pa", "Supply pressure without flow", 170e5, 1e4, 1e8, display="bar", nominal=1e5, source="SYSTEM section 1: 0..170 bar")]  # fmt: skip
    p_load_0: Annotated[float, Variable("Pa", "Load pressure at the start", 0.0, -1e9, 1e9, display="bar", nominal=1e5, source="starts at rest")]  # fmt: skip


class Coefficients(NamedTuple):
    """PL1 = decay PL0 + old opening0 + new opening1, of a load pressure that rises and of one that falls."""

    h: float
    gain: float
    decay: float
    old: float
    new: float
    decay_falling: float
    old_falling: float
    new_falling: float


@slot("chain")
def opening(spool: float, m: NoMemory, p: Parameters) -> float:
    """Effective opening of the valve, m; effects on the flow act here."""
    return spool


@slot("chain")
def static_gain(K_c: float, p: Parameters) -> float:
    """Load pressure per opening, Pa/m; effects such as leakage act here."""
    return K_c


@slot("chain")
def time_constant(T: float, p: Parameters) -> float:
    """Time constant, s; effects such as leakage and compressibility act here."""
    return T


@slot("chain")
def falling_time_constant(T: float, p: Parameters) -> float:
    """Time constant of a load pressure that falls, s, from that of one that rises."""
    return T


@slot("sum")
def lost_opening(p_load: float, p: Parameters) -> float:
    """Opening whose flow escapes at a load pressure, m; effects that are not linear in it act here."""
    return 0.0


@slot("chain")
def supply_pressure(p_s: float, m: NoMemory, p: Parameters) -> float:
    """Supply pressure, Pa; effects such as a sagging supply act here."""
    return p_s


@slot("chain")
def driving_pressure(p_load: float, m: NoMemory, p: Parameters) -> float:
    """Load pressure as the mechanics feel it, Pa; effects such as a counterbalance valve act here."""
    return p_load


@equation
def start(u: Input, p: Parameters) -> State:
    """Nominally no load pressure; the opening is the spool's."""
    return State(p.p_load_0, u.spool)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Exact first-order response to a ramp over the step h, s."""
    T = time_constant(p.T, p)
    gain = static_gain(p.K_c, p)
    up, up1, _, _ = phi_functions(h / T)
    down, down1, _, _ = phi_functions(h / falling_time_constant(T, p))
    return Coefficients(
        h,
        gain,
        up,
        gain * (up1 - up),
        gain * (1.0 - up1),
        down,
        gain * (down1 - down),
        gain * (1.0 - down1),
    )


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(4.33) over one step of length c.h."""
    wanted = opening(u.spool, m, p)
    q = wanted - lost_opening(x.p_load, p)
    decay, old, new = c.decay, c.old, c.new
    if x.p_load > 0.5 * c.gain * (x.opening + q):
        decay, old, new = c.decay_falling, c.old_falling, c.new_falling
    so_far = decay * x.p_load + old * x.opening
    q = wanted - lost_opening(so_far + new * q, p)
    return State(so_far + new * q, q)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """Pressures at the ports, symmetric about half the supply."""
    p_s = supply_pressure(p.p_s, m, p)
    return Output(driving_pressure(x.p_load, m, p), 0.5 * (p_s + x.p_load), 0.5 * (p_s - x.p_load), p_s)


BLOCK = Block(
    name="continuity",
    title="Flow and pressure, identified form: spool position to load pressure",
    module=sys.modules[__name__],
    reads={"spool": "line"},
    helpers=(phi_functions,),
)
