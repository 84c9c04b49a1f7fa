"""The static curve of a drive from its logs: what is put in comes out, and intervals hold from log to log."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from cosim.api.identifying import dead_zone_of
from cosim.errors import DataError
from cosim.identify import drive_fit
from cosim.identify.answer import finish
from cosim.identify.drive_curve import NAMES, OF_ITS_OWN, SCATTER, Estimate, drive_curve, next_log
from cosim.identify.drive_fit import Run, static
from cosim.identify.drive_held_out import predicted
from cosim.identify.run_drive import Told, drive_answer, sentences
from cosim.logs import load_log, load_mapping

# dead zone, slopes, top speeds
TRUTH = np.array([-0.2, 0.25, 1.4, 1.8, -0.75, 0.8])
LAG, STEP, FINE = 0.1, 0.05, 10


def made(seed, truth=TRUTH, *, seconds=100.0, noise=1e-3, shared=0.0):
    """A log of a drive whose operator moves a lever; `shared`: part of the time in which others take half of its flow."""
    rng = np.random.default_rng(seed)
    h = STEP / FINE
    count = int(seconds / STEP)
    held = np.repeat(rng.uniform(-1.0, 1.0, count // 30 + 1), 30)[:count]
    still = np.repeat(rng.random(count // 30 + 1) < 0.3, 30)[:count]
    command = np.where(still, 0.0, held)
    asked = static(np.repeat(command, FINE), truth)
    taken = np.repeat(rng.random(count // 60 + 1) < shared, 60 * FINE)[: asked.size]
    kept = np.exp(-h / LAG)
    speed = lfilter([0.0, 1.0 - kept], [1.0, -kept], np.where(taken, 0.5, 1.0) * asked)
    position = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * h)])[::FINE]
    return Run(f"log {seed}", STEP * np.arange(count), command, position + noise * rng.standard_normal(count))


def test_the_numbers_come_out():
    found = drive_curve([made(1)])
    for name, truth in zip(NAMES, TRUTH, strict=True):
        one = found.values[name]
        assert one.value == pytest.approx(truth, rel=0.02)
        assert one.low < truth < one.high
    assert found.lag + found.delay == pytest.approx(LAG, rel=0.05)
    # the free curve knows nothing of the seven numbers
    assert np.interp([-0.6, 0.0, 0.55, 0.9], found.knots, found.speeds) == pytest.approx(
        static(np.array([-0.6, 0.0, 0.55, 0.9]), TRUTH), abs=0.02
    )


def step_of(level, seed, *, noise=1e-3):
    """A log of one step of the command, too short for a curve of its own: half a second of rest, then motion."""
    count, h = int(6.0 / STEP), STEP / FINE
    command = np.where(np.arange(count) * STEP < 0.5, 0.0, level)
    kept = np.exp(-h / LAG)
    speed = lfilter([0.0, 1.0 - kept], [1.0, -kept], static(np.repeat(command, FINE), TRUTH))
    position = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * h)])[::FINE]
    position += noise * np.random.default_rng(seed).standard_normal(count)
    return Run(f"step to {level}", STEP * np.arange(count), command, position)


def test_logs_of_one_step_each_tell_the_curve_together():
    levels = (-0.6, -0.5, -0.35, 0.4, 0.5, 0.6)
    found = drive_curve([step_of(level, k) for k, level in enumerate(levels)])
    assert set(found.values) == {
        "dead_low",
        "dead_high",
        "slope_low",
        "slope_high",
    }  # no top speed is reached
    for name, one in found.values.items():
        truth = TRUTH[NAMES.index(name)]
        assert one.value == pytest.approx(truth, rel=0.03)
        assert one.low < truth < one.high
    assert found.names == tuple(f"step to {level}" for level in levels)
    # the free curve claims no bend between the levels that were driven
    assert found.knots == pytest.approx([*levels[:3], 0.0, *levels[3:]])
    assert found.speeds == pytest.approx(static(found.knots, TRUTH), abs=0.02)


@pytest.mark.parametrize("levels", [(0.6, 0.6), (0.6, -0.6), (0.6, 0.6, 0.6)])
def test_one_level_a_side_tells_no_dead_zone(levels):
    with pytest.raises(DataError, match="at least two levels of each direction together"):
        drive_curve([step_of(level, k) for k, level in enumerate(levels)])


def test_a_side_with_one_level_is_left_out():
    found = drive_curve([step_of(level, k) for k, level in enumerate((-0.6, 0.4, 0.5, 0.6))])
    assert set(found.values) == {"dead_high", "slope_high"}


def test_stretches_that_are_none_of_the_curve_do_not_bend_it():
    found = drive_curve([made(2, shared=0.15)])
    for name in ("top_low", "top_high"):
        assert found.values[name].value == pytest.approx(TRUTH[NAMES.index(name)], rel=0.03)
    for name in ("dead_low", "dead_high"):
        assert found.values[name].value == pytest.approx(TRUTH[NAMES.index(name)], abs=0.03)


@pytest.mark.slow
def test_a_drive_on_a_spring_has_no_curve_of_its_own():
    """A command turns it to a place, where it swings; of a drive whose speed it sets little is left."""
    rng = np.random.default_rng(9)
    command = np.repeat(rng.uniform(-1.0, 1.0, 50), 200)
    h, place, speed, row = 0.01, 0.0, 0.0, []
    for u in command:
        speed += h * (100.0 * (u - place) - 1.0 * speed)
        place += h * speed
        row.append(place)
    swung = Run("swung", h * np.arange(command.size), command, np.array(row))
    with pytest.raises(
        DataError, match=r"swung: the curve leaves \d+ % of how the speed varies: the command does not set"
    ):
        drive_curve([swung])
    assert drive_curve([made(1)]).left < 0.5 * OF_ITS_OWN


def test_what_a_curve_leaves_is_held_against_all_speeds() -> None:
    """A loop closed around a cylinder: its command is held at rest only, and it moves while that falls to the dead zone."""
    reference = np.cumsum(np.repeat([0.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0], 1)).repeat(
        1000
    )
    h, speed, place, commands, places = STEP / FINE, 0.0, 0.0, [], []
    for k in range(reference.size):
        u = float(np.clip(0.9 * (reference[k] - place), -1.0, 1.0))
        commands.append(u)
        places.append(place)
        goal = float(static(np.array([u]), TRUTH)[0])
        for _ in range(FINE):
            speed += (goal - speed) * h / LAG
            place += speed * h
    noise = 1e-4 * np.random.default_rng(4).standard_normal(reference.size)
    found = drive_curve(
        [Run("loop", STEP * np.arange(reference.size), np.array(commands), np.array(places) + noise)]
    )
    assert found.left < 0.05


def test_intervals_hold_for_the_next_log():
    """Four machines whose dead zones and slopes differ from day to day, five logs each known."""
    rng = np.random.default_rng(8)
    spread = np.array([0.02, 0.02, 0.1, 0.1, 0.01, 0.01])
    inside = []
    for machine in range(4):
        logs = [
            made(10 * machine + k + 100, TRUTH + spread * rng.standard_normal(6), seconds=60.0)
            for k in range(5)
        ]
        each = [drive_curve([log]).each[0] for log in logs]
        for left, one in enumerate(each):
            for name in NAMES:
                others = [e.values[name] for k, e in enumerate(each) if k != left and name in e.values]
                if name in one.values and len(others) > 2:
                    told = next_log(others, SCATTER[name.partition("_")[0]])
                    inside.append(told.low <= one.values[name].value <= told.high)
    assert len(inside) > 100
    # at 95 % fewer than 88 % of some 110 are as rare as one in four hundred, were they independent
    assert np.mean(inside) > 0.88


def test_several_logs_scatter_and_one_does_not_hide_it():
    same = [Estimate(1.0, 0.01, 0.0, 0.0)] * 4
    apart = [Estimate(v, 0.01, 0.0, 0.0) for v in (0.8, 0.9, 1.1, 1.2)]
    wide, narrow = next_log(apart, 0.1), next_log(same, 0.1)
    assert wide.high - wide.low > 5.0 * (narrow.high - narrow.low)
    assert wide.low < 0.8
    assert wide.high > 1.2
    alone = next_log(same[:1], 0.1)
    assert alone.high - 1.0 == pytest.approx(
        2.262 * np.sqrt(2.0) * np.hypot(0.01, 0.1), rel=1e-3
    )  # Student's t, nine degrees


@pytest.mark.parametrize(("values", "holds"), [((0.23, 0.24), 0.5), ((0.20, 0.28), 1.0), ((0.1, 0.4), 1.4)])
def test_two_logs_are_not_as_if_nothing_were_known_of_how_drives_scatter(values, holds):
    """Student's t of one degree made a dead zone of 0.23 and 0.24 "0 to 0.57" for the next log."""
    told = next_log([Estimate(v, 0.015, 0.0, 0.0) for v in values], SCATTER["dead"])
    assert told.low < values[0]
    assert told.high > values[1]
    assert (told.high - told.low) / (2.0 * told.value) < holds


