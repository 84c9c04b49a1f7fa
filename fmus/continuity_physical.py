"""Flow and pressure from first principles: orifices, two chambers, leakage, supply.

    Q_A = Cd w |x_v| sqrt(2/rho (Ps - PA))     x_v > 0,   -Cd w |x_v| sqrt(2/rho (PA - PT))   x_v < 0      (4.17)
    Q_B = -Cd w |x_v| sqrt(2/rho (PB - PT))    x_v > 0,    Cd w |x_v| sqrt(2/rho (Ps - PB))   x_v < 0      (4.18), sign: SYSTEM 9.5
    dPA/dt = beta/(V_L + V_A) (Q_A - A r omega - C_L (PA - PB))                                            (4.19)
    dPB/dt = beta/(V_L + V_B) (Q_B + A r omega + C_L (PA - PB))                                            (4.20), sign: SYSTEM 9.5
    tau_p dPs/dt = p_s - R_s Q_drawn - Ps                       supply; R_s = 0: constant
    PL = PA - PB                                                                                           (4.21)

Integrated by the classical Runge-Kutta scheme (order 4) while spool and velocity move on straight lines. The source
gives none of Cd, rho, beta, volumes and leakage. Here beta and the volumes are typical values; leakage, orifice width and,
in the physical system, the viscous friction b = 43.33 J then follow from keeping, linearised about the centre,
the poles (9.09 and 34.9 rad/s) and the low-frequency gain of the identified chain. What the structure cannot keep: b and with it
the load pressure at a given speed are 1.24 times the identified ones, because the piston's flow feeds back here and does not there.
"""

import math
import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation


class Input(NamedTuple):
    """What comes in."""

    spool: Annotated[float, Variable("m", "Spool position", low=-1.0, high=1.0, display="mm", nominal=1e-3)]
    omega: Annotated[
        float, Variable("rad/s", "Slew velocity", low=-1e4, high=1e4, display="deg/s", nominal=0.01)
    ]


class Output(NamedTuple):
    """What goes out."""

    p_load: Annotated[float, Variable("Pa", "Load pressure PA - PB", display="bar", nominal=1e5)]
    p_a: Annotated[float, Variable("Pa", "Pressure at port A", display="bar", nominal=1e5)]
    p_b: Annotated[float, Variable("Pa", "Pressure at port B", display="bar", nominal=1e5)]
    p_supply: Annotated[float, Variable("Pa", "Supply pressure", display="bar", nominal=1e5)]


class State(NamedTuple):
    """Three pressures, and the inputs at the end of the last step."""

    p_a: Annotated[float, Variable("Pa", "Pressure at port A", display="bar", nominal=1e5)]
    p_b: Annotated[float, Variable("Pa", "Pressure at port B", display="bar", nominal=1e5)]
    p_supply: Annotated[float, Variable("Pa", "Supply pressure", display="bar", nominal=1e5)]
    spool: Annotated[float, Variable("m", "Spool position", display="mm", nominal=1e-3)]
    omega: Annotated[float, Variable("rad/s", "Slew velocity", display="deg/s", nominal=0.01)]


class Parameters(NamedTuple):
    """Orifices, fluid, volumes, leakage, supply."""

    C_d: Annotated[float, Variable("1", "Discharge coefficient", 0.65, 1e-3, 1.0, source="typical of a sharp edge: Merritt, Hydraulic Control Systems, 1967, ch. 3")]  # fmt: skip
    w: Annotated[float, Variable("m", "Area gradient of the orifices", 1.6980384670641e-4, 1e-9, 1.0, display="mm", nominal=1e-4, source="keeps the low-frequency gain of (5.12); see the module's text")]  # fmt: skip
    rho: Annotated[float, Variable("kg/m3", "Density of the oil", 870.0, 100.0, 5000.0, nominal=1e3, source="typical of mineral oil: Merritt 1967, ch. 1")]  # fmt: skip
    beta: Annotated[float, Variable("Pa", "Effective bulk modulus", 7e8, 1e5, 1e11, display="bar", nominal=1e8, source="typical with hoses and some air: Jelali and Kroll, Hydraulic Servo-systems, 2003, ch. 3")]  # fmt: skip
    V_L: Annotated[float, Variable("m3", "Volume of each line", 2.4e-3, 1e-9, 10.0, display="l", nominal=1e-3, source="assumed: hoses and counterbalance valve block")]  # fmt: skip
    V_A: Annotated[float, Variable("m3", "Volume of chamber A at mid stroke", 2.1e-3, 1e-9, 10.0, display="l", nominal=1e-3, source="A times half the stroke of 290 deg at r = 100 mm (SYSTEM section 2)")]  # fmt: skip
    V_B: Annotated[float, Variable("m3", "Volume of chamber B at mid stroke", 2.1e-3, 1e-9, 10.0, display="l", nominal=1e-3, source="A times half the stroke of 290 deg at r = 100 mm (SYSTEM section 2)")]  # fmt: skip
    C_L: Annotated[float, Variable("m3/(s.Pa)", "Cross-port leakage coefficient", 2.1215307141765915e-12, 0.0, 1e-6, nominal=1e-12, source="keeps the poles of (5.12); see the module's text")]  # fmt: skip
    A: Annotated[float, Variable("m2", "Cylinder area", 8.4193e-3, 1e-9, 100.0, display="mm2", nominal=1e-2, source="Table 3.1; SYSTEM section 9.3")]  # fmt: skip
    r: Annotated[
        float, Variable("m", "Pinion radius", 0.1, 1e-6, 100.0, display="mm", nominal=0.1, source="Table 3.1")
    ]
    p_s: Annotated[float, Variable("Pa", "Supply pressure without flow", 170e5, 1e4, 1e8, display="bar", nominal=1e5, source="SYSTEM section 1: 0..170 bar")]  # fmt: skip
    p_t: Annotated[float, Variable("Pa", "Tank pressure", 0.0, 0.0, 1e7, display="bar", nominal=1e5, source="assumed: open tank")]  # fmt: skip
    R_s: Annotated[float, Variable("Pa.s/m3", "Fall of the supply per flow drawn", 0.0, 0.0, 1e15, nominal=1e10, source="0: stiff supply (CONTRACT section 6)")]  # fmt: skip
    tau_p: Annotated[float, Variable("s", "Time constant of the supply", 0.1, 1e-4, 1e3, nominal=0.1, source="assumed; acts only where R_s > 0")]  # fmt: skip


