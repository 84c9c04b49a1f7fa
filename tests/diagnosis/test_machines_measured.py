"""Real machines through their mappings alone; measured data where it is at hand."""

import os
from pathlib import Path

import pytest

from cosim.diagnosis.answer import answer
from cosim.diagnosis.lexicon import speaking
from cosim.diagnosis.model import machine_of
from cosim.diagnosis.schema import Answer
from cosim.diagnosis.story import diagnose
from cosim.logs import load_log
from cosim.paths import examples_folder

MEASURED = Path(os.environ.get("COSIM_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
pytestmark = [
    pytest.mark.data,
    pytest.mark.slow,
    pytest.mark.skipif(not MEASURED.is_dir(), reason="no measured data: set COSIM_DATA to their folder"),
]


def found(folder: Path, mapping: str, log: str, other: str | None = None) -> Answer:
    """The answer of ``cosim diagnose LOG --mapping MAPPING --calibrate [--held-out OTHER]``."""
    path = examples_folder() / "mappings" / f"{mapping}.toml"
    loaded = load_log(MEASURED / log, path)
    held = load_log(MEASURED / other, path) if other else None
    machine = machine_of(None, loaded, path)
    made = diagnose(loaded, model=machine, held_out=held, calibrate=True, folder=folder)
    with speaking(machine.lexicon):
        return answer(made, loaded, None)


def test_the_crane_actuators_load_rings(tmp_path: Path) -> None:
    result = found(tmp_path, "actuator_forest_crane", "actuator_forest_crane/actuator.mat")
    assert "continuity.travel_flow" in [c.effect for c in result.causes]
    # linear models reach 1.01 in a free run over samples 513 to 1024, a four-branch Hammerstein model 0.61
    assert result.gain["pressure"].rmse_after < 0.61
    assert any("counts samples" in note for note in result.warnings)
