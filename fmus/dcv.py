"""Directional control valve: command to spool position, second order, with stops, speed limit and neutral.

    x'' + 2 zeta w0 x' + w0^2 x = w0^2 (K u + x_0)            (4.16)
    -r_v v_max <= x' <= v_max,   x_min <= x <= x_max          stop: position clamped, speed set to zero

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
    x_0: Annotated[float, Variable("m", "Shift of the neutral position", 0.0, -1e-2, 1e-2, display="mm", nominal=1e-4, source="Table 3.5: neutral shifted; nominal 0")]  # fmt: skip
    v_max: Annotated[float, Variable("m/s", "Largest spool speed; 1 m/s is out of reach", 1.0, 1e-5, 100.0, display="mm/s", nominal=1e-2, source="no rate limit in reach")]  # fmt: skip
    r_v: Annotated[float, Variable("1", "Largest speed towards B over that towards A", 1.0, 0.01, 100.0, source="alike in both directions")]  # fmt: skip
    x_min: Annotated[float, Variable("m", "Stop towards B", -2.6e-3, -1.0, 0.0, display="mm", nominal=1e-3, source="Table 3.6")]  # fmt: skip
    x_max: Annotated[float, Variable("m", "Stop towards A", 2.6e-3, 0.0, 1.0, display="mm", nominal=1e-3, source="Table 3.6")]  # fmt: skip
    spool_0: Annotated[float, Variable("m", "Spool position at the start", 0.0, -1.0, 1.0, display="mm", nominal=1e-3, source="starts at rest")]  # fmt: skip


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


@slot("chain")
def damping_ratio(zeta: float, e: float, m: NoMemory, p: Parameters) -> float:
    """The damping ratio at the distance e, m, from the rest position; one that changes anywhere differs from zeta at 0."""
    return zeta


@equation
def transition(t: float, zeta: float, p: Parameters) -> tuple[float, float, float, float]:
    """Transition matrix of (deviation from the rest position, speed) over t seconds, row by row."""
    return expm2(0.0, 1.0, -p.w0 * p.w0, -2.0 * zeta * p.w0, t)


@equation
def rest_position(demand: float, p: Parameters) -> float:
    """Where the spool comes to rest, m, were there no stops."""
    return p.K * demand + p.x_0


@equation
def fastest(rate: float, p: Parameters) -> float:
    """The largest speed in the direction of this one, m/s, both as magnitudes."""
    if rate < 0.0:
        return p.v_max * p.r_v
    return p.v_max


@equation
def slow_both_ways(e: float, v: float, p: Parameters) -> bool:
    """True where the energy of a free motion from here bounds its speed below the limits of both directions."""
    least = p.v_max * min(1.0, p.r_v)
    return p.w0 * p.w0 * e * e + v * v < least * least


@equation
def inside(spool: float, rate: float, p: Parameters) -> bool:
    """True where neither a stop nor the speed limit is exceeded by more than rounding."""
    grace = 1e-12 * (p.x_max - p.x_min)
    fast = p.v_max * (1.0 + 1e-12)
    return p.x_min - grace <= spool <= p.x_max + grace and -fast * p.r_v <= rate <= fast


@equation
def unlimited(spool: float, rate: float, rest: float, p: Parameters) -> bool:
    """True if the free motion from here never meets a limit: its energy only falls, which bounds deviation and speed."""
    e = spool - rest
    reach = math.sqrt(e * e + rate * rate / (p.w0 * p.w0))
    return inside(rest + reach, p.w0 * reach, p) and inside(rest - reach, -p.w0 * reach, p)


@equation
def turning_time(e: float, v: float, dt: float, zeta: float, p: Parameters) -> float:
    """Time within dt <= 1/w0 at which v, the derivative of e, changes sign in free motion, by bisection; dt if it does not."""
    _, _, a21, a22 = transition(dt, zeta, p)
    if v * (a21 * e + a22 * v) >= 0.0:
        return dt
    low = 0.0
    high = dt
    for _ in range(60):
        t = 0.5 * (low + high)
        _, _, a21, a22 = transition(t, zeta, p)
        if v * (a21 * e + a22 * v) > 0.0:
            low = t
        else:
            high = t
    return high


@equation
def moved(
    spool: float, rate: float, rest: float, t: float, zeta: float, p: Parameters
) -> tuple[float, float]:
    """Spool and speed after t seconds of free motion."""
    a11, a12, a21, a22 = transition(t, zeta, p)
    e = spool - rest
    return rest + a11 * e + a12 * rate, a21 * e + a22 * rate


@equation
def is_inside_after(spool: float, rate: float, rest: float, t: float, zeta: float, p: Parameters) -> bool:
    """True where t seconds of free motion end inside the limits."""
    x, v = moved(spool, rate, rest, t, zeta, p)
    return inside(x, v, p)


@equation
def exit_time(spool: float, rate: float, rest: float, dt: float, zeta: float, p: Parameters) -> float:
    """Time just after the free motion first leaves the limits, or dt if it stays inside; dt <= 1/w0.

    Between the turning points of position and speed both are monotone, so it is enough to look there and at the end.
    """
    e = spool - rest
    force = -p.w0 * p.w0 * e - 2.0 * zeta * p.w0 * rate
    one = turning_time(e, rate, dt, zeta, p)
    two = turning_time(rate, force, dt, zeta, p)
    high = min(one, two)
    if is_inside_after(spool, rate, rest, high, zeta, p):
        high = max(one, two)
        if is_inside_after(spool, rate, rest, high, zeta, p):
            high = dt
            if is_inside_after(spool, rate, rest, high, zeta, p):
                return dt
    low = 0.0
    for _ in range(60):
        t = 0.5 * (low + high)
        if is_inside_after(spool, rate, rest, t, zeta, p):
            low = t
        else:
            high = t
    return high


@equation
def sliding_time(spool: float, rate: float, rest: float, zeta: float, p: Parameters) -> float:
    """How long the spool stays at the speed limit, s: until the demand asks for less, or a stop; <= 0 if it leaves at once."""
    release = rest - 2.0 * zeta * rate / p.w0  # where the acceleration changes sign
    goal = min(release, p.x_max) if rate > 0.0 else max(release, p.x_min)
    return (goal - spool) / rate


@equation
def settled(spool: float, rate: float, p: Parameters) -> State:
    """Clamped to the limits; a stop takes the speed into it."""
    rate = min(p.v_max, max(-p.v_max * p.r_v, rate))
    if spool >= p.x_max:
        return State(p.x_max, min(rate, 0.0))
    if spool <= p.x_min:
        return State(p.x_min, max(rate, 0.0))
    return State(spool, rate)


@equation
def constrained(spool: float, rate: float, rest: float, h: float, zeta: float, p: Parameters) -> State:
    """The motion over h with stops and speed limit, event by event, in pieces that hold one turning point at most."""
    left = h
    for _ in range(100000):
        if rate == 0.0 and ((spool >= p.x_max and rest >= p.x_max) or (spool <= p.x_min and rest <= p.x_min)):
            return State(spool, 0.0)  # pressed against a stop
        if abs(rate) >= fastest(rate, p):
            dt = min(left, sliding_time(spool, rate, rest, zeta, p))
            if dt > 1e-9 * h:
                spool, rate = settled(spool + rate * dt, rate, p)
                left = left - dt
                if left > 0.0:
                    continue
                return State(spool, rate)
        if unlimited(spool, rate, rest, p):
            spool, rate = moved(spool, rate, rest, left, zeta, p)
            return settled(spool, rate, p)
        dt = exit_time(spool, rate, rest, min(left, 1.0 / p.w0), zeta, p)
        spool, rate = moved(spool, rate, rest, dt, zeta, p)
        spool, rate = settled(spool, rate, p)
        left = left - dt
        if not left > 0.0:
            return State(spool, rate)
    return State(spool, rate)


@equation
def start(u: Input, p: Parameters) -> State:
    """At rest, nominally at the mechanical centre, whatever the neutral, and between the stops."""
    return State(min(p.x_max, max(p.x_min, p.spool_0)), 0.0)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Transition matrix over the step h, s."""
    a11, a12, a21, a22 = transition(h, p.zeta, p)
    return Coefficients(h, a11, a12, a21, a22)


