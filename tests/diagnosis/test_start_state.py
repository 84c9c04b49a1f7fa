"""A log that begins in motion: the model begins there too, also where a state is not measured."""

import dataclasses

import numpy as np
import pytest

from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.model.groups import MODELS, merged
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.diagnosis.record.record import begun_values, fixed_values, joined
from cosim.logs.log import Log
from cosim.rig import make_log
from cosim.rig.run import RigRun
from cosim.rig.write import as_log

BEGIN = 7.0  # s into the log: the column turns


@pytest.fixture(scope="module")
def run() -> RigRun:
    return make_log("steps", 20.0, [], seed=7)


def cut_off(log: Log, begin: float, without: tuple[str, ...] = (), end: float = np.inf) -> Log:
    """What a logger switched on late would have recorded."""
    first, last = np.searchsorted(log.time, [begin, end])
    signals = {n: v[first:last] for n, v in log.signals.items() if n not in without}
    return dataclasses.replace(log, time=log.time[first:last] - log.time[first], signals=signals)


def test_measured_states_start_at_their_readings(run: RigRun) -> None:
    record = prepare(cut_off(as_log(run), BEGIN), our_machine("full_order"))
    found = {n: v for g in MODELS["full_order"] for n, v in fixed_values(record, g).items()}
    at = round(BEGIN * 1e3)
    truth = run.true
    assert abs(truth["omega"][at]) > 0.01, "the test wants a log that begins in motion"
    assert found["mechanical.omega_0"] == pytest.approx(truth["omega"][at], rel=0.1)
    assert found["dcv.spool_0"] == pytest.approx(truth["spool"][at], abs=2e-5)
    assert found["continuity.p_load_0"] == pytest.approx(truth["p_load"][at], abs=6e4)
    assert found["mechanical.theta_0"] == pytest.approx(truth["theta"][at], abs=1e-3)


@pytest.mark.parametrize("without", [(), ("spool", "p_a", "p_b", "p_supply")])
def test_the_model_follows_from_the_first_sample_on(run: RigRun, without: tuple[str, ...]) -> None:
    """Driven by what was measured before it; without a start state the angle is off by the way that the start takes."""
    record = prepare(cut_off(as_log(run), BEGIN, without), our_machine("full_order"))
    group = merged(MODELS["full_order"], record.signals)[-1]
    fixed = fixed_values(record, group)
    measured = record.signals["slew"]

    def error(start: dict[str, float]) -> float:
        model = GroupModel(group, record.signals[group.drive], record.h, start, record.grid)
        return float(np.sqrt(np.mean((measured - model.simulate({})["slew"])[:3000] ** 2)))

    at_rest = {n: v for n, v in fixed.items() if n.endswith("theta_0")}
    assert error(fixed) < 0.4 * error(at_rest)


def test_a_log_that_begins_at_rest_has_no_other_state(run: RigRun) -> None:
    record = prepare(as_log(run), our_machine("full_order"))
    assert [begun_values(record, g) for g in MODELS["full_order"][:2]] == [{}, {}]
    assert not begun_values(record, MODELS["full_order"][2])


def test_of_several_logs_each_begins_in_its_own_state(run: RigRun) -> None:
    machine = our_machine("full_order")
    late, early = (prepare(cut_off(as_log(run), begin), machine) for begin in (BEGIN, 0.0))
    found = fixed_values(joined([late, early]), MODELS["full_order"][2])
    assert found["mechanical.omega_0"] != 0.0
    assert found["mechanical.omega_0@1"] == 0.0


@pytest.mark.slow
def test_a_clean_log_that_begins_in_motion_is_adequate(run: RigRun) -> None:
    found = diagnose(cut_off(as_log(run), BEGIN, end=15.0))
    assert found.verdict == "adequate"
    assert found.causes == []
