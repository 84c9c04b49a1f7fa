"""Ends of the travel in a log: how far the drive would have gone on, had nothing held the axis where it went farthest."""

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.thresholds import NEAR_AN_END, PUSHED_ON, SCATTER_AT_END
from cosim.inference.pieces import Cuts

Array = NDArray[np.float64]

SPANS_OF_LOG = 5000  # a place is looked at no more finely


def lost_at_ends(drive: Array, place: Array, cuts: Cuts = ()) -> float:
    """The way that an axis did not make because it stood at an end, over the way that it made.

    Where it is pushed as when it moves, in the direction in which it went farthest, and stays there, it would otherwise have
    gone on at the speed that such a command gives it elsewhere.

    Args:
        drive: (n,) what moves it.
        place: (n,) where it is.
        cuts: first sample of each log but the first.
    """
    spans = max(1, round(place.size / SPANS_OF_LOG))
    pushes, places, ways = (
        np.concatenate(parts)
        for parts in zip(
            *(steps(u, y, spans) for u, y in zip(np.split(drive, cuts), np.split(place, cuts), strict=True)),
            strict=True,
        )
    )
    made = float(np.abs(ways).sum())
    if ways.size < 3 or made == 0.0:
        return 0.0
    pushes = pushes * (np.sign(pushes @ ways) or 1.0)
    noise = float(np.sqrt(np.median(np.diff(ways) ** 2)))
    near = max(NEAR_AN_END * float(np.ptp(places)), SCATTER_AT_END * noise)
    lost = 0.0
    for side in (1.0, -1.0):
        push, way = side * pushes, side * ways
        moving = np.flatnonzero((push > 0.0) & (way > 0.0))
        if not moving.size:
            continue
        order = moving[np.argsort(push[moving])]
        gone = np.cumsum(way[order])
        usual = push[order][np.searchsorted(gone, 0.5 * gone[-1])]
        there = (side * places).max() - side * places < near
        pushed = push >= PUSHED_ON * usual
        if np.any(pushed & ~there):
            pace = float(way[pushed & ~there].mean())
            lost += max(pace * np.count_nonzero(pushed & there) - near, 0.0)
    return lost / made


def steps(drive: Array, place: Array, spans: int) -> tuple[Array, Array, Array]:
    """Means over spans of samples: of what drives, of where the axis is, and how far it moves until the next."""
    count = place.size // spans
    push, where = (v[: count * spans].reshape(count, spans).mean(axis=1) for v in (drive, place))
    return push[:-1], where[:-1], np.diff(where)
