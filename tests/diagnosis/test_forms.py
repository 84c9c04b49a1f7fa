"""Causes of another law than the simplest: named as what they are, the form found, and nothing invented beside them."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_logs import off, only
from scipy.integrate import solve_ivp

from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import Noise, make_log
from cosim.rig.write import as_log
from fmus import registry

COULOMB, STRIBECK = "mechanical.coulomb_friction", "mechanical.stribeck_friction"
SIZES = {COULOMB: {"tau_c": 120.0}, STRIBECK: {"tau_c": 80.0, "tau_s": 100.0, "omega_s": 0.008}}
FORM = {"lugre": ("z_s", 2e-5), "smooth": ("omega_v", 5e-4), "sharp": ("", 0.0)}


def diagnosed_of(effect: str, friction: str, seed: int, seconds: float = 30.0, excitation: str = "mixed"):
    """Diagnosis of a log with friction of that form."""
    hidden = f"{effect}:" + ",".join(f"{n}={v}" for n, v in SIZES[effect].items())
    run = make_log(excitation, seconds, [hidden], seed=seed, settings=off(seed), friction=friction)
    return diagnose(as_log(run), model=only("mechanical"))


@pytest.mark.parametrize(
    ("effect", "friction", "how"),
    [
        (COULOMB, "lugre", (10.0, "steps")),
        *(
            pytest.param(*case, (30.0,), marks=pytest.mark.slow)
            for case in [(STRIBECK, "lugre"), (COULOMB, "smooth"), (STRIBECK, "smooth")]
        ),
    ],
)
def test_the_form_is_found_and_nothing_beside_it(effect, friction, how) -> None:
    found = diagnosed_of(effect, friction, 4711, *how)
    assert [c.effect.name for c in found.causes] == [effect]
    assert not found.rests
    (cause,) = found.causes
    form, size = FORM[friction]
    value, deviation = cause.parameters[form]
    assert value == pytest.approx(size, abs=4.0 * deviation, rel=0.1)
    for name, true in SIZES[effect].items():
        value, deviation = cause.parameters[name]
        assert value == pytest.approx(true, abs=4.0 * deviation)


@pytest.mark.slow
def test_friction_in_which_the_drive_only_creeps_is_no_dead_sensor() -> None:
    """Small steps below the friction's level: the angle moves by a fifteenth of what it should."""
    hidden = ["mechanical.coulomb_friction:tau_c=238"]
    noise = Noise(scale=1.59)
    run = make_log(
        "small_steps", 60.0, hidden, amplitude=0.866, seed=279974570, noise=noise, friction="smooth"
    )
    found = diagnose(as_log(run))
    (cause,) = found.causes
    assert cause.effect.name == COULOMB
    assert cause.parameters["omega_v"][0] / cause.parameters["tau_c"][0] == pytest.approx(
        5e-4 / 240.0, rel=0.05
    )


@pytest.mark.slow  # dry friction's is looked at in tests/diagnosis/test_blind.py too
@pytest.mark.parametrize("effect", [COULOMB, STRIBECK])
def test_sharp_friction_keeps_its_simplest_form(effect) -> None:
    (cause,) = diagnosed_of(effect, "sharp", seed=815).causes
    assert cause.effect == registry.effects()[effect]
    assert not set(cause.parameters) & set(cause.effect.forms)


