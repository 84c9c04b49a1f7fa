"""A log made ready for the diagnosis, SI."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import resolution
from cosim.compiled import compiled_block
from cosim.diagnosis.model.groups import COMPONENT_VALUES, SPEED, Group
from cosim.diagnosis.record.grid import OF_PIECE, Grid, Pieces, cuts_of, plain_name
from cosim.diagnosis.record.signatures import bridged, stale
from cosim.diagnosis.thresholds import READ_AT_START, SAME_INTERVAL
from cosim.errors import DataError
from cosim.inference.beginning import level, speed
from cosim.inference.pieces import by_piece, slope
from cosim.logs.filter import low_pass_without_shift
from fmus import registry

Array = NDArray[np.float64]

STARTS = ("theta_0", "omega_0", "spool_0", "p_load_0")
HELD_FOR, HELD_STEPS = (
    30.0,
    300,
)  # s for which a drive is held, and steps of it, until all behind it has settled


@dataclass
class Record:
    """Uniformly sampled signals.

    Attributes:
        h: interval between samples, s; the usual one where it varies.
        signals: name -> (n,) SI, with ``p_load`` where both ports were measured.
        grid: the stamps and the finer steps of a simulation, or those of several logs one behind the other; None where each
            sample is a step.
        rest: s at the start whose mean gives the start angle.
        sparse: what the signals did between the samples is not known: sampled more rarely than the drive has news, and
            no mapping says how the command changes.
        filled: name -> (n,) True where a signal's value was missing and lies on a line between others; only signals that
            have such places. They are no evidence.
    """

    h: float
    signals: dict[str, Array] = field(repr=False)
    grid: Grid | Pieces | None = field(default=None, repr=False)
    rest: float = READ_AT_START
    sparse: bool = False
    filled: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict, repr=False)

    @property
    def time(self) -> Array:
        """(n,) s, from zero."""
        if self.grid is not None:
            return self.grid.stamps
        n = len(next(iter(self.signals.values())))
        return np.asarray(np.arange(n) * self.h, dtype=np.float64)

    @property
    def cuts(self) -> tuple[int, ...]:
        """First sample of each log but the first."""
        return cuts_of(self.grid)

    @property
    def pieces(self) -> list["Record"]:
        """The record of each log, by itself."""
        grid = self.grid
        if not isinstance(grid, Pieces):
            return [self]
        rows = {n: np.split(v, grid.cuts) for n, v in self.signals.items()}
        filled = {n: np.split(v, grid.cuts) for n, v in self.filled.items()}
        return [
            Record(
                h,
                {n: parts[i] for n, parts in rows.items()},
                own,
                self.rest,
                self.sparse,
                {n: parts[i] for n, parts in filled.items() if parts[i].any()},
            )
            for i, (h, own) in enumerate(zip(grid.intervals, grid.grids, strict=True))
        ]

    def until(self, count: int) -> "Record":
        """The first samples of one log alone."""
        grid = replace(self.grid, stamps=self.grid.stamps[:count]) if isinstance(self.grid, Grid) else None
        signals = {n: v[:count] for n, v in self.signals.items()}
        filled = {n: v[:count] for n, v in self.filled.items()}
        return Record(self.h, signals, grid, self.rest, self.sparse, filled)

    def has(self, *names: str) -> bool:
        """True if all of these were measured."""
        return all(name in self.signals for name in names)

    def lost(self, name: str) -> NDArray[np.bool_]:
        """(n,) True where a signal is stale because a packet was lost."""
        return by_piece(stale, self.cuts, self.signals[name], self.rate(name))

    def fresh(self, name: str) -> Array:
        """A signal with its stale samples on straight lines between fresh ones."""
        return by_piece(bridged, self.cuts, self.signals[name], self.lost(name), self.time)

    def rounding(self, name: str) -> float:
        """Standard deviation that rounding to a signal's resolution leaves, SI: no error below it counts."""
        read, cuts = as_read(self.signals[name], self.filled.get(name), self.cuts)
        return resolution(read, cuts) / float(np.sqrt(12.0))

    def smooth(self, name: str, cutoff: float = 5.0) -> Array:
        """A signal without what lies above `cutoff` Hz, no phase shift."""
        return low_pass(self.signals[name], self.h, cutoff, self.cuts)

    def rate(self, name: str, cutoff: float = 5.0) -> Array:
        """Time derivative of a signal, smoothed."""
        return slope(self.smooth(name, cutoff), self.h, self.cuts)


def as_read(
    values: Array, filled: NDArray[np.bool_] | None, cuts: tuple[int, ...] = ()
) -> tuple[Array, tuple[int, ...]]:
    """The readings alone, without what stands between them, and the first of each log but the first.

    Straight lines between readings have next to no noise, and levels as close together as one likes.

    Args:
        values: (n,), between the readings filled in.
        filled: (n,) True where they are; None where all are readings.
        cuts: first sample of each log but the first.
    """
    kept = np.arange(values.size) if filled is None else np.flatnonzero(~filled)
    if filled is None or kept.size < 2:
        return values, cuts
    return values[kept], tuple(int(k) for k in np.searchsorted(kept, cuts))


