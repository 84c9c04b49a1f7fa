"""What free parameters make up for is no candidate: one number cannot be two causes."""

import dataclasses

import numpy as np
import pytest

from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.trials import candidates_of
from cosim.diagnosis.hypotheses.naming import nominal
from cosim.diagnosis.hypotheses.screening import identifiable
from cosim.diagnosis.model.groups import MODELS, merged
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import prepare
from cosim.logs.log import Log
from cosim.rig import make_log
from cosim.rig.write import as_log

# with command and angle alone, and J and b free, these are one number with them
ONE_NUMBER = {"dcv.gain", "continuity.flow_gain", "sensor.gain"}


def left_out(log: Log) -> set[str]:
    """The candidates that the command-to-angle group of a log drops, inertia and viscous friction free."""
    signals = {n: log.signals[n] for n in ("u", "slew")}
    record = prepare(dataclasses.replace(log, signals=signals), our_machine("full_order"))
    (group,) = merged(MODELS["full_order"], record.signals)
    group = dataclasses.replace(group, trusted=("mechanical.J", "mechanical.b"))
    task = task_for(group, record, [])
    null = nominal(task, record, 30.0)
    candidates = candidates_of(task)
    return {e.name for e in candidates} - {e.name for e in identifiable(task, null, candidates)}


def test_gains_between_two_signals_are_one_number() -> None:
    found = left_out(as_log(make_log("mixed", 30.0, [], seed=5)))
    assert found >= ONE_NUMBER
    kept = {"mechanical.coulomb_friction", "continuity.flow_asymmetry", "dcv.delay", "dead_zone.mismatch"}
    assert not kept & found


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_in_a_log_of_one_direction_an_asymmetry_is_a_gain(side: float) -> None:
    time = np.arange(20000) * 1e-3
    u = side * np.where(time < 1.0, 0.0, np.where(time < 8.0, 0.4, 0.7))
    found = left_out(as_log(make_log(u, 20.0, [], seed=5)))
    assert found >= {*ONE_NUMBER, "continuity.flow_asymmetry"}
    assert "mechanical.coulomb_friction" not in found
