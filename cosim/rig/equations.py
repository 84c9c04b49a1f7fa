"""The continuous equations of the whole drive, as one system, written for the rig alone.

    x'     = v,   v' = w0^2 (K d + x_0 - x) - 2 zeta w0 v                      (4.16, 5.3)
    T PL'  = K_c x - PL                                                        (4.33, 5.4)
    or, in the physical system, with PL = PA - PB, V the volume of line and chamber:
    V PA'  = beta (Q_A - A r w - C_L PL - C_A (PA - PT))                       (4.17), (4.19)
    V PB'  = beta (Q_B + A r w + C_L PL - C_B (PB - PT))                       (4.18), (4.20), signs: SYSTEM 9.5
    J w'   = PL A r - b w - tau_f - tau_load,   theta' = w                     (4.27)

with every flaw of docs/design.md in its place. All numbers are SI. The functions are compiled by numba; `slide` tells
what the friction does: STUCK, sliding in the direction +1 or -1, FREE (no friction), BRISTLE (LuGre) or SMOOTH. They are
compiled into the march of `cosim.rig.integrate`, which alone is cached on disk: numba's cache would not notice a
change in another file.
"""

import math
from typing import NamedTuple

from cosim.rig.jit import compiled
from cosim.rig.parameters import Plant

STUCK, FREE, BRISTLE, SMOOTH = 0, 2, 3, 4
SMOOTH_SPEED = 5e-4  # rad/s, speed over which smooth friction builds up: a fifth of the slowest motion that is measured well


class State(NamedTuple):
    """Continuous state (SI): spool and its speed, load and supply pressure, column, boom, bristle, sensor, PA + PB."""

    x: float
    v: float
    p_load: float
    p_supply: float
    theta: float
    omega: float
    boom: float
    boom_omega: float
    bristle: float
    sensed: float
    p_sum: float


class Moment(NamedTuple):
    """What is held over a substep: demand [1], seen angle at its start [rad], friction, bristle stiffness and damping."""

    demand: float
    seen: float
    slide: int
    sigma0: float
    sigma1: float


@compiled
def clip(value: float, low: float, high: float) -> float:
    """`value` kept within [low, high]."""
    return min(max(value, low), high)


@compiled
def play(value: float, last: float, half: float) -> float:
    """Play operator: the output stays at `last` until `value` is `half` away, then is dragged along."""
    return min(max(last, value - half), value + half)


@compiled
def valve_rates(s: State, t: float, demand: float, p: Plant) -> tuple[float, float]:
    """Spool speed [m/s] and acceleration [m/s2] at demand [1]; the speed state is limited to -r_v v_max..v_max."""
    q, k = p.dcv, p.dcv.K
    if p.unknown.g_warm != 0.0:
        k *= 1.0 + p.unknown.g_warm * (1.0 - math.exp(-t / p.unknown.tau_warm))
    error = k * demand + q.x_0 - s.x
    zeta = q.zeta
    if q.c_a != 0.0:
        zeta *= 1.0 + q.c_a * math.exp(-((error / (q.u_a * k)) ** 2))
    v = clip(s.v, -q.r_v * q.v_max, q.v_max)
    return v, q.w0 * q.w0 * error - 2.0 * zeta * q.w0 * v


@compiled
def through(opening: float, dp: float, p: Plant) -> float:
    """Flow [m3/s] through an orifice `opening` [m] wide, of the sign of its pressure drop dp [Pa]."""
    q = p.continuity
    return math.copysign(q.C_d * q.w * opening * math.sqrt(2.0 / q.rho * abs(dp)), dp)


