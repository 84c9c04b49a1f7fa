"""Writes a log as CSV, Parquet or MAT: headings ``name [unit]``, log units, and every digit."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from cosim.errors import UsageError
from cosim.files import whole
from cosim.logs import checksums
from cosim.logs.log import Log, Tracker
from cosim.logs.source import Array
from cosim.signals import SIGNALS, SYNTHETIC_COLUMN, conversion

WRITABLE: tuple[str, ...] = (".csv", ".parquet", ".mat")
"""File types that can be written."""

_ROW_GROUP = 1 << 17  # small enough that a reader's buffers do not count


def write_log(log: Log | Tracker, path: Path | str) -> Path:
    """Writes a log or a tracker's record; the suffix chooses the format. Filled values are written as missing.

    CSV numbers have the fewest digits that read back to the same value. A synthetic log keeps its mark.

    Args:
        log: what to write.
        path: .csv, .parquet or .mat file; missing folders are made.

    Returns:
        The path.

    Raises:
        UsageError: the suffix or the file cannot be written, or the log's time is in samples.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in WRITABLE:
        raise UsageError(f"{path}: a log is written as {', '.join(WRITABLE)}; '{suffix}' is none of them")
    columns = _columns(log)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole(path) as part:
            if suffix == ".mat":
                _write_mat(columns, part)
            else:
                table = pa.table({f"{name} [{unit}]": values for (name, unit), values in columns.items()})
                if suffix == ".csv":
                    _write_csv(table, part)
                else:
                    pq.write_table(
                        checksums.added(table), part, row_group_size=_ROW_GROUP, write_page_checksum=True
                    )
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _columns(log: Log | Tracker) -> dict[tuple[str, str], Array]:
    if isinstance(log, Log) and log.time_unit != "s":
        raise UsageError(f"{log.source}: a log whose time is in samples cannot be written: it needs seconds")
    columns: dict[tuple[str, str], Array] = {("time", "s"): log.time}
    if isinstance(log, Tracker):
        unit = SIGNALS["slew_external"].unit
        columns["slew_external", unit] = _displayed(log.slew_external, unit, "rad", log.valid)
    else:
        for name, values in log.signals.items():
            unit = log.display[name]
            columns[name, unit] = _displayed(values, unit, log.units[name], log.valid.get(name))
    if log.synthetic:
        columns[SYNTHETIC_COLUMN, "1"] = np.ones(len(log.time))
    return columns


def _displayed(values: Array, unit: str, si: str, valid: NDArray[np.bool_] | None) -> Array:
    """SI values in the file's unit, NaN where not valid; of several numbers that read back to the same, the roundest."""
    scale = conversion(unit, si)
    shown = values / scale
    if scale != 1.0:
        for decimals in (12, 9, 6):
            rounder = np.round(shown, decimals)
            np.copyto(shown, rounder, where=rounder * scale == values)
    return shown if valid is None else np.where(valid, shown, np.nan)


def _write_csv(table: pa.Table, path: Path) -> None:
    with path.open("wb") as file:
        file.write((",".join(table.column_names) + "\n").encode())
        arrow_csv.write_csv(
            _nan_as_null(table), file, arrow_csv.WriteOptions(include_header=False, quoting_style="none")
        )


def _nan_as_null(table: pa.Table) -> pa.Table:
    """NaN as null, which pyarrow writes as an empty cell."""
    arrays = [pa.array(column.to_numpy(), from_pandas=True) for column in table.columns]
    return pa.table(arrays, names=table.column_names)


def _write_mat(columns: dict[tuple[str, str], Array], path: Path) -> None:
    """One matrix ``data`` (n, m) with the texts ``names`` and ``units``: what MATLAB users unpack in a line."""
    from scipy.io import savemat

    names, units = (np.array([key[part] for key in columns], dtype=object) for part in (0, 1))
    savemat(
        path,
        {"data": np.column_stack(list(columns.values())), "names": names, "units": units},
        do_compression=True,
    )
