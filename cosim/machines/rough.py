"""Rough numbers of a machine from its own log: gain and lag of a first order, so that a search can begin.

And of a second order, where a weight or a spring brings a driven axis back.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import minimize, minimize_scalar
from scipy.signal import cont2discrete, lfilter

Array = NDArray[np.float64]

WINDOW = 5.0  # s: an integrated response drifts with all that a first order lacks
LAGS = 20  # lags that are tried first, evenly spaced in their logarithm
# a side that is reached less than this part of the other is not used; a signal that stays as far off zero has a bias
ONE_SIDED = 0.25
# share of what a sum of the drive over time leaves of a place in windows, below which the drive itself tells it
NEARER = 0.25
MODES = 16  # frequencies that are tried first, evenly spaced in their logarithm
DAMPINGS = (0.03, 0.15, 0.6, 2.0)  # tried with each
SLOWEST_MODE, FASTEST_MODE = 2.0, 6.0  # periods in the log, and samples in a period, at least
ROUGH_SAMPLES = 20000  # samples that are used: a rough number needs no more


@dataclass(frozen=True)
class FirstOrder:
    """A response that follows a drive as ``lag dy/dt + y = gain drive``, or whose rate of change does.

    Attributes:
        gain: response (or its rate) per drive.
        lag: s.
        share: of the response's variance that it explains.
    """

    gain: float
    lag: float
    share: float


def first_order(
    time: Array, drive: Array, response: Array, *, integrates: bool, windows: bool | None = None
) -> FirstOrder:
    """Least squares over gain and offset for lags from one sample to a tenth of the log.

    Args:
        time: (n,) s.
        drive: (n,) what drives.
        response: (n,) what answers.
        integrates: its rate of change follows the drive.
        windows: judged in windows of 5 s, each with its own offset; by default what integrates.

    Returns:
        The best; its gain is 0 where the drive stands still.
    """
    even, u, y = _even(time, drive, response)
    h = float(even[1] - even[0])
    before = u[0] if np.ptp(u) > 0.0 else 0.0  # a log that begins with its only step: at rest before it
    inside = _inside(even.size, h if (integrates if windows is None else windows) else None)
    goal = inside(y)
    power = float(goal @ goal)

    def at(log_lag: float) -> FirstOrder:
        lag = float(np.exp(log_lag))
        kept = float(np.exp(-h / lag))
        lagged, _ = lfilter(
            [0.0, 1.0 - kept], [1.0, -kept], u, zi=[before]
        )  # the drive is held from its stamp on
        row = inside(cumulative_trapezoid(lagged, dx=h, initial=0.0) if integrates else lagged)
        size = float(row @ row)
        if size == 0.0 or power == 0.0:
            return FirstOrder(0.0, lag, 0.0)
        gain = float(row @ goal) / size
        return FirstOrder(gain, lag, gain * gain * size / power)

    shortest = max(h, float(np.median(np.diff(time))))
    tried = np.linspace(np.log(shortest), np.log(max(0.1 * (even[-1] - even[0]), shortest)), LAGS)
    first = int(np.argmax([at(x).share for x in tried]))
    ends = (float(tried[max(first - 1, 0)]), float(tried[min(first + 1, LAGS - 1)]))
    if ends[0] == ends[1]:
        return at(ends[0])
    found = minimize_scalar(lambda x: -at(x).share, bounds=ends, method="bounded")
    return max(at(float(found.x)), at(float(tried[first])), key=lambda f: f.share)


def _even(time: Array, drive: Array, response: Array) -> tuple[Array, Array, Array]:
    """Stamps, drive and response (m,) at an even rate, of no more samples than are needed."""
    even = np.linspace(time[0], time[-1], min(time.size, ROUGH_SAMPLES))
    held = drive[np.clip(np.searchsorted(time, even, side="right") - 1, 0, time.size - 1)]
    return even, held, np.interp(even, time, response)


def _inside(count: int, h: float | None) -> Callable[[Array], Array]:
    """Takes the mean of each window from (count,) values; of all where no interval `h` between them is given."""
    length = count if h is None else min(max(round(WINDOW / h), 8), count)
    rows = count // length

    def inside(values: Array) -> Array:
        part = values[: rows * length].reshape(rows, length)
        return np.asarray((part - part.mean(axis=1, keepdims=True)).ravel())

    return inside


@dataclass(frozen=True)
class SecondOrder:
    """A place that a force or torque drives and a weight or a spring brings back: ``m y'' + b y' + k y = drive``.

    Attributes:
        mass: m, drive per acceleration.
        damping: b, drive per speed.
        stiffness: k, drive per place.
    """

    mass: float
    damping: float
    stiffness: float


def brought_back(time: Array, drive: Array, response: Array) -> SecondOrder | None:
    """Least squares of a second order; None where it leaves not much less than a place that goes on with its drive.

    Args:
        time: (n,) s.
        drive: (n,) what drives.
        response: (n,) the place.
    """
    even, u, y = _even(time, drive, response)
    h, count = float(even[1] - even[0]), even.size
    inside = _inside(count, h)
    goal = inside(y)
    power = float(goal @ goal)
    slowest, fastest = 2.0 * np.pi * SLOWEST_MODE / (h * count), 2.0 * np.pi / (FASTEST_MODE * h)
    if power == 0.0 or fastest <= slowest:
        return None
    kick = np.zeros(count)
    kick[0] = 1.0

    def at(logs: Array) -> tuple[float, float]:
        """Share that it leaves, and its gain."""
        w, zeta = np.exp(logs)
        numerator, poles, _ = cont2discrete(([w * w], [1.0, 2.0 * zeta * w, w * w]), h, "zoh")
        numerator = np.ravel(numerator)
        free = lfilter([1.0], poles, kick)  # from the first place and speed, whatever they were
        parts = [
            lfilter(numerator, poles, u),
            lfilter(numerator, poles, np.ones(count)),
            free,
            np.append(0.0, free[:-1]),
        ]
        rows = np.stack([inside(part) for part in parts], axis=1)
        found = np.linalg.lstsq(rows, goal, rcond=None)[0]
        left = goal - rows @ found
        return float(left @ left) / power, float(found[0])

    tried = [
        np.array([w, zeta])
        for w in np.linspace(np.log(slowest), np.log(fastest), MODES)
        for zeta in np.log(DAMPINGS)
    ]
    best = min(tried, key=lambda logs: at(logs)[0])
    best = minimize(lambda logs: at(logs)[0], best, method="Nelder-Mead", options={"xatol": 1e-3}).x
    left, gain = at(best)
    w, zeta = np.exp(best)
    on = first_order(time, drive, response, integrates=True)
    if gain <= 0.0 or left >= NEARER * (1.0 - on.share * (on.gain > 0.0)) or not slowest <= w <= fastest:
        return None
    mass = 1.0 / (gain * w * w)
    return SecondOrder(mass, 2.0 * zeta * w * mass, 1.0 / gain)


def stays_with(time: Array, drive: Array, response: Array) -> bool | None:
    """Whether a place follows its drive itself, a demanded place, or (False) goes on as long as that lasts.

    None where neither leaves much less than the other, as of a servo whose limited speed never lets it arrive.
    """
    fits = [first_order(time, drive, response, integrates=on, windows=True) for on in (False, True)]
    itself, summed = (1.0 - max(fit.share * (fit.gain > 0.0), 0.0) for fit in fits)
    if itself < NEARER * summed:
        return True
    return False if summed < NEARER * itself else None


def reach(values: Array) -> float:
    """Half the range of a signal without its hundredth at either end, in its unit."""
    low, high = np.quantile(values, (0.01, 0.99))
    return 0.5 * float(high - low)


def swing(values: Array) -> float:
    """What a signal reaches, in its unit: about zero on both sides or on its only one, about a bias half its range."""
    low, high = np.quantile(values, (0.01, 0.99))
    both, one = float(min(-low, high)), float(max(-low, high))
    if both > ONE_SIDED * one:
        return both
    return one if both > -ONE_SIDED * one else reach(values)


def typical_speed(time: Array, position: Array, lag: float) -> float:
    """Speed that the fastest hundredth of the log exceeds, over stretches of the lag but at least 3 samples."""
    width = max(3, round(lag / float(np.median(np.diff(time)))))
    if position.size <= width:
        return 0.0
    rates = (position[width:] - position[:-width]) / (time[width:] - time[:-width])
    return float(np.quantile(np.abs(rates), 0.99))
