"""What the page shows of a log: its columns, and a form with a row for each signal, filled with guesses."""

import re
import tomllib
from collections.abc import Collection, Sequence
from collections.abc import Mapping as Table
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cosim.anysystem.initial import Beginning
from cosim.anysystem.read import value_of
from cosim.anysystem.start import (
    began,
    beginnings_of,
    both_ways,
    entering,
    numbers_of,
    of_file,
    unit_of_connector,
)
from cosim.errors import UsageError
from cosim.logs.guess import (
    DRIVERS,
    MOTIONS,
    Guess,
    demands,
    guesses,
    likely,
    machine_lines,
    of_other_axis,
    texts_of,
)
from cosim.logs.mapping import Column as Named
from cosim.logs.mapping import Mapping, SignalColumn
from cosim.logs.overview import Column, Overview
from cosim.plots import thinned
from cosim.signals import LOG_SIGNALS, SIGNALS
from cosim.ssp.stated import in_si, unit_in_words, without_unit
from cosim.ssp.system import Port, System
from cosim.system.graph import port_of

POINTS = 160  # of a column's small picture
OWN = "own"
TOLERANCE = "1 %"  # of a parameter that is trusted and of which a mapping says no more
DRIVE = "u"  # without the crane's command nothing can be simulated
OF_MACHINES = {
    "torque": "N.m",
    "force": "N",
    "travel": "m",
    "speed": "rad/s",
    "flow": "l/min",
}  # units to begin with


@dataclass
class Row:
    """One signal, and the column that it is taken from.

    Attributes:
        signal: name as in a mapping.
        text: what it is.
        needed: nothing can be diagnosed without it.
        column: index of the column, None where none is chosen.
        unit: of the value after the scaling.
        gain, zero: factor on the reading, and the reading that means zero; a gain may be the name of a stored number.
        reversed: the file counts the other way.
        held: each value stays until the next sample; None where that is not asked.
        why: reason of the guess.
        check: what a person should look at, or empty.
        minus: a column and the one whose reading is taken off it, where each direction has a column of its own.
        counts: unit in which an FMU that states none counts, as its description says; ``OWN``: as the log does; else empty.
    """

    signal: str
    text: str
    needed: bool = False
    column: int | None = None
    unit: str = ""
    gain: float | str = 1.0
    zero: float = 0.0
    reversed: bool = False
    held: bool | None = None
    why: str = ""
    check: str = ""
    minus: tuple[int, int] | None = None
    counts: str = ""


@dataclass
class TimeRow:
    """Where time comes from.

    Attributes:
        column: index of the time column, or None.
        own: each column has stamps of its own.
        step: interval between samples in `unit`, where there is no column; None where nobody knows it.
        unit: of the column or step.
        check: what a person should look at, or empty.
    """

    column: int | None = None
    own: bool = False
    step: float | None = None
    unit: str = "s"
    check: str = ""


@dataclass
class NumberRow:
    """A parameter of somebody's model, and how well it is known.

    Attributes:
        name: ``component.parameter``.
        text: what the FMU says of it.
        value: as the model has it, in `unit`.
        unit: of the FMU, or as its description says; else empty.
        trusted: how well it is known, such as ``2 %``; empty where it is taken as exact.
        free: nobody knows it: it is fitted with every cause.
    """

    name: str
    text: str
    value: float
    unit: str = ""
    trusted: str = ""
    free: bool = False


@dataclass
class Form:
    """Time and signals, as guessed or as a mapping file says.

    Attributes:
        time: where time comes from.
        rows: the signals.
        least: at least one of these must be chosen too, with the words for them; empty where it does not matter.
        named: what the least are, in words.
        start: parameter that is the initial value of a signal that begins elsewhere than the model -> this signal.
        numbers: parameters of somebody's model.
    """

    time: TimeRow
    rows: list[Row]
    least: list[str] = field(default_factory=list)
    named: str = ""
    start: dict[str, str] = field(default_factory=dict)
    numbers: list[NumberRow] = field(default_factory=list)


