"""``cosim identify markers``: the slew angle and the seam from a record of marker positions and two marker models."""

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError, UsageError
from cosim.identify.answer import Answer
from cosim.logs.load import open_source
from cosim.markers import Limits, MarkerModel, Poses, Stitched, seam, slew, stitch
from cosim.signals import SYNTHETIC_COLUMN, conversion

Array = NDArray[np.float64]
DEG = math.pi / 180.0
AXES = ("x", "y", "z")


def read_positions(path: Path) -> tuple[Array, tuple[str, ...], Array, bool]:
    """Stamps (n,) [s], names of markers, positions (n, markers, 3) [m] with NaN where hidden, whether it is synthetic.

    The columns are ``time [s]`` and ``NAME_x [mm]``, ``NAME_y [mm]``, ``NAME_z [mm]`` for each marker, in any unit of
    length.

    Raises:
        DataError: the file cannot be read, or a column is missing or has no unit; the message names it.
    """
    source = open_source(path)
    columns = {label.name: (k, label) for k, label in enumerate(source.labels)}
    names = tuple(
        name[:-2]
        for name in columns
        if name.endswith("_x") and all(f"{name[:-2]}_{axis}" in columns for axis in AXES)
    )
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


def markers_answer(record: Path, models: Path, limits: Limits) -> Answer:
    """The slew angle of a record of marker positions as the tracker's record, and the seam of the two models.

    Args:
        record: positions, whose z axis is the slew axis.
        models: file of the two models.
        limits: what a sample must keep to.

    Raises:
        DataError: a file is bad, or no sample gives an angle.
        UsageError: models and record do not fit.
    """
    time, names, positions, synthetic = read_positions(record)
    first, second = read_models(models)
    found = stitch(positions, names, first, second, limits)
    noise = _noise(found)
    step, deviation, overlap = _step(found, noise)
    notes = []
    try:
        predicted: float | None = seam(first, second)
    except UsageError as error:
        predicted = None
        notes.append(f"the seam is not known from the models: {error}")
    there = np.isfinite(found.angle)
    data = {
        "synthetic": synthetic,
        "samples": int(there.size),
        "with_angle": int(there.sum()),
        "refused": {pose.model: pose.counts for pose in found.poses},
        "noise_of_a_coordinate": {"value": noise * 1e3, "unit": "mm"},
        "noise_of_the_angle": {
            "value": noise * float(np.median(found.deviation[there])) / DEG,
            "unit": "deg",
        },
        "seam_of_the_models": None if predicted is None else {"value": predicted / DEG, "unit": "deg"},
        "seam_in_the_record": None
        if not overlap
        else {
            "value": step / DEG,
            "unit": "deg",
            "standard_deviation": deviation / DEG,
            "samples_of_both": overlap,
        },
    }
    answer = Answer("markers", data, notes=notes)
    shown = "not known" if predicted is None else f"{predicted / DEG:.4f} deg"
    seen = (
        "no sample shows both models"
        if not overlap
        else f"{step / DEG:.4f} deg in the {overlap} samples that show both"
    )
    answer.lines = [
        f"seam below 12 deg: {shown} by the models, {seen}",
        f"noise of a coordinate {noise * 1e3:.3f} mm, of the angle {data['noise_of_the_angle']['value']:.4f} deg",  # type: ignore[index]
        found.summary(),
    ]
    answer.texts["tracker.csv"] = _tracker(time, found.angle, synthetic)
    return answer


def _noise(found: Stitched) -> float:
    """Standard deviation [m] of a coordinate, from what the poses leave: 3 coordinates a marker less 6 of the pose."""
    squares, free = 0.0, 0
    for pose in found.poses:
        good = pose.refused == ""
        squares += float(np.sum(pose.visible[good] * pose.residual[good] ** 2))
        free += int(np.sum(3 * pose.visible[good] - 6))
    return math.sqrt(squares / free)


def _step(found: Stitched, noise: float) -> tuple[float, float, int]:
    """First model's angle less the second's [rad] where both have a pose, its standard deviation at most, the samples.

    Markers that both models hold have the same error in both, so the deviation is a bound.
    """
    low, high = (slew(pose.rotation) for pose in found.poses)
    both = np.isfinite(low) & np.isfinite(high)
    count = int(both.sum())
    if not count:
        return math.nan, math.nan, 0
    variance = _variance(found.poses[0], both) + _variance(found.poses[1], both)
    return float(np.mean((low - high)[both])), noise * math.sqrt(variance / count), count


def _variance(pose: Poses, where: NDArray[np.bool_]) -> float:
    return float(np.mean(pose.sensitivity[where, 2, 2]))


def _tracker(time: Array, angle: Array, synthetic: bool) -> str:
    """The tracker's record as CSV; a sample without an angle is empty."""
    mark = ",1" if synthetic else ""
    rows = [
        f"{t:.6f},{'' if math.isnan(a) else f'{a / DEG:.6f}'}{mark}" for t, a in zip(time, angle, strict=True)
    ]
    head = "time [s],slew_external [deg]" + (",synthetic [1]" if synthetic else "")
    return "\n".join([head, *rows]) + "\n"
