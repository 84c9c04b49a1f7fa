"""Logs that were computed and carry no noise at all, and signals that only a sensor could make worse."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_logs import off, only

from cosim.diagnosis.budget import Budget
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.record.signatures import resting, stale_share
from cosim.inference.noise import quietest
from cosim.rig import Noise, make_log
from cosim.rig.write import as_log


def told_without_noise(*hidden: str, model="full_order", excitation="mixed", seconds=21.0):
    """Diagnosis of a log without noise."""
    run = make_log(excitation, seconds, list(hidden), seed=31, noise=Noise(scale=0.0))
    return diagnose(as_log(run), model=model)


@pytest.mark.slow
def test_a_clean_log_without_noise_is_adequate() -> None:
    found = told_without_noise(excitation="steps", seconds=12.0)
    assert found.verdict == "adequate"
    assert not found.causes


@pytest.mark.parametrize(
    ("effect", "parameter", "size"),
    [
        ("mechanical.coulomb_friction", "tau_c", 100.0),
        pytest.param("mechanical.backlash", "gap", np.radians(0.2), marks=pytest.mark.slow),
        pytest.param("continuity.compressibility", "c_beta", 0.4, marks=pytest.mark.slow),
        pytest.param("dcv.delay", "tau_d", 0.02, marks=pytest.mark.slow),
    ],
)
def test_an_effect_without_noise_is_found_alone_and_exactly(effect: str, parameter: str, size: float) -> None:
    # what drives the block is the same log as without the effect
    block = effect.partition(".")[0]
    found = told_without_noise(f"{effect}:{parameter}={float(size)!r}", model=only(block))
    (cause,) = found.causes
    assert cause.effect.name == effect
    assert cause.parameters[parameter][0] == pytest.approx(size, rel=1e-3)
    assert not found.rests


@pytest.mark.parametrize(
    "kind", ["white", *(pytest.param(k, marks=pytest.mark.slow) for k in ("ar1", "pink"))]
)
def test_the_noise_of_sensors_is_never_below_what_is_assumed(kind: str) -> None:
    """Even at half the usual size the noise learned is that of the log, and not the least that is assumed."""
    noise = Noise(scale=0.5, kind=kind, correlation_time=0.03)
    log = as_log(make_log("mixed", 21.0, [], seed=8, settings=off(8), noise=noise))
    found = diagnose(log, budget=Budget(1e-9))  # the noise is learned before causes are tried
    for finding in found.findings.values():
        for signal, rule in finding.task.rules.items():
            assert rule.rms > 2.0 * quietest(finding.task.measured[signal])


def test_what_stands_is_not_stale_and_what_jumps_behind_is() -> None:
    moving = np.linspace(0.0, 1.0, 1001)
    stood = np.concatenate([moving[:500], np.full(60, moving[500]), moving[501:]])
    assert resting(stood)[500:560].all()
    assert not resting(stood)[:499].any()
    stale = moving.copy()
    stale[500:560] = stale[500]
    assert not resting(stale).any()
    rate = np.full(stale.size, 1.0)
    assert stale_share(stale, rate)[0] > 0.05
    assert stale_share(stood, np.full(stood.size, 1.0))[0] == 0.0


def test_a_nominal_parameter_that_is_off_is_named_beside_a_small_rest() -> None:
    """The nominal model bends the parameter itself: all that is left then is the rest, however small it is."""
    run = make_log("mixed", 21.0, ["dcv.gain:K=2.1 mm"], seed=4, settings=off(4, "dcv.gain"))
    log = as_log(run)
    spool = log.signals["spool"]
    curved = spool * (1.0 - 0.002 * (spool / 2.6e-3) ** 2)  # a displacement sensor that is not quite straight
    found = diagnose(replace(log, signals={**log.signals, "spool": curved}), model=only("dcv"))
    assert [c.effect.name for c in found.causes] == ["dcv.gain"]
    assert found.causes[0].parameters["K"][0] == pytest.approx(2.1e-3, rel=0.01)
    assert {rest.block for rest in found.rests} == {"dcv"}
    assert found.verdict == "partly_explained"
