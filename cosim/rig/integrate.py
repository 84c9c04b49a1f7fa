"""Marches the drive through the log: substeps of every millisecond, with friction's events located inside them."""

import math
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.interrupts import uninterrupted
from cosim.rig.equations import (
    BRISTLE,
    FREE,
    SMOOTH,
    SMOOTH_SPEED,
    STUCK,
    Moment,
    State,
    clip,
    free_torque,
    friction_level,
    play,
    runge_kutta,
)
from cosim.rig.jit import cached, compiled
from cosim.rig.parameters import STEP, Plant

SUBSTEPS = 20  # a millisecond; tests/rig/test_rig_convergence.py measures what is left
BRISTLE_TRAVEL = 2e-5  # rad, bristle deflection at breakaway: a fifth of the sensor's noise
COLUMNS = ("spool", "p_load", "p_supply", "theta", "omega", "seen", "sensed", "boom", "p_sum")


@compiled
def _stopped(s: State, p: Plant) -> State:
    """The state with the hard stops of spool and column (position clamped, speed zero) and the spool's greatest speed."""
    x, v = s.x, clip(s.v, -p.dcv.r_v * p.dcv.v_max, p.dcv.v_max)
    if x > p.dcv.x_max:
        x, v = p.dcv.x_max, min(v, 0.0)
    elif x < p.dcv.x_min:
        x, v = p.dcv.x_min, max(v, 0.0)
    theta, omega = s.theta, s.omega
    if theta > p.mechanical.theta_max:
        theta, omega = p.mechanical.theta_max, min(omega, 0.0)
    elif theta < p.mechanical.theta_min:
        theta, omega = p.mechanical.theta_min, max(omega, 0.0)
    return State(x, v, s.p_load, s.p_supply, theta, omega, s.boom, s.boom_omega, s.bristle, s.sensed, s.p_sum)


@compiled
def _halted(s: State) -> State:
    """The state with the column at rest."""
    return State(
        s.x, s.v, s.p_load, s.p_supply, s.theta, 0.0, s.boom, s.boom_omega, s.bristle, s.sensed, s.p_sum
    )


@compiled
def _excess(s: State, t: float, p: Plant) -> float:
    """Torque [N.m] beyond what friction holds at standstill; negative or zero: the column sticks."""
    return abs(free_torque(s, t, p)) - friction_level(0.0, s.p_load, p)


@compiled
def _direction(s: State, t: float, breaking: bool, p: Plant) -> int:
    """STUCK, or the direction in which the column slides; `breaking` says that a breakaway has been located here."""
    if s.omega != 0.0:
        return 1 if s.omega > 0.0 else -1
    if not breaking and _excess(s, t, p) <= 0.0:
        return STUCK
    return 1 if free_torque(s, t, p) > 0.0 else -1


@compiled
def _rub(s: State, t: float, h: float, held: Moment, p: Plant) -> State:
    """A substep of `h` seconds with sharp friction: stops and breakaways are located by a secant and stepped to."""
    breaking = False
    for _ in range(8):
        slide = _direction(s, t, breaking, p)
        now = Moment(held.demand, held.seen, slide, 0.0, 0.0)
        new = runge_kutta(s, t, h, now, p)
        if slide == STUCK:
            start, end = _excess(s, t, p), _excess(new, t + h, p)
            if end <= 0.0:
                return new
            part = h * start / (start - end)
            breaking = True
        else:
            if new.omega * slide > 0.0:
                return new
            part = h * s.omega / (s.omega - new.omega) if s.omega != 0.0 else h
            breaking = False
        s = runge_kutta(s, t, part, now, p)
        if slide != STUCK:
            s = _halted(s)
        t, h = t + part, h - part
        if h <= 1e-15:
            return s
    return runge_kutta(_halted(s), t, h, Moment(held.demand, held.seen, STUCK, 0.0, 0.0), p)


@compiled
def _step(s: State, t: float, h: float, held: Moment, p: Plant) -> State:
    """A substep of `h` seconds without regard to the spool's stops."""
    if held.slide == FREE or held.slide == BRISTLE or held.slide == SMOOTH:
        return runge_kutta(s, t, h, held, p)
    return _rub(s, t, h, held, p)


@compiled
def _time_to_stop(s: State, t: float, h: float, held: Moment, p: Plant) -> float:
    """Seconds, at most `h`, until the spool meets a stop that it has passed after `h`: regula falsi (Illinois)."""
    new = runge_kutta(s, t, h, held, p)
    stop = p.dcv.x_max if new.x > p.dcv.x_max else p.dcv.x_min
    low, high, below, above = 0.0, h, s.x - stop, new.x - stop
    middle = h
    for _ in range(5):
        middle = low + (high - low) * below / (below - above)
        beyond = runge_kutta(s, t, middle, held, p).x - stop
        if beyond * above > 0.0:
            high, above, below = middle, beyond, 0.5 * below
        else:
            low, below, above = middle, beyond, 0.5 * above
    return middle