def joined(records: Sequence[Record]) -> Record:
    """One record of several logs of one machine, with the signals that all of them have; of one log, the log's own.

    Raises:
        DataError: their sampling intervals differ by more than `SAME_INTERVAL`.
    """
    if len(records) == 1:
        return records[0]
    intervals = tuple(r.h for r in records)
    if max(intervals) > SAME_INTERVAL * min(intervals):
        told = ", ".join(f"{1e3 * h:.4g} ms" for h in intervals)
        raise DataError(
            f"the logs were sampled every {told}: diagnosed together they must have one interval, within "
            f"{SAME_INTERVAL - 1.0:.0%}; bring the finer ones to the coarsest interval, or diagnose each by itself"
        )
    grids = [r.grid if isinstance(r.grid, Grid) else None for r in records]
    common = [n for n in records[0].signals if all(r.has(n) for r in records)]
    signals = {n: np.concatenate([r.signals[n] for r in records]) for n in common}
    pieces = Pieces(tuple(r.time.size for r in records), intervals, tuple(grids))
    sparse = any(r.sparse for r in records)
    full = [np.zeros(r.time.size, dtype=np.bool_) for r in records]
    filled = {
        n: np.concatenate([r.filled.get(n, none) for r, none in zip(records, full, strict=True)])
        for n in common
        if any(n in r.filled for r in records)
    }
    return Record(float(np.median(intervals)), signals, pieces, records[0].rest, sparse, filled)


def each_left_out(record: Record) -> list[tuple[Record, Record]]:
    """Each log of a record left out in turn: the others, and that one; nothing of one log."""
    pieces = record.pieces if record.cuts else []
    return [(joined([*pieces[:i], *pieces[i + 1 :]]), own) for i, own in enumerate(pieces)]


def fixed_values(record: Record, group: Group) -> dict[str, float]:
    """What each log itself fixes: the state at which it starts; a log that begins in motion has more of it than an angle."""
    found: dict[str, float] = {}
    begun = [begun_values(piece, group) for piece in record.pieces]
    moving = {n for values in begun for n in values}  # one log may begin in motion and the next at rest
    for i, (piece, values) in enumerate(zip(record.pieces, begun, strict=True)):
        own, first = f"{OF_PIECE}{i}" if i else "", 1 if values else max(1, round(piece.rest / piece.h))
        found |= {
            n + own: float(np.mean(piece.signals[s][:first])) for n, s in group.starts if s in piece.signals
        }
        found |= {n + own: values.get(n, 0.0) for n in moving}
    return found


def is_start(name: str) -> bool:
    """Whether ``component.parameter`` is a part of the state at which a log begins."""
    return plain_name(name).rpartition(".")[2] in STARTS


def begun_values(record: Record, group: Group) -> dict[str, float]:
    """Start values of a group's blocks in a log that begins in motion, SI; empty for one that begins at rest.

    What is measured starts at its first reading, a velocity is the slope of the angle. What is not measured is where the
    first value of the drive, held for long, would have brought it.
    """
    found: dict[str, float] = {}
    for component, block in group.stages:
        declared = registry.block(block).parameters
        if "omega_0" in declared and (s := group.shows(component, "theta")) in record.signals:
            found[f"{component}.omega_0"] = speed(record.time, record.signals[s])
        if "omega_0" in declared and (s := group.shows(component, SPEED)) in record.signals:
            found[f"{component}.omega_0"] = level(record.signals[s], record.h)
        for output in ("spool", "p_load"):
            if f"{output}_0" in declared and (s := shown_by(group, component, output)) in record.signals:
                found[f"{component}.{output}_0"] = level(record.signals[s], record.h)
    if not any(found.values()):
        return {}
    before = settled(group, float(record.signals[group.drive][0])) if group.drive in record.signals else {}
    return before | found


def shown_by(group: Group, component: str, output: str) -> str:
    """The signal of a log that shows an output, also where several sensors together show it; empty for none."""
    together = output in group.observed and component in (group.components[-1], *(group.loop or ()))
    return output if together else group.shows(component, output)


def settled(group: Group, drive: float) -> dict[str, float]:
    """Start values of the blocks before a group's last one with dynamics where the drive has been held for long, SI."""
    found: dict[str, float] = {}
    signal = np.array([drive])
    for component, block in group.stages:
        if block in ("mechanical", "simplified", "continuity_physical"):  # an angle does not settle
            break
        compiled = compiled_block(block, component)
        own = {n.partition(".")[2]: v for n, v in COMPONENT_VALUES.items() if n.startswith(component + ".")}
        rows = compiled.run(np.full((1, HELD_STEPS), signal[0]), HELD_FOR / HELD_STEPS, own, signal)
        for output, values in zip(compiled.outputs, rows, strict=True):
            if f"{output}_0" in compiled.nominal:
                found[f"{component}.{output}_0"] = float(values[-1])
        signal = np.array([rows[0][-1]])
    return found


def low_pass(values: Array, h: float, cutoff: float, cuts: tuple[int, ...] = ()) -> Array:
    """Values (n,) every h s without what lies above `cutoff` Hz, no phase shift, piece by piece."""
    return by_piece(lambda row: low_pass_without_shift(row, h, cutoff, order=2), cuts, values)
