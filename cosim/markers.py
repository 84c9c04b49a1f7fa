"""Positions of an optical tracker's markers to the pose of a rigid marker model, and to the slew angle (section 3.5.4).

A marker model is a table of points in the frame of the body that carries them. The pose is the rotation R and position t of

    measured = R point + t + noise

by least squares. Two models of one body never agree quite; where the record goes from one to the other it steps.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.errors import DataError, UsageError

Array = NDArray[np.float64]

LEAST_VISIBLE = 4  # markers that a pose needs (section 3.5.4)
SWITCH = math.radians(12.0)  # below it the first model, above it the second (Table 3.4)
LOWEST_ANGLE = math.radians(-55.0)  # a turn from here on holds the slew sensor's -20 .. 270 deg in its middle
IN_A_LINE = (
    0.05  # spread of markers across their line over that along it, below which they show no turn about it
)
REASONS = ("visible", "line", "range", "residual")


@dataclass(frozen=True)
class MarkerModel:
    """A rigid marker model.

    Attributes:
        name: what messages call it.
        points: marker -> (3,) position [m] in the body's frame; its z axis is the slew axis where a slew angle is asked for.

    Raises:
        UsageError: fewer than four markers, a position that is no three numbers, or markers in a line.
    """

    name: str
    points: Mapping[str, ArrayLike]

    def __post_init__(self) -> None:
        """Check the points."""
        for marker, point in self.points.items():
            values = np.asarray(point, dtype=np.float64)
            if values.shape != (3,) or not np.isfinite(values).all():
                raise UsageError(
                    f"marker model '{self.name}': the position of '{marker}' must be three finite numbers, in m"
                )
        if len(self.points) < LEAST_VISIBLE:
            raise UsageError(
                f"marker model '{self.name}' has {len(self.points)} markers: a pose needs at least {LEAST_VISIBLE}"
            )
        if _in_a_line(_resistance(self.array(self.markers))):
            raise UsageError(
                f"marker model '{self.name}': its markers lie in a line, so a turn about it is not seen: move one aside"
            )

    @property
    def markers(self) -> tuple[str, ...]:
        """The markers' names."""
        return tuple(self.points)

    def array(self, markers: tuple[str, ...]) -> Array:
        """Positions (markers, 3) [m] of `markers`."""
        return np.array([self.points[marker] for marker in markers], dtype=np.float64)


@dataclass(frozen=True)
class Limits:
    """What a sample must keep to.

    Attributes:
        residual: largest root mean square distance [m] of the visible markers from where the pose puts them.
        nearest, farthest: range [m] in which the tracker measures, from `camera` to each visible marker.
        camera: (3,) position [m] of the tracker in the frame of the measured positions.
    """

    residual: float = 1e-3
    nearest: float = 0.0
    farthest: float = math.inf
    camera: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Poses:
    """Poses of a marker model; NaN where a sample was refused.

    Attributes:
        model: name of the marker model.
        rotation: (n, 3, 3) from the body's frame to that of the measured positions.
        position: (n, 3) [m] of the body's origin there.
        residual: (n,) root mean square distance [m] of the visible markers from where the pose puts them.
        sensitivity: (n, 3, 3) [1/m2]; times the variance of a coordinate of a marker it is the covariance of the pose's
            rotation vector, in the frame of the measured positions, for equal and independent noise.
        visible: (n,) number of visible markers.
        refused: (n,) "" or one of REASONS.
        limits: what was asked of a sample.
    """

    model: str
    rotation: Array
    position: Array
    residual: Array
    sensitivity: Array
    visible: NDArray[np.int64]
    refused: NDArray[np.str_]
    limits: Limits = field(default_factory=Limits)

    @property
    def counts(self) -> dict[str, int]:
        """How many samples were refused for each of REASONS that occurred."""
        return {why: n for why in REASONS if (n := int(np.count_nonzero(self.refused == why)))}

    def summary(self) -> str:
        """One sentence: how many samples were refused, and why."""
        limits = self.limits
        words = {
            "visible": f"with fewer than {LEAST_VISIBLE} visible markers",
            "line": "whose visible markers lie in a line",
            "range": f"with a marker outside {limits.nearest:g} .. {limits.farthest:g} m of the tracker",
            "residual": f"with a residual above {limits.residual * 1e3:g} mm",
        }
        why = ", ".join(f"{n} {words[reason]}" for reason, n in self.counts.items())
        total = self.refused.size
        return (
            f"marker model '{self.model}': {sum(self.counts.values())} of {total} samples refused"
            f"{': ' if why else ''}{why}"
        )