@compiled
def _span(s: State, t: float, length: float, count: int, held: Moment, p: Plant) -> tuple[State, float]:
    """`count` substeps over `length` seconds at one demand; returns the state and the seen angle [rad]."""
    seen, half, low, high = held.seen, 0.5 * p.mechanical.gap, p.dcv.x_min, p.dcv.x_max
    for i in range(count):
        now, left = t + i * (length / count), length / count
        hits = 0
        while left > 1e-15:
            moment = Moment(held.demand, seen, held.slide, held.sigma0, held.sigma1)
            new = _step(s, now, left, moment, p)
            part = left
            if hits < 3 and (new.x > high > s.x or new.x < low < s.x):
                part = _time_to_stop(s, now, left, moment, p)
                end = _step(s, now, part, moment, p)
                stop = high if new.x > high else low
                new = State(stop, 0.0, *end[2:])
                hits += 1
            s = _stopped(new, p)
            seen = play(s.theta, seen, half)
            now, left = now + part, left - part
    return s, seen


@compiled
def _demand(u: float, dragged: float, p: Plant) -> tuple[float, float]:
    """What reaches the spool loop [1] for one command, and the play's own value [1] before and after it."""
    c, z = p.compensator, p.dead_zone
    jump = c.d_plus if u > 0.0 else c.d_minus
    dragged = play(u + jump * math.tanh(c.S * u), dragged, p.dcv.play)
    if dragged >= z.b_r:
        value = z.m_r * (dragged - z.b_r)
    elif dragged <= z.b_l:
        value = z.m_l * (dragged - z.b_l)
    else:
        value = 0.0
    return clip(value, -z.limit, z.limit), dragged


@compiled
def valve_demand(u: NDArray[np.float64], p: Plant) -> NDArray[np.float64]:
    """What reaches the spool loop [1]: compensator (4.9), play, dead zone (2.2), limit; `u` (n,) is held each ms."""
    out = np.empty(u.size)
    dragged = 0.0
    for k in range(u.size):
        out[k], dragged = _demand(u[k], dragged, p)
    return out


@compiled
def _lag(p: Plant) -> tuple[int, float]:
    """The delay between demand and spool loop: whole milliseconds, and the rest as a share of one."""
    late = round(p.dcv.tau_d / STEP * 1e9) / 1e9  # whole milliseconds stay whole
    whole = int(late)
    return whole, late - whole


@compiled
def _millisecond(s: State, start: float, older: float, newer: float, part: float, substeps: int, held: Moment,
                 p: Plant) -> tuple[State, float]:  # fmt: skip
    """A millisecond from `start` [s], in which the demand `older` holds for the share `part`, then `newer`."""
    seen = held.seen
    for piece in range(2):
        share = part if piece == 0 else 1.0 - part
        if share == 0.0:
            continue
        value = older if piece == 0 else newer
        now = start + (0.0 if piece == 0 else part * STEP)
        count = max(1, math.ceil(substeps * share - 1e-9))
        moment = Moment(value, seen, held.slide, held.sigma0, held.sigma1)
        s, seen = _span(s, now, share * STEP, count, moment, p)
    return s, seen


@compiled
def _at_rest(p: Plant) -> State:
    """The state at the start of the log: everything at rest, the boom above the column, the lag settled."""
    theta = clip(p.mechanical.theta_0, p.mechanical.theta_min, p.mechanical.theta_max)
    # both chambers stand at half the supply
    total = p.continuity.p_s + p.continuity.p_t
    return State(0.0, 0.0, 0.0, p.continuity.p_s, theta, 0.0, theta, 0.0, 0.0, theta, total)


def _source_digest() -> int:
    """A number that changes with the sources of the compiled march."""
    folder = Path(__file__).parent
    return zlib.crc32(
        b"".join((folder / f"{name}.py").read_bytes() for name in ("parameters", "equations", "integrate"))
    )


def _compile_march(digest: int) -> Callable[..., NDArray[np.float64]]:
    """The compiled march, cached on disk; `digest` is part of its cache key, so that no stale code is ever loaded."""

    @cached
    def march(u: NDArray[np.float64], substeps: int, slide: int, sigma0: float, sigma1: float,
              p: Plant) -> NDArray[np.float64]:  # fmt: skip
        demand = valve_demand(u, p)
        rows = np.empty((u.size, 9))
        whole, part = _lag(p) if digest >= 0 else (0, 0.0)
        s = _at_rest(p)
        seen = s.theta
        for k in range(u.size):
            rows[k, :5] = s.x, s.p_load, s.p_supply, s.theta, s.omega
            rows[k, 5:] = seen, s.sensed, s.boom, s.p_sum
            older = demand[k - whole - 1] if k - whole - 1 >= 0 else 0.0
            newer = demand[k - whole] if k - whole >= 0 else 0.0
            held = Moment(0.0, seen, slide, sigma0, sigma1)
            s, seen = _millisecond(s, k * STEP, older, newer, part, substeps, held, p)
        return rows

    return march


