"""Logs sampled far faster than anything in them moves: fewer samples say the same, and each run takes less.

How far apart samples may be is asked of the readings, whose noise alone may be lost, and of the model as it is, which must
give the same with the inputs made as coarse.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from cosim.anysystem.model import Segment
from cosim.compare.metrics import white_noise

Array = NDArray[np.float64]
ENOUGH = 3000  # samples of the longest log: they describe what a log of that length can tell
NOISE_ALONE = 1.1  # times a reading's white noise: what may be lost of it
SAME = 1e-3  # of a signal's spread: two programs that integrate one model differ by that
LITTLE = 0.01  # of it, that a reading may lose where a run takes too long: more is lost by a part of the log


def averaged(series: Array, every: int) -> Array:
    """A series (n,) at every so many samples, each the mean of those around it, the nearest counting most.

    Straight lines between the means enclose what those between the samples do, and nothing overshoots.
    """
    weights = np.bartlett(2 * every + 1) / every
    return np.asarray(convolve1d(series, weights, mode="nearest")[::every])


def held(series: Array, every: int) -> Array:
    """A series (n,) whose values hold until the next sample, as means (m,) that hold so much longer."""
    starts = np.arange(0, series.size, every)
    return np.asarray(np.add.reduceat(series, starts) / np.diff(np.append(starts, series.size)))


def thinned(segment: Segment, every: int, real: Mapping[str, bool]) -> Segment:
    """A log with every so many samples; what is whole, true or false is as it is at these.

    Args:
        segment: the log.
        every: samples that one stands for; of a short log fewer, as `share` says.
        real: signal -> whether it is a real number.
    """
    every = share(segment, every)
    if every == 1:
        return segment
    signals = {}
    for name, values in segment.signals.items():
        if not real.get(name, True):
            signals[name] = values[::every]
        elif name in segment.steps:
            signals[name] = held(values, every)
        else:
            signals[name] = averaged(values, every)
    count = next(iter(signals.values())).size
    stamps = segment.stamps if segment.stamps.size else np.arange(segment.count, dtype=np.float64)
    return replace(
        segment,
        h=float(f"{every * segment.h:.12g}"),
        signals=signals,
        missing={n: lost[::every][:count] for n, lost in segment.missing.items()},
        fitted=segment.fitted[::every][:count],
        windows=segment.windows[::every][:count],
        recorded=segment.recorded or dict(segment.signals),
        stamps=stamps / every,
    )


def factors(segments: Sequence[Segment]) -> list[int]:
    """How many samples one may stand for, the most first."""
    found, every = [], max(s.count for s in segments) // ENOUGH
    while every > 1:
        found.append(every)
        every = 2 * every // 3
    return found


def share(segment: Segment, every: int) -> int:
    """How many samples of a log one stands for where it is so many in the longest log."""
    return max(min(every, segment.count // ENOUGH), 1)


def loses(series: Array, every: int) -> float:
    """What a reading (n,) loses beyond its white noise, in parts of its spread."""
    kept = np.interp(np.arange(series.size), np.arange(0, series.size, every), averaged(series, every))
    lost = float(np.sqrt(np.mean((series - kept) ** 2)))
    return max(lost - NOISE_ALONE * white_noise(series), 0.0) / max(float(np.std(series)), 1e-300)


def alike(full: Array, coarse: Array, every: int) -> bool:
    """Whether a model's output (n,) is what it gives (m,) with inputs and steps so much coarser.

    But for the moment within a sample at which it is read, which every hypothesis fits.
    """
    differ = averaged(full, every) - coarse
    speed = np.gradient(coarse)
    moment = float(np.clip(speed @ differ / max(float(speed @ speed), 1e-300), -1.0, 1.0))
    left = differ - moment * speed
    return float(np.sqrt(np.mean(left**2))) <= SAME * max(float(np.std(full)), 1e-300)
