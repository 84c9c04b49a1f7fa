"""What free functions explain is a fault only if it shows again, as strongly, in windows that had no share in finding it."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from cosim.diagnosis.fitting.noise import plain
from cosim.diagnosis.pipeline import diagnose as pipeline
from cosim.diagnosis.pipeline.diagnose import diagnose, outdone_by_linear
from cosim.diagnosis.residuals import reference as reference_module
from cosim.diagnosis.residuals.freeform import Leftover, changing, explain, families
from cosim.diagnosis.residuals.reference import Reference
from cosim.diagnosis.thresholds import SYSTEMATIC, USUAL_SIZE
from cosim.diagnosis.verdict.verdict import systematic
from cosim.inference.linear import Data
from cosim.rig import make_log
from cosim.rig.write import as_log
from tests.diagnosis.hidden_logs import diagnosed, off

Array = NDArray[np.float64]
H, N = 1e-3, 60_000
TIME = np.arange(N) * H
LINES = ((0.11, 0.3), (0.23, 1.0), (0.37, 2.0), (0.61, 0.5))
ANGLE = np.asarray(sum(np.sin(2.0 * np.pi * f * TIME + phase) for f, phase in LINES))
SPEED = np.gradient(ANGLE, H)
TRANSFER = ([1.0], [0.1, 1.0])


BIN = 1.0  # noise of ten samples of variance 10


def leftover(residual: Array) -> Leftover:
    """What free functions find with noise thought to be white, as where they leave nothing to learn it from."""
    rule = plain(10, 500, True)
    bases = families({"x": ANGLE, "v": SPEED}, TRANSFER, H, "force", "N")
    for by, driver in (("time", TIME), ("x", ANGLE)):
        bases += changing("v", SPEED, by, driver, TRANSFER, H, "force", "N")
    return explain(residual, bases, rule, lambda r: rule(r).ravel(), np.repeat(np.arange(12), 500))


@pytest.mark.parametrize(
    ("linear", "ours", "step", "outdone"),
    [
        (0.60, 0.72, 0.0, True),
        (0.72, 0.60, 0.0, False),
        (0.60, 0.601, 0.0, False),
        (0.06, 0.12, 0.2, False),
        (0.06, 0.40, 0.2, True),
    ],
)
def test_what_a_linear_model_predicts_better_is_not_explained(
    linear: float, ours: float, step: float, outdone: bool
) -> None:
    """By more than the sensor's noise, or a step of its readings; 0.60 against 0.72 cm was a small excavator's boom."""
    squares = np.linspace(0.5, 1.5, 24)  # of such windows the difference is not clear
    reference = Reference(None, linear**2 * squares, ours**2 * squares[::-1])  # type: ignore[arg-type]
    assert outdone_by_linear({"slew": reference}, {"slew": 0.05}, {"slew": step} if step else {}) is outdone


@pytest.mark.parametrize(("linear", "better"), [(0.95, False), (0.85, True)])
def test_a_linear_model_is_no_better_where_nobody_would_mind(linear: float, better: bool) -> None:
    """A delay that halved the error of a speed was dropped for a linear model with 96 % of what it left."""
    squares = np.linspace(0.9, 1.1, 24)  # of so many alike the difference is certain
    assert Reference(None, linear**2 * squares, squares).clearly_better is better  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("order", "is_speed", "curve", "lacks"),
    [(0, True, 1.0, False), (1, True, 1.0, True), (1, True, 0.5, False), (0, False, 0.5, True)],
)
def test_a_constant_gain_shows_no_dynamics_that_a_speed_lacks(
    monkeypatch: pytest.MonkeyPatch, order: int, is_speed: bool, curve: float, lacks: bool
) -> None:
    """A damper's friction was dropped for "linear dynamics: a constant gain"; a place that follows so does lack them.

    Nor does a free curve that does as well: its bends are no dynamics.
    """
    reference = Reference(SimpleNamespace(order=order), np.full(24, 0.25), np.ones(24))  # type: ignore[arg-type]
    group = SimpleNamespace(integrates=True, is_speed=lambda signal: is_speed)
    task = SimpleNamespace(model=SimpleNamespace(group=group), measured={"speed": np.ones(9)})
    monkeypatch.setattr(pipeline, "of_group", lambda *_: reference)
    monkeypatch.setattr(pipeline, "adequate", lambda finding: False)
    monkeypatch.setattr(pipeline, "negligible", lambda *_: 0.0)
    monkeypatch.setattr(pipeline, "of_curve", lambda *_: curve)

    @dataclass(frozen=True)
    class Stub:
        task: SimpleNamespace
        reference: Reference | None = None
        lacks_curve: float = 0.0
        chosen: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(fit=None, effects=()))
        null: None = None
        lacks_linear: bool = False
        rivals: dict[str, None] | None = None
        events: dict[str, dict[str, None]] = field(default_factory=dict)

        def accept(self, *_: object) -> "Stub":
            return self

    found = pipeline.beside_linear(Stub(task), SimpleNamespace(time=np.arange(9.0)), None, {})  # type: ignore[arg-type]
    assert found.reference is reference
    assert found.lacks_linear is lacks
    assert found.lacks_curve == (curve if order and not lacks else 0.0)


@pytest.mark.parametrize(
    ("before", "ours", "plain", "linear", "numbers"),
    [
        (91.0, 2.61, 2.38, 0.56, True),  # a motor's friction and damping in one direction
        (91.0, 2.61, 1.20, 0.56, False),  # a lag and a constant alone do better
        (91.0, 2.61, 8.00, 0.56, False),  # they do what no lag does
        (3.90, 2.61, 2.38, 0.56, False),  # they leave much to the poles
    ],
)
def test_friction_of_one_direction_stands_in_for_no_dynamics(
    monkeypatch: pytest.MonkeyPatch, before: float, ours: float, plain: float, linear: float, numbers: bool
) -> None:
    """A linear model has a constant, too, and poles for what is left: all that was told was that it is better."""

    def held(a: float, b: float) -> Reference:
        return Reference(None, np.full(12, a**2), np.full(12, b**2))  # type: ignore[arg-type]

    monkeypatch.setattr(pipeline, "of_same_order", lambda *_: held(plain, ours))
    monkeypatch.setattr(pipeline, "beside", lambda *_: held(linear, before))
    trial = SimpleNamespace(fit=None)
    finding = SimpleNamespace(task=None, chosen=trial, null=trial)
    found = pipeline.numbers_only(finding, SimpleNamespace(time=None), held(linear, ours))  # type: ignore[arg-type]
    assert found is numbers


def test_what_is_no_dynamics_has_one_lag_and_no_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    fits = []
    monkeypatch.setattr(reference_module, "beside", lambda task, found, time, fit: fits.append(fit))
    group = SimpleNamespace(integrates=False, is_speed=lambda signal: True)
    task = SimpleNamespace(model=SimpleNamespace(group=group), measured={"speed": None})
    reference_module.of_same_order(task, None, None)  # type: ignore[arg-type]
    u = np.repeat(np.random.default_rng(2).uniform(0.0, 1.0, 12), 40)
    y = 3.0 + lfilter([0.0] * 9 + [0.1], [1.0, -0.9], u)  # eight samples late
    model = fits[0](Data(u, y, 0.01, lambda rows: rows, np.arange(u.size) // 120))
    assert model.order == 1
    assert model.sections.delay == 0.0
    assert model.predicted(u, 0.01).size == u.size


def slow_noise(seed: int) -> Array:
    """White noise and slower noise of many correlation times, nearly 1/f."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=N) * np.sqrt(10.0)
    for time in (0.15, 0.5, 1.5, 5.0):
        pole = np.exp(-H / time)
        noise += 0.25 * lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.normal(size=N))
    return noise


