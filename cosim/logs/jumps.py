"""Values that jump off and back: what damage to a file without checksums looks like, and a loose contact too.

No value is changed: the log loads, and a warning says where to look.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SHARE, TIMES = 0.99, 4.0
"""A sample is off where it misses the line between its neighbours by four times what 99 % of the samples do (ten standard
deviations of normal noise), ..."""

AROUND, CALM = 12, 6.0
"""... by six times what any of twelve samples on either side does: a machine that starts to move is not calm around, ..."""

PART = 0.005
"""... and by this part of the signal's span: less does not matter."""

LONGEST = 256
"""Samples that a stretch may last: two of the sectors in which a disk loses data."""

FEW = 3
"""More stretches than these are taken for the signal's own way."""

CHANGES = 0.1
"""A command that changes at fewer of its samples is made of constant stretches."""

STATES = 12
"""Whole numbers, as few as these: a switch, a gear or a mode, which goes and comes back as it likes."""

STILL = 0.9
"""A step is a signal's own if it exceeds four times what this share of its steps do: what drives a machine steps seldom."""

VANISHING = 1e-40
"""Of a signal's size: nothing that is measured or computed jumps to a number as small as this that is not zero. Half of a
number's bytes are lost there."""

_ENOUGH = 20
_SAMPLED = 1 << 16


def jumps(time: Array, values: Array, held: bool) -> tuple[Index, float]:
    """Samples that jump off and back.

    Args:
        time: stamps (n,) [s], strictly increasing.
        values: (n,), finite.
        held: whether the signal is constant between samples: a command, which may jump as it likes.

    Returns:
        Index of the first sample of each stretch, and the largest jump in the values' unit.
    """
    if len(values) < _ENOUGH:
        return np.empty(0, dtype=np.int64), 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        step = np.diff(values)
        if _states(values):
            return np.empty(0, dtype=np.int64), 0.0
        if held and np.count_nonzero(step) <= CHANGES * len(step):
            starts = np.union1d(_blips(values, step), _vanishing(values))
        else:
            span = _span(values)
            found = [_spikes(time, values, held), _stretches(step, span), _zeros(values, step, span)]
            found += [_vanishing(values), *([] if held else [_brief(step, span)])]
            starts = np.unique(np.concatenate(found))
            starts = starts[np.diff(starts, prepend=-9) > 2]  # a stretch may begin and end with half a number
    if not starts.size:
        return starts, 0.0
    edges = np.where(starts > 0, starts, np.flatnonzero(step)[0])  # a log may begin with the stretch
    return starts, float(np.abs(step[np.array([edges - 1, edges]).clip(0, len(step) - 1)]).max())


