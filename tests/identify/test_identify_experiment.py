"""The source's experiments: its grids, one whole period a frequency, and the rig plays the file."""

import json

import numpy as np
import pytest

from cosim.errors import UsageError
from cosim.identify.experiment import DCV_GRID, GRIDS, SLEW_GRID, ramp, stepped_sine, write_experiment
from cosim.identify.run_design import experiment_of
from cosim.rig import Noise, as_log, make_log
from cosim.rig.excitation import read_command


def test_grids_are_those_of_the_source():
    """SYSTEM section 8: the first 100 of linspace(0.1, 50, 1000); then linspace(5, 70, 100), 195 used."""
    assert SLEW_GRID.size == 100
    assert SLEW_GRID[0] == 0.1
    assert SLEW_GRID[-1] == pytest.approx(5.045, abs=1e-3)
    assert DCV_GRID.size == 195
    assert np.array_equal(DCV_GRID[:100], SLEW_GRID)
    assert DCV_GRID[100] == 5.0
    assert np.diff(DCV_GRID[100:]) == pytest.approx(65.0 / 99.0)
    assert GRIDS["slew"][1] == (1.0, 0.75)
    assert GRIDS["dcv"][1] == (1.0, 0.75, 0.35)


def test_slew_experiment_takes_the_time_its_periods_take():
    made = experiment_of("slew", [], None, 2)
    assert made.duration == pytest.approx(2 * np.sum(2 * np.pi / SLEW_GRID) + 9.0, abs=0.01)
    assert np.abs(made.command).max() == pytest.approx(1.0, abs=1e-4)
    # whole periods come back: 2 A k / w at the lowest frequency is the travel
    assert made.travel == pytest.approx(2 * 2.27 / 0.1, rel=0.01)


def test_periods_follow_each_other_without_a_jump():
    made = stepped_sine("x", [5.0, 11.0, 30.0], (0.5,))
    assert np.abs(np.diff(made.command)).max() <= 0.5 * 30.0 * 1e-3 * 1.01
    t = np.arange(made.command.size) * 1e-3 - 3.0
    first = (t >= 0.0) & (t < 2 * np.pi / 5.0)
    assert np.allclose(made.command[first], 0.5 * np.sin(5.0 * t[first]))
    second = (t >= 2 * np.pi / 5.0) & (t < 2 * np.pi / 5.0 + 2 * np.pi / 11.0)
    assert np.allclose(made.command[second], 0.5 * np.sin(11.0 * (t[second] - 2 * np.pi / 5.0)))


def test_ramp_goes_up_and_down_on_both_sides():
    made = ramp(0.8, 1, 10.0)
    assert made.command.max() == pytest.approx(0.8, abs=1e-3)
    assert made.command.min() == pytest.approx(-0.8, abs=1e-3)
    assert abs(made.command.sum()) * 1e-3 < 1e-2
    moving = made.command[3000:-3000]
    assert np.abs(np.diff(moving)).max() == pytest.approx(4 * 0.8 / 10.0 * 1e-3, rel=1e-6)


def test_file_is_what_the_rig_plays(tmp_path):
    made = stepped_sine("x", [8.0, 20.0], (1.0, 0.35))
    plan = write_experiment(made, tmp_path / "sub" / "x.csv")
    time, u = read_command(tmp_path / "sub" / "x.csv")
    assert time == pytest.approx(np.arange(u.size) * 1e-3, abs=1e-9)
    assert np.abs(u - made.command).max() <= 0.5e-9
    content = json.loads(plan.read_text())
    assert content["frequencies"] == {"value": [8.0, 20.0], "unit": "rad/s"}
    assert content["amplitudes"] == [1.0, 0.35]


def test_a_sine_of_ones_own_keeps_off_the_stops():
    """Through the valve's resonance, where full amplitude drives the spool against them."""
    band = (10.0, 60.0, 30)
    reached = {}
    for amplitudes in ([], [1.0]):
        log = as_log(make_log(experiment_of("sine", amplitudes, band, 2).command, noise=Noise(scale=0.0)))
        reached[tuple(amplitudes)] = np.abs(log["spool"]).max()
    assert reached[()] < 1.30 * 0.75 * 2.375e-3  # amplitude times gain times the largest swing
    assert reached[(1.0,)] > 2.6e-3 - 0.005e-3  # nearer to the stop than the sensor can tell


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("slow", [], None, 2), "'slow' is no experiment: choose slew, dcv, ramp, sine"),
        (("sine", [], None, 2), "needs a band"),
        (("sine", [], (5.0, 1.0, 10), 2), "needs a band"),
        (("sine", [], (5.0, 900.0, 10), 2), "up to 300 rad/s"),
        (("dcv", [1.2], None, 2), "amplitudes must lie within 0 .. 1"),
        (("ramp", [0.5, 1.0], None, 2), "one amplitude"),
        (("ramp", [], None, 0), "one period or more"),
    ],
)
def test_experiments_that_make_no_sense(arguments, message):
    with pytest.raises(UsageError, match=message):
        experiment_of(*arguments)
