"""A log made ready for the diagnosis, SI, and the free functions of each group."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from cosim.compiled import compiled_block
from cosim.diagnosis.freeform import Basis, changing, families
from cosim.diagnosis.grid import OF_PIECE, Grid, Pieces, cuts_of, plain_name
from cosim.diagnosis.groups import COMPONENT_VALUES, SPEED, Group
from cosim.diagnosis.memory import reversals
from cosim.diagnosis.samples import bridged, stale
from cosim.diagnosis.thresholds import READ_AT_START, SAME_INTERVAL
from cosim.errors import DataError
from cosim.inference.beginning import level, speed
from cosim.inference.pieces import by_piece, slope
from fmus import registry

Array = NDArray[np.float64]

STARTS = ("theta_0", "omega_0", "spool_0", "p_load_0")
SETTLING, SETTLED = 30.0, 300  # s for which a drive is held, and steps of it, until all behind it has settled


@dataclass
class Record:
    """Uniformly sampled signals.

    Attributes:
        h: interval between samples, s; the usual one where it varies.
        signals: name -> (n,) SI, with ``p_load`` where both ports were measured.
        grid: the stamps and the finer steps of a simulation, or those of several logs one behind the other; None where each
            sample is a step.
        rest: s at the start whose mean gives the start angle.
    """

    h: float
    signals: dict[str, Array] = field(repr=False)
    grid: Grid | Pieces | None = field(default=None, repr=False)
    rest: float = READ_AT_START

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
        return [
            Record(h, {n: parts[i] for n, parts in rows.items()}, own, self.rest)
            for i, (h, own) in enumerate(zip(grid.intervals, grid.grids, strict=True))
        ]

    def until(self, count: int) -> "Record":
        """The first samples of one log alone."""
        grid = replace(self.grid, stamps=self.grid.stamps[:count]) if isinstance(self.grid, Grid) else None
        return Record(self.h, {n: v[:count] for n, v in self.signals.items()}, grid, self.rest)

    def has(self, *names: str) -> bool:
        """True if all of these were measured."""
        return all(name in self.signals for name in names)

    def lost(self, name: str) -> NDArray[np.bool_]:
        """(n,) True where a signal is stale because a packet was lost."""
        return by_piece(stale, self.cuts, self.signals[name], self.rate(name))

    def fresh(self, name: str) -> Array:
        """A signal with its stale samples on straight lines between fresh ones."""
        return by_piece(bridged, self.cuts, self.signals[name], self.lost(name), self.time)

    def smooth(self, name: str, cutoff: float = 5.0) -> Array:
        """A signal without what lies above `cutoff` Hz, no phase shift."""
        return low_pass(self.signals[name], self.h, cutoff, self.cuts)

    def rate(self, name: str, cutoff: float = 5.0) -> Array:
        """Time derivative of a signal, smoothed."""
        return slope(self.smooth(name, cutoff), self.h, self.cuts)


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
    return Record(float(np.median(intervals)), signals, pieces, records[0].rest)


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
            found[f"{component}.omega_0"] = level(record.signals[s])
        for output in ("spool", "p_load"):
            if f"{output}_0" in declared and (s := shown_by(group, component, output)) in record.signals:
                found[f"{component}.{output}_0"] = level(record.signals[s])
    if not any(found.values()):
        return {}
    before = settled(group, float(record.signals[group.drive][0])) if group.drive in record.signals else {}
    return before | found


def shown_by(group: Group, component: str, output: str) -> str:
    """The signal of a log that shows an output, also where several sensors together show it; empty for none."""
    together = output in group.observed and component == group.components[-1]
    return output if together else group.shows(component, output)


def settled(group: Group, drive: float) -> dict[str, float]:
    """Start values of the blocks before a group's last one with dynamics where the drive has been held for long, SI."""
    found: dict[str, float] = {}
    signal = np.array([drive])
    for component, block in group.stages:
        if block in ("mechanical", "simplified"):  # an angle does not settle
            break
        compiled = compiled_block(block, component)
        own = {n.partition(".")[2]: v for n, v in COMPONENT_VALUES.items() if n.startswith(component + ".")}
        rows = compiled.run(np.full((1, SETTLED), signal[0]), SETTLING / SETTLED, own, signal)
        for output, values in zip(compiled.outputs, rows, strict=True):
            if f"{output}_0" in compiled.nominal:
                found[f"{component}.{output}_0"] = float(values[-1])
        signal = np.array([rows[0][-1]])
    return found


def low_pass(values: Array, h: float, cutoff: float, cuts: tuple[int, ...] = ()) -> Array:
    """Values (n,) every h s without what lies above `cutoff` Hz, no phase shift, piece by piece."""
    sections = butter(2, min(cutoff * 2.0 * h, 0.9), output="sos")
    return by_piece(lambda row: np.asarray(sosfiltfilt(sections, row)), cuts, values)


