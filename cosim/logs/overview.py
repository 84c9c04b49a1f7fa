"""What is in a file of measured data, whatever its columns are called: for a first look, and for guesses.

Nothing is mended or converted here; `cosim.logs.load` does that once it is known which column is which signal.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError, HeadlessError, UsageError
from cosim.logs.clocks import RATES, TIME_WORDS, counted, is_time, plain
from cosim.logs.load import open_source
from cosim.logs.mapping import Mapping
from cosim.logs.repair import newest_first, wide_intervals
from cosim.logs.source import Label, Source
from cosim.signals import check_spelling, conversion
from cosim.units import parse_unit

Array = NDArray[np.float64]

# spellings of units that people write and pint reads as another unit or not at all
SPELLINGS = {
    "grad": "deg", "°": "deg", "degree": "deg", "degrees": "deg", "degre": "deg", "degres": "deg", "grados": "deg",
    "gradi": "deg", "grader": "deg", "grad/s": "deg/s", "°/s": "deg/s", "nm": "N.m", "n·m": "N.m", "n*m": "N.m",
    "knm": "kN.m", "u/min": "rpm", "1/min": "rpm", "tr/min": "rpm", "sek": "s", "sec": "s", "sekunden": "s",
    "seconds": "s", "msec": "ms", "millisekunden": "ms", "µs": "us", "μs": "us", "prozent": "%", "percent": "%",
    "pct": "%", "-": "1", "rpm": "rpm", "lpm": "l/min", "gpm": "gallon/min", "radians": "rad", "volt": "V", "volts": "V",
    "amps": "A", "ampere": "A",
}  # fmt: skip
_BRACKETS = re.compile(r"[\[(]([^\[\]():]*)[\])]")
# last parts of names that nobody writes for anything else than a unit
UNIT_SUFFIXES = {
    "mm": "mm", "cm": "cm", "um": "um", "bar": "bar", "mbar": "mbar", "psi": "psi", "kpa": "kPa", "mpa": "MPa", "deg": "deg",
    "degrees": "deg", "rad": "rad", "rpm": "rpm", "rads": "rad/s", "radps": "rad/s", "degs": "deg/s", "dps": "deg/s",
    "mps": "m/s", "rps": "turn/s", "ms": "ms", "us": "us", "ns": "ns", "sec": "s", "mv": "mV", "ma": "mA",
    "percent": "%", "pct": "%", "nm": "N.m", "kn": "kN", "kg": "kg", "hz": "Hz", "lpm": "l/min", "gpm": "gallon/min",
}  # fmt: skip
# "speed_deg_per_sec", "velocity_mm_s": a length or an angle a time
_PER_TIME = re.compile(r"_(deg|degrees?|rad|mm|cm|m|rev)_?(?:per_?|p_?|_)(s|sec|second|min|minute)$")
OF_ROTATION = {"degree": "deg", "degrees": "deg", "rev": "turn"}
# letters that are much else: the unit of what these words mean only
OF_LETTERS = {
    "s": r"time|stamp|zeit|\bt$",
    "m": r"position|\bpos\b|travel|stroke|height|level|displac|length",
    "A": r"current|strom|\bi$",
    "V": r"volt|spannung",
    "N": r"force|kraft|thrust|load",
    "Pa": r"press|druck",
    "us": r"time|stamp|zeit|pulse|pwm",
}  # fmt: skip
_EXACT = {"Pa": "Pa", "mm": "mm", "Nm": "N.m"}  # case matters where a small letter is another unit
STAMPS = 20  # samples from which repeated stamps tell an interval
CLOCKWORK = 0.95  # share of a clock's intervals that are near the usual one
BARS = "▁▂▃▄▅▆▇█"


@dataclass(frozen=True)
class Column:
    """One column as it stands in the file.

    Attributes:
        index: from 0.
        label: its heading.
        unit: unit in a spelling that a mapping takes, or None where the heading has none that can be read.
        values: (n,), NaN where missing; empty where it holds no numbers.
        why: why it could not be read, or empty.
    """

    index: int
    label: Label
    unit: str | None
    values: Array
    why: str = ""

    @cached_property
    def finite(self) -> Array:
        """The values that are there."""
        return self.values[np.isfinite(self.values)]

    @property
    def missing(self) -> int:
        """Values that are not there."""
        return int(self.values.size - self.finite.size)

    @property
    def constant(self) -> bool:
        """Whether it never moves."""
        return bool(self.finite.size) and bool(np.ptp(self.finite) == 0.0)

    @cached_property
    def held(self) -> bool:
        """Whether it stays for long and then jumps, as a command does."""
        if self.finite.size < 20 or self.constant:
            return False
        return float(np.mean(np.diff(self.finite) == 0.0)) > 0.7

    @property
    def kind(self) -> str:
        """Its shape in a word."""
        if not self.values.size:
            return "text"
        if not self.finite.size:
            return "empty"
        return "constant" if self.constant else "steps" if self.held else "moves"

    def spark(self, width: int = 60) -> str:
        """The column as a row of bars."""
        if not self.finite.size:
            return ""
        filled = np.interp(np.arange(self.values.size), np.flatnonzero(np.isfinite(self.values)), self.finite)
        parts = [float(part.mean()) for part in np.array_split(filled, min(width, filled.size))]
        low, high = min(parts), max(parts)
        if high == low:
            return BARS[0] * len(parts)
        return "".join(BARS[min(int(8 * (x - low) / (high - low)), 7)] for x in parts)


@dataclass(frozen=True)
class Clock:
    """How time is told.

    Attributes:
        column: index of the time column, None where each column has stamps of its own.
        unit: of the stamps.
        guessed: why this unit, where the heading does not say it; else empty.
        seconds: (n,) stamps [s].
    """

    column: int | None
    unit: str
    guessed: str
    seconds: Array

    @property
    def step(self) -> float:
        """Median interval, s."""
        return float(np.median(np.diff(self.seconds))) if self.seconds.size > 1 else 0.0

    @property
    def rate(self) -> float:
        """Samples a second; 0 where time stands still."""
        return 1.0 / self.step if self.step > 0.0 else 0.0

    @property
    def duration(self) -> float:
        """From the first to the last sample, s."""
        return float(self.seconds[-1] - self.seconds[0]) if self.seconds.size else 0.0

    @property
    def gaps(self) -> int:
        """Intervals in which samples are missing, as the loader counts them."""
        return wide_intervals(np.diff(self.seconds))[0].size if self.step > 0.0 else 0

    @property
    def even(self) -> bool:
        """Whether the samples are evenly spaced but for gaps."""
        return wide_intervals(np.diff(self.seconds))[1] if self.step > 0.0 else True

    @property
    def backwards(self) -> int:
        """Intervals in which time stands still or goes back."""
        return int(np.sum(np.diff(self.seconds) <= 0.0))


@dataclass(frozen=True)
class Overview:
    """A file at first sight.

    Attributes:
        path: the file.
        columns: all of them, in their order.
        clock: how time is told, None where no column looks like a time.
        warnings: what the reader had to do to the file.
        header: the columns have headings; without, they are called by their place from 1.
        interval: name of a number stored beside the columns that says how often was sampled, and the interval [s]; or None.
        coarse: index of a time column whose stamps are coarser than its samples; None without one, or with a clock.
    """

    path: Path
    columns: tuple[Column, ...]
    clock: Clock | None
    warnings: tuple[str, ...]
    header: bool = True
    interval: tuple[str, float] | None = None
    coarse: int | None = None

    @cached_property
    def times(self) -> frozenset[int]:
        """Index of every column that tells time and nothing else."""
        clock = self.clock
        if clock is None:
            return frozenset() if self.coarse is None else frozenset({self.coarse})
        if clock.column is not None:
            return frozenset({clock.column})
        return frozenset(
            c.index
            for c in self.columns
            if c.finite.size > 1
            and bool(np.all(np.diff(c.finite) > 0.0))
            and (TIME_WORDS.search(plain(c.label.short)) or np.array_equal(c.values, clock.seconds))
        )

    @property
    def samples(self) -> int:
        """Rows."""
        return max((c.values.size for c in self.columns), default=0)


def overview(path: Path, mapping: Mapping | None = None, source: Source | None = None) -> Overview:
    """Reads every column of a file.

    Args:
        path: the file.
        mapping: says how a text file is written, where the file itself does not tell.
        source: the file as `open_source` opened it, where it did.

    Raises:
        DataError: the file is missing, of an unknown type, or cannot be read at all.
        MissingExtraError: its type needs an optional dependency.
    """
    header = True
    try:
        source = source or open_source(path, mapping)
    except HeadlessError:
        source, header = open_source(path, header=False), False
    columns = tuple(_column(source, k, values) for k, values in enumerate(_values(source)))
    if any(_tells_time(c) and newest_first(c.finite) for c in columns):  # the loader reads it backwards too
        columns = tuple(replace(c, values=c.values[::-1]) for c in columns)
    clock, interval = _clock(source, columns), _interval(source.constants)
    coarse = None if clock is not None else next((c for c in columns if _repeats_stamps(c)), None)
    if coarse is not None and interval is None:
        interval = f"mean interval of '{coarse.label.shown}', whose stamps repeat,", _mean_interval(coarse)
    place = None if coarse is None else coarse.index
    return Overview(path, columns, clock, tuple(dict.fromkeys(source.warnings)), header, interval, place)


def _repeats_stamps(column: Column) -> bool:
    """Whether a column tells time, but in fewer digits than its samples need: it never falls, and repeats itself evenly."""
    if not _tells_time(column) or column.missing or column.finite.size < STAMPS:
        return False
    steps = np.diff(column.finite)
    rises = np.diff(np.flatnonzero(steps > 0.0))
    return (
        bool(np.all(steps >= 0.0)) and rises.size > 2 and float(rises.max()) < 3.0 * float(np.median(rises))
    )


def _mean_interval(column: Column) -> float:
    """Interval between the samples of a time column, s."""
    mean = float(column.finite[-1] - column.finite[0]) / (column.finite.size - 1)
    unit = column.unit or ""
    unit = unit if unit and is_time(unit) else counted(np.arange(column.finite.size, dtype=np.float64) * mean)
    return float(f"{mean * conversion(unit, 's'):.4g}")


def _interval(constants: dict[str, float]) -> tuple[str, float] | None:
    """The interval between samples [s] that a file states as a number: ``Ts``, ``dt`` or, as a rate, ``fs``."""
    for name, value in constants.items():
        word = plain(name.rpartition(".")[2]).replace(" ", "")
        if value > 0.0 and word in (
            "ts",
            "dt",
            "h",
            "tsample",
            "sampletime",
            "samplingtime",
            "samplinginterval",
        ):
            return name, value
        if value > 0.0 and word in ("fs", "fsample", "samplerate", "samplingrate", "samplingfrequency"):
            return name, 1.0 / value
    return None


def measured(path: Path, source: Source | None = None) -> Overview:
    """As `overview`, of a file that can be a log.

    Raises:
        DataError: as `overview`, or no column holds numbers.
    """
    found = overview(path, source=source)
    if not any(column.finite.size for column in found.columns):
        raise DataError(f"{path}: holds no column of numbers: a log is a table with a row for each sample")
    return found


def _values(source: Source) -> list[Array | str]:
    """Each column's values, or why it has none: a column of text does not keep the others from being read."""
    indices = range(len(source.labels))
    try:
        return list(source.read(indices))
    except DataError:
        found: list[Array | str] = []
        for k in indices:
            try:
                found += source.read([k])
            except DataError as error:
                found.append(str(error).removeprefix(f"{source.path}: "))
        return found


