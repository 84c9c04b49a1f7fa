"""Rough numbers of a machine from its own log: gain and lag of a first order, so that a search can begin."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

Array = NDArray[np.float64]

WINDOW = 5.0  # s: an integrated response drifts with all that a first order lacks
LAGS = 20  # lags that are tried first, evenly spaced in their logarithm
# a side that is reached less than this part of the other is not used; a signal that stays as far off zero has a bias
ONE_SIDED = 0.25
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


class Piece(NamedTuple):
    """One log of a machine.

    Attributes:
        time: (n,) s.
        drive: (n,) what drives.
        response: (n,) what answers.
    """

    time: Array
    drive: Array
    response: Array


def first_order(pieces: Sequence[Piece], *, integrates: bool) -> FirstOrder:
    """Least squares over gain and offset for lags from one sample to a tenth of the longest log.

    Behind a dead zone each log has a gain of its own: beside those the lag is sought. The gain is that of all.

    Args:
        pieces: the logs.
        integrates: the response's rate of change follows the drive; it is then judged in windows of 5 s, each with its own
            offset.

    Returns:
        The best; its gain is 0 where the drive stands still.
    """
    each = [Evenly.of(piece, ROUGH_SAMPLES // len(pieces), integrates) for piece in pieces]
    goals = [own.inside(own.response) for own in each]
    power = float(sum(goal @ goal for goal in goals))

    def at(log_lag: float) -> FirstOrder:
        lag = float(np.exp(log_lag))
        rows = [own.inside(own.answer(lag, integrates)) for own in each]
        sizes = np.array([row @ row for row in rows])
        if not sizes.any() or power == 0.0:
            return FirstOrder(0.0, lag, 0.0)
        products = np.array([row @ goal for row, goal in zip(rows, goals, strict=True)])
        explained = float(np.sum(products**2 / np.where(sizes > 0.0, sizes, np.inf)))
        return FirstOrder(float(products.sum() / sizes.sum()), lag, explained / power)

    shortest = max(
        max(own.h, float(np.median(np.diff(piece.time)))) for own, piece in zip(each, pieces, strict=True)
    )
    longest = max(float(piece.time[-1] - piece.time[0]) for piece in pieces)
    tried = np.linspace(np.log(shortest), np.log(max(0.1 * longest, shortest)), LAGS)
    first = int(np.argmax([at(x).share for x in tried]))
    ends = (float(tried[max(first - 1, 0)]), float(tried[min(first + 1, LAGS - 1)]))
    if ends[0] == ends[1]:
        return at(ends[0])
    found = minimize_scalar(lambda x: -at(x).share, bounds=ends, method="bounded")
    return max(at(float(found.x)), at(float(tried[first])), key=lambda f: f.share)


class Evenly(NamedTuple):
    """One log on even stamps, in windows.

    Attributes:
        h: interval, s.
        length: samples of a window.
        drive: (n,) what drives, held from its stamp on.
        response: (n,) what answers.
    """

    h: float
    length: int
    drive: Array
    response: Array

    @classmethod
    def of(cls, piece: Piece, most: int, integrates: bool) -> "Evenly":
        """At most so many samples of a log."""
        time = piece.time
        count = max(min(time.size, most), 2)
        even = np.linspace(time[0], time[-1], count)
        h = float(even[1] - even[0])
        held = piece.drive[np.clip(np.searchsorted(time, even, side="right") - 1, 0, time.size - 1)]
        length = min(max(round(WINDOW / h), 8), count) if integrates else count
        return cls(h, length, held, np.interp(even, time, piece.response))

    def inside(self, values: Array) -> Array:
        """Values less their mean in each whole window."""
        rows = values.size // self.length
        part = values[: rows * self.length].reshape(rows, self.length)
        return np.asarray((part - part.mean(axis=1, keepdims=True)).ravel())

    def answer(self, lag: float, integrates: bool) -> Array:
        """(n,) the drive behind a lag, s, or what piles up of it."""
        kept = float(np.exp(-self.h / lag))
        lagged, _ = lfilter([0.0, 1.0 - kept], [1.0, -kept], self.drive, zi=[self.drive[0]])
        return np.asarray(cumulative_trapezoid(lagged, dx=self.h, initial=0.0) if integrates else lagged)


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
