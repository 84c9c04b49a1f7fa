"""The proposed experiment, played on the virtual rig, resolves the ambiguity it was proposed for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.answer.experiment import Rehearsal, evidence_of, menu, proposal_for, write_command
from cosim.diagnosis.fitting.noise import CORRELATION_TIMES, Whitener
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.report.deliver import delivered
from cosim.rig import as_log, make_log

HIDDEN = ["mechanical.coulomb_friction:tau_c=60 N.m"]


def test_menu_stays_within_the_rigs_limits() -> None:
    for description, command in menu(10.0, 1e-3):
        assert np.abs(command).max() <= 1.0 + 1e-12, description
        assert command.size == 10001


def test_an_experiment_is_read_as_often_as_the_log_was_sampled() -> None:
    _, command = menu(10.0, 1e-3)[3]
    each, tenth = (Rehearsal(MODELS["full_order"], command, {}, 1e-3, interval) for interval in (1e-3, 1e-2))
    friction = {"mechanical.tau_c": 60.0}
    for signal, values in each.read(friction).items():
        assert tenth.read(friction)[signal] == pytest.approx(values[::10], rel=1e-9)
    rule = Whitener(1, 300, True, (1e-8,) + (0.0,) * len(CORRELATION_TIMES))
    slew = np.stack([tenth.read(values)["slew"] for values in ({}, friction)])
    evidence = evidence_of({"slew": slew}, {"slew": rule})
    spread = tenth.spread(evidence)
    assert spread.size == command.size
    assert np.sum(spread) == pytest.approx(np.sum(evidence))
    # each reading's share lies in the steps since the one before
    assert spread[5001:6001].sum() == pytest.approx(evidence[501:601].sum(), rel=1e-6)


@pytest.mark.slow
def test_a_log_slower_than_the_command_gets_an_experiment_too(tmp_path: Path) -> None:
    log = as_log(make_log("steps", 12.0, HIDDEN, seed=4, amplitude=0.8))
    slow = replace(log, time=log.time[::10], signals={n: v[::10] for n, v in log.signals.items()})
    found = diagnose(slow)
    (cause,) = found.causes
    assert {"mechanical.coulomb_friction", "continuity.cracking_pressure"} <= {
        cause.effect.name,
        *cause.indistinguishable,
    }
    answer = delivered(found, slow, tmp_path)
    assert answer.next_experiment is not None
    assert answer.next_experiment.predicted_gain > 10.0
    command = np.loadtxt(tmp_path / "next_experiment.csv", delimiter=",", skiprows=1)
    assert command[1, 0] == pytest.approx(1e-3)


@pytest.mark.slow
def test_proposal_resolves_the_ambiguity(tmp_path: Path) -> None:
    # large steps alone cannot tell dry friction from the cracking pressure of the counterbalance valve
    log = as_log(make_log("steps", 20.0, HIDDEN, seed=4, amplitude=0.8))
    first = diagnose(log)
    assert [c.effect.name for c in first.causes] == ["mechanical.coulomb_friction"]
    assert "continuity.cracking_pressure" in first.causes[0].indistinguishable
    proposal = proposal_for(MODELS["full_order"], first.findings, first.causes, first.start, first.values)
    assert proposal is not None
    assert proposal.predicted_gain > 20.0
    written = write_command(proposal, tmp_path)
    assert written.file is not None
    run = make_log("file", 30.0, HIDDEN, seed=5, command_file=written.file)
    second = diagnose(as_log(run))
    assert [c.effect.name for c in second.causes] == ["mechanical.coulomb_friction"]
    assert "continuity.cracking_pressure" not in second.causes[0].indistinguishable
    realised = {e.name: behind for e, behind in second.causes[0].rivals}["continuity.cracking_pressure"]
    # the prediction is to first order in the rival's parameters, and the noise is another
    assert 0.3 < realised / proposal.predicted_gain < 3.0
