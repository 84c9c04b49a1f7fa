"""A servo that closes a position loop of its own: the demanded place and the place that it holds (synthetic)."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.browser.form import machine_of as machine_of_page
from cosim.diagnosis.answer import remarks
from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.answer.curve import curve_of
from cosim.diagnosis.answer.remarks import at_once, itself
from cosim.diagnosis.fitting.paced import seen_speeds
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.diagnosis.record.record import joined
from cosim.diagnosis.thresholds import CALIBRATED_TRUST
from cosim.errors import DataError
from cosim.identify.run_drive import drive_answer
from cosim.lexicon import speaking
from cosim.logs import Log, load_log, load_mapping
from cosim.logs.guess import guesses, mapping_text
from cosim.logs.overview import overview
from cosim.machines import made_for
from cosim.machines.rough import stays_with
from cosim.report.material import Material
from cosim.report.names import kind_of_motion
from cosim.report.words import in_own_words, quantity

PLAIN = """
time = { column = "t", unit = "s" }
[signals]
u = { column = "u", unit = "1" }
slew = { column = "x", unit = "deg" }
[machine]
chain = ["dead_zone", "dcv", "continuity", "mechanical", "sensor"]
"""
LATE, LAG, STEP = 0.12, 0.06, 0.01  # s


def servo(
    folder: Path, late: float = LATE, fastest: float = np.inf, back: float = np.inf
) -> tuple[Path, Path]:
    """A log of steps with supply voltage and temperature, and its mapping as `cosim init --machine` writes it.

    Args:
        folder: where to write them.
        late: s, delay of the servo.
        fastest, back: 1/s, rates at which it lets its goal rise and fall.
    """
    t = STEP * np.arange(4000)
    rng = np.random.default_rng(5)
    # ramps of 0.5 s: what stands between the corners of a step is the business of a linear model of free order
    goal = np.interp(t, 0.5 * np.arange(81), rng.uniform(-1.0, 1.0, 81))
    asked = np.roll(goal, round(late / STEP))
    asked[: round(late / STEP)] = goal[0]
    for k in range(1, t.size):
        asked[k] = asked[k - 1] + np.clip(asked[k] - asked[k - 1], -min(fastest, back) * STEP, fastest * STEP)
    place = np.full(t.size, goal[0])
    kept = np.exp(-STEP / LAG)
    for k in range(1, t.size):
        place[k] = kept * place[k - 1] + (1.0 - kept) * asked[k - 1]
    place += rng.normal(0.0, 1e-2, t.size)
    volts = 12.0 - 0.5 * (np.abs(goal - place) > 0.1)
    temperature = np.repeat(np.linspace(25.0, 31.0, 8).round(), 500)
    file = folder / "servo.csv"
    np.savetxt(
        file, np.column_stack([t, goal, place, volts, temperature]), delimiter=",", comments="", fmt="%.6g",
        header="timestamp,goal_position,position,input_volts,temp",
    )  # fmt: skip
    found = overview(file)
    mapping = folder / "servo.toml"
    mapping.write_text(mapping_text(found, guesses(found, machine=True), None), encoding="utf-8")
    return file, mapping


def recorded(
    folder: Path, name: str, time: np.ndarray, command: np.ndarray, place: np.ndarray
) -> tuple[Path, Path]:
    """A log of a command and a place, and a mapping that says nothing of a demanded place."""
    file, mapping = folder / f"{name}.csv", folder / f"{name}.toml"
    rows = np.column_stack([time, command, place])
    np.savetxt(file, rows, delimiter=",", comments="", header="t,u,x", fmt="%.6g")
    mapping.write_text(PLAIN, encoding="utf-8")
    return file, mapping


@pytest.fixture
def loaded(tmp_path: Path) -> tuple[Path, Log]:
    file, mapping = servo(tmp_path)
    return mapping, load_log(file, mapping)


def test_what_is_called_goal_is_what_drives_it(loaded):
    mapping, log = loaded
    text = mapping.read_text(encoding="utf-8")
    assert 'column = "goal_position"' in text.partition("[signals.travel]")[0], (
        "and no supply voltage or temperature"
    )
    assert 'command = "place"' in text
    assert '"sensor"' not in text.partition("[machine]")[2].partition("\n\n")[0]
    made = made_for(mapping, log, folder=mapping.parent / "made")
    assert made.table.signals["travel"].variable == "mechanical.omega"
    assert made.diagnose["held"] == ["travel"]
    # a demand of 1 is the largest of the log; a start for a fit, which the delay biases
    assert made.numbers.speed == pytest.approx(np.max(np.abs(log["travel"])), rel=0.2)
    assert {"dead_zone.mismatch", "mechanical.gravity_load"} < set(made.diagnose["exclude"])
    assert not {"dcv.delay", "dcv.hysteresis"} & set(made.diagnose["exclude"])


def test_the_page_knows_it_too(tmp_path):
    found = overview(servo(tmp_path)[0])
    entries = {
        "u": {"column": "goal_position", "unit": "1"},
        "travel": {"column": "position", "unit": "m"},
    }
    table = machine_of_page(found, entries)
    assert table["command"] == "place"
    assert "sensor" not in table["chain"]
    assert "command" not in machine_of_page(found, entries | {"u": {"column": "input_volts", "unit": "V"}})


@pytest.mark.parametrize("measured", ["actual-position [mm]", "Ist Position [mm]", "position_fb [mm]"])
def test_the_target_drives_and_not_the_current_that_the_loop_makes_of_it(tmp_path, measured):
    """A linear actuator whose place is called the actual one: "the only voltage or current" was its command."""
    t = STEP * np.arange(2000)
    target = np.repeat(np.random.default_rng(9).uniform(-5.0, 5.0, 20), 100)
    place = np.interp(t - 0.05, t, target)
    current = np.gradient(place, STEP)
    file = tmp_path / "actuator.csv"
    np.savetxt(
        file, np.column_stack([t, target, place, current]), delimiter=",", comments="", fmt="%.6g",
        header=f"time [s],target-position [mm],{measured},current [mA]",
    )  # fmt: skip
    found = guesses(overview(file), machine=True)
    assert found["u"].column.label.short == "target-position"
    assert found["u"].place
    assert found["travel"].column.label.shown == measured
    largest = 1.0 / found["u"].gain
    assert largest == pytest.approx(np.max(np.abs(target)), rel=1e-3)
    assert f'speed = "{largest:.4g} mm"' in mapping_text(overview(file), found, None), (
        "what a command of 1 asks for is known"
    )


@pytest.mark.parametrize(("held", "told"), [(1.6, True), (1.95, False)])
def test_a_drive_that_stays_short_of_its_demand_is_told(monkeypatch, held, told):
    """A servo with a weight held 79 % of its goals: the gain was fitted, and nothing said so."""
    fit = SimpleNamespace(values={"mechanical.b": 1.0})
    group = SimpleNamespace(place=True, observed=("slew",))
    finding = SimpleNamespace(
        task=SimpleNamespace(model=SimpleNamespace(group=group)),
        lacks_linear=False,
        chosen=SimpleNamespace(effects=(), fit=fit),
    )
    found = SimpleNamespace(
        machine=SimpleNamespace(mapping=SimpleNamespace(machine={"speed": "2 rad"})),
        findings={"mechanical": finding},
        values={},
    )
    monkeypatch.setattr(remarks, "static_speeds", lambda *given: [held])
    monkeypatch.setattr(remarks, "what_stands", lambda finding: SimpleNamespace(fit=fit))
    notes = remarks.short_of_demand(found)
    assert [n.partition(":")[0] for n in notes] == (
        ["of a demand of 114.6 deg the drive holds 91.67 deg (80 %)"] if told else []
    )
    found.machine.mapping.machine["speed"] = "?"
    assert remarks.short_of_demand(found) == []


def test_a_limit_of_its_rate_is_told_as_a_speed_of_the_place(tmp_path):
    """Nobody knows what "9.3 full command/s" of a demand within a drive are."""
    file, mapping = servo(tmp_path, late=0.0, fastest=1.5)
    log = load_log(file, mapping)
    machine = machine_of(None, log, mapping)
    with speaking(machine.lexicon):
        found = diagnose(log, model=machine, tolerance=CALIBRATED_TRUST)
    assert "dcv.rate_limit" in [c.effect.name for c in found.causes]
    speed = found.top_speeds["dcv.v_max"]
    assert speed.value == pytest.approx(1.5, rel=0.02)
    assert speed.ci95[0] < speed.value < speed.ci95[1] < 1.6


def test_each_direction_has_a_fastest_rate_of_its_own(tmp_path):
    """A cylinder has two areas. One rate for both ways drifts, and a linear model takes the drive for a slow one."""
    file, mapping = servo(tmp_path, late=0.0, fastest=1.6, back=0.8)
    log = load_log(file, mapping)
    machine = machine_of(None, log, mapping)
    with speaking(machine.lexicon):
        found = diagnose(log, model=machine, tolerance=CALIBRATED_TRUST)
        assert [c.effect.name for c in found.causes] == ["dcv.rate_limit"]
        there, back = (found.top_speeds[f"dcv.{n}"] for n in ("v_max", "r_v"))
        assert (there.value, back.value) == (pytest.approx(1.6, rel=0.02), pytest.approx(-0.8, rel=0.02))
        assert back.ci95[0] < back.value < back.ci95[1] < 0.0
        told = answer(found, log, None)
        (cause,) = told.causes
        assert set(cause.top_speed) == {"v_max", "r_v"}
        how = in_own_words(cause, Material(told, 0.0, {}, {}))[1]
        assert "one way and" in how


def test_speeds_are_seen_each_way_and_not_across_a_seam():
    t = STEP * np.arange(400)
    one = np.interp(t, [0.0, 1.0, 3.0, 4.0], [0.0, 2.0, 0.0, 0.0])
    noise = np.random.default_rng(1).normal(0.0, 2e-3, 2 * t.size)
    two = np.concatenate([one, one + 50.0]) + noise
    assert seen_speeds(two, STEP, (t.size,)) == (pytest.approx(2.0, rel=0.1), pytest.approx(1.0, rel=0.1))
    assert seen_speeds(np.zeros(100), STEP, ()) == (0.0, 0.0)


def test_its_delay_is_named_in_words_of_a_place(loaded):
    mapping, log = loaded
    machine = machine_of(None, log, mapping)
    with speaking(machine.lexicon):
        found = diagnose(log, model=machine)
    assert [c.effect.name for c in found.causes] == ["dcv.delay"]
    (value, _), *_ = found.causes[0].parameters.values()
    assert value == pytest.approx(LATE, abs=2.0 * STEP), "less what valve and winding are late by, a sample"
    assert curve_of(found, log) is None, "a place has no static curve of speed against command"
    with speaking(machine.lexicon):
        assert kind_of_motion("a missing torque") == "a missing demand"
        assert [quantity(name)[1] for name in ("theta", "omega")] == ["m", "m/s"]


def test_no_levels_or_directions_of_a_speed_are_asked_of_it(loaded):
    """Between two places it goes both ways, and no gain is missing: "dead zone and friction cannot be told from it"."""
    mapping, log = loaded
    two = 0.5 + 0.5 * np.sign(log["u"])
    machine = machine_of(None, log, mapping)
    record = prepare(replace(log, signals=log.signals | {"u": two}), machine)
    told = SimpleNamespace(record=record, machine=machine, causes=[], findings={}, values={})
    assert not any("one level" in text or "never" in text for text in remarks.advice(told))  # type: ignore[arg-type]


def test_without_machine_the_current_of_a_servo_is_no_command_of_the_crane(tmp_path):
    """An angle and a current beside the target were mapped as the crane's, and no word was said of another machine."""
    t = STEP * np.arange(2000)
    target = np.repeat(np.random.default_rng(9).uniform(-50.0, 50.0, 20), 100)
    place = np.interp(t - 0.05, t, target)
    file = tmp_path / "servo.csv"
    rows = np.column_stack([t, target, place, np.round(np.gradient(place, STEP), -2)])
    head = "time [s],target-position [deg],actual-position [deg],current [A]"
    np.savetxt(file, rows, delimiter=",", comments="", fmt="%.6g", header=head)
    assert "u" not in guesses(overview(file))
    assert guesses(overview(file), machine=True)["u"].place


