"""A cause too small to be seen where it acts is weighed where it is integrated."""

import numpy as np
import pytest
from hidden_logs import off

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.trials import Trial
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.verdict.upstream import one_deviation
from cosim.rig import Hidden, Noise, make_log
from cosim.rig.write import as_log
from fmus import registry


@pytest.mark.slow
def test_an_asymmetry_below_the_noise_of_the_pressure_is_declared_beside_the_drift_it_looks_like() -> None:
    run = make_log(
        "small_steps",
        60.0,
        [Hidden("continuity.flow_asymmetry", {"a_q": 0.018})],
        amplitude=0.7,
        noise=Noise(scale=0.7, kind="ar1", correlation_time=0.05),
        seed=23,
    )
    found = diagnose(as_log(run))
    assert [c.effect.block for c in found.causes if c.group == "mechanical"]
    for cause in found.causes:
        if cause.group == "mechanical":
            assert "continuity.flow_asymmetry" in cause.indistinguishable


@pytest.mark.slow
def test_an_asymmetry_that_only_the_slew_shows_is_named_where_it_acts() -> None:
    """A drift of the sensor with a gear ripple beside it explained the slew worse, and was named."""
    noise = Noise(scale=2.0, kind="ar1", correlation_time=0.05)
    hidden = [Hidden("continuity.flow_asymmetry", {"a_q": 0.03})]
    run = make_log("mixed", 40.0, hidden, amplitude=0.8, noise=noise, seed=31, settings=off(31))
    found = diagnose(as_log(run))
    (cause,) = found.causes
    assert cause.effect.name == "continuity.flow_asymmetry"
    assert not found.rests
    assert found.findings["mechanical"].chosen.effects == ()
    value, deviation = cause.parameters["a_q"]
    assert value == pytest.approx(0.03, abs=3.0 * deviation)
    behind = {e.name for e, far in cause.rivals if far > 6.0}
    assert behind & {"sensor.drift", "mechanical.gravity_load", "mechanical.viscous_asymmetry"}


@pytest.mark.slow
def test_a_drift_beyond_what_the_pressure_allows_has_no_rival_upstream() -> None:
    run = make_log("mixed", 60.0, [Hidden("sensor.drift", {"drift": 5e-4})], seed=24)
    (cause,) = diagnose(as_log(run)).causes
    assert cause.effect.name == "sensor.drift"
    assert not [n for n in cause.indistinguishable if n.startswith(("dcv.", "continuity.flow"))]


@pytest.mark.parametrize(("k_s", "tau_s"), [(2.6e5, 1e-3), (0.0, 0.3), (5e8, 0.1)])
def test_what_is_tried_upstream_stays_within_its_limits(k_s: float, tau_s: float) -> None:
    effect = registry.effects()["continuity.supply_sag"]
    values = {"continuity.k_s": k_s, "continuity.tau_s": tau_s}
    spread = np.array([2.6e5, 0.3])
    covariance = np.outer(spread, spread) * np.array([[1.0, -0.999], [-0.999, 1.0]])
    trial = Trial((effect,), Fit(values, dict(zip(values, spread, strict=True)), 0.0, 9, {}, covariance), 2)
    for part, moved in one_deviation(trial):
        assert 0.0 < abs(part) <= 1.0
        for name, variable in effect.parameters.items():
            assert variable.low <= moved[f"continuity.{name}"] <= variable.high
        assert moved["continuity.tau_s"] != tau_s