def _column(source: Source, index: int, values: Array | str) -> Column:
    label = source.labels[index]
    unit = spelled(label.unit) or unit_within(label.short)
    if isinstance(values, str):
        return Column(index, label, unit, np.empty(0), values)
    return Column(index, label, unit, values)


def spelled(unit: str | None) -> str | None:
    """A unit in a spelling that a mapping takes; None for no unit and for what is none."""
    if unit is None:
        return None
    text = unit.strip()
    found = _EXACT.get(text) or SPELLINGS.get(text.lower()) or text
    try:
        check_spelling(found)
        parse_unit(found)
    except UsageError:
        return None
    return found


def unit_within(name: str) -> str | None:
    """The unit that a name holds: in brackets within it (``Flow (l/min) - Plot 0``) or as its last part (``x_mm``).

    Letters that are units as well, such as the port A, count only where the name says what they are units of.
    """
    bracketed = [unit for text in _BRACKETS.findall(name) if (unit := spelled(text)) is not None]
    if len(bracketed) == 1:
        return bracketed[0]
    if rate := _PER_TIME.search(name.lower()):
        return f"{OF_ROTATION.get(rate[1], rate[1])}/{'min' if rate[2].startswith('m') else 's'}"
    before, _, last = name.rpartition("_")
    if not before:
        return None
    for letter, words in OF_LETTERS.items():
        if last == letter and re.search(words, plain(before)):
            return letter
    return UNIT_SUFFIXES.get(last.lower())


