"""Rough numbers of a machine from its own log."""

import numpy as np
import pytest

from cosim.machines.rough import swing


def test_a_command_on_one_side_reaches_all_of_it():
    step = np.concatenate([np.zeros(100), np.full(900, 0.5)])
    assert swing(step) == swing(-step) == pytest.approx(0.5)


def test_a_command_on_both_sides_counts_with_the_smaller():
    assert swing(np.concatenate([np.full(500, -0.4), np.full(500, 0.6)])) == pytest.approx(0.4)


def test_a_signal_with_a_bias_counts_with_half_its_range():
    assert swing(np.linspace(60.0, 80.0, 1001)) == pytest.approx(9.8)  # without a hundredth at either end
