"""Readings in steps: nothing is held against a model within a step, and what is beyond it is what the model is off by."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.diagnosis.fitting.noise import plain
from cosim.diagnosis.fitting.rounded import beyond, concentration, outside
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.record.signatures import coarse_step
from cosim.rig import as_log, make_log

RULE = plain(10, 50, demean=True, skip=500)
TIME = np.arange(6000) * 1e-3
STEP = 0.1


def angle(size: float) -> np.ndarray:
    """A motion of a size that a step may be larger than."""
    return size * np.sin(3.0 * TIME) + 0.3 * size * np.sin(17.0 * TIME)


@given(st.floats(-5.0, 5.0), st.floats(1e-3, 2.0))
def test_nothing_is_left_within_a_step_and_all_but_half_a_step_beyond(value: float, step: float) -> None:
    off, slope = (float(x) for x in outside(np.array(value), step))
    assert abs(off) <= max(abs(value) - 0.5 * step, 0.0) + 0.025 * step
    assert abs(off) >= abs(value) - 0.5 * step - 1e-12
    assert off * value >= 0.0
    near = 1e-6 * step
    rise = outside(np.array([value - near, value + near]), step)[0]
    assert slope == pytest.approx((rise[1] - rise[0]) / (2.0 * near), abs=1e-4)


@pytest.mark.parametrize("size", [0.04, 0.3, 5.0])
@pytest.mark.parametrize("rounded", [np.rint, np.floor, np.ceil])
def test_the_true_motion_leaves_next_to_nothing_of_readings_in_steps(size: float, rounded: np.ufunc) -> None:
    readings = STEP * rounded(angle(size) / STEP)
    rows = RULE.layout.rows(beyond(readings - angle(size), STEP, RULE))
    left = rows - rows.mean(axis=1, keepdims=True)  # each window has a free offset
    assert np.sqrt(np.mean(left**2)) < 0.02 * STEP  # the readings themselves are off by 0.29 of a step


@given(st.floats(-2.0, 2.0), st.sampled_from([0.0, 0.04, 0.3, 5.0]))
def test_where_the_axis_goes_from_window_to_window_stays_in_what_is_left(rate: float, size: float) -> None:
    """A model off by a creep of `rate` a second: by less than a step nothing is known, more of it is not lost."""
    motion = angle(size) + rate * TIME
    left = beyond(STEP * np.rint(motion / STEP) - angle(size), STEP, RULE)
    means, there = (RULE.windows(values).mean(axis=1) for values in (left, rate * TIME))
    np.testing.assert_allclose(means, there, atol=1.05 * STEP)
    np.testing.assert_allclose(np.diff(means).sum(), np.diff(there).sum(), atol=1.05 * STEP)


def test_a_motion_that_is_too_large_is_seen() -> None:
    readings = STEP * np.rint(angle(0.3) / STEP)
    few, many = (np.sum(beyond(readings - f * angle(0.3), STEP, RULE) ** 2) for f in (1.0, 1.2))
    assert many > 20.0 * few


def test_noise_is_counted_where_it_judges() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.01, TIME.size)
    readings = STEP * np.rint((angle(0.3) + noise) / STEP)
    assert coarse_step(readings) == pytest.approx(STEP)
    assert concentration(readings - angle(0.3), STEP, RULE) > 2.0
    assert concentration(noise, 1e-9, RULE) == pytest.approx(1.0, abs=1e-3)  # steps this fine are none


@pytest.mark.slow
@pytest.mark.parametrize(
    "measured",
    [("u", "spool", "p_supply", "p_a", "p_b", "slew"), pytest.param(("u", "slew"), marks=pytest.mark.slow)],
)
def test_a_fast_motion_of_a_few_steps_is_no_other_inertia(measured: tuple[str, ...]) -> None:
    """A chirp whose fast part is hardly larger than a step."""
    log = as_log(make_log("chirp", 40.0, ["sensor.quantisation:quantum=0.2 deg"], seed=3))
    found = diagnose(replace(log, signals={n: log.signals[n] for n in measured}))
    assert [c.effect.name for c in found.causes] == ["sensor.quantisation"]
    assert found.verdict == "explained"
