"""Long logs: the stretch that the fits use, and whether what they found holds in the rest.

Five minutes at 1 kHz say all that a log can say about effects that do not change; three hours would only cost time and
memory in proportion. What changes, or happens once, shows when the extended model is run over the rest.
"""

from collections.abc import Iterable, Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.whole import ChainModel
from cosim.diagnosis.found import Diagnosis, Elsewhere
from cosim.diagnosis.record.record import Record, fixed_values
from cosim.diagnosis.record.signatures import cells
from cosim.diagnosis.thresholds import (
    FEWEST_SAMPLES,
    LEVELS,
    LONGEST,
    LONGEST_SAMPLES,
    SETTLING,
    SHORT_PIECE,
    VISITED,
    WORSE_ELSEWHERE,
)
from cosim.logs import Log

Array = NDArray[np.float64]

PIECE = 1.0 / 15.0  # of a stretch, by which it is moved


def longest(log: Log) -> float:
    """Length of the stretch of a log, s: what is sampled slowly needs a longer one, and costs as much."""
    return max(LONGEST, LONGEST_SAMPLES * log.step)


def chosen_stretch(log: Log, drive: str = "u", from_start: bool = False) -> Log:
    """The part of a log that the fits use: the log itself, or as much as is `longest` whose command visits most.

    Visited is counted in cells of level and direction of the command; among equals the command that moves most wins,
    then the earliest.

    Args:
        log: the log.
        drive: the command.
        from_start: the first seconds in any case, because another clock is counted from there.
    """
    length = longest(log)
    if log.duration <= length or drive not in log:
        return log
    if from_start:
        return log.slice(None, float(log.time[0]) + length)
    piece, width = length * PIECE, round(1.0 / PIECE)
    u = log[drive]
    low, size = float(u.min()), max(float(np.ptp(u)), 1e-300)
    edges = np.searchsorted(log.time, log.time[0] + piece * np.arange(int(log.duration / piece) + 1))
    rows = []
    travel = []
    for a, b in pairwise(edges.tolist()):  # piece by piece: a long log fills the memory as it is
        part = u[a:b]
        rows.append(np.bincount(cells(part, low, size), minlength=3 * LEVELS))
        travel.append(float(np.abs(np.diff(part)).sum()))
    table = np.array(rows)
    best, found = (-1, -1.0), 0
    for first in range(len(rows) - width + 1):
        visited = int((table[first : first + width].sum(axis=0) * log.step >= VISITED).sum())
        score = (visited, round(sum(travel[first : first + width]), 6))
        if score > best:
            best, found = score, first
    start = float(log.time[0]) + found * piece
    return log.slice(start, start + length)


def others(log: Log, part: Log) -> list[Log]:
    """The rest of a log in pieces of at most the stretch's length; what is too short to judge is left out."""
    found, length = [], longest(log)
    least = max(SHORT_PIECE, (FEWEST_SAMPLES + 1) * log.step)
    for low, high in ((log.time[0], part.time[0]), (part.time[-1], log.time[-1])):
        count = max(1, int(np.ceil((high - low) / length)))
        edges = np.linspace(low, high, count + 1)
        found += [log.slice(a, b) for a, b in pairwise(edges) if b - a > least]
    return found


def settled_error(residual: Array, h: float, window: int) -> float:
    """Root of the median mean square of windows of a residual (n,), each without its mean.

    The start does not count, where the state is not known; nor does what happens rarely.
    """
    rows = residual[round(SETTLING / h) :]
    count = rows.size // window
    rows = rows[: count * window].reshape(count, window)
    return float(np.sqrt(np.median(np.var(rows, axis=1)))) if count else 0.0


def elsewhere(
    found: Diagnosis, pieces: Iterable[tuple[Log, Record]], values: Mapping[str, float]
) -> list[Elsewhere]:
    """The pieces of the rest in which the model errs noticeably more than in the stretch that was used, run by the twin.

    Args:
        found: the diagnosis of the stretch.
        pieces: the rest, and the same prepared.
        values: ``component.parameter`` -> SI of the extended model.
    """

    def errors(record: Record) -> dict[str, float]:
        simulated = by_twin(found, record, values)
        seen = [s for s in simulated if s in record.signals]
        return {s: settled_error(record.signals[s] - simulated[s], record.h, found.window) for s in seen}

    here = errors(found.record)
    listed = []
    for piece, record in pieces:
        low, high = float(piece.time[0]), float(piece.time[-1])
        ratios = {s: e / here[s] for s, e in errors(record).items() if here[s] > 0.0}
        listed += [
            Elsewhere(s, low, high, ratio, piece.name)
            for s, ratio in ratios.items()
            if ratio > WORSE_ELSEWHERE
        ]
    return listed


def by_twin(found: Diagnosis, record: Record, values: Mapping[str, float]) -> dict[str, Array]:
    """Signals of the model on a record's command, (n,) SI, by the compiled twin; it starts at the record's angle."""
    start = {n: v for g in found.groups for n, v in fixed_values(record, g).items()}
    own = {n: v for n, v in values.items() if n not in start}
    return ChainModel(found.groups, record, start).simulate(own)
