"""Loads a log or a tracker's record: open, choose columns, convert to SI, mend, check."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ColumnsError, DataError
from cosim.files import why_no_file
from cosim.logs.channels import MdfSource, TdmsSource
from cosim.logs.choose import Pick, choose, choose_mapped, remedy
from cosim.logs.jumps import describe, jumps, stepping
from cosim.logs.log import Gap, Log, Tracker
from cosim.logs.mapping import Mapping, load_mapping
from cosim.logs.markers import holds_markers, tracker_of_markers
from cosim.logs.mat import MatSource
from cosim.logs.matrix import MatrixText, holds_matrix
from cosim.logs.packed import PACKED, ZIP, PackedText, Workbook
from cosim.logs.parquet import ParquetSource
from cosim.logs.repair import TimeRepair, fill, sampling
from cosim.logs.source import Array, Source, digest
from cosim.logs.text import TextSource
from cosim.signals import LOG_SIGNALS, SIGNALS, SYNTHETIC_COLUMN, TRACKER_SIGNALS, conversion

_TEXT = (".csv", ".txt", ".tsv", ".dat", ".log", ".m")
_BINARY: dict[str, Callable[[Path], Source]] = {
    ".parquet": ParquetSource,
    ".pq": ParquetSource,
    ".mat": MatSource,
    ".mf4": MdfSource,
    ".mdf": MdfSource,
    ".tdms": TdmsSource,
}
_BOOK = ".xlsx"
OTHER_KINDS = {
    (".7z", ".rar", ".tar", ".tgz"): "unpack it first",
    (*PACKED,): "a compressed text file is called so, such as log.csv.gz; unpack any other first",
    (".xls", ".xlsm", ".xlsb", ".ods"): "save it as .xlsx, or its sheet as CSV",
    (
        ".json",
        ".npz",
        ".npy",
        ".pkl",
        ".h5",
        ".hdf5",
        ".feather",
    ): "write it as CSV or Parquet, a column for each signal "
    "(pandas: DataFrame.to_csv('log.csv', index=False))",
    (
        ".bag",
        ".db3",
        ".mcap",
    ): "write the messages of its topics as CSV, a row for each sample and a column of time",
    (".blf", ".asc", ".trc"): "decode its CAN messages with their database (.dbc) into MDF4 or CSV",
}  # what people have that is not read -> what makes a log of it
SUFFIXES: tuple[str, ...] = (*_TEXT, *_BINARY, _BOOK)
"""File types that can be loaded, besides text files that are compressed."""
ENDINGS = (*(text + packed for text in _TEXT for packed in PACKED), *SUFFIXES)
"""What the name of a log ends in, the longer before the shorter."""


def ending(name: str) -> str | None:
    """What a file's name ends in if it is that of a log, such as ``.csv.gz``; None of any other."""
    return next((known for known in ENDINGS if name.lower().endswith(known)), None)


def stem(path: Path) -> str:
    """A file's name without what a log's name ends in."""
    return path.name[: len(path.name) - len(ending(path.name) or path.suffix)]


def load_log(
    path: Path | str,
    mapping: Mapping | Path | str | None = None,
    *,
    select: Sequence[str] | None = None,
    source: Source | None = None,
) -> Log:
    """Loads a log.

    Args:
        path: CSV (.csv, .txt, .tsv, .dat; also compressed, .csv.gz), .mat, .parquet, .mf4, .tdms or .xlsx file.
        mapping: mapping or its file, for a file whose columns have other names; only what it names is read.
        select: load only these signals.
        source: the file as `open_source` opened it with this mapping, where it did.

    Returns:
        The signals in SI on a strictly increasing time; what was repaired is in `Log.warnings`.

    Raises:
        DataError: the file or mapping is bad beyond mending; the message names file, row and column.
        UsageError: `select` names an unknown signal.
        MissingExtraError: the file type needs an optional dependency.
    """
    chosen = mapping if isinstance(mapping, Mapping) or mapping is None else load_mapping(mapping)
    if chosen is not None:
        _check_content(Path(path), chosen)
    raw = _load(source or open_source(Path(path), chosen), chosen, LOG_SIGNALS, select)
    return Log(
        time=raw.time,
        source=raw.source,
        warnings=tuple(raw.warnings),
        synthetic=raw.synthetic,
        sha256=raw.sha256,
        signals=raw.signals,
        units={pick.name: pick.si for pick in raw.picks if pick.name in raw.signals},
        display={pick.name: pick.unit for pick in raw.picks if pick.name in raw.signals},
        held=frozenset(pick.name for pick in raw.picks if pick.held and pick.name in raw.signals),
        valid=raw.valid,
        gaps=raw.gaps,
        time_unit=raw.time_unit,
        model=chosen.model_reference if chosen else None,
    )


