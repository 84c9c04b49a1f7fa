"""The static curve of the drive as a picture and a table of the page."""

import numpy as np

from cosim.diagnosis.answer.schema import DriveNumber
from cosim.report.material import Material
from cosim.report.picture import Layer, Panel, Picture
from cosim.report.words import axis, number, shows_speed, signal_name, unit_text

SLOPE = "slope"
NUMBER_NAMES = (("dead_zone", "dead zone"), ("slope", SLOPE), ("top_speed", "top speed"))
SIDES = (("low", "lower side"), ("high", "upper side"))
FINEST = 1e-3
CAPTION = (
    "Straight lines: dead zone, slope and top speed as in the table. Curve and band: fitted freely, it only has to rise; "
    "where the two part the drive is no such straight line. From all stretches of half a second of {logs}."
)
MODELS = " Of the models: the speed in which a lasting command ends, from rest."


def picture(material: Material) -> Picture | None:
    """Speed over command: what the log says, the models, and what the table says as lines; None without a curve."""
    curve = material.answer.drive_curve
    if curve is None:
        return None
    command, motion = curve.command, curve.motion
    unit, scale = parts_of_full(command["unit"])
    u, speed, low, high = np.array(curve.points, dtype=np.float64).T
    corners, edges = lined(material)
    layers = [
        Layer("line", "free curve", "plain", scale * u, speed),
        Layer(
            "line",
            "dead zone, slope, top speed",
            "measured",
            scale * corners,
            edges,
            hidden=bool(curve.simulated),
        ),
    ]
    if curve.simulated:
        at, nominal, extended = np.array(curve.simulated, dtype=np.float64).T
        layers.append(Layer("line", "nominal model", "nominal", scale * at, nominal))
        if not np.isnan(extended).any():
            layers.append(Layer("line", "extended model", "extended", scale * at, extended))
    # at an end that one log reached once, the band may be many times as wide as all curves
    drawn = np.concatenate([layer.y for layer in layers])
    least, most = float(drawn.min()) - float(np.ptp(drawn)), float(drawn.max()) + float(np.ptp(drawn))
    band = np.clip(low, least, most), np.clip(high, least, most)
    layers.insert(0, Layer("band", "95 % band", "measured", scale * u, *band))
    moved = signal_name(motion["signal"])
    speed_of = moved if shows_speed(motion["signal"]) else f"speed of {moved}"
    return Picture(
        "drive-curve",
        "Static curve of the drive",
        axis(signal_name(command["signal"]), unit),
        [Panel(axis(speed_of, motion["unit"]), layers)],
        CAPTION.format(logs=" and ".join(curve.logs)) + (MODELS if curve.simulated else ""),
    )


def parts_of_full(unit: str) -> tuple[str, float]:
    """Unit in which a command is shown, and how many of it make one as it is told: parts of full command are per cent."""
    return ("%", 100.0) if unit in ("1", "") else (unit, 1.0)


def lined(material: Material) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the curve that the numbers make: (k,) commands and speeds, in the units people read."""
    curve = material.answer.drive_curve
    assert curve is not None
    first, last = curve.points[0][0], curve.points[-1][0]
    found = [(0.0, 0.0)]
    for side, end in (("low", first), ("high", last)):
        edge, slope, top = (getattr(curve, kind).get(side) for kind, _ in NUMBER_NAMES)
        if edge is None or slope is None:
            continue
        corner = end if top is None else edge.value + top.value / slope.value
        found.append((edge.value, 0.0))
        if top is not None and abs(corner) < abs(end):
            found += [(corner, top.value), (end, top.value)]
        else:
            found.append((end, slope.value * (end - edge.value)))
    found.sort()
    return np.array([x for x, _ in found]), np.array([y for _, y in found])


def rows(material: Material) -> list[tuple[str, str, str, str, str]]:
    """(what, estimate, 95 % interval, unit, as read in the log) of each number of the curve."""
    return [
        (f"{what}, {where}", value, ends, unit, read)
        for what, where, value, ends, unit, read in by_side(material)
    ]


def by_side(material: Material, sure: bool = False) -> list[tuple[str, str, str, str, str, str]]:
    """The same with what it is and its side apart, the sides of one thing behind one another.

    Args:
        material: its answer has the curve, or none.
        sure: only numbers whose interval excludes none at all.
    """
    curve = material.answer.drive_curve
    if curve is None:
        return []
    found = []
    for kind, words in NUMBER_NAMES:
        for side, where in SIDES:
            item: DriveNumber | None = getattr(curve, kind).get(side)
            if item is None or (sure and item.ci95[0] <= 0.0 <= item.ci95[1]):
                continue
            # what is known better than a thousandth of what the curve spans is no news
            along = [point[0 if kind == "dead_zone" else 1] for point in curve.points]
            finest = FINEST * (max(along) - min(along)) * (0.0 if kind == "slope" else 1.0)
            spread = max(0.5 * (item.ci95[1] - item.ci95[0]), finest)
            read = ""
            if item.reading is not None:
                first, second = item.reading.ci95
                known = item.ci95[1] - item.ci95[0]
                wide = 0.5 * abs(second - first) * (2.0 * spread / known if known > 0.0 else 1.0)
                ends = " to ".join(number(v, wide) for v in item.reading.ci95)
                read = f"{item.reading.column}: {number(item.reading.value, wide)} ({ends})"
            unit, scale = parts_of_full(item.unit) if kind == "dead_zone" else (item.unit, 1.0)
            value, low, high = (number(scale * v, scale * spread) for v in (item.value, *item.ci95))
            found.append((words, where, value, f"{low} to {high}", unit_text(unit), read))
    return found
