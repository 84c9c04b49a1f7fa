"""Values that a log lacks lie on a line between others: no evidence for or against a model."""

import dataclasses

import numpy as np
import pytest

from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import prepare
from cosim.diagnosis.record.record import joined
from cosim.logs import Log
from cosim.rig import as_log, make_log

MACHINE = our_machine("full_order")
MECHANICAL = next(g for g in MACHINE.groups if g.name == "mechanical")
HOLES = ((2000, 2200), (5200, 5240), (9000, 9001))


def with_holes(log: Log) -> Log:
    """The log as the loader gives it where rows are empty: lines, and where they lie."""
    signals, valid = dict(log.signals), {}
    for name in ("slew", "p_a"):
        values, there = log.signals[name].copy(), np.ones(len(log), dtype=bool)
        for first, last in HOLES:
            there[first:last] = False
        values[~there] = np.interp(log.time[~there], log.time[there], values[there])
        signals[name], valid[name] = values, there
    return dataclasses.replace(log, signals=signals, valid=valid)


@pytest.fixture(scope="module")
def log() -> Log:
    return as_log(make_log("steps", 15.0, seed=9))


def test_what_was_filled_does_not_count(log: Log) -> None:
    record = prepare(with_holes(log), MACHINE)
    assert set(record.filled) == {"slew", "p_a", "p_load"}
    task = task_for(MECHANICAL, record, [])
    lost = task.lost["slew"]
    assert lost.sum() == sum(last - first for first, last in HOLES)
    residual = task.residuals({})["slew"]
    other = dict(record.signals) | {"slew": record.signals["slew"] + np.where(lost, 0.1, 0.0)}
    again = task_for(MECHANICAL, dataclasses.replace(record, signals=other), [])
    assert np.allclose(again.residuals({})["slew"], residual), "whatever stands in the holes"
    whole = task_for(MECHANICAL, prepare(log, MACHINE), [])
    assert "slew" not in whole.lost
    assert np.abs(whole.residuals({})["slew"][2000:2200]).max() > 0.0


def test_several_logs_keep_their_holes(log: Log) -> None:
    first, second = prepare(log, MACHINE), prepare(with_holes(log), MACHINE)
    both = joined([first, second])
    assert not both.filled["slew"][: len(log)].any()
    assert np.array_equal(both.filled["slew"][len(log) :], second.filled["slew"])
    assert [set(piece.filled) for piece in both.pieces] == [set(), {"slew", "p_load", "p_a"}]
    assert second.until(2100).filled["slew"].sum() == 100
