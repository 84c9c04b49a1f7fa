"""Where searches begin: the size, and for a sine the phase, that explain most."""

import dataclasses
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.diagnosis.fitting import trials
from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.starts import Size, sized
from cosim.diagnosis.fitting.trials import FIRST_ROUNDS, Trial, fitted_on, led_on, tried, unpaid
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import Noise, as_log, make_log
from fmus import registry
from fmus.contract import Effect
from tests.diagnosis.hidden_logs import diagnosed

X = np.linspace(0.0, 9.0, 400)
HIDDEN = np.linalg.qr(np.stack([X, np.cos(3.0 * X)], axis=1))[0]


@given(
    size=st.floats(0.1, 100.0),
    phase=st.floats(-3.0, 3.0),
    sign=st.sampled_from([1.0, -1.0]),
    other=st.floats(-5.0, 5.0),
)
def test_amplitude_and_phase_of_a_sine_are_found_at_once(
    size: float, phase: float, sign: float, other: float
) -> None:
    """Whichever way the phase counts, and whatever the other parameters hide."""

    def response(amplitude: float, angle: float) -> np.ndarray:
        return amplitude * np.sin(X + sign * angle)

    off = response(size, phase) + other * HIDDEN[:, 0]
    alike = [({"m.size": 2.0, "m.phase": p}, off - response(2.0, p)) for p in (0.5, 0.5 + 0.5 * np.pi)]
    found = sized(alike, Size("m.size", 0.0, "m.phase"), off, HIDDEN)
    assert response(found["m.size"], found["m.phase"]) == pytest.approx(
        response(size, phase), abs=1e-9 * size
    )


@given(size=st.floats(-50.0, 50.0), off_value=st.floats(-1.0, 1.0))
def test_a_size_is_found_at_once(size: float, off_value: float) -> None:
    off = size * np.sin(X)
    found = sized(
        [({"m.size": off_value + 2.0}, off - 2.0 * np.sin(X))], Size("m.size", off_value), off, HIDDEN[:, :0]
    )
    assert found["m.size"] - off_value == pytest.approx(size, abs=1e-9)


@pytest.mark.slow
def test_gravity_over_a_short_range_of_angles_is_found_in_the_first_rounds() -> None:
    """Amplitude and phase lie in a long valley there, along which a search from afar creeps."""
    finding = diagnosed(
        "mechanical.gravity_load:tau_g=100 N.m,theta_g=17 deg", seed=18, seconds=40.0
    ).findings["mechanical"]
    effect = registry.effects()["mechanical.gravity_load"]
    trial = tried(finding.task, (effect,), 0.01, finding.null.fit, FIRST_ROUNDS)
    assert trial.fit.values["mechanical.tau_g"] == pytest.approx(100.0, rel=0.1)
    assert trial.fit.values["mechanical.theta_g"] == pytest.approx(np.radians(17.0), abs=0.02)


@pytest.mark.slow
def test_a_limit_of_the_speed_below_all_starts_is_found() -> None:
    """Small steps of a valve that is slower than any start: the measured spool itself says how fast it gets."""
    hidden, noise = ["dcv.rate_limit:v_max=4.2e-3"], Noise(scale=1.17)
    run = make_log("small_steps", 60.0, hidden, amplitude=0.8123, seed=29079684, noise=noise)
    (cause,) = diagnose(as_log(run)).causes
    assert cause.effect.name == "dcv.rate_limit"
    assert cause.parameters["v_max"][0] == pytest.approx(4.2e-3, rel=0.01)


@pytest.mark.slow
def test_a_stop_that_is_never_met_is_left_where_it_was() -> None:
    """One stop is hit; the other lies beyond what the spool reaches: all that the log says is that it is no nearer."""
    settings = {"dcv.K": 0.002398, "dcv.w0": 25.39, "dcv.zeta": 0.5505}
    command = np.where(np.arange(30_001) % 5000 < 2500, 0.765, -1.0) * (np.arange(30_001) > 500)
    run = make_log(
        command, 30.0, ["dcv.stroke_limit:x_max=2.4e-3,x_min=-1.728e-3"], seed=35, settings=settings
    )
    assert 2.2e-3 < run.true["spool"].max() < 2.39e-3
    (cause,) = diagnose(as_log(run)).causes
    assert cause.effect.name == "dcv.stroke_limit"
    assert cause.parameters["x_min"][0] == pytest.approx(-1.728e-3, rel=1e-3)
    value, deviation = cause.parameters["x_max"]
    assert value - 1.96 * deviation < 2.4e-3 < value == pytest.approx(2.6e-3)