def free_bases(
    record: Record, group: Group, values: dict[str, float], predicted: dict[str, Array]
) -> dict[str, list[Basis]]:
    """The free functions for each observed signal of a group.

    They depend on what drives the group and on what the model predicts, never on the signal that is judged: that would
    explain its own noise.

    Args:
        record: the measured signals.
        group: the group.
        values: ``component.parameter`` -> SI, for its linear part.
        predicted: observed signal -> (n,) what the fitted model predicts, SI.
    """
    if group.kind == "dcv":
        found = valve_bases(record, group, values, predicted[group.observed[0]])
    elif group.kind == "continuity":
        found = pressure_bases(record, group, values, predicted)
    else:
        found = {s: motion_bases(record, group, values, s, seen) for s, seen in predicted.items()}
    return {s: [replace(basis, cuts=record.cuts) for basis in bases] for s, bases in found.items()}


def valve_bases(
    record: Record, group: Group, values: dict[str, float], spool: Array
) -> dict[str, list[Basis]]:
    """A missing demand, through the valve's second order (4.16)."""
    h, drive, seen = record.h, group.drive, group.observed[0]
    K, w0, zeta = (values[name] for name in group.linear)
    transfer = ([K * w0 * w0], [1.0, 2.0 * zeta * w0, w0 * w0])
    drivers = {drive: record.signals[drive], seen: spool, f"{seen}_rate": slope(spool, h, record.cuts)}
    found = families(drivers, transfer, h, "demand", "1")
    found += changing(drive, drivers[drive], "time", record.time, transfer, h, "demand", "1")
    for by in (drive, seen):
        rate = drivers[f"{seen}_rate"]
        found += changing(f"{seen}_rate", rate, by, drivers[by], transfer, h, "demand", "1")
    return {seen: found}


def pressure_bases(
    record: Record, group: Group, values: dict[str, float], predicted: dict[str, Array]
) -> dict[str, list[Basis]]:
    """A missing opening, through the first order (4.33), and a missing supply pressure."""
    h, drive, seen = record.h, group.drive, group.observed[0]
    K_c, T = (values[name] for name in group.linear)
    drivers = {seen: predicted[seen]}
    if not group.held:
        spool = record.smooth(drive, 20.0)
        drivers |= {drive: spool, f"{drive}_rate": record.rate(drive, 10.0)}
    else:
        spool = predicted[seen] / K_c  # the opening that the pressure asks for
        drivers[drive] = record.signals[drive]
    # not of the slew: nothing in the continuity depends on it, and slow noise would pass for such a dependence
    transfer = ([K_c], [T, 1.0])
    opening = families(drivers, transfer, h, "opening", "m")
    for by, driver in (("time", record.time), (seen, drivers[seen])):
        opening += changing("spool", spool, by, driver, transfer, h, "opening", "m")
    found = {seen: opening}
    for supply in group.observed[1:]:
        if supply in predicted:
            flow = {"abs(spool)": np.abs(spool)}
            lagged = families(flow, ([1.0], [0.3, 1.0]), h, "lagged supply", "Pa")
            found[supply] = families(flow, None, h, "supply", "Pa") + lagged
    return found


def motion_bases(
    record: Record, group: Group, values: dict[str, float], signal: str, seen: Array
) -> list[Basis]:
    """A missing torque (demand, in the simplified model) through the linear mechanics (4.28), and a missing reading."""
    h, drive, is_speed = record.h, group.drive, group.is_speed(signal)
    angle = by_piece(lambda row: h * np.cumsum(row), record.cuts, seen) if is_speed else seen
    rate = seen if is_speed else slope(angle, h, record.cuts)
    drivers = {"omega": rate, "theta": angle}
    if "p_load" in record.signals:
        drivers["p_load"] = record.smooth("p_load")
    else:
        name = drive if not group.held and group.stages[0][1] == "mechanical" else command_of(record, drive)
        drivers[name] = record.smooth(name) if name == drive and not group.held else record.signals[name]
    transfer = to_motion(group, values, is_speed)
    what, unit = ("demand", "1") if group.kind == "simplified" else ("torque", "N.m")
    found = families(drivers, transfer, h, what, unit)
    factors = [
        ("omega", rate, "time", record.time),
        ("omega", rate, "theta", angle),
        ("acceleration", slope(rate, h, record.cuts), "theta", angle),
    ]
    if "p_load" in drivers:
        direction = np.tanh(rate / max(0.02 * float(np.abs(rate).max()), 1e-300))
        factors.append(("direction", direction, "p_load", np.abs(drivers["p_load"])))
    for of, factor, by, driver in factors:
        found += changing(of, factor, by, driver, transfer, h, what, unit)
    reading = "rad/s" if is_speed else "rad"
    found += families({"omega": rate}, None, h, "reading", reading)
    return found + reversals("theta", angle, "reading", reading, h)


def to_motion(
    group: Group, values: Mapping[str, float], to_speed: bool = False
) -> tuple[list[float], list[float]]:
    """Transfer function from a missing torque to the angle (4.28), or to the speed.

    Of the simplified model it is that from a missing demand.
    """
    one, other = (values[name] for name in group.linear)
    top, bottom = ([one], [1.0, other]) if group.kind == "simplified" else ([1.0], [one, other])
    return (top, bottom) if to_speed else (top, [*bottom, 0.0])


def command_of(record: Record, drive: str) -> str:
    """The command if it was logged, otherwise what drives the group."""
    return "u" if "u" in record.signals else drive
