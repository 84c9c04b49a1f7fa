"""Coordinates of a search: a sine as sine and cosine, a bounded ratio as what is beyond its least; the same numbers."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.diagnosis.fitting.coordinates import Coordinates
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.rig import as_log, make_log

SCALES = np.array([2.0, 150.0, 5.0, 1.0])
amplitudes = st.floats(1.0, 1e4) | st.floats(-1e4, -1.0)
phases = st.floats(-10.0, 10.0)


@given(amplitudes, phases, st.floats(-3.0, 3.0), st.floats(-5.0, 5.0))
def test_unknowns_come_back_and_change_as_told(
    amplitude: float, phase: float, off: float, other: float
) -> None:
    start = np.array([1.0, np.sign(amplitude), 7.0, phase - off])
    coordinates = Coordinates([(1, 3)], SCALES, start)
    x = np.array([other, amplitude, 7.0 - other, phase])
    z = coordinates.sought(x)
    np.testing.assert_allclose(coordinates.reported(z), x, rtol=1e-9, atol=1e-9)
    size = 1e-6 * float(np.hypot(z[1], z[3]))
    steps = [
        (coordinates.reported(z + d) - coordinates.reported(z - d)) / (2.0 * size * SCALES)
        for d in size * np.eye(4)
    ]
    np.testing.assert_allclose(coordinates.turn(z), np.stack(steps, axis=1), rtol=1e-4, atol=1e-6)


sizes = st.floats(0.0, 1e4)


@given(sizes, sizes, st.floats(0.5, 20.0))
def test_a_size_stays_within_its_share_of_another(size: float, other: float, ratio: float) -> None:
    coordinates = Coordinates([], SCALES, np.ones(4), shares=[(1, 2, ratio)])
    x = np.array([1.0, size, other, 7.0])
    z = coordinates.sought(x)
    assert z[2] >= 0.0
    back = coordinates.reported(z)
    assert back[1] <= ratio * back[2] * (1.0 + 1e-12)
    if size <= ratio * other:
        np.testing.assert_allclose(back, x, rtol=1e-9, atol=1e-9)
    step = np.array([0.3, 2.0, 0.7, -1.0])  # linear: any step will do
    moved = (coordinates.reported(z + step) - back) / SCALES
    np.testing.assert_allclose(coordinates.turn(z) @ step, moved, rtol=1e-6, atol=1e-6)


@given(st.floats(1e-6, 1e6), st.floats(-1e3, 1e3))
def test_an_order_of_magnitude_goes_by_its_logarithm(size: float, other: float) -> None:
    coordinates = Coordinates([], SCALES, np.ones(4), ratios=[1])
    x = np.array([other, size, other, 1.0])
    z = coordinates.sought(x)
    np.testing.assert_allclose(coordinates.reported(z), x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        coordinates.reported(z + np.array([0.0, np.log(2.0), 0.0, 0.0]))[1], 2.0 * size, rtol=1e-9
    )
    low, high = coordinates.bounds(0.1 * np.abs(x) + 1e-9, 10.0 * np.abs(x) + 1e-9)
    assert low[1] < z[1] < high[1]
    step = np.array([0.0, 1e-6, 0.0, 0.0])
    slope = (coordinates.reported(z + step) - coordinates.reported(z - step))[1] / (2e-6 * SCALES[1])
    np.testing.assert_allclose(coordinates.turn(z)[1, 1], slope, rtol=1e-6)


@given(st.floats(0.0, 10.0), st.floats(-3.0, 3.0))
def test_an_amplitude_stays_within_its_bounds(amplitude: float, phase: float) -> None:
    coordinates = Coordinates([(0, 1)], np.array([0.2, 1.0]), np.array([0.3, 0.0]), np.array([0.95, 1e3]))
    found = coordinates.reported(coordinates.sought(np.array([amplitude, phase])))
    assert found[0] == pytest.approx(min(amplitude, 0.95), abs=1e-12)


@given(amplitudes, phases)
def test_a_sine_is_the_same_in_both(amplitude: float, phase: float) -> None:
    coordinates = Coordinates([(0, 1)], np.array([150.0, 1.0]), np.array([amplitude, phase]))
    z = coordinates.sought(np.array([amplitude, phase]))
    angle = np.linspace(-1.0, 1.0, 7)
    sine = 150.0 * (z[0] * np.sin(angle) + z[1] * np.cos(angle))
    np.testing.assert_allclose(amplitude * np.sin(angle + phase), sine, rtol=1e-9, atol=1e-9 * abs(amplitude))


@pytest.mark.slow
def test_gravity_is_found_over_a_small_range_of_angles_with_the_command_alone() -> None:
    hidden = ["mechanical.gravity_load:tau_g=90 N.m,theta_g=30 deg"]
    log = as_log(make_log("multisine", 30.0, hidden, amplitude=0.75, seed=8, start=np.radians(13.0)))
    found = diagnose(replace(log, signals={n: log.signals[n] for n in ("u", "slew")}))
    assert [c.effect.name for c in found.causes] == ["mechanical.gravity_load"]
    (finding,) = found.findings.values()
    assert finding.chosen.fit.settled
