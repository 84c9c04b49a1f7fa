"""Slew sensor, (3.2): reading = gain * angle + bias, nominally the angle itself."""

import numpy as np
import pytest
from fmu_bench import bare, run
from hypothesis import given
from hypothesis import strategies as st

BLOCK = bare("sensor")
angles = st.floats(-10.0, 10.0)


@given(st.lists(angles, min_size=1, max_size=20), st.floats(1e-4, 1.0))
def test_nominally_the_angle_itself(theta: list[float], h: float) -> None:
    found = run(BLOCK, h, [0.0]).play([[t] for t in theta])[:, 0]
    assert np.array_equal(found, theta)


@given(angles, st.floats(-2.0, 2.0), st.floats(-1.0, 1.0))
def test_scaling_of_3_2(theta: float, gain: float, bias: float) -> None:
    r = run(BLOCK, 1e-3, [theta], {"gain": gain, "bias": bias})
    assert r.x.slew == r.step(theta)[0] == pytest.approx(gain * theta + bias, rel=1e-14, abs=1e-15)
