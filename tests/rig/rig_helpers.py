"""Commands and exact references that the rig's tests share."""

import numpy as np
from scipy.signal import cont2discrete, lsim

from cosim.rig import make_log
from cosim.rig.parameters import BAR, DEG

STEP = 1e-3
# one hundredth of the sensors' noise: what the integration may be off by
SPOOL, PRESSURE, ANGLE = 0.005e-5, 1e-3 * BAR, 1e-4 * DEG
LEVER = 8419.3e-6 * 0.1  # m3: torque per load pressure
B, J = 34.9 * 763.94, 763.94


def held(*pieces):
    """A command of (level, seconds) pieces."""
    return np.concatenate([np.full(round(seconds / STEP), float(level)) for level, seconds in pieces])


def lively(seconds=6.0):
    """Steps that reach the stops, a ramp, small motion and a sine: every effect has something to act on."""
    t = np.arange(round(seconds / STEP)) * STEP / seconds * 6.0
    steps = np.select([t < 0.7, t < 1.4, t < 1.7], [1.0, -1.0, 0.0], 0.0)
    ramp = np.where((t >= 1.7) & (t < 3.7), 1.0 - 2.0 * np.abs((t - 1.7) / 2.0 * 2.0 - 1.0), 0.0)
    small = np.where((t >= 3.7) & (t < 4.7), 0.08 * np.sign(np.sin(9.0 * t)), 0.0)
    sine = np.where(t >= 4.7, 0.8 * np.sin(11.0 * (t - 4.7)), 0.0)
    return steps + ramp + small + sine


def clean(u, *hidden, **options):
    """A log without noise."""
    return make_log(np.asarray(u, dtype=float), hidden=hidden, noise=0, **options)


def follows(numerator, denominator, values, start=0.0):
    """Response to values joined by straight lines (first-order hold), offset by `start`."""
    t = np.arange(values.size) * STEP
    return start + lsim((numerator, denominator), values, t)[1]


def zero_order(numerator, denominator, u):
    """Exact response at the samples to a command held over each of them, from rest."""
    from scipy.signal import tf2ss

    a, b, c, d = tf2ss(numerator, denominator)
    a, b, c, d, _ = cont2discrete((a, b, c, d), STEP, method="zoh")
    x, out = np.zeros(a.shape[0]), np.empty(u.size)
    for k, value in enumerate(u):
        out[k] = c[0] @ x + d[0, 0] * value
        x = a @ x + b[:, 0] * value
    return out
