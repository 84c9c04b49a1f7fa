"""A record of marker positions as the tracker's record: the slew angle by two marker models that lie beside it (3.5.4)."""

import json
import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError, UsageError
from cosim.logs.clocks import TIME_WORDS, plain
from cosim.logs.log import Tracker
from cosim.logs.source import Source, digest
from cosim.markers import MarkerModel, stitch
from cosim.signals import SYNTHETIC_COLUMN, conversion

Array = NDArray[np.float64]
AXES = ("x", "y", "z")
ANGLE = "slew_external"
LEAST = 3  # markers that make a pose


def marker_names(columns: Collection[str]) -> tuple[str, ...]:
    """Markers of which a table has all three coordinates."""
    return tuple(
        name[:-2]
        for name in columns
        if name.endswith("_x") and all(f"{name[:-2]}_{axis}" in columns for axis in AXES)
    )


def holds_markers(source: Source) -> bool:
    """Whether a file holds marker positions, and no slew angle made of them.

    A pose takes three markers. A table with fewer, or in which other quantities stand beside them, is a log like others.
    """
    names = {name for label in source.labels for name in (label.name, label.alias) if name}
    markers = marker_names(names)
    others = names - {f"{marker}_{axis}" for marker in markers for axis in AXES}
    beside = [name for name in others if not TIME_WORDS.search(plain(name)) and name != SYNTHETIC_COLUMN]
    return len(markers) >= LEAST and not beside


def models_beside(path: Path) -> Path:
    """The file of the two marker models that belongs to a record of positions.

    Raises:
        DataError: there is none; the message says what to write.
    """
    names = [f"{stem}models{suffix}" for stem in (f"{path.stem}.", "") for suffix in (".toml", ".json")]
    for name in names:
        if (found := path.with_name(name)).is_file():
            return found
    raise DataError(
        f"{path} holds marker positions and no '{ANGLE}': put the two marker models beside it as {names[0]}"
        f" (docs/identify.md), or make the tracker's record by `cosim identify markers {path.name} --models FILE --out DIR`"
    )


def tracker_of_markers(source: Source) -> Tracker:
    """The tracker's record by the poses of the markers, on the tracker's clock; a sample without a pose is missing.

    Raises:
        DataError: record or models are bad, or no sample has a pose.
        UsageError: models and record do not fit.
    """
    path = source.path
    models = models_beside(path)
    time, names, positions, synthetic = read_positions(path, source)
    found = stitch(positions, names, *read_models(models))
    valid = np.isfinite(found.angle)
    angle = found.angle if valid.all() else np.interp(time, time[valid], found.angle[valid])
    return Tracker(
        time=time,
        source=path,
        warnings=(f"slew angle by the poses of {len(names)} markers ({models.name}): {found.summary()}",),
        synthetic=synthetic,
        sha256=digest(path),
        slew_external=angle,
        valid=valid,
    )


def read_positions(path: Path, source: Source | None = None) -> tuple[Array, tuple[str, ...], Array, bool]:
    """Stamps (n,) [s], names of markers, positions (n, markers, 3) [m] with NaN where hidden, whether it is synthetic.

    The columns are ``time [s]`` and ``NAME_x [mm]``, ``NAME_y [mm]``, ``NAME_z [mm]`` for each marker, in any unit of
    length.

    Raises:
        DataError: the file cannot be read, or a column is missing or has no unit; the message names it.
    """
    from cosim.logs.load import open_source

    source = source or open_source(path)
    columns = {label.name: (k, label) for k, label in enumerate(source.labels)}
    names = marker_names(columns)
    if "time" not in columns or not names:
        raise DataError(
            f"{path}: a record of markers has 'time [s]' and 'NAME_x [mm]', 'NAME_y [mm]', 'NAME_z [mm]' for each marker; "
            f"this has {', '.join(label.text for label in source.labels)}"
        )
    wanted = [("time", "s"), *((f"{name}_{axis}", "m") for name in names for axis in AXES)]
    read = []
    values = source.read([columns[name][0] for name, _ in wanted])
    for (name, si), column in zip(wanted, values, strict=True):
        label = columns[name][1]
        if label.unit is None:
            raise DataError(f"{path}: column '{label.text}' has no unit: write it as '{label.name} [mm]'")
        try:
            read.append(column * conversion(label.unit, si))
        except UsageError as error:
            raise DataError(f"{path}: column '{label.text}': {error}") from None
    time = read[0]
    back = np.flatnonzero(~(np.diff(time) > 0.0))
    if time.size == 0 or back.size:
        where = f"{source.at(int(back[0]) + 1)}: the time does not rise" if back.size else "no rows"
        raise DataError(f"{path}: {where}")
    positions = np.stack(read[1:], axis=1).reshape(time.size, len(names), 3)
    return time, names, positions, SYNTHETIC_COLUMN in columns


def read_models(path: Path) -> tuple[MarkerModel, MarkerModel]:
    """The two marker models of a .toml or .json file: that below 12 deg first.

    It holds ``unit`` and under ``models`` a table a model: marker = [x, y, z]. The truth file of the rig is such a file too.

    Raises:
        DataError: the file cannot be read or does not hold two such tables.
        UsageError: a model is none.
    """
    try:
        text = path.read_text(encoding="utf-8")
        data: dict[str, Any] = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from None
    data = data.get("markers", data) if isinstance(data, dict) else {}
    models = data.get("models") if isinstance(data, dict) else None
    if not isinstance(models, dict) or len(models) != 2 or not isinstance(data.get("unit"), str):
        raise DataError(
            f"{path}: marker models are written as unit = \"mm\" and two tables such as [models.'model 1'] with lines "
            "S1 = [900, 250, 1200]; the first counts below 12 deg"
        )
    try:
        scale, made = conversion(data["unit"], "m"), []
    except UsageError as error:
        raise DataError(f"{path}: {error}") from None
    for name, points in models.items():
        try:
            scaled = {str(marker): np.asarray(point, dtype=float) * scale for marker, point in points.items()}
        except (AttributeError, TypeError, ValueError):
            raise DataError(f"{path}: a marker of '{name}' is not written as [x, y, z]") from None
        made.append(MarkerModel(str(name), scaled))
    return made[0], made[1]
