"""The static curve of a drive, speed against command: dead zone, slope and top speed of either side, from logs.

    T dw/dt + w = f(u(t - d)),  dx/dt = w
    f(u) = min(s_r (u - b_r), v_r), u > b_r;  0, b_l < u < b_r;  max(s_l (u - b_l), v_l), u < b_l

What is compared is the way covered in short stretches (the speed over windows), so a position that drifts costs nothing.
Of a real drive some stretches are none of this curve's (flow shared with another axis, an end stop); the sum of squares
is replaced by one that grows linearly (soft L1) from what most stretches are off by, so these do not bend it.

Beside the seven numbers the curve is fitted freely: straight lines between knots, which only rise (NNLS).

Intervals hold from log to log. Within a log they come from its own parts (a moving-block jackknife over parts that are
long against anything the drive remembers); between logs from the scatter of the logs (DerSimonian and Laird, Controlled
Clinical Trials 7(3), 1986), with Student's t for the number of logs. A log alone says nothing of the next one: then the
scatter of other drives' logs, SCATTER, is added.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls
from scipy.signal import lfilter
from scipy.stats import t as student

from cosim.errors import DataError

Array = NDArray[np.float64]

NAMES = ("dead_low", "dead_high", "slope_low", "slope_high", "top_low", "top_high")
STRETCH = 0.5  # s over which the way is compared, at least 4 samples and 2 lags
FINER = 4  # steps of the simulation in a sample
PARTS = 10  # of a log, left out in turn
MOVING = 0.02  # of the largest speed, beyond which a stretch counts as one of motion
LEAST = 1e-3  # of the largest speed: no error is taken for smaller
FAR = 2.0  # typical errors from which on an error counts linearly
ROUNDS = 3  # of learning what the typical error is
KNOTS = 7  # of the free curve on either side
FASTEST = 5e-3  # s, of a step: no drive here tells two changes of command apart within it
MOST_STEPS = 200_000  # of the simulation: longer logs are simulated more coarsely
STEADY = 0.05  # of the largest command, within which it counts as held
EDGE = 0.02  # of the largest command: a top speed counts as reached if the command goes this far beyond where it begins
# relative, of dead zone, slope and top speed between the logs of one machine, where only one log is known: root mean
# square over boom, stick and bucket of a small excavator (five logs each, docs/identify.md), beyond what a log itself knows
SCATTER = {"dead": 0.11, "slope": 0.28, "top": 0.016}


@dataclass(frozen=True)
class Run:
    """One log of a drive.

    Attributes:
        name: of the log.
        time: (n,) s, rising.
        command: (n,) held from its stamp on.
        position: (n,) what the drive moves.
    """

    name: str
    time: Array
    command: Array
    position: Array


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
        each: of every log alone, in the order of the logs.
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


@dataclass(frozen=True)
class _Fine:
    """A log on an even grid, finer than its samples; `begins` are the samples at which stretches of `ahead` begin."""

    run: Run
    step: float
    grid: Array
    begins: NDArray[np.int64]
    ahead: int

    @cached_property
    def held(self) -> Array:
        """(m,) the command on the grid."""
        # at the middle of each step, where a change within it is early as often as late
        index = np.searchsorted(self.run.time, self.grid + 0.5 * self.step, side="right") - 1
        return np.asarray(self.run.command[np.clip(index, 0, self.run.time.size - 1)])

    def ways(self, speed: Array, lag: float, delay: float) -> Array:
        """(k,) way in each stretch, per second, of a drive that is asked for these speeds (m,)."""
        kept = float(np.exp(-self.step / lag))
        moving, _ = lfilter([0.0, 1.0 - kept], [1.0, -kept], speed, zi=[speed[0]])
        # exact for a speed that goes to the asked one along an exponential
        steps = speed * self.step + (moving - speed) * lag * (1.0 - kept)
        # the drive does not change with time: a command that comes later moves it later
        way = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
        first, last = (self.run.time[i] for i in (self.begins, self.begins + self.ahead))
        covered = np.interp(last - delay, self.grid, way) - np.interp(first - delay, self.grid, way)
        return np.asarray(covered / (last - first))

    def mean_speed(self, position: Array) -> Array:
        """(k,) of a position (n,) over each stretch."""
        first, last = self.begins, self.begins + self.ahead
        return np.asarray((position[last] - position[first]) / (self.run.time[last] - self.run.time[first]))

    def mean_command(self) -> Array:
        """(k,) over each stretch."""
        sums = np.concatenate([[0.0], np.cumsum(self.run.command)])
        return np.asarray((sums[self.begins + self.ahead] - sums[self.begins]) / self.ahead)

    def steadiness(self) -> Array:
        """(k,) range of the command over each stretch and a quarter of one before, in which the speed settles."""
        before = self.ahead // 4
        rows = np.lib.stride_tricks.sliding_window_view(self.run.command, self.ahead + before + 1)
        spread = rows.max(axis=1) - rows.min(axis=1)
        return np.asarray(spread[np.clip(self.begins - before, 0, spread.size - 1)])


def fine(run: Run, lag: float = 0.0) -> _Fine:
    """A log prepared: its grid and its stretches.

    Raises:
        DataError: it is too short, or command or position stand still.
    """
    usual = float(np.median(np.diff(run.time)))
    span = float(run.time[-1] - run.time[0])
    ahead = max(4, round(max(STRETCH, 2.0 * lag) / usual))
    if run.time.size < 20 * ahead:
        raise DataError(
            f"{run.name}: {span:.3g} s are too short for a static curve: it takes 20 stretches of {ahead * usual:.2g} s"
        )
    for what, values in (("command", run.command), ("position", run.position)):
        if np.ptp(values) == 0.0:
            raise DataError(f"{run.name}: the {what} never moves")
    step = max(usual / FINER, FASTEST, span / MOST_STEPS)
    grid = run.time[0] + step * np.arange(int(span / step) + 2)
    begins = np.arange(0, run.time.size - ahead, max(1, ahead // 2))
    return _Fine(run, step, grid, begins, ahead)


def static(command: Array, x: Array) -> Array:
    """Speed of the seven-number curve (the first six of x are `NAMES`) at commands of any shape."""
    low, high, s_l, s_r, v_l, v_r = x[:6]
    right = np.minimum(s_r * np.maximum(command - high, 0.0), v_r)
    left = np.minimum(s_l * np.maximum(low - command, 0.0), -v_l)
    return np.asarray(right - left)


def drive_curve(runs: Sequence[Run]) -> DriveCurve:
    """The static curve of a drive from one log or several of one machine.

    Args:
        runs: the logs.

    Raises:
        DataError: no log, or one that is too short, stands still or drives against its command.
    """
    if not runs:
        raise DataError("a static curve takes a log at least")
    each = tuple(_of_one(run) for run in runs)
    if len(each) == 1:
        alone = each[0]
        widened = {n: next_log([e], SCATTER[n.partition("_")[0]]) for n, e in alone.values.items()}
        return replace(alone, values=widened, each=each)
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
    )


def _of_one(run: Run) -> DriveCurve:
    """The curve of one log, intervals within the log."""
    log = fine(run)
    goal = log.mean_speed(run.position)
    begun = _begin(log, goal)
    x, typical = _fitted(log, goal, begun, np.ones(goal.size, dtype=bool))
    if log.ahead < round(2.0 * x[6] / float(np.median(np.diff(run.time)))):
        log = fine(run, float(x[6]))
        goal = log.mean_speed(run.position)
        x, typical = _fitted(log, goal, x, np.ones(goal.size, dtype=bool))
    part = np.minimum(np.arange(goal.size) * PARTS // goal.size, PARTS - 1)
    knots = _knots(run.command, x)
    speeds = _free(log, goal, x, knots, typical, np.ones(goal.size, dtype=bool))
    others, curves = [], []
    for k in range(PARTS):
        kept = part != k
        x_k, _ = _fitted(log, goal, x, kept, typical)
        others.append(x_k)
        curves.append(_free(log, goal, x, knots, typical, kept))
    spread = _jackknife(np.array(others))
    reach = student.ppf(0.975, PARTS - 1)
    low, high = (float(np.quantile(run.command, q)) for q in (0.002, 0.998))
    values = {}
    for i, name in enumerate(NAMES):
        if name.startswith("top") and not _topped(name, x, low, high):
            continue
        if (name.endswith("low") and low >= x[0]) or (name.endswith("high") and high <= x[1]):
            continue  # this side was never driven
        d = float(spread[i])
        values[name] = Estimate(float(x[i]), d, float(x[i] - reach * d), float(x[i] + reach * d))
    off = reach * _jackknife(np.array(curves))
    steady = log.steadiness() <= STEADY * float(np.abs(run.command).max())
    points = (log.mean_command()[steady], goal[steady])
    band = np.array([speeds - off, speeds + off])
    return DriveCurve(values, float(x[6]), float(x[7]), knots, speeds, band, typical, (), (run.name,), points)


def _topped(name: str, x: Array, low: float, high: float) -> bool:
    """True if the command goes beyond where a top speed begins."""
    if name == "top_high":
        return bool(high > x[1] + x[5] / x[3] + EDGE * high)
    return bool(low < x[0] + x[4] / x[2] + EDGE * low)


def _jackknife(others: Array) -> Array:
    """Standard deviations from estimates (parts, k) that each leave one part out (Efron and Stein, 1981)."""
    count = len(others)
    return np.asarray(np.sqrt((count - 1) / count * np.sum((others - others.mean(axis=0)) ** 2, axis=0)))


def _begin(log: _Fine, goal: Array) -> Array:
    """Rough numbers: dead zone where the drive stands, slopes and top speeds of what moves."""
    command = log.run.command
    if float(np.corrcoef(log.mean_command(), goal)[0, 1]) < 0.0:
        raise DataError(
            f"{log.run.name}: the position goes against the command: give one of them sign = -1 in the mapping"
        )
    low, high = min(float(command.min()), 0.0), max(float(command.max()), 0.0)
    size = max(high, -low)
    low, high = min(low, -1e-3 * size), max(high, 1e-3 * size)
    fastest = float(np.quantile(np.abs(goal), 0.98))
    slope = 1.3 * fastest / size
    return np.array(
        [0.2 * low, 0.2 * high, slope, slope, -fastest, fastest, 2.0 * log.step, log.step * FINER]
    )


def _fitted(
    log: _Fine, goal: Array, begun: Array, kept: NDArray[np.bool_], typical: float | None = None
) -> tuple[Array, float]:
    """The numbers (dead zone, slopes, tops, lag, delay) and the typical error of the speed over a stretch."""
    command = log.run.command
    size, fastest = float(np.abs(command).max()), float(np.abs(goal).max())
    usual = log.step * FINER
    low = np.array(
        [
            -size,
            0.0,
            0.01 * fastest / size,
            0.01 * fastest / size,
            -3.0 * fastest,
            0.01 * fastest,
            0.1 * log.step,
            0.0,
        ]
    )
    high = np.array(
        [
            0.0,
            size,
            50.0 * fastest / size,
            50.0 * fastest / size,
            -0.01 * fastest,
            3.0 * fastest,
            max(2.0, 20 * usual),
            max(0.5, 4 * usual),
        ]
    )
    scale = np.array([0.1 * size, 0.1 * size, fastest / size, fastest / size, fastest, fastest, usual, usual])
    x = np.clip(begun, low + 1e-9 * scale, high - 1e-9 * scale)

    def off(x: Array) -> Array:
        return (goal - log.ways(static(log.held, x), float(x[6]), float(x[7])))[kept]

    learn = typical is None
    moving = np.abs(goal) > MOVING * fastest  # at rest everything fits
    for _ in range(ROUNDS if learn else 1):
        if learn:
            typical = max(1.4826 * float(np.median(np.abs(off(x))[moving[kept]])), LEAST * fastest)
        width = float(typical or 1.0) * FAR
        found = least_squares(
            lambda x, width=width: off(x) / width,
            x,
            bounds=(low, high),
            x_scale=scale,
            loss="soft_l1",
            diff_step=1e-3,
        )
        x = found.x
    return np.asarray(x), float(typical or 0.0)


def _knots(command: Array, x: Array) -> Array:
    """Commands at which the free curve may bend: the edges of the dead zone, and evenly from there to the extremes."""
    low, high = float(command.min()), float(command.max())
    left = np.linspace(low, min(x[0], 0.0), KNOTS) if low < x[0] else np.empty(0)
    right = np.linspace(max(x[1], 0.0), high, KNOTS) if high > x[1] else np.empty(0)
    return np.unique(np.concatenate([left, [0.0], right]))


def _free(log: _Fine, goal: Array, x: Array, knots: Array, typical: float, kept: NDArray[np.bool_]) -> Array:
    """(m,) speeds at the knots of a curve of straight lines that only rises and is zero at no command."""
    ramps = []
    for a, b in pairwise(knots):
        rise = np.clip((log.held - a) / (b - a), 0.0, 1.0)
        ramps.append(log.ways(rise if a >= 0.0 else rise - 1.0, float(x[6]), float(x[7])))
    columns = np.stack(ramps, axis=1)[kept]
    target, weights = goal[kept], np.ones(int(kept.sum()))
    steps = np.zeros(knots.size - 1)
    for _ in range(5):
        root = np.sqrt(weights)
        steps, _ = nnls(columns * root[:, None], target * root)
        weights = 1.0 / np.sqrt(1.0 + ((target - columns @ steps) / (FAR * typical)) ** 2)
    rising = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(rising - rising[int(np.argmin(np.abs(knots)))])


def next_log(told: Sequence[Estimate], scatter: float = 0.0) -> Estimate:
    """One number of a machine from those of its logs, with the interval in which the next log's lies in 95 % of cases.

    Args:
        told: of each log.
        scatter: relative standard deviation between logs, where one log alone is known.
    """
    values, own = np.array([e.value for e in told]), np.array([e.deviation for e in told]) ** 2
    if len(told) == 1:
        (one,) = told
        # this log and the next are off by as much
        spread = float(np.hypot(one.deviation, scatter * abs(one.value)) * np.sqrt(2.0))
        return _one_sided(one.value, one.deviation, float(student.ppf(0.975, PARTS - 1)) * spread)
    weights = 1.0 / np.maximum(own, 1e-12 * max(float(own.max()), 1e-300))
    mean = float(weights @ values / weights.sum())
    spread = float(weights @ (values - mean) ** 2)
    scale = float(weights.sum() - (weights @ weights) / weights.sum())
    apart = max(0.0, (spread - (len(told) - 1)) / scale) if scale > 0.0 else 0.0
    weights = 1.0 / np.maximum(own + apart, 1e-300)
    mean = float(weights @ values / weights.sum())
    # of the mean, of the machine from log to log, and of what one more log would read by itself
    variance = 1.0 / float(weights.sum()) + apart + float(np.mean(own))
    reach = float(student.ppf(0.975, len(told) - 1)) * float(np.sqrt(variance))
    return _one_sided(mean, float(np.sqrt(1.0 / weights.sum())), reach)


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
    mean, count = np.nanmean(rows, axis=0), np.sum(np.isfinite(rows), axis=0)
    own = np.array([np.interp(knots, c.knots, 0.25 * (c.band[1] - c.band[0])) for c in each])
    spread = np.sqrt(
        np.nanvar(rows, axis=0, ddof=1) * (1.0 + 1.0 / count) + np.median(own, axis=0) ** 2 / count
    )
    off = student.ppf(0.975, np.maximum(count - 1, 1)) * spread
    return knots, mean, np.array([mean - off, mean + off])