@pytest.mark.slow
def test_a_place_that_was_taken_for_the_sum_of_its_command_is_told(loaded):
    mapping, log = loaded
    text = mapping.read_text(encoding="utf-8")
    kept = [line for line in text.splitlines() if not line.startswith("command")]
    mapping.write_text("\n".join(kept).replace('"mechanical"]', '"mechanical", "sensor"]'), encoding="utf-8")
    machine = machine_of(None, log, mapping)
    record = prepare(log, machine)
    assert itself(record, "u", "travel")
    (told,) = at_once(diagnose(log, model=machine))
    assert 'say command = "place" in [machine]' in told


def test_a_place_that_a_named_load_brings_back_is_taken_for_no_demanded_place():
    """A propeller on a pendulum: of the load that grows with its angle the answer said to correct the mapping."""
    t = STEP * np.arange(1000)
    angle = np.roll(np.sign(np.sin(t)), 2)
    record = SimpleNamespace(
        has=lambda *names: True, cuts=(), time=t, signals={"torque": np.sign(np.sin(t)), "slew": angle}
    )
    group = SimpleNamespace(integrates=True, is_speed=lambda name: False, drive="torque")
    task = SimpleNamespace(model=SimpleNamespace(group=group), measured={"slew": angle})
    found = SimpleNamespace(
        findings={"mechanical": SimpleNamespace(task=task, lacks_linear=False, reference=None)},
        machine=SimpleNamespace(drive="torque"),
        record=record,
        causes=[],
    )
    (told,) = at_once(found)
    assert "state J and b in [machine]" in told
    found.causes = [SimpleNamespace(effect=SimpleNamespace(name="mechanical.gravity_load"))]
    assert at_once(found) == []