def test_a_top_speed_that_is_not_reached_is_not_told():
    run = made(3, np.array([-0.2, 0.25, 0.5, 0.5, -0.75, 0.8]))  # 0.5 (1 - 0.25) is below 0.8
    assert set(drive_curve([run]).values) == {"dead_low", "dead_high", "slope_low", "slope_high"}


def test_a_side_that_is_not_driven_is_not_told():
    run = made(4)
    one = Run(run.name, run.time, np.maximum(run.command, 0.0), run.position)
    moved = np.concatenate([[0.0], np.cumsum(static(one.command, TRUTH) * STEP)[:-1]])
    found = drive_curve([Run(run.name, run.time, one.command, moved)])
    assert set(found.values) == {"dead_high", "slope_high", "top_high"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: Run(r.name, r.time, -r.command, r.position), "against the command"),
        (lambda r: Run(r.name, r.time, 0.0 * r.command, r.position), "the command never moves"),
        (lambda r: Run(r.name, r.time[:50], r.command[:50], r.position[:50]), "too short"),
    ],
)
def test_logs_that_tell_nothing_are_refused(change, words):
    with pytest.raises(DataError, match=words):
        drive_curve([change(made(5))])


MAPPING = """
time = { column = "t", unit = "s" }
[signals]
u = { column = "duty", unit = "1", zero = 7.5, gain = 0.4 }
slew = { column = "angle", unit = "rad" }
"""