class Coefficients(NamedTuple):
    """Number of inner steps (each at most 1 ms) and their length."""

    h: float
    inner: float
    steps: float


@equation
def orifice(opening: float, dp: float, p: Parameters) -> float:
    """Turbulent flow through an orifice, m3/s, with the sign of dp; below 0.1 bar it goes smoothly through zero."""
    return p.C_d * p.w * opening * math.sqrt(2.0 / p.rho) * dp / math.sqrt(math.sqrt(dp * dp + 1e8))


@equation
def port_flows(p_a: float, p_b: float, p_s: float, spool: float, p: Parameters) -> tuple[float, float]:
    """Flow into chamber A and into chamber B, m3/s: (4.17), (4.18)."""
    if spool >= 0.0:
        return orifice(spool, p_s - p_a, p), -orifice(spool, p_b - p.p_t, p)
    return -orifice(-spool, p_a - p.p_t, p), orifice(-spool, p_s - p_b, p)


@equation
def rates(
    p_a: float, p_b: float, p_s: float, spool: float, omega: float, p: Parameters
) -> tuple[float, float, float]:
    """dPA/dt, dPB/dt, dPs/dt in Pa/s: (4.19), (4.20)."""
    q_a, q_b = port_flows(p_a, p_b, p_s, spool, p)
    swept = p.A * p.r * omega
    leak = p.C_L * (p_a - p_b)
    drawn = q_a if spool >= 0.0 else q_b
    return (
        p.beta / (p.V_L + p.V_A) * (q_a - swept - leak),
        p.beta / (p.V_L + p.V_B) * (q_b + swept + leak),
        (p.p_s - p.R_s * drawn - p_s) / p.tau_p,
    )


@equation
def start(u: Input, p: Parameters) -> State:
    """No load pressure, both chambers at half the supply."""
    return State(0.5 * (p.p_s + p.p_t), 0.5 * (p.p_s + p.p_t), p.p_s, u.spool, u.omega)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Inner steps for the step h, s."""
    n = max(1.0, math.ceil(h / 1.0e-3 - 1e-6))
    return Coefficients(h, h / n, n)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(4.17)-(4.20) over one step of length c.h."""
    a, b, s = x.p_a, x.p_b, x.p_supply
    k = c.inner
    ds = (u.spool - x.spool) / c.steps
    dw = (u.omega - x.omega) / c.steps
    for i in range(int(c.steps)):
        v0 = x.spool + i * ds
        w0 = x.omega + i * dw
        a1, b1, s1 = rates(a, b, s, v0, w0, p)
        v, w = v0 + 0.5 * ds, w0 + 0.5 * dw
        a2, b2, s2 = rates(a + 0.5 * k * a1, b + 0.5 * k * b1, s + 0.5 * k * s1, v, w, p)
        a3, b3, s3 = rates(a + 0.5 * k * a2, b + 0.5 * k * b2, s + 0.5 * k * s2, v, w, p)
        a4, b4, s4 = rates(a + k * a3, b + k * b3, s + k * s3, v0 + ds, w0 + dw, p)
        a = a + k / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        b = b + k / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
        s = s + k / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4)
    return State(a, b, s, u.spool, u.omega)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The pressures."""
    return Output(x.p_a - x.p_b, x.p_a, x.p_b, x.p_supply)


BLOCK = Block(
    name="continuity_physical",
    title="Flow and pressure, physical form: orifices, two chambers, leakage, supply",
    module=sys.modules[__name__],
    reads={"spool": "line", "omega": "line"},
)