def load_tracker(
    path: Path | str, mapping: Mapping | Path | str | None = None, source: Source | None = None
) -> Tracker:
    """Loads the record of an external tracker: `time` and `slew_external`, on its own clock, neither shifted nor resampled.

    A record of marker positions is turned into the angle by the marker models beside it (`cosim.logs.markers`). `source` is
    the file as `open_source` opened it with this mapping, where it did.

    Raises:
        DataError: the file or mapping is bad beyond mending, or has no `slew_external` and no markers.
        MissingExtraError: the file type needs an optional dependency.
    """
    chosen = mapping if isinstance(mapping, Mapping) or mapping is None else load_mapping(mapping)
    if chosen is not None and "slew_external" not in chosen.signals:
        raise DataError(
            f"{chosen.path or 'the mapping'}: has no signal 'slew_external', which a tracker's file must hold"
        )
    opened = source or open_source(Path(path), chosen)
    if chosen is None and holds_markers(opened):
        return tracker_of_markers(opened)
    raw = _load(opened, chosen, TRACKER_SIGNALS, ["slew_external"] if chosen else None)
    if "slew_external" not in raw.signals:
        raise DataError(f"{raw.source}: 'slew_external' has no value at all")
    return Tracker(
        time=raw.time,
        source=raw.source,
        warnings=tuple(raw.warnings),
        synthetic=raw.synthetic,
        sha256=raw.sha256,
        slew_external=raw.signals["slew_external"],
        valid=raw.valid.get("slew_external", np.ones(len(raw.time), dtype=bool)),
        gaps=raw.gaps,
    )


def _check_content(path: Path, mapping: Mapping) -> None:
    """Refuse a file of a name that the mapping knows with another content."""
    wanted = mapping.sha256.get(path.name)
    if wanted is not None and path.is_file() and digest(path) != wanted:
        raise DataError(
            f"{path}: SHA-256 {digest(path)} is not {wanted}, for which {mapping.path or 'the mapping'} was made: get the "
            "file again, or take its line out of [sha256] if you changed it on purpose"
        )


@dataclass
class _Raw:
    source: Path
    picks: list[Pick]
    sha256: str
    time: Array
    time_unit: str
    signals: dict[str, Array]
    valid: dict[str, NDArray[np.bool_]]
    gaps: tuple[Gap, ...]
    synthetic: bool
    warnings: list[str]


def open_source(path: Path, mapping: Mapping | None = None, header: bool = True) -> Source:
    """Opens a file of measured data by its suffix, without reading its columns.

    Args:
        path: the file.
        mapping: says how a text file is written, where the file itself does not tell.
        header: False for a table of text that starts with data.

    Raises:
        DataError: it is missing, of an unknown type, or damaged.
        MissingExtraError: its type needs an optional dependency.
    """
    if not path.is_file():
        raise DataError(f"{path}: {why_no_file(path)}")
    suffix = path.suffix.lower()
    try:
        options = mapping.file.model_dump() if mapping else {}
        sheet = options.pop("sheet", None)
        options |= {} if header else {"header": False}
        if suffix == _BOOK:
            return Workbook(path, sheet, **options)
        if suffix in _TEXT:
            return MatrixText(path, **options) if holds_matrix(path) else TextSource(path, **options)
        if suffix == ZIP or (suffix in PACKED and ending(path.name)):
            return PackedText(path, _TEXT, **options)
        if suffix in _BINARY:
            return _BINARY[suffix](path)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from None
    remedy = next((f": {text}" for kinds, text in OTHER_KINDS.items() if suffix in kinds), "")
    raise DataError(f"{path}: a log is one of {', '.join(SUFFIXES)}; '{suffix}' is none of them{remedy}")