_march = _compile_march(_source_digest())


def _of_chambers(p: Plant) -> float:
    """An upper bound [1/s] of the rates of two chambers and the column between them; 0 in the identified form."""
    m, c = p.mechanical, p.continuity
    if c.physical == 0.0:
        return 0.0
    stiff = 2.0 * c.beta / (1.0 + c.c_beta) / (c.V_L + 0.5 * min(c.V_A, c.V_B))
    # the orifices at a hundredth of the supply: nearer to it a chamber is not driven
    widest = c.C_d * c.w * max(p.dcv.x_max, -p.dcv.x_min) * math.sqrt(50.0 / (c.rho * c.p_s))
    leak = stiff * (c.C_L * (1.0 + c.c_l) + max(c.C_A, c.C_B) + widest)
    return max(leak, math.sqrt(stiff / (1.0 - m.mu) / m.J) * m.A * m.r)


def _fastest_rate(p: Plant, friction: str) -> float:
    """An upper bound [1/s] of the drive's rates, to refuse what explicit steps cannot follow."""
    m, c = p.mechanical, p.continuity
    column = (1.0 - m.mu) * m.J * (1.0 - abs(p.unknown.j_theta))
    found = [
        p.dcv.w0 * (1.0 + 2.0 * p.dcv.zeta * (1.0 + p.dcv.c_a)),
        (1.0 + c.c_l) / (c.T * (1.0 + c.c_beta) * min(1.0, c.r_T)),
        1.0 / c.tau_s,
        _of_chambers(p),
        (m.b + 2.0 * m.mu * m.J * m.zeta_f * m.w_f) / column + 2.0 * m.zeta_f * m.w_f,
        m.w_f * math.sqrt(1.0 + m.mu * m.J / column) if m.mu else 0.0,
        1.0 / p.sensor.tau_l if p.sensor.tau_l else 0.0,
    ]
    if friction == "smooth":
        found.append((m.tau_c + m.tau_s) / SMOOTH_SPEED / column)
    if friction == "lugre":  # at the greatest speed of the rack, 5.7 mm/s (4.32)
        found.append(5.7e-3 / m.r / BRISTLE_TRAVEL * (1.0 + m.tau_s / m.tau_c))
    return max(found)


def friction_form(plant: Plant, friction: str, substeps: int) -> tuple[int, float, float]:
    """What the dry friction does at the start, and the stiffness [N.m/rad] and damping [N.m.s/rad] of its bristles.

    Raises:
        UsageError: the crane is too fast for the substeps, or the bristle friction has no Coulomb level.
    """
    m = plant.mechanical
    dry = m.tau_c > 0.0 or m.tau_s > 0.0 or plant.unknown.kappa > 0.0
    if friction == "lugre" and dry and m.tau_c <= 0.0:
        raise UsageError(
            "the LuGre friction needs mechanical.tau_c > 0: its bristles have no level to reach otherwise"
        )
    rate = _fastest_rate(plant, friction if dry else "")
    if rate * STEP / substeps > 1.0:
        raise UsageError(
            f"these parameters make the crane too fast ({rate:.3g} 1/s) for {substeps} substeps a millisecond: "
            f"use at least {math.ceil(rate * STEP)} substeps, or a heavier or less damped crane"
        )
    slide, sigma0, sigma1 = FREE, 0.0, 0.0
    if dry and friction == "smooth":
        slide = SMOOTH
    elif dry and friction == "lugre":
        slide = BRISTLE
        sigma0 = (m.tau_c + m.tau_s) / BRISTLE_TRAVEL
        sigma1 = math.sqrt(sigma0 * m.J)
    elif dry:
        slide = STUCK
    return slide, sigma0, sigma1


def simulate(
    u: NDArray[np.float64], plant: Plant, *, friction: str = "sharp", substeps: int = SUBSTEPS
) -> dict[str, NDArray[np.float64]]:
    """The drive's true signals (SI) at every millisecond, for a command `u` (n,) [1] held over each.

    `friction` is the form that dry friction takes: ``sharp``, ``lugre`` or ``smooth``.

    Returns:
        COLUMNS -> (n,) arrays; row 0 is the state at rest, row k the state at k ms. `seen` [rad] is the angle behind the
        backlash, `sensed` [rad] the same through the sensor's lag (only where tau_l > 0).

    Raises:
        UsageError: the crane is too fast for the substeps, or the bristle friction has no Coulomb level.
    """
    slide, sigma0, sigma1 = friction_form(plant, friction, substeps)
    # a log's signals are read only, for which the march would be compiled anew
    own = np.require(u, np.float64, ["C", "W"])
    with uninterrupted():
        rows = _march(own, substeps, slide, sigma0, sigma1, plant)
    return {name: np.ascontiguousarray(rows[:, i]) for i, name in enumerate(COLUMNS)}
