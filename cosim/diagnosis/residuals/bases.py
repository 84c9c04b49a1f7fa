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
    if group.loop is not None:
        found = loop_bases(record, group, values, predicted)
    elif group.kind == "dcv":
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
    # of how fast it changes: a vessel that is filled and emptied by ways of their own rises and falls in times of their own
    drivers = {seen: predicted[seen], f"{seen}_rate": slope(predicted[seen], h, record.cuts)}
    if not group.commanded:
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
    summed = is_speed and not group.place
    angle = by_piece(lambda row: h * np.cumsum(row), record.cuts, seen) if summed else seen
    rate = seen if summed else slope(angle, h, record.cuts)
    drivers = {"omega": rate, "theta": angle}
    if "p_load" in record.signals:
        drivers["p_load"] = record.smooth("p_load")
    else:
        name = drive if group.stages[0][1] == "mechanical" else command_of(record, drive)
        drivers[name] = record.smooth(name) if name == drive and not group.commanded else record.signals[name]
    transfer = to_motion(group, values, is_speed)
    what, unit = ("demand", "1") if group.kind == "simplified" else ("torque", "N.m")
    found = missing_torque(record, drivers, transfer, what, unit)
    return found + missing_reading(drivers, "rad/s" if is_speed else "rad", h)


def missing_torque(
    record: Record,
    drivers: Mapping[str, Array],
    transfer: tuple[list[float], list[float]],
    what: str,
    unit: str,
) -> list[Basis]:
    """A missing torque that depends on these signals, speed and angle among them, behind a transfer function."""
    h, rate, angle = record.h, drivers["omega"], drivers["theta"]
    found = families(dict(drivers), transfer, h, what, unit)
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
    return found


def missing_reading(drivers: Mapping[str, Array], unit: str, h: float) -> list[Basis]:
    """A sensor that reads by speed, or by the way since the motion last turned, what is not there."""
    found = families({"omega": drivers["omega"]}, None, h, "reading", unit)
    return found + reversals("theta", drivers["theta"], "reading", unit, h)


def loop_bases(
    record: Record, group: Group, values: Mapping[str, float], predicted: dict[str, Array]
) -> dict[str, list[Basis]]:
    """A missing torque and a missing opening, each through pressure and mechanics that feed back, and a missing reading."""
    h, drive, cuts = record.h, group.drive, record.cuts
    shown = {s: group.output_of(s) for s in predicted}
    opened: dict[str, Array] = {
        drive: record.signals[drive] if group.commanded else record.smooth(drive, 20.0)
    }
    moved: dict[str, Array] = {}
    for signal, output in shown.items():
        if output == "p_load":
            opened["p_load"] = predicted[signal]
        elif output != "p_supply" and not moved:
            is_speed = group.is_speed(signal)
            seen = predicted[signal]
            angle = by_piece(lambda row: h * np.cumsum(row), cuts, seen) if is_speed else seen
            moved = {"omega": seen if is_speed else slope(angle, h, cuts), "theta": angle}
    if moved and "p_load" in opened:
        moved["p_load"] = opened["p_load"]
    # where the spool was not measured, at its neutral
    loop = around(group, values, 0.0 if group.commanded else float(np.mean(np.abs(opened[drive]))))
    found: dict[str, list[Basis]] = {}
    for signal, output in shown.items():
        if output == "p_supply":
            flow = {"abs(spool)": np.abs(opened[drive])}
            lagged = families(flow, ([1.0], [0.3, 1.0]), h, "lagged supply", "Pa")
            found[signal] = families(flow, None, h, "supply", "Pa") + lagged
            continue
        pressure, is_speed = output == "p_load", group.is_speed(signal)
        to = "pressure" if pressure else "speed" if is_speed else "angle"
        found[signal] = families(opened, loop["opening", to], h, "opening", "m")
        if moved:
            found[signal] += missing_torque(record, moved, loop["torque", to], "torque", "N.m")
        if moved and not pressure:
            found[signal] += missing_reading(moved, "rad/s" if is_speed else "rad", h)
    return found


def around(
    group: Group, values: Mapping[str, float], spool: float
) -> dict[tuple[str, str], tuple[list[float], list[float]]]:
    """Transfer functions of (4.19)-(4.21) with (4.27), linearised at a mean opening (m) and no load pressure.

    c = 2 beta/V;   dPL/dt = c (k_q x_v - A r w) - k_p PL;   J dw/dt = A r PL - b w + torque

    Returns:
        (torque or opening, pressure or speed or angle) -> numerator and denominator.
    """
    names = [n.rpartition(".")[2] for n in group.linear]
    sizes = [values[n] for n in group.linear]
    split = names.index("J")
    p = dict(zip(names[:split], sizes[:split], strict=True))
    m = dict(zip(names[split:], sizes[split:], strict=True))
    c = 2.0 * p["beta"] / (p["V_L"] + 0.5 * (p["V_A"] + p["V_B"]))
    k_q = p["C_d"] * p["w"] * float(np.sqrt(p["p_s"] / p["rho"]))
    k_p = c * (p["C_L"] + 0.5 * k_q * spool / p["p_s"])
    swept, lever = p["A"] * p["r"], m["A"] * m["r"]
    bottom = [m["J"], m["b"] + k_p * m["J"], k_p * m["b"] + c * swept * lever]
    return {
        ("torque", "pressure"): ([-c * swept], bottom),
        ("torque", "speed"): ([1.0, k_p], bottom),
        ("torque", "angle"): ([1.0, k_p], [*bottom, 0.0]),
        ("opening", "pressure"): ([c * k_q * m["J"], c * k_q * m["b"]], bottom),
        ("opening", "speed"): ([c * k_q * lever], bottom),
        ("opening", "angle"): ([c * k_q * lever], [*bottom, 0.0]),
    }


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
