"""Values that jump off and back: what damage to a file without checksums looks like, and a loose contact too.

Two things speak for the log: the signal jumps as far elsewhere and stays there, so that it jumps by itself; or another
signal answers what it did, or it answers what another one did (`confirmed`). No value is changed: the log loads, and a
warning says where to look.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cosim.logs.answered import confirmed

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

ASKED = 32
"""Stretches that the other signals are asked about: each costs some ten milliseconds."""

_ENOUGH = 20
_NONE: Index = np.empty((0, 2), dtype=np.int64)
_SAMPLED = 1 << 16


def jumps(time: Array, values: Array, held: bool, others: Iterable[Array] = ()) -> tuple[Index, float]:
    """Samples that jump off and back.

    Args:
        time: stamps (n,) [s], strictly increasing.
        values: (n,), finite.
        held: whether the signal is constant between samples: a command, which may jump as it likes.
        others: the log's other signals (n,), finite, which may confirm what this one does.

    Returns:
        Index of the first sample of each stretch, and the largest jump in the values' unit.
    """
    if len(values) < _ENOUGH:
        return _NONE[:, 0], 0.0
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        step = np.diff(values)
        if _states(values):
            return _NONE[:, 0], 0.0
        lost = _vanishing(values)
        if held and np.count_nonzero(step) <= CHANGES * len(step):
            found = _blips(values, step)
        else:
            span = _span(values)
            kinds = [_spikes(time, values, held), _stretches(step, span, held), _zeros(values, step, span)]
            found = np.concatenate([*kinds, *([] if held else [_brief(step, span)])])
        if len(found):
            sound = [other for other in others if other.std() < np.inf]
            asked, rest = found[:ASKED], found[ASKED:]
            alone = [not confirmed(values, begin, end, sound) for begin, end in asked.tolist()]
            found = np.concatenate([asked[alone], rest])
        starts = np.unique(np.concatenate([found, lost])[:, 0])
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
    first = np.union1d(inner[shape] + 1, np.array(ends, dtype=np.int64))
    return np.stack([first, first + 1], axis=1)


def _stretches(step: Array, span: float, held: bool) -> Index:
    """Stretches that begin and end with a jump from one sample to the next, amid samples that do not jump.

    A signal that jumps as far elsewhere and does not come back jumps by itself; a command may stand as a log begins or ends.
    """
    size = np.abs(step)
    limit = 2 * TIMES * _usual(size)
    edges = np.flatnonzero(size > max(limit, 4 * PART * span))
    edges = edges[[size[k] > CALM * _around(size, k, 1, AROUND) for k in edges.tolist()]]
    if not edges.size:
        return _NONE
    short = np.diff(edges) <= LONGEST
    back = step[edges[:-1]] * step[edges[1:]] < 0
    found = [(int(k) + 1, int(m) + 1) for k, m in pairwise(edges)]
    found = [found[k] for k in np.flatnonzero(short & back)]
    moving = np.flatnonzero(step)
    if not held and edges[0] == moving[0] and 0 < edges[0] < LONGEST:  # constant up to the first jump
        found.insert(0, (0, int(edges[0]) + 1))
    if (
        not held and edges[-1] == moving[-1] and 1 < len(step) - edges[-1] <= LONGEST
    ):  # and from the last one on
        found.append((int(edges[-1]) + 1, len(step) + 1))
    if not 0 < len(found) <= FEW:
        return _NONE
    first = np.array(found)
    apart = np.min(np.abs(edges[:, None] + 1 - first.reshape(-1)[None, :]), axis=1) > LONGEST
    least = min(max(size[max(begin - 1, 0)], size[min(end - 1, len(size) - 1)]) for begin, end in found)
    return _NONE if np.any(size[edges[apart]] >= least) else first


def _brief(step: Array, span: float) -> Index:
    """The same of a few samples, where each jump lies around the other. A command may do so: a tap on a stick."""
    size = np.abs(step)
    edges = np.flatnonzero(size > max(2 * TIMES * _usual(size), 4 * PART * span)).tolist()
    first = []
    for k, m in pairwise(edges):
        if 2 <= m - k <= AROUND and step[k] * step[m] < 0:
            around = (size[max(0, k - AROUND) : k], size[k + 1 : m], size[m + 1 : m + 1 + AROUND])
            if min(size[k], size[m]) > CALM * max(part.max(initial=0.0) for part in around):
                first.append((k + 1, m + 1))
    return np.array(first) if 0 < len(first) <= FEW else _NONE


def _vanishing(values: Array) -> Index:
    """Stretches of numbers that are next to nothing and not zero, amid numbers that are not."""
    size = np.abs(values)
    whole = _usual(size)
    least = VANISHING * whole
    if not np.any((size < least) & (size > 0.0)):
        return _NONE
    edges = np.flatnonzero(np.diff(np.concatenate(([False], size < least, [False]))))
    begin, end = edges[::2], edges[1::2]  # [begin, end)
    lost = np.array([bool(np.any(size[b:e] > 0.0)) for b, e in zip(begin, end, strict=True)])
    # what dies away comes near to nothing step by step
    before = np.where(begin > 0, size[np.maximum(begin - 1, 0)], np.inf)
    after = np.where(end < len(size), size[np.minimum(end, len(size) - 1)], np.inf)
    found = lost & (np.minimum(before, after) > PART * whole)
    return _few(begin[found], end[found])


def _zeros(values: Array, step: Array, span: float) -> Index:
    """Stretches of exact zeros amid values far from it; the sample on either side may be half lost."""
    if np.count_nonzero(values) == len(values):
        return _NONE
    edges = np.flatnonzero(np.diff(np.concatenate(([False], values == 0.0, [False]))))
    begin, end = edges[::2], edges[1::2]  # [begin, end)
    limit = max(TIMES * _usual(np.abs(step)), 4 * PART * span)
    before, after = (
        np.abs(values[np.maximum(begin - 2, 0)]),
        np.abs(values[np.minimum(end + 1, len(values) - 1)]),
    )
    inside = (end - begin >= 4) & (end - begin <= LONGEST) & (begin > 1) & (end < len(values) - 1)
    found = inside & (np.minimum(before, after) > limit)
    return _few(begin[found], end[found])


def _blips(values: Array, step: Array) -> Index:
    """In a command made of long constant stretches, samples at a level of their own, and short pauses at such a zero."""
    edges = np.flatnonzero(step)
    if len(edges) < 2:
        return _NONE
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
    return _few(bounds[:-1][odd], bounds[1:][odd])


def _few(begin: Index, end: Index) -> Index:
    """The stretches (k, 2), unless there are so many that they are the signal's own way."""
    return np.stack([begin, end], axis=1) if begin.size <= FEW else _NONE
