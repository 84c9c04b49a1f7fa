"""Dead zone, end of the opening and ends of the travel together: found where one by one each bends the others."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from cosim.diagnosis.extension.top_speed import in_place, settled, slopes_of, static_speeds, top_speeds
from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.trials import Trial, candidates_of, copied, starting, tried
from cosim.diagnosis.hypotheses.naming import nominal, remaining
from cosim.diagnosis.hypotheses.static_curve import Edge, boxed, together
from cosim.diagnosis.model.groups import merged
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.record.record import Record, joined
from cosim.diagnosis.thresholds import GUESSED_TRUST
from cosim.rig import make_log

H, NOISE = 0.02, 2e-4  # s, rad
HIDDEN = {"dead_zone.b_r": 0.5, "dcv.x_max": 0.6e-3, "mechanical.theta_max": np.radians(14.0)}
SPEED = {"mechanical.J": 1500.0, "mechanical.b": 9000.0}  # a drive three times as fast as its nominal numbers


@pytest.fixture(scope="module")
def begun() -> tuple[Task, Trial]:
    """Three synthetic logs, each a step from rest to an end of the travel, of which command and angle are known."""
    rng, machine, records = np.random.default_rng(5), our_machine("full_order"), []
    for level, seconds in ((0.12, 14.0), (0.25, 8.0), (0.8, 8.0)):
        command = np.concatenate([np.zeros(500), np.full(round(1e3 * seconds), level)])
        run = make_log(command, settings=HIDDEN | SPEED, noise=0)
        every = round(1e3 * H)
        slew = run.slew[::every] + NOISE * rng.standard_normal(run.slew[::every].size)
        records.append(Record(H, {"u": run.u[::every], "slew": slew}))
    record = joined(records)
    (group,) = merged(machine.groups, record.signals)
    task = task_for(replace(group, absolute=True, trusted=("mechanical.J", "mechanical.b")), record, [])
    return task, nominal(task, record, GUESSED_TRUST)


@pytest.fixture(scope="module")
def found(begun: tuple[Task, Trial]) -> Trial:
    task, null = begun
    trial = together(copied(task), null, candidates_of(task), GUESSED_TRUST)
    assert trial is not None
    return trial


def test_all_that_bends_the_curve_is_found_at_once(found: Trial) -> None:
    assert set(found.names) == {"dead_zone.mismatch", "dcv.stroke_limit", "mechanical.end_stop"}
    for name, truth in HIDDEN.items():
        assert found.fit.values[name] == pytest.approx(truth, rel=0.02), name


def test_nothing_but_noise_is_left_where_a_search_from_nominal_ends_far_off(
    begun: tuple[Task, Trial], found: Trial
) -> None:
    task, null = begun
    assert remaining(task, found) < 1.1 * NOISE
    straight = tried(copied(task), found.effects, GUESSED_TRUST, null.fit)
    assert remaining(task, straight) > 10.0 * NOISE


def driven(level: float) -> float:
    """Speed of the hidden drive at a constant command, far from the end of its travel, rad/s."""
    free = {n: v for n, v in HIDDEN.items() if n != "mechanical.theta_max"}
    angle = make_log(np.full(5000, level), settings=free | SPEED, noise=0).slew
    return float(angle[-1] - angle[-1001])


def test_the_speed_at_a_stop_is_that_of_the_machine(begun: tuple[Task, Trial], found: Trial) -> None:
    """No end of the travel counts there, and its interval is that of the product, not of the stop's own place."""
    task, _ = begun
    (speed,) = top_speeds(task.model, found.effects, found.fit, None).values()
    assert speed.value == pytest.approx(driven(1.0), rel=2e-3)
    low, high = speed.ci95
    assert low < driven(1.0) < high
    fit = found.fit
    relative = fit.deviations["dcv.x_max"] / fit.values["dcv.x_max"]
    assert (high - low) / 3.92 / speed.value < 0.5 * relative


def test_what_a_stop_and_a_damping_have_in_common_does_not_change_the_speed(
    begun: tuple[Task, Trial], found: Trial
) -> None:
    """Where only their ratio is known, errors of either a hundred times its size must cancel."""
    task, _ = begun
    values = {n: v for n, v in found.fit.values.items() if n != "mechanical.theta_max"}
    names = ["mechanical.b", "dcv.x_max"]
    speed = settled(task.model, 1.0, values)
    assert speed is not None
    slopes = slopes_of(partial(settled, task.model, 1.0), values, names, speed)
    assert slopes is not None
    shares = slopes * [values[n] for n in names] / driven(1.0)
    assert shares == pytest.approx([-1.0, 1.0], rel=5e-3)
    assert shares.sum() == pytest.approx(0.0, abs=1e-4)


