"""Rough numbers of a machine from its own log."""

import numpy as np
import pytest
from scipy.signal import lsim

from cosim.machines.rough import brought_back, swing


def test_a_command_on_one_side_reaches_all_of_it():
    step = np.concatenate([np.zeros(100), np.full(900, 0.5)])
    assert swing(step) == swing(-step) == pytest.approx(0.5)


def test_a_command_on_both_sides_counts_with_the_smaller():
    assert swing(np.concatenate([np.full(500, -0.4), np.full(500, 0.6)])) == pytest.approx(0.4)


def test_a_signal_with_a_bias_counts_with_half_its_range():
    assert swing(np.linspace(60.0, 80.0, 1001)) == pytest.approx(9.8)  # without a hundredth at either end


@pytest.mark.parametrize("damping", [0.02, 0.5])
def test_an_axis_that_its_weight_brings_back_has_its_inertia_from_how_it_swings(damping):
    """A propeller on a pendulum: begun as one that turns on and on, its friction came out 1000 times too large."""
    time = np.arange(4000) * 0.01
    torque = np.where(np.sin(0.7 * time) + np.sin(0.31 * time) > 0.3, 1.5, 0.2)
    system = ([1.0], [0.0125, damping, 2.0])
    _, angle, _ = lsim(system, torque, time, interp=False)
    noise = 5e-3 * np.random.default_rng(3).standard_normal(time.size)
    found = brought_back(time, torque, angle + noise + 0.3)
    assert (found.mass, found.damping, found.stiffness) == pytest.approx((0.0125, damping, 2.0), rel=0.05)


def test_an_axis_that_goes_on_with_its_torque_is_brought_back_by_nothing():
    time = np.arange(4000) * 0.01
    torque = np.sign(np.sin(0.7 * time) + np.sin(0.31 * time))
    _, angle, _ = lsim(([1.0], [0.0125, 0.2, 0.0]), torque, time, interp=False)
    assert brought_back(time, torque, angle) is None
    assert brought_back(time, torque, np.zeros(time.size)) is None
