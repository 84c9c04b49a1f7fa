"""Brings a log onto a uniform step, and finds where its motion starts."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError, UsageError
from cosim.logs.log import Log, whole_interval

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ON_GRID = 0.05  # stamps this part of a step off a uniform grid are taken to lie on it: rounding, not jitter
LEAST_SAMPLES = 10
AT_REST = 0.5  # s, the longest start over which the first value is averaged
AT_ONCE = 0.01  # s, in which nothing moves by more than its noise whatever drives it
CUBIC = 0.1  # s, in which a motion is a cubic
PART = 0.3  # of the mean speed: less than that at the first sample is no motion there
SIGNIFICANT = 5.0  # standard errors of a slope that make it a motion


def on_grid(log: Log, step: float | None = None) -> tuple[Log, float, list[str]]:
    """A log on the grid ``time[0] + k step``.

    Args:
        log: as loaded.
        step: [s]; by default the log's own.

    Returns:
        The log, its step [s], and notes of what was done.

    Raises:
        UsageError: the step does not fit the log.
        DataError: the log is too short.
    """
    notes = list(log.warnings)
    if log.time_unit != "s":
        notes.append("the log has no time: one sample counts as 1 s")
    # the mean interval: a median of rounded stamps would drift off them
    mean = whole_interval(float(f"{log.duration / (len(log) - 1):.10g}"), len(log))
    grid = log.time[0] + np.arange(len(log)) * mean
    uniform = bool(np.max(np.abs(log.time - grid)) <= ON_GRID * mean)
    wanted = (mean if uniform else log.step) if step is None else step
    if not (np.isfinite(wanted) and wanted > 0.0):
        raise UsageError(f"a step size of {wanted} s cannot be simulated: give a positive one")
    if uniform and abs(wanted - mean) <= 1e-9 * mean:
        result = dataclasses.replace(log, time=grid)
    else:
        result = log.resample(wanted)
        cause = "its sampling is irregular" if step is None else "the step size asks for it"
        notes.append(f"the log was resampled to a step of {wanted:.6g} s, since {cause}")
    if len(result) < LEAST_SAMPLES:
        raise DataError(
            f"{log.source}: {len(result)} samples at a step of {wanted:g} s are too few to compare"
        )
    return result, wanted, notes


def first_value(values: Array, valid: Mask, drives: list[Array], step: float) -> tuple[float, bool]:
    """Where a signal starts, its noise averaged out as far as the drive stands still.

    Args:
        values: (n,) the signal.
        valid: (n,) False where it was filled in.
        drives: the signals (n,) that move it.
        step: [s].

    Returns:
        The value at the first sample, and whether the signal was moving there.
    """
    still = int(AT_ONCE / step) + 1
    limit = min(len(values), int(AT_REST / step) + 1)
    if drives:
        changes = [np.flatnonzero(drive[:limit] != drive[0]) for drive in drives]
        still = max(still, min(int(c[0]) if len(c) else limit for c in changes))
    use = np.flatnonzero(valid[:still])
    if len(use) < LEAST_SAMPLES:
        return (float(values[use].mean()) if len(use) else float(values[0])), False
    _, slope, error = _polynomial(np.asarray(use * step, dtype=np.float64), values[use], 1)
    if abs(slope) <= SIGNIFICANT * error:
        return float(values[use].mean()), False
    early = use[: max(LEAST_SAMPLES, int(CUBIC / step) + 1)]
    first, *_ = _polynomial(np.asarray(early * step, dtype=np.float64), values[early], 3)
    _, speed, error = _polynomial(np.asarray(use * step, dtype=np.float64), values[use], 2)
    # a drive that is switched on at the first sample starts at rest, however fast it is soon after
    return first, abs(speed) > max(SIGNIFICANT * error, PART * abs(slope))


def _polynomial(time: Array, values: Array, degree: int) -> tuple[float, float, float]:
    """Value and slope at time 0, and the slope's standard error, of a least-squares polynomial through values (n,)."""
    scale = float(time[-1])
    matrix = np.vander(time / scale, degree + 1, increasing=True)
    found, *_ = np.linalg.lstsq(matrix, values, rcond=None)
    rest = values - matrix @ found
    variance = float(rest @ rest) / (len(values) - degree - 1)
    spread = np.linalg.inv(matrix.T @ matrix)[1, 1]
    return float(found[0]), float(found[1]) / scale, math.sqrt(variance * spread) / scale
