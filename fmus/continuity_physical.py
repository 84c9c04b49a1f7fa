"""Flow and pressure from first principles: orifices, two chambers, leakage, supply.

    Q_A = Cd w |x_v| sqrt(2/rho (Ps - PA))     x_v > 0,   -Cd w |x_v| sqrt(2/rho (PA - PT))   x_v < 0      (4.17)
    Q_B = -Cd w |x_v| sqrt(2/rho (PB - PT))    x_v > 0,    Cd w |x_v| sqrt(2/rho (Ps - PB))   x_v < 0      (4.18), sign: SYSTEM 9.5
    dPA/dt = beta/(V_L + V_A + A x) (Q_A - A dx/dt - L_A),   L_A = C_L (PA - PB) + C_A (PA - PT)           (4.19)
    dPB/dt = beta/(V_L + V_B - A x) (Q_B + A dx/dt - L_B),   L_B = C_L (PB - PA) + C_B (PB - PT)           (4.20), sign: SYSTEM 9.5
    dx/dt = r omega                                             rack, from mid stroke: the chambers' volumes follow it
    tau_p dPs/dt = p_s - R_s Q_drawn - Ps                       supply; R_s = 0: constant
    PL = PA - PB                                                                                           (4.21)

Integrated by the classical Runge-Kutta scheme (order 4) while spool and velocity move on straight lines. The velocity is
that at the start of a step, since the mechanics, which the pressure drives, are stepped behind: it goes on as in the step
before. So the loop of the two is of second order in the step. The source gives none of Cd, rho, beta, volumes and leakage. Here beta and the volumes are typical values; leakage, orifice width and,
in the physical system, the viscous friction b = 43.33 J then follow from keeping, linearised about the centre,
the poles (9.09 and 34.9 rad/s) and the low-frequency gain of the identified chain. What the structure cannot keep: b and with it
the load pressure at a given speed are 1.24 times the identified ones, because the piston's flow feeds back here and does not there.
"""

import math
import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation, slot


class Input(NamedTuple):
    """What comes in."""

    spool: Annotated[float, Variable("m", "Spool position", low=-1.0, high=1.0, display="mm", nominal=1e-3)]
    omega: Annotated[
        float,
        Variable(
            "rad/s",
            "Slew velocity at the start of the step",
            low=-1e4,
            high=1e4,
            display="deg/s",
            nominal=0.01,
        ),
    ]


class Output(NamedTuple):
    """What goes out."""

    p_load: Annotated[float, Variable("Pa", "Load pressure PA - PB", display="bar", nominal=1e5)]
    p_a: Annotated[float, Variable("Pa", "Pressure at port A", display="bar", nominal=1e5)]
    p_b: Annotated[float, Variable("Pa", "Pressure at port B", display="bar", nominal=1e5)]
    p_supply: Annotated[float, Variable("Pa", "Supply pressure", display="bar", nominal=1e5)]


class State(NamedTuple):
    """Three pressures, the rack, and the inputs of the last step."""

    p_a: Annotated[float, Variable("Pa", "Pressure at port A", display="bar", nominal=1e5)]
    p_b: Annotated[float, Variable("Pa", "Pressure at port B", display="bar", nominal=1e5)]
    p_supply: Annotated[float, Variable("Pa", "Supply pressure", display="bar", nominal=1e5)]
    rack: Annotated[float, Variable("m", "Rack position from mid stroke", display="mm", nominal=1e-2)]
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
    C_A: Annotated[float, Variable("m3/(s.Pa)", "Leakage coefficient of chamber A to the tank", 0.0, 0.0, 1e-6, nominal=1e-12, source="off: the leakage is between the ports, L_C of (4.25)")]  # fmt: skip
    C_B: Annotated[float, Variable("m3/(s.Pa)", "Leakage coefficient of chamber B to the tank", 0.0, 0.0, 1e-6, nominal=1e-12, source="off: the leakage is between the ports, L_C of (4.25)")]  # fmt: skip
    A: Annotated[float, Variable("m2", "Cylinder area", 8.4193e-3, 1e-9, 100.0, display="mm2", nominal=1e-2, source="Table 3.1; SYSTEM section 9.3")]  # fmt: skip
    r: Annotated[
        float, Variable("m", "Pinion radius", 0.1, 1e-6, 100.0, display="mm", nominal=0.1, source="Table 3.1")
    ]
    p_s: Annotated[float, Variable("Pa", "Supply pressure without flow", 170e5, 1e4, 1e8, display="bar", nominal=1e5, source="SYSTEM section 1: 0..170 bar")]  # fmt: skip
    p_t: Annotated[float, Variable("Pa", "Tank pressure", 0.0, 0.0, 1e7, display="bar", nominal=1e5, source="assumed: open tank")]  # fmt: skip
    R_s: Annotated[float, Variable("Pa.s/m3", "Fall of the supply per flow drawn", 0.0, 0.0, 1e15, nominal=1e10, source="0: stiff supply")]  # fmt: skip
    tau_p: Annotated[float, Variable("s", "Time constant of the supply", 0.1, 1e-4, 1e3, nominal=0.1, source="assumed; acts only where R_s > 0")]  # fmt: skip
    p_load_0: Annotated[float, Variable("Pa", "Load pressure at the start", 0.0, -1e8, 1e8, display="bar", nominal=1e5, source="starts at rest")]  # fmt: skip
    x_0: Annotated[float, Variable("m", "Rack position at the start from mid stroke", 0.0, -1.0, 1.0, display="mm", nominal=1e-2, source="assumed: a log starts at mid stroke")]  # fmt: skip