def test_a_place_that_goes_against_what_a_controller_puts_out_is_no_demanded_one():
    """A motor without damping in a loop: a constant gain below 0 told its angle best, and it was said to follow."""
    t = STEP * np.arange(1000)
    effort = np.sin(2.0 * np.pi * t)
    group = SimpleNamespace(integrates=True, is_speed=lambda name: False, drive="u")
    task = SimpleNamespace(model=SimpleNamespace(group=group), measured={"slew": -effort})
    finding = SimpleNamespace(
        task=task,
        lacks_linear=True,
        reference=SimpleNamespace(model=SimpleNamespace(integrates=False, settled=-3.0)),
    )
    found = SimpleNamespace(
        findings={"mechanical": finding},
        machine=SimpleNamespace(drive="u"),
        record=SimpleNamespace(
            has=lambda *names: True, cuts=(), time=t, signals={"u": effort, "slew": -effort}
        ),
        causes=[],
    )
    (told,) = at_once(found)
    assert told.startswith("slew goes against u itself: if u is what a controller puts out")
    finding.reference.model.settled = 3.0
    (told,) = at_once(found)
    assert told.startswith("slew follows u itself")


def test_a_place_whose_sum_of_commands_goes_the_other_way_is_no_reversed_sign(tmp_path):
    """A slow sine and what holds it: the sum of the command falls where the place rises."""
    t = STEP * np.arange(1000)
    goal = np.sin(2.0 * np.pi * 0.25 * t)
    file, mapping = recorded(tmp_path, "sine", t, goal, np.roll(goal, 3))
    with pytest.raises(DataError, match='say command = "place" in \\[machine\\]'):
        machine_of(None, load_log(file, mapping), mapping)


