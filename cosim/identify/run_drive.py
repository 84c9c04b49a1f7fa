"""``cosim identify drive``: from logs, and what their mapping says of the columns, to `Answer`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from cosim.errors import DataError
from cosim.identify.answer import Answer
from cosim.identify.drive_curve import OF_ITS_OWN, DriveCurve, Estimate, drive_curve, not_set
from cosim.identify.drive_fit import Run
from cosim.identify.drive_held_out import Predicted, predicted
from cosim.logs import Log, Mapping
from cosim.units import factor, is_speed, of_speed

Array = NDArray[np.float64]

CURVE_COLUMNS = ["number", "value", "95 % from", "to", "unit", "as read"]
WORDS = {
    "dead_low": "dead zone, low",
    "dead_high": "dead zone, high",
    "slope_low": "slope, low",
    "slope_high": "slope, high",
    "top_low": "top speed, low",
    "top_high": "top speed, high",
}


@dataclass(frozen=True)
class Told:
    """Units in which a curve is told.

    Attributes:
        command, motion: names of the signals.
        command_unit, speed_unit: what people read; the speed is that of the motion, which may be measured as such.
        command_scale, motion_scale: shown per SI.
        column: heading of the command in the file, where its readings are another number than the command.
        zero, gain: command [its unit] = gain (reading - zero).
    """

    command: str
    motion: str
    command_unit: str
    speed_unit: str
    command_scale: float = 1.0
    motion_scale: float = 1.0
    column: str = ""
    zero: float = 0.0
    gain: float = 1.0

    def of(self, name: str) -> tuple[str, float]:
        """Unit of a number of the curve, and shown per SI."""
        speed = self.speed_unit
        if name.startswith("dead"):
            return self.command_unit, self.command_scale
        if name.startswith("top"):
            return speed, self.motion_scale
        unit = speed if self.command_unit == "1" else f"{speed}/({self.command_unit})"
        return unit, self.motion_scale / self.command_scale

    def reading(self, command: float) -> float:
        """What stands in the file for a command [its unit]."""
        return self.zero + command / self.gain


def told_of(log: Log, mapping: Mapping | None, command: str, motion: str) -> Told:
    """The units of a log's command and motion.

    Raises:
        DataError: the log does not hold one of them, or the command is a demanded place.
    """
    for name in (command, motion):
        log.require(name, "the static curve of a drive")
    if mapping is not None and mapping.machine.get("command") == "place":
        raise DataError(
            f"{log.source}: '{command}' is a demanded place (command = \"place\"): a drive that holds it has no static "
            "curve of speed against command; give what its controller puts out, or cosim diagnose the log"
        )
    shown = {n: log.display[n] for n in (command, motion)}
    scales = {n: factor(log.units[n], unit) for n, unit in shown.items()}
    found = Told(command, motion, shown[command], of_speed(shown[motion]), scales[command], scales[motion])
    column = mapping.signals.get(command) if mapping is not None else None
    if column is None or isinstance(column.gain, str):
        return found
    gain = column.sign * column.gain * factor(column.unit or shown[command], shown[command])
    zero = column.zero - column.offset / (column.sign * column.gain)
    if (gain, zero) == (1.0, 0.0):
        return found
    heading = column.column[0] if isinstance(column.column, tuple) else str(column.column)
    return Told(**{**vars(found), "column": heading, "zero": zero, "gain": gain})


def run_of(log: Log, told: Told) -> Run:
    """A log as the curve is estimated from it.

    Raises:
        DataError: it counts samples and has no time.
    """
    if log.time_unit != "s":
        raise DataError(f"{log.source}: it counts samples and has no time, so a speed cannot be told from it")
    motion, rate = log[told.motion], is_speed(log.units[told.motion])
    return Run(log.name, log.time, log[told.command], way(log.time, motion) if rate else motion)


def way(time: Array, speed: Array) -> Array:
    """(n,) what a measured speed has covered: the curve is that of the way over short stretches."""
    return np.asarray(cumulative_trapezoid(speed, time, initial=0.0))


def ends(mapping: Mapping | None) -> tuple[str, str]:
    """Names of command and motion: those of the mapping's machine, else ours."""
    machine = mapping.machine if mapping is not None else {}
    return str(machine.get("input", "u")), str(machine.get("output", "slew"))


def moved_by(log: Log, command: str, usual: str) -> str:
    """The motion of a log: the usual one, or the one signal beside the command where it is not there.

    Raises:
        DataError: several might be it.
    """
    others = [name for name in log.signals if name != command]
    if usual in log or len(others) < 2:
        return usual if usual in log or not others else others[0]
    raise DataError(
        f"{log.source}: which signal is the motion of the drive? Say --motion {' or '.join(others)}"
    )


def number(estimate: Estimate, unit: str, scale: float) -> dict[str, Any]:
    """An estimate as JSON, in the unit people read."""
    low, high = sorted((estimate.low * scale, estimate.high * scale))
    return {"value": estimate.value * scale, "unit": unit, "ci95": [low, high]}


