"""Extended observer: slew angle and velocity, the torque that the model lacks, and the slew sensor's own error.

    theta' = omega + ...
    J omega' = A r PL - b omega + tau + ...                     (4.27), all that is not viscous in tau
    tau'  = -tau / T_tau + ...                                  friction, load, wind: a first-order Gauss-Markov process
    beta' = -beta / T_beta + ...                                error of the slew sensor, likewise
    ... = L (slew - theta - beta)                               (2.15), gains per second

A reading of the tracker, taken `external_age` before the end of a step, moves the estimate by
K (slew_external - theta + omega external_age). PL is measured, or comes from a model of valve and pressure: these have no
noise of their own there, so that Kalman's gain on their states is zero. The gains are those of the stationary Kalman filter
(`cosim identify kalman`).
Over a step PL moves on a straight line and the motion is exact for it; the correction is made at its end. T = 0: no such state.
"""

import math
import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation
from fmus.linear import phi_functions
from fmus.motion import slid

KALMAN = "stationary Kalman filter of cosim/identify/kalman.py: slew sensor 0.01 deg, load pressure 0.14 bar, disturbance 100 N.m over 1 s"


class Input(NamedTuple):
    """What comes in."""

    p_load: Annotated[float, Variable("Pa", "Load pressure, measured or modelled", low=-1e9, high=1e9, display="bar", nominal=1e6)]  # fmt: skip
    slew: Annotated[
        float, Variable("rad", "Measured slew angle", low=-1e6, high=1e6, display="deg", nominal=0.01)
    ]
    slew_external: Annotated[float, Variable("rad", "Reading of the external tracker", low=-1e6, high=1e6, display="deg", nominal=0.01)]  # fmt: skip
    external_age: Annotated[float, Variable("s", "Time since that reading was taken; negative: none in this step", -1.0, -1e6, 10.0, nominal=0.01)]  # fmt: skip


class Output(NamedTuple):
    """What goes out."""

    slew_estimate: Annotated[float, Variable("rad", "Estimated slew angle", display="deg")]
    slew_rate_estimate: Annotated[
        float, Variable("rad/s", "Estimated slew velocity", display="deg/s", nominal=0.01)
    ]
    disturbance: Annotated[float, Variable("N.m", "Estimated torque that the model lacks", nominal=100.0)]
    sensor_error: Annotated[float, Variable("rad", "Estimated error of the slew sensor", display="deg", nominal=0.01)]  # fmt: skip


class State(NamedTuple):
    """The estimate, and the load pressure at the end of the last step."""

    theta: Annotated[float, Variable("rad", "Estimated slew angle", display="deg")]
    omega: Annotated[float, Variable("rad/s", "Estimated slew velocity", display="deg/s", nominal=0.01)]
    tau: Annotated[float, Variable("N.m", "Estimated disturbance torque", nominal=100.0)]
    beta: Annotated[float, Variable("rad", "Estimated error of the slew sensor", display="deg", nominal=0.01)]
    p_load: Annotated[float, Variable("Pa", "Load pressure", display="bar", nominal=1e6)]


