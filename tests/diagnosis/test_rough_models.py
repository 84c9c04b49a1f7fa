"""Machines that no model of ours describes well: what is named on them, and what is not (logs computed here, synthetic)."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.answer.remarks import advice
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.verdict import verdict
from cosim.logs import Log
from cosim.rig import make_log
from cosim.rig.write import as_log

Array = NDArray[np.float64]
H = 0.02
COUNT = 3000


def through(top: list[float], bottom: list[float], u: Array) -> Array:
    """Response of a transfer function to a held input."""
    b, a, _ = cont2discrete((top, bottom), H)
    return np.asarray(lfilter(np.ravel(b), a, u))


def command() -> Array:
    return np.repeat(np.random.default_rng(7).uniform(-1.0, 1.0, COUNT // 25), 25)


def log_of(u: Array, angle: Array) -> Log:
    """A log of command and angle, with noise of 2e-4 rad."""
    like = as_log(make_log("mixed", 21.0, [], seed=1))
    noisy = angle + 2e-4 * np.random.default_rng(8).standard_normal(COUNT)
    return dataclasses.replace(like, time=np.arange(COUNT) * H, signals={"u": u, "slew": noisy})


@pytest.fixture(scope="module")
def arm() -> tuple[Log, Diagnosis]:
    """A linear drive whose arm swings at 6 rad/s, which the model does not have."""
    u = command()
    angle = through([36.0], [1.0, 0.36, 36.0], through([0.1745], [1.0, 4.4, 0.0], u))
    log = log_of(u, angle)
    return log, diagnose(log, model="simplified", calibrate=True)


def test_missing_linear_dynamics_are_told_and_nothing_else_is_named_on_top(
    arm: tuple[Log, Diagnosis],
) -> None:
    found = arm[1]
    assert found.causes == []
    assert found.verdict == "unexplained"
    (rest,) = [r for r in found.rests if r.what.startswith("linear dynamics are missing")]
    assert "a mode at 6 rad/s" in rest.what
    span = found.window * found.record.h
    assert f"predicts slew over windows of {span:.3g} s left out of the fit with" in rest.what


def test_a_demanded_place_in_the_stead_of_a_command_is_told(arm: tuple[Log, Diagnosis]) -> None:
    """A closed loop of which the setpoint was logged: the place follows it itself. An arm that swings goes on."""
    assert not any("follows u itself" in text for text in advice(arm[1]))
    u = command()
    closed = diagnose(log_of(u, 0.1 * through([1.0], [0.1, 1.0], u)), model="simplified", calibrate=True)
    assert closed.causes == []
    (text,) = [text for text in advice(closed) if "follows u itself" in text]
    assert "log what the controller puts out" in text


def test_the_noise_of_a_machine_that_never_rests_is_not_its_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that changes with each third sample: what the speed does then passed for noise, larger than any error."""
    u = np.repeat(np.random.default_rng(3).choice([-1.0, 1.0], COUNT // 3), 3)
    noise = 1e-3 * np.random.default_rng(4).standard_normal(COUNT)
    speed = through([1.0], [0.1, 1.0], u)
    left = 2e-2 * through([1.0], [0.05, 1.0], u) + noise
    monkeypatch.setattr(verdict, "adequate", lambda finding: False)
    finding = left_over(speed + noise, left)
    assert verdict.noise_floor(speed + noise, H) > np.std(left), "the signal has no quiet place"
    assert 1e-3 < verdict.floor_of(finding, "speed") < np.std(left)


def left_over(speed: np.ndarray, left: np.ndarray) -> SimpleNamespace:
    """A finding of which only the readings of a speed and what is left of them matter."""
    task = SimpleNamespace(
        rules={"speed": SimpleNamespace(skip=0, cuts=())},
        measured={"speed": speed},
        model=SimpleNamespace(h=H, cuts=(), group=SimpleNamespace(reading="slew")),
        steps={},
        lost={},
    )
    fit = SimpleNamespace(residuals={"speed": left})
    return SimpleNamespace(task=task, chosen=SimpleNamespace(fit=fit), signatures=[])


def test_readings_in_steps_have_noise_where_machine_and_model_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole revolutions a minute of a motor that stands half the time, and of a model that stands there too."""
    monkeypatch.setattr(verdict, "adequate", lambda finding: False)
    speed = np.round(40.0 * np.repeat([0.0, 1.0], COUNT // 2) + np.linspace(0.0, 8.0, COUNT // 2 * 2))
    speed[: COUNT // 2] = 0.0
    left = np.where(speed > 0.0, 3.0 * np.sin(0.01 * np.arange(speed.size)), 0.0)
    assert verdict.floor_of(left_over(speed, left), "speed") == pytest.approx(1.0 / np.sqrt(12.0))


def test_readings_refreshed_rarely_have_the_noise_of_what_was_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pressure refreshed every 16 samples: on the lines in between it had a fiftieth of its noise."""
    monkeypatch.setattr(verdict, "adequate", lambda finding: False)
    stamps, samples = np.arange(0, 32000, 16), np.arange(32000)
    read = np.round(
        40.0 * np.sin(stamps / 2000.0) + np.random.default_rng(4).normal(0.0, 0.2, stamps.size), 2
    )
    filled = np.ones(samples.size, dtype=bool)
    filled[stamps] = False
    speed = np.interp(samples, stamps, read)
    finding = left_over(speed, speed - 40.0 * np.sin(samples / 2000.0))
    assert verdict.floor_of(finding, "speed") < 0.1, "of what stands between the readings"
    finding.task.lost["speed"] = filled
    assert verdict.floor_of(finding, "speed") == pytest.approx(0.2, rel=0.15)


def test_the_linear_reference_stands_beside_the_answer(arm: tuple[Log, Diagnosis]) -> None:
    said = answer(arm[1], arm[0], None).linear["slew"]
    assert said.rmse < 0.1 * said.rmse_extended
    assert said.ci95_of_ratio[0] > 10.0
    assert any(abs(complex(*pole)) == pytest.approx(6.0, rel=0.02) for pole in said.poles)


def test_a_wide_dead_zone_is_named_though_much_is_left() -> None:
    """A lag, a disturbance and a ripple that no hypothesis has are left over: held-out windows tell, no share of it."""
    u = command()
    # the model's compensator adds 0.45 and 0.40 of command, its valve takes them away again: here it takes 0.25 more
    moved = np.sign(u) * np.maximum(np.abs(u) - 0.25, 0.0)
    angle = through([1.0], [0.05, 1.0], through([0.297], [1.0, 7.0, 0.0], moved))
    time = np.arange(COUNT) * H
    angle = angle + 2e-3 * np.cumsum(np.sin(0.44 * time) * H) + 4e-3 * np.sin(60.0 * angle)
    found = diagnose(log_of(u, angle), model="simplified", calibrate=True)
    assert [c.effect.name for c in found.causes] == ["dead_zone.mismatch"]
    assert found.verdict == "partly_explained"
    # what is left bends the edges, and the intervals know it
    for name, edge in (("dead_zone.b_r", 0.70), ("dead_zone.b_l", -0.65)):
        reach = 1.96 * found.deviations[name]
        assert abs(found.values[name] - edge) < reach < 0.2
