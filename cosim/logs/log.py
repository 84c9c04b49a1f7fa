"""What a loaded log is: SI signals on a strictly increasing time, and what was done to get there."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError, UsageError
from cosim.logs.source import closest

if TYPE_CHECKING:
    import pandas as pd

    from cosim.plots import Backend

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_UNIFORM = (
    0.01  # largest deviation of an interval, in median intervals; stamps rounded to 10 us at 1 kHz still pass
)

_DRIFT = 0.01  # intervals by which all samples together may miss a round interval


def whole_interval(interval: float, count: int) -> float:
    """An interval as its logger was set: the round number that it is of all samples to a hundredth of one.

    A clock's rounding makes 10 ms 10.0001 ms. An FMU may take steps of 10 ms only, and logs of one logger have one interval.

    Args:
        interval: between samples [s].
        count: of samples.
    """
    for digits in (1, 2, 3):
        rounded = float(f"{interval:.{digits}g}")
        if abs(rounded - interval) * count <= _DRIFT * interval:
            return rounded
    return interval


@dataclass(frozen=True)
class Gap:
    """An interval in which samples are missing.

    Attributes:
        start: stamp before it [s].
        stop: stamp after it [s].
    """

    start: float
    stop: float


@dataclass(frozen=True)
class _Record:
    """What a log and a tracker's record share."""

    time: Array
    source: Path
    warnings: tuple[str, ...]
    synthetic: bool
    sha256: str

    @cached_property
    def step(self) -> float:
        """Median interval between samples [s], to 12 digits: a difference of two stamps carries no more."""
        return float(f"{np.median(np.diff(self.time)):.12g}")

    @cached_property
    def uniform(self) -> bool:
        """Whether every interval is the median one, to 1 %."""
        intervals = np.diff(self.time)
        return bool(max(intervals.max() - self.step, self.step - intervals.min()) <= _UNIFORM * self.step)

    @property
    def name(self) -> str:
        """The file's name without its suffix."""
        return self.source.stem

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True)
class Log(_Record):
    """A log.

    Attributes:
        time: stamps (n,) [s], strictly increasing, n >= 2.
        source: the file.
        warnings: what was repaired, left out or looks wrong, one sentence each.
        synthetic: True for a log made by the virtual rig.
        sha256: of the file.
        signals: signal -> values (n,) in SI, all finite.
        units: signal -> its SI unit.
        display: signal -> the unit in which people read it.
        held: the signals that are constant between samples.
        valid: signal -> mask (n,), False where a missing value was filled; only signals that have such places.
        gaps: intervals in which samples are missing.
        time_unit: ``s``, or ``sample`` where the interval is not known.
        model: model that the mapping names, or None.
    """

    signals: dict[str, Array]
    units: dict[str, str]
    display: dict[str, str]
    held: frozenset[str] = frozenset()
    valid: dict[str, Mask] = field(default_factory=dict)
    gaps: tuple[Gap, ...] = ()
    time_unit: str = "s"
    model: str | None = None

    def __contains__(self, name: str) -> bool:
        return name in self.signals or (name == "p_load" and {"p_a", "p_b"} <= self.signals.keys())

    def __getitem__(self, name: str) -> Array:
        """A signal (n,) [SI]; `p_load` is derived.

        Raises:
            DataError: the log does not hold it.
        """
        return self.require(name)

    def require(self, name: str, why: str = "") -> Array:
        """A signal (n,) [SI] that something depends on.

        Args:
            name: the signal; `p_load` is derived from `p_a` and `p_b`.
            why: what cannot be judged without it, e.g. ``the mechanics``.

        Raises:
            DataError: the log does not hold it.
        """
        if name == "p_load" and name in self and name not in self.signals:
            return self.p_load
        if name in self.signals:
            return self.signals[name]
        needed = ("p_a", "p_b") if name == "p_load" else (name,)
        missing = [f"'{part}'" for part in needed if part not in self.signals]
        purpose = f": without it {why} cannot be judged" if why else ""
        raise DataError(
            f"{self.source}: the log has no signal {' and '.join(missing)}{purpose}"
            f"{closest(name, list(self.signals))} (it holds {', '.join(self.signals)})"
        )

    @property
    def p_load(self) -> Array:
        """Load pressure ``p_a - p_b`` (n,) [Pa] (4.21).

        Raises:
            DataError: one of the two is missing.
        """
        return self.require("p_a", "the load pressure") - self.require("p_b", "the load pressure")

    def valid_mask(self, name: str) -> Mask:
        """Mask (n,): False where a missing value of the signal was filled.

        Raises:
            DataError: the log does not hold the signal.
        """
        if name == "p_load" and name not in self.signals:
            return self.valid_mask("p_a") & self.valid_mask("p_b")
        self.require(name)
        return self.valid.get(name, np.ones(len(self), dtype=bool))

    def slice(self, start: float | None = None, stop: float | None = None) -> "Log":
        """The samples with ``start <= time < stop`` [s], as views of the same arrays; time is not shifted.

        Raises:
            UsageError: fewer than two samples are left.
        """
        first = 0 if start is None else int(np.searchsorted(self.time, start, "left"))
        last = len(self) if stop is None else int(np.searchsorted(self.time, stop, "left"))
        if last - first < 2:
            raise UsageError(
                f"{self.source}: fewer than two samples between {start} and {stop} s; the log runs from"
                f" {self.time[0]:g} to {self.time[-1]:g} s"
            )
        part = slice(first, last)
        low, high = self.time[first], self.time[last - 1]
        return dataclasses.replace(
            self,
            time=self.time[part],
            signals={name: values[part] for name, values in self.signals.items()},
            valid={name: mask[part] for name, mask in self.valid.items()},
            gaps=tuple(gap for gap in self.gaps if gap.start >= low and gap.stop <= high),
        )

    def resample(self, step: float) -> "Log":
        """The log on the grid ``time[0] + k step``: held signals hold, the others follow straight lines.

        A filled sample, and one inside a gap, is marked in `valid` of the result. Nothing is filtered: going to a
        coarser grid folds what is faster than it.

        Args:
            step: interval [s].

        Raises:
            UsageError: the step is not positive, or longer than the log.
        """
        if not (np.isfinite(step) and 0 < step <= self.duration):
            raise UsageError(f"a step of {step} s does not fit a log of {self.duration:g} s")
        count = int(np.floor(self.duration / step * (1 + 1e-12) + 1e-9)) + 1
        grid = self.time[0] + np.arange(count) * step
        # a grid point that differs from a stamp by rounding only belongs to that stamp
        before = np.searchsorted(self.time, grid + 1e-6 * min(step, self.step), "right") - 1
        after = np.minimum(
            np.searchsorted(self.time, grid - 1e-6 * min(step, self.step), "left"), len(self) - 1
        )
        inside = np.zeros(count, dtype=bool)
        for gap in self.gaps:
            inside |= (self.time[before] <= gap.start) & (self.time[after] >= gap.stop)
        signals = {
            name: values[before] if name in self.held else np.interp(grid, self.time, values)
            for name, values in self.signals.items()
        }
        valid = {name: self._valid_on(name, before, after) & ~inside for name in self.signals}
        return dataclasses.replace(
            self,
            time=grid,
            signals=signals,
            valid={name: mask for name, mask in valid.items() if not mask.all()},
        )

    def _valid_on(self, name: str, before: NDArray[np.intp], after: NDArray[np.intp]) -> Mask:
        mask = self.valid_mask(name)
        return mask[before] if name in self.held else mask[before] & mask[after]

    def in_display_units(self, name: str) -> Array:
        """A signal in the unit in which people read it: ``display[name]``.

        Raises:
            DataError: the log does not hold it.
        """
        from cosim.signals import conversion

        return self.require(name) / conversion(self.display[name], self.units[name])

    def to_frame(self, si: bool = False) -> "pd.DataFrame":
        """A pandas table with a column ``name [unit]`` for each signal, ``time [s]`` first.

        Args:
            si: in SI instead of the units people read.
        """
        import pandas as pd

        columns = {"time [s]": self.time}
        for name in self.signals:
            unit = self.units[name] if si else self.display[name]
            columns[f"{name} [{unit}]"] = self.signals[name] if si else self.in_display_units(name)
        frame = pd.DataFrame(columns)
        frame.attrs.update(source=str(self.source), synthetic=self.synthetic, warnings=list(self.warnings))
        return frame

    def plot(self, backend: "Backend" = "auto") -> Any:
        """Every signal over time in the unit people read; a plotly or matplotlib figure."""
        from cosim.plots import draw

        kind = "synthetic log" if self.synthetic else "log"
        panels = {f"{n} [{self.display[n]}]": {n: self.in_display_units(n)} for n in self.signals}
        return draw(self.time, panels, backend, f"{self.source.name} ({kind})")

    def _repr_html_(self) -> str:
        import html

        kind = "synthetic log" if self.synthetic else "log"
        head = f"{html.escape(self.source.name)} ({kind}): {len(self)} samples in {self.duration:.6g} s"
        table = self.to_frame().describe().loc[["min", "mean", "max"]].T
        return f"<div>{head}</div>{table.to_html(border=0)}"


@dataclass(frozen=True)
class Tracker(_Record):
    """The record of an external tracker, on its own clock and at its own rate.

    Attributes:
        time: stamps (m,) on the tracker's clock [s], strictly increasing.
        slew_external: slew angle (m,) [rad].
        valid: mask (m,), False where a missing value was filled.
        gaps: intervals in which samples are missing.
        source, warnings, synthetic, sha256: as in a log.
    """

    slew_external: Array
    valid: Mask
    gaps: tuple[Gap, ...] = ()


def listed(logs: Log | Sequence[Log]) -> tuple[Log, ...]:
    """One log or several as a tuple."""
    return (logs,) if isinstance(logs, Log) else tuple(logs)
