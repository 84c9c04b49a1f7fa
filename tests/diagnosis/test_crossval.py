"""Held-out windows refute what they contradict, and nothing that only they show."""

import pytest

from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.thresholds import BEYOND_TRUST, NOMINAL_TRUST
from cosim.rig import Noise, as_log, make_log
from cosim.rig.parameters import nominal_value
from tests.diagnosis.hidden_logs import diagnosed


@pytest.mark.slow
def test_a_stop_that_the_other_windows_hardly_touch_is_not_refuted() -> None:
    """The multisine repeats every third window: the others meet one stop by a hair, and must not carry it off."""
    settings = {
        "dcv.K": 0.00232715,
        "dcv.w0": 25.678,
        "dcv.zeta": 0.538546,
        "continuity.K_c": 518694000.0,
        "continuity.T": 0.10972,
        "mechanical.J": 772.349,
        "mechanical.b": 26726.7,
    }
    hidden = "dcv.stroke_limit:x_max=2.0299321 mm,x_min=-2.0098871 mm"
    noise = Noise(scale=1.816)
    run = make_log(
        "multisine",
        60.0,
        [hidden],
        amplitude=0.9659133288003879,
        seed=620120254,
        settings=settings,
        noise=noise,
        start=0.8411837754962741,
    )
    (cause,) = diagnose(as_log(run)).causes
    assert cause.effect.name == "dcv.stroke_limit"
    assert cause.held_out.gain > 100.0
    x_max, x_min = (cause.parameters[name][0] for name in ("x_max", "x_min"))
    assert (x_max, x_min) == pytest.approx((2.03e-3, -2.01e-3), abs=1e-5)


@pytest.mark.slow
def test_a_parameter_off_its_trust_is_held_against_one_within_it() -> None:
    """Under a prior that the data overwhelm the alternative would have nearly the same value, and chance would decide."""
    (cause,) = diagnosed("continuity.flow_gain", seed=81).causes
    assert cause.effect.name == "continuity.flow_gain"
    assert cause.held_out.gain > 0.2 * cause.gain


@pytest.mark.slow
def test_a_cause_is_not_refuted_by_a_nominal_parameter_bent_far_beyond_its_trust() -> None:
    """A weak lag of the sensor and too large an inertia predict alike; but nothing says why the inertia should be."""
    settings = {
        "dcv.K": 0.002383,
        "dcv.w0": 25.0713,
        "dcv.zeta": 0.5494,
        "continuity.K_c": 5.31166e8,
        "continuity.T": 0.110546,
        "mechanical.J": 762.842,
        "mechanical.b": 26697.0,
    }
    run = make_log(
        "mixed",
        60.0,
        ["sensor.lag:tau_l=4.56 ms"],
        amplitude=0.7516,
        seed=1121629052,
        settings=settings,
        noise=Noise(scale=1.738),
    )
    found = diagnose(as_log(run))
    finding = found.findings["mechanical"]
    bent = finding.null.fit.values["mechanical.J"] / nominal_value("mechanical.J") - 1.0
    assert abs(bent) > BEYOND_TRUST * NOMINAL_TRUST
    (cause,) = found.causes
    assert cause.effect.name == "sensor.lag"
    assert cause.held_out.gain > 0.2 * cause.gain
    assert not found.rests
