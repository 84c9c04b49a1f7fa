"""The free functions of each group: what might be missing in it, whatever it depends on."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.residuals.freeform import Basis, changing, families
from cosim.diagnosis.residuals.hysteresis import reversals
from cosim.inference.pieces import by_piece, slope

Array = NDArray[np.float64]


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
