"""An end of the travel, a sensor that saturates, a constant load: each named, and told from the others where the log can."""

import dataclasses
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cosim.diagnosis.answer.answer import unmoved
from cosim.diagnosis.extension import estimate
from cosim.diagnosis.fitting import trials
from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.limits import Passed, idle, passed, passed_in_fit, unmet
from cosim.diagnosis.fitting.trials import tried
from cosim.diagnosis.found import Cause, Diagnosis
from cosim.diagnosis.held_out import free_run
from cosim.diagnosis.hypotheses.naming import nominal
from cosim.diagnosis.model.groups import left_out
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import NOMINAL_TRUST
from cosim.rig import make_log
from cosim.rig.write import as_log
from fmus import registry

MACHINE = our_machine("full_order")
START = {"mechanical.theta_0": np.radians(15.0)}


def found(hidden: str, excitation: str = "steps", without: tuple[str, ...] = ()) -> Diagnosis:
    log = as_log(make_log(excitation, 30.0, [hidden], seed=7, settings=START))
    return diagnose(
        dataclasses.replace(log, signals={n: v for n, v in log.signals.items() if n not in without})
    )


@pytest.fixture(scope="module")
def stopped() -> Task:
    """A synthetic log of a drive that meets an end of its travel at 16 deg, its noise learned."""
    log = as_log(make_log("steps", 20.0, ["mechanical.end_stop"], seed=7, settings=START))
    record = prepare(log, MACHINE)
    task = task_for(next(g for g in MACHINE.groups if g.name == "mechanical"), record, [])
    nominal(task, record, NOMINAL_TRUST)
    return task