def curve_data(curve: DriveCurve, told: Told) -> dict[str, Any]:
    """The curve as JSON."""
    sides: dict[str, dict[str, Any]] = {"dead_zone": {}, "slope": {}, "top_speed": {}}
    kinds = {"dead": "dead_zone", "slope": "slope", "top": "top_speed"}
    for name, estimate in curve.values.items():
        kind, _, side = name.partition("_")
        entry = number(estimate, *told.of(name))
        if kind == "dead" and told.column:
            read = sorted(told.reading(v) for v in entry["ci95"])
            entry["reading"] = {"value": told.reading(entry["value"]), "ci95": read, "column": told.column}
        sides[kinds[kind]][side] = entry
    speed = told.motion_scale
    points = [
        [float(u * told.command_scale), float(v * speed), float(low * speed), float(high * speed)]
        for u, v, low, high in zip(curve.knots, curve.speeds, *curve.band, strict=True)
    ]
    return {
        "command": {"signal": told.command, "unit": told.command_unit},
        "motion": {"signal": told.motion, "unit": told.speed_unit},
        **sides,
        "lag": {"value": curve.lag + curve.delay, "unit": "s"},
        "points": points,
        "error": {"value": curve.typical * speed, "unit": told.speed_unit},
        "logs": list(curve.names),
        "holds": "for the next log, from the scatter of these"
        if curve.scattered
        else "for the next log, with the scatter between logs of other drives",
    }


def table_rows(curve: DriveCurve, told: Told) -> list[list[object]]:
    """Rows name, value, lower and upper end of the 95 % interval, unit, and how a command reads in the file."""
    rows: list[list[object]] = []
    for name, estimate in curve.values.items():
        unit, scale = told.of(name)
        shown = number(estimate, unit, scale)
        low, high = shown["ci95"]
        read = (
            f"{told.column} {told.reading(shown['value']):.4g}"
            if name.startswith("dead") and told.column
            else ""
        )
        rows.append([WORDS[name], *(f"{v:.4g}" for v in (shown["value"], low, high)), unit, read])
    return rows


def sentences(curve: DriveCurve, told: Told) -> list[str]:
    """The curve in words: dead zone, slope and top speed of either side with their 95 % intervals."""

    def shown(name: str) -> str:
        item = number(curve.values[name], *told.of(name))
        low, high = item["ci95"]
        return f"{item['value']:.3g} ({low:.3g} to {high:.3g})"

    def known(kind: str) -> dict[str, str]:
        return {side: shown(f"{kind}_{side}") for side in ("low", "high") if f"{kind}_{side}" in curve.values}

    lines = []
    dead = known("dead")
    if dead and all(_none_shows(curve.values[f"dead_{side}"]) for side in dead):
        widest = max(
            abs(end) for s in dead for end in number(curve.values[f"dead_{s}"], *told.of(f"dead_{s}"))["ci95"]
        )
        unit = "" if told.command_unit == "1" else f" {told.command_unit}"
        lines.append(
            f"Dead zone: none shows; one wider than {widest:.2g}{unit} of the command {told.command} would have shown (95 %)"
        )
    elif dead:
        unit = "" if told.command_unit == "1" else f" {told.command_unit}"
        text = f"Dead zone: nothing moves for a command {told.command} {_between(dead, 'from', 'to')}{unit}"
        if told.column:
            read = {
                s: f"{told.reading(number(curve.values[f'dead_{s}'], *told.of(f'dead_{s}'))['value']):.4g}"
                for s in dead
            }
            text += f"; in the log's column '{told.column}' {_between(read, 'from', 'to')}"
        lines.append(text)
    for kind, what in (("slope", "Slope beyond it"), ("top", "Top speed")):
        sides = known(kind)
        if sides:
            unit = told.of(f"{kind}_low")[0]
            per = " per unit of the command" if kind == "slope" and told.command_unit == "1" else ""
            parts = " and ".join(
                f"{text} {'below' if side == 'low' else 'above'}" for side, text in sides.items()
            )
            lines.append(f"{what}: {parts}, {unit}{per}")
    return [
        *lines,
        "In brackets 95 % intervals, which hold for the next log of this machine"
        + (
            ""
            if len(curve.names) > 1
            else ": wide, since one log says nothing of how much the next one differs"
        ),
    ]


def _none_shows(dead: Estimate) -> bool:
    """Whether one end of a dead zone is 0 within its 95 % interval."""
    return dead.low <= 0.0 <= dead.high


def _between(sides: dict[str, str], start: str, end: str) -> str:
    """``from A to B`` of a low and a high side, or the one of them that is known."""
    words = [f"{word} {sides[side]}" for side, word in (("low", start), ("high", end)) if side in sides]
    return " ".join(words)


