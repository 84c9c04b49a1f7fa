"""Mapping files (TOML): which column of a foreign file is which signal, in which unit, and the model to use.

    model = "simplified"
    [time]
    column = "Time"
    unit = "s"
    [signals.u]
    column = "Swing Cmd"
    unit = "1"
    zero = 7.4695
    gain = 0.3952

A value is ``sign * gain * (reading - zero) + offset`` in `unit`; with `minus` the reading is the difference of two columns.
"""

import os
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveInt,
    ValidationError,
    field_validator,
    model_validator,
)

from cosim.errors import DataError, UsageError
from cosim.logs.source import closest
from cosim.signals import SIGNALS, SYNTHETIC_COLUMN, check_spelling, conversion

Heading = Annotated[str, Field(min_length=1)]
# several headings: the one that a file has, where logs of one machine call a signal differently
Column = Heading | PositiveInt | Annotated[tuple[Heading, ...], Field(min_length=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
REMEDIES = {
    "signals": ": a table such as [signals.u] with 'column' and 'unit' for each signal; 'cosim init LOG' writes what it can",
    "time": ": a table [time] with 'column' and 'unit', or with 'step' and 'unit'",
}
_RESERVED = ("time", "p_load", SYNTHETIC_COLUMN)
_OF_OWN = {
    "time": "it has a table of its own, [time]",
    "p_load": "it is p_a - p_b: give these two, or, where a pressure drives the machine, call it torque or force",
}


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FileFormat(_Strict):
    """How a text file is written.

    Attributes:
        separator: column separator; by default found in the header.
        decimal: decimal sign; by default found in the cells.
        header: False where the file starts with data; its columns are then 1, 2, ...
        encoding: of the header, such as ``cp949``; by default UTF-8, or Windows-1252 where it is none.
        sheet: of a workbook (.xlsx); by default the first that has a value.
    """

    separator: Literal[",", ";", "\t", "|", " "] | None = None
    decimal: Literal[".", ","] | None = None
    header: bool = True
    encoding: str | None = None
    sheet: Heading | None = None

    @field_validator("encoding")
    @classmethod
    def _ascii(cls, encoding: str | None) -> str | None:
        if encoding is not None:
            try:
                same = "a,1".encode(encoding) == b"a,1"
            except (LookupError, ValueError):
                raise ValueError(
                    f"'{encoding}' is not the name of an encoding, such as utf-8 or cp949"
                ) from None
            if not same:
                raise ValueError(f"a file in '{encoding}' is not read: save it as UTF-8")
        return encoding

    @model_validator(mode="after")
    def _distinct(self) -> "FileFormat":
        if self.separator is not None and self.separator == self.decimal:
            raise ValueError("separator and decimal are the same sign")
        return self


class TimeColumn(_Strict):
    """Where time comes from: a column, or a fixed interval between samples.

    Attributes:
        column: heading, or position counted from 1; of several headings the first that the file has.
        step: interval between samples in `unit`, for a file without a time column.
        unit: unit of the column or step; ``sample`` to work in samples, where the interval is not known.
    """

    column: Column | None = None
    step: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    unit: str | None = None

    @model_validator(mode="after")
    def _one_of(self) -> "TimeColumn":
        if (self.column is None) == (self.step is None):
            raise ValueError("give either the column or the step")
        if self.unit == "sample" and self.step is None:
            raise ValueError("unit 'sample' goes with a step, such as step = 1")
        if self.unit not in (None, "sample"):
            _convertible(self.unit or "", "s")
        return self


class SignalColumn(_Strict):
    """Where one signal comes from.

    Attributes:
        column: heading, or position counted from 1; of several headings the first that the file has.
        minus: a second column, whose reading is taken off the first's: where each direction has a column of its own.
        unit: unit of the value after the scaling; by default the one in the heading.
        gain: factor on the reading, or the name of a single number stored in the file (MAT files).
        zero: reading that means zero.
        offset: added after the scaling, in `unit`.
        sign: -1 where the file counts the other way.
        held: whether the value is constant between samples; by default as for the canonical signal, else False.
        plausible: lowest and highest plausible value in `unit`; by default those of the canonical signal.
        period: range in `unit` after which the value begins anew, such as 360 of an angle in degrees; it is made to go on.
        text: what it is.
    """

    column: Column
    minus: Column | None = None
    unit: str | None = None
    gain: Finite | Annotated[str, Field(min_length=1)] = 1.0
    zero: Finite = 0.0
    offset: Finite = 0.0
    sign: Literal[1, -1] = 1
    held: bool | None = None
    plausible: tuple[Finite, Finite] | None = None
    period: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    text: str = ""

    @field_validator("unit")
    @classmethod
    def _readable(cls, unit: str | None) -> str | None:
        if unit is not None:
            _convertible(unit, None)
        return unit

    @field_validator("gain")
    @classmethod
    def _not_zero(cls, gain: float | str) -> float | str:
        if gain == 0:
            raise ValueError("a gain of 0 leaves nothing of the signal")
        return gain

    @field_validator("plausible")
    @classmethod
    def _in_order(cls, plausible: tuple[float, float] | None) -> tuple[float, float] | None:
        if plausible is not None and plausible[0] >= plausible[1]:
            raise ValueError("give the lowest value first, then the highest")
        return plausible


class Mapping(_Strict):
    """A mapping file.

    Attributes:
        name: short name of the data set.
        description: where it comes from, what is known about it.
        model: name of a built-in model, or path of an .ssp, .ssd or .ssv relative to the mapping file.
        file: how a text file is written.
        time: where time comes from.
        signals: signal -> where it comes from; names may be our own (``slew``) or the mapping's (``force``).
        compare: how signals map to the variables of a model; `cosim.compare.mapping` reads and checks it.
        diagnose: what the diagnosis must know of the machine; `cosim.diagnosis.model.options` reads and checks it.
        machine: the model as a chain of blocks, in place of `model`; `cosim.machines.table` reads and checks it.
        held_out: signal, or ``time``, -> its column in a second record of the same file, which is held out of the fits.
        sha256: file name -> SHA-256 of the files that the mapping was made for; another content is refused.
        path: the mapping file, None for a mapping made in memory.
    """

    name: str = ""
    description: str = ""
    model: str | None = None
    file: FileFormat = FileFormat()
    time: TimeColumn
    signals: Annotated[dict[str, SignalColumn], Field(min_length=1)]
    compare: dict[str, Any] = Field(default_factory=dict)
    diagnose: dict[str, Any] = Field(default_factory=dict)
    machine: dict[str, Any] = Field(default_factory=dict)
    held_out: dict[str, Column] = Field(default_factory=dict)
    sha256: dict[str, Annotated[str, Field(pattern="^[0-9a-f]{64}$")]] = Field(default_factory=dict)
    path: Path | None = Field(default=None, exclude=True)

    @field_validator("signals")
    @classmethod
    def _names(cls, signals: dict[str, SignalColumn]) -> dict[str, SignalColumn]:
        for name in signals:
            # these signs are in connectors of any system only, such as "valve.spool", "crane.f[0]", "der(x)", "p@tank"
            connector = any(sign in name for sign in ".[(@") and name.isprintable()
            if not (name.isidentifier() or connector) or name in _RESERVED:
                how = _OF_OWN.get(name, "use letters, digits and _")
                raise ValueError(f"'{name}' cannot be the name of a signal: {how}")
        return signals

    @model_validator(mode="after")
    def _one_model(self) -> "Mapping":
        if self.machine and self.model is not None:
            raise ValueError("give either a model or a table [machine], which makes one")
        for name, column in self.signals.items():
            if name in SIGNALS and column.unit is not None and not self.of_others:
                target = SIGNALS[name].si
                own = name == "u" and self.machine.get("command") == "place"
                remedy = of_a_place(column.unit) if own else raw_reading(target, column.unit)
                _convertible(column.unit, target, f"signal '{name}': ", remedy)
        return self

    @model_validator(mode="after")
    def _held_out(self) -> "Mapping":
        known = [*self.signals, *(["time"] if self.time.column is not None else [])]
        for name in self.held_out:
            if name not in known:
                raise ValueError(f"held_out: '{name}' is not a signal of the mapping{closest(name, known)}")
        return self

    @property
    def of_held_out(self) -> "Mapping":
        """The mapping of the second record."""
        columns = dict(self.held_out)
        time = self.time
        if "time" in columns:
            time = time.model_copy(update={"column": columns.pop("time")})
        signals = {
            name: column.model_copy(update={"column": columns.get(name, column.column)})
            for name, column in self.signals.items()
        }
        return self.model_copy(update={"time": time, "signals": signals, "held_out": {}})

    @property
    def of_others(self) -> bool:
        """Whether it names a package or FMU, whose signals are not ours even where they are called so."""
        return (self.model or "").lower().endswith((".ssp", ".fmu"))

    @property
    def model_reference(self) -> str | None:
        """The model's name, or the path of its file: relative where that of the mapping is."""
        if self.model is None or not self.model.lower().endswith((".ssp", ".ssv", ".ssd", ".fmu")):
            return self.model
        folder = self.path.parent if self.path else Path()
        given = folder / self.model
        short = Path(os.path.normpath(given))
        return str(
            short if short.resolve() == given.resolve() else given
        )  # ".." behind a link leads elsewhere


def _convertible(unit: str, target: str | None, prefix: str = "", remedy: str = "") -> None:
    try:
        check_spelling(unit)
        if target is not None:
            conversion(unit, target)
    except UsageError as error:
        raise ValueError(f"{prefix}{error}{remedy}") from None


# what shows the motion of another machine than the crane
OTHER_MOTIONS = (("m", "travel"), ("m/s", "speed"), ("rad/s", "speed"))


def of_a_place(unit: str) -> str:
    """What to write where the command is a place, and was given in its unit."""
    return f"""; of a demanded place, write unit = "1" and say in [machine] what place a 1 is (speed = "1 {unit}")"""


def raw_reading(target: str, unit: str) -> str:
    """What to write where a signal that is a share is read as a pulse, a voltage or counts, or an angle as a length."""
    if target == "1":
        return (
            """; of a raw reading, such as a voltage, write unit = "1" and gain = 1 over its value at full command, or, """
            """without a gain, say under [machine] what one of it brings (speed = "25 rpm")"""
        )
    for other, name in OTHER_MOTIONS if target == "rad" else ():
        with suppress(UsageError):
            conversion(unit, other)
            return f"; beside a [machine] it is called '{name}'"
    return ""


def load_mapping(path: Path | str) -> Mapping:
    """Reads a mapping file.

    Raises:
        DataError: it is missing, is no TOML, or a key or value in it is wrong; the message names the key.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(
            f"{path}: the mapping cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"{path}: the mapping is not valid TOML: {error}") from None
    if "path" in content:
        raise DataError(f"{path}: 'path' is not a key of a mapping; known: {', '.join(_keys(Mapping))}")
    try:
        return Mapping.model_validate({**content, "path": path})
    except ValidationError as error:
        raise DataError(f"{path}: " + "; ".join(_explain(dict(item)) for item in error.errors())) from None


def _keys(model: type[BaseModel]) -> list[str]:
    return [key for key in model.model_fields if key != "path"]


def _explain(item: dict[str, object]) -> str:
    """One pydantic error as a sentence with the key's path."""
    location = [str(part) for part in item["loc"]]  # type: ignore[attr-defined]
    where = ".".join(part for part in location if "[" not in part and part not in ("str", "float", "int"))
    if item["type"] == "extra_forbidden":
        models: dict[str, type[BaseModel]] = {"file": FileFormat, "time": TimeColumn, "signals": SignalColumn}
        known = _keys(models[location[0]] if len(location) > 1 else Mapping)
        hint = closest(location[-1], known) or f"; known: {', '.join(known)}"
        return f"'{where}' is not a key of a mapping{hint}"
    if item["type"] == "missing":
        return f"'{where}' is missing{REMEDIES.get(where, '')}"
    message = str(item["msg"]).removeprefix("Value error, ")
    return f"'{where}': {message}" if where else message
