"""Every number of the virtual crane, and every effect that can be hidden in it: the one table of the rig.

The named tuples hold the nominal crane; the default of a field is its "off" value. `PARAMETERS`
adds unit, allowed range, meaning and source to each, `EFFECTS` says which parameters make up an effect and how large it
is when only its name is given. All numbers are SI. The kernels read the same tuples (``p.dcv.K``).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

MS, BAR, DEG = 1e-3, 1e5, math.pi / 180.0
STEP = 1e-3  # s, the clock of the real-time target (SYSTEM section 1)


class Compensator(NamedTuple):
    """Inverse dead zone in the controller (4.9), Table 4.1."""

    d_plus: float = 0.45
    d_minus: float = 0.40
    S: float = 50.0


class DeadZone(NamedTuple):
    """Dead zone of the valve itself (2.2)."""

    m_r: float = 1.0
    b_r: float = 0.45
    m_l: float = 1.0
    b_l: float = -0.40
    limit: float = 1.0


class Dcv(NamedTuple):
    """Directional control valve, command to spool (4.16, 5.3), with its flaws."""

    K: float = 2.375e-3
    w0: float = 25.23
    zeta: float = 0.545
    x_0: float = 0.0
    v_max: float = 1.0
    r_v: float = 1.0
    x_min: float = -2.6e-3
    x_max: float = 2.6e-3
    tau_d: float = 0.0
    play: float = 0.0
    c_a: float = 0.0
    u_a: float = 0.2


class Continuity(NamedTuple):
    """Spool to load pressure (4.33, 5.4) with its flaws; or, where `physical`, orifices and two chambers (4.17)-(4.21)."""

    K_c: float = 5.28e8
    T: float = 0.11
    p_s: float = 170.0 * BAR
    a_q: float = 0.0
    c_l: float = 0.0
    c_beta: float = 0.0
    r_T: float = 1.0
    k_s: float = 0.0
    tau_s: float = 0.1
    p_c: float = 0.0
    c_q: float = 0.0
    physical: float = 0.0
    C_d: float = 0.65
    w: float = 1.6980384670641e-4
    rho: float = 870.0
    beta: float = 7e8
    V_L: float = 2.4e-3
    V_A: float = 2.1e-3
    V_B: float = 2.1e-3
    C_L: float = 2.1215307141765915e-12
    C_A: float = 0.0
    C_B: float = 0.0
    p_t: float = 0.0
    R_s: float = 0.0
    tau_p: float = 0.1


class Mechanical(NamedTuple):
    """Slew mechanics (4.27), with its flaws; `theta_0` is the slew angle at the start of the log."""

    J: float = 763.94
    b: float = 34.9 * 763.94
    A: float = 8419.3e-6
    r: float = 0.1
    tau_c: float = 0.0
    tau_load: float = 0.0
    theta_0: float = 15.0 * DEG
    theta_min: float = -1e9
    theta_max: float = 1e9
    tau_s: float = 0.0
    omega_s: float = 0.01
    tau_g: float = 0.0
    theta_g: float = 0.0
    gap: float = 0.0
    mu: float = 0.0
    w_f: float = 10.0
    zeta_f: float = 0.02
    tau_r: float = 0.0
    n_r: float = 20.0
    phi_r: float = 0.0
    a_b: float = 0.0


class Sensor(NamedTuple):
    """Slew sensor: slew = gain theta + bias + drift t of the lagging angle, then its range, rounding and lost packets."""

    bias: float = 0.0
    gain: float = 1.0
    low: float = -1e6
    high: float = 1e6
    drift: float = 0.0
    quantum: float = 0.0
    tau_l: float = 0.0
    p_drop: float = 0.0


class Tracker(NamedTuple):
    """External optical tracker (Table 3.4): its clock, and the step between its two marker models."""

    offset: float = 0.0
    rate: float = 1.0
    seam: float = 0.0
    misfit: float = 0.0


class Unknown(NamedTuple):
    """Causes that no library of effects names, for blind tests; each is off at its first parameter's zero."""

    q_drag: float = 0.0
    g_warm: float = 0.0
    tau_warm: float = 20.0
    tau_burst: float = 0.0
    t_burst: float = 20.0
    d_burst: float = 4.0
    w_burst: float = 12.0
    kappa: float = 0.0
    j_theta: float = 0.0
    n_theta: float = 6.0


