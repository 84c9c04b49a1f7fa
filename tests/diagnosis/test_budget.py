"""A diagnosis with a budget ends in time with the best so far, and says what it did not try."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cosim.cli import make_app
from cosim.commands import diagnose as command
from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.budget import Budget, current, parse_budget, seen_by_threads, within
from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.fit import fit
from cosim.diagnosis.fitting.trials import unknowns
from cosim.diagnosis.hypotheses.naming import nominal
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.errors import UsageError
from cosim.rig import make_log
from cosim.rig.write import as_log

HIDDEN = ("mechanical.coulomb_friction:tau_c=150 N.m",)


def test_a_stage_ends_when_its_share_is_gone() -> None:
    now = [5.0]
    budget = Budget(100.0, clock=lambda: now[0])
    assert not budget.over
    budget.allow(0.5)
    now[0] = 54.9
    assert not budget.over
    now[0] = 55.0
    assert budget.over
    budget.allow(1.0)
    assert not budget.over


def test_a_part_of_what_is_left_to_a_stage_may_be_taken() -> None:
    now = [0.0]
    budget = Budget(100.0, clock=lambda: now[0])
    budget.allow(0.5)
    now[0] += 10.0
    with budget.part(0.25):  # of the 40 s that are left
        now[0] += 9.0
        assert not budget.over
        now[0] += 2.0
        assert budget.over
    assert not budget.over
    now[0] += 30.0
    assert budget.over


def test_without_a_span_nothing_is_over() -> None:
    budget = Budget()
    budget.allow(0.0001)
    assert not budget.over
    assert budget.warnings == []


def test_somebody_may_end_a_search_once() -> None:
    """What cannot end by itself is not ended so, and a second request is for somebody else."""
    budget = Budget()
    assert not budget.end()
    with budget.searching():
        assert not budget.over
        assert budget.end()
        assert budget.over
        assert budget.gone
        assert not budget.end()
    budget.leave_out("dcv", "dcv.delay")
    assert budget.warnings == ["dcv: it was interrupted; not tried: dcv.delay"]


def test_threads_of_a_pool_see_the_budget() -> None:
    budget = Budget(1e-9)

    def gone(_: int) -> bool:
        return current().gone

    with within(budget), ThreadPoolExecutor(1) as pool:
        assert list(pool.map(gone, [1])) == [False]
        assert list(pool.map(seen_by_threads(gone), [1])) == [True]


def test_a_fit_that_runs_is_cut_when_the_time_is_gone() -> None:
    """It ends where it is by then: not settled, and better than where it began."""
    record = prepare(
        as_log(make_log("mixed", 24.0, ["dcv.gain:K=2.0 mm"], seed=1)), our_machine("full_order")
    )
    task = task_for(MODELS["full_order"][0], record, [])
    nominal(task, record, 1.0)
    wanted, _ = unknowns(task.model, (), 1.0)
    now = [0.0]

    def ticking() -> float:
        now[0] += 1.0
        return now[0]

    with within(Budget(1.5, clock=ticking)):  # each look at the clock takes a second
        cut = fit(task, wanted)
    begun = task.white(task.residuals({}))
    assert fit(task, wanted).settled
    assert not cut.settled
    assert cut.log_likelihood > -0.5 * float(begun @ begun) + 1000.0


def test_what_was_left_out_is_said_group_by_group() -> None:
    budget = Budget(60.0)
    budget.leave_out("dcv", "dcv.delay")
    for _ in range(3):
        budget.leave_out("dcv", "a set of causes")
    assert budget.warnings == [
        "dcv: the time allowed (60 s) was over; not tried: dcv.delay, a set of causes (3 of them)"
    ]


@pytest.mark.parametrize("budget", [None, "60s"])
def test_what_takes_long_says_how_it_is_ended(
    budget: str | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "LONG", 0.0)
    with command.way_out(budget):
        for thread in threading.enumerate():
            if isinstance(thread, threading.Timer):
                thread.join()
    assert ("--budget" in capsys.readouterr().err) == (budget is None)


@pytest.mark.parametrize(("text", "seconds"), [("60s", 60.0), ("2 min", 120.0), ("90", 90.0)])
def test_a_budget_is_a_time_with_its_unit(text: str, seconds: float) -> None:
    assert parse_budget(text) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("text", "says"), [("0s", "positive"), ("-5 s", "positive"), ("3 m", "'m'"), ("soon", "not a number")]
)
def test_what_is_no_time_is_refused(text: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        parse_budget(text)


def test_a_diagnosis_ends_and_says_what_was_not_tried() -> None:
    log = as_log(make_log("steps", 12.0, HIDDEN, seed=3))
    for seconds in (
        0.5,
        1e-9,
    ):  # on a new host what the first one runs is compiled, so the second one alone is timed
        begin = time.process_time()
        found = diagnose(log, budget=Budget(seconds, clock=time.process_time))
        taken = time.process_time() - begin
        said = answer(found, log, None).warnings
        left_out = [w for w in said if f"the time allowed ({seconds:g} s) was over" in w]
        assert found.stage == ""
        assert set(found.findings) == {"dcv", "continuity", "mechanical"}
        assert left_out
    assert any("mechanical.coulomb_friction" in w for w in left_out)
    assert found.causes == []
    assert taken < 20.0  # nominal fits only; without a budget this log takes far longer


def test_a_wrong_budget_is_refused_before_the_log_is_read(tmp_path: Path) -> None:
    result = CliRunner().invoke(make_app(), ["diagnose", str(tmp_path / "none.csv"), "--budget", "3 kg"])
    assert result.exit_code != 0
    assert isinstance(result.exception, UsageError) or "kg" in result.output


def test_no_linear_model_is_fitted_for_each_log_when_the_time_is_gone() -> None:
    """Of one log it is one fit, of several one for each."""
    logs = [as_log(make_log("steps", 6.0, HIDDEN, seed=s)) for s in (1, 2)]
    for given, fitted in ((logs[:1], True), (logs, False)):
        found = diagnose(given, budget=Budget(1e-6))
        assert bool(found.references) == fitted
        assert any("the linear reference of the whole was left out" in note for note in found.notes) != fitted
