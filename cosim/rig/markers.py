"""The optical tracker as it measures: markers on the column, two models of them, and the angle from their poses (3.5.4)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.markers import Limits, MarkerModel, Stitched, lever, seam, stitch
from cosim.rig.noise import Noise, stream
from cosim.rig.parameters import DEG, Plant
from cosim.rig.sensing import SEAM_ANGLE, TRACKER_STEP, passed

Array = NDArray[np.float64]

HIDDEN = 0.05  # probability that a marker in sight is hidden in a sample
RESIDUAL = 1e-3  # m, largest residual of a pose that counts, or five times the noise where that is more
# x (along the boom at slew angle 0), y, z (the slew axis) [m]; what the source used is not known
SHARED = {"S1": (0.9, 0.25, 1.2), "S2": (0.9, -0.3, 1.5), "S3": (1.5, 0.2, 1.4), "S4": (1.6, -0.2, 1.1)}
LOW = {"A1": (0.5, 0.45, 1.3), "A2": (1.1, 0.5, 1.6), "A3": (1.9, 0.35, 1.2)}
HIGH = {"B1": (0.5, -0.45, 1.4), "B2": (1.1, -0.5, 1.1), "B3": (1.9, -0.3, 1.5)}
LOW_UP_TO, HIGH_FROM = 20.0 * DEG, 4.0 * DEG  # where the markers of one model only turn out of sight


@dataclass(frozen=True)
class MarkerRecord:
    """What the tracker saw of the markers.

    Attributes:
        stamps: (m,) on the tracker's own clock [s].
        markers: their names.
        positions: (m, markers, 3) [m] in the crane's frame, NaN where hidden.
        models: below 12 deg, and above.
        deviation: standard deviation [m] of each coordinate.
        stitched: the angle that follows.
    """

    stamps: Array
    markers: tuple[str, ...]
    positions: Array = field(repr=False)
    models: tuple[MarkerModel, MarkerModel]
    deviation: float
    stitched: Stitched = field(repr=False)

    def truth(self) -> dict[str, object]:
        """Models, noise and the seam that follows from the models, as plain data."""
        return {
            "models": {
                model.name: {marker: np.asarray(p).tolist() for marker, p in model.points.items()}
                for model in self.models
            },
            "unit": "m",
            "standard_deviation": {"value": self.deviation, "unit": "m"},
            "seam": {"value": seam(*self.models), "unit": "rad"},
            "refused": {pose.model: pose.counts for pose in self.stitched.poses},
        }


def marker_models(plant: Plant, seed: int) -> tuple[MarkerModel, MarkerModel]:
    """The models below and above 12 deg. The second is true; the frame of the first is off.

    It was laid on the second by the shared markers, each measured with an error of `tracker.misfit` [m];
    `tracker.seam` [rad] turns it further.
    """
    from scipy.spatial.transform import Rotation

    q = plant.tracker
    true, shared = np.array([*SHARED.values(), *LOW.values()]), np.array([*SHARED.values()])
    wrong = shared + q.misfit * stream(seed, "marker models").standard_normal(shared.shape)
    laid = Rotation.align_vectors(wrong - wrong.mean(axis=0), shared - shared.mean(axis=0))[0]
    points = laid.apply(true - shared.mean(axis=0)) + wrong.mean(axis=0)
    points = Rotation.from_euler("z", -q.seam).apply(points)
    first = MarkerModel("model 1", dict(zip([*SHARED, *LOW], points, strict=True)))
    return first, MarkerModel("model 2", SHARED | HIGH)


def watch(seen: Array, plant: Plant, noise: Noise, seed: int) -> MarkerRecord:
    """What the tracker sees of the markers while the angle behind the backlash is `seen` (n,) [rad], a value a millisecond.

    Noise is equal on all coordinates, of such a size that the angle by all markers of model 2 has that of `slew_external`.

    Raises:
        DataError: no sample shows enough markers.
    """
    from scipy.spatial.transform import Rotation

    stamps, angle = passed(seen, plant)
    models = marker_models(plant, seed)
    table = SHARED | LOW | HIGH
    markers = tuple(table)
    turn = Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0]))
    positions = np.stack([turn.apply(np.asarray(point)) for point in table.values()], axis=1)
    deviation = noise.size("slew_external") * lever(models[1])
    for index, marker in enumerate(markers):
        for axis in range(3):
            unit = noise.unit(f"noise {marker} {'xyz'[axis]}", stamps.size, seed, TRACKER_STEP)
            positions[:, index, axis] += deviation * unit
    hidden = stream(seed, "hidden markers").random(positions.shape[:2]) < HIDDEN
    for index, marker in enumerate(markers):
        if marker in LOW:
            hidden[:, index] |= angle > LOW_UP_TO
        elif marker in HIGH:
            hidden[:, index] |= angle < HIGH_FROM
    positions[hidden] = np.nan
    limits = Limits(residual=max(RESIDUAL, 5.0 * deviation))
    stitched = stitch(positions, markers, *models, limits, SEAM_ANGLE)
    return MarkerRecord(stamps, markers, positions, models, deviation, stitched)