class Plant(NamedTuple):
    """The whole crane: one named tuple a block."""

    compensator: Compensator = Compensator()
    dead_zone: DeadZone = DeadZone()
    dcv: Dcv = Dcv()
    continuity: Continuity = Continuity()
    mechanical: Mechanical = Mechanical()
    sensor: Sensor = Sensor()
    tracker: Tracker = Tracker()
    unknown: Unknown = Unknown()


NOMINAL = Plant()
IDENTIFIED_ONLY = ("continuity.K_c", "continuity.T", "continuity.k_s", "continuity.c_q")
PHYSICAL_ONLY = tuple(
    f"continuity.{name}"
    for name in ("C_d", "w", "rho", "beta", "V_L", "V_A", "V_B", "C_L", "C_A", "C_B", "p_t", "R_s", "tau_p")
)
PHYSICAL_B = 33102.35190191385  # N m s/rad, keeps the poles of (5.12) where the piston's flow feeds back


@dataclass(frozen=True)
class Parameter:
    """One number of the crane: SI unit, allowed range (both ends allowed), meaning and source."""

    unit: str
    low: float
    high: float
    text: str
    source: str
    or_zero: bool = False  # zero (off) is allowed besides the range

    def allows(self, value: float) -> bool:
        """Whether `value` (SI) is finite and in the range."""
        return self.low <= value <= self.high or (self.or_zero and value == 0.0)


_D, _U = "docs/design.md", "docs/rig.md, unknown causes"
PI = math.pi

