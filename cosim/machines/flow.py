"""Whether a load pressure stands between command and motion, or beside them.

In the chain command -> valve -> load pressure -> motion nothing is lost on the way: what follows from the pressure that
follows from the command is as good a prediction of the motion as one from the command at once. Where flow sets the speed (a
pump's, or that through a valve which load and weight hardly change), the pressure is what the load makes of it. It cannot be
told from the command, and a model cut there would predict the motion from what the command does not tell.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter
from scipy.stats import wilcoxon

from cosim.machines.rough import WINDOW

Array = NDArray[np.float64]

KNOTS = 7  # of the static curve through which a drive acts, its two ends among them
LAGS, FINER = 12, 8  # lags that are tried, evenly spaced in their logarithm, and between two of them
FLOW_SAMPLES = 6000  # samples that are used
WINDOWS = 8  # at least so many, shorter ones in a short log
FEWEST = 6  # of them; fewer cannot be told from chance
# of the error from the command at once; on the crane they are equal, 2.1 where dry friction takes two thirds of the torque
WORSE = 2.2
# share of the pressure's variance that must follow from the command; on the crane it is 0.88 or more
LEAST = 0.5
CHANCE = 0.05  # of finding as much where the two are equally good, by ranks of the windows
ALIKE = 1e-8  # columns that differ by less of their size than this are one


class Curve(NamedTuple):
    """A static curve of a drive behind a first-order lag.

    Attributes:
        lag: s.
        bends: where the curve bends, in the drive's unit.
        numbers: constant, slope, and change of slope at each bend.
    """

    lag: float
    bends: Array
    numbers: Array


class Even(NamedTuple):
    """A log on even stamps.

    Attributes:
        h: interval, s.
        length: samples of a window.
        rows: windows.
    """

    h: float
    length: int
    rows: int

    def inside(self, values: Array) -> Array:
        """(rows * length, columns): values less their mean in each window."""
        part = values[: self.rows * self.length].reshape(self.rows, self.length, -1)
        return np.asarray((part - part.mean(axis=1, keepdims=True)).reshape(self.rows * self.length, -1))

    def left(self, error: Array, time: Array | None) -> Array:
        """(rows,) squares of an error in each window; a steady drift over time, where there may be one, does not count."""
        found = self.inside(error)[:, 0]
        if time is not None:  # a constant error of a speed
            ramp = self.inside(time)[:, 0]
            found = found - ramp * float(ramp @ found) / float(ramp @ ramp)
        squares = np.sum(found.reshape(self.rows, self.length) ** 2, axis=1)
        return np.asarray(np.maximum(squares, np.finfo(float).tiny))


def set_by_flow(time: Array, command: Array, pressure: Array, motion: Array, *, integrates: bool) -> str:
    """Why the load and not the command makes a pressure, in words; empty where the command does.

    Args:
        time: (n,) s.
        command: (n,) what drives the machine, held from stamp to stamp.
        pressure: (n,) the load pressure.
        motion: (n,) what it does.
        integrates: the motion is an angle or a position, whose rate of change follows; else a speed.
    """
    stamps = np.linspace(time[0], time[-1], min(time.size, FLOW_SAMPLES))
    h = float(stamps[1] - stamps[0])
    length = min(max(round(min(WINDOW, h * stamps.size / WINDOWS) / h), 8), stamps.size)
    even = Even(h, length, stamps.size // length)
    held = command[np.clip(np.searchsorted(time, stamps, side="right") - 1, 0, time.size - 1)]
    load, moved = (np.interp(stamps, time, values) for values in (pressure, motion))
    if min(np.ptp(held), np.ptp(load), np.ptp(moved)) == 0.0:
        return ""
    pressed = seen_through(fitted(held, load, Even(h, stamps.size, 1), False), held, h, False)
    pressed += load.mean() - pressed.mean()
    share = 1.0 - float(np.var(load - pressed) / np.var(load))
    if share < LEAST:
        return f"only {max(share, 0.0):.0%} of the load pressure's changes follow from the command"
    at_once = seen_through(fitted(held, moved, even, integrates), held, h, integrates)
    by_way = seen_through(fitted(load, moved, even, integrates), pressed, h, integrates)
    ours, theirs = (even.left(moved - guess, stamps if integrates else None) for guess in (at_once, by_way))
    larger = float(np.sqrt(theirs.sum() / ours.sum()))
    if larger < WORSE or even.rows < FEWEST:
        return ""
    chance = float(wilcoxon(np.log(theirs / ours), alternative="greater").pvalue)
    if chance > CHANCE:
        return ""
    return f"by way of the load pressure the error is {larger:.2g} times as large as from the command at once"


def fitted(drive: Array, answer: Array, even: Even, integrates: bool) -> Curve:
    """The curve and lag that leave least of an answer in all windows."""
    goal = even.inside(answer)[:, 0]
    bends = np.unique(np.quantile(drive, np.linspace(0.0, 1.0, KNOTS)))[1:-1]

    def at(log_lag: float) -> tuple[float, Curve]:
        lag = float(np.exp(log_lag))
        basis = even.inside(answers(lag, bends, drive, even.h, integrates))
        sizes = np.sqrt(np.sum(basis * basis, axis=0))
        sizes[sizes == 0.0] = 1.0
        numbers, *_ = np.linalg.lstsq(basis / sizes, goal, rcond=ALIKE)
        left = float(np.sum((goal - basis @ (numbers / sizes)) ** 2))
        return left, Curve(lag, bends, numbers / sizes)

    tried = np.linspace(np.log(even.h), np.log(max(0.1 * even.h * drive.size, even.h)), LAGS)
    found = [at(x) for x in tried]
    best = int(np.argmin([left for left, _ in found]))
    ends = (float(tried[max(best - 1, 0)]), float(tried[min(best + 1, LAGS - 1)]))
    if ends[0] == ends[1]:
        return found[best][1]
    finer = minimize_scalar(
        lambda x: at(float(x))[0], bounds=ends, method="bounded", options={"maxiter": FINER}
    )
    return min((found[best], at(float(finer.x))), key=lambda item: item[0])[1]


def answers(lag: float, bends: Array, drive: Array, h: float, integrates: bool) -> Array:
    """(n, 2 + bends) what each part of a curve makes of a drive."""
    curve = np.column_stack([np.ones(drive.size), drive, *(np.maximum(drive - bend, 0.0) for bend in bends)])
    kept = float(np.exp(-h / lag))
    seen = np.asarray(lfilter([0.0, 1.0 - kept], [1.0, -kept], curve, axis=0, zi=curve[:1])[0])
    return np.asarray(cumulative_trapezoid(seen, dx=h, axis=0, initial=0.0)) if integrates else seen


def seen_through(curve: Curve, drive: Array, h: float, integrates: bool) -> Array:
    """(n,) the answer to a drive by a curve and a lag."""
    return np.asarray(answers(curve.lag, curve.bends, drive, h, integrates) @ curve.numbers)
