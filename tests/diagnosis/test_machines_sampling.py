"""Logs are judged at their own samples, however uneven."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_logs import only
from hypothesis import given
from hypothesis import strategies as st

from cosim.diagnosis.answer.remarks import notes
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.record.grid import Grid, grid_of
from cosim.rig import as_log, make_log


def test_a_fast_even_log_needs_no_grid() -> None:
    grid, interval = grid_of(np.arange(1000) * 1e-3)
    assert grid is None
    assert interval == 1e-3


def test_a_slow_even_log_is_simulated_in_whole_parts_of_its_interval() -> None:
    grid, interval = grid_of(3.0 + np.arange(50) * 0.05, step=0.02)
    assert grid is not None
    assert interval == 0.05
    assert interval / grid.step == pytest.approx(3.0)
    rows = np.sin(grid.time)
    assert np.array_equal(grid.sampled(rows), rows[::3])


@given(
    st.lists(st.floats(0.011, 0.2), min_size=3, max_size=30),
    st.integers(0, 2**32 - 1),
)
def test_a_held_command_hands_over_all_that_it_is(intervals: list[float], seed: int) -> None:
    stamps = np.concatenate([[0.0], np.cumsum(intervals)])
    values = np.random.default_rng(seed).normal(size=stamps.size)
    grid = Grid(stamps, 5e-3)
    driven = grid.driven(values, held=True)
    # its integral to the last stamp is that of the steps: no command is lost between samples
    whole = float(values[:-1] @ np.diff(stamps))
    beyond = (grid.time[-1] - stamps[-1]) * values[-1]
    assert float(driven[:-1].sum()) * grid.step == pytest.approx(whole + beyond, abs=1e-9)
    assert driven.min() >= values.min() - 1e-9
    assert driven.max() <= values.max() + 1e-9


def test_a_straight_line_is_read_at_the_stamps() -> None:
    stamps = np.array([0.0, 0.013, 0.09, 0.117, 0.2])
    grid = Grid(stamps, 1e-2)
    line = 2.0 + 3.0 * stamps
    assert grid.sampled(grid.driven(line, held=False))[:-1] == pytest.approx(line[:-1])


def test_the_drive_at_uneven_samples_is_that_of_a_fine_simulation() -> None:
    rng = np.random.default_rng(4)
    stamps = np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.09, 400))])
    values = 0.5 * np.sign(np.sin(0.7 * stamps))
    (group,) = MODELS["simplified"]
    uneven = GroupModel(group, values, 0.055, {}, Grid(stamps, 1e-3)).simulate({})["slew"]
    fine = np.arange(0.0, stamps[-1], 1e-4)
    held = values[np.searchsorted(stamps, fine + 1e-9, "right") - 1]
    exact = GroupModel(group, held, 1e-4, {}).simulate({})["slew"]
    # the compensator sees the mean over a step in which the command changes: 1 ms at most per change
    assert np.max(np.abs(uneven[:-1] - np.interp(stamps[:-1], fine, exact))) < 2e-3 * np.ptp(exact)


@pytest.mark.parametrize("held", [pytest.param(True, marks=pytest.mark.slow), False])
def test_a_command_logged_more_rarely_than_it_changes_lies_on_straight_lines(held: bool) -> None:
    """The rig's controller acts every millisecond; the log has every tenth."""
    log = as_log(make_log("multisine", 12.0, ["dcv.delay:tau_d=20 ms"], seed=12))
    signals = {name: values[::10] for name, values in log.signals.items()}
    kept = log.held if held else log.held - {"u"}
    found = diagnose(replace(log, time=log.time[::10], signals=signals, held=kept), model=only("dcv"))
    assert [c.effect.name for c in found.causes] == ["dcv.delay"]
    # held for 10 ms instead of 1 ms the command seems late by half of the difference
    late = 4.5e-3 if held else 0.0
    assert found.causes[0].parameters["tau_d"][0] == pytest.approx(20e-3 - late, abs=5e-4)
    (note,) = notes(found, (log,))
    assert ("held = false" in note) == held
