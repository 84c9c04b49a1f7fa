"""What the instruments make of the true signals: the slew sensor, the observer on the target, the optical tracker."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cosim.rig.jit import cached
from cosim.rig.noise import Noise, stream
from cosim.rig.parameters import DEG, STEP, Plant

Array = NDArray[np.float64]

TRACKER_STEP = 1.0 / 80.0  # s on the tracker's own clock (SYSTEM section 1)
SEAM_ANGLE = 12.0 * DEG  # below it marker model 1, above it model 2 (Table 3.4)


def reading(angle: Array, time: Array, plant: Plant) -> Array:
    """What the slew sensor shows [rad] of the angle [rad] behind its lag at `time` [s]: scale, bias, drift, range."""
    q = plant.sensor
    return np.clip(q.gain * angle + q.bias + q.drift * time, q.low, q.high)


def slew_signal(
    true: dict[str, Array], plant: Plant, noise: Noise, seed: int, passes: Callable[[Array], Array]
) -> Array:
    """The logged slew angle (n,) [rad]: lag, then scale, bias and drift, its range, then noise, rounding, lost packets.

    `true` holds `seen` and `sensed` [rad] of `cosim.rig.integrate.simulate`, at each millisecond; `passes` is what the
    channel goes through between sensor and rounding.
    """
    q = plant.sensor
    time = np.arange(true["seen"].size, dtype=np.float64) * STEP
    angle = true["sensed"] if q.tau_l > 0.0 else true["seen"]
    slew = passes(reading(angle, time, plant) + noise.draw("slew", time.size, seed))
    if q.quantum > 0.0:
        slew = q.quantum * np.round(slew / q.quantum)
    if q.p_drop > 0.0:
        stale = stream(seed, "dropout").random(time.size) < q.p_drop
        stale[0] = False
        slew = slew[np.maximum.accumulate(np.where(stale, 0, np.arange(time.size)))]
    return slew


def observe(u: Array, slew: Array) -> tuple[Array, Array]:
    """Slew [rad] and slew rate [rad/s] estimates, (n,) each, of the 1 kHz observer (2.15, 4.35-4.38) on the target.

    Command `u` [1] and measured `slew` [rad] are held over each millisecond, and the observer is discretised exactly for
    that; the estimate at k ms has seen the samples before it. It starts at the first measured angle, at rest.
    """
    from scipy.signal import cont2discrete

    a = np.array([[-4.4, 0.0], [1.0, 0.0]])
    c = np.array([[0.0, 2.5]])
    gain = np.array([[7.744], [6.16]])
    inputs = np.hstack([np.array([[4.0], [0.0]]), gain])
    a_d, b_d, *_ = cont2discrete((a - gain @ c, inputs, c, np.zeros((1, 2))), STEP, method="zoh")
    states = _filter(np.ascontiguousarray(a_d), np.ascontiguousarray(b_d), u, slew / DEG)
    return 2.5 * DEG * states[:, 1], 2.5 * DEG * states[:, 0]


@cached
def _filter(a: Array, b: Array, u: Array, y: Array) -> Array:
    """States (n, 2) of x[k+1] = a x[k] + b [u[k], y[k]], from rest at y[0]."""
    x = np.empty((u.size, 2))
    x[0, 0], x[0, 1] = 0.0, y[0] / 2.5
    for k in range(u.size - 1):
        for i in range(2):
            x[k + 1, i] = a[i, 0] * x[k, 0] + a[i, 1] * x[k, 1] + b[i, 0] * u[k] + b[i, 1] * y[k]
    return x


def track(seen: Array, plant: Plant, noise: Noise, seed: int) -> tuple[Array, Array]:
    """Stamps [s] on the tracker's own clock and its angles [rad], 80 a second, for all instants inside the log.

    `seen` (n,) [rad] is the angle behind the backlash at each millisecond. A stamp s means the true time offset + rate s.
    """
    stamps, angle = passed(seen, plant)
    angle = angle + np.where(angle < SEAM_ANGLE, plant.tracker.seam, 0.0)
    return stamps, angle + noise.draw("slew_external", stamps.size, seed, TRACKER_STEP)


def passed(seen: Array, plant: Plant) -> tuple[Array, Array]:
    """The tracker's stamps [s] on its own clock and the true angle [rad] at each.

    Between milliseconds the angle is taken as straight: at most 1e-5 deg off at this drive's accelerations.
    """
    q = plant.tracker
    time = np.arange(seen.size) * STEP
    first = math.ceil(-q.offset / (q.rate * TRACKER_STEP) - 1e-9)
    last = math.floor((time[-1] - q.offset) / (q.rate * TRACKER_STEP) + 1e-9)
    stamps = np.arange(first, last + 1) * TRACKER_STEP
    return stamps, np.interp(q.offset + q.rate * stamps, time, seen)
