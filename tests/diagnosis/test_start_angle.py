"""A log that starts far from angle zero: what is wrong with the sensor is wrong with the first reading too."""

import numpy as np
import pytest

from cosim.diagnosis.fitting.group_model import standing
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import as_log, as_tracker, make_log

START = np.radians(50.0)


@pytest.mark.slow
@pytest.mark.parametrize("tracked", [False, True])
def test_the_scale_of_the_sensor_is_the_one_that_the_whole_chain_bears_out(tracked: bool) -> None:
    run = make_log("mixed", 40.0, ["sensor.gain:gain=1.08"], seed=6, start=START, tracker=True)
    found = diagnose(as_log(run), tracker=as_tracker(run) if tracked else None)
    named = {n for c in found.causes for n in (c.effect.name, *c.indistinguishable)}
    assert "sensor.gain" in named
    if "sensor.gain" in found.values:
        assert found.values["sensor.gain"] == pytest.approx(1.08, rel=0.01)
        assert standing(found.start, found.values)["mechanical.theta_0"] == pytest.approx(START, rel=0.01)
    else:
        assert found.values["mechanical.b"] == pytest.approx(26661.5 / 1.08, rel=0.02)