def _load(
    source: Source, mapping: Mapping | None, known: Sequence[str], select: Sequence[str] | None
) -> _Raw:
    path = source.path
    if mapping is None:
        picks, notes = choose(source, known, select)
    else:
        picks, notes = choose_mapped(source, mapping, select), []
    second = [p for p in picks if p.minus is not None]
    values = source.read([*(p.index for p in picks), *(p.minus for p in second if p.minus is not None)])
    columns = dict(zip((p.name for p in picks), values, strict=False))
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is infinite, and mended as missing
        for pick, off in zip(second, values[len(picks) :], strict=True):
            _take_off(source, pick, columns, off)
        for pick in picks:
            _scale(columns[pick.name], pick)
    mark = columns.pop(SYNTHETIC_COLUMN, None)
    synthetic = bool(mark is not None and (mark == 1.0).any())
    time, unit, aligned = _time(source, picks, columns, mapping)
    _same_length(source, time, columns)
    columns.pop("time", None)
    repair = TimeRepair(time, list(columns.values()), lambda k: f"{path}: {source.at(k)}")
    time = repair.time
    if repair.keep is not None:
        columns = {name: values[repair.keep] for name, values in columns.items()}

    for pick in picks:
        if pick.period is not None and pick.name in columns:
            there = np.isfinite(columns[pick.name])
            columns[pick.name][there] = np.unwrap(columns[pick.name][there], period=pick.period)

    def place(k: int) -> str:
        return source.at(int(k if repair.keep is None else repair.keep[k]))

    gaps, timing = sampling(time, place, unit)
    taken = {index for pick in picks for index in (pick.index, pick.minus)}

    def beside() -> dict[str, Array]:
        """The columns that are no signal, such as the reference of a controller; read only where a signal jumps."""
        if any(source.clock(p.index) is not None for p in picks):
            return {}
        found = _readable(source, [k for k in range(len(source.labels)) if k not in taken])
        return {n: v if repair.keep is None else v[repair.keep] for n, v in found.items()}

    valid, mended = _mend(path, time, columns, {pick.name: pick for pick in picks}, place, beside)
    if not columns:
        raise DataError(f"{path}: no signal has any value")
    warnings = [*source.warnings, *notes, *aligned, *repair.warnings, *timing, *mended]
    return _Raw(path, picks, digest(path), time, unit, columns, valid, gaps, synthetic, warnings)


def _take_off(source: Source, pick: Pick, columns: dict[str, Array], off: Array) -> None:
    clocks = source.clock(pick.index), source.clock(pick.minus or 0)
    same = all(clock is None for clock in clocks) or (
        all(clock is not None for clock in clocks) and np.array_equal(*clocks)  # type: ignore[arg-type]
    )
    if not same or len(off) != len(columns[pick.name]):
        raise DataError(
            f"{source.path}: 'signals.{pick.name}.minus' takes one column off another with other time stamps"
        )
    columns[pick.name] -= off


def _scale(values: Array, pick: Pick) -> None:
    if pick.scale != 1.0:
        values *= pick.scale
    if pick.shift:
        values += pick.shift


def _time(
    source: Source, picks: list[Pick], columns: dict[str, Array], mapping: Mapping | None
) -> tuple[Array, str, list[str]]:
    """The stamps [s], their unit, and sentences on columns brought to a common clock (in place)."""
    if mapping is not None and mapping.time.step is not None:
        count = max(map(len, columns.values()))
        scale = 1.0 if mapping.time.unit == "sample" else conversion(mapping.time.unit or "s", "s")
        return (
            np.arange(count, dtype=np.float64) * (mapping.time.step * scale),
            "sample" if mapping.time.unit == "sample" else "s",
            [],
        )
    if "time" in columns and source.clock(next(p.index for p in picks if p.name == "time")) is None:
        return columns["time"], "s", []
    clocks = {p.name: source.clock(p.index) for p in picks if p.name in columns and p.name != "time"}
    stamps = {name: clock for name, clock in clocks.items() if clock is not None}
    if len(stamps) < len(clocks) or not stamps:
        raise ColumnsError(
            f"{source.path}: there is no time column: add 'time [s]', or name the column or the step in a mapping"
            f" ({remedy(source)})"
        )
    return _align(source, stamps, columns, {p.name for p in picks if p.held})