class Coefficients(NamedTuple):
    """Number of inner steps (each at most 1 ms) and their length."""

    h: float
    inner: float
    steps: float


@slot("chain")
def opening(spool: float, m: NoMemory, p: Parameters) -> float:
    """Effective opening of the valve, m; effects on the flow act here."""
    return spool


@slot("chain")
def driving_pressure(p_load: float, m: NoMemory, p: Parameters) -> float:
    """Load pressure as the mechanics feel it, Pa; effects such as a counterbalance valve act here."""
    return p_load


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
    p_a: float, p_b: float, p_s: float, rack: float, spool: float, omega: float, p: Parameters
) -> tuple[float, float, float]:
    """dPA/dt, dPB/dt, dPs/dt in Pa/s, by the effective opening `spool`, m: (4.19), (4.20)."""
    q_a, q_b = port_flows(p_a, p_b, p_s, spool, p)
    swept = p.A * p.r * omega
    across = p.C_L * (p_a - p_b)
    drawn = q_a if spool >= 0.0 else q_b
    # a chamber at its end is empty; the line is left
    return (
        p.beta / (p.V_L + max(p.V_A + p.A * rack, 0.0)) * (q_a - swept - across - p.C_A * (p_a - p.p_t)),
        p.beta / (p.V_L + max(p.V_B - p.A * rack, 0.0)) * (q_b + swept + across - p.C_B * (p_b - p.p_t)),
        (p.p_s - p.R_s * drawn - p_s) / p.tau_p,
    )


@equation
def start(u: Input, p: Parameters) -> State:
    """Both chambers about half the supply, nominally without load pressure."""
    middle = 0.5 * (p.p_s + p.p_t)
    return State(middle + 0.5 * p.p_load_0, middle - 0.5 * p.p_load_0, p.p_s, p.x_0, u.spool, u.omega)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Inner steps for the step h, s."""
    n = max(1.0, math.ceil(h / 1.0e-3 - 1e-6))
    return Coefficients(h, h / n, n)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(4.17)-(4.20) over one step of length c.h."""
    a, b, s, rack = x.p_a, x.p_b, x.p_supply, x.rack
    k = c.inner
    ds = (u.spool - x.spool) / c.steps
    dw = (u.omega - x.omega) / c.steps  # as in the step before
    way = k * p.r
    end = opening(x.spool, m, p)
    for i in range(int(c.steps)):
        w0 = u.omega + i * dw
        begin = end
        middle, end = opening(x.spool + (i + 0.5) * ds, m, p), opening(x.spool + (i + 1) * ds, m, p)
        w, w1 = w0 + 0.5 * dw, w0 + dw
        half, whole = rack + 0.5 * way * (w0 + 0.25 * dw), rack + way * w
        a1, b1, s1 = rates(a, b, s, rack, begin, w0, p)
        a2, b2, s2 = rates(a + 0.5 * k * a1, b + 0.5 * k * b1, s + 0.5 * k * s1, half, middle, w, p)
        a3, b3, s3 = rates(a + 0.5 * k * a2, b + 0.5 * k * b2, s + 0.5 * k * s2, half, middle, w, p)
        a4, b4, s4 = rates(a + k * a3, b + k * b3, s + k * s3, whole, end, w1, p)
        a = a + k / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        b = b + k / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
        s = s + k / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4)
        rack = whole
    return State(a, b, s, rack, u.spool, u.omega)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The pressures."""
    return Output(driving_pressure(x.p_a - x.p_b, m, p), x.p_a, x.p_b, x.p_supply)


BLOCK = Block(
    name="continuity_physical",
    title="Flow and pressure, physical form: orifices, two chambers, leakage, supply",
    module=sys.modules[__name__],
    reads={"spool": "line", "omega": "start"},
)
