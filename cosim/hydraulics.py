"""The physical hydraulics linearised about the centre: flow gains, greatest flow, natural frequency and damping.

    Q_L = Cd w |x_v| sqrt((Ps - sign(x_v) PL)/rho)                                   (4.22), standard form: SYSTEM 9.5
    Q_L = K_flow x_v - K_pressure PL about x_v, PL = 0                               (4.23)
    dx/dt / Q_L = A^-1 / (s^2/w_mh^2 + 2 zeta_mh s/w_mh + 1)                         (5.6)
    w_mh = 2 A sqrt(beta/(V_t m)),  zeta_mh = b_x/(4 A) sqrt(V_t/(beta m)) + C/A sqrt(beta m/V_t)     (5.7), (5.8)

m = J/r^2 and b_x = b/r^2 are inertia and friction at the rack, V_t = 2 V_L + V_A + V_B, C = C_L + (C_A + C_B)/4; the
source's zeta_mh has the first term only. Merritt, Hydraulic Control Systems, 1967, ch. 6.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.closed_loop import values
from cosim.ssp.system import System

LITRES_A_MINUTE = 6e4  # in one m3/s
BAR = 1e5


def is_physical(system: System) -> bool:
    """Whether the system has two chambers and orifices that drive the column."""
    parts = system.components
    return all(n in parts for n in ("dcv", "continuity", "mechanical")) and (
        "C_d" in parts["continuity"].fmu.variables
    )


def linearised(system: System, opening: float | None = None) -> dict[str, float]:
    """The linearised hydraulics of a physical system, SI.

    Args:
        system: with components dcv, continuity and mechanical.
        opening: of the spool [m] at which K_pressure is taken; by default half the travel of full command.

    Returns:
        ``K_flow`` [m2/s], ``K_pressure`` [m3/(s.Pa)], ``opening`` [m], ``Q_max`` [m3/s] at full command without load,
        ``w_mh`` [rad/s] and ``zeta_mh`` [1] at the centre, ``zeta_mh_friction`` [1] without leakage as the source has it,
        ``gain`` [rad/s per m] of the whole from spool to velocity at low frequency.
    """
    v, c, m = (values(system, name) for name in ("dcv", "continuity", "mechanical"))
    at = 0.5 * v["K"] if opening is None else opening
    p_s = c["p_s"] - c["p_t"]
    flow = c["C_d"] * c["w"] * math.sqrt(p_s / c["rho"])
    pressure = c["C_d"] * c["w"] * abs(at) / (2.0 * math.sqrt(c["rho"] * p_s))
    leak = c["C_L"] + 0.25 * (c["C_A"] + c["C_B"])
    mass, friction = m["J"] / m["r"] ** 2, m["b"] / m["r"] ** 2
    volume = 2.0 * c["V_L"] + c["V_A"] + c["V_B"]
    rubbing = friction / (4.0 * m["A"]) * math.sqrt(volume / (c["beta"] * mass))
    leaking = leak / m["A"] * math.sqrt(c["beta"] * mass / volume)
    area = m["A"] * m["r"]
    return {
        "K_flow": flow,
        "K_pressure": pressure,
        "opening": at,
        "Q_max": flow * v["K"],
        "w_mh": 2.0 * m["A"] * math.sqrt(c["beta"] / (volume * mass)),
        "zeta_mh": rubbing + leaking,
        "zeta_mh_friction": rubbing,
        "gain": flow * area / (area**2 + leak * m["b"]),
    }


def poles(system: System) -> NDArray[np.complex128]:
    """Poles [1/s] of pressure and velocity about the centre, leakage and friction in."""
    found = linearised(system)
    m, c = values(system, "mechanical"), values(system, "continuity")
    leak = c["C_L"] + 0.25 * (c["C_A"] + c["C_B"])
    stiffness = found["w_mh"] ** 2 * (1.0 + leak * m["b"] / (m["A"] * m["r"]) ** 2)
    return np.asarray(np.roots([1.0, 2.0 * found["zeta_mh"] * found["w_mh"], stiffness]), dtype=np.complex128)


def facts(system: System) -> dict[str, Any]:
    """The same for people, in three lines, and as numbers under ``hydraulics``."""
    found, p = linearised(system), poles(system)
    roots = ", ".join(f"{x.real:.4g}" if abs(x.imag) < 1e-9 else f"{x:.4g}" for x in p)
    gains = (
        f"flow per spool opening K_flow {found['K_flow'] * LITRES_A_MINUTE * 1e-3:.4g} l/min per mm, less per load pressure "
        f"K_pressure {found['K_pressure'] * LITRES_A_MINUTE * BAR:.3g} l/min per bar at {found['opening'] * 1e3:.3g} mm "
        f"(4.23), at most Q_max {found['Q_max'] * LITRES_A_MINUTE:.3g} l/min at full command"
    )
    motion = (
        f"natural frequency w_mh {found['w_mh']:.4g} rad/s, damping ratio zeta_mh {found['zeta_mh']:.4g}, of it "
        f"{found['zeta_mh_friction']:.4g} by friction (5.7), (5.8); poles {roots} 1/s"
    )
    return {"flow_gains": gains, "pressure_and_motion": motion, "hydraulics": found}
