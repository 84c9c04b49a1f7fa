"""How a record begins: whether a signal stands or moves at its first sample, and how fast."""

import numpy as np
from numpy.typing import NDArray

from cosim.inference.thresholds import (
    START_HANGS,
    START_LACK,
    START_PART,
    START_SAMPLES,
    START_SPAN,
    START_STILL,
    START_SURE,
)

Array = NDArray[np.float64]

PARTED = 4  # a span's third differences reach over three parts of it
THIRD = np.array([-1.0, 3.0, -3.0, 1.0])
SAME_INPUT = 1e-6  # of its range, by which an input may differ and still be the same: rounding


def level(values: Array, h: float) -> float:
    """First value (n,), or 0 where it is no more than the signal's noise, of values (n,) every `h` s."""
    first = values[: 5 * START_SAMPLES]
    if first.size < START_SAMPLES:
        return 0.0
    noise = max(scatter(first, 1), scatter(first, parted(first.size, h)))
    return float(first[0]) if abs(first[0]) > START_SURE * noise else 0.0


def scatter(values: Array, apart: int) -> float:
    """Standard deviation of the noise of values (n,), by third differences of values so many samples apart.

    A smooth motion hardly shows in them; noise that hangs together for some samples shows the more the further apart.
    """
    return float(np.median(np.abs(values[third(values.size, apart)] @ THIRD))) / (0.6745 * np.sqrt(20.0))


def third(count: int, apart: int) -> NDArray[np.int64]:
    """(k, 4) numbers of the samples of each third difference of `count` samples, `apart` of one another."""
    return np.arange(count - 3 * apart)[:, None] + apart * np.arange(4)


def parted(count: int, h: float) -> int:
    """Samples every `h` s in a part of `count` of them, or of the longest span in which a motion is smooth."""
    return max(1, min(count, round(START_SPAN / h)) // PARTED)


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
    span = float(time[count - 1] - time[0])
    wanders = hanging(values[: 5 * count], count, span / (count - 1))
    error = max(error, error / max(left, 1e-300) * wanders)
    if abs(first) <= START_SURE * error or first * mean <= 0.0 or abs(first) < START_PART * abs(mean):
        return 0.0
    return first / span


def hanging(values: Array, count: int, h: float) -> float:
    """Noise of so many independent samples that errs a parabola's slope as much as that of values (n,) every `h` s.

    Filtered readings wander: for a few samples that is a slope. Of noise whose scatter grows with the distance as many
    of `count` samples are independent as the scatter of neighbours leaves of that of samples a part of the span apart.
    """
    near, far = scatter(values, 1), scatter(values, parted(count, h))
    if far <= START_HANGS * near:
        return near
    return far * float(np.sqrt(count / max(PARTED, count * (near / far) ** 2)))


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
