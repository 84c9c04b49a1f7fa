"""A log made ready for the diagnosis, SI, and the free functions of each group."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from cosim.diagnosis.freeform import Basis, changing, families
from cosim.diagnosis.grid import Grid
from cosim.diagnosis.groups import Group
from cosim.diagnosis.memory import reversals
from cosim.diagnosis.options import REST
from cosim.diagnosis.samples import bridged, stale

Array = NDArray[np.float64]


@dataclass
class Record:
    """Uniformly sampled signals.

    Attributes:
        h: interval between samples, s; the usual one where it varies.
        signals: name -> (n,) SI, with ``p_load`` where both ports were measured.
        grid: the stamps and the finer steps of a simulation; None where each sample is a step.
        rest: s at the start whose mean gives the start angle.
    """

    h: float
    signals: dict[str, Array] = field(repr=False)
    grid: Grid | None = field(default=None, repr=False)
    rest: float = REST

    @property
    def time(self) -> Array:
        """(n,) s, from zero."""
        if self.grid is not None:
            return self.grid.stamps
        n = len(next(iter(self.signals.values())))
        return np.asarray(np.arange(n) * self.h, dtype=np.float64)

    def until(self, count: int) -> "Record":
        """The first samples alone."""
        grid = None if self.grid is None else replace(self.grid, stamps=self.grid.stamps[:count])
        return Record(self.h, {n: v[:count] for n, v in self.signals.items()}, grid, self.rest)

    def has(self, *names: str) -> bool:
        """True if all of these were measured."""
        return all(name in self.signals for name in names)

    def lost(self, name: str) -> NDArray[np.bool_]:
        """(n,) True where a signal is stale because a packet was lost."""
        return stale(self.signals[name], self.rate(name))

    def fresh(self, name: str) -> Array:
        """A signal with its stale samples on straight lines between fresh ones."""
        return bridged(self.signals[name], self.lost(name), self.time)

    def smooth(self, name: str, cutoff: float = 5.0) -> Array:
        """A signal without what lies above `cutoff` Hz, no phase shift."""
        return low_pass(self.signals[name], self.h, cutoff)

    def rate(self, name: str, cutoff: float = 5.0) -> Array:
        """Time derivative of a signal, smoothed."""
        return np.asarray(np.gradient(self.smooth(name, cutoff), self.h), dtype=np.float64)


def low_pass(values: Array, h: float, cutoff: float) -> Array:
    """Values (n,) every h s without what lies above `cutoff` Hz, no phase shift."""
    sections = butter(2, min(cutoff * 2.0 * h, 0.9), output="sos")
    return np.asarray(sosfiltfilt(sections, values))


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
        return valve_bases(record, group, values, predicted[group.observed[0]])
    if group.kind == "continuity":
        return pressure_bases(record, group, values, predicted)
    return angle_bases(record, group, values, predicted[group.observed[0]])


def valve_bases(
    record: Record, group: Group, values: dict[str, float], spool: Array
) -> dict[str, list[Basis]]:
    """A missing demand, through the valve's second order (4.16)."""
    h, drive, seen = record.h, group.drive, group.observed[0]
    K, w0, zeta = (values[name] for name in group.linear)
    transfer = ([K * w0 * w0], [1.0, 2.0 * zeta * w0, w0 * w0])
    drivers = {drive: record.signals[drive], seen: spool, f"{seen}_rate": np.gradient(spool, h)}
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


def angle_bases(
    record: Record, group: Group, values: dict[str, float], angle: Array
) -> dict[str, list[Basis]]:
    """A missing torque (demand, in the simplified model) through the linear mechanics (4.28), and a missing reading."""
    h, drive = record.h, group.drive
    rate = np.gradient(angle, h)
    drivers = {"omega": rate, "theta": angle}
    if "p_load" in record.signals:
        drivers["p_load"] = record.smooth("p_load")
    else:
        name = drive if not group.held and group.stages[0][1] == "mechanical" else command_of(record, drive)
        drivers[name] = record.smooth(name) if name == drive and not group.held else record.signals[name]
    transfer = to_angle(group, values)
    what, unit = ("demand", "1") if group.kind == "simplified" else ("torque", "N.m")
    found = families(drivers, transfer, h, what, unit)
    factors = [
        ("omega", rate, "time", record.time),
        ("omega", rate, "theta", angle),
        ("acceleration", np.gradient(rate, h), "theta", angle),
    ]
    if "p_load" in drivers:
        direction = np.tanh(rate / max(0.02 * float(np.abs(rate).max()), 1e-300))
        factors.append(("direction", direction, "p_load", np.abs(drivers["p_load"])))
    for of, signal, by, driver in factors:
        found += changing(of, signal, by, driver, transfer, h, what, unit)
    found += families({"omega": rate}, None, h, "reading", "rad")
    return {group.observed[0]: found + reversals("theta", angle, "reading", "rad", h)}


def to_angle(group: Group, values: Mapping[str, float]) -> tuple[list[float], list[float]]:
    """Transfer function from a missing torque to the angle (4.28), from a missing demand in the simplified model."""
    one, other = (values[name] for name in group.linear)
    return ([one], [1.0, other, 0.0]) if group.kind == "simplified" else ([1.0], [one, other, 0.0])


def command_of(record: Record, drive: str) -> str:
    """The command if it was logged, otherwise what drives the group."""
    return "u" if "u" in record.signals else drive