def test_no_static_curve_of_speed_is_asked_of_it(loaded, tmp_path):
    mapping, log = loaded
    with pytest.raises(DataError, match="'u' is a demanded place"):
        drive_answer([log], load_mapping(mapping), None, None)
    # nor where the mapping does not say so; stamps that are 30 ms late make its speed go against the sine
    t = STEP * np.arange(6000)
    goal = np.sin(2.0 * np.pi * 0.25 * t)
    file, other = recorded(tmp_path, "long", t, goal, np.roll(goal, -3))
    with pytest.raises(DataError, match="follows the command itself and stays with it"):
        drive_answer([load_log(file, other)], load_mapping(other), None, None)


def test_a_drive_that_goes_on_while_its_command_lasts_is_no_place(tmp_path):
    t = STEP * np.arange(4000)
    command = np.repeat(np.random.default_rng(6).uniform(-1.0, 1.0, 80), 50)
    lagged = np.convolve(command, np.exp(-np.arange(60) * STEP / 0.1))[: t.size]
    file, mapping = recorded(tmp_path, "drive", t, command, np.cumsum(lagged))
    log = load_log(file, mapping)
    assert not itself(prepare(log, machine_of(None, log, mapping)), "u", "slew")


def test_a_record_in_which_a_servo_never_arrives_says_nothing_against_one_in_which_it_does(tmp_path):
    """Its speed is limited: a demand that is reversed before it arrives is followed neither by it nor by its sum."""
    t = STEP * np.arange(1000)
    levels = np.random.default_rng(8).uniform(-1.0, 1.0, 200)
    slow, fast = np.repeat(levels[:5], 200), np.repeat(levels, 5)
    told = []
    for name, demand in (("slow", slow), ("fast", fast)):
        place = np.zeros(t.size)
        for k in range(1, t.size):
            place[k] = place[k - 1] + np.clip(demand[k - 1] - place[k - 1], -3.0 * STEP, 3.0 * STEP)
        told.append(stays_with(t, demand, place))
        recorded(tmp_path, name, t, demand, place)
    assert told == [True, None]
    logs = [load_log(tmp_path / f"{name}.csv", tmp_path / "slow.toml") for name in ("slow", "fast")]
    machine = machine_of(None, logs, tmp_path / "slow.toml")
    assert itself(joined([prepare(log, machine) for log in logs]), "u", "slew")