def stepping(starts: Index, columns: Mapping[str, Array]) -> list[str]:
    """Columns (n,) that step, too, wherever a stretch starts: what the signal may follow.

    An output that its component hands straight on jumps with its input, and nothing is damaged.
    """
    found = []
    for name, values in columns.items():
        with np.errstate(over="ignore", invalid="ignore"):
            size = np.abs(np.diff(values))
        limit = TIMES * float(np.quantile(size[:: max(1, len(size) // _SAMPLED)], STILL))
        if bool(np.all(size[np.maximum(starts - 1, 0)] > limit)):
            found.append(name)
    return found


def describe(
    name: str, unit: str, starts: Index, size: float, place: Callable[[int], str], others: Sequence[str] = ()
) -> str:
    """The sentence for a log's warnings; `size` in `unit`, `others` step there as well."""
    times = "once" if len(starts) == 1 else f"at {len(starts)} places"
    of = "" if unit == "1" else f" {unit}"
    told = f"{name}: jumps away {times}, by up to {size:.4g}{of} (first: {place(int(starts[0]))})"
    if others:
        return f"{told}, where {' and '.join(others)} steps too: it may follow that; else the file may be damaged there"
    return f"{told}: the file or the signal may be damaged there"


def _states(values: Array) -> bool:
    """Whether a signal holds nothing but a few whole numbers."""
    return bool(np.all(values == np.round(values))) and np.unique(values).size <= STATES


def _usual(sizes: Array) -> float:
    """What 99 % of the sizes do not exceed."""
    return float(np.quantile(sizes[:: max(1, len(sizes) // _SAMPLED)], SHARE))


def _span(values: Array) -> float:
    """Between the lowest and the highest hundredth."""
    low, high = np.quantile(values[:: max(1, len(values) // _SAMPLED)], [1 - SHARE, SHARE])
    return float(high - low)


def _around(sizes: Array, k: int, near: int, far: int) -> float:
    """The largest of the sizes from `near` to `far` places before and after `k`."""
    before, after = sizes[max(0, k - far) : max(0, k - near + 1)], sizes[k + near : k + far + 1]
    return float(max(before.max(initial=0.0), after.max(initial=0.0)))


def _spikes(time: Array, values: Array, held: bool) -> Index:
    """Single samples, by how far each is off the line between its neighbours.

    A command that stands elsewhere after its spike than before it is none: a controller's output kicks where its reference
    steps.
    """
    off = time[1:-1] - time[:-2]  # in place: logs are long
    off /= time[2:] - time[:-2]
    off *= values[:-2] - values[2:]
    off += values[1:-1]
    off -= values[:-2]
    size = np.abs(off)
    inner = np.flatnonzero(size > np.maximum(TIMES * _usual(size), PART * _span(values)))
    inner = inner[[size[k] > CALM * _around(size, k, 2, AROUND) for k in inner.tolist()]]
    if held:
        size_of_step, across = np.abs(np.diff(values)), np.abs(values[2:] - values[:-2])
        inner = inner[[across[k] <= CALM * _around(size_of_step, k, 2, AROUND) for k in inner.tolist()]]
    # the neighbours of a spike miss by half as much to the other side; those of an edge do not
    last = len(off) - 1
    before = np.where(inner > 0, off[np.maximum(inner - 1, 0)], 0.0)
    after = np.where(inner < last, off[np.minimum(inner + 1, last)], 0.0)
    shape = (off[inner] * before <= 0) & (off[inner] * after <= 0)
    shape &= np.maximum(np.abs(before), np.abs(after)) > 0.25 * size[inner]
    shape &= np.minimum(np.abs(before), np.abs(after)) > np.where(
        (inner == 0) | (inner == last), -1.0, 0.25 * size[inner]
    )
    ends = [
        sample
        for sample, k, near in ((0, 0, 1), (len(values) - 1, last, last - 1))
        if k in inner and size[near] < 0.25 * size[k]
    ]
    return np.union1d(inner[shape] + 1, np.array(ends, dtype=np.int64))


def _stretches(step: Array, span: float) -> Index:
    """Stretches that begin and end with a jump from one sample to the next, amid samples that do not jump."""
    size = np.abs(step)
    limit = 2 * TIMES * _usual(size)
    edges = np.flatnonzero(size > max(limit, 4 * PART * span))
    edges = edges[[size[k] > CALM * _around(size, k, 1, AROUND) for k in edges.tolist()]]
    if not edges.size:
        return edges
    short = np.diff(edges) <= LONGEST
    back = step[edges[:-1]] * step[edges[1:]] < 0
    first = (edges[:-1][short & back] + 1).tolist()
    moving = np.flatnonzero(step)
    if edges[0] == moving[0] and 0 < edges[0] < LONGEST:  # constant up to the first jump
        first.insert(0, 0)
    if edges[-1] == moving[-1] and 1 < len(step) - edges[-1] <= LONGEST:  # and from the last one on
        first.append(int(edges[-1]) + 1)
    return np.array(first if len(first) <= FEW else [], dtype=np.int64)


def _brief(step: Array, span: float) -> Index:
    """The same of a few samples, where each jump lies around the other. A command may do so: a tap on a stick."""
    size = np.abs(step)
    edges = np.flatnonzero(size > max(2 * TIMES * _usual(size), 4 * PART * span)).tolist()
    first = []
    for k, m in pairwise(edges):
        if 2 <= m - k <= AROUND and step[k] * step[m] < 0:
            around = (size[max(0, k - AROUND) : k], size[k + 1 : m], size[m + 1 : m + 1 + AROUND])
            if min(size[k], size[m]) > CALM * max(part.max(initial=0.0) for part in around):
                first.append(k + 1)
    return np.array(first if len(first) <= FEW else [], dtype=np.int64)


def _vanishing(values: Array) -> Index:
    """Stretches of numbers that are next to nothing and not zero, amid numbers that are not."""
    size = np.abs(values)
    whole = _usual(size)
    least = VANISHING * whole
    if not np.any((size < least) & (size > 0.0)):
        return np.empty(0, dtype=np.int64)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], size < least, [False]))))
    begin, end = edges[::2], edges[1::2]  # [begin, end)
    lost = np.array([bool(np.any(size[b:e] > 0.0)) for b, e in zip(begin, end, strict=True)])
    # what dies away comes near to nothing step by step
    before = np.where(begin > 0, size[np.maximum(begin - 1, 0)], np.inf)
    after = np.where(end < len(size), size[np.minimum(end, len(size) - 1)], np.inf)
    first = begin[lost & (np.minimum(before, after) > PART * whole)]
    return first if first.size <= FEW else np.empty(0, dtype=np.int64)


def _zeros(values: Array, step: Array, span: float) -> Index:
    """Stretches of exact zeros amid values far from it; the sample on either side may be half lost."""
    if np.count_nonzero(values) == len(values):
        return np.empty(0, dtype=np.int64)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], values == 0.0, [False]))))
    begin, end = edges[::2], edges[1::2]  # [begin, end)
    limit = max(TIMES * _usual(np.abs(step)), 4 * PART * span)
    before, after = (
        np.abs(values[np.maximum(begin - 2, 0)]),
        np.abs(values[np.minimum(end + 1, len(values) - 1)]),
    )
    inside = (end - begin >= 4) & (end - begin <= LONGEST) & (begin > 1) & (end < len(values) - 1)
    first = begin[inside & (np.minimum(before, after) > limit)]
    return first if first.size <= FEW else np.empty(0, dtype=np.int64)


def _blips(values: Array, step: Array) -> Index:
    """In a command made of long constant stretches, samples at a level of their own, and short pauses at such a zero."""
    edges = np.flatnonzero(step)
    if len(edges) < 2:
        return np.empty(0, dtype=np.int64)
    bounds = np.concatenate(([0], edges + 1, [len(values)]))
    lengths, level = np.diff(bounds), values[bounds[:-1]]
    odd = np.zeros(len(lengths), dtype=bool)
    calm = np.minimum(lengths[:-2], lengths[2:]) >= 4
    # damage does not hit upon a level of its own: a controller that switches does
    strange = ~np.isin(level, level[lengths > 1])
    odd[1:-1] = (level[:-2] == level[2:]) & (lengths[1:-1] == 1) & calm & strange[1:-1]
    zero = (level == 0.0) & (lengths > 1)
    usual = np.median(lengths[lengths > 2]) if (lengths > 2).any() else 0.0
    if zero.any() and not zero[0] and not zero[-1] and lengths[zero].max() <= min(LONGEST, 0.5 * usual):
        odd |= zero
    first = bounds[:-1][odd]
    return first if first.size <= FEW else np.empty(0, dtype=np.int64)
