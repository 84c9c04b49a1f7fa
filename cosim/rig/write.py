"""Synthetic logs in the program's own form and as files, with the truth beside them."""

import dataclasses
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.files import write_text
from cosim.logs.log import Log, Tracker
from cosim.logs.write import WRITABLE, write_log
from cosim.rig.run import RigRun
from cosim.signals import SIGNALS

DECIMALS: dict[str, int] = {  # in the log's units; each last digit is at most a thousandth of the noise
    "u": 9,
    "spool": 6,
    "p_supply": 5,
    "p_a": 5,
    "p_b": 5,
    "slew": 6,
    "slew_estimate": 6,
    "slew_rate_estimate": 6,
    "slew_external": 6,
}

MM = 1e-3


def check_suffix(path: Path) -> None:
    """Refuse a file type that cannot be written, before any work is done.

    Raises:
        UsageError: a log cannot be written with this suffix.
    """
    if path.suffix.lower() not in WRITABLE:
        raise UsageError(
            f"{path}: a log is written as {', '.join(WRITABLE)}; '{path.suffix}' is none of them"
        )


def as_log(run: RigRun) -> Log:
    """The log of `run` (SI, every digit) as `cosim.logs.load_log` would give it, marked as synthetic."""
    signals = run.signals
    return Log(
        time=run.time,
        source=Path("synthetic"),
        warnings=(),
        synthetic=True,
        sha256="",
        signals=signals,
        units={name: SIGNALS[name].si for name in signals},
        display={name: SIGNALS[name].unit for name in signals},
        held=frozenset(name for name in signals if SIGNALS[name].held),
    )


def as_tracker(run: RigRun) -> Tracker:
    """The tracker's record of `run` (SI, every digit), marked as synthetic.

    Raises:
        UsageError: the run has no tracker record.
    """
    if run.tracker is None:
        raise UsageError("this run has no tracker record: make it with tracker=True")
    stamps, angle = run.tracker
    valid = np.isfinite(angle)  # a sample without a pose is missing
    return Tracker(
        time=stamps,
        source=Path("synthetic"),
        warnings=(),
        synthetic=True,
        sha256="",
        slew_external=angle if valid.all() else np.interp(stamps, stamps[valid], angle[valid]),
        valid=valid,
    )


def _rounded(name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """SI values with the digits that the file keeps."""
    scale = SIGNALS[name].to_si
    return np.asarray(np.round(values / scale, DECIMALS[name]) * scale)


def write(run: RigRun, path: Path) -> None:
    """Write the log of `run`; the suffix of `path` chooses CSV, Parquet or MAT.

    Raises:
        UsageError: the suffix is none of these, or the file cannot be written.
    """
    log = as_log(run)
    signals = {name: _rounded(name, values) for name, values in log.signals.items()}
    write_log(dataclasses.replace(log, time=np.round(run.time, 6), signals=signals), path)


def write_tracker(run: RigRun, path: Path) -> None:
    """Write the tracker's record of `run`, on its own clock.

    Raises:
        UsageError: the run has no tracker record, or suffix or file cannot be written.
    """
    record = as_tracker(run)
    angle = _rounded("slew_external", record.slew_external)
    write_log(dataclasses.replace(record, time=np.round(record.time, 6), slew_external=angle), path)


def write_markers(run: RigRun, path: Path) -> Path:
    """Write the marker positions of `run`, on the tracker's clock: ``S1_x [mm]`` and so on, empty where hidden.

    Beside it goes NAME.models.toml with the two marker models, as every reader of a tracker's record looks for them; its
    path is returned.

    Raises:
        UsageError: the run has no marker positions, or suffix or file cannot be written.
    """
    if run.markers is None:
        raise UsageError("this run has no marker positions: make it with markers=True")
    seen = run.markers
    signals = {
        f"{marker}_{axis}": np.round(seen.positions[:, i, k] / MM, 6) * MM  # far below the noise
        for i, marker in enumerate(seen.markers)
        for k, axis in enumerate("xyz")
    }
    log = Log(
        time=np.round(seen.stamps, 6),
        source=Path("synthetic"),
        warnings=(),
        synthetic=True,
        sha256="",
        signals=signals,
        units=dict.fromkeys(signals, "m"),
        display=dict.fromkeys(signals, "mm"),
        held=frozenset(),
    )
    write_log(log, path)
    lines = ["# marker models of the virtual rig; the first counts below 12 deg", 'unit = "mm"']
    for model in seen.models:
        lines += ["", f'[models."{model.name}"]']
        for marker in model.markers:
            x, y, z = model.array((marker,))[0] / MM
            lines.append(f"{marker} = [{x:.9g}, {y:.9g}, {z:.9g}]")
    return _written(path.with_name(f"{path.stem}.models.toml"), "\n".join(lines) + "\n")


def write_truth(run: RigRun, log: Path) -> Path:
    """Write what was hidden in the log at `log` to ``<log>.truth.json`` beside it, and return that path."""
    return _written(
        log.with_name(log.name + ".truth.json"), json.dumps(run.truth, indent=2, sort_keys=True) + "\n"
    )


def _written(path: Path, text: str) -> Path:
    try:
        return write_text(path, text)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None