def drive_answer(
    logs: Sequence[Log], mapping: Mapping | None, command: str | None, motion: str | None
) -> Answer:
    """The static curve of a drive.

    Args:
        logs: of one machine.
        mapping: with which they were read.
        command: name of the command; by default the input of the mapping's machine, or ``u``.
        motion: name of the motion; by default its output, or ``slew``, or the one signal beside the command.

    Raises:
        DataError: a log does not hold them, is too short or stands still.
    """
    told, curve, held_out = _curve(logs, mapping, command, motion)
    data = curve_data(curve, told)
    missing = [WORDS[n] for n in WORDS if n not in curve.values]
    lines = [
        f"the speed follows the command after {curve.lag + curve.delay:.3g} s",
        fits(held_out, told),
    ]
    notes = _notes(curve, len(logs))
    if missing:
        notes.append(f"not told by the log{'s' if len(logs) > 1 else ''}: {'; '.join(missing)}")

    def draw() -> Any:
        from cosim.identify.drive_picture import drive_figure

        return drive_figure(curve, told)

    synthetic = any(log.synthetic for log in logs)
    table = [
        (
            f"Static curve of the drive, from {len(logs)} log{'s' if len(logs) > 1 else ''}",
            CURVE_COLUMNS,
            table_rows(curve, told),
        )
    ]
    return Answer(
        "drive",
        {"synthetic": synthetic, "drive_curve": data, "held_out": held_out_data(held_out, told)},
        tables=table,
        lines=lines,
        brief=sentences(curve, told),
        notes=notes,
        draw=draw,
        following="Next: name more logs of the machine to narrow the intervals; --verbose shows the table"
        if len(logs) == 1
        else "Next: --out DIR draws the curve; --verbose shows the table",
    )


def _curve(
    logs: Sequence[Log], mapping: Mapping | None, command: str | None, motion: str | None
) -> tuple[Told, DriveCurve, Predicted]:
    """The curve of logs, in which units it is told, and how well it predicts what was left out."""
    default = ends(mapping)
    command = command or default[0]
    told = told_of(logs[0], mapping, command, motion or moved_by(logs[0], command, default[1]))
    runs = [run_of(log, told) for log in logs]
    curve = drive_curve(runs)
    return told, curve, predicted(runs, curve.lag)


def _notes(curve: DriveCurve, count: int) -> list[str]:
    """What to beware of in a curve of so many logs."""
    notes = []
    if curve.left > OF_ITS_OWN:
        notes.append(not_set(curve.left))
    if count == 1:
        notes.append(
            "one log says nothing of the next: the scatter between logs of other drives widens its intervals"
        )
    return notes


def fits(of: Predicted, told: Told) -> str:
    """How well a curve predicts what was left out, and beside what."""
    which = f"{of.parts} {'logs' if of.logs else 'parts of the log'}"
    unit, scale = told.speed_unit, told.motion_scale
    return (
        f"How well it fits: of {which}, each predicted from the others, the speed over half a second is off by "
        f"{of.error * scale:.3g} {unit} (RMS; it varies by {of.spread * scale:.3g}); without a dead zone by "
        f"{of.without * scale:.3g}"
    )


def held_out_data(of: Predicted, told: Told) -> dict[str, Any]:
    """The same as JSON."""
    return {
        "error": of.error * told.motion_scale,
        "without_dead_zone": of.without * told.motion_scale,
        "spread": of.spread * told.motion_scale,
        "unit": told.speed_unit,
        "parts": of.parts,
        "parts_are_logs": of.logs,
    }


def still_answer(logs: Sequence[Log], mapping: Mapping | None, motion: str | None, following: str) -> Answer:
    """The dead zone of a machine: the commands at which nothing moves, as the static curve of its drive has them.

    Args:
        logs: of one machine.
        mapping: with which they were read.
        motion: name of the motion; by default the output of the mapping's machine.
        following: what to type next.

    Raises:
        DataError: a log does not hold command and motion, is too short, stands still, or tells no dead zone.
    """
    told, curve, held_out = _curve(logs, mapping, None, motion)
    if not any(name.startswith("dead") for name in curve.values):
        raise DataError(
            f"{', '.join(curve.names)}: the dead zone cannot be told from the slope beyond it; give logs of at least two "
            "levels of each direction together"
        )
    data = curve_data(curve, told)
    rows = [row for row in table_rows(curve, told) if str(row[0]).startswith("dead")]
    sides = {"low": "left", "high": "right"}
    missing = [f"{side} (the {sides[side]})" for side in sides if f"dead_{side}" not in curve.values]
    notes = _notes(curve, len(logs))
    if missing:
        notes.append(f"the end of the dead zone is not told by the log: {' and '.join(missing)}")

    def draw() -> Any:
        from cosim.identify.drive_picture import drive_figure

        return drive_figure(curve, told)

    said = sentences(curve, told)
    return Answer(
        "dead-zone",
        {
            "synthetic": any(log.synthetic for log in logs),
            "response": told.motion,
            "command": data["command"],
            "dead_zone": data["dead_zone"],
            "held_out": held_out_data(held_out, told),
            "logs": data["logs"],
            "holds": data["holds"],
        },
        tables=[(f"Dead zone, from {told.motion}", CURVE_COLUMNS, rows)],
        lines=[fits(held_out, told)],
        brief=[said[0], said[-1]],
        notes=notes,
        draw=draw,
        following=following,
    )
