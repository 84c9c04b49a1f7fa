"""The proposed experiment, played on the virtual rig, resolves the ambiguity it was proposed for."""

from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.experiment import menu, proposal_for, write_command
from cosim.diagnosis.groups import MODELS
from cosim.diagnosis.story import diagnose
from cosim.rig import as_log, make_log

HIDDEN = ["mechanical.coulomb_friction:tau_c=60 N.m"]


def test_menu_stays_within_the_rigs_limits() -> None:
    for description, command in menu(10.0, 1e-3):
        assert np.abs(command).max() <= 1.0 + 1e-12, description
        assert command.size == 10001


@pytest.mark.slow
def test_proposal_resolves_the_ambiguity(tmp_path: Path) -> None:
    # large steps alone cannot tell dry friction from the cracking pressure of the counterbalance valve
    log = as_log(make_log("steps", 20.0, HIDDEN, seed=4, amplitude=0.8))
    first = diagnose(log)
    assert [c.effect.name for c in first.causes] == ["mechanical.coulomb_friction"]
    assert "continuity.cracking_pressure" in first.causes[0].alike
    proposal = proposal_for(MODELS["full_order"], first.findings, first.causes, first.start, first.values)
    assert proposal is not None
    assert proposal.predicted_gain > 20.0
    written = write_command(proposal, tmp_path)
    assert written.file is not None
    run = make_log("file", 30.0, HIDDEN, seed=5, command_file=written.file)
    second = diagnose(as_log(run))
    assert [c.effect.name for c in second.causes] == ["mechanical.coulomb_friction"]
    assert "continuity.cracking_pressure" not in second.causes[0].alike
    realised = {e.name: behind for e, behind in second.causes[0].rivals}["continuity.cracking_pressure"]
    # the prediction is to first order in the rival's parameters, and the noise is another
    assert 0.3 < realised / proposal.predicted_gain < 3.0
