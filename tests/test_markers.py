"""Marker positions to a pose and to the slew angle of two models: answers known beforehand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cosim.errors import DataError, UsageError
from cosim.markers import Limits, MarkerModel, lever, poses, seam, slew, stitch

DEG = np.pi / 180.0
POINTS = {
    "a": (0.9, 0.2, 1.2),
    "b": (0.9, -0.3, 1.5),
    "c": (1.5, 0.2, 1.4),
    "d": (1.6, -0.2, 1.1),
    "e": (0.5, 0.4, 1.3),
    "f": (1.1, 0.5, 1.6),
}
MODEL = MarkerModel("column", POINTS)
NAMES = MODEL.markers
BODY = MODEL.array(NAMES)


def placed(rotation, position, body=BODY):
    """The markers (n, markers, 3) of a body at each pose."""
    return np.einsum("nij,mj->nmi", rotation.as_matrix(), body) + np.asarray(position)[:, None, :]


def turned(angle, body=BODY):
    """The markers (n, markers, 3) of a body slewed by each angle [rad]."""
    return placed(
        Rotation.from_rotvec(np.outer(angle, [0, 0, 1.0])), np.zeros((len(angle), 3)), np.asarray(body)
    )


def test_exact_positions_give_the_exact_pose():
    rng = np.random.default_rng(1)
    rotation, position = Rotation.random(20, random_state=2), rng.normal(size=(20, 3))
    found = poses(placed(rotation, position), NAMES, MODEL)
    assert np.allclose(found.rotation, rotation.as_matrix(), atol=1e-12)
    assert np.allclose(found.position, position, atol=1e-12)
    assert found.residual.max() < 1e-12
    assert found.counts == {}
    assert found.summary() == "marker model 'column': 0 of 20 samples refused"


def test_markers_go_by_name_and_strangers_are_not_used():
    angle = np.array([0.3])
    order = [3, 0, 5, 1, 4, 2]
    strange = np.concatenate([np.full((1, 1, 3), 9.0), turned(angle)[:, order]], axis=1)
    found = poses(strange, ("x", *(NAMES[k] for k in order)), MODEL)
    assert slew(found.rotation) == pytest.approx(angle, abs=1e-12)


def test_noise_spreads_the_pose_as_its_covariance_says():
    count, noise = 4000, 1e-4
    rng = np.random.default_rng(3)
    rotation = Rotation.from_rotvec(np.tile([0.1, -0.2, 0.7], (count, 1)))
    seen = placed(rotation, np.zeros((count, 3))) + noise * rng.standard_normal((count, 6, 3))
    seen[:, 2] = np.nan  # a hidden marker belongs to the covariance
    found = poses(seen, NAMES, MODEL)
    error = (Rotation.from_matrix(found.rotation) * rotation.inv()).as_rotvec()
    stated = noise**2 * found.sensitivity[0]
    whitened = np.linalg.solve(np.linalg.cholesky(stated), error.T)
    # each entry of the covariance of 4000 white samples has a deviation of 0.016 or 0.022: four and more of these
    assert np.allclose(np.cov(whitened), np.eye(3), atol=0.09)
    # 15 coordinates less the 6 of the pose are left, of five markers
    assert np.sqrt(np.mean(found.residual**2)) == pytest.approx(noise * np.sqrt(9 / 5), rel=0.02)


def test_noise_of_the_angle_is_noise_over_the_lever():
    count, noise = 4000, 1e-4
    seen = turned(np.full(count, 1.0)) + noise * np.random.default_rng(4).standard_normal((count, 6, 3))
    found = stitch(seen, NAMES, MODEL, MODEL)
    assert np.std(found.angle) == pytest.approx(noise / lever(MODEL), rel=0.05)
    assert np.allclose(found.deviation, 1.0 / lever(MODEL), rtol=1e-3)


def test_hidden_markers_do_not_move_the_pose_and_three_are_refused():
    angle = np.full(4, 0.5)
    seen = turned(angle)
    seen[1, :2] = np.nan  # four left
    seen[2, :3] = np.nan  # three left
    seen[3, 1, 2] = np.nan  # half a marker is none
    found = poses(seen, NAMES, MODEL)
    assert found.visible.tolist() == [6, 4, 3, 5]
    assert found.counts == {"visible": 1}
    assert list(found.refused) == ["", "", "visible", ""]
    assert "1 with fewer than 4 visible markers" in found.summary()
    assert np.isnan(found.rotation[2]).all()
    assert slew(found.rotation)[[0, 1, 3]] == pytest.approx(0.5, abs=1e-12)


def test_a_swapped_marker_is_refused_by_its_residual():
    seen = turned(np.full(3, 0.5))
    seen[1, [0, 1]] = seen[1, [1, 0]]
    found = poses(seen, NAMES, MODEL)
    assert list(found.refused) == ["", "residual", ""]
    assert found.residual[1] > 0.05
    assert "1 with a residual above 1 mm" in found.summary()
    assert poses(seen, NAMES, MODEL, Limits(residual=1.0)).counts == {}


@pytest.mark.parametrize("limits", [Limits(nearest=4.0), Limits(farthest=3.0)])
def test_a_marker_out_of_range_refuses_the_sample(limits):
    seen = turned(np.array([0.0, np.pi]))
    camera = (5.0, 0.0, 1.3)  # markers at 3.4 to 4.5 m, then at 5.5 to 6.6 m
    found = poses(seen, NAMES, MODEL, Limits(nearest=limits.nearest, farthest=limits.farthest, camera=camera))
    expected = ["range", ""] if limits.nearest else ["range", "range"]
    assert list(found.refused) == expected
    assert f"{expected.count('range')} with a marker outside" in found.summary()


def test_visible_markers_in_a_line_are_refused():
    line = {f"l{k}": (float(k), 0.0, 1.0) for k in range(4)}
    model = MarkerModel("boom", {**line, "aside": (0.0, 0.5, 1.0)})
    seen = turned(np.array([0.2, 0.2]), model.array(model.markers))
    seen[1, 4] = np.nan
    assert list(poses(seen, model.markers, model).refused) == ["", "line"]
    with pytest.raises(UsageError, match="'beam': its markers lie in a line"):
        MarkerModel("beam", line)


def test_the_slew_angle_covers_the_sensors_range_and_ignores_a_tilted_model():
    angle = np.array([-20.0, 0.0, 11.0, 179.0, 181.0, 270.0]) * DEG
    assert slew(poses(turned(angle), NAMES, MODEL).rotation) == pytest.approx(angle, abs=1e-12)
    tilt = Rotation.from_euler("ZYX", [0.0, 0.2, -0.1])
    leaning = MarkerModel("leaning", dict(zip(NAMES, tilt.inv().apply(BODY), strict=True)))
    assert slew(poses(turned(angle), NAMES, leaning).rotation) == pytest.approx(angle, abs=1e-12)


def displaced(turn, names=NAMES):
    """The model of the markers `names` in a frame turned by `turn` [rad] about a tilted axis and moved."""
    rotation = Rotation.from_rotvec(turn * np.array([0.1, -0.2, 1.0]))
    points = rotation.apply(MODEL.array(names)) + np.array([2e-3, -1e-3, 5e-4])
    return MarkerModel("displaced", dict(zip(names, points, strict=True)))


def test_the_seam_of_two_rigid_models_is_the_step_of_the_record_at_any_angle():
    angle = np.linspace(-5.0, 30.0, 70) * DEG  # none at 12 deg itself
    first = displaced(-5e-3, NAMES[:5])
    second = MarkerModel("true", POINTS)
    found = stitch(turned(angle), NAMES, first, second)
    step = found.angle - angle
    assert np.array_equal(found.first, angle < 12 * DEG)
    assert seam(first, second) == pytest.approx(5e-3, rel=0.01)
    assert step[found.first] == pytest.approx(seam(first, second), abs=1e-12)
    assert step[~found.first] == pytest.approx(0.0, abs=1e-12)
    # exchanged, with the same frame counting as the crane's
    assert seam(second, first, second) == pytest.approx(-seam(first, second), abs=1e-12)


def test_errors_of_single_markers_make_the_seam_that_a_survey_predicts():
    rng = np.random.default_rng(5)
    wrong = {name: np.add(point, 2e-3 * rng.standard_normal(3)) for name, point in POINTS.items()}
    first = MarkerModel("first", {name: wrong[name] for name in "abcd"})
    second = MarkerModel("second", {name: POINTS[name] for name in "cdef"})
    with pytest.raises(UsageError, match="have 2 markers in common"):
        seam(first, second)
    predicted = seam(first, second, MODEL)
    angle = np.array([5.0, 20.0]) * DEG
    found = stitch(turned(angle), NAMES, first, second, Limits(residual=5e-3))
    assert abs(predicted) > 2e-4
    assert found.angle - angle == pytest.approx([predicted, 0.0], abs=1e-12)


def test_a_sample_without_the_model_of_its_side_has_no_angle():
    angle = np.array([5.0, 6.0, 20.0]) * DEG
    first = MarkerModel("low", {name: POINTS[name] for name in "abce"})
    second = MarkerModel("high", {name: POINTS[name] for name in "abdf"})
    seen = turned(angle)
    seen[1, NAMES.index("c")] = np.nan
    found = stitch(seen, NAMES, first, second)
    assert np.isnan(found.angle).tolist() == [False, True, False]
    assert found.summary() == (
        "1 of 3 samples have no angle; marker model 'low': 1 of 3 samples refused: 1 with fewer than 4 visible markers; "
        "marker model 'high': 0 of 3 samples refused"
    )
    with pytest.raises(DataError, match="no sample has a slew angle; marker model 'low': 3 of 3"):
        stitch(seen * np.nan, NAMES, first, second)


@pytest.mark.parametrize(
    ("positions", "names", "message"),
    [
        (np.zeros((2, 6)), NAMES, r"shape \(2, 6\)"),
        (np.zeros((2, 6, 3)), (*NAMES[:5], "a"), "named twice"),
        (np.zeros((2, 3, 3)), NAMES[:3], "3 markers in common with the record"),
    ],
)
def test_what_does_not_fit_is_refused(positions, names, message):
    with pytest.raises(UsageError, match=message):
        poses(positions, names, MODEL)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ({"a": (0, 0, 0), "b": (1, 0, 0), "c": (0, 1, 0)}, "has 3 markers"),
        ({**POINTS, "a": (0, 0)}, "'a' must be three"),
        ({**POINTS, "a": (0, 0, np.nan)}, "'a' must be three"),
    ],
)
def test_a_model_is_checked(points, message):
    with pytest.raises(UsageError, match=message):
        MarkerModel("m", points)