@equation
def pull(e: float, v: float, m: NoMemory, p: Parameters) -> float:
    """Acceleration, m/s2, at the distance e from the rest position and the speed v."""
    return -p.w0 * p.w0 * e - 2.0 * damping_ratio(p.zeta, e, m, p) * p.w0 * v


@equation
def met_nothing(spool: float, rate: float, e: float, v: float, dt: float, p: Parameters) -> bool:
    """True if motion over dt from (e, v) to (spool, rate) met no limit: it did not turn, and energy bounds its speed."""
    within = p.x_min < spool < p.x_max and abs(rate) < fastest(rate, p)
    return within and slow_both_ways(e, v, p) and v * rate >= 0.0 and p.w0 * dt <= 1.0


@equation
def runge_kutta(e: float, v: float, h: float, m: NoMemory, p: Parameters) -> tuple[float, float]:
    """Distance from the rest position and speed after h, by the classical scheme (order 4)."""
    a1 = pull(e, v, m, p)
    v2 = v + 0.5 * h * a1
    a2 = pull(e + 0.5 * h * v, v2, m, p)
    v3 = v + 0.5 * h * a2
    a3 = pull(e + 0.5 * h * v2, v3, m, p)
    v4 = v + h * a3
    a4 = pull(e + h * v3, v4, m, p)
    return e + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