def column_facts(column: Column) -> dict[str, Any]:
    """A column as plain data: name, unit, range, shape, and a small picture as values from 0 to 1 over 0 to 1."""
    low, high = (
        (float(column.finite.min()), float(column.finite.max())) if column.finite.size else (None, None)
    )
    facts: dict[str, Any] = {
        "index": column.index,
        "name": column.label.shown,
        "unit": column.unit or "",
        "low": low,
        "high": high,
        "shape": column.kind,
        "held": column.held,
        "missing": column.missing if column.values.size else 0,
        "why": column.why,
        "picture": [],
    }
    if low is not None and high is not None:
        places = np.flatnonzero(np.isfinite(column.values)).astype(np.float64)
        time, values = thinned(places, column.finite, POINTS)
        across, up = max(column.values.size - 1, 1), (high - low) or 1.0
        scaled = zip(time / across, (values - low) / up if high > low else 0.5 + 0.0 * values, strict=True)
        facts["picture"] = [[round(float(x), 4), round(float(y), 4)] for x, y in scaled]
    return facts


def log_facts(found: Overview) -> dict[str, Any]:
    """A log as plain data: length, rate, gaps, columns."""
    clock = found.clock
    return {
        "samples": found.samples,
        "duration": None if clock is None else clock.duration,
        "rate": None if clock is None else clock.rate,
        "gaps": 0 if clock is None else clock.gaps,
        "backwards": 0 if clock is None else clock.backwards,
        "columns": [column_facts(column) for column in found.columns],
        "warnings": list(found.warnings),
    }


def guessed(row: Row, guess: Guess) -> Row:
    """A row with a guess of `cosim init` in it."""
    row.column, row.unit, row.why = guess.column.index, guess.unit, guess.why
    row.gain, row.zero = guess.gain, guess.zero
    if guess.minus is not None:
        row.minus = (guess.column.index, guess.minus.index)
        row.check = f"column '{guess.minus.label.shown}' is taken off it"
    elif guess.check:
        row.check = "full command is taken to be the largest reading" if guess.gain != 1.0 else "the unit"
    return row


def crane_form(found: Overview) -> Form:
    """The signals of the crane with the guesses of `cosim init`."""
    made = guesses(found)
    rows = []
    for name in LOG_SIGNALS:
        row = Row(name, said(name), needed=name == DRIVE, unit=SIGNALS[name].unit)
        rows.append(guessed(row, made[name]) if name in made else row)
    measured = [name for name in LOG_SIGNALS if name != DRIVE and not name.endswith("estimate")]
    return Form(time_row(found), rows, measured, "the slew angle, the spool or the pressures")


def machine_form(found: Overview) -> Form:
    """The signals of a machine of its own with the guesses of `cosim init --machine`, those with a column first."""
    made = guesses(found, machine=True)
    texts = texts_of(None)
    rows = []
    for name in (DRIVE, *DRIVERS, "slew", *MOTIONS, "spool", "p_supply", "p_a", "p_b"):
        unit = SIGNALS[name].unit if name in SIGNALS else OF_MACHINES[name]
        row = Row(name, texts[name].split(";")[0], unit=unit)
        rows.append(guessed(row, made[name]) if name in made else row)
    rows.sort(key=lambda row: row.column is None)
    return Form(time_row(found), rows, ["slew", *MOTIONS, "spool"], "an angle, a travel, a speed or a flow")


def of_another(found: Overview) -> bool:
    """Whether a log shows a drive of its own, and nothing of the crane but a command, or an angle that is another axis'."""
    crane = guesses(found)
    return likely(found)[1] and (crane.keys() <= {DRIVE} or bool(of_other_axis(crane)))


