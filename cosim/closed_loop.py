"""Margins of a position loop from the parameters of its components, and the limit cycles of its dead zone and its friction.

As a linear loop, cut at the command:

    G(s) = K w0^2 / (s^2 + 2 zeta w0 s + w0^2)  K_c / (T s + 1)  A r / (s (J s + b))        (4.16), (4.33), (4.28)
    u = -(k_p + k_i/s) theta - k_d omega,  omega by the observer (2.15), theta by the sensor or by the observer

Compensator and dead zone are taken to cancel there (form 2 does; the tanh of form 3 leaves a dead band of -3.18 % to +3.28 %
of command), the sensor as exact. Held for 1 ms and half a millisecond old on
average, the command costs 0.03 deg of phase for each rad/s of crossover, which is left out.

Where they do not cancel, their joint curve f has the describing function N(A) of a sine of amplitude A, and the loop swings
by itself at the amplitude at which N(A) uses up the gain margin (Gelb and Vander Velde, Multiple-Input Describing Functions,
1968, ch. 3): N(A) = 1/(pi A) integral of f(A sin p) sin p over a turn. It is stable where N falls with A.

Dry friction makes no such oscillation: for a sine it is more damping. With an integral it makes one that sticks (Olsson and
Astrom, Friction generated limit cycles, IEEE Trans. Control Systems Technology 9(4), 2001), which is found in a simulation.
"""

import math
from typing import Any

import control
import numpy as np

from cosim.compare.observer import lag_of
from cosim.results import Result
from cosim.ssp.system import Port, System
from fmus import controller, dead_zone, observer
from fmus.contract import fields

BLOCKS = ("controller", "dcv", "continuity", "mechanical", "observer")
DEG = math.pi / 180.0


def is_loop(system: System) -> bool:
    """Whether the system is a controller around the full-order drive."""
    return all(name in system.components for name in BLOCKS)


def drive(system: System) -> Any:
    """Transfer function of the drive from command [1] to angle [rad]."""
    v, c, m = (values(system, name) for name in ("dcv", "continuity", "mechanical"))
    valve = control.tf([v["K"] * v["w0"] ** 2], [1.0, 2.0 * v["zeta"] * v["w0"], v["w0"] ** 2])
    pressure = control.tf([c["K_c"]], [c["T"], 1.0])
    return valve * pressure * control.tf([m["A"] * m["r"]], [m["J"], m["b"], 0.0])


def feedback(system: System) -> Any:
    """Transfer function of the controller from angle [rad] to minus the command [1], the observer within."""
    gains, own = values(system, "controller"), values(system, "observer")
    declared = fields(observer.Parameters)  # a package of an earlier version lacks some
    p = observer.Parameters(*(own.get(name, v.start) for name, v in declared.items()))
    estimated = Port("observer", "slew_estimate") in {
        w.source for w in system.wires if w.target == Port("controller", "slew")
    }
    k_p, k_d, k_i = gains["k_p"], gains["k_d"], gains["k_i"]
    A, B, C = np.array([[-p.a, 0.0], [1.0, 0.0]]), np.array([[p.k], [0.0]]), np.array([[0.0, p.c]])
    L = np.array([[gain] for gain in observer.gains(p)])
    K = np.array([[k_d * p.c, k_p * p.c if estimated else 0.0]])
    direct = 0.0 if estimated else k_p
    A, B_in = A - L @ C - B @ K, L - B * direct
    if k_i != 0.0:  # of the angle that is fed back
        summed, at_once = (np.array([[0.0, p.c]]), 0.0) if estimated else (np.zeros((1, 2)), 1.0)
        A = np.block([[A, -k_i * B], [summed, np.zeros((1, 1))]])
        B_in, K = np.vstack([B_in, [[at_once]]]), np.hstack([K, [[k_i]]])
    return control.tf(control.ss(A, B_in, K, [[direct]]))


def values(system: System, component: str) -> dict[str, float]:
    """Parameters of a component, SI: those the package binds over the FMU's own."""
    found = system.components[component]
    own = {n: v.start for n, v in found.fmu.variables.items() if v.causality == "parameter"}
    return {n: float(v) for n, v in {**own, **found.starts}.items() if isinstance(v, (int, float))}


def margins(system: System) -> dict[str, Any]:
    """Gain and phase margin of the loop, and the gain on the angle at which it begins to swing by itself.

    Returns:
        ``gain_margin`` (a factor on all gains together) and ``gain_margin_db``, ``phase_margin`` [deg] at ``crossover``
        [rad/s], ``gain`` and ``gain_limit`` [1/deg]: k_p, and k_p where the gain margin is used up, at ``limit_frequency``
        [rad/s]; ``stable``.
    """
    loop = feedback(system) * drive(system)
    gain, phase, swing, crossover = (float(value) for value in control.margin(loop))
    k_p = values(system, "controller")["k_p"] * DEG
    poles = control.poles(control.feedback(loop, 1.0))
    return {
        "gain": k_p,
        "gain_limit": k_p * gain,
        "limit_frequency": swing,
        "gain_margin": gain,
        "gain_margin_db": 20.0 * math.log10(gain) if gain > 0.0 else -math.inf,
        "phase_margin": phase,
        "crossover": crossover,
        "stable": bool(poles.real.max() < 0.0),
    }