PARAMETERS: dict[str, Parameter] = {
    "compensator.d_plus": Parameter("1", 0.0, 1.0, "Jump of the inverse, u > 0", "Table 4.1"),
    "compensator.d_minus": Parameter("1", 0.0, 1.0, "Jump of the inverse, u < 0", "Table 4.1"),
    "compensator.S": Parameter("1", 0.1, 1e6, "Sharpness of the inverse", "(4.9); value: nominal crane"),
    "dead_zone.m_r": Parameter("1", 0.01, 100.0, "Slope, right", "(2.2)"),
    "dead_zone.b_r": Parameter("1", 0.0, 1.0, "Break point, right", "(2.2), Table 4.1"),
    "dead_zone.m_l": Parameter("1", 0.01, 100.0, "Slope, left", "(2.2)"),
    "dead_zone.b_l": Parameter("1", -1.0, 0.0, "Break point, left", "(2.2), Table 4.1"),
    "dead_zone.limit": Parameter("1", 0.01, 10.0, "Limit of the demand, both signs", "full opening"),
    "dcv.K": Parameter("m", 1e-5, 0.1, "Spool travel at full demand", "(5.3)"),
    "dcv.w0": Parameter("rad/s", 0.5, 500.0, "Natural frequency of the valve", "(5.3)"),
    "dcv.zeta": Parameter("1", 0.01, 20.0, "Damping ratio of the valve", "(5.3)"),
    "dcv.x_0": Parameter("m", -5e-3, 5e-3, "Shift of the spool's neutral", _D),
    "dcv.v_max": Parameter("m/s", 1e-5, 1e3, "Greatest spool speed", _D),
    "dcv.r_v": Parameter("1", 0.01, 100.0, "Greatest spool speed towards B over that towards A", _D),
    "dcv.x_min": Parameter("m", -0.1, 0.0, "Stop of the spool, port B", "Table 3.6"),
    "dcv.x_max": Parameter("m", 0.0, 0.1, "Stop of the spool, port A", "Table 3.6"),
    "dcv.tau_d": Parameter("s", 0.0, 2.0, "Delay of the demand", _D),
    "dcv.play": Parameter("1", 0.0, 1.0, "Half the width of the play on the compensated command", _D),
    "dcv.c_a": Parameter("1", 0.0, 20.0, "Damping added in small motion, of zeta", "fig. 5.6"),
    "dcv.u_a": Parameter("1", 1e-3, 10.0, "Spool error, in demand, over which that fades", "fig. 5.6"),
    "continuity.K_c": Parameter("Pa/m", 1e6, 1e11, "Load pressure per spool opening", "(5.4)"),
    "continuity.T": Parameter("s", 5e-3, 10.0, "Time constant of the load pressure", "(5.4)"),
    "continuity.p_s": Parameter("Pa", 1e5, 1e8, "Supply pressure", "nominal crane"),
    "continuity.a_q": Parameter("1", -0.95, 0.95, "Flow asymmetry", _D),
    "continuity.c_l": Parameter("1", -0.9, 50.0, "Leakage added, of the nominal", _D),
    "continuity.c_beta": Parameter("1", -0.9, 20.0, "Compressibility added, of the nominal", _D),
    "continuity.r_T": Parameter(
        "1", 0.01, 100.0, "Time constant of a falling load pressure over that of a rising one", _D
    ),
    "continuity.k_s": Parameter("Pa/m", 0.0, 1e11, "Fall of the supply per spool opening", _D),
    "continuity.tau_s": Parameter("s", 2 * MS, 100.0, "Time constant of the supply", _D),
    "continuity.p_c": Parameter("Pa", 0.0, 1e8, "Cracking pressure of the counterbalance valve", _D),
    "continuity.c_q": Parameter(
        "1/Pa", 0.0, 1e-5, "Inverse of the load pressure that ends the flow", "(4.22)"
    ),
    "continuity.physical": Parameter(
        "1", 0.0, 1.0, "1: orifices and two chambers (--model physical)", "(4.17)-(4.21)"
    ),
    "continuity.C_d": Parameter("1", 1e-3, 1.0, "Discharge coefficient", "(4.17)"),
    "continuity.w": Parameter("m", 1e-7, 1e-1, "Area gradient of the orifices", "(4.17)"),
    "continuity.rho": Parameter("kg/m3", 100.0, 5000.0, "Density of the oil", "(4.17)"),
    "continuity.beta": Parameter("Pa", 1e6, 1e10, "Effective bulk modulus", "(4.19)"),
    "continuity.V_L": Parameter("m3", 1e-5, 1.0, "Volume of each line", "(4.19)"),
    "continuity.V_A": Parameter("m3", 1e-5, 1.0, "Volume of chamber A at the start", "(4.19)"),
    "continuity.V_B": Parameter("m3", 1e-5, 1.0, "Volume of chamber B at the start", "(4.20)"),
    "continuity.C_L": Parameter("m3/(s.Pa)", 0.0, 1e-8, "Cross-port leakage coefficient", "(4.25)"),
    "continuity.C_A": Parameter("m3/(s.Pa)", 0.0, 1e-8, "Leakage coefficient of chamber A", "(4.19)"),
    "continuity.C_B": Parameter("m3/(s.Pa)", 0.0, 1e-8, "Leakage coefficient of chamber B", "(4.20)"),
    "continuity.p_t": Parameter("Pa", 0.0, 1e7, "Tank pressure", "(4.17)"),
    "continuity.R_s": Parameter("Pa.s/m3", 0.0, 1e14, "Fall of the supply per flow drawn", _D),
    "continuity.tau_p": Parameter("s", 2 * MS, 100.0, "Time constant of that supply", _D),
    "mechanical.J": Parameter(
        "kg.m2", 1.0, 1e6, "Inertia at the slew axis", "(4.34) with the pole of (5.12)"
    ),
    "mechanical.b": Parameter("N.m.s/rad", 0.0, 1e7, "Viscous friction", "(4.34) with the pole of (5.12)"),
    "mechanical.A": Parameter("m2", 1e-5, 1.0, "Cylinder area", "Table 3.1"),
    "mechanical.r": Parameter("m", 1e-3, 10.0, "Pinion radius", "Table 3.1"),
    "mechanical.tau_c": Parameter("N.m", 0.0, 1e6, "Coulomb friction", "(4.27)"),
    "mechanical.tau_load": Parameter("N.m", -1e6, 1e6, "Constant load against positive motion", "(4.27)"),
    "mechanical.theta_0": Parameter(
        "rad", -2 * PI, 4 * PI, "Slew angle at the start", "where the log starts"
    ),
    "mechanical.theta_min": Parameter("rad", -1e9, 1e9, "Lower end of the travel", _D),
    "mechanical.theta_max": Parameter("rad", -1e9, 1e9, "Upper end of the travel", _D),
    "mechanical.tau_s": Parameter("N.m", 0.0, 1e6, "Friction at standstill above Coulomb", _D),
    "mechanical.omega_s": Parameter("rad/s", 1e-5, 10.0, "Stribeck speed", _D),
    "mechanical.tau_g": Parameter("N.m", -1e6, 1e6, "Greatest torque of gravity", _D),
    "mechanical.theta_g": Parameter("rad", -2 * PI, 2 * PI, "Angle at which gravity vanishes", _D),
    "mechanical.gap": Parameter("rad", 0.0, 1.0, "Full backlash between mechanism and what is seen", _D),
    "mechanical.mu": Parameter("1", 0.0, 0.95, "Fraction of J on the spring (boom)", _D),
    "mechanical.w_f": Parameter("rad/s", 0.1, 300.0, "Boom frequency with the column locked", _D),
    "mechanical.zeta_f": Parameter("1", 0.0, 2.0, "Damping ratio of the boom", _D),
    "mechanical.tau_r": Parameter("N.m", -1e6, 1e6, "Torque ripple of the gear", _D),
    "mechanical.n_r": Parameter("1", 0.1, 2000.0, "Ripples a revolution", _D),
    "mechanical.phi_r": Parameter("rad", -2 * PI, 2 * PI, "Phase of the ripple", _D),
    "mechanical.a_b": Parameter(
        "1", -1.0, 1.0, "Viscous friction is b (1 + a_b) forwards, b (1 - a_b) backwards", _D
    ),
    "sensor.bias": Parameter("rad", -PI, PI, "Zero error", _D),
    "sensor.gain": Parameter("1", 0.1, 10.0, "Scale", _D),
    "sensor.low": Parameter("rad", -1e6, 1e6, "Lowest reading", _D),
    "sensor.high": Parameter("rad", -1e6, 1e6, "Highest reading", _D),
    "sensor.drift": Parameter("rad/s", -1.0, 1.0, "Zero drift", _D),
    "sensor.quantum": Parameter("rad", 0.0, 1.0, "Step of the converter", _D),
    "sensor.tau_l": Parameter("s", MS, 10.0, "Time constant of the lag", _D, or_zero=True),
    "sensor.p_drop": Parameter("1", 0.0, 0.99, "Probability that a sample is stale", _D),
    "tracker.offset": Parameter("s", -1e5, 1e5, "True time at the tracker's zero", _D),
    "tracker.rate": Parameter("1", 0.5, 2.0, "True seconds in one of the tracker's", _D),
    "tracker.seam": Parameter("rad", -0.5, 0.5, "Added below 12 deg", "Table 3.4, fig. 5.16"),
    "tracker.misfit": Parameter(
        "m", 0.0, 0.02, "Error of the markers by which model 1 was laid on model 2", "section 3.5.4"
    ),
    "unknown.q_drag": Parameter("N.m.s2/rad2", 0.0, 1e9, "Quadratic torque against speed", _U),
    "unknown.g_warm": Parameter("1", -0.9, 2.0, "Valve gain gained when warm", _U),
    "unknown.tau_warm": Parameter("s", 0.1, 1e5, "Time constant of the warming", _U),
    "unknown.tau_burst": Parameter("N.m", -1e6, 1e6, "Amplitude of the torque burst", _U),
    "unknown.t_burst": Parameter("s", 0.0, 1e5, "Start of the burst", _U),
    "unknown.d_burst": Parameter("s", 0.05, 1e4, "Length of the burst", _U),
    "unknown.w_burst": Parameter("rad/s", 0.0, 100.0, "Frequency inside the burst", _U),
    "unknown.kappa": Parameter("1", 0.0, 0.9, "Friction as a fraction of the driving torque", _U),
    "unknown.j_theta": Parameter("1", -0.9, 0.9, "Amplitude of inertia over angle, of J", _U),
    "unknown.n_theta": Parameter("1", 0.1, 100.0, "Periods of inertia a revolution", _U),
}


