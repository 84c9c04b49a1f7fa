"""How a record begins: whether a signal stands or moves at its first sample, and how fast."""

import numpy as np
from numpy.typing import NDArray

from cosim.inference.thresholds import (
    START_LACK,
    START_PART,
    START_SAMPLES,
    START_SPAN,
    START_STILL,
    START_SURE,
)

Array = NDArray[np.float64]

SAME_INPUT = 1e-6  # of its range, by which an input may differ and still be the same: rounding


def level(values: Array) -> float:
    """First value (n,), or 0 where it is no more than the signal's noise.

    The noise is that of the first differences, so a signal that moves slowly against its samples counts as still.
    """
    first = values[: 5 * START_SAMPLES]
    if first.size < START_SAMPLES:
        return 0.0
    noise = float(np.median(np.abs(np.diff(first)))) / (0.6745 * np.sqrt(2.0))
    return float(first[0]) if abs(first[0]) > START_SURE * noise else 0.0


def speed(time: Array, values: Array) -> float:
    """Speed at the first sample, per s, of values (n,) at increasing times (n,) [s]; 0 where the signal stands there.

    The span is halved until a parabola describes the motion but for noise. A motion that only begins has its parabola's
    slope at the first sample small, or against the motion.
    """
    count = max(START_SAMPLES, int(np.searchsorted(time, time[0] + START_SPAN)))
    if values.size < count or not np.isfinite(values[:count]).all():
        return 0.0
    while True:
        t, first, error, left = parabola(time[:count], values[:count])
        noise = np.diff(values[:count], 3)
        # of white noise third differences have 20 times the variance, of a smooth motion hardly any
        if count == START_SAMPLES or left <= START_LACK * float(np.sqrt(np.mean(noise**2) / 20.0)):
            break
        count = max(START_SAMPLES, count // 2)
    mean = float(np.polyfit(t, values[:count], 1)[0])
    if abs(first) <= START_SURE * error or first * mean <= 0.0 or abs(first) < START_PART * abs(mean):
        return 0.0
    return first / float(time[count - 1] - time[0])


def rests(u: Array, y: Array) -> bool:
    """True if the output (n,) stands until its input (n,), which is constant at first, changes: all before has settled.

    An input that changes from the first sample on, or never, tells nothing of it.
    """
    changed = np.flatnonzero(np.abs(u - u[0]) > SAME_INPUT * np.ptp(u))
    count = int(changed[0]) if changed.size else 0
    if count < START_SAMPLES:
        return False
    first = y[:count]
    noise = float(np.median(np.abs(np.diff(first)))) / (0.6745 * np.sqrt(2.0))
    stretches = y[: y.size // count * count].reshape(-1, count)
    usual = float(np.sqrt(np.mean(np.var(stretches, axis=1))))
    return float(np.std(first)) <= max(START_LACK * noise, START_STILL * usual)


def parabola(time: Array, values: Array) -> tuple[Array, float, float, float]:
    """Times (n,) from 0 to 1, slope at the first, its standard error and RMS of what a parabola leaves of values (n,)."""
    t = (time - time[0]) / (time[-1] - time[0])
    matrix = np.vander(t, 3, increasing=True)
    found = np.linalg.lstsq(matrix, values, rcond=None)[0]
    rest = values - matrix @ found
    variance = float(rest @ rest) / (t.size - 3)
    error = float(np.sqrt(variance * np.linalg.inv(matrix.T @ matrix)[1, 1]))
    return t, float(found[1]), error, float(np.sqrt(variance))
