"""Whether the rest of a log confirms a stretch of a signal: what a machine answers was commanded, and is no damage.

A signal that may answer is forecast one block ahead from its own two last blocks and the last ones of what it may follow,
by least squares over the log without the stretch. It has answered if its forecasts in and after the stretch are about as
good as elsewhere, and clearly worse once the stretch is taken out of what it follows.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PARTS = 4
"""Blocks that a stretch is cut into: an answer need not be as quick as the samples come."""

PAST = 8
"""Blocks of the command that a forecast sees: an answer may come twice the stretch's length late."""

LOG_ODDS = 4.6
"""Natural logarithm of the odds by which a signal must be for the stretch: a hundred to one."""

MISSED = 6.0
"""Times the usual mean square by which its forecasts may miss there: a machine is not linear. Foreign numbers in the place
of a command miss by tens and hundreds of times, ..."""

CLEARLY = 12.0
"""... and still no more than a fifth of what they miss without them: so much less to miss is an answer, however it was
forecast."""

ROUNDING = 1e-20
"""Of the square of a signal's span: what follows exactly misses by no less."""

_BLOCKS = 300, 20_000
"""At least as many, where the log has them: twelve numbers are to be found. No more than this: it takes milliseconds."""


def confirmed(values: Array, begin: int, end: int, others: Sequence[Array]) -> bool:
    """Whether another signal (n,) follows a signal's samples from `begin` to before `end`, or they follow another signal."""
    return answered(values, begin, end, others) or any(
        answered(other, begin, end, [values]) for other in others
    )


def answered(command: Array, begin: int, end: int, others: Iterable[Array]) -> bool:
    """Whether one of the other signals (n,) follows the samples from `begin` to before `end` of a command (n,).

    All are finite. A signal that does not tell has not answered.
    """
    size = max(1, min((end - begin) // PARTS, len(command) // _BLOCKS[0]))
    first = begin - min(begin // size, _BLOCKS[1] // 2) * size  # a block begins with the stretch
    count = min((len(command) - first) // size, _BLOCKS[1])
    part = slice(first, first + count * size)

    def blocks(values: Array) -> Array:
        return values[part].reshape(count, size).mean(axis=1)

    without = command[: part.stop].copy()
    without[begin:end] = _across(command, begin, end)[: part.stop - begin]
    if count <= 4 * PAST:
        return False
    rows = np.arange(PAST, count)
    logged, taken = (
        np.stack([x[rows - k] for k in range(PAST)], axis=1) for x in map(blocks, (command, without))
    )
    near = np.any(logged != taken, axis=1)
    if not near.any() or np.count_nonzero(~near) <= 2 * PAST:
        return False
    return any(_follows(blocks(other), logged, taken, near) for other in others)


def _across(command: Array, begin: int, end: int) -> Array:
    """The straight line across a stretch; constant where the log begins or ends with it."""
    before = command[begin - 1] if begin else command[min(end, len(command) - 1)]
    after = command[end] if end < len(command) else before
    return np.linspace(before, after, end - begin + 2)[1:-1]


def _follows(other: Array, logged: Array, taken: Array, near: NDArray[np.bool_]) -> bool:
    """Whether a signal (m,) in blocks follows the command as logged, where that differs from the one without the stretch."""
    if not np.ptp(other):
        return False
    scaled = (other - other.mean()) / np.ptp(other)
    past = np.stack([np.ones(len(other) - PAST), scaled[PAST - 1 : -1], scaled[PAST - 2 : -2]], axis=1)
    now = scaled[PAST:]
    gains = np.linalg.lstsq(np.hstack([past, logged])[~near], now[~near], rcond=None)[0]
    with_it, without_it = ((now - np.hstack([past, x]) @ gains) ** 2 for x in (logged, taken))
    usual = max(float(with_it[~near].mean()), ROUNDING)
    misses, would_miss = float(with_it[near].mean()), float(without_it[near].mean())
    # what is missed as usual is not held for better than that
    odds = 0.5 * np.count_nonzero(near) * np.log((would_miss + usual) / (misses + usual))
    return bool(odds > LOG_ODDS and misses <= max(MISSED * usual, would_miss / CLEARLY))