def machine_of(found: Overview, entries: Table[str, Table[str, Any]]) -> dict[str, Any]:
    """The table `[machine]` of a drive whose signals were chosen so, as `cosim init --machine` writes it.

    Args:
        found: the log.
        entries: signal -> column and unit, as in a mapping.

    Raises:
        UsageError: nothing drives it.
    """
    if not entries.keys() & {DRIVE, *DRIVERS}:
        raise UsageError("nothing drives the machine: choose a column for u, torque or force")
    made = {}
    for name, entry in entries.items():
        column = find(found, entry["column"])
        if column is not None:
            made[name] = Guess(name, found.columns[column], entry["unit"], 1.0, "", False)
    # a command drives more of the chain than the force behind it
    if DRIVE in made:
        made = {name: guess for name, guess in made.items() if name not in DRIVERS}
    motion = next((made[name] for name in ("slew", "travel") if name in made), None)
    if DRIVE in made and motion is not None and demands(made[DRIVE].column, motion.column):
        made[DRIVE] = replace(made[DRIVE], place=True)
    table: dict[str, Any] = tomllib.loads("\n".join(machine_lines(found, made)))["machine"]
    return table


def connector_form(found: Overview, system: System) -> Form:
    """The connectors of any system with the guesses of `cosim init`; those with a column first."""
    matched = of_file(system, found)
    clock = found.clock.column if found.clock else None
    columns = {port: k for k, port in matched.taken.items() if k != clock}
    driving, ways = entering(system), both_ways(system, found, matched)
    rows = []
    for port, own in matched.units.items():
        row = Row(port, "input" if port in system.inputs else "", unit=own or "1")
        row.held = False if port_of(system, port) in driving else None
        row.counts = "" if own else unit_of_connector(system, port) or OWN
        if port in columns:
            column = found.columns[columns[port]]
            said = "" if row.counts == OWN else row.counts
            row.column, row.unit = column.index, column.unit or own or said or "1"
            row.why = "" if matched.check(column.index) else "its name"
            row.held = None if row.held is None else column.held
            row.check = matched.check(column.index)
            if not row.check and own and not column.unit:
                row.check = "the heading has no unit"
            if not row.check and row.counts == OWN and not in_si(row.unit):
                row.check = "the FMU states no unit: it is taken to count as the log does"
            if not row.check and said and not column.unit:
                row.check = "the unit is that of the FMU's description"
            if column.index in ways:
                one, other = ways[column.index]
                row.column, row.minus = one.index, (one.index, other.index)
                row.held = one.held or other.held
                row.check = row.check or f"column '{other.label.shown}' is taken off it"
        rows.append(row)
    begins = {b.connector: b for b in beginnings_of(system, found, matched) if b.off}
    for row in rows:
        if row.signal in begins:
            row.text = began(begins[row.signal], found.columns[columns[row.signal]].unit or "")
    start = {b.parameter: b.connector for b in begins.values() if b.parameter}
    rows.sort(key=lambda row: row.column is None)
    outputs = [row.signal for row in rows if row.signal not in system.inputs]
    return Form(
        time_row(found),
        rows,
        outputs,
        "an output of a component",
        start,
        number_rows(system, list(begins.values())),
    )


def number_rows(system: System, begins: Sequence[Beginning]) -> list[NumberRow]:
    """The parameters of a system, each taken as exact."""
    rows = []
    for name in numbers_of(system, begins):
        variable, value = system.variable(Port(*name.split(".", 1))), value_of(system, name)
        if value is not None:
            unit = variable.unit or unit_in_words(variable)
            text = variable.description if variable.unit else without_unit(variable.description)
            rows.append(NumberRow(name, text, value, unit))
    return rows


def known_in(numbers: Sequence[NumberRow], table: Table[str, Any]) -> None:
    """Put into the rows what the table ``[diagnose]`` of a mapping says of parameters."""
    trusted, free = table.get("trusted", {}), table.get("free", [])
    for row in numbers:
        if row.name in trusted:
            own = trusted[row.name] if isinstance(trusted, dict) else None
            row.trusted = TOLERANCE if own is None else own if isinstance(own, str) else f"{100.0 * own:g} %"
        row.free = row.name in free


