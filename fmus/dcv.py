"""Directional control valve: command to spool position, second order, with stops, speed limit and neutral.

    x'' + 2 zeta w0 x' + w0^2 x = w0^2 (K u + x_0)            (4.16)
    |x'| <= v_max,   x_min <= x <= x_max                      stop: position clamped, speed set to zero

The demand is held over a step. Between events the solution is exact for any step; an event (speed limit reached or
left, stop hit) is located inside the step.
"""

import math
import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation, slot
from fmus.linear import expm2


class Input(NamedTuple):
    """What comes in."""

    demand: Annotated[float, Variable("1", "Command behind the valve's dead zone", low=-100.0, high=100.0)]


class Output(NamedTuple):
    """What goes out."""

    spool: Annotated[float, Variable("m", "Spool position", display="mm", nominal=1e-3)]
    spool_rate: Annotated[float, Variable("m/s", "Spool speed", display="mm/s", nominal=1e-2)]


class State(NamedTuple):
    """Second order."""

    spool: Annotated[float, Variable("m", "Spool position", display="mm", nominal=1e-3)]
    spool_rate: Annotated[float, Variable("m/s", "Spool speed", display="mm/s", nominal=1e-2)]


class Parameters(NamedTuple):
    """The identified valve, its stops and its limits."""

    K: Annotated[float, Variable("m", "Spool travel per unit of command", 2.375e-3, 1e-6, 1.0, display="mm", nominal=1e-3, source="(5.3), Table 4.3 TF4")]  # fmt: skip
    w0: Annotated[float, Variable("rad/s", "Undamped natural frequency", 25.23, 0.1, 1e4, nominal=10.0, source="(5.3), Table 4.3 TF4")]  # fmt: skip
    zeta: Annotated[float, Variable("1", "Damping ratio", 0.545, 0.0, 100.0, source="(5.3), Table 4.3 TF4")]
    x_0: Annotated[float, Variable("m", "Shift of the neutral position", 0.0, -1e-2, 1e-2, display="mm", nominal=1e-4, source="Table 3.5: neutral shifted; nominal 0 (CONTRACT section 6)")]  # fmt: skip
    v_max: Annotated[float, Variable("m/s", "Largest spool speed; 1 m/s is out of reach", 1.0, 1e-5, 100.0, display="mm/s", nominal=1e-2, source="CONTRACT section 6: no rate limit in reach")]  # fmt: skip
    x_min: Annotated[float, Variable("m", "Stop towards B", -2.6e-3, -1.0, 0.0, display="mm", nominal=1e-3, source="Table 3.6")]  # fmt: skip
    x_max: Annotated[float, Variable("m", "Stop towards A", 2.6e-3, 0.0, 1.0, display="mm", nominal=1e-3, source="Table 3.6")]  # fmt: skip
    spool_0: Annotated[float, Variable("m", "Spool position at the start", 0.0, -1.0, 1.0, display="mm", nominal=1e-3, source="CONTRACT section 6: starts at rest")]  # fmt: skip


class Coefficients(NamedTuple):
    """Transition matrix of (deviation, speed) over the step."""

    h: float
    a11: float
    a12: float
    a21: float
    a22: float


@slot("chain")
def delayed_demand(demand: float, m: NoMemory, p: Parameters) -> float:
    """The demand as it reaches the spool, 1; effects such as a transport delay act here."""
    return demand


@equation
def transition(t: float, p: Parameters) -> tuple[float, float, float, float]:
    """Transition matrix of (deviation from the rest position, speed) over t seconds, row by row."""
    return expm2(0.0, 1.0, -p.w0 * p.w0, -2.0 * p.zeta * p.w0, t)


@equation
def rest_position(demand: float, p: Parameters) -> float:
    """Where the spool comes to rest, m, were there no stops."""
    return p.K * demand + p.x_0


@equation
def inside(spool: float, rate: float, p: Parameters) -> bool:
    """True where neither a stop nor the speed limit is exceeded by more than rounding."""
    grace = 1e-12 * (p.x_max - p.x_min)
    fast = p.v_max * (1.0 + 1e-12)
    return p.x_min - grace <= spool <= p.x_max + grace and -fast <= rate <= fast


@equation
def unlimited(spool: float, rate: float, rest: float, p: Parameters) -> bool:
    """True if the free motion from here never meets a limit: its energy only falls, which bounds deviation and speed."""
    e = spool - rest
    reach = math.sqrt(e * e + rate * rate / (p.w0 * p.w0))
    return inside(rest + reach, p.w0 * reach, p) and inside(rest - reach, 0.0, p)


@equation
def turning_time(e: float, v: float, dt: float, p: Parameters) -> float:
    """Time within dt <= 1/w0 at which v, the derivative of e, changes sign in free motion, by bisection; dt if it does not."""
    _, _, a21, a22 = transition(dt, p)
    if v * (a21 * e + a22 * v) >= 0.0:
        return dt
    low = 0.0
    high = dt
    for _ in range(60):
        t = 0.5 * (low + high)
        _, _, a21, a22 = transition(t, p)
        if v * (a21 * e + a22 * v) > 0.0:
            low = t
        else:
            high = t
    return high