def poses(
    positions: Array, markers: tuple[str, ...], model: MarkerModel, limits: Limits | None = None
) -> Poses:
    """The pose of `model` in each sample.

    Args:
        positions: (n, markers, 3) measured [m], NaN where a marker is hidden.
        markers: their names, in that order; those that are not of the model are not used.
        model: where the markers sit on the body.
        limits: what a sample must keep to; None for the usual.

    Raises:
        UsageError: shapes or names do not fit.
    """
    limits = limits or Limits()
    measured = _checked(positions, markers)
    used = tuple(marker for marker in markers if marker in model.points)
    if len(used) < LEAST_VISIBLE:
        raise UsageError(
            f"marker model '{model.name}' has {len(used)} markers in common with the record: a pose needs {LEAST_VISIBLE}. "
            f"Of the model: {', '.join(model.markers)}; in the record: {', '.join(markers)}"
        )
    measured = measured[:, [markers.index(marker) for marker in used]]
    points, seen = model.array(used), np.asarray(np.isfinite(measured).all(axis=2))
    count = measured.shape[0]
    rotation, sensitivity = np.full((count, 3, 3), np.nan), np.full((count, 3, 3), np.nan)
    position, residual = np.full((count, 3), np.nan), np.full(count, np.nan)
    refused = np.full(count, "", dtype="<U8")
    with np.errstate(invalid="ignore"):
        distance = np.linalg.norm(measured - np.asarray(limits.camera), axis=2)
        far = ((distance < limits.nearest) | (distance > limits.farthest)).any(axis=1)
    for k in range(count):
        here = seen[k]
        if here.sum() < LEAST_VISIBLE:
            refused[k] = "visible"
            continue
        resistance = _resistance(points[here])
        if _in_a_line(resistance):
            refused[k] = "line"
            continue
        turned, moved, left = _fit(measured[k, here], points[here])
        residual[k] = math.sqrt(np.mean(np.sum(left**2, axis=1)))
        if far[k]:
            refused[k] = "range"
        elif residual[k] > limits.residual:
            refused[k] = "residual"
        else:
            rotation[k], position[k] = turned, moved
            sensitivity[k] = turned @ np.linalg.inv(resistance) @ turned.T
    return Poses(model.name, rotation, position, residual, sensitivity, seen.sum(axis=1), refused, limits)


def slew(rotation: Array) -> Array:
    """Slew angle (n,) [rad], -55 .. 305 deg, of rotations (n, 3, 3) whose z axes are the slew axis; NaN stays NaN.

    It is the first of the angles z-y-x: a tilt of the model against the crane changes it by a constant only.
    """
    angle = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    return np.asarray(LOWEST_ANGLE + np.mod(angle - LOWEST_ANGLE, 2.0 * math.pi))


@dataclass(frozen=True)
class Stitched:
    """The slew angle of two marker models.

    Attributes:
        angle: (n,) [rad], NaN where no pose was found.
        first: (n,) True where the first model counts, that is below the switch.
        deviation: (n,) standard deviation [1/m] of the angle per standard deviation of a coordinate of a marker.
        poses: of the first and the second model.
    """

    angle: Array
    first: NDArray[np.bool_]
    deviation: Array
    poses: tuple[Poses, Poses]

    def summary(self) -> str:
        """How many samples have no angle, and what each model refused on its side of the switch."""
        sides = [
            replace(pose, refused=np.where(side, pose.refused, "")).summary()
            for pose, side in zip(self.poses, (self.first, ~self.first), strict=True)
        ]
        without = np.count_nonzero(np.isnan(self.angle))
        return f"{without} of {self.angle.size} samples have no angle; {'; '.join(sides)}"