def test_a_speed_in_the_place_of_a_stop_leaves_the_fit_as_it_is(
    begun: tuple[Task, Trial], found: Trial
) -> None:
    fit, names = found.fit, list(found.fit.values)[: found.fit.covariance.shape[0]]
    slopes = np.arange(1.0, len(names) + 1.0)
    other = in_place(fit, "dcv.x_max", 3.0, slopes)
    # any change of the estimates moves the residuals as it did, told in either terms
    change = np.random.default_rng(3).standard_normal(len(names))
    scaled = [change / [f.scales[n] for n in names] for f in (fit, other)]
    scaled[1][names.index("dcv.x_max")] = slopes @ change / other.scales["dcv.x_max"]
    assert fit.slopes is not None
    assert other.slopes is not None
    np.testing.assert_allclose(other.slopes @ scaled[1], fit.slopes @ scaled[0], rtol=1e-9, atol=1e-9)
    assert other.deviations["dcv.x_max"] == pytest.approx(float(np.sqrt(slopes @ fit.covariance @ slopes)))


def test_the_static_curve_of_the_model_is_that_of_the_machine(
    begun: tuple[Task, Trial], found: Trial
) -> None:
    task, _ = begun
    levels = [1.0, 0.75, 0.6, 0.3]
    speeds = static_speeds(task.model, found.effects, found.fit.values, levels)
    assert speeds == pytest.approx([driven(level) for level in levels], rel=0.02, abs=1e-5)


def test_where_no_speed_lasts_none_is_told(begun: tuple[Task, Trial], found: Trial) -> None:
    task, _ = begun
    model = copied(task).model
    weight = {"mechanical.tau_g": 5e4}
    assert settled(model, 1.0, found.fit.values | {"mechanical.theta_max": 1e9}) is not None
    model.fixed = model.fixed | weight
    assert top_speeds(model, found.effects, found.fit, None) == {}
    assert static_speeds(model, found.effects, found.fit.values, [1.0, 0.5]) is None
    placed = copied(task).model
    placed.group = replace(placed.group, place=True)
    assert top_speeds(placed, found.effects, found.fit, None) == {}


def test_what_the_log_does_not_drive_to_is_not_sought(begun: tuple[Task, Trial]) -> None:
    task, null = begun
    bending = tuple(e for e in candidates_of(task) if e.bends)
    box = {
        e.name: e for e in boxed(task, null.fit, bending, *starting(task, bending, GUESSED_TRUST, null.fit))
    }
    assert {"dead_zone.b_r", "dcv.x_max", "mechanical.theta_max", "mechanical.J"} <= box.keys()
    assert not {"dead_zone.b_l", "dcv.x_min", "mechanical.theta_min"} & box.keys()
    stop = box["mechanical.theta_max"]
    assert stop.low < HIDDEN["mechanical.theta_max"] + 4.0 * NOISE < stop.high + 8.0 * NOISE


def test_a_valve_that_the_command_never_opens_has_no_end_to_be_sought(begun: tuple[Task, Trial]) -> None:
    task, null = begun
    bending = tuple(e for e in candidates_of(task) if e.bends)
    wanted, starts = starting(task, bending, GUESSED_TRUST, null.fit)
    shut = replace(null.fit, values=null.fit.values | {"dead_zone.b_r": 5.0})
    closed = copied(task)
    closed.model.fixed = closed.model.fixed | {"dead_zone.b_r": 5.0}
    assert "dcv.x_max" not in {e.name for e in boxed(closed, shut, bending, wanted, starts)}


def test_one_alone_or_where_windows_have_offsets_is_left_to_the_usual_search(
    begun: tuple[Task, Trial],
) -> None:
    task, null = begun
    few = tuple(e for e in candidates_of(task) if e.name == "dead_zone.mismatch")
    assert together(copied(task), null, few, GUESSED_TRUST) is None
    drifting = copied(task)
    drifting.set_rules({s: replace(rule, demean=True) for s, rule in task.rules.items()})
    assert together(drifting, null, candidates_of(task), GUESSED_TRUST) is None


def test_the_ends_of_an_edge() -> None:
    assert [Edge("a", 2.0, 8.0).at(s) for s in (0.0, 0.5, 1.0)] == [2.0, 5.0, 8.0]
    assert [Edge("a", -2.0, -8.0, True).at(s) for s in (0.0, 0.5, 1.0)] == pytest.approx([-2.0, -4.0, -8.0])
