"""Synthetic logs as files: CSV, Parquet or MAT by the suffix, with the truth beside them."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.io import savemat

from cosim.errors import UsageError
from cosim.rig.run import RigRun
from cosim.units import factor

SUFFIXES = (".csv", ".parquet", ".mat")
COLUMNS: dict[
    str, tuple[str, str, int]
] = {  # signal -> SI unit, unit in the file, decimals (far below the noise)
    "time": ("s", "s", 6),
    "u": ("1", "1", 9),
    "spool": ("m", "mm", 6),
    "p_supply": ("Pa", "bar", 5),
    "p_a": ("Pa", "bar", 5),
    "p_b": ("Pa", "bar", 5),
    "slew": ("rad", "deg", 6),
    "slew_estimate": ("rad", "deg", 6),
    "slew_rate_estimate": ("rad/s", "deg/s", 6),
    "slew_external": ("rad", "deg", 6),
}


def check_suffix(path: Path) -> None:
    """Refuse a file type that cannot be written, before any work is done.

    Raises:
        UsageError: the suffix is not one of SUFFIXES.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"{path}: a log is written as {', '.join(SUFFIXES)}; '{path.suffix}' is none of them"
        )


def table(signals: dict[str, NDArray[np.float64]]) -> pd.DataFrame:
    """Signals (SI, ``time`` among them) as a table with ``name [unit]`` headers and the mark ``synthetic [1]``."""
    columns = {}
    for name, values in signals.items():
        si, unit, decimals = COLUMNS[name]
        columns[f"{name} [{unit}]"] = np.round(values * factor(si, unit), decimals)
    frame = pd.DataFrame(columns)
    frame["synthetic [1]"] = np.ones(len(frame), dtype=np.int64)
    return frame


def _write_table(frame: pd.DataFrame, path: Path) -> None:
    check_suffix(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    kind = path.suffix.lower()
    if kind == ".csv":
        frame.to_csv(path, index=False, lineterminator="\n")
    elif kind == ".parquet":
        frame.to_parquet(path, index=False)
    else:
        names = [column.split(" [")[0] for column in frame.columns]
        units = [column.split(" [")[1].rstrip("]") for column in frame.columns]
        savemat(
            path,
            {"data": frame.to_numpy(dtype=float), "names": np.array(names, dtype=object), "units": units},
        )


def write(run: RigRun, path: Path) -> None:
    """Write the log of `run`; the suffix of `path` chooses CSV, Parquet or MAT.

    Raises:
        UsageError: the suffix is none of these.
    """
    _write_table(table({"time": run.time, **run.signals}), path)


def write_tracker(run: RigRun, path: Path) -> None:
    """Write the tracker's record of `run`, on its own clock.

    Raises:
        UsageError: the run has no tracker record, or the suffix cannot be written.
    """
    if run.tracker is None:
        raise UsageError("this run has no tracker record: make it with tracker=True")
    stamps, angle = run.tracker
    _write_table(table({"time": stamps, "slew_external": angle}), path)


def truth_path(log: Path) -> Path:
    """Where the truth about the log lies: ``<log>.truth.json``."""
    return log.with_name(log.name + ".truth.json")


def write_truth(run: RigRun, log: Path) -> Path:
    """Write what was hidden in the log at `log` beside it, and return that path."""
    path = truth_path(log)
    path.write_text(json.dumps(run.truth, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    return path