def test_an_end_that_the_fitted_readings_pass_is_left_out_and_the_other_stays(
    stopped: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where much else is wrong a search bends one of the two to describe something else."""
    stop = registry.effects()["mechanical.end_stop"]
    search = trials.fit_from_starts

    def led_astray(*given: Any, **more: Any) -> Fit:
        found = search(*given, **more)
        return replace(found, values=found.values | {"mechanical.theta_min": np.radians(14.0)})

    monkeypatch.setattr(trials, "fit_from_starts", led_astray)
    found = tried(stopped, (stop,), NOMINAL_TRUST).fit
    assert passed_in_fit(stopped, (stop,), found) == {}
    assert found.values["mechanical.theta_min"] == stopped.model.nominal("mechanical.theta_min")
    assert np.degrees(found.values["mechanical.theta_max"]) == pytest.approx(16.0, abs=0.1)


@pytest.mark.parametrize("again", [free_run.refitted, free_run.onward])
def test_so_it_is_where_held_out_data_judge(
    stopped: Task, monkeypatch: pytest.MonkeyPatch, again: Callable[..., Fit]
) -> None:
    """Else the stop would be refused for what was fitted to the other end, and something unlikelier take its place."""
    stop = registry.effects()["mechanical.end_stop"]
    near, search = tried(stopped, (stop,), NOMINAL_TRUST).fit, free_run.fit
    astray = [{"mechanical.theta_min": np.radians(14.0)}]

    def led_astray_once(*given: Any, **more: Any) -> Fit:
        found = search(*given, **more)
        return replace(found, values=found.values | astray.pop()) if astray else found

    monkeypatch.setattr(free_run, "fit", led_astray_once)
    found = again(cast(Finding, SimpleNamespace(task=stopped)), (stop,), NOMINAL_TRUST, near)
    assert not astray
    assert found.values["mechanical.theta_min"] == stopped.model.nominal("mechanical.theta_min")
    assert np.degrees(found.values["mechanical.theta_max"]) == pytest.approx(16.0, abs=0.1)


@pytest.mark.parametrize("gives_way", [0.0, 0.15])
def test_a_limit_that_other_readings_pass_is_none(stopped: Task, gives_way: float) -> None:
    """By more than a stop gives way, and a sensor has noise."""
    task = stopped
    other = prepare(as_log(make_log("steps", 20.0, ["mechanical.end_stop"], seed=8, settings=START)), MACHINE)
    stop = registry.effects()["mechanical.end_stop"]
    end = np.radians(16.0 - gives_way)
    limits = {"mechanical.theta_max": end, "mechanical.theta_min": np.radians(11.9)}
    fit = Fit(limits, dict.fromkeys(limits, 1e-5), 0.0, 0, {}, np.empty((0, 0)))

    def beyond(by: float) -> list[Passed]:
        """Of a log that goes on for an angle [deg] beyond the stop."""
        slew = other.signals["slew"]
        shift = np.where(slew > np.radians(15.9), np.radians(by), 0.0)
        return passed(task, stop, fit, {"slew": slew + shift})

    assert task.measured["slew"].max() > np.radians(15.98)
    assert beyond(0.0) == []
    (found,) = beyond(1.0)
    assert (found.signal, found.limit, found.rate) == ("slew", end, False)
    assert np.degrees(found.reading) == pytest.approx(17.0, abs=0.1)
    far = replace(fit, values=limits | {"mechanical.theta_max": np.radians(14.0)})
    (found,) = passed(task, stop, far, {"slew": task.measured["slew"]})
    assert np.degrees(found.reading) == pytest.approx(16.0, abs=0.1)  # of the fitted ones themselves


@pytest.mark.parametrize(
    ("ends", "alone"), [((16.1, 1e9), False), ((30.0, 1e9), True), ((30.0, 11.9), False)]
)
def test_an_end_that_no_reading_comes_near_is_none(
    stopped: Task, ends: tuple[float, float], alone: bool
) -> None:
    """A model that goes on too far met one 1 mm beyond all readings of an actuator of 10 mm."""
    stop, nowhere = registry.effects()["mechanical.end_stop"], stopped.model.nominal("mechanical.theta_min")
    limits = {
        "mechanical.theta_max": np.radians(ends[0]),
        "mechanical.theta_min": nowhere if ends[1] == 1e9 else np.radians(ends[1]),
    }
    fit = Fit(limits, dict.fromkeys(limits, 1e-5), 0.0, 0, {}, np.empty((0, 0)))
    assert unmet(stopped, stop, fit) is alone


def test_an_estimate_whose_limit_readings_pass_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two estimates of a cause the free run's was better on the held-out data and had stops well within the travel."""
    stop = registry.effects()["mechanical.end_stop"]
    near, far = (Fit({"mechanical.theta_max": v}, {}, 0.0, 0, {}, np.empty((0, 0))) for v in (0.2, 0.5))
    group = SimpleNamespace(drifts=True)
    task: Any = SimpleNamespace(rules={"slew": None}, model=SimpleNamespace(group=group))
    finding: Any = SimpleNamespace(task=task, null=SimpleNamespace(fit=far))
    told: Any = SimpleNamespace(
        record=SimpleNamespace(cuts=()), held=SimpleNamespace(record=SimpleNamespace(signals={"slew": None}))
    )
    monkeypatch.setattr(estimate, "what_stands", lambda finding: SimpleNamespace(fit=far))
    monkeypatch.setattr(estimate, "refitted", lambda *given, mask: near)
    monkeypatch.setattr(estimate, "onward", lambda *given: far)
    monkeypatch.setattr(estimate, "worth_naming", lambda *given: True)
    monkeypatch.setattr(estimate, "held_error", lambda *given: given[5].values["mechanical.theta_max"])
    beyond = Passed("slew", 0.2, 0.4, False)
    monkeypatch.setattr(
        estimate, "passed_in", lambda held, task, effect, fit: [beyond] if fit is near else []
    )
    estimate.estimate_alone(told, finding, (stop,), NOMINAL_TRUST, {})
    assert told.values["mechanical.theta_max"] == 0.5


def test_a_size_that_changes_nothing_is_known_as_such() -> None:
    """A dead zone of the direction in which nothing is driven; of the other the log knows."""
    log = as_log(make_log("steps", 6.0, ["dead_zone.mismatch"], seed=7, settings=START))
    record = prepare(log, MACHINE)
    record.signals["u"] = np.abs(record.signals["u"])
    task = task_for(next(g for g in MACHINE.groups if g.name == "dcv"), record, [])
    effect = registry.effects()["dead_zone.mismatch"]
    found = tried(task, (effect,), 0.01)
    assert idle(found.fit, "dead_zone.b_l")
    assert not idle(found.fit, "dead_zone.b_r")


def test_an_end_out_of_reach_is_never_told_beside_one_that_another_fit_met(stopped: Task) -> None:
    """The fit of the block alone did not meet the lower end, that of the whole did; the upper one is 1e9 rad away."""
    stop = registry.effects()["mechanical.end_stop"]
    values = {"mechanical.theta_max": 1e9, "mechanical.theta_min": -1.8}
    own = Fit(values, {}, 0.0, 10, {}, np.empty((0, 0)), slopes=np.zeros((10, 2)))
    assert all(idle(own, name) for name in values)
    told: Any = SimpleNamespace(
        findings={"mechanical": SimpleNamespace(task=stopped, chosen=SimpleNamespace(fit=own))},
        values=values,
        deviations={"mechanical.theta_max": 0.1, "mechanical.theta_min": 0.07},
    )
    cause: Any = SimpleNamespace(
        effect=stop, group="mechanical", parameters={"theta_max": (1e9, 5e8), "theta_min": (-2.6, 0.04)}
    )
    assert unmoved(told, cause) == {"theta_max"}


def only(told: Diagnosis) -> Cause:
    assert told.verdict == "explained", [r.what for r in told.rests]
    (cause,) = told.causes
    return cause


@pytest.mark.slow
def test_an_end_of_the_travel_is_named_and_measured() -> None:
    cause = only(found("mechanical.end_stop"))
    assert (cause.effect.name, cause.indistinguishable) == ("mechanical.end_stop", [])
    for name, angle in (("theta_max", 16.0), ("theta_min", 12.0)):
        value, deviation = cause.parameters[name]
        assert np.degrees(value) == pytest.approx(angle, abs=0.02)
        assert abs(value - np.radians(angle)) < 4.0 * deviation + 2e-4


@pytest.mark.slow
def test_also_where_only_command_and_angle_were_measured() -> None:
    cause = only(found("mechanical.end_stop", without=("spool", "p_a", "p_b", "p_supply")))
    assert cause.effect.name == "mechanical.end_stop"
    assert np.degrees(cause.parameters["theta_max"][0]) == pytest.approx(16.0, abs=0.05)


@pytest.mark.slow
def test_a_saturated_sensor_is_no_end_of_the_travel() -> None:
    """The drive has moved on: the reading comes back later than the drive is reversed."""
    cause = only(found("sensor.saturation"))
    assert (cause.effect.name, cause.indistinguishable) == ("sensor.saturation", [])
    assert np.degrees(cause.parameters["high"][0]) == pytest.approx(16.0, abs=0.02)


@pytest.mark.slow
def test_an_end_that_the_library_lacks_is_not_named_for_something_else() -> None:
    with left_out("mechanical.end_stop", "sensor.saturation"):
        told = found("mechanical.end_stop")
    assert told.verdict in ("unexplained", "partly_explained")
    assert "mechanical" in [r.block for r in told.rests]


@pytest.mark.slow
def test_a_constant_load_is_a_candidate_without_being_asked_for() -> None:
    """A sensor that drifts shows the same where viscous friction alone holds the drive; so both are told."""
    cause = only(found("mechanical.constant_load"))
    assert "mechanical.constant_load" in (cause.effect.name, *cause.indistinguishable)


@pytest.mark.slow
def test_beside_friction_a_constant_load_is_told_from_a_drift() -> None:
    log = as_log(
        make_log(
            "steps", 30.0, ["mechanical.constant_load", "mechanical.coulomb_friction"], seed=7, settings=START
        )
    )
    told = diagnose(log)
    assert {c.effect.name for c in told.causes} == {
        "mechanical.constant_load",
        "mechanical.coulomb_friction",
    }
    load = next(c for c in told.causes if c.effect.name == "mechanical.constant_load")
    assert "sensor.drift" not in load.indistinguishable