def test_the_dead_zone_is_told_as_it_stands_in_the_log(tmp_path: Path):
    run = made(6)
    (tmp_path / "m.toml").write_text(MAPPING)
    table = np.column_stack([run.time, 7.5 + run.command / 0.4, run.position])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,duty,angle", comments="", fmt="%.9g")
    mapping = load_mapping(tmp_path / "m.toml")
    log = load_log(tmp_path / "log.csv", mapping)
    answer = drive_answer([log], mapping, None, None)
    found = json.loads(json.dumps(answer.data["drive_curve"]))
    high = found["dead_zone"]["high"]
    assert high["value"] == pytest.approx(0.25, abs=0.01)
    assert high["reading"]["column"] == "duty"
    assert high["reading"]["value"] == pytest.approx(7.5 + 0.25 / 0.4, abs=0.03)
    low, top = high["reading"]["ci95"]
    assert low < high["reading"]["value"] < top
    unit = found["top_speed"]["low"]["unit"]
    assert found["top_speed"]["low"]["value"] == pytest.approx(
        {"deg/s": np.degrees(-0.75), "rad/s": -0.75}[unit], rel=0.02
    )
    assert answer.draw is not None
    assert len(answer.draw().axes) == 1
    dead, slope, top, how_sure = answer.summary()[:4]
    value, reading = found["dead_zone"]["high"]["value"], high["reading"]["value"]
    assert re.fullmatch(
        rf"Dead zone: nothing moves for a command u from -0\.\d+ \(.*\) to {value:.3g} \(\S+ to \S+\); "
        rf"in the log's column 'duty' from \S+ to {reading:.4g}",
        dead,
    )
    assert slope.startswith("Slope beyond it: ")
    assert slope.endswith(f"{unit} per unit of the command")
    assert top.endswith(unit)
    assert "95 % intervals, which hold for the next log" in how_sure


