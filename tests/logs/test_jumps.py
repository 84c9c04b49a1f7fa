"""Values that jump off and back are told; what a machine does by itself is not."""

import numpy as np
import pytest
from log_files import MEASURED, TOP

from benchmarks.sound_logs import KINDS, sound, told
from cosim.logs import load_log
from cosim.logs.jumps import jumps


def smooth(count=2000):
    random = np.random.default_rng(5)
    time = np.arange(count) / 1000
    return time, 30 * np.sin(5 * time) + random.normal(0, 0.01, count)


def changed(values, at, new):
    values = values.copy()
    values[at] = new
    return values


@pytest.mark.parametrize(
    ("at", "new", "first"),
    [
        (700, 0.0, 700),  # one sample of a moving signal
        (0, 20.0, 0),
        (1999, 0.0, 1999),
        (slice(700, 764), 0.0, 700),  # a sector of a disk
        (slice(1950, 2000), 0.0, 1950),
        (slice(0, 40), -9.0, 0),
        (slice(700, 764), np.linspace(-9, -8, 64), 700),  # from elsewhere in the file
        (slice(700, 764), np.r_[6.0, np.zeros(62), 7.0], 700),  # zeros that begin and end within a number
        (slice(700, 702), 0.0, 700),  # a few bytes
        (slice(700, 703), [3e-310, 0.0, 0.0], 700),
        (slice(700, 709), 90.0, 700),
        (slice(700, 712), [9.8e-319, *np.full(9, 4.67e-57), 14.0, 8.0], 700),  # text read as numbers
        (slice(1990, 2000), 4.67e-57, 1990),
    ],
)
def test_what_jumps_away_is_found(at, new, first):
    time, values = smooth()
    starts, size = jumps(time, changed(values, at, new), held=False)
    assert starts.tolist() == [first]
    assert size > 1


def test_a_number_that_is_next_to_nothing_is_damage_even_in_a_command_that_knows_zero():
    time = np.arange(2000) / 1000
    u = changed(0.6 * np.sign(np.sin(9 * time)), 1, 0.0)
    assert not jumps(time, u, held=True)[0].size
    assert not jumps(time, changed(u, slice(500, 550), 0.0), held=True)[0].size
    assert jumps(time, changed(u, slice(500, 550), 4.67e-62), held=True)[0].tolist() == [500]
    dying = np.exp(-np.arange(2000) / 5.0)
    assert not jumps(time, dying, held=False)[0].size
    sine = np.sin(np.pi * np.arange(2000) / 2)  # 1e-16 in the place of zero
    assert not jumps(time, sine, held=True)[0].size


def test_a_tap_on_a_stick_is_no_damage():
    random = np.random.default_rng(7)
    stick = changed(random.normal(0, 0.001, 2000), slice(700, 705), 0.8)
    time = np.arange(2000) / 20
    assert not jumps(time, stick, held=True)[0].size
    assert jumps(time, stick, held=False)[0].tolist() == [700]


def test_a_small_error_is_found_only_above_the_noise():
    time, values = smooth()
    assert jumps(time, changed(values, 700, values[700] + 0.3), held=False)[0].tolist() == [700]
    assert not jumps(time, changed(values, 700, values[700] + 0.03), held=False)[0].size


@pytest.mark.parametrize(
    "values",
    [
        np.repeat([0.0, 1.0, 0.0, 1.0], 500),  # one step, and back
        np.repeat([0.0, 1.0], 1000),
        np.zeros(2000),
        np.arange(2000) % 2.0,
        np.round(smooth()[1], 0),  # coarse resolution
        np.exp(-np.maximum(0, np.arange(2000) - 900) / 20.0)
        * (np.arange(2000) >= 900),  # a stroke that dies away
        np.random.default_rng(2).normal(0, 1, 2000),
        np.repeat(smooth()[1][::20], 20),  # stale samples
    ],
)
def test_what_a_sound_signal_does_is_not_told(values):
    time = np.arange(2000) / 1000
    assert not jumps(time, values, held=False)[0].size


