"""Slew mechanics with dry friction by scipy's solve_ivp, one call a phase: an independent reference for events."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

J, B, AR = 763.9437268410978, 26661.636066754313, 8.4193e-3 * 0.1


def reference(
    times: Sequence[float],
    torques: Sequence[float],
    level: Callable[[float], float],
    load: Callable[[float, float], float] = lambda theta, omega: 0.0,
    b: float = B,
    omega: float = 0.0,
) -> np.ndarray:
    """(angle, velocity) at each time but the first; the driving torque is straight between them.

    Args:
        times: s.
        torques: driving torque at each time, N m.
        level: dry friction torque at a speed, N m.
        load: torque against positive motion at an angle and velocity, N m.
        b: viscous friction, N m s/rad.
        omega: velocity at the start, rad/s.
    """
    rows, theta = [], 0.0
    for (t0, t1), (q0, q1) in zip(itertools.pairwise(times), itertools.pairwise(torques), strict=True):
        now = t0

        def drive(t: float, t0: float = t0, t1: float = t1, q0: float = q0, q1: float = q1) -> float:
            return q0 + (q1 - q0) * (t - t0) / (t1 - t0)

        while t1 - now > 1e-13:
            push = drive(now) - load(theta, 0.0)
            # a rate decides where the push is exactly what friction holds: an event has just been found
            sign = np.sign(omega) if omega != 0.0 else np.sign(push) * (abs(push) > level(0.0) * (1 - 1e-12))
            if (
                omega == 0.0
                and abs(abs(push) - level(0.0)) <= 1e-9 * level(0.0)
                and np.sign(push) * (q1 - q0) <= 0.0
            ):
                sign = 0.0

            def rates(t: float, y: np.ndarray, sign: float = sign) -> list[float]:
                if sign == 0.0:
                    return [0.0, 0.0]
                return [y[1], (drive(t) - load(y[0], y[1]) - b * y[1] - sign * level(y[1])) / J]

            def stops(t: float, y: np.ndarray, sign: float = sign) -> float:
                return sign * y[1]

            def breaks(t: float, y: np.ndarray) -> float:
                return level(0.0) - abs(drive(t) - load(y[0], 0.0))

            event = breaks if sign == 0.0 else stops
            event.terminal, event.direction = True, -1
            tight = {"rtol": 1e-12, "atol": 1e-14, "max_step": 0.02}
            found = solve_ivp(rates, (now, t1), [theta, omega], "DOP853", events=event, **tight)
            now, (theta, omega) = found.t[-1], found.y[:, -1]
            if sign == 0.0 or found.status == 1:
                omega = 0.0
        rows.append((theta, omega))
    return np.array(rows)