def test_the_answer_is_in_words_and_the_table_on_demand(tmp_path: Path, capsys):
    run = made(6)
    table = np.column_stack([run.time, run.command, np.degrees(run.position)])
    np.savetxt(
        tmp_path / "log.csv",
        table,
        delimiter=",",
        header="time [s],u [1],slew [deg]",
        comments="",
        fmt="%.9g",
    )
    answer = drive_answer([load_log(tmp_path / "log.csv")], None, None, None)
    finish(answer, None, as_json=False, verbose=False)
    said = capsys.readouterr().out
    assert said.startswith("Dead zone: nothing moves for a command u from ")
    assert "in the log's column" not in said  # it reads as the command
    assert "Next: name more logs" in said
    assert "95 % from" not in said
    finish(answer, None, as_json=False, verbose=True)
    assert "95 % from" in capsys.readouterr().out


LINEAR = """
time = { column = "t", unit = "s" }
[signals]
u = { column = "duty", unit = "1" }
travel = { column = "way", unit = "m" }
[signals.pressure]
column = "p"
unit = "bar"
"""


MACHINE = """
[machine]
chain = ["dead_zone", "dcv", "continuity", "mechanical", "sensor"]
speed = "?"
lag = "?"
"""


def test_the_dead_zone_of_a_machine_is_that_of_its_static_curve(tmp_path: Path):
    """Not what the crane's compensator and chain would make of its command; and no model of the crane takes it."""
    run = made(6, seconds=60.0)
    (tmp_path / "m.toml").write_text(MAPPING + MACHINE)
    table = np.column_stack([run.time, 7.5 + run.command / 0.4, run.position])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,duty,angle", comments="", fmt="%.9g")
    log = load_log(tmp_path / "log.csv", tmp_path / "m.toml")
    answer = dead_zone_of([log], tmp_path / "m.toml", [])
    found = answer.data["dead_zone"]
    for side, truth in (("low", -0.2), ("high", 0.25)):
        assert found[side]["value"] == pytest.approx(truth, abs=0.01)
        assert found[side]["ci95"][0] < truth < found[side]["ci95"][1]
    assert answer.parameters == {}
    held_out = answer.data["held_out"]
    assert held_out["error"] < 0.05 * held_out["spread"]
    assert held_out["without_dead_zone"] > 3.0 * held_out["error"]
    assert answer.lines[-1].startswith("How well it fits: of 10 parts of the log")
    assert re.match(r"Next: cosim diagnose \S+log.csv --mapping \S+m.toml --calibrate ", answer.next_step({}))


def test_a_drive_without_a_dead_zone_is_predicted_as_well_without_one():
    run = made(7, np.array([-1e-9, 1e-9, 1.4, 1.8, -0.75, 0.8]), seconds=60.0)
    found = predicted([run], LAG)
    assert found.without == pytest.approx(found.error, rel=0.05)
    assert found.told > 95.0


