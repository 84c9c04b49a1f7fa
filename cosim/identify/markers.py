"""``cosim identify markers``: the slew angle and the seam from a record of marker positions and two marker models."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.identify.answer import Answer
from cosim.logs.markers import read_models, read_positions
from cosim.markers import Limits, Poses, Stitched, seam, slew, stitch

Array = NDArray[np.float64]
DEG = math.pi / 180.0


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
