"""Held-out windows refute what they contradict, and nothing that only they show."""

import pytest

from cosim.diagnosis.story import diagnose
from cosim.rig import Noise, as_log, make_log


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
    assert cause.held_out > 100.0
    x_max, x_min = (cause.parameters[name][0] for name in ("x_max", "x_min"))
    assert (x_max, x_min) == pytest.approx((2.03e-3, -2.01e-3), abs=1e-5)
