"""The rig's tracker with markers: the record follows from their positions and the two models."""

import json

import numpy as np
import pandas as pd
import pytest
from rig_helpers import clean, lively
from typer.testing import CliRunner

from cosim.cli import make_app
from cosim.diagnosis.tracker.model import SEAM
from cosim.errors import UsageError
from cosim.logs import load_tracker
from cosim.markers import seam
from cosim.rig import make_log
from cosim.rig.parameters import DEG

U = lively()
TIME = np.arange(U.size) * 1e-3
START = 12 * DEG


def straight(run):
    """The true angle at the tracker's stamps."""
    return np.interp(run.tracker[0], TIME, run.true["seen"])


def test_without_noise_and_misfit_the_angle_is_the_true_one():
    run = clean(U, markers=True, start=START)
    assert np.nanmax(np.abs(run.tracker[1] - straight(run))) < 1e-12
    assert run.truth["markers"]["seam"]["value"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("hidden", [[], ["tracker.seam:seam=0.3 deg"]])
def test_the_seam_of_the_models_is_the_step_of_the_record(hidden):
    run = clean(U, *hidden, settings={"tracker.misfit": 2e-3}, markers=True, start=START)
    step = run.tracker[1] - straight(run)
    predicted = seam(*run.markers.models)
    below = straight(run) < 12 * DEG
    there = np.isfinite(step)
    assert 20 < (below & there).sum() < there.sum() - 20
    assert abs(predicted) > 0.01 * DEG
    assert step[below & there] == pytest.approx(predicted, abs=1e-12)
    assert step[~below & there] == pytest.approx(0.0, abs=1e-12)
    assert run.truth["markers"]["seam"]["value"] == predicted


def test_the_hidden_seam_is_made_of_the_models():
    run = clean(U, "tracker.seam:seam=0.3 deg", markers=True, start=START)
    assert seam(*run.markers.models) == pytest.approx(0.3 * DEG, abs=1e-12)


def test_noise_of_the_angle_is_that_of_the_tracker():
    run = make_log(U, markers=True, start=30 * DEG, seed=4)
    error = run.tracker[1] - straight(run)
    # some markers are hidden, which costs a few per cent
    assert np.nanstd(error) == pytest.approx(0.01 * DEG, rel=0.15)


def test_markers_leave_the_rest_of_the_log_as_it_was():
    plain, marked = (make_log(U, tracker=True, markers=m, seed=4) for m in (False, True))
    assert all(np.array_equal(plain.signals[name], marked.signals[name]) for name in plain.signals)
    assert np.array_equal(plain.tracker[0], marked.tracker[0])
    assert "markers" not in plain.truth


def test_a_misfit_without_markers_is_refused():
    with pytest.raises(UsageError, match="--markers FILE"):
        make_log(U, settings={"tracker.misfit": 1e-3}, tracker=True)


def test_the_files_hold_what_the_run_holds(tmp_path):
    log, tracker, markers = (tmp_path / f"{name}.csv" for name in ("log", "tracker", "markers"))
    arguments = ["rig", "--out", log, "--excitation", "steps", "--duration", "20 s", "--tracker", tracker]
    arguments += ["--markers", markers, "--set", "tracker.misfit=2 mm", "--json"]
    result = CliRunner().invoke(make_app(), [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["markers_path"] == str(markers)
    run = make_log("steps", 20.0, settings={"tracker.misfit": 2e-3}, markers=True)
    table = pd.read_csv(markers)
    assert list(table.columns[:4]) == ["time [s]", "S1_x [mm]", "S1_y [mm]", "S1_z [mm]"]
    assert (table["synthetic [1]"] == 1).all()
    assert np.allclose(table.to_numpy()[:, 1:-1] * 1e-3, run.markers.positions.reshape(len(table), -1),
                       atol=1e-9, equal_nan=True)  # fmt: skip
    record = load_tracker(tracker)
    there = np.isfinite(run.tracker[1])
    assert np.array_equal(record.valid, there)
    assert np.allclose(record.slew_external[there], run.tracker[1][there], atol=0.51e-6 * DEG)


def test_a_comparison_with_the_log_finds_the_seam_of_the_models(tmp_path):
    from cosim.beside.tracker import run_tracker
    from cosim.rig import as_log, write_tracker

    run = make_log("steps", 20.0, settings={"tracker.misfit": 3e-3}, markers=True, seed=2)
    write_tracker(run, tmp_path / "tracker.csv")
    fit = run_tracker(as_log(run), tmp_path / "tracker.csv").finding.fit
    predicted = seam(*run.markers.models)
    assert abs(predicted) > 20 * fit.deviations[SEAM]
    assert fit.values[SEAM] == pytest.approx(predicted, abs=4 * fit.deviations[SEAM])