@equation
def moved(spool: float, rate: float, rest: float, t: float, p: Parameters) -> tuple[float, float]:
    """Spool and speed after t seconds of free motion."""
    a11, a12, a21, a22 = transition(t, p)
    e = spool - rest
    return rest + a11 * e + a12 * rate, a21 * e + a22 * rate


@equation
def is_inside_after(spool: float, rate: float, rest: float, t: float, p: Parameters) -> bool:
    """True where t seconds of free motion end inside the limits."""
    x, v = moved(spool, rate, rest, t, p)
    return inside(x, v, p)


@equation
def exit_time(spool: float, rate: float, rest: float, dt: float, p: Parameters) -> float:
    """Time just after the free motion first leaves the limits, or dt if it stays inside; dt <= 1/w0.

    Between the turning points of position and speed both are monotone, so it is enough to look there and at the end.
    """
    e = spool - rest
    force = -p.w0 * p.w0 * e - 2.0 * p.zeta * p.w0 * rate
    one = turning_time(e, rate, dt, p)
    two = turning_time(rate, force, dt, p)
    high = min(one, two)
    if is_inside_after(spool, rate, rest, high, p):
        high = max(one, two)
        if is_inside_after(spool, rate, rest, high, p):
            high = dt
            if is_inside_after(spool, rate, rest, high, p):
                return dt
    low = 0.0
    for _ in range(60):
        t = 0.5 * (low + high)
        if is_inside_after(spool, rate, rest, t, p):
            low = t
        else:
            high = t
    return high


@equation
def sliding_time(spool: float, rate: float, rest: float, p: Parameters) -> float:
    """How long the spool stays at the speed limit, s: until the demand asks for less, or a stop; <= 0 if it leaves at once."""
    release = rest - 2.0 * p.zeta * rate / p.w0  # where the acceleration changes sign
    goal = min(release, p.x_max) if rate > 0.0 else max(release, p.x_min)
    return (goal - spool) / rate


@equation
def settled(spool: float, rate: float, p: Parameters) -> State:
    """Clamped to the limits; a stop takes the speed into it."""
    rate = min(p.v_max, max(-p.v_max, rate))
    if spool >= p.x_max:
        return State(p.x_max, min(rate, 0.0))
    if spool <= p.x_min:
        return State(p.x_min, max(rate, 0.0))
    return State(spool, rate)


@equation
def constrained(spool: float, rate: float, rest: float, h: float, p: Parameters) -> State:
    """The motion over h with stops and speed limit, event by event, in pieces that hold one turning point at most."""
    left = h
    for _ in range(100000):
        if rate == 0.0 and ((spool >= p.x_max and rest >= p.x_max) or (spool <= p.x_min and rest <= p.x_min)):
            return State(spool, 0.0)  # pressed against a stop
        if abs(rate) >= p.v_max:
            dt = min(left, sliding_time(spool, rate, rest, p))
            if dt > 1e-9 * h:
                spool, rate = settled(spool + rate * dt, rate, p)
                left = left - dt
                if left > 0.0:
                    continue
                return State(spool, rate)
        if unlimited(spool, rate, rest, p):
            spool, rate = moved(spool, rate, rest, left, p)
            return settled(spool, rate, p)
        dt = exit_time(spool, rate, rest, min(left, 1.0 / p.w0), p)
        spool, rate = moved(spool, rate, rest, dt, p)
        spool, rate = settled(spool, rate, p)
        left = left - dt
        if not left > 0.0:
            return State(spool, rate)
    return State(spool, rate)


@equation
def start(u: Input, p: Parameters) -> State:
    """At rest, nominally at the mechanical centre, whatever the neutral (CONTRACT section 6), and between the stops."""
    return State(min(p.x_max, max(p.x_min, p.spool_0)), 0.0)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Transition matrix over the step h, s."""
    a11, a12, a21, a22 = transition(h, p)
    return Coefficients(h, a11, a12, a21, a22)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(4.16) over one step of length c.h."""
    rest = rest_position(delayed_demand(u.demand, m, p), p)
    e = x.spool - rest
    v = x.spool_rate
    spool = rest + c.a11 * e + c.a12 * v
    rate = c.a21 * e + c.a22 * v
    if p.x_min < spool < p.x_max and -p.v_max < rate < p.v_max:
        # no limit in between: the spool did not turn and energy bounds its speed, or nothing can be met at all
        slow = p.w0 * p.w0 * e * e + v * v < p.v_max * p.v_max
        if (slow and v * rate >= 0.0 and p.w0 * c.h <= 1.0) or unlimited(x.spool, v, rest, p):
            return State(spool, rate)
    return constrained(x.spool, v, rest, c.h, p)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The state itself."""
    return Output(x.spool, x.spool_rate)


BLOCK = Block(
    name="dcv",
    title="Directional control valve: command to spool position",
    module=sys.modules[__name__],
    reads={"demand": "held"},
    helpers=(expm2,),
)
