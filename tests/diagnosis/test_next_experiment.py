"""The proposed experiment, played on the virtual rig, resolves the ambiguity it was proposed for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.answer.experiment import (
    Proposal,
    Rehearsal,
    evidence_of,
    menu,
    proposal_for,
    reached,
    within,
    write_command,
)
from cosim.diagnosis.fitting.noise import CORRELATION_TIMES, Whitener
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.lexicon import Lexicon, Shown, speaking
from cosim.report.deliver import delivered
from cosim.rig import as_log, make_log

HIDDEN = ["mechanical.coulomb_friction:tau_c=60 N.m"]


def test_menu_stays_within_the_rigs_limits() -> None:
    for description, command in menu(10.0, 1e-3):
        assert np.abs(command).max() <= 1.0 + 1e-12, description
        assert command.size == 10001


@pytest.mark.parametrize(
    ("log", "reach"),
    [
        ([0.05, 0.06], (0.0, 0.06)),  # a motor of one direction: its friction shows where it stops
        ([-0.2, -0.1], (-0.2, 0.0)),
        ([-0.8, 0.6], (-0.6, 0.6)),
        ([-0.01, 0.6], (-0.01, 0.6)),
    ],
)
def test_another_machine_is_driven_no_further_than_its_log_shows(
    log: list[float], reach: tuple[float, float]
) -> None:
    """A motor of 0.39 N m that the log drove with 0.06 was to be driven with "amplitude 1"."""
    assert reached(np.array(log)) == reach
    for item in menu(10.0, 1e-3):
        said, command = within(reach, *item, "torque")
        assert reach[0] - 1e-12 <= command.min() <= command.max() <= reach[1] + 1e-12
        half, middle = 0.5 * (reach[1] - reach[0]), 0.5 * (reach[0] + reach[1])
        assert said["amplitude"] == pytest.approx(half * float(item[0]["amplitude"]), rel=1e-3)
        assert said.get("middle", 0.0) == pytest.approx(middle, rel=1e-3)


def test_the_file_of_a_command_has_its_name_and_unit(tmp_path: Path) -> None:
    command = np.array([0.0, 0.06, 0.001234567])
    words = Lexicon({"torque": Shown("N.m", 1.0, "torque"), "u": Shown("1", 1.0, "command")}, {}, {})
    with speaking(words):
        made = write_command(Proposal("", {}, 2.0, command, drive="torque"), tmp_path)
        assert made.file is not None
        assert made.file.read_text().splitlines()[:3] == ["time [s],torque [N.m]", "0.000,0", "0.001,0.06"]
        made = write_command(Proposal("", {}, 2.0, command), tmp_path)
        assert made.file is not None
        assert made.file.read_text().splitlines()[:3] == [
            "time [s],u [1]",
            "0.000,0.000000",
            "0.001,0.060000",
        ]


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