@equation
def varied(
    spool: float, rate: float, rest: float, h: float, most: float, m: NoMemory, p: Parameters
) -> State:
    """The motion over h where the damping ratio, at most `most`, changes on the way.

    By Runge-Kutta in pieces that are short beside the valve's fastest rate. Where that would take many, and near a limit,
    the motion of a piece is exact with the damping ratio of its middle (order 2).
    """
    n = int(min(h * p.w0 * (1.0 + 2.0 * most) / 0.4, 1e6)) + 1
    few = n <= 10
    if not few:
        n = int(min(h * p.w0 / 0.05, 200.0)) + 1
    dt = h / n
    still = 1e-9 * (p.x_max - p.x_min) * p.w0
    for i in range(n):
        e = spool - rest
        if few:
            new, fast = runge_kutta(e, rate, dt, m, p)
            if met_nothing(rest + new, fast, e, rate, dt, p) or unlimited(spool, rate, rest, p):
                spool, rate = settled(rest + new, fast, p)
                continue
        elif p.w0 * abs(e) + abs(rate) < still:
            return constrained(spool, rate, rest, (n - i) * dt, most, p)
        halfway = max(min(0.5 * dt * rate, abs(e)), -abs(e))
        spool, rate = constrained(spool, rate, rest, dt, damping_ratio(p.zeta, e + halfway, m, p), p)
    return State(spool, rate)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(4.16) over one step of length c.h."""
    rest = rest_position(delayed_demand(u.demand, m, p), p)
    e = x.spool - rest
    v = x.spool_rate
    most = damping_ratio(p.zeta, 0.0, m, p)
    if most != p.zeta:
        return varied(x.spool, v, rest, c.h, most, m, p)
    spool = rest + c.a11 * e + c.a12 * v
    rate = c.a21 * e + c.a22 * v
    if p.x_min < spool < p.x_max and abs(rate) < fastest(rate, p):
        # no limit in between: the spool did not turn and energy bounds its speed, or nothing can be met at all
        slow = slow_both_ways(e, v, p)
        if (slow and v * rate >= 0.0 and p.w0 * c.h <= 1.0) or unlimited(x.spool, v, rest, p):
            return State(spool, rate)
    return constrained(x.spool, v, rest, c.h, p.zeta, p)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The state itself."""
    return Output(x.spool, x.spool_rate)


# In model exchange. The motion is 0.0: free; 1.0 or -1.0: pressed against the stop of this side; 2.0 or -2.0: at the largest
# speed in this direction. It changes at events only. 1e-15 m, 1e-12 m/s and 1e-9 m/s2 are below anything that matters: by
# so much an indicator is away from zero where a motion begins, since a host looks for its next change of sign.


@equation
def motion_from(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> float:
    """The motion that begins in this state."""
    rest = rest_position(delayed_demand(u.demand, m, p), p)
    if x.spool_rate == 0.0 and x.spool >= p.x_max and rest > p.x_max + 1e-15:
        return 1.0
    if x.spool_rate == 0.0 and x.spool <= p.x_min and rest < p.x_min - 1e-15:
        return -1.0
    side = math.copysign(1.0, x.spool_rate)
    if (
        abs(x.spool_rate) >= fastest(x.spool_rate, p)
        and pull(x.spool - rest, x.spool_rate, m, p) * side > 1e-9
    ):
        return 2.0 * side
    return 0.0


@equation
def after_event(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients, motion: float) -> State:
    """The state after an event: at the largest speed, or at a stop, which took the speed into it."""
    return settled(x.spool, x.spool_rate, p)


@equation
def indicators(
    x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients, motion: float
) -> tuple[float, float, float]:
    """Numbers that an event makes negative: way and speed left until a limit, or what still holds the spool at it."""
    rest = rest_position(delayed_demand(u.demand, m, p), p)
    if motion == 1.0:
        return rest - p.x_max, 1.0, 1.0
    if motion == -1.0:
        return p.x_min - rest, 1.0, 1.0
    left = fastest(x.spool_rate, p) - abs(x.spool_rate) + 1e-12
    if motion != 0.0:
        left = pull(x.spool - rest, x.spool_rate, m, p) * motion
    return p.x_max - x.spool + 1e-15, x.spool - p.x_min + 1e-15, left


@equation
def step_without_event(
    x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients, motion: float
) -> State:
    """(4.16) over a step of length c.h in which the motion stays as it is; of a damping that varies, as it begins."""
    if motion == 1.0 or motion == -1.0:
        return State(x.spool, 0.0)
    if motion != 0.0:
        return State(x.spool + c.h * x.spool_rate, x.spool_rate)
    rest = rest_position(delayed_demand(u.demand, m, p), p)
    e = x.spool - rest
    spool, rate = moved(x.spool, x.spool_rate, rest, c.h, damping_ratio(p.zeta, e, m, p), p)
    return State(spool, rate)


BLOCK = Block(
    name="dcv",
    title="Directional control valve: command to spool position",
    module=sys.modules[__name__],
    reads={"demand": "held"},
    helpers=(expm2,),
)