@pytest.mark.parametrize(
    "wrong", ['chain = ["dead_zone", "dcv", "continuity", "mechanical", "sensor"]', 'motion = "flow"']
)
def test_a_place_ends_at_the_mechanics_and_is_no_flow(tmp_path, wrong):
    file, mapping = servo(tmp_path)
    text = mapping.read_text(encoding="utf-8")
    key = wrong.partition(" ")[0]
    lines = [wrong if line.startswith(f"{key} = ") else line for line in text.splitlines()]
    mapping.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(DataError, match='command = "place" is for a chain'):
        machine_of(None, load_log(file, mapping), mapping)


def test_a_target_in_the_unit_of_the_place_needs_no_other_word_and_need_not_be_reached(tmp_path):
    """A servo too slow for its demand: "Missing: a column for u", or its `target_rad` was taken for a speed's command."""
    t = 0.02 * np.arange(400)
    target = 0.5 * np.sign(np.sin(2.0 * np.pi * (0.2 + 0.15 * t) * t))
    place = np.zeros(t.size)
    for k in range(1, t.size):
        place[k] = place[k - 1] + np.clip(target[k - 1] - place[k - 1], -0.02, 0.02)
    file = tmp_path / "slow.csv"
    rows = np.column_stack([t, target, place])
    np.savetxt(file, rows, delimiter=",", comments="", fmt="%.6g", header="time_s,target_rad,angle_rad")
    found = guesses(overview(file), machine=True)
    assert found["u"].place
    assert 'speed = "0.5 rad"' in mapping_text(overview(file), found, None)


@pytest.mark.parametrize("unit", ["rad", "cm"])
def test_a_demanded_place_in_its_own_unit_is_answered_with_what_to_write(tmp_path, unit):
    mapping = tmp_path / "servo.toml"
    text = PLAIN.replace('column = "u", unit = "1"', f'column = "u", unit = "{unit}"').replace(
        ', "sensor"', ""
    )
    mapping.write_text(text + 'command = "place"\n', encoding="utf-8")
    said = rf'of a demanded place, write unit = "1" .* 1 is \(speed = "1 {unit}"\)'
    with pytest.raises(DataError, match=said):
        load_mapping(mapping)


@pytest.mark.parametrize(("unit", "name"), [("cm", "travel"), ("mm/s", "speed"), ("rpm", "speed")])
def test_a_length_or_a_speed_taken_for_the_angle_is_answered_with_the_signal_s_name(tmp_path, unit, name):
    mapping = tmp_path / "axis.toml"
    mapping.write_text(
        f'name = "x"\ntime = {{column = "t", unit = "s"}}\nsignals.slew = {{column = "y", unit = "{unit}"}}\n',
        encoding="utf-8",
    )
    with pytest.raises(DataError, match=f"expected one like 'rad'; beside a .machine. it is called '{name}'"):
        load_mapping(mapping)