class Parameters(NamedTuple):
    """Model, gains and start."""

    J: Annotated[float, Variable("kg.m2", "Inertia at the slew axis", 763.9437268410978, 1e-3, 1e9, nominal=1e3, source="(4.34) with the pole of (5.12)")]  # fmt: skip
    b: Annotated[float, Variable("N.m.s/rad", "Viscous friction", 26661.636066754313, 0.0, 1e12, nominal=1e4, source="(4.34) with the pole of (5.12)")]  # fmt: skip
    A: Annotated[float, Variable("m2", "Cylinder area", 8.4193e-3, 1e-9, 100.0, nominal=1e-2, source="Table 3.1")]  # fmt: skip
    r: Annotated[float, Variable("m", "Pinion radius", 0.1, 1e-6, 100.0, source="Table 3.1")]
    T_tau: Annotated[float, Variable("s", "Correlation time of the disturbance; 1e9: a random walk, 0: none", 1.0, 0.0, 1e9, source="our choice")]  # fmt: skip
    T_beta: Annotated[float, Variable("s", "Correlation time of the sensor's error; 0: none", 0.0, 0.0, 1e9, source="off: without a tracker it cannot be seen")]  # fmt: skip
    l_theta: Annotated[float, Variable("1/s", "Gain of the slew sensor on the angle", 39.7962, -1e6, 1e6, nominal=10.0, source=KALMAN)]  # fmt: skip
    l_omega: Annotated[float, Variable("1/s2", "Gain of the slew sensor on the velocity", 791.869, -1e9, 1e9, nominal=100.0, source=KALMAN)]  # fmt: skip
    l_tau: Annotated[float, Variable("N.m/(rad.s)", "Gain of the slew sensor on the disturbance", 23957567.0, -1e11, 1e11, nominal=1e6, source=KALMAN)]  # fmt: skip
    l_beta: Annotated[float, Variable("1/s", "Gain of the slew sensor on its error", 0.0, -1e6, 1e6, nominal=10.0, source="off: no tracker")]  # fmt: skip
    k_theta: Annotated[float, Variable("1", "Gain of a tracker's reading on the angle", 0.0, -10.0, 10.0, source="off: no tracker")]  # fmt: skip
    k_omega: Annotated[float, Variable("1/s", "Gain of a tracker's reading on the velocity", 0.0, -1e6, 1e6, source="off: no tracker")]  # fmt: skip
    k_tau: Annotated[float, Variable("N.m/rad", "Gain of a tracker's reading on the disturbance", 0.0, -1e11, 1e11, nominal=1e3, source="off: no tracker")]  # fmt: skip
    k_beta: Annotated[float, Variable("1", "Gain of a tracker's reading on the sensor's error", 0.0, -10.0, 10.0, source="off: no tracker")]  # fmt: skip
    at_reading: Annotated[float, Variable("1", "Start: 1 standing at the measured angle, 0 at slew_0 and rate_0", 1.0, 0.0, 1.0, kind="integer", source="starts where the log does")]  # fmt: skip
    slew_0: Annotated[float, Variable("rad", "Estimated angle at the start, where at_reading is 0", 0.0, -1e6, 1e6, display="deg", source="(2.15): the source starts at zero")]  # fmt: skip
    rate_0: Annotated[float, Variable("rad/s", "Estimated velocity at the start, where at_reading is 0", 0.0, -1e3, 1e3, display="deg/s", nominal=0.01, source="(2.15): the source starts at zero")]  # fmt: skip
    tau_0: Annotated[float, Variable("N.m", "Estimated disturbance at the start", 0.0, -1e9, 1e9, nominal=100.0, source="off")]  # fmt: skip
    beta_0: Annotated[float, Variable("rad", "Estimated error of the slew sensor at the start", 0.0, -1e3, 1e3, display="deg", nominal=0.01, source="off")]  # fmt: skip


class Coefficients(NamedTuple):
    """What is left of disturbance and sensor error after the step h, and the functions of b h/J."""

    h: float
    tau: float
    beta: float
    decay: float
    phi1: float
    phi2: float
    phi3: float


@equation
def kept(h: float, T: float) -> float:
    """What is left of a Gauss-Markov state of correlation time T after h: nothing of one that there is not."""
    if T == 0.0:
        return 0.0
    return math.exp(-h / T)


@equation
def start(u: Input, p: Parameters) -> State:
    """Standing at the measured angle less the sensor's error, or where it is told to."""
    theta = u.slew - p.beta_0
    omega = 0.0
    if p.at_reading == 0.0:
        theta = p.slew_0
        omega = p.rate_0
    return State(theta, omega, p.tau_0, p.beta_0, u.p_load)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Over the step h, s."""
    decay, phi1, phi2, phi3 = phi_functions(p.b * h / p.J)
    return Coefficients(h, kept(h, p.T_tau), kept(h, p.T_beta), decay, phi1, phi2, phi3)


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """The motion over one step of length c.h, then the correction by what was read at its end."""
    tau = c.tau * x.tau
    beta = c.beta * x.beta
    theta, omega = slid(
        x.theta, x.omega, p.A * p.r * x.p_load + x.tau, p.A * p.r * u.p_load + tau,
        c.h, p.J, c.decay, c.phi1, c.phi2, c.phi3,
    )  # fmt: skip
    e = u.slew - theta - beta
    theta = theta + c.h * p.l_theta * e
    omega = omega + c.h * p.l_omega * e
    tau = tau + c.h * p.l_tau * e
    beta = beta + c.h * p.l_beta * e
    if u.external_age < 0.0:
        return State(theta, omega, tau, beta, u.p_load)
    d = u.slew_external - theta + omega * u.external_age
    return State(
        theta + p.k_theta * d, omega + p.k_omega * d, tau + p.k_tau * d, beta + p.k_beta * d, u.p_load
    )


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """The state itself."""
    return Output(x.theta, x.omega, x.tau, x.beta)


BLOCK = Block(
    name="observer_extended",
    title="Extended observer of slew angle, velocity, disturbance torque and sensor error",
    module=sys.modules[__name__],
    reads={"p_load": "line", "slew": "instant", "slew_external": "instant", "external_age": "instant"},
    helpers=(phi_functions, slid),
)
