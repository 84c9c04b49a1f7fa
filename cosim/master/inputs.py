"""What a caller asks for, checked: the grid of communication points, start values, inputs as time series."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.errors import UsageError
from cosim.ssp.system import Value, Variable

Array = NDArray[np.float64]
Series = float | tuple[ArrayLike, ArrayLike]
"""A constant, or (times [s], values), both of shape (m,)."""

# stamps are k * h computed elsewhere: a sample that lies this part of a step late still belongs to its grid point
SLACK = 1e-6
WHOLE = 1e-6  # a stop time this part of a step off the grid is rounding


class Sampler:
    """Checked input series, read at some communication points after the other."""

    def __init__(self, inputs: Mapping[str, Series], time: Array, held: Sequence[bool]) -> None:
        """Check the series against the whole time axis.

        Args:
            inputs: constant or (times, values) by name; times strictly increasing.
            time: communication points [s], shape (n + 1,).
            held: for each input, whether it keeps each value until the next sample, and its value at the START of a
                step counts; otherwise straight lines between samples, and the value at the step's END.

        Raises:
            UsageError: a series is malformed, holds NaN or infinity, or does not cover `time`. A held input may end one
                interval early: its last value is kept.
        """
        self._time, self._slack = time, SLACK * (time[1] - time[0])
        self._held = np.array(held, dtype=bool)
        self._series = [
            _covering(name, series, time, self._slack, hold)
            for (name, series), hold in zip(inputs.items(), held, strict=True)
        ]

    def points(self, first: int, last: int) -> Array:
        """Values at the communication points `first` to `last`, shape (last - first + 1, inputs)."""
        time = self._time[first : last + 1]
        sampled = np.empty((len(time), len(self._series)))
        for k, (series, held) in enumerate(zip(self._series, self._held, strict=True)):
            if isinstance(series, float):
                sampled[:, k] = series
            elif held:
                stamps, values = series
                sampled[:, k] = values[np.searchsorted(stamps, time + self._slack, side="right") - 1]
            else:
                sampled[:, k] = np.interp(time, *series)
        return sampled

    def steps(self, points: Array) -> Array:
        """What is handed over during each step between `points` (m + 1, inputs), shape (m, inputs)."""
        return np.where(self._held, points[:-1], points[1:])


def _covering(
    name: str, series: Series, time: Array, slack: float, held: bool
) -> float | tuple[Array, Array]:
    """A series that is finite and covers `time` [s]."""
    if isinstance(series, (int, float)):
        if not np.isfinite(series):
            raise UsageError(f"input '{name}' is {series}: give a finite number")
        return float(series)
    stamps, values = _checked(name, series)
    if stamps[0] > time[0] + slack:
        raise UsageError(
            f"input '{name}' begins at {stamps[0]:g} s, after the simulation's start at {time[0]:g} s"
        )
    allowed = slack
    if held:
        allowed += max(time[-1] - time[-2], stamps[-1] - stamps[-2] if len(stamps) > 1 else 0.0)
    if stamps[-1] < time[-1] - allowed:
        raise UsageError(
            f"input '{name}' ends at {stamps[-1]:g} s, before the stop time of {time[-1]:g} s: stop earlier"
        )
    return stamps, values


def _checked(name: str, series: Sequence[ArrayLike] | tuple[ArrayLike, ArrayLike]) -> tuple[Array, Array]:
    if len(series) != 2:
        raise UsageError(f"input '{name}' must be a number or (times, values)")
    stamps, values = (np.asarray(part, dtype=np.float64) for part in series)
    if stamps.ndim != 1 or stamps.shape != values.shape or len(stamps) == 0:
        raise UsageError(
            f"input '{name}': times and values must be equally long and not empty, not {stamps.shape}, {values.shape}"
        )
    bad = np.flatnonzero(~(np.isfinite(stamps) & np.isfinite(values)))
    if len(bad):
        raise UsageError(f"input '{name}' is not finite at sample {bad[0]}: repair the data first")
    back = np.flatnonzero(stamps[1:] <= stamps[:-1])
    if len(back):
        k = int(back[0])
        raise UsageError(
            f"input '{name}': time does not increase from sample {k} ({stamps[k]:g} s) to {stamps[k + 1]:g} s"
        )
    return stamps, values


def time_grid(start: float, stop: float, step: float, partial: bool) -> tuple[Array, int, list[str]]:
    """Communication points start + k step, the last one exactly `stop`.

    Returns:
        (points [s] of shape (n + 1,), number of whole steps, notes).

    Raises:
        UsageError: the times make no sense, or the span is no multiple of the step and `partial` is not allowed.
    """
    if not (np.isfinite([start, stop, step]).all() and step > 0.0 and stop > start):
        raise UsageError(
            f"cannot simulate from {start} s to {stop} s in steps of {step} s: stop > start, step > 0 needed"
        )
    ratio = (stop - start) / step
    if ratio > 1e9:
        raise UsageError(f"{ratio:.3g} steps are too many: choose a larger step size than {step:g} s")
    whole = round(ratio)
    if whole >= 1 and abs(ratio - whole) <= WHOLE:
        grid: Array = start + np.arange(whole + 1, dtype=np.float64) * step
        grid[-1] = stop
        return grid, whole, []
    whole = int(ratio)
    if not partial:
        near = [f"{start + k * step:.12g} s" for k in (whole, whole + 1) if k]
        raise UsageError(
            f"the time from {start:g} s to {stop:g} s is no multiple of the step size {step:g} s: "
            f"stop at {' or '.join(near)}, or allow a shorter last step"
        )
    grid = np.append(start + np.arange(whole + 1, dtype=np.float64) * step, stop)
    return (
        grid,
        whole,
        [f"the last step is {stop - grid[-2]:.6g} s long instead of {step:g} s, to end at {stop:g} s"],
    )


def checked_value(name: str, value: Value, variable: Variable) -> Value:
    """A value of the variable's type.

    Raises:
        UsageError: the types do not fit, or a number is not finite.
    """
    kind = variable.kind
    if kind == "String" and isinstance(value, str):
        return value
    if kind == "Boolean" and (isinstance(value, (bool, np.bool_)) or value in (0, 1)):
        return bool(value)
    number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if kind == "Real" and number:
        if not np.isfinite(value):
            raise UsageError(f"'{name}' = {value} is not a finite number")
        return float(value)
    if kind in ("Integer", "Enumeration") and number and float(value).is_integer():
        return int(value)
    raise UsageError(f"'{name}' is of type {kind}; {value!r} is not")
