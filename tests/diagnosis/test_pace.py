"""Searches take longer steps where the log cannot tell them from its own, and only there."""

from dataclasses import replace

import numpy as np

from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.pace import in_exact_steps, paced
from cosim.diagnosis.fitting.trials import candidates_of, tried_all
from cosim.diagnosis.hypotheses.naming import nominal
from cosim.diagnosis.model.groups import merged
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import prepare
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.thresholds import STEP_ERROR, STEP_ERROR_AFTER
from cosim.rig import make_log
from cosim.rig.write import as_log


def slow_task() -> tuple[Task, Record]:
    """The whole drive from command to slew, logged every 40 ms."""
    run = make_log("mixed", 40.0, [], seed=5)
    log = as_log(run).resample(0.04)
    machine = our_machine("full_order")
    record = prepare(log, machine)
    kept = {s: record.signals[s] for s in ("u", "slew")}
    record = replace(record, signals=kept)
    return task_for(merged(machine.groups, record.signals)[0], record, []), record


def test_a_slow_log_is_searched_in_longer_steps() -> None:
    task, record = slow_task()
    null, exact = nominal(task, record, 0.01), task.model
    candidates = candidates_of(task)
    paced(task, exact, null.fit, candidates, 0.01)
    assert task.model.step > 1.5 * exact.step
    searched = task.model.step
    assert off(task, exact, null.fit.values) <= STEP_ERROR

    single = tried_all(task, [(candidates[0],)], 0.01, null.fit)
    again, chosen, others = in_exact_steps(task, exact, null, null, single, 0.01)
    assert exact.step <= task.model.step < searched
    assert off(task, exact, again.fit.values) <= STEP_ERROR_AFTER * STEP_ERROR
    assert chosen is again
    assert [t.names for t in others] == [(candidates[0].name,)]


def off(task: Task, exact: GroupModel, values: dict[str, float]) -> float:
    """Root mean square of what the task's steps change of the whitened residual."""
    moved = task.white(task.residuals(values)) - task.white(task.against(exact.simulate(values)))
    return float(np.sqrt(np.mean(moved**2)))


def test_a_log_without_noise_is_searched_in_its_own_steps() -> None:
    task, record = slow_task()
    null, exact = nominal(task, record, 0.01), task.model
    task.set_rules({s: replace(r, sizes=tuple(1e-8 * v for v in r.sizes)) for s, r in task.rules.items()})
    paced(task, exact, null.fit, (), 0.01)
    assert task.model is exact
