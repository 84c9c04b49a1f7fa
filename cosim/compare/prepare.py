"""Brings a log onto a uniform step, and finds where its motion starts."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError, UsageError
from cosim.logs.log import Log

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ON_GRID = 0.05  # stamps this part of a step off a uniform grid are taken to lie on it: rounding, not jitter
LEAST_SAMPLES = 10
AT_REST = 0.5  # s, the longest start over which the first value is averaged
AT_ONCE = 0.01  # s, in which nothing moves by more than its noise whatever drives it
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
    mean = float(f"{log.duration / (len(log) - 1):.10g}")
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
    if not len(use):
        return float(values[0]), False
    if len(use) >= LEAST_SAMPLES:
        time = (use - use.mean()) * step
        y = values[use]
        slope = float(time @ (y - y.mean()) / (time @ time))
        rest = y - y.mean() - slope * time
        error = float(np.sqrt(rest @ rest / (len(use) - 2) / (time @ time)))
        if abs(slope) > SIGNIFICANT * error:
            return float(y.mean() - slope * use.mean() * step), True
    return float(values[use].mean()), False