def _align(
    source: Source, stamps: dict[str, Array], columns: dict[str, Array], held: set[str]
) -> tuple[Array, str, list[str]]:
    """Brings channels with clocks of their own to the clock of the one with the most samples."""
    master = max(stamps, key=lambda name: len(stamps[name]))
    time = stamps[master]
    moved = []
    for name, clock in stamps.items():
        if len(clock) != len(columns[name]):
            raise DataError(
                f"{source.path}: '{name}' has {len(columns[name])} values and {len(clock)} time stamps"
            )
        if len(clock) == len(time) and np.array_equal(clock, time):
            continue
        if not len(clock) or not np.isfinite(clock).all() or (np.diff(clock) <= 0).any():
            raise DataError(f"{source.path}: the time stamps of '{name}' are not increasing")
        if name in held:
            values = columns[name][np.maximum(np.searchsorted(clock, time, "right") - 1, 0)]
        else:
            values = np.interp(time, clock, columns[name])
        values[(time < clock[0]) | (time > clock[-1])] = np.nan
        columns[name] = values
        moved.append(f"'{name}'")
    note = f"{', '.join(moved)}: on a clock of their own, brought to that of '{master}'"
    return time, "s", [note] if moved else []


def _same_length(source: Source, time: Array, columns: dict[str, Array]) -> None:
    for name, values in columns.items():
        if len(values) != len(time):
            raise DataError(f"{source.path}: '{name}' has {len(values)} values, time has {len(time)}")


def _readable(source: Source, indices: Sequence[int]) -> dict[str, Array]:
    """Those columns that hold nothing but numbers, by their headings."""
    found, told = {}, list(source.warnings)
    for k in indices:
        try:
            (values,) = source.read([k])
        except DataError:  # a column of text is not asked for
            continue
        if np.isfinite(values).all():
            found[source.labels[k].shown] = values
    source.warnings[:] = told  # what these columns need is nothing to be told
    return found


def _mend(
    path: Path,
    time: Array,
    columns: dict[str, Array],
    picks: dict[str, Pick],
    place: Callable[[int], str],
    beside: Callable[[], dict[str, Array]],
) -> tuple[dict[str, NDArray[np.bool_]], list[str]]:
    """Fills missing values, drops empty signals and checks ranges; changes `columns` in place."""
    valid: dict[str, NDArray[np.bool_]] = {}
    notes = []
    for name in list(columns):
        values = columns[name]
        if not np.isfinite(values).any():
            del columns[name]
            notes.append(f"{name}: no value at all; treated as missing")
            continue
        mask, note = fill(name, time, values, picks[name].held, lambda k: f"{path}: {place(k)}")
        if mask is not None:
            valid[name] = mask
            notes.append(note)
        notes += _range_note(name, values, place, picks[name])
    for name in columns:
        notes += _jump_note(time, columns, place, picks[name], beside)
    return valid, notes


def _range_note(name: str, values: Array, place: Callable[[int], str], pick: Pick) -> list[str]:
    signal = SIGNALS.get(name)
    plausible = pick.plausible or ((signal.low, signal.high) if signal else None)
    if plausible is None:
        return []
    low, high = float(values.min()), float(values.max())
    if plausible[0] <= low and high <= plausible[1]:
        return []
    first = int(np.argmax((values < plausible[0]) | (values > plausible[1])))
    scale = conversion(pick.unit, pick.si)
    of = "" if pick.unit == "1" else f" {pick.unit}"
    shown = [f"{value / scale:.6g}" for value in (low, high, *plausible)]
    return [
        f"{name}: values from {shown[0]} to {shown[1]}{of}, plausible are {shown[2]} to {shown[3]}: check unit"
        f" and scaling (first: {place(first)})"
    ]


def _jump_note(
    time: Array,
    columns: dict[str, Array],
    place: Callable[[int], str],
    pick: Pick,
    beside: Callable[[], dict[str, Array]],
) -> list[str]:
    rest = [values for name, values in columns.items() if name != pick.name]
    starts, size = jumps(time, columns[pick.name], pick.held, rest)
    if not starts.size:
        return []
    others = stepping(starts, {n: v for n, v in columns.items() if n != pick.name}) or stepping(
        starts, {f"'{n}'": v for n, v in beside().items() if v.size == time.size}
    )
    return [describe(pick.name, pick.unit, starts, size / conversion(pick.unit, pick.si), place, others[:2])]