@dataclass(frozen=True)
class Effect:
    """A hideable effect: the block it sits in and its parameters' values (SI) at its moderate default size."""

    block: str
    moderate: dict[str, float]  # "block.parameter" -> value

    def off(self) -> dict[str, float]:
        """The values (SI) at which the crane is the nominal one."""
        return {name: nominal_value(name) for name in self.moderate}


def nominal_value(name: str) -> float:
    """Nominal value (SI) of ``component.parameter``."""
    component, parameter = name.split(".")
    return float(getattr(getattr(NOMINAL, component), parameter))


EFFECTS: dict[str, Effect] = {
    "dead_zone.mismatch": Effect("dead_zone", {"dead_zone.b_r": 0.50, "dead_zone.b_l": -0.45}),
    "dcv.gain": Effect("dcv", {"dcv.K": 2.14e-3}),
    "dcv.bandwidth": Effect("dcv", {"dcv.w0": 20.0}),
    "dcv.damping": Effect("dcv", {"dcv.zeta": 0.75}),
    "dcv.delay": Effect("dcv", {"dcv.tau_d": 20 * MS}),
    "dcv.rate_limit": Effect("dcv", {"dcv.v_max": 0.01}),
    "dcv.stroke_limit": Effect("dcv", {"dcv.x_max": 1.7e-3, "dcv.x_min": -1.7e-3}),
    "dcv.hysteresis": Effect("dcv", {"dcv.play": 0.03}),
    "dcv.offset": Effect("dcv", {"dcv.x_0": 0.1e-3}),
    "continuity.flow_gain": Effect("continuity", {"continuity.K_c": 4.6e8}),
    "continuity.flow_asymmetry": Effect("continuity", {"continuity.a_q": 0.10}),
    "continuity.leakage": Effect("continuity", {"continuity.c_l": 0.20}),
    "continuity.compressibility": Effect("continuity", {"continuity.c_beta": 0.40}),
    "continuity.lag_asymmetry": Effect("continuity", {"continuity.r_T": 2.0}),
    "continuity.supply_sag": Effect("continuity", {"continuity.k_s": 1.2e9, "continuity.tau_s": 0.1}),
    "continuity.cracking_pressure": Effect("continuity", {"continuity.p_c": 1.0 * BAR}),
    "mechanical.coulomb_friction": Effect("mechanical", {"mechanical.tau_c": 100.0}),
    "mechanical.stribeck_friction": Effect(
        "mechanical", {"mechanical.tau_c": 100.0, "mechanical.tau_s": 80.0, "mechanical.omega_s": 0.01}
    ),
    "mechanical.viscous_friction": Effect("mechanical", {"mechanical.b": 32e3}),
    "mechanical.inertia": Effect("mechanical", {"mechanical.J": 1000.0}),
    "mechanical.gravity_load": Effect("mechanical", {"mechanical.tau_g": 100.0, "mechanical.theta_g": 0.0}),
    "mechanical.backlash": Effect("mechanical", {"mechanical.gap": 0.2 * DEG}),
    "mechanical.compliance": Effect(
        "mechanical", {"mechanical.mu": 0.3, "mechanical.w_f": 10.0, "mechanical.zeta_f": 0.02}
    ),
    "mechanical.gear_ripple": Effect(
        "mechanical", {"mechanical.tau_r": 50.0, "mechanical.n_r": 20.0, "mechanical.phi_r": 0.0}
    ),
    "mechanical.end_stop": Effect(
        "mechanical", {"mechanical.theta_max": 16.0 * DEG, "mechanical.theta_min": 12.0 * DEG}
    ),
    "mechanical.constant_load": Effect("mechanical", {"mechanical.tau_load": 60.0}),
    "sensor.saturation": Effect("sensor", {"sensor.high": 16.0 * DEG, "sensor.low": 12.0 * DEG}),
    "sensor.bias": Effect("sensor", {"sensor.bias": 1.0 * DEG}),
    "sensor.gain": Effect("sensor", {"sensor.gain": 1.02}),
    "sensor.drift": Effect("sensor", {"sensor.drift": 0.01 * DEG}),
    "sensor.quantisation": Effect("sensor", {"sensor.quantum": 0.1 * DEG}),
    "sensor.lag": Effect("sensor", {"sensor.tau_l": 50 * MS}),
    "sensor.dropout": Effect("sensor", {"sensor.p_drop": 0.1}),
    "tracker.clock": Effect("tracker", {"tracker.offset": 0.2, "tracker.rate": 1.0005}),
    "tracker.seam": Effect("tracker", {"tracker.seam": 0.3 * DEG}),
    "dcv.amplitude_damping": Effect("dcv", {"dcv.c_a": 1.0, "dcv.u_a": 0.2}),
    "continuity.flow_pressure": Effect("continuity", {"continuity.c_q": 1.0 / (170.0 * BAR)}),
    "unknown.quadratic_drag": Effect("mechanical", {"unknown.q_drag": 1.5e5}),
    "unknown.warming_valve": Effect("dcv", {"unknown.g_warm": 0.15, "unknown.tau_warm": 20.0}),
    "unknown.torque_burst": Effect(
        "mechanical",
        {
            "unknown.tau_burst": 200.0,
            "unknown.t_burst": 20.0,
            "unknown.d_burst": 4.0,
            "unknown.w_burst": 12.0,
        },
    ),
    "unknown.pressure_friction": Effect("mechanical", {"unknown.kappa": 0.12}),
    "unknown.angle_inertia": Effect("mechanical", {"unknown.j_theta": 0.4, "unknown.n_theta": 6.0}),
}
