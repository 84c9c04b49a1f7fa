"""A drive's static curve fitted to logs: the simulation over stretches, the seven numbers and the free curve."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls
from scipy.signal import lfilter

from cosim.errors import DataError
from cosim.machines.rough import stays_with

Array = NDArray[np.float64]

STRETCH = 0.5  # s over which the way is compared, at least 4 samples and 2 lags
FEWEST = 20  # stretches, of all logs
FINER = 4  # steps of the simulation in a sample
MOVING = 0.02  # of the largest speed, beyond which a stretch counts as one of motion
LEAST = 1e-3  # of the largest speed: no error is taken for smaller
FAR = 2.0  # typical errors from which on an error counts linearly
ROUNDS = 3  # of learning what the typical error is
MOST_RUNS = 100  # of the simulation in a round, those for derivatives apart: a log that tells the numbers takes half as many
KNOTS = 7  # of the free curve on either side
FINEST_STEP = 5e-3  # s, of a step: no drive here tells two changes of command apart within it
MOST_STEPS = 200_000  # of the simulation: longer logs are simulated more coarsely


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
class Fine:
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


def fine(runs: Sequence[Run], lag: float = 0.0) -> tuple[Fine, ...]:
    """The logs of one drive prepared: each one's grid and stretches. A log shorter than a stretch is left out.

    Raises:
        DataError: they are too short together, or command or position stand still in all of them.
    """
    name = runs[0].name if len(runs) == 1 else f"{len(runs)} logs"
    for what in ("command", "position"):
        if all(np.ptp(getattr(run, what)) == 0.0 for run in runs):
            raise DataError(f"{name}: the {what} never moves")
    found, stretches, longest = [], 0.0, 0.0
    for run in runs:
        usual = float(np.median(np.diff(run.time)))
        span = float(run.time[-1] - run.time[0])
        ahead = max(4, round(max(STRETCH, 2.0 * lag) / usual))
        stretches += run.time.size / ahead
        longest = max(longest, ahead * usual)
        if run.time.size <= 2 * ahead:
            continue
        step = max(usual / FINER, FINEST_STEP, span / MOST_STEPS)
        grid = run.time[0] + step * np.arange(int(span / step) + 2)
        begins = np.arange(0, run.time.size - ahead, max(1, ahead // 2))
        found.append(Fine(run, step, grid, begins, ahead))
    if stretches < FEWEST or not found:
        span = sum(float(run.time[-1] - run.time[0]) for run in runs)
        raise DataError(
            f"{name}: {span:.3g} s are too short for a static curve: "
            f"it takes {FEWEST} stretches of {longest:.2g} s"
        )
    return tuple(found)


def static(command: Array, x: Array) -> Array:
    """Speed of the seven-number curve (the first six of x are `NAMES`) at commands of any shape."""
    low, high, s_l, s_r, v_l, v_r = x[:6]
    right = np.minimum(s_r * np.maximum(command - high, 0.0), v_r)
    left = np.minimum(s_l * np.maximum(low - command, 0.0), -v_l)
    return np.asarray(right - left)


def ways(logs: Sequence[Fine], x: Array) -> Array:
    """(k,) speed over each stretch of each log, by the numbers (8,) of a drive."""
    return np.concatenate([log.ways(static(log.held, x), float(x[6]), float(x[7])) for log in logs])


def begin(logs: Sequence[Fine], goal: Array) -> Array:
    """Rough numbers: dead zone where the drive stands, slopes and top speeds of what moves."""
    command = commands(logs)
    if float(np.corrcoef(np.concatenate([log.mean_command() for log in logs]), goal)[0, 1]) < 0.0:
        name = logs[0].run.name if len(logs) == 1 else f"{len(logs)} logs"
        if any(stays_with(log.run.time, log.run.command, log.run.position) for log in logs):
            raise DataError(
                f"{name}: the motion follows the command itself and stays with it, as a demanded place is held: there is no "
                "static curve of speed against command"
            )
        raise DataError(
            f"{name}: the position goes against the command: give one of them sign = -1 in the mapping"
        )
    low, high = min(float(command.min()), 0.0), max(float(command.max()), 0.0)
    size = max(high, -low)
    low, high = min(low, -1e-3 * size), max(high, 1e-3 * size)
    fastest = float(np.quantile(np.abs(goal), 0.98))
    slope = 1.3 * fastest / size
    lag, delay = 2.0 * logs[0].step, logs[0].step * FINER
    return np.array([0.2 * low, 0.2 * high, slope, slope, -fastest, fastest, lag, delay])


def commands(logs: Sequence[Fine]) -> Array:
    """All commands of the logs, one behind the other."""
    return np.concatenate([log.run.command for log in logs])


def mean_speeds(logs: Sequence[Fine]) -> Array:
    """(k,) speed over each stretch of each log."""
    return np.concatenate([log.mean_speed(log.run.position) for log in logs])


def fitted(
    logs: Sequence[Fine],
    goal: Array,
    begun: Array,
    kept: NDArray[np.bool_],
    typical: float | None = None,
    *,
    still: bool = True,
) -> tuple[Array, float, Array]:
    """The numbers (dead zone, slopes, tops, lag, delay), the typical error of the speed over a stretch, and how sure.

    Args:
        logs: of one drive.
        goal: (k,) its speed over each stretch.
        begun: (8,) numbers to begin with.
        kept: (k,) stretches that count.
        typical: error; learned where it is not given.
        still: whether there may be a dead zone.

    Returns:
        the numbers (8,), the typical error, and standard deviations (8,) by the curvature of the errors: without bound
        where the logs hold a number only together with another one.
    """
    size, fastest = float(np.abs(commands(logs)).max()), float(np.abs(goal).max())
    usual = max(log.step for log in logs) * FINER
    flat = fastest / size
    low = np.array([-size, 0, 0.01 * flat, 0.01 * flat, -3 * fastest, 0.01 * fastest, 0.025 * usual, 0])
    slowest, latest = max(2.0, 20.0 * usual), max(0.5, 4.0 * usual)  # s
    high = np.array([0, size, 50 * flat, 50 * flat, -0.01 * fastest, 3 * fastest, slowest, latest])
    if not still:
        low[0], high[1] = -1e-6 * size, 1e-6 * size
    scale = np.array([0.1 * size, 0.1 * size, flat, flat, fastest, fastest, usual, usual])
    x = np.clip(begun, low + 1e-9 * scale, high - 1e-9 * scale)

    def off(x: Array) -> Array:
        return np.asarray((goal - ways(logs, x))[kept])

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
            max_nfev=MOST_RUNS,
        )
        x = found.x
    return np.asarray(x), float(typical or 0.0), spread(found.jac * scale) * scale / FAR


def spread(jacobian: Array) -> Array:
    """(k,) standard deviations of numbers by the derivatives (n, k) of errors of a deviation of 1.

    A number on which no error depends is left out of the others' and is not known (infinite).
    """
    known = np.linalg.norm(jacobian, axis=0) > 0.0
    found = np.full(known.size, np.inf)
    _, sizes, rows = np.linalg.svd(jacobian[:, known], full_matrices=False)
    with np.errstate(divide="ignore"):
        found[known] = np.sqrt(np.sum((rows / np.maximum(sizes, 1e-150)[:, None]) ** 2, axis=0))
    return found


def knots_of(logs: Sequence[Fine], x: Array) -> Array:
    """Commands at which the free curve may bend: the edges of the dead zone, and evenly from there to the extremes.

    Where the command was held at a few levels only, at these: between them the logs know nothing of a bend.
    """
    command = commands(logs)
    levels = np.unique(command)
    if levels.size <= KNOTS:
        return np.unique(np.append(levels, 0.0))
    low, high = float(levels[0]), float(levels[-1])
    left = np.linspace(low, min(x[0], 0.0), KNOTS) if low < x[0] else np.empty(0)
    right = np.linspace(max(x[1], 0.0), high, KNOTS) if high > x[1] else np.empty(0)
    return np.unique(np.concatenate([left, [0.0], right]))


def free_curve(
    logs: Sequence[Fine], goal: Array, x: Array, knots: Array, typical: float, kept: NDArray[np.bool_]
) -> Array:
    """(m,) speeds at the knots of a curve of straight lines that only rises and is zero at no command."""
    ramps = []
    for a, b in pairwise(knots):
        rises = [np.clip((log.held - a) / (b - a), 0.0, 1.0) - (a < 0.0) for log in logs]
        ways = [log.ways(rise, float(x[6]), float(x[7])) for log, rise in zip(logs, rises, strict=True)]
        ramps.append(np.concatenate(ways))
    columns = np.stack(ramps, axis=1)[kept]
    target, weights = goal[kept], np.ones(int(kept.sum()))
    steps = np.zeros(knots.size - 1)
    for _ in range(5):
        root = np.sqrt(weights)
        steps, _ = nnls(columns * root[:, None], target * root)
        weights = 1.0 / np.sqrt(1.0 + ((target - columns @ steps) / (FAR * typical)) ** 2)
    rising = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(rising - rising[int(np.argmin(np.abs(knots)))])