@compiled
def chamber_rates(s: State, p: Plant) -> tuple[float, float, float]:
    """Rates [Pa/s] of load and supply pressure, and of the sum of both chambers': (4.17)-(4.20)."""
    q, m = p.continuity, p.mechanical
    x = clip(s.x, p.dcv.x_min, p.dcv.x_max)
    width = abs(x) * (1.0 + q.a_q if x > 0.0 else 1.0 - q.a_q)
    pa, pb = 0.5 * (s.p_sum + s.p_load), 0.5 * (s.p_sum - s.p_load)
    if x > 0.0:
        into_a, into_b = through(width, s.p_supply - pa, p), through(width, q.p_t - pb, p)
        drawn = into_a
    else:
        into_a, into_b = through(width, q.p_t - pa, p), through(width, s.p_supply - pb, p)
        drawn = into_b
    moved = m.A * m.r * (s.theta - m.theta_0)
    swept = m.A * m.r * s.omega + q.C_L * (1.0 + q.c_l) * s.p_load
    stiff = q.beta / (1.0 + q.c_beta)
    rate_a = stiff / (q.V_L + max(q.V_A + moved, 0.0)) * (into_a - swept - q.C_A * (pa - q.p_t))
    rate_b = stiff / (q.V_L + max(q.V_B - moved, 0.0)) * (into_b + swept - q.C_B * (pb - q.p_t))
    return rate_a - rate_b, (q.p_s - q.R_s * drawn - s.p_supply) / q.tau_p, rate_a + rate_b


@compiled
def pressure_rates(s: State, p: Plant) -> tuple[float, float, float]:
    """Rates [Pa/s] of load and supply pressure, and of the sum of both chambers'."""
    q = p.continuity
    if q.physical != 0.0:
        return chamber_rates(s, p)
    x = clip(s.x, p.dcv.x_min, p.dcv.x_max)
    root = math.sqrt(max(s.p_supply, 0.0) / q.p_s)
    opening = x * root * (1.0 + q.a_q if x > 0.0 else 1.0 - q.a_q)
    if q.c_q != 0.0:  # (4.22) in its standard form, SYSTEM 9.5
        opening *= math.sqrt(max(1.0 - q.c_q * math.copysign(s.p_load, x * s.p_load), 0.0))
    leak = 1.0 + q.c_l
    load = (q.K_c / leak * opening - s.p_load) * leak / (q.T * (1.0 + q.c_beta))
    if load < 0.0:
        load /= q.r_T
    supply = (q.p_s - q.k_s * abs(x) * root - s.p_supply) / q.tau_s
    return load, supply, supply


@compiled
def friction_level(omega: float, p_load: float, p: Plant) -> float:
    """Friction torque [N.m] at speed `omega`: tau_c + tau_s exp(-(omega/omega_s)^2), and the unknown pressure part."""
    m = p.mechanical
    level = m.tau_c
    if m.tau_s != 0.0:
        level += m.tau_s * math.exp(-((omega / m.omega_s) ** 2))
    return level + p.unknown.kappa * abs(p_load) * m.A * m.r


@compiled
def spring_torque(s: State, p: Plant) -> float:
    """Torque [N.m] of the boom on the column; boom inertia mu J, frequency w_f with the column locked."""
    m = p.mechanical
    inertia = m.mu * m.J
    return inertia * m.w_f * (m.w_f * (s.boom - s.theta) + 2.0 * m.zeta_f * (s.boom_omega - s.omega))


@compiled
def free_torque(s: State, t: float, p: Plant) -> float:
    """Torque [N.m] on the column from everything but dry friction."""
    m, q = p.mechanical, p.unknown
    felt = s.p_load - clip(s.p_load, -p.continuity.p_c, p.continuity.p_c)
    viscous = m.b * (1.0 + m.a_b if s.omega > 0.0 else 1.0 - m.a_b)
    torque = felt * m.A * m.r - viscous * s.omega - m.tau_load
    if m.tau_g != 0.0:
        torque -= m.tau_g * math.sin(s.theta - m.theta_g)
    if m.tau_r != 0.0:
        torque += m.tau_r * math.sin(m.n_r * s.theta + m.phi_r)
    if m.mu != 0.0:
        torque += spring_torque(s, p)
    if q.q_drag != 0.0:
        torque -= q.q_drag * s.omega * abs(s.omega)
    if q.tau_burst != 0.0 and 0.0 < t - q.t_burst < q.d_burst:
        age = t - q.t_burst
        window = math.sin(math.pi * age / q.d_burst) ** 2
        torque += q.tau_burst * window * math.cos(q.w_burst * (age - 0.5 * q.d_burst))
    return torque


