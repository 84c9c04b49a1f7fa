"""Ends of the travel in a log: how much of the way they took, and that a place counts where they took much of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.diagnosis.model.groups import MODELS, merged
from cosim.diagnosis.pipeline.diagnose import at_its_ends
from cosim.diagnosis.record.ends import lost_at_ends
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.thresholds import LOST_AT_ENDS

STEP, SPEED = 0.01, 0.5  # s, rad/s at full command
FOR = 400  # samples that a command is held


def pushed(seed=1, count=20):
    """(n,) a command that jumps now and then, on both sides."""
    return np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, count), FOR)


def between(command, low=-np.inf, high=np.inf):
    """(n,) where an axis is whose speed follows its command, between two ends."""
    place = np.zeros(command.size)
    for k in range(1, command.size):
        place[k] = np.clip(place[k - 1] + SPEED * STEP * command[k - 1], low, high)
    return place


def test_the_way_lost_is_what_the_ends_took():
    # out and back at full command for 4 s each; the end comes after 3 s of the first
    command = np.concatenate([np.full(400, 1.0), np.full(400, -1.0)])
    place = between(command, high=SPEED * 3.0)
    made, lost = SPEED * (3.0 + 4.0), SPEED * 1.0
    # less what passing through the last hundredth of the travel takes
    assert lost_at_ends(command, place) == pytest.approx(lost / made, rel=0.05)


def test_without_ends_nothing_is_lost():
    command = pushed()
    # where it went farthest it passes a little slower than elsewhere
    assert lost_at_ends(command, between(command)) < 0.1 * LOST_AT_ENDS


def test_a_command_within_the_dead_zone_is_no_end():
    # it stands where it went farthest, though pushed on by less than moves it
    command = np.concatenate([np.full(400, 0.9), np.full(800, 0.3), np.full(400, -0.9)])
    moving = np.where(np.abs(command) > 0.4, command, 0.0)
    assert lost_at_ends(command, between(moving)) == 0.0


def test_a_log_in_which_nothing_moves_loses_nothing():
    assert lost_at_ends(pushed(), np.zeros(20 * FOR)) == 0.0
    assert lost_at_ends(np.ones(2), np.zeros(2)) == 0.0


def test_readings_that_scatter_are_no_end():
    command, rng = pushed(), np.random.default_rng(3)
    place = between(command)
    noise = 0.003 * np.ptp(place) * rng.standard_normal(place.size)
    assert lost_at_ends(command, place + noise) < LOST_AT_ENDS


@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3), st.booleans(), st.floats(-10.0, 10.0))
@settings(max_examples=25, deadline=None)
def test_units_signs_and_zero_do_not_matter(gain, size, reversed_, zero):
    command = pushed()
    place = between(command, -0.3, 0.4)
    there = lost_at_ends(command, place)
    sign = -1.0 if reversed_ else 1.0
    assert there > LOST_AT_ENDS
    assert lost_at_ends(sign * gain * command, size * (place + zero)) == pytest.approx(there, rel=1e-6)


def test_several_logs_are_looked_at_together():
    command = pushed()
    place = between(command, -0.3, 0.4)
    one = lost_at_ends(command, place)
    twice = lost_at_ends(np.tile(command, 2), np.tile(place, 2), (command.size,))
    assert twice == pytest.approx(one, rel=0.02)


@pytest.fixture
def axis():
    return merged(MODELS["full_order"], {"u": 0, "slew": 0})[-1]


def of(command, place):
    return Record(STEP, {"u": command, "slew": place})


def test_where_ends_took_much_of_the_way_the_place_counts(axis):
    command = pushed()
    assert axis.drifts
    assert at_its_ends(axis, of(command, between(command, -0.3, 0.4))).absolute
    assert at_its_ends(axis, of(command, between(command))) is axis


def test_a_signal_that_wanders_is_left_alone(axis):
    command = pushed()
    wandering = replace(axis, drifting=True)
    assert at_its_ends(wandering, of(command, between(command, -0.3, 0.4))) is wandering


def test_without_the_signals_nothing_is_said(axis):
    assert at_its_ends(axis, Record(STEP, {"u": pushed()})) is axis