def test_a_command_may_jump_but_not_for_one_sample():
    time = np.arange(2000) / 1000
    u = 0.6 * np.sign(np.sin(9 * time + 0.1))
    assert not jumps(time, u, held=True)[0].size
    assert jumps(time, changed(u, 500, 0.4), held=True)[0].tolist() == [500]
    assert jumps(time, changed(u, slice(150, 214), 0.0), held=True)[0].tolist() == [150]
    pulses = np.repeat([0.0, 0.6, 0.0, 0.6, 0.0], [400, 200, 100, 200, 1100])  # begins and rests at zero
    assert not jumps(time, pulses, held=True)[0].size


def test_a_switch_or_a_gear_goes_and_comes_back_as_it_likes():
    place = np.arange(2000)
    for values in (place // 130 % 2, 1 + place // 170 % 4, -(place // 200 % 3)):
        assert jumps(place / 1000, values.astype(float), held=False)[0].size == 0


def test_uneven_sampling_is_no_jump():
    random = np.random.default_rng(3)
    time = np.cumsum(random.uniform(0.02, 0.09, 2000))
    assert not jumps(time, np.sin(0.5 * time), held=False)[0].size


def test_the_log_warns_with_place_and_size(load):
    lines = [f"{k / 1000:.3f},{k // 500 % 2},{10 + k * 0.05:.2f}" for k in range(900)]
    lines[400] = "0.400,0,0.00"
    (warning,) = load(lines).warnings
    assert warning == (
        "slew: jumps away once, by up to 30.05 deg (first: row 402): the file or the signal may be damaged there"
    )


def test_what_steps_with_another_column_may_follow_it(load):
    command = np.repeat([0.0, 0.4, 0.1, -0.3, 0.2], 180)
    moved = np.where((np.arange(900) >= 360) & (np.arange(900) < 540), 30.0, 0.0) + 0.05 * np.arange(900)
    lines = [f"{k / 1000:.3f},{command[k]},{10 + moved[k]:.2f}" for k in range(900)]
    (warning,) = load(lines).warnings
    assert warning == (
        "slew: jumps away once, by up to 30.05 deg (first: row 362), where u steps too: it may follow that; else the"
        " file may be damaged there"
    )
    later = [f"{k / 1000:.3f},{command[k - 5]},{10 + moved[k]:.2f}" for k in range(900)]
    (warning,) = load(later).warnings
    assert warning.endswith("the file or the signal may be damaged there")


@pytest.mark.data
@pytest.mark.skipif(not MEASURED.is_dir(), reason="no measured data: set COSIM_DATA to their folder")
@pytest.mark.parametrize("file", ["emps/DATA_EMPS.mat", "emps/DATA_EMPS_PULSES.mat"])
def test_sound_measured_logs_are_left_alone(file):
    assert load_log(MEASURED / file, TOP / "examples" / "mappings" / "emps.toml").warnings == ()


def test_the_synthetic_demonstration_is_left_alone():
    assert not any("jumps" in text for text in load_log(TOP / "examples" / "synthetic_demo.csv").warnings)


def test_a_controller_kicks_where_its_reference_steps():
    """The output of a PID controller jumps for one sample and stays elsewhere afterwards; a lost sample comes back."""
    time = np.arange(2000) / 1000
    command = np.where(time < 0.8, 0.2, 0.35) + 1e-4 * np.sin(900 * time)
    kick = changed(command, 800, 0.9)
    assert jumps(time, kick, held=True)[0].size == 0
    assert jumps(time, changed(command, 500, 0.9), held=True)[0].tolist() == [500]
    assert jumps(time, kick, held=False)[0].size <= 1


def test_a_pulse_of_a_level_that_a_controller_has_is_its_own():
    """A drive that knows 0, 30 and 70 % gives 30 % for one sample; a damaged sample is at a level of its own."""
    time = np.arange(2000) / 50
    levels = np.repeat([0.0, 30.0, 0.0, 70.0, 30.0, 0.0], [300, 200, 500, 300, 300, 400]) / 71.0
    assert jumps(time, changed(levels, 700, 30.0 / 71.0), held=True)[0].size == 0
    assert jumps(time, changed(levels, 700, 0.2), held=True)[0].tolist() == [700]


def test_a_column_that_is_no_signal_tells_why_a_command_kicks(tmp_path):
    """The reference of a controller lies in the file and is not asked for: where it steps the command may kick."""
    time = np.arange(2000) / 1000
    random = np.random.default_rng(6)
    command = changed(0.2 + 0.01 * np.sin(5 * time) + random.normal(0, 1e-3, 2000), 800, 0.9)
    reference = np.where(time < 0.8, 10.0, 25.0)
    mapping = tmp_path / "log.toml"
    mapping.write_text(
        'time = { column = "t", unit = "s" }\n[signals]\nu = { column = "out", unit = "1" }\n',
        encoding="utf-8",
    )
    for head, step in (("t,out,ref,mode", reference), ("t,out,other,mode", 10.0 + 0.1 * time)):
        lines = [f"{a},{b:.6f},{c},on" for a, b, c in zip(time, command, step, strict=True)]
        (tmp_path / "log.csv").write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        (told,) = [text for text in load_log(tmp_path / "log.csv", mapping).warnings if "jumps away" in text]
        assert ("where 'ref' steps too: it may follow that" in told) == ("ref" in head)


def commanded(count=8000, rate=1000.0, seed=3):
    """A hand on a stick that holds it still for 0.15 s; a second-order machine of 3 Hz that follows it, with noise."""
    random = np.random.default_rng(seed)
    time = np.arange(count) / rate
    hand = np.convolve(random.normal(0, 1, count), np.exp(-np.arange(300) / 50) / 10)[:count]
    command = np.convolve(hand, np.full(30, 1 / 30), "same")
    command[3800:3950] = 1.5
    speed, place, follows = 0.0, 0.0, []
    for u in command:
        speed += ((2 * np.pi * 3) ** 2 * (u - place) - 2 * np.pi * 3 * speed) / rate
        place += speed / rate
        follows.append(place)
    return time, command, np.array(follows) + random.normal(0, 0.005, count)


def test_a_hold_that_the_machine_answers_was_commanded():
    time, command, follows = commanded()
    assert jumps(time, command, held=True)[0].tolist() == [3800]
    assert jumps(time, command, held=True, others=[follows])[0].size == 0


@pytest.mark.parametrize("foreign", [1.5, -1.5])
def test_a_hold_that_the_machine_does_not_answer_is_told(foreign):
    """The machine went on with the hand: what the file holds of the command there is not what was commanded."""
    time, command, follows = commanded()
    command = changed(command, slice(6000, 6150), foreign)
    assert jumps(time, command, held=True, others=[follows])[0].tolist() == [6000]


def test_a_reading_that_follows_a_command_at_once_jumps_with_it_and_no_other_way():
    time, command, follows = commanded()
    current = 2 * command + np.random.default_rng(4).normal(0, 1e-3, time.size)
    assert jumps(time, current, held=False, others=[command, follows])[0].size == 0
    lost = changed(current, slice(6000, 6150), 3.0)
    assert jumps(time, lost, held=False, others=[command, follows])[0].tolist() == [6000]


def test_a_signal_that_jumps_as_far_elsewhere_and_stays_there_jumps_by_itself():
    time = np.arange(4000) / 200
    sine = 0.2 * np.sin(3 * time)
    away = np.where((time > 5) & (time < 5.5), 0.5, 0.0)
    assert jumps(time, sine + away, held=False)[0].tolist() == [1001]
    assert jumps(time, sine + away + 0.6 * (time > 12), held=False)[0].size == 0
    assert jumps(time, sine + away + 0.1 * (time > 12), held=False)[0].tolist() == [1001]


def test_a_command_may_stand_as_a_log_begins_and_ends():
    time = np.arange(4000) / 200
    command = np.where((time > 0.6) & (time < 19.5), 0.5 + 0.2 * np.sin(3 * time), 0.0)
    assert jumps(time, command, held=True)[0].size == 0
    assert jumps(time, command, held=False)[0].tolist() == [0, 3900]


def test_sound_logs_of_stepping_commands_are_seldom_called_damaged():
    """Before signals were asked about one another one log in twenty was."""
    found = {log.kind: told(log, log.signals) for log in sound(len(KINDS), seed=26)}
    assert not any(found.values()), found