@compiled
def column_rate(s: State, torque: float, p: Plant) -> float:
    """Acceleration [rad/s2] of the column; with inertia over angle, d/dt of J(theta) w^2/2 is kept (Lagrange)."""
    m, q = p.mechanical, p.unknown
    inertia = (1.0 - m.mu) * m.J
    if q.j_theta != 0.0:
        slope = inertia * q.j_theta * q.n_theta * math.cos(q.n_theta * s.theta)
        inertia *= 1.0 + q.j_theta * math.sin(q.n_theta * s.theta)
        torque -= 0.5 * slope * s.omega * s.omega
    return torque / inertia


@compiled
def friction_torque(s: State, held: Moment, p: Plant) -> tuple[float, float]:
    """Dry friction [N.m] against motion, and the bristle's rate [rad/s] in the LuGre form."""
    if held.slide == FREE:
        return 0.0, 0.0
    level = friction_level(s.omega, s.p_load, p)
    if held.slide == SMOOTH:
        return level * math.tanh(s.omega / SMOOTH_SPEED), 0.0
    if held.slide != BRISTLE:
        return held.slide * level, 0.0
    rate = s.omega - abs(s.omega) * held.sigma0 * s.bristle / level
    return held.sigma0 * s.bristle + held.sigma1 * rate, rate


@compiled
def rates(s: State, t: float, held: Moment, p: Plant) -> State:
    """Time derivative of the whole state at time `t` [s]."""
    v, a = valve_rates(s, t, held.demand, p)
    load, supply, total = pressure_rates(s, p)
    omega, alpha, bristle = 0.0, 0.0, 0.0
    if held.slide != STUCK:
        friction, bristle = friction_torque(s, held, p)
        omega, alpha = s.omega, column_rate(s, free_torque(s, t, p) - friction, p)
    boom_omega, boom_alpha = 0.0, 0.0
    if p.mechanical.mu != 0.0:
        boom_omega, boom_alpha = s.boom_omega, -spring_torque(s, p) / (p.mechanical.mu * p.mechanical.J)
    sensed = 0.0
    if p.sensor.tau_l != 0.0:
        seen = play(s.theta, held.seen, 0.5 * p.mechanical.gap)
        sensed = (seen - s.sensed) / p.sensor.tau_l
    return State(v, a, load, supply, omega, alpha, boom_omega, boom_alpha, bristle, sensed, total)


@compiled
def moved(s: State, h: float, d: State) -> State:
    """``s + h d``."""
    return State(
        s.x + h * d.x,
        s.v + h * d.v,
        s.p_load + h * d.p_load,
        s.p_supply + h * d.p_supply,
        s.theta + h * d.theta,
        s.omega + h * d.omega,
        s.boom + h * d.boom,
        s.boom_omega + h * d.boom_omega,
        s.bristle + h * d.bristle,
        s.sensed + h * d.sensed,
        s.p_sum + h * d.p_sum,
    )


@compiled
def runge_kutta(s: State, t: float, h: float, held: Moment, p: Plant) -> State:
    """One classical fourth-order Runge-Kutta step of `h` seconds."""
    k1 = rates(s, t, held, p)
    k2 = rates(moved(s, 0.5 * h, k1), t + 0.5 * h, held, p)
    k3 = rates(moved(s, 0.5 * h, k2), t + 0.5 * h, held, p)
    k4 = rates(moved(s, h, k3), t + h, held, p)
    s = moved(moved(s, h / 6.0, k1), h / 3.0, k2)
    return moved(moved(s, h / 3.0, k3), h / 6.0, k4)