def file_form(
    found: Overview, mapping: Mapping, needed: Collection[str], other: Table[str, Row] | None = None
) -> Form:
    """The signals of a mapping file; for a column that this log does not have `other` may have a guess.

    Args:
        found: the log.
        mapping: the file.
        needed: signals that cannot do without a column.
        other: signal -> row with the guess of `cosim init`.
    """
    rows = [
        _of_file(found, name, entry, name in needed or name == DRIVE)
        for name, entry in mapping.signals.items()
    ]
    taken = {row.column for row in rows}
    for row in rows:
        guess = (other or {}).get(row.signal)
        if (
            row.column is None
            and guess is not None
            and guess.column is not None
            and guess.column not in taken
        ):
            # the file's scaling belongs to the column that it names
            row.column, row.why, row.minus = guess.column, guess.why, guess.minus
            row.unit, row.gain, row.zero, row.reversed = guess.unit, guess.gain, guess.zero, guess.reversed
            taken.add(guess.column)
    time = time_row(found)
    given = mapping.time
    if given.column is not None:
        column = find(found, given.column)
        if column is not None:
            time = TimeRow(column, unit=given.unit or found.columns[column].unit or "s")
        else:
            time.check = f"the file names '{given.column}', which this log does not have"
    elif given.step is not None:
        time = TimeRow(step=given.step, unit=given.unit or "s")
    return Form(time, rows)


def _of_file(found: Overview, name: str, entry: SignalColumn, needed: bool) -> Row:
    column = find(found, entry.column)
    unit = entry.unit or (found.columns[column].unit if column is not None else None) or ""
    text = entry.text or (said(name) if name in SIGNALS else name.replace("_", " "))
    if entry.minus is not None:
        text += f" (less column '{entry.minus}')"
    check = "" if column is not None else f"the file names '{entry.column}', which this log does not have"
    return Row(
        signal=name,
        text=text,
        needed=needed,
        column=column,
        unit=unit,
        gain=entry.gain,
        zero=entry.zero,
        reversed=entry.sign < 0,
        held=entry.held,
        why="the mapping file",
        check=check,
    )


def time_row(found: Overview) -> TimeRow:
    """Time as the file itself tells it."""
    clock = found.clock
    if clock is None and found.coarse is not None and found.interval is not None:
        name = found.columns[found.coarse].label.shown
        return TimeRow(step=found.interval[1], check=f"mean interval of '{name}', whose stamps repeat")
    if clock is None:
        return TimeRow(check="no column looks like a time: choose it, or give the interval between samples")
    return TimeRow(clock.column, clock.column is None, None, clock.unit, clock.guessed)


def find(found: Overview, named: Named) -> int | None:
    """Index of the column that a mapping names by headings or by position from 1; None where there is not just one."""
    if isinstance(named, tuple):
        return next((k for heading in named if (k := find(found, heading)) is not None), None)
    if isinstance(named, int):
        return named - 1 if named <= len(found.columns) else None
    fitting = [c.index for c in found.columns if c.label.called(named)]
    return fitting[0] if len(fitting) == 1 else None


def named(found: Overview, index: int) -> str | int:
    """How a mapping names a column: by its heading, or by its position from 1 where another has the same one.

    Raises:
        UsageError: there is no such column.
    """
    if not 0 <= index < len(found.columns):
        raise UsageError(f"there is no column {index + 1}: the log has {len(found.columns)}")
    text = found.columns[index].label.text
    return text if text and find(found, text) == index else index + 1


def said(name: str) -> str:
    """What a signal of ours is, in a few words."""
    return re.split(r"[;(]", SIGNALS[name].text)[0].strip().rstrip(",")
