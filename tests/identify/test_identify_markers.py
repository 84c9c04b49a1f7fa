"""``cosim identify markers``: the tracker's record and the seam from files of positions and models."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.cli import make_app
from cosim.errors import DataError
from cosim.identify.markers import markers_answer
from cosim.logs import load_tracker
from cosim.logs.markers import read_models, read_positions
from cosim.markers import Limits
from cosim.rig import make_log, write, write_markers

DEG = np.pi / 180.0


@pytest.fixture(scope="module")
def run():
    """Twenty seconds of the rig with models that do not agree."""
    return make_log("steps", 20.0, settings={"tracker.misfit": 3e-3}, markers=True, seed=2)


@pytest.fixture(scope="module")
def files(run, tmp_path_factory):
    """The record of positions, and the models in mm."""
    folder = tmp_path_factory.mktemp("markers")
    write_markers(run, folder / "markers.csv")
    lines = ['unit = "mm"']
    for model in run.markers.models:
        lines.append(f'[models."{model.name}"]')
        lines += [f"{marker} = {[float(v) * 1e3 for v in point]}" for marker, point in model.points.items()]
    (folder / "models.toml").write_text("\n".join(lines))
    return folder / "markers.csv", folder / "models.toml"


def test_files_give_what_was_written(run, files):
    time, names, positions, synthetic = read_positions(files[0])
    assert synthetic
    assert names == run.markers.markers
    assert np.allclose(time, run.markers.stamps, atol=1e-6)
    assert np.allclose(positions, run.markers.positions, atol=1e-9, equal_nan=True)
    for read, model in zip(read_models(files[1]), run.markers.models, strict=True):
        assert read.markers == model.markers
        assert np.allclose(read.array(read.markers), model.array(model.markers), atol=1e-12)


def test_the_command_gives_the_rigs_own_record_and_seam(run, files, tmp_path):
    arguments = ["identify", "markers", files[0], "--models", files[1], "--out", tmp_path, "--json"]
    result = CliRunner().invoke(make_app(), [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    found, truth = json.loads(result.stdout), run.truth["markers"]
    assert found["synthetic"] is True
    assert found["seam_of_the_models"]["value"] == pytest.approx(truth["seam"]["value"] / DEG, abs=1e-9)
    step = found["seam_in_the_record"]
    assert abs(step["value"]) > 20 * step["standard_deviation"]
    assert step["value"] == pytest.approx(
        found["seam_of_the_models"]["value"], abs=4 * step["standard_deviation"]
    )
    # some 40 000 free coordinates: 0.4 %
    deviation = truth["standard_deviation"]["value"] * 1e3
    assert found["noise_of_a_coordinate"]["value"] == pytest.approx(deviation, rel=0.02)
    assert found["refused"] == truth["refused"]
    record = load_tracker(tmp_path / "tracker.csv")
    there = np.isfinite(run.tracker[1])
    assert record.synthetic
    assert np.array_equal(record.valid, there)
    # six decimals of a degree, and positions rounded to a nanometre
    assert np.allclose(record.slew_external[there], run.tracker[1][there], atol=0.6e-6 * DEG)


def test_models_without_common_markers_still_give_the_step_of_the_record(run, files, tmp_path):
    first, second = run.markers.models
    plain = {
        "unit": "m",
        "models": {
            "low": {m: list(map(float, first.points[m])) for m in ("A1", "A2", "A3", "S1")},
            "high": {m: list(map(float, second.points[m])) for m in ("B1", "B2", "S2", "S3")},
        },
    }
    (tmp_path / "models.json").write_text(json.dumps(plain))
    answer = markers_answer(files[0], tmp_path / "models.json", Limits(residual=5e-3))
    assert answer.data["seam_of_the_models"] is None
    assert "have 0 markers in common" in answer.notes[0]
    step = answer.data["seam_in_the_record"]
    seam = run.truth["markers"]["seam"]["value"] / DEG
    assert step["value"] == pytest.approx(seam, abs=4 * step["standard_deviation"])


def test_a_range_that_the_tracker_does_not_reach_is_said(files):
    with pytest.raises(DataError, match=r"with a marker outside 50 .. inf m of the tracker"):
        markers_answer(*files, Limits(nearest=50.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time [s],u [1]\n0,0\n1,0\n", "'NAME_x"),
        ("time [s],A_x,A_y,A_z\n0,1,2,3\n1,1,2,3\n", "'A_x' has no unit"),
        ("time [s],A_x [bar],A_y [m],A_z [m]\n0,1,2,3\n1,1,2,3\n", r"'A_x \[bar\]'"),
        ("time [s],A_x [m],A_y [m],A_z [m]\n0,1,2,3\n0,1,2,3\n", "row 3: the time does not rise"),
    ],
)
def test_a_bad_record_is_refused(tmp_path, text, message):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(DataError, match=message):
        read_positions(tmp_path / "bad.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("unit = ", "cannot be read"),
        ('unit = "mm"\n[models.a]\nS1 = [1, 2, 3]\n', "two tables such as"),
        ("markers = [1, 2]\n", "two tables such as"),
        ('unit = "bar"\n[models.a]\nS1 = [1, 2, 3]\n[models.b]\nS1 = [1, 2, 3]\n', "bad.toml.*bar"),
        ('unit = "mm"\n[models.a]\nS1 = ["x", 2, 3]\n[models.b]\nS1 = [1, 2, 3]\n', "a marker of 'a'"),
    ],
)
def test_bad_models_are_refused(tmp_path, text, message):
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(DataError, match=message):
        read_models(tmp_path / "bad.toml")


def test_a_record_of_markers_is_a_tracker_s_record_wherever_one_is_read(run, files, tmp_path):
    """`--external markers.csv`: poses by the models that lie beside it; the same angle as the rig's own."""
    made, (stamps, angle) = load_tracker(files[0]), run.tracker
    assert made.synthetic
    assert np.allclose(made.time, stamps, atol=1e-6)
    assert np.array_equal(made.valid, np.isfinite(angle))
    assert np.allclose(made.slew_external[made.valid], angle[made.valid], atol=1e-8)
    assert "poses of 10 markers (markers.models.toml)" in made.warnings[0]
    told = CliRunner().invoke(make_app(), ["info", str(files[0]), "--json"])
    assert json.loads(told.stdout)["kind"] == "tracker"


def test_markers_without_their_models_say_what_is_missing(files, tmp_path):
    alone = tmp_path / "here.csv"
    alone.write_bytes(files[0].read_bytes())
    with pytest.raises(DataError, match=r"put the two marker models beside it as here\.models\.toml"):
        load_tracker(alone)
    (tmp_path / "models.toml").write_bytes(files[1].read_bytes())  # of all records in the folder
    assert len(load_tracker(alone)) == len(load_tracker(files[0]))


def test_the_seam_of_the_models_is_found_from_their_markers(run, files, undrawn, tmp_path):
    log = tmp_path / "log.csv"
    write(run, log)
    arguments = ["compare", log, "--external", files[0], "--out", tmp_path / "out", "--json"]
    result = CliRunner().invoke(make_app(), [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    rows = {p["name"]: p for p in json.loads(result.stdout)["tracker"]["parameters"]}
    low, high = rows["tracker.seam"]["ci95"]
    wide = 0.5 * (high - low)
    assert low - wide < run.truth["markers"]["seam"]["value"] < high + wide
