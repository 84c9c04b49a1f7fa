"""The drive once more, written after SYSTEM.md and not after `cosim.rig` or `fmus`: time stepping with friction as impulse.

Every part is advanced by the implicit midpoint rule or exactly for a held input, the parts one after the other (splitting);
dry friction is the impulse that stops the column or opposes it at its limit (Moreau 1988). All numbers are SI.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
TICK = 1e-3  # s
PATCH = 0.05  # rad: half-width of a patch of friction
SIGNALS = ("spool", "p_load", "p_supply", "angle", "far")


class Machine(NamedTuple):
    """Parameters of the drive and the forms of its flaws; the defaults are the nominal crane.

    Forms: `stop_w` > 0 a spring of that frequency for a stop; `pade` a rational delay; `plays` elements of one hysteresis;
    `round_dz`, `s_c` width of a rounded corner; `p_turb` pressure at which a leak turns turbulent; `p_air` pressure that
    halves the air's share; `supply` 0 lag, 1 two lags, 2 flow in proportion to the opening; `law` of falling friction 0
    Gauss, 1 exponential, 2 rational; `friction` 0 dry, 1 smooth over `w_v`, 2 bristles of deflection `z_s`; `triangle`
    ripple; `creep` time in which a gap closes; `lags` of the sensor.

    What no effect of the library is: `progress` the spool's travel grows by this power of the demand; `k_side` its gain
    differs between the sides; `p_relief` a relief valve holds the load pressure; `line` a second lag of the pressure, of a
    hose; `wind` torque that repeats in time with `w_wind`; `cushion` a spring beyond `theta_c` from the start; `patch`
    friction about the angle `theta_p`.
    """

    K: float = 2.375e-3
    w0: float = 25.23
    zeta: float = 0.545
    x_0: float = 0.0
    v_max: float = 1e9
    x_min: float = -2.6e-3
    x_max: float = 2.6e-3
    stop_w: float = 0.0
    tau_d: float = 0.0
    pade: int = 0
    play: float = 0.0
    plays: int = 1
    b_r: float = 0.45
    b_l: float = -0.40
    round_dz: float = 0.0
    K_c: float = 5.28e8
    T: float = 0.11
    a_q: float = 0.0
    c_l: float = 0.0
    p_turb: float = 0.0
    c_beta: float = 0.0
    p_air: float = 0.0
    r_T: float = 1.0
    k_s: float = 0.0
    tau_s: float = 0.1
    supply: int = 0
    p_c: float = 0.0
    s_c: float = 0.0
    J: float = 763.944
    b: float = 26661.6
    tau_c: float = 0.0
    tau_s_friction: float = 0.0
    omega_s: float = 0.01
    law: int = 0
    friction: int = 0
    w_v: float = 5e-4
    z_s: float = 2e-5
    tau_g: float = 0.0
    theta_g: float = 0.0
    tau_r: float = 0.0
    n_r: float = 20.0
    phi_r: float = 0.0
    triangle: int = 0
    gap: float = 0.0
    creep: float = 0.0
    mu: float = 0.0
    w_f: float = 10.0
    zeta_f: float = 0.02
    tau_l: float = 0.0
    lags: int = 1
    theta_0: float = 0.0
    progress: float = 1.0
    k_side: float = 0.0
    p_relief: float = 1e9
    line: float = 0.0
    wind: float = 0.0
    w_wind: float = 1.0
    cushion: float = 0.0
    theta_c: float = 0.3
    patch: float = 0.0
    theta_p: float = 0.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def soft(x: float, width: float) -> float:
    """max(x, 0) with a corner rounded over `width`; sharp at width 0."""
    if width <= 0.0:
        return max(x, 0.0)
    return 0.5 * (x + math.sqrt(x * x + width * width))


@njit(cache=True)  # type: ignore[untyped-decorator]
def demand(command: float, state: Array, m: Machine) -> float:
    """What the valve is asked for after compensator, hysteresis and its own dead zone; `state` holds the plays."""
    c = command + (0.45 if command > 0.0 else 0.40) * math.tanh(50.0 * command)
    if m.play > 0.0:
        total = 0.0
        for i in range(m.plays):
            # the elements' mean half-width is the play
            half = m.play * 2.0 * (i + 0.5) / m.plays
            state[i] = min(max(state[i], c - half), c + half)
            total += state[i]
        c = total / m.plays
    d = soft(c - m.b_r, m.round_dz) - soft(m.b_l - c, m.round_dz)
    d = min(max(d, -1.0), 1.0)
    if m.progress != 1.0:
        d = math.copysign(abs(d) ** m.progress, d)
    return d * (1.0 + math.copysign(m.k_side, d))


@njit(cache=True)  # type: ignore[untyped-decorator]
def spool_step(x: float, v: float, d: float, h: float, m: Machine) -> tuple[float, float]:
    """Spool and its speed after `h` (4.16): implicit midpoint, then the limits."""
    target = m.K * d + m.x_0
    stiff, damp = m.w0 * m.w0, 2.0 * m.zeta * m.w0
    force = stiff * (target - x)
    if m.stop_w > 0.0:
        over = x - m.x_max if x > m.x_max else x - m.x_min if x < m.x_min else 0.0
        if over != 0.0:
            force -= m.stop_w * m.stop_w * over + 2.0 * m.stop_w * v
    new = (v + h * (force - 0.25 * h * stiff * v - 0.5 * damp * v)) / (
        1.0 + 0.5 * h * damp + 0.25 * h * h * stiff
    )
    new = min(max(new, -m.v_max), m.v_max)
    x += 0.5 * h * (v + new)
    if m.stop_w == 0.0 and (x > m.x_max or x < m.x_min):
        return min(max(x, m.x_min), m.x_max), 0.0
    return x, new


@njit(cache=True)  # type: ignore[untyped-decorator]
def pressure_step(
    p: float, supply: float, lag: float, x: float, h: float, m: Machine
) -> tuple[float, float, float]:
    """Load pressure, supply and its second lag after `h` (4.33), each exact for what the others are at the start."""
    root = math.sqrt(max(supply, 0.0) / 170e5)
    flow = m.K_c * root * (x + m.a_q * abs(x))
    leak = m.c_l
    if m.p_turb > 0.0:
        leak *= math.sqrt(m.p_turb / (m.p_turb + abs(p)))
    air = m.c_beta
    if m.p_air > 0.0:
        air /= 1.0 + abs(p) / m.p_air
    time = m.T * (1.0 + air) / (1.0 + leak)
    settled = flow / (1.0 + leak)
    if p > settled:
        time *= m.r_T
    drawn = abs(x) * (1.0 if m.supply == 2 else root)
    low = 170e5 - m.k_s * drawn
    if m.supply == 1:
        pole = math.exp(-2.0 * h / m.tau_s)
        lag = low + (lag - low) * pole
        supply = lag + (supply - lag) * pole
    else:
        supply = low + (supply - low) * math.exp(-h / m.tau_s)
    p = settled + (p - settled) * math.exp(-h / time)
    return min(max(p, -m.p_relief), m.p_relief), supply, lag


@njit(cache=True)  # type: ignore[untyped-decorator]
def level(w: float, theta: float, m: Machine) -> float:
    """Friction torque at speed `w` and angle `theta`."""
    s = abs(w) / m.omega_s
    fall = math.exp(-s * s) if m.law == 0 else math.exp(-s) if m.law == 1 else 1.0 / (1.0 + s * s)
    more = m.patch * math.exp(-(((theta - m.theta_p) / PATCH) ** 2)) if m.patch > 0.0 else 0.0
    return m.tau_c + m.tau_s_friction * fall + more


@njit(cache=True)  # type: ignore[untyped-decorator]
def torque(p: float, theta: float, t: float, m: Machine) -> float:
    """Torque of pressure, gravity and ripple (4.27), wind and end cushion."""
    felt = p
    if m.p_c > 0.0:
        felt = soft(p - m.p_c, m.s_c * m.p_c) - soft(-p - m.p_c, m.s_c * m.p_c)
    total = felt * 8419.3e-6 * 0.1 - m.tau_g * math.sin(theta - m.theta_g)
    phase = m.n_r * theta + m.phi_r
    wave = 2.0 / math.pi * math.asin(math.sin(phase)) if m.triangle else math.sin(phase)
    if m.wind != 0.0:
        total += m.wind * math.sin(m.w_wind * t)
    turned = theta - m.theta_0
    if m.cushion > 0.0 and abs(turned) > m.theta_c:
        total -= m.cushion * (turned - math.copysign(m.theta_c, turned))
    return total + m.tau_r * wave


@njit(cache=True)  # type: ignore[untyped-decorator]
def column_step(w: float, z: float, drive: float, theta: float, h: float, m: Machine) -> tuple[float, float]:
    """Speed and bristle after `h`: implicit midpoint in the damping, friction as an impulse or by its smooth law."""
    J = m.J * (1.0 - m.mu)
    below = 1.0 + 0.5 * h * m.b / J
    free = (w * (1.0 - 0.5 * h * m.b / J) + h * drive / J) / below
    if m.tau_c + m.tau_s_friction + m.patch <= 0.0:
        return free, z
    if m.friction == 0:
        most = h * level(w, theta, m) / (J * below)
        return math.copysign(max(abs(free) - most, 0.0), free), z
    new = w
    bristle = z
    for _ in range(3):
        mid = 0.5 * (w + new)
        f = level(mid, theta, m)
        if m.friction == 1:
            resist = f * math.tanh(mid / m.w_v)
        else:
            stiff = (m.tau_c + m.tau_s_friction) / m.z_s
            bristle = (z + h * mid) / (1.0 + h * abs(mid) * stiff / f)
            # damping of the bristles, half of critical
            resist = stiff * 0.5 * (z + bristle) + 0.5 * math.sqrt(stiff * J) * (bristle - z) / h
        new = free - h * resist / (J * below)
    return new, bristle


@njit(cache=True)  # type: ignore[untyped-decorator]
def advance(u: Array, m: Machine, substeps: int) -> tuple[Array, Array, Array, Array, Array]:
    """Spool, load and supply pressure, angle read by the sensor and far side of the gap, (n,) each, at every tick."""
    n = u.size
    out = (np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    h = TICK / substeps
    plays = np.zeros(max(m.plays, 1))
    x = v = p = source = w = z = wb = d1 = d2 = 0.0
    supply = lag = 170e5
    theta = boom = far = seen = seen2 = m.theta_0
    for k in range(n):
        out[0][k], out[1][k], out[2][k], out[4][k] = x, p, supply, far
        out[3][k] = far if m.tau_l <= 0.0 else seen2 if m.lags == 2 else seen
        for i in range(substeps):
            late = k + (i + 0.5) / substeps - (0.0 if m.pade else m.tau_d / TICK)
            d = demand(u[int(late)] if late >= 0.0 else 0.0, plays, m)
            if m.pade and m.tau_d > 0.0:  # two rational lags of half the delay each, with their zeros
                r = 4.0 / m.tau_d
                pole = math.exp(-r * h)
                first = 2.0 * d1 - d
                d1 = d + (d1 - d) * pole
                d = 2.0 * d2 - first
                d2 = first + (d2 - first) * pole
            x_before = x
            x, v = spool_step(x, v, d, h, m)
            p_before = p
            source, supply, lag = pressure_step(source, supply, lag, 0.5 * (x + x_before), h, m)
            p = source if m.line <= 0.0 else source + (p - source) * math.exp(-h / m.line)
            t = k * TICK + (i + 0.5) * h
            drive = torque(0.5 * (p + p_before), theta + 0.5 * h * w, t, m)
            if m.mu > 0.0:
                inertia = m.mu * m.J
                pull = inertia * (
                    m.w_f * m.w_f * (boom + 0.5 * h * wb - theta - 0.5 * h * w)
                    + 2.0 * m.zeta_f * m.w_f * (wb - w)
                )
                drive += pull
                wb_new = wb - h * pull / inertia
                boom += 0.5 * h * (wb + wb_new)
                wb = wb_new
            w_before = w
            w, z = column_step(w, z, drive, theta, h, m)
            theta += 0.5 * h * (w + w_before)
            held = min(max(far, theta - 0.5 * m.gap), theta + 0.5 * m.gap)
            far = held if m.creep <= 0.0 else held + (far - held) * math.exp(-h / m.creep)
            if m.tau_l > 0.0:
                pole = math.exp(-h * m.lags / m.tau_l)
                seen = far + (seen - far) * pole
                seen2 = seen + (seen2 - seen) * pole
    return out


def run(u: Array, machine: Machine, substeps: int = 20) -> dict[str, Array]:
    """The true signals of SIGNALS at every millisecond for the command `u` (n,) held over each."""
    return dict(zip(SIGNALS, advance(np.ascontiguousarray(u), machine, substeps), strict=True))