def test_the_side_to_which_a_log_never_moves_costs_nothing() -> None:
    """Else a dead zone pays for two sizes where friction, which explains as much, pays for one."""
    group = dataclasses.replace(our_machine("full_order").groups[-1], starts=())
    model = GroupModel(group, np.zeros(100), 1e-3)
    names = ["dead_zone.b_r", "dead_zone.b_l", "mechanical.theta_max", "mechanical.theta_min"]
    values = dict(zip(names, (0.3, -0.09, 1.0, model.nominal("mechanical.theta_min")), strict=True))
    slopes = np.zeros((9, 4))
    slopes[:, [0, 2, 3]] = 1.0
    known = registry.effects()

    def unpaid_of(name: str, seen: np.ndarray) -> int:
        found = Fit(values, values, 0.0, 9, {}, np.empty((0, 0)), slopes=seen)
        return unpaid(model, known[name], found)

    assert unpaid_of("dead_zone.mismatch", slopes) == 1
    assert unpaid_of("dead_zone.mismatch", np.ones((9, 4))) == 0
    assert unpaid_of("dead_zone.mismatch", np.zeros((9, 4))) == 1  # an effect that shows nothing is not free
    assert unpaid_of("mechanical.end_stop", slopes) == 1  # a stop out of reach


def test_the_likeliest_are_fitted_on_as_long_as_that_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    """The order in which quick fits leave them is one of chance."""
    effects = registry.effects()

    def trial(name: str, reached: float, settled: bool = False) -> Trial:
        found = Fit({}, {}, reached, 9, {}, np.empty((0, 0)), settled=settled)
        return Trial((effects[name],), found, 1)

    gains = {"mechanical.backlash": [5.0, 3.0, 0.01, 9.0], "dcv.delay": [-1.0, 9.0], "dcv.offset": [9.0]}
    rounds = dict.fromkeys(gains, 0)

    def further(_: Task, own: tuple[Effect, ...], __: float, near: Fit, *___: int, quick: bool) -> Trial:
        (effect,) = own
        assert quick
        gained = gains[effect.name][rounds[effect.name]]
        rounds[effect.name] += 1
        return trial(effect.name, near.log_likelihood + gained)

    monkeypatch.setattr(trials, "tried", further)
    monkeypatch.setattr(trials, "copied", lambda task: task)
    begun = [trial(name, 0.0, settled=name == "dcv.offset") for name in gains]
    no_task = cast("Task", None)
    found = fitted_on(no_task, begun, 0.01, lambda t: t.fit.log_likelihood)
    assert [t.fit.log_likelihood for t in found] == pytest.approx([8.01, 0.0, 0.0])
    assert rounds == {"mechanical.backlash": 3, "dcv.delay": 1, "dcv.offset": 0}


def test_a_search_that_went_astray_begins_again_where_a_kindred_one_ended() -> None:
    """From a size of zero nothing may lead to dry friction: the fuller law in the same list shows where it lies."""
    known = registry.effects()

    def trial(name: str, reached: float) -> Trial:
        return Trial((known[f"mechanical.{name}"],), Fit({}, {}, reached, 9, {}, np.empty((0, 0))), 1)

    lost, fuller, other = (
        trial("coulomb_friction", 0.5),
        trial("stribeck_friction", 900.0),
        trial("backlash", 950.0),
    )
    assert led_on(lost, [lost, fuller, other]) is fuller
    assert led_on(fuller, [lost, fuller, other]) is None
    assert led_on(trial("coulomb_friction", 890.0), [fuller, other]) is None
    assert led_on(trial("stribeck_friction", 880.0), [trial("coulomb_friction", 890.0)]) is not None
