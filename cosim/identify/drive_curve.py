"""The static curve of a drive, speed against command: dead zone, slope and top speed of either side, from logs.

    T dw/dt + w = f(u(t - d)),  dx/dt = w
    f(u) = min(s_r (u - b_r), v_r), u > b_r;  0, b_l < u < b_r;  max(s_l (u - b_l), v_l), u < b_l

What is compared is the way covered in short stretches (the speed over windows), so a position that drifts costs nothing.
Of a real drive some stretches are none of this curve's (flow shared with another axis, an end stop); the sum of squares
is replaced by one that grows linearly (soft L1) from what most stretches are off by, so these do not bend it.

Beside the seven numbers the curve is fitted freely: straight lines between knots, which only rise (NNLS).

Intervals hold from log to log. Within a log they come from its own parts (a moving-block jackknife over parts that are
long against anything the drive remembers); between logs from the scatter of the logs, which two or three hardly tell:
what is known of it from other drives, SCATTER, is their prior (`cosim.inference.between`). A log alone says nothing of the
next one: then that is added.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from cosim.errors import DataError
from cosim.identify.drive_fit import (
    KNOTS,
    Fine,
    Run,
    begin,
    commands,
    fine,
    fitted,
    free_curve,
    knots_of,
    mean_speeds,
)
from cosim.inference.between import combined

Array = NDArray[np.float64]

NAMES = ("dead_low", "dead_high", "slope_low", "slope_high", "top_low", "top_high")
PARTS = 10  # of a log, left out in turn
STEADY = 0.05  # of the largest command, within which it counts as held
EDGE = 0.02  # of the largest command: a top speed counts as reached if the command goes this far beyond where it begins
# share of the speed's spread that a curve leaves at most where it is one; a small excavator's four axes leave 0.1 to 0.4, a
# pendulum pushed by a propeller 0.98
OF_ITS_OWN = 0.7
# relative, of dead zone, slope and top speed between the logs of one machine, where only one log is known: root mean
# square over boom, stick and bucket of a small excavator (five logs each, docs/identify.md), beyond what a log itself knows
SCATTER = {"dead": 0.11, "slope": 0.28, "top": 0.016}
# times as much is the half-normal prior of it for another drive, of which two or three logs hardly tell it: intervals from
# two or three of the excavator's five logs hold in 94 to 100 % of the others (docs/identify.md)
MAY_SCATTER = 3.0


@dataclass(frozen=True)
class Estimate:
    """A number with its standard deviation within the log and the interval that holds from log to log."""

    value: float
    deviation: float
    low: float
    high: float


@dataclass(frozen=True)
class DriveCurve:
    """The static curve of a drive.

    Attributes:
        values: name (of `NAMES`) -> estimate, in the units of command and position per second; a top speed that no log
            reaches is missing.
        lag, delay: s, of the speed behind the command.
        knots: (m,) commands of the free curve.
        speeds: (m,) of the free curve.
        band: (2, m) its 95 % band.
        typical: error of the speed over a stretch.
        spread: standard deviation of the speed over all stretches; of several logs the median.
        each: of every log alone, in the order of the logs; none where one tells nothing alone: then all are fitted together.
        names: of the logs.
    """

    values: dict[str, Estimate]
    lag: float
    delay: float
    knots: Array
    speeds: Array
    band: Array
    typical: float
    each: "tuple[DriveCurve, ...]" = ()
    names: tuple[str, ...] = ()
    points: tuple[Array, Array] = field(default=(np.empty(0), np.empty(0)), repr=False)
    spread: float = 0.0

    @property
    def left(self) -> float:
        """Share of how the speed varies that the curve leaves: about 1 where the command does not set the speed."""
        return self.typical / self.spread if self.spread > 0.0 else 0.0

    @property
    def scattered(self) -> bool:
        """Whether the intervals come from how the logs scatter, each by itself."""
        return len(self.each) == len(self.names) > 1


def left_of(typical: float, speeds: Array) -> float:
    """Share of how speeds (n,) vary that a curve with this typical error leaves."""
    spread = float(np.std(speeds)) if speeds.size else 0.0
    return typical / spread if spread > 0.0 else 0.0


def not_set(left: float) -> str:
    """That the command does not set the speed, in words, where a curve leaves this share of how it varies."""
    return (
        f"the curve leaves {100.0 * left:.0f} % of how the speed varies: the command does not set the speed alone "
        "(a spring, a load, another axis), or not within the time over which it is taken"
    )


def drive_curve(runs: Sequence[Run]) -> DriveCurve:
    """The static curve of a drive from one log or several of one machine.

    Args:
        runs: the logs.

    Raises:
        DataError: no log, or they are too short, stand still, drive against their command or hold too few levels of it,
            or it does not set the speed.
    """
    if not runs:
        raise DataError("a static curve takes a log at least")
    each = _each(runs) if len(runs) > 1 else ()
    if len(runs) == 1 or len(each) < len(runs):
        together = _of(runs)
        widened = {n: next_log([e], SCATTER[n.partition("_")[0]]) for n, e in together.values.items()}
        return replace(together, values=widened, each=() if len(runs) > 1 else (together,))
    values = {}
    for name in NAMES:
        told = [c.values[name] for c in each if name in c.values]
        if told:
            values[name] = next_log(told, SCATTER[name.partition("_")[0]])
    knots, speeds, band = _common(each)
    points = tuple(np.concatenate([c.points[i] for c in each]) for i in (0, 1))
    return DriveCurve(
        values,
        float(np.median([c.lag for c in each])),
        float(np.median([c.delay for c in each])),
        knots,
        speeds,
        band,
        float(np.median([c.typical for c in each])),
        each,
        tuple(run.name for run in runs),
        (points[0], points[1]),
        float(np.median([c.spread for c in each])),
    )


def _each(runs: Sequence[Run]) -> tuple[DriveCurve, ...]:
    """The curve of each of several logs by itself; none if one tells none, such as a log of one step."""
    try:
        return tuple(_of([run]) for run in runs)
    except DataError:
        return ()


def _of(runs: Sequence[Run]) -> DriveCurve:
    """One curve of all logs; its intervals come from the parts of the log, or from the logs, each left out in turn."""
    logs = fine(runs)
    goal = mean_speeds(logs)
    x, typical, curved = fitted(logs, goal, begin(logs, goal), np.ones(goal.size, dtype=bool))
    if any(log.ahead < round(2.0 * x[6] / float(np.median(np.diff(log.run.time)))) for log in logs):
        logs = fine(runs, float(x[6]))
        goal = mean_speeds(logs)
        x, typical, curved = fitted(logs, goal, x, np.ones(goal.size, dtype=bool))
    command = commands(logs)
    limits = np.where([n.startswith("dead") for n in NAMES], np.abs(command).max(), np.abs(x[: len(NAMES)]))
    if not np.any((curved[: len(NAMES)] < limits)[: NAMES.index("top_low")]):  # no need to leave parts out
        raise _untold(logs, left_of(typical, goal))
    tenth = np.concatenate([np.arange(log.begins.size) * PARTS // log.begins.size for log in logs])
    count = [log.begins.size for log in logs]
    part = tenth if len(logs) == 1 else np.repeat(np.arange(len(logs)), count)
    knots = knots_of(logs, x)
    speeds = free_curve(logs, goal, x, knots, typical, np.ones(goal.size, dtype=bool))
    # a level may be in one log only: without this log nothing is known of its speed, but between two levels there is
    curves = [free_curve(logs, goal, x, knots, typical, tenth != k) for k in range(PARTS)]
    others = [fitted(logs, goal, x, part != k, typical)[0] for k in range(int(part[-1]) + 1)]
    deviations = np.maximum(_jackknife(np.array(others)), curved)
    reach = student.ppf(0.975, len(others) - 1)
    low, high = (float(np.quantile(command, q)) for q in (0.002, 0.998))
    values: dict[str, Estimate] = {}
    for i, name in enumerate(NAMES):
        kind, _, side = name.partition("_")
        if (side == "low" and low >= x[0]) or (side == "high" and high <= x[1]):
            continue  # this side was never driven
        if kind == "top" and not (f"slope_{side}" in values and _topped(name, x, low, high)):
            continue
        d = float(deviations[i])
        # what could as well be anything is not known: of one level, where the dead zone ends and how steep it goes on
        if reach * d < limits[i]:
            values[name] = Estimate(float(x[i]), d, float(x[i] - reach * d), float(x[i] + reach * d))
    if not values:
        raise _untold(logs, left_of(typical, goal))
    off = student.ppf(0.975, PARTS - 1) * _jackknife(np.array(curves))
    size = STEADY * float(np.abs(command).max())
    steady = np.concatenate([log.steadiness() for log in logs]) <= size
    points = (np.concatenate([log.mean_command() for log in logs])[steady], goal[steady])
    band = np.array([speeds - off, speeds + off])
    names = tuple(log.run.name for log in logs)
    spread = float(np.std(goal))
    return DriveCurve(
        values, float(x[6]), float(x[7]), knots, speeds, band, typical, (), names, points, spread
    )


def _untold(logs: Sequence[Fine], left: float) -> DataError:
    """Why no number of the curve is known: the command does not set the speed, or too few of its levels were driven."""
    why = (
        "too few levels of the command to tell the dead zone from the slope beyond it; give logs of at least two levels of "
        "each direction together"
    )
    return DataError(
        f"{', '.join(log.run.name for log in logs)}: {not_set(left) if left > OF_ITS_OWN else why}"
    )


def _topped(name: str, x: Array, low: float, high: float) -> bool:
    """True if the command goes beyond where a top speed begins."""
    if name == "top_high":
        return bool(high > x[1] + x[5] / x[3] + EDGE * high)
    return bool(low < x[0] + x[4] / x[2] + EDGE * low)


def _jackknife(others: Array) -> Array:
    """Standard deviations from estimates (parts, k) that each leave one part out (Efron and Stein, 1981)."""
    count = len(others)
    return np.asarray(np.sqrt((count - 1) / count * np.sum((others - others.mean(axis=0)) ** 2, axis=0)))


def next_log(told: Sequence[Estimate], scatter: float) -> Estimate:
    """One number of a machine from those of its logs, with the interval in which the next log's lies in 95 % of cases.

    Args:
        told: of each log.
        scatter: relative standard deviation between the logs of other drives.
    """
    values, own = np.array([e.value for e in told]), np.array([e.deviation for e in told])
    if len(told) == 1:
        (one,) = told
        # this log and the next are off by as much
        spread = float(np.hypot(one.deviation, scatter * abs(one.value)) * np.sqrt(2.0))
        return _one_sided(one.value, one.deviation, float(student.ppf(0.975, PARTS - 1)) * spread)
    own = np.maximum(own, 1e-6 * max(float(own.max()), 1e-300))
    size, apart = float(np.abs(values).mean()), 0.0
    # logs count by how well each knows the number, and by how the machine changes between them
    for _ in range(2):
        weights = 1.0 / (own**2 + apart**2)
        mean, deviation = float(weights @ values / weights.sum()), float(weights.sum() ** -0.5)
        found = combined(mean, deviation, values, own, size, MAY_SCATTER * scatter)
        apart = found.scatter
    return _one_sided(mean, deviation, found.next_ci95[1] - mean)


def _one_sided(value: float, deviation: float, reach: float) -> Estimate:
    """An estimate whose interval stays on its side of zero, as dead zones, slopes and top speeds of one side do."""
    low, high = value - reach, value + reach
    return Estimate(
        value, deviation, max(low, 0.0) if value > 0.0 else low, min(high, 0.0) if value < 0.0 else high
    )


def _common(each: Sequence[DriveCurve]) -> tuple[Array, Array, Array]:
    """Knots, mean and 95 % band of the curves of several logs, where at least two of them go."""
    low, high = (sorted(c.knots[i] for c in each) for i in (0, -1))
    ends = low[min(1, len(low) - 1)], high[-min(2, len(high))]
    knots = np.unique(np.concatenate([np.linspace(ends[0], ends[1], 4 * KNOTS), [0.0]]))
    rows = np.array(
        [
            np.where(
                (knots >= c.knots[0]) & (knots <= c.knots[-1]), np.interp(knots, c.knots, c.speeds), np.nan
            )
            for c in each
        ]
    )
    own = np.array([np.interp(knots, c.knots, 0.25 * (c.band[1] - c.band[0])) for c in each])
    mean, off = np.full(knots.size, np.nan), np.full(knots.size, np.nan)
    for i, (speeds, deviations) in enumerate(zip(rows.T, own.T, strict=True)):
        here = np.isfinite(speeds)
        mean[i] = speeds[here].mean()
        of_all = float(np.sqrt(np.mean(deviations[here] ** 2) / here.sum()))
        if here.sum() == 1:
            off[i] = 2.0 * of_all
            continue
        found = combined(mean[i], of_all, speeds[here], deviations[here], abs(mean[i]))
        off[i] = found.next_ci95[1] - mean[i]
    return knots, mean, np.array([mean - off, mean + off])