@pytest.mark.parametrize(
    ("root", "named", "noise_scale"),
    [
        pytest.param(True, True, 1.0, marks=pytest.mark.slow),
        (False, False, 1.0),
        pytest.param(True, True, 0.0, marks=pytest.mark.slow),
    ],
    ids=["turbulent", "laminar", "turbulent without noise"],
)
def test_leakage_through_an_orifice_is_leakage(root, named, noise_scale) -> None:
    """The pressure is made by scipy from the rig's spool: the rig has no such leakage."""
    run = make_log("steps", 15.0, [], seed=99, settings=off(99), noise=Noise(scale=noise_scale))
    log = as_log(run)
    spool, noise = run.true["spool"], log.signals["p_a"] - 0.5 * (run.true["p_supply"] + run.true["p_load"])
    gain, lag = off(99)["continuity.K_c"], off(99)["continuity.T"]

    def rate(t: float, p: np.ndarray) -> np.ndarray:
        leak = 0.25 * np.sign(p) * np.sqrt(1e6 * np.abs(p)) if root else 0.25 * p
        return (gain * np.interp(t, log.time, spool) - p - leak) / lag

    p_load = solve_ivp(
        rate, (0.0, log.time[-1]), [0.0], "RK45", log.time, max_step=2e-3, rtol=1e-6, atol=10.0
    ).y[0]
    signals = {n: v for n, v in log.signals.items() if n != "slew"}
    signals["p_a"] = 0.5 * (run.true["p_supply"] + p_load) + noise
    signals["p_b"] = 0.5 * (run.true["p_supply"] - p_load) - noise
    found = diagnose(replace(log, signals=signals), model=only("continuity"))
    (cause,) = found.causes
    assert cause.effect.name == "continuity.leakage"
    assert not found.rests
    assert cause.parameters["c_l"][0] == pytest.approx(0.25, rel=0.05)
    assert ("k_t" in cause.parameters) == named


def test_effects_are_told_apart_by_name_whatever_is_free_in_them() -> None:
    plain = registry.effects()[COULOMB]
    formed = plain.formed("z_s")
    assert formed == plain
    assert hash(formed) == hash(plain)
    assert formed != registry.effects()[STRIBECK]
    assert formed.is_formed
    assert not plain.is_formed
    assert list(formed.plain.free) == list(plain.free) != list(formed.free)


@pytest.mark.slow
def test_which_friction_holds_a_drive_at_rest_cannot_be_told() -> None:
    """More parameters are held against a cause only if it frees all that the named one does."""
    hidden = ["mechanical.stribeck_friction:tau_c=200,tau_s=150,omega_s=0.008"]
    run = make_log("small_steps", 30.0, hidden, seed=68, amplitude=0.5)
    assert np.ptp(run.true["theta"]) == 0.0
    (cause,) = diagnose(as_log(run)).causes
    assert "mechanical.stribeck_friction" in (cause.effect.name, *cause.indistinguishable)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "soft"),
    [
        pytest.param(41, True, marks=pytest.mark.slow),
        pytest.param(42, True, marks=pytest.mark.slow),
        (43, False),
    ],
)
def test_a_counterbalance_valve_may_open_gradually(seed, soft) -> None:
    """The angle is made by scipy from the rig's pressure: the rig's valve opens all at once."""
    settings = off(seed)
    run = make_log("mixed", 40.0, [], seed=seed, settings=settings)
    log, p_c = as_log(run), 1e5
    p_load = run.true["p_load"]
    lost = p_c * np.tanh(p_load / p_c) if soft else np.clip(p_load, -p_c, p_c)
    inertia, damping = settings["mechanical.J"], settings["mechanical.b"]
    area = settings.get("mechanical.A", 8419.3e-6) * settings.get("mechanical.r", 0.1)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[1], (area * np.interp(t, log.time, p_load - lost) - damping * y[1]) / inertia])

    theta = solve_ivp(
        rate,
        (0.0, log.time[-1]),
        [run.true["theta"][0], 0.0],
        "RK45",
        log.time,
        max_step=5e-3,
        rtol=1e-8,
        atol=1e-9,
    ).y[0]
    noise = log.signals["slew"] - run.true["theta"]
    found = diagnose(replace(log, signals=log.signals | {"slew": theta + noise}))
    (cause,) = found.causes
    assert cause.effect.name == "continuity.cracking_pressure"
    assert not found.rests
    assert cause.parameters["p_c"][0] == pytest.approx(p_c, rel=0.03)
    assert ("s_c" in cause.parameters) == soft
