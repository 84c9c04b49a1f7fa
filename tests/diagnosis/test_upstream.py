"""A cause too small to be seen where it acts is weighed where it is integrated."""

from cosim.diagnosis.story import diagnose
from cosim.rig import Hidden, Noise, make_log
from cosim.rig.write import as_log


def test_an_asymmetry_below_the_noise_of_the_pressure_is_declared_beside_the_drift_it_looks_like() -> None:
    run = make_log(
        "small_steps",
        60.0,
        [Hidden("continuity.flow_asymmetry", {"a_q": 0.012})],
        amplitude=0.7,
        noise=Noise(scale=0.7, kind="ar1", correlation_time=0.05),
        seed=23,
    )
    found = diagnose(as_log(run))
    assert [c.effect.block for c in found.causes if c.group == "mechanical"]
    for cause in found.causes:
        if cause.group == "mechanical":
            assert "continuity.flow_asymmetry" in cause.alike


def test_a_drift_beyond_what_the_pressure_allows_has_no_rival_upstream() -> None:
    run = make_log("mixed", 60.0, [Hidden("sensor.drift", {"drift": 5e-4})], seed=24)
    (cause,) = diagnose(as_log(run)).causes
    assert cause.effect.name == "sensor.drift"
    assert not [n for n in cause.alike if n.startswith(("dcv.", "continuity.flow"))]
