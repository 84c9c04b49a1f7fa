"""A log in which nothing moves shows one state of the machine: no effect is named, and what to excite is said."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cosim.diagnosis.at_rest import nothing_moves
from cosim.diagnosis.labels import contradictions
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.diagnosis.record.record import Record
from cosim.logs import Log
from cosim.report.deliver import delivered
from cosim.report.screen import lines
from cosim.rig import make_log
from cosim.rig.write import as_log

MACHINE = our_machine("full_order")
SECONDS = 6.0


@cache
def commanded(u: float, *hidden: str) -> Log:
    """A log of a constant command."""
    return as_log(make_log(np.full(round(1e3 * SECONDS) + 1, u), SECONDS, hidden, seed=3))


def uneasy(log: Log, size: float) -> Log:
    """A log whose command was recorded with noise."""
    noise = size * np.random.default_rng(1).standard_normal(len(log))
    return replace(log, signals=log.signals | {"u": log.signals["u"] + noise})


def told(log: Log) -> list[str]:
    """What is said of a log's labels."""
    return [c.finding for c in contradictions(log, prepare(log, MACHINE), MACHINE, True)]


@pytest.mark.parametrize("noise", [0.0, 1e-5, 3e-3])
@pytest.mark.parametrize("u", [0.0, 0.02])
def test_labels_of_a_machine_at_rest_are_not_contradicted(u: float, noise: float) -> None:
    log = uneasy(commanded(u), noise)
    assert nothing_moves(prepare(log, MACHINE), MACHINE)
    assert told(log) == []


def test_a_constant_command_that_the_machine_follows_is_no_contradiction() -> None:
    log = commanded(0.5)
    assert not nothing_moves(prepare(log, MACHINE), MACHINE)
    assert told(log) == []


def test_a_command_that_never_moves_while_the_machine_does_is_told() -> None:
    moving = as_log(make_log("steps", SECONDS, seed=3))
    log = replace(moving, signals=moving.signals | {"u": np.zeros(len(moving))})
    assert told(log) == ["u never moves"]


def test_a_machine_that_creeps_is_not_at_rest() -> None:
    log = commanded(0.0, "dcv.offset:x_0=0.3 mm")
    assert not nothing_moves(prepare(log, MACHINE), MACHINE)


@pytest.mark.parametrize(
    ("torque", "swing", "still"), [(0.8, 4e-4, False), (0.0, 4e-4, False), (0.0, 0.0, True)]
)
def test_the_crane_s_range_does_not_tell_whether_another_machine_moves(torque, swing, still) -> None:
    # a joint that 0.8 N m turn by hundredths of a degree, held by its friction: an angle of the crane would be still
    time = 0.015 * np.arange(600)
    noise = 1e-6 * np.random.default_rng(2).standard_normal(600)
    signals = {"torque": torque * np.sin(3.0 * time), "slew": 0.3 + swing * np.sin(3.0 * time) + noise}
    joint = replace(
        MACHINE, name="joint", signals={"torque": MACHINE.signals["u"]}, groups=MACHINE.groups[-1:]
    )
    joint = replace(joint, groups=(replace(joint.groups[0], drive="torque"),))
    assert nothing_moves(Record(0.015, signals), joint) == still


def test_nothing_is_named_and_what_to_excite_is_said(tmp_path) -> None:
    # the recorded noise of the command, sent through the compensator, would pass for play of the valve
    log = uneasy(commanded(0.0), 1e-2)
    result = delivered(diagnose(log), log, tmp_path)
    assert (result.verdict, result.causes, result.at_rest) == ("adequate", [], True)
    assert {"dcv.offset", "dcv.hysteresis", "mechanical.inertia"} <= set(result.not_exercised)
    assert result.next_experiment is not None
    assert "no effect is named or excluded" in "\n".join(lines(result, tmp_path))
    assert any(w.startswith("nothing moves in this log") for w in result.warnings)


@pytest.mark.parametrize("noise", [0.0, 1.0], ids=["all zero", "with the sensors' noise"])
def test_a_log_whose_command_is_zero_throughout_is_answered(noise: float, tmp_path) -> None:
    log = commanded(0.0)
    log = replace(log, signals={n: noise * v for n, v in log.signals.items()})
    result = delivered(diagnose(log), log, tmp_path)
    assert (result.causes, result.at_rest, result.interrupted) == ([], True, None)
    assert result.verdict == (
        "unexplained" if noise == 0.0 else "adequate"
    )  # no supply pressure: 170 bar off


def test_a_level_that_is_off_while_nothing_moves_has_no_cause() -> None:
    # a shifted neutral would turn the machine: it may as well be the zero of the sensor
    log = uneasy(commanded(0.0), 1e-5)
    log = replace(log, signals=log.signals | {"spool": log.signals["spool"] + 0.3e-3})
    found = diagnose(log)
    assert (found.verdict, found.causes) == ("unexplained", [])
    (rest,) = found.rests
    assert rest.signal == "spool"
    assert rest.leftover.rms == pytest.approx(0.3e-3, rel=0.01)