AMPLITUDES = np.geomspace(1e-4, 1.2, 120)  # of the command, 1
_TURN = (np.arange(720) + 0.5) * (2.0 * math.pi / 720)


def curve(system: System, command: float) -> float:
    """What the valve's loop gets [1] of a command [1]: the controller's own inverse, the compensator, the dead zone."""
    gains = controller.Parameters(**values(system, "controller"))
    found = controller.inverse(command, gains)
    for name in ("compensator", "dead_zone"):
        own = values(system, name)
        found = dead_zone.limited(
            found, dead_zone.Parameters(**{n: own[n] for n in dead_zone.Parameters._fields})
        )
    return found


def describing_function(system: System, amplitudes: Any) -> Any:
    """N of the joint curve for sines of these amplitudes (n,) [1], between which the curve is interpolated."""
    grid = np.concatenate([-np.geomspace(1.3, 1e-6, 2000), [0.0], np.geomspace(1e-6, 1.3, 2000)])
    shape = np.array([curve(system, float(u)) for u in grid])
    sine = np.sin(_TURN)
    return np.array([2.0 / a * np.mean(np.interp(a * sine, grid, shape) * sine) for a in amplitudes])


def limit_cycle(system: System) -> dict[str, float] | None:
    """The swing that the dead zone and its inverse keep up, or None where they keep up none.

    Returns:
        Amplitudes of the command ``command`` [1] and of the angle ``angle`` [deg], and ``frequency`` [rad/s].
    """
    loop = margins(system)
    gain = describing_function(system, AMPLITUDES)
    falling = np.flatnonzero((gain[:-1] >= loop["gain_margin"]) & (gain[1:] < loop["gain_margin"]))
    if not falling.size or not loop["stable"]:
        return None
    k = int(falling[-1])
    part = (gain[k] - loop["gain_margin"]) / (gain[k] - gain[k + 1])
    amplitude = float(AMPLITUDES[k] * (AMPLITUDES[k + 1] / AMPLITUDES[k]) ** part)
    response = abs(complex(drive(system)(1j * loop["limit_frequency"])))
    angle = loop["gain_margin"] * amplitude * response / DEG
    return {"command": amplitude, "angle": angle, "frequency": loop["limit_frequency"]}


def tracking(result: Result) -> dict[str, float] | None:
    """How the measured angle follows the reference, or None where a result has not both.

    Returns:
        ``rmse`` and ``largest`` error [deg], ``lag`` [s] by which the angle trails (NaN where nothing moves), ``effort``,
        the root mean square of the command [1].
    """
    names = ("reference.reference", "sensor.slew", "controller.u")
    if not all(name in result.signals for name in names) or result.time.size < 8:
        return None
    wanted, slew, u = (result.signals[name] for name in names)
    error = (slew - wanted) / DEG
    return {
        "rmse": float(np.sqrt(np.mean(error**2))),
        "largest": float(np.abs(error).max()),
        "lag": lag_of(slew, wanted, result.step_size),
        "effort": float(np.sqrt(np.mean(u**2))),
    }


LASTS = (
    0.9  # size in the last quarter of the time in which the reference stands, of that in the quarter before
)
FEWEST_TURNS = 4  # in these two: two whole swings
STANDS = 0.5  # share of the time at rest, from which on it is friction that makes the swing


def swing(result: Result) -> dict[str, float] | None:
    """The swing that a run keeps up while its reference stands; None for none, or where the reference stands too briefly.

    Returns:
        ``angle`` [deg], half its peak to peak, ``period`` [s], ``command``, the largest [1], and ``at_rest``, the share of
        the time in which the column stands.
    """
    names = ("reference.reference", "sensor.slew", "controller.u", "mechanical.omega")
    if not all(name in result.signals for name in names):
        return None
    wanted, slew, u, omega = (result.signals[name] for name in names)
    moved = np.flatnonzero(wanted != wanted[-1])
    first = int(moved[-1]) + 1 if moved.size else 0
    quarter = (wanted.size - first) // 4
    if quarter < 2:
        return None
    slew, u, omega = (signal[-2 * quarter :] for signal in (slew, u, omega))
    if not np.ptp(slew[quarter:]) >= LASTS * np.ptp(slew[:quarter]) > 0.0:
        return None
    going = np.flatnonzero(omega)
    turns = going[1:][np.diff(np.sign(omega[going])) != 0.0]
    if turns.size < FEWEST_TURNS:
        return None
    return {
        "angle": 0.5 * float(np.ptp(slew)) / DEG,
        "period": 2.0 * float(turns[-1] - turns[0]) / (turns.size - 1) * result.step_size,
        "command": float(np.abs(u).max()),
        "at_rest": float(np.mean(omega == 0.0)),
    }


def why(found: dict[str, float]) -> str:
    """What makes a swing, in words."""
    if found["at_rest"] > STANDS:
        return (
            f"the column stands for {found['at_rest']:.0%} of the time, held by dry friction until the command has grown "
            "enough, and then goes too far: less k_i, or a controller without it"
        )
    if found["command"] > 0.99:
        return (
            "the command goes from limit to limit: the loop is beyond its gain limit, which cosim info prints"
        )
    return "the compensator gives more than the dead zone takes, or the gain margin is used up: cosim info says which"
