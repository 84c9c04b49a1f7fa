"""Excitations stay within -1 .. 1, come back, repeat with their seed, and are what they are called."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.errors import DataError, UsageError
from cosim.rig import excitation, make_log
from cosim.rig.excitation import EXCITATIONS, MIXED_SECTIONS, SOURCE_FREQUENCIES, command
from cosim.rig.parameters import DEG


def grid(seconds):
    return np.arange(round(seconds * 1000) + 1) * 1e-3


@settings(max_examples=40, deadline=None)
@given(
    name=st.sampled_from(sorted(EXCITATIONS)),
    seconds=st.integers(21, 200),
    amplitude=st.floats(0.0, 1.0),
    seed=st.integers(0, 10_000),
)
def test_laws_of_every_excitation(name, seconds, amplitude, seed):
    time = grid(seconds)
    u = command(name, time, amplitude, seed)
    assert np.max(np.abs(u)) <= amplitude
    assert np.array_equal(u, command(name, time, amplitude, seed))
    if name != "chirp":  # a chirp ends where it ends
        assert abs(np.sum(u) * 1e-3) < 0.15 * amplitude + 1e-12  # 1/3 deg of slew


@pytest.mark.parametrize("name", ["steps", "small_steps"])
def test_steps_hold_their_value_long_enough(name):
    u = command(name, grid(60), 1.0, 3)
    edges = np.flatnonzero(np.diff(u)) + 1
    levels = u[edges[:-1]]
    lengths = np.diff(edges)[levels != 0.0]
    assert lengths.min() >= 500
    assert np.unique(np.abs(levels)).size > 8
    assert np.max(np.abs(u)) <= (1.0 if name == "steps" else 0.2)


def test_sweep_is_one_whole_period_of_each_frequency_of_the_source():
    wanted = [SOURCE_FREQUENCIES[i] for i in (10, 40, 100)]
    time = grid(30)
    u = excitation.sweep(time, 0.75, frequencies=wanted)
    start = 0.0
    for w in wanted:
        part = (time >= start) & (time < start + 2 * np.pi / w)
        assert np.allclose(u[part], 0.75 * np.sin(w * (time[part] - start)), atol=1e-12)
        start += 2 * np.pi / w
    assert np.all(u[time > start] == 0.0)
    chosen = excitation.sweep_frequencies(60.0)
    assert np.all(np.isin(chosen, SOURCE_FREQUENCIES))
    assert 40.0 < np.sum(2 * np.pi / chosen) <= 60.0


def test_square_is_the_sign_of_the_sweep():
    time = grid(30)
    u = excitation.square(time, 0.35)
    assert set(np.unique(u)) == {-0.35, 0.0, 0.35}
    assert np.array_equal(u, 0.35 * np.sign(excitation.sweep(time)))
    periods = excitation.sweep_frequencies(30.001)
    assert np.count_nonzero(np.diff(u) < -0.5) == periods.size, "one fall from plus to minus a period"


def test_triangle_is_slow_and_straight():
    u = command("triangle", grid(40), 0.9, 1)
    slope = np.diff(u) / 1e-3
    assert np.allclose(
        np.abs(slope[np.abs(np.diff(slope, prepend=slope[0])) < 1e-6]), 4 * 0.9 / 20, rtol=1e-3
    )
    assert np.isclose(u.max(), 0.9, atol=1e-3)


def test_multisine_stays_in_its_band():
    u = excitation.multisine(grid(30)[:-1], 1.0, 5, band=(1.0, 10.0))
    spectrum = np.abs(np.fft.rfft(u))
    w = 2 * np.pi * np.fft.rfftfreq(u.size, 1e-3)
    outside = (w < 0.95) | (w > 10.1)
    assert np.max(spectrum[outside]) < 1e-6 * np.max(spectrum)
    assert np.max(np.abs(u)) == pytest.approx(1.0)


def test_mixed_has_all_sections():
    time = grid(60)
    u = command("mixed", time, 1.0, 1)
    share = 59.5 / len(MIXED_SECTIONS)
    for i, name in enumerate(MIXED_SECTIONS):
        part = u[round((0.5 + i * share) * 1000) : round((0.5 + (i + 1) * share) * 1000)]
        assert np.ptp(part) > (0.1 if name == "small_steps" else 1.0)
        assert part[-1] == 0.0


@pytest.mark.parametrize("name", sorted(EXCITATIONS))
def test_angle_stays_in_the_sensors_range(name):
    run = make_log(name, 60.0, noise=0)
    assert run.notes == []
    assert -20 * DEG < run.slew.min() < 12 * DEG < run.slew.max() < 270 * DEG


def test_leaving_the_range_is_said():
    run = make_log(np.full(200_000, 1.0), noise=0)
    assert "leaves the sensor's range" in run.notes[0]


def test_played_file_is_held(tmp_path):
    path = tmp_path / "u.csv"
    path.write_text("time [s],u [1]\n5.0,0.5\n5.1,-0.5\n5.2,0\n")
    u = make_log("file", 0.3, command_file=path, noise=0).u
    assert np.all(u[:100] == 0.5)
    assert np.all(u[100:200] == -0.5)
    assert np.all(u[200:] == 0.0)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("time [s],u [1]\n0,0\n1,1.5\n", "row 3.*outside"),
        ("time [s],u [1]\n0,0\n1,x\n", "row 3"),
        ("time [s],u [1]\n0,0\n0,1\n", "row 3.*rise"),
        ("time [s],v [1]\n0,0\n", r"u \[1\]"),
        ("time [s],u [1]\n", "no rows"),
        ("", "CSV"),
    ],
)
def test_bad_command_files_are_named_by_row(tmp_path, text, word):
    path = tmp_path / "u.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=word):
        make_log("file", 1.0, command_file=path)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"excitation": "mixt"}, "mixed"),
        ({"amplitude": 1.2}, "amplitude"),
        ({"duration": 0.0}, "duration"),
        ({"duration": 1.00005}, "milliseconds"),
        ({"duration": float("nan")}, "duration"),
        ({"duration": 5.0}, "mixed"),
        ({"excitation": "sweep", "duration": 0.1}, "sweep"),
        ({"excitation": "multisine", "duration": 0.1}, "harmonic"),
        ({"excitation": "file"}, "--input"),
        ({"excitation": np.array([2.0, 0.0])}, "-1"),
        ({"excitation": np.array([np.nan, 0.0])}, "-1"),
        ({"excitation": np.zeros((2, 2))}, "row"),
    ],
)
def test_bad_requests_are_refused(options, word):
    with pytest.raises(UsageError, match=word):
        make_log(**options)