def longest(columns: Iterable[Column]) -> Column:
    """The column with the most values; where each has stamps of its own its clock is the log's."""
    return max(columns, key=lambda c: c.values.size)


def _clock(source: Source, columns: tuple[Column, ...]) -> Clock | None:
    """The time column: by its name or unit, else the one that rises evenly."""
    for column in columns:
        stamps = source.clock(column.index)
        if stamps is not None and len(stamps) > 1:
            return Clock(None, "s", "", np.asarray(stamps, dtype=np.float64))
    rising = [
        c
        for c in columns
        if c.finite.size > 1 and c.missing < c.finite.size and float(np.mean(np.diff(c.finite) > 0.0)) > 0.9
    ]
    named = [c for c in rising if _named_time(c)]
    timed = [c for c in rising if c.unit is not None and is_time(c.unit)]
    even = [c for c in rising if c.unit is None and _even(np.diff(c.finite))]
    likely = [*(c for c in named if c in timed), *named, *timed, *even]
    if not likely:
        return None
    column = likely[0]
    if column.unit is not None and is_time(column.unit):
        return Clock(column.index, column.unit, "", column.finite * conversion(column.unit, "s"))
    unit = counted(column.finite)
    step, scale = float(np.median(np.diff(column.finite))), conversion(unit, "s")
    why = f"steps of {step:.4g}, so {1.0 / (step * scale):.4g} samples a second if it counts {unit}"
    return Clock(column.index, unit, why, column.finite * scale)


def _named_time(column: Column) -> bool:
    """Whether the heading is that of a clock."""
    return bool(TIME_WORDS.search(plain(column.label.name.rpartition(".")[2])))


def _tells_time(column: Column) -> bool:
    """Whether the heading or the unit is that of a clock."""
    return _named_time(column) or (column.unit is not None and is_time(column.unit))


def _even(intervals: Array) -> bool:
    """Whether a column without a name rises as a clock does: always, and nearly always by the same; gaps are few."""
    usual = float(np.median(intervals))
    if usual < 1.0 / RATES[1]:
        return False
    return (
        bool(np.all(intervals > 0.0)) and float(np.mean(np.abs(intervals - usual) < 0.5 * usual)) > CLOCKWORK
    )
