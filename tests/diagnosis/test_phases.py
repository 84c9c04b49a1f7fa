"""A sine is told in its usual spelling: positive amplitude, phase within half a turn; it stays the same sine."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.phases import usual, usually_spelled
from cosim.diagnosis.fitting.trials import Trial
from fmus import registry

GRAVITY = registry.effects()["mechanical.gravity_load"]


@given(st.floats(-1e4, 1e4), st.floats(-50.0, 50.0), st.floats(-4.0, 4.0))
def test_the_torque_stays_the_same(amplitude: float, rest: float, angle: float) -> None:
    told = usual(GRAVITY, {"tau_g": amplitude, "theta_g": rest})
    assert told["tau_g"] >= 0.0
    assert abs(told["theta_g"]) <= math.pi
    torque = amplitude * math.sin(angle - rest)
    assert told["tau_g"] * math.sin(angle - told["theta_g"]) == pytest.approx(
        torque, abs=1e-9 * abs(amplitude)
    )
    assert usual(GRAVITY, told) == pytest.approx(told)


def test_an_effect_without_phase_is_left_alone() -> None:
    load = registry.effects()["mechanical.constant_load"]
    assert usual(load, {"tau_load": -3.0}) == {"tau_load": -3.0}


def test_the_covariance_turns_with_the_amplitude() -> None:
    names = ["mechanical.J", "mechanical.tau_g", "mechanical.theta_g"]
    values = dict(zip(names, (764.0, -100.0, 0.5), strict=True))
    covariance = np.array([[4.0, 1.0, 0.1], [1.0, 9.0, 0.2], [0.1, 0.2, 1.0]])
    slopes = np.arange(6.0).reshape(2, 3)
    found = Fit(values, dict.fromkeys(names, 1.0), -10.0, 50, {}, covariance, slopes=slopes)
    told = usually_spelled(Trial((GRAVITY,), found, 2)).fit
    assert list(told.values.values()) == pytest.approx([764.0, 100.0, 0.5 - math.pi])
    assert told.covariance.tolist() == [[4.0, -1.0, 0.1], [-1.0, 9.0, -0.2], [0.1, -0.2, 1.0]]
    assert told.slopes is not None
    assert told.slopes.tolist() == [[0.0, -1.0, 2.0], [3.0, -4.0, 5.0]]


def test_an_amplitude_of_zero_turns_nothing() -> None:
    values = {"mechanical.tau_g": 0.0, "mechanical.theta_g": 0.5}
    covariance = np.array([[9.0, 0.2], [0.2, 1.0]])
    found = Fit(values, dict.fromkeys(values, 1.0), -10.0, 50, {}, covariance)
    assert usually_spelled(Trial((GRAVITY,), found, 2)).fit.covariance.tolist() == covariance.tolist()