@pytest.mark.parametrize("seed", [0, 3, 10, 11])
def test_slow_noise_is_no_fault_however_improbable_and_a_force_is(seed: int) -> None:
    noise = slow_noise(seed)
    alone = leftover(noise)
    assert alone.p_value < SYSTEMATIC, "or this test shows nothing"
    assert not systematic(alone, 0.0, BIN)
    force = 0.12 * np.abs(ANGLE) * ANGLE
    assert systematic(leftover(noise + lfilter([H / 0.1], [1.0, H / 0.1 - 1.0], force)), 0.0, BIN)


def test_the_parts_of_the_rule() -> None:
    found = replace(leftover(np.zeros(N) + slow_noise(1)), p_value=1e-9, gain=44.0, rms=0.9)
    assert not systematic(replace(found, held_out=9.2), 0.0, BIN)
    assert systematic(replace(found, held_out=20.0), 0.0, BIN)
    assert not systematic(replace(found, held_out=20.0), 2.0, BIN), "smaller than what matters"
    assert not systematic(replace(found, held_out=20.0, p_value=1e-3), 0.0, BIN), "chance"
    assert not systematic(replace(found, gain=9.0, held_out=5.0), 0.0, BIN), "too little to be sure"
    # windows that visit different regimes have little to say of each other
    assert systematic(replace(found, held_out=-20.0, p_value=1e-40), 0.0, BIN)
    # what is nearly constant has been taken for slow noise, but no noise is larger than that of one bin
    assert systematic(replace(found, held_out=0.6, rms=1.1), 0.0, BIN)


@pytest.mark.slow
def test_a_drive_that_friction_holds_is_not_called_a_dead_sensor() -> None:
    """Friction of any size beyond the drive's torque says the same; not to know which is no doubt about it."""
    found = diagnosed(
        "mechanical.coulomb_friction:tau_c=400 N.m", seed=52, seconds=30.0, excitation="small_steps"
    )
    (cause,) = found.causes
    named = {cause.effect.name, *cause.indistinguishable}
    assert "mechanical.coulomb_friction" in named
    assert "sensor.gain" not in named


@pytest.mark.slow
def test_a_law_of_which_only_a_ratio_is_known_is_tried_at_a_usual_size() -> None:
    """A drive that only creeps shows tau_c / omega_v: the best fit lay at a friction beyond all sizes, and was set aside."""
    own = off(9, "mechanical.viscous_friction")
    run = make_log("small_steps", 25.0, ["mechanical.viscous_friction:b=2.7e5"], seed=9, settings=own)
    found = diagnose(as_log(run))
    (cause,) = found.causes
    assert cause.effect.name == "mechanical.coulomb_friction"
    assert "mechanical.viscous_friction" in cause.indistinguishable
    assert cause.parameters["tau_c"][0] <= USUAL_SIZE * cause.effect.free["tau_c"].scale * (1.0 + 1e-9)
