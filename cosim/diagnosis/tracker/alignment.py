"""Laying a tracker's record over a log without knowing anything of its clock."""

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.thresholds import CLOCK_MOTION, CLOCK_OVERLAP, CLOCK_READINGS
from cosim.errors import DataError

Array = NDArray[np.float64]

COARSE_OFFSETS, FINE_OFFSETS = 0.1, 0.02  # s between the offsets that are tried
CANDIDATES = 3  # offsets handed on: a repeating motion fits at several
RATE_PARTS = 6  # of the record, each laid over the log by itself, which gives the rate
PART_REACH = 2.0  # s by which a part may be off the offset of the whole


def first_offsets(time: Array, slew: Array, stamps: Array, readings: Array) -> list[tuple[float, float]]:
    """Find candidates of (offset [s], rate) that lay a tracker's record over the log, the best first.

    Args:
        time: (n,) of the log, s from 0.
        slew: (n,) of the log, rad.
        stamps: (m,) of the tracker, on its own clock, s.
        readings: (m,) of the tracker, rad.

    Raises:
        DataError: the two records do not overlap enough, or neither moves.
    """
    span = float(stamps[-1] - stamps[0])
    shortest = CLOCK_OVERLAP * min(span, float(time[-1]))
    thin = max(1, round(COARSE_OFFSETS / float(np.median(np.diff(stamps)))))
    s, y = stamps[::thin], readings[::thin]
    offsets = np.arange(-s[0] - span + shortest, time[-1] - s[0] - shortest + COARSE_OFFSETS, COARSE_OFFSETS)
    costs = np.array([_cost(o, 1.0, time, slew, s, y) for o in offsets])
    if not np.isfinite(costs).any() or np.ptp(slew) < CLOCK_MOTION:
        raise DataError(
            "the tracker's record cannot be laid over the log: they do not overlap, or the slew does not move"
        )
    padded = np.concatenate([[np.inf], costs, [np.inf]])
    dips = np.flatnonzero((padded[1:-1] <= padded[:-2]) & (padded[1:-1] <= padded[2:]) & np.isfinite(costs))
    dips = dips[np.argsort(costs[dips])][:CANDIDATES]
    return [_refined(float(offsets[k]), time, slew, stamps, readings) for k in dips]


def _cost(offset: float, rate: float, time: Array, slew: Array, s: Array, y: Array) -> float:
    """Variance of the difference, rad2, a straight line left out: a drifting sensor would hide a small motion behind it.

    Infinite where too little overlaps.
    """
    t = offset + rate * s
    inside = (t >= 0.0) & (t <= time[-1])
    if inside.sum() < max(
        CLOCK_READINGS, CLOCK_OVERLAP * min(s.size, s.size * time[-1] / max(s[-1] - s[0], 1e-9))
    ):
        return float("inf")
    difference, since = y[inside] - np.interp(t[inside], time, slew), t[inside] - t[inside].mean()
    line = float(since @ difference) ** 2 / max(float(since @ since), 1e-300)
    return float(np.var(difference)) - line / difference.size


def _refined(offset: float, time: Array, slew: Array, stamps: Array, readings: Array) -> tuple[float, float]:
    """Offset and rate from where each part of the record fits best near an offset of the whole."""
    thin = max(1, round(COARSE_OFFSETS / 2.0 / float(np.median(np.diff(stamps)))))
    middles, offsets, weights = [], [], []
    for part in np.array_split(np.arange(0, stamps.size, thin), RATE_PARTS):
        s, y = stamps[part], readings[part]
        tried = offset + np.arange(-PART_REACH, PART_REACH + FINE_OFFSETS, FINE_OFFSETS)
        costs = np.array([_cost(o, 1.0, time, slew, s, y) for o in tried])
        if part.size < CLOCK_READINGS or not np.isfinite(costs).any() or np.ptp(y) < CLOCK_MOTION:
            continue
        k = int(np.argmin(costs))
        middles.append(float(s.mean()))
        offsets.append(float(tried[k]))
        # a part that moves much tells much
        weights.append(float(np.std(y)) if 0 < k < tried.size - 1 else 0.0)
    if sum(w > 0.0 for w in weights) < 2:
        return offset, 1.0
    slope, level = np.polyfit(middles, offsets, 1, w=weights)
    return float(level), float(1.0 + slope)