def test_the_one_signal_beside_the_command_is_the_motion(tmp_path: Path):
    """A cylinder's position is called by another name than the crane's angle."""
    run = made(6)
    table = np.column_stack([run.time, run.command, run.position, 100.0 + run.command])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,duty,way,p", comments="", fmt="%.9g")
    (tmp_path / "one.toml").write_text(LINEAR.partition("[signals.pressure]")[0])
    (tmp_path / "two.toml").write_text(LINEAR)
    one, two = (load_mapping(tmp_path / f"{name}.toml") for name in ("one", "two"))
    found = drive_answer([load_log(tmp_path / "log.csv", one)], one, None, None).data["drive_curve"]
    assert found["motion"]["signal"] == "travel"
    assert found["dead_zone"]["high"]["value"] == pytest.approx(0.25, abs=0.01)
    log = load_log(tmp_path / "log.csv", two)
    with pytest.raises(DataError, match="--motion travel or pressure"):
        drive_answer([log], two, None, None)
    named = drive_answer([log], two, None, "travel").data["drive_curve"]
    assert named["dead_zone"] == found["dead_zone"]


def test_a_side_that_is_not_known_is_left_out_of_the_words():
    run = made(3, seconds=200.0)
    curve = drive_curve([run])
    known = {name: e for name, e in curve.values.items() if not name.endswith("_low") and name != "top_high"}
    lines = sentences(replace(curve, values=known), Told("u", "slew", "1", "deg/s"))
    assert len(lines) == 3
    assert "for a command u to 0.2" in lines[0]
    assert "below" not in lines[1]


def test_a_dead_zone_that_is_none_is_not_given_as_a_tiny_one():
    curve = drive_curve([made(3, seconds=200.0)])
    tiny = {n: Estimate(1e-10, 1e-8, -4e-8, 1.5e-3) for n in ("dead_low", "dead_high")}
    lines = sentences(replace(curve, values={**curve.values, **tiny}), Told("u", "slew", "1", "deg/s"))
    assert lines[0] == "Dead zone: none shows; one wider than 0.0015 of the command u would have shown (95 %)"


SPEED = """
[signals]
u = { column = "u", unit = "1" }
speed = { column = "speed", unit = "rpm" }
[time]
column = "t"
unit = "s"
[machine]
chain = ["dead_zone", "dcv", "continuity", "mechanical"]
output = "speed"
speed = "?"
lag = "?"
"""


def test_a_speed_that_was_measured_gives_the_same_curve(tmp_path: Path):
    """A tachometer or a flow meter in the place of an angle."""
    run = made(6, noise=0.0)
    (tmp_path / "m.toml").write_text(SPEED)
    rpm = np.gradient(run.position, run.time) * 60.0 / (2.0 * np.pi)
    table = np.column_stack([run.time, run.command, rpm])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,u,speed", comments="", fmt="%.9g")
    mapping = load_mapping(tmp_path / "m.toml")
    found = drive_answer([load_log(tmp_path / "log.csv", mapping)], mapping, None, None).data["drive_curve"]
    assert found["motion"]["unit"] == found["top_speed"]["high"]["unit"] == "rpm"
    assert found["dead_zone"]["high"]["value"] == pytest.approx(0.25, abs=0.02)
    assert found["top_speed"]["high"]["value"] == pytest.approx(0.8 * 60.0 / (2.0 * np.pi), rel=0.03)
    assert found["top_speed"]["low"]["value"] == pytest.approx(-0.75 * 60.0 / (2.0 * np.pi), rel=0.03)


def test_a_log_that_does_not_tell_the_numbers_takes_no_longer(monkeypatch):
    """One step of a slow tank: dead zone and slope trade against each other for ever; a fit ends there."""
    taken = []

    def counted(*args, **options):
        found = least_squares(*args, **options)
        taken.append(found.nfev)
        return found

    monkeypatch.setattr(drive_fit, "least_squares", counted)
    time = 0.05 * np.arange(6000)
    command = np.where(time < 3.0, 0.7, 0.8)
    level = 12.0 + np.where(time < 3.0, 0.0, 6.0 * (1.0 - np.exp(-(time - 3.0) / 60.0)))
    drive_curve([Run("tank", time, command, np.concatenate([[0.0], np.cumsum(level[1:] * 0.05)]))])
    assert max(taken) <= drive_fit.MOST_RUNS
    # and one that tells them is not cut short
    taken.clear()
    drive_curve([made(1)])
    assert max(taken) < drive_fit.MOST_RUNS
