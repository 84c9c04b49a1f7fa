"""The next experiment as a picture: what both explanations predict, and where they part."""

import numpy as np
import pytest
from report_helpers import hidden_material

from cosim.diagnosis.answer.schema import NextExperiment
from cosim.report.experiment import PIECE, picture, telling, telling_spans
from cosim.report.folder import keep, load
from cosim.report.material import Experiment, Material, Noise

H, N = 1e-3, 20_000
TIME = np.arange(N) * H
MODELS = ("mechanical.coulomb_friction", "continuity.cracking_pressure")


@pytest.fixture(scope="module")
def proposed() -> Material:
    """Material with an experiment whose explanations part between 8 and 10 s, in the slew alone."""
    material = hidden_material("mechanical.coulomb_friction")
    apart = 0.004 * np.sin(30.0 * TIME) * ((TIME >= 8.0) & (TIME < 10.0))
    slew = 0.3 * np.sin(TIME)
    pressure = 1e6 * np.cos(TIME)
    noise = {"slew": Noise(10, 500, True, 5e-4), "p_load": Noise(10, 500, True, 1e4)}
    material.experiment = Experiment(
        MODELS,
        H,
        np.sign(np.sin(TIME)),
        {"slew": np.stack([slew + apart, slew]), "p_load": np.stack([pressure, pressure])},
        noise,
        (apart / 5e-4) ** 2 / 10.0,
    )
    material.answer = material.answer.model_copy(
        update={
            "next_experiment": NextExperiment(
                why="tells them apart", excitation={"shape": "steps"}, predicted_gain=50.0
            )
        }
    )
    return material


def test_it_shows_both_predictions_of_the_telling_signal(proposed: Material) -> None:
    assert proposed.experiment is not None
    assert telling(proposed.experiment) == "slew"
    found = picture(proposed)
    assert found is not None
    names = [layer.name for panel in found.panels for layer in panel.layers]
    assert "dry friction" in names
    assert "cracking pressure of the counterbalance valve" in names
    one, other = (layer.y for layer in found.panels[1].layers)
    at = found.panels[1].layers[0].x
    far = (at > 8.0) & (at < 10.0)
    assert np.abs(one - other)[far].max() == pytest.approx(np.degrees(0.004), rel=0.1)
    assert np.abs(one - other)[~far].max() < 1e-9


def test_where_they_part_is_shaded(proposed: Material) -> None:
    found = picture(proposed)
    assert found is not None
    assert found.shaded
    assert all(8.0 <= a < b <= 10.0 for a, b in found.shaded)
    # evenly spread within the two seconds: half of it is half of them
    assert sum(b - a for a, b in found.shaded) == pytest.approx(1.0, abs=2 * PIECE)


def test_spans_hold_half_of_the_evidence() -> None:
    evidence = np.random.default_rng(3).exponential(size=N)
    spans = telling_spans(evidence, H)
    inside = np.zeros(N, dtype=bool)
    for a, b in spans:
        inside[round(a / H) : round(b / H)] = True
    assert evidence[inside].sum() >= 0.5 * evidence.sum()
    assert evidence[inside].mean() > evidence[~inside].mean()


def test_a_folder_gives_the_experiment_back(proposed: Material, tmp_path) -> None:
    keep(proposed, tmp_path)
    (tmp_path / "diagnosis.json").write_text(proposed.answer.model_dump_json(), encoding="utf-8")
    again = load(tmp_path).experiment
    assert again is not None
    assert proposed.experiment is not None
    assert again.models == MODELS
    assert again.predicted["slew"] == pytest.approx(proposed.experiment.predicted["slew"])
    assert again.noise == proposed.experiment.noise
    assert again.evidence == pytest.approx(proposed.experiment.evidence)


def test_an_earlier_experiment_does_not_stay(proposed: Material, tmp_path) -> None:
    keep(proposed, tmp_path)
    keep(hidden_material("mechanical.coulomb_friction"), tmp_path)
    assert not (tmp_path / "next_experiment.parquet").exists()
