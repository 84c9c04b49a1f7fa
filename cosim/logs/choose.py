"""From the columns of a file to signals: by their canonical headings, or by a mapping."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cosim.console import typed
from cosim.errors import ColumnsError, DataError, UsageError
from cosim.logs.mapping import Column, Mapping, SignalColumn, raw_reading
from cosim.logs.source import Label, Source, closest
from cosim.signals import SIGNALS, SYNTHETIC_COLUMN, check_spelling, conversion
from cosim.units import base_exponents, own_zero

# whose plausible range is that of the crane's travel and sensors, of no other machine's; a command of 1 is full anywhere
OF_THE_CRANE = tuple(name for name in SIGNALS if name not in ("time", "u"))
_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Pick:
    """One column chosen: ``signal[si] = scale * (reading - minus) + shift``.

    Attributes:
        name: the signal.
        index: the column's index in the source.
        si: unit of the result.
        unit: unit in which people read it.
        scale: factor from reading to SI.
        shift: added after it [si].
        held: constant between samples.
        minus: index of the column that is taken off, None for none.
        plausible: lowest and highest plausible value [si] of a signal that is not ours, or differs in this file.
        period: range [si] after which the value begins anew, None where it does not.
    """

    name: str
    index: int
    si: str
    unit: str
    scale: float
    shift: float = 0.0
    held: bool = False
    minus: int | None = None
    plausible: tuple[float, float] | None = None
    period: float | None = None


def remedy(source: Source) -> str:
    """What to type where the headings do not say which column is which."""
    return f"'cosim init {typed(source.path)}' writes a mapping with guesses"


def choose(
    source: Source, known: Sequence[str], select: Sequence[str] | None
) -> tuple[list[Pick], list[str]]:
    """The columns of a file in our own format, `time` among them; and a warning about those left alone.

    Args:
        source: the file.
        known: the signals that may be in it, without `time`.
        select: load only these of them, or all.

    Raises:
        DataError: a column's unit is missing, unreadable or of the wrong dimension, a signal is there twice, or there
            is none.
        UsageError: `select` names an unknown signal.
    """
    for asked in select or ():
        if asked not in known:
            raise UsageError(
                f"there is no signal '{asked}'{closest(asked, known)}; known: {', '.join(known)}"
            )
    wanted = ("time", *(known if select is None else select), SYNTHETIC_COLUMN)
    picks: dict[str, Pick] = {}
    unknown: list[str] = []
    for index, label in enumerate(source.labels):
        name = _canonical(label, ("time", *known, SYNTHETIC_COLUMN))
        if not name:
            unknown.append(f"'{label.text}'{closest(label.name, known)}")
        elif name in picks:
            other = source.labels[picks[name].index].text
            raise ColumnsError(
                f"{source.path}: columns '{other}' and '{label.text}' are both '{name}': delete one, or say with a"
                f" mapping which to use ({remedy(source)})"
            )
        elif name in wanted:
            picks[name] = _pick_known(source, index, label, name)
    if not picks.keys() - {"time", SYNTHETIC_COLUMN} and select is None:
        raise ColumnsError(
            f"{source.path}: no column is a known signal ({', '.join(known)}); found"
            f" {', '.join(unknown[:20]) or 'none'}: {remedy(source)}"
        )
    notes = [f"ignored columns: {', '.join(unknown)}"] if unknown else []
    return list(picks.values()), notes


def _canonical(label: Label, known: Sequence[str]) -> str:
    """The signal a column holds, or the empty text."""
    return next((name for name in (label.name, label.alias) if name in known), None) or ""


def _pick_known(source: Source, index: int, label: Label, name: str) -> Pick:
    if name == SYNTHETIC_COLUMN:
        return Pick(name, index, "1", "1", 1.0)
    signal = SIGNALS[name]
    if label.unit is None and not (name == "time" and source.clock(index) is not None):
        raise ColumnsError(
            f"{source.path}: column '{label.text}' has no unit: write it into the header, such as"
            f" '{name} [{signal.unit}]', or give a mapping ({remedy(source)})"
        )
    return Pick(
        name,
        index,
        signal.si,
        signal.unit,
        _factor(source, label, label.unit or "s", signal.si),
        0.0,
        signal.held,
    )


def _factor(source: Source, label: Label, unit: str, si: str) -> float:
    try:
        return conversion(unit, si)
    except UsageError as error:
        raw = raw_reading(si, unit)
        raise ColumnsError(f"{source.path}: column '{label.text}': {error}{raw} ({remedy(source)})") from None


def choose_mapped(source: Source, mapping: Mapping, select: Sequence[str] | None) -> list[Pick]:
    """The columns that a mapping names, `time` among them unless it has a fixed step.

    Raises:
        DataError: a column is not in the file, a unit is missing or wrong, or a gain is not stored in the file.
        UsageError: `select` names a signal that the mapping does not.
    """
    for name in select or ():
        if name not in mapping.signals:
            raise UsageError(f"the mapping has no signal '{name}'{closest(name, list(mapping.signals))}")
    picks = []
    if mapping.time.column is not None:
        index = _find(source, mapping.time.column, "time")
        label = source.labels[index]
        unit = mapping.time.unit or label.unit
        if unit is None:
            raise DataError(
                f"{source.path}: column '{label.text}' has no unit: give 'time.unit' in the mapping"
            )
        picks.append(Pick("time", index, "s", "s", _factor(source, label, unit, "s")))
    picks += [
        _pick_mapped(source, name, column, mapping)
        for name, column in mapping.signals.items()
        if select is None or name in select
    ]
    mark = [k for k, label in enumerate(source.labels) if _canonical(label, (SYNTHETIC_COLUMN,))]
    return picks + [Pick(SYNTHETIC_COLUMN, k, "1", "1", 1.0) for k in mark[:1]]


def _pick_mapped(source: Source, name: str, column: SignalColumn, mapping: Mapping) -> Pick:
    index = _find(source, column.column, name)
    minus = None if column.minus is None else _find(source, column.minus, name)
    label = source.labels[index]
    unit = column.unit or label.unit
    if column.unit:
        source.settled.add(index)
    if unit is None:
        raise DataError(
            f"{source.path}: column '{label.text}' has no unit: give 'signals.{name}.unit' in the mapping ('1' for none)"
        )
    signal = SIGNALS.get(name)
    if signal is not None and mapping.of_others and not _of_dimension(unit, signal.si):
        signal = None
    si = signal.si if signal else _si_name(source, label, unit)
    factor = _factor(source, label, unit, si)
    gain = column.sign * _gain(source, name, column.gain)
    shift = (column.offset - gain * column.zero) * factor
    held = column.held if column.held is not None else bool(signal and signal.held)
    plausible = (
        None if column.plausible is None else (column.plausible[0] * factor, column.plausible[1] * factor)
    )
    # where a machine's speed at a command of 1 is stated, that may be a volt
    by_speed = name == "u" and mapping.machine.get("speed", "?") != "?"
    if plausible is None and (mapping.of_others or (mapping.machine and (name in OF_THE_CRANE or by_speed))):
        plausible = (-math.inf, math.inf)
    period = None if column.period is None else column.period * factor
    shown = signal.unit if signal else unit
    return Pick(name, index, si, shown, gain * factor, shift, held, minus, plausible, period)


def _of_dimension(unit: str, si: str) -> bool:
    try:
        conversion(unit, si)
    except UsageError:
        return False
    return True


def _si_name(source: Source, label: Label, unit: str) -> str:
    """The SI unit for a unit of any dimension: itself where it is one already, else spelled in base units.

    One with a zero of its own, as degC, is kept: another model may count in it, too.
    """
    try:
        check_spelling(unit)
        if own_zero(unit) is not None:
            return unit
        exponents, factor = base_exponents(unit)
    except UsageError as error:
        raise DataError(f"{source.path}: column '{label.text}': {error}") from None
    if factor == 1.0:
        return unit
    powers = [(name, exponents[name]) for name in _BASE if exponents.get(name)]
    return ".".join(f"{name}{power}" if power != 1 else name for name, power in powers) or "1"


def _gain(source: Source, name: str, gain: float | str) -> float:
    if not isinstance(gain, str):
        return gain
    if gain not in source.constants:
        stored = list(source.constants)
        known = f"; stored numbers: {', '.join(stored)}" if stored else ""
        raise DataError(
            f"{source.path}: the mapping's gain '{gain}' for '{name}' is not a single number stored in the file"
            f"{closest(gain, stored)}{known}"
        )
    return source.constants[gain]


def holds(source: Source, column: SignalColumn) -> bool:
    """Whether a file has the column of a mapping's signal, and the one that is taken off it."""
    try:
        for one in (column.column, column.minus):
            if one is not None:
                _find(source, one, "")
    except DataError:
        return False
    return True


def _find(source: Source, column: Column, name: str) -> int:
    if isinstance(column, tuple):
        there = [heading for heading in column if any(label.called(heading) for label in source.labels)]
        column = (there or column)[0]
    if isinstance(column, int):
        if column > len(source.labels):
            raise DataError(
                f"{source.path}: the mapping takes '{name}' from column {column}; there are {len(source.labels)}"
            )
        return column - 1
    found = [k for k, label in enumerate(source.labels) if label.called(column)]
    if len(found) == 1:
        return found[0]
    texts = [label.text for label in source.labels]
    if found:
        double = ", ".join(f"{k + 1} '{texts[k]}'" for k in found)
        raise DataError(
            f"{source.path}: '{column}' fits several columns ({double}): give its number in the mapping"
        )
    listed = ", ".join(texts[:20]) + (" ..." if len(texts) > 20 else "")
    raise DataError(
        f"{source.path}: the mapping takes '{name}' from column '{column}', which is not there"
        f"{closest(column, texts)}; columns: {listed} (where logs of one machine call it differently, name all: "
        f"column = ['{column}', ...])"
    )