def stitch(
    positions: Array,
    markers: tuple[str, ...],
    first: MarkerModel,
    second: MarkerModel,
    limits: Limits | None = None,
    switch: float = SWITCH,
) -> Stitched:
    """The slew angle by two marker models: `first` below `switch` [rad], `second` above it.

    On which side a sample lies is said by the second model, and by the first where the second has no pose. A sample without
    a pose of the model of its side has no angle: the other's would move the seam away from the switch.

    Args:
        positions: (n, markers, 3) measured [m], NaN where hidden, in a frame whose z axis is the slew axis.
        markers: their names, in that order.
        first: model of the angles below the switch.
        second: model of those above.
        limits: what a sample must keep to.
        switch: [rad].

    Raises:
        UsageError: shapes or names do not fit.
        DataError: no sample at all has an angle; the message says why.
    """
    both = tuple(poses(positions, markers, model, limits) for model in (first, second))
    angles = [slew(pose.rotation) for pose in both]
    side = np.where(np.isnan(angles[1]), angles[0], angles[1]) < switch
    angle = np.where(side, angles[0], angles[1])
    if np.isnan(angle).all():
        raise DataError(f"no sample has a slew angle; {both[0].summary()}; {both[1].summary()}")
    variance = np.where(side, both[0].sensitivity[:, 2, 2], both[1].sensitivity[:, 2, 2])
    return Stitched(angle, side, np.sqrt(variance), (both[0], both[1]))


def seam(first: MarkerModel, second: MarkerModel, survey: MarkerModel | None = None) -> float:
    """Step [rad] of the slew angle below the switch: what the first model shows more than the second, at any angle.

    Args:
        first: model below the switch.
        second: model above it.
        survey: true positions of the markers of both, in any frame whose z axis is the slew axis; without it the markers
            that both models hold are compared and the second's frame counts as upright, which says all where each model
            is rigid and only the first's frame is off.

    Raises:
        UsageError: fewer than four markers to compare.
    """
    shown = []
    for model in (first, second):
        reference = survey or second
        markers = tuple(marker for marker in model.markers if marker in reference.points)
        if len(markers) < LEAST_VISIBLE:
            raise UsageError(
                f"marker models '{model.name}' and '{reference.name}' have {len(markers)} markers in common: "
                f"{LEAST_VISIBLE} are needed to compare them. Give a survey of all markers"
            )
        shown.append(_fit(reference.array(markers), model.array(markers))[0])
    return float(np.mod(np.diff(slew(np.stack(shown[::-1])))[0] + math.pi, 2.0 * math.pi) - math.pi)


def lever(model: MarkerModel) -> float:
    """Length [m] by which the model turns noise of a marker's coordinate into noise of the slew angle, all visible."""
    return 1.0 / math.sqrt(np.linalg.inv(_resistance(model.array(model.markers)))[2, 2])


def _checked(positions: Array, markers: tuple[str, ...]) -> Array:
    measured = np.asarray(positions, dtype=np.float64)
    if measured.ndim != 3 or measured.shape[1:] != (len(markers), 3):
        raise UsageError(
            f"marker positions have the shape {measured.shape}: (samples, {len(markers)}, 3) fits the {len(markers)} names"
        )
    if len(set(markers)) != len(markers):
        raise UsageError(f"a marker is named twice: {', '.join(markers)}")
    return measured


def _fit(measured: Array, points: Array) -> tuple[Array, Array, Array]:
    """Rotation (3, 3), position (3,) [m] and what is left (m, 3) [m] of `points` (m, 3) laid on `measured` (m, 3)."""
    from scipy.spatial.transform import Rotation  # half a second that no log without markers needs

    middle, centre = measured.mean(axis=0), points.mean(axis=0)
    rotation = Rotation.align_vectors(measured - middle, points - centre)[0].as_matrix()
    return rotation, middle - rotation @ centre, measured - middle - (points - centre) @ rotation.T


def _resistance(points: Array) -> Array:
    """Sum of |p|^2 I - p p' [m2] (3, 3) about the points' centre: how firmly they hold a rotation about each axis."""
    arms = points - points.mean(axis=0)
    return np.asarray(np.sum(arms**2) * np.eye(3) - arms.T @ arms)


def _in_a_line(resistance: Array) -> bool:
    values = np.linalg.eigvalsh(resistance)
    return bool(values[0] <= IN_A_LINE**2 * values[2])
