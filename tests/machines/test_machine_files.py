"""A machine in one file: its wiring, its values, and what the log tells of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from cosim.compare import Comparator, load_mapping, open_model
from cosim.diagnosis.answer.curve import curve_of
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.model.options import Options, options_of
from cosim.diagnosis.pipeline import diagnose as steps
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.thresholds import GUESSED_TRUST, NOMINAL_TRUST
from cosim.errors import DataError, UsageError
from cosim.lexicon import Lexicon
from cosim.logs import load_log
from cosim.machines import made_for, write_machine
from cosim.machines.rough import first_order
from cosim.request import model_path
from cosim.ssp.read import read_system

STEP, GAIN, LAG, MASS, DRAG = 0.02, 0.8, 0.15, 40.0, 90.0
DRIVE = """
name = "small drive"
time = { column = "t", unit = "s" }
[signals]
u = { column = "duty", unit = "1", zero = 50.0, gain = 0.02 }
slew = { column = "angle", unit = "rad" }
[machine]
chain = ["dead_zone", "dcv", "continuity", "mechanical", "sensor"]
"""
AXIS = """
name = "axis"
time = { column = "t", unit = "s" }
[signals]
force = { column = "force", unit = "N", held = true }
position = { column = "position", unit = "mm" }
[machine]
chain = ["mechanical"]
input = "force"
output = "position"
motion = "travel"
"""


@pytest.mark.parametrize(
    ("stated", "told"),
    [
        (
            'speed = "30"\nlag = "150 ms"\n',
            'speed = 30 as 30 rad/s; write the unit, such as speed = "30 deg/s"',
        ),
        (
            'speed = "30 deg/s"\nlag = "0.2"\n[machine.parameters]\n"dcv.w0" = 40\n"mechanical.tau_c" = 0\n',
            'lag = 0.2 as 0.2 s, dcv.w0 = 40 as 40 rad/s; write the unit, such as lag = "0.2 ms"',
        ),
        ('speed = "30 deg/s"\nlag = "150 ms"\n', ""),
    ],
)
def test_a_number_without_a_unit_is_told(tmp_path: Path, stated: str, told: str) -> None:
    """30 was taken as 30 rad/s, without a word."""
    mapping = tmp_path / "machine.toml"
    mapping.write_text(DRIVE + stated, encoding="utf-8")
    notes = made_for(mapping, folder=tmp_path / "made").table.notes
    assert bool(notes) == bool(told)
    assert all(note.startswith("[machine]: a number without a unit is taken in SI: ") for note in notes)
    assert all(told in note for note in notes)


def test_a_natural_frequency_is_one_on_a_travelling_axis_too(tmp_path: Path) -> None:
    """ "40 rad/s" was refused there for m/s, and shown in m/s."""
    mapping = tmp_path / "machine.toml"
    text = DRIVE.replace('"rad"', '"mm"').replace("slew", "travel")
    mapping.write_text(text + 'speed = "0.2 m/s"\nlag = "0.1 s"\nparameters = { "dcv.w0" = "40 rad/s" }\n')
    made = made_for(mapping, folder=tmp_path / "made")
    assert (made.numbers.values["dcv.w0"], made.machine.unit("dcv.w0")) == (40.0, "rad/s")
    assert made.machine.unit("mechanical.omega_v") == "m/s"
    lexicon = Lexicon(units=made.machine.units)
    assert [lexicon.parameter(made.machine.variable(n))[0] for n in ("dcv.w0", "mechanical.omega_v")] == [
        "rad/s",
        "m/s",
    ]


@pytest.mark.parametrize("speed", ["0.08 rad/s", "?"])
def test_a_command_in_volts_is_one_where_its_speed_is_stated(tmp_path: Path, speed: str) -> None:
    """It was called implausible, with a remedy that made the stated speed wrong."""
    drive = np.repeat(np.random.default_rng(2).uniform(-8.0, 8.0, 40), 50)
    columns = {"t": STEP * np.arange(drive.size), "duty": drive, "angle": moved(drive, 0.08, 0.15)}
    text = DRIVE.replace(", zero = 50.0, gain = 0.02", "") + f'speed = "{speed}"\nlag = "0.15 s"\n'
    mapping, file = written(tmp_path, text, columns)
    log = load_log(file, mapping)
    warned = any("plausible are -1.05 to 1.05" in w for w in log.warnings)
    notes = made_for(mapping, log, tmp_path / "made").table.notes
    assert warned == (speed == "?")
    assert any("is then what a command of 1 brings, and not full command" in n for n in notes) == (
        speed != "?"
    )


def moved(drive, gain, lag):
    """Position of a drive whose speed follows with a first-order lag, its command held."""
    kept = np.exp(-STEP / lag)
    speed = lfilter([0.0, 1.0 - kept], [1.0, -kept], gain * drive)
    # of a speed that goes from one value to the next along an exponential
    steps = gain * drive[:-1] * STEP + (speed[:-1] - gain * drive[:-1]) * lag * (1.0 - kept)
    return np.concatenate([[0.0], np.cumsum(steps)])


def written(folder: Path, text: str, columns: dict[str, np.ndarray]) -> tuple[Path, Path]:
    mapping, log = folder / "machine.toml", folder / "log.csv"
    mapping.write_text(text, encoding="utf-8")
    np.savetxt(
        log, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="",
        fmt="%.9g",
    )  # fmt: skip
    return mapping, log


@pytest.fixture
def excitation():
    rng = np.random.default_rng(5)
    return np.repeat(rng.uniform(-1.0, 1.0, 60), 50)  # a minute, held for a second each


@pytest.fixture
def drive(tmp_path, excitation):
    time = STEP * np.arange(excitation.size)
    angle = moved(excitation, GAIN, LAG)
    return written(tmp_path, DRIVE, {"t": time, "duty": 50.0 + 50.0 * excitation, "angle": angle})


@pytest.fixture
def axis(tmp_path, excitation):
    time, force = STEP * np.arange(excitation.size), 100.0 * excitation
    position = 1e3 * moved(force, 1.0 / DRAG, MASS / DRAG)
    return written(tmp_path, AXIS, {"t": time, "force": force, "position": position})


def test_gain_and_lag_come_from_the_log(drive):
    mapping, log = drive
    numbers = made_for(mapping, load_log(log, mapping)).numbers
    assert numbers.speed == pytest.approx(GAIN, rel=0.02)
    assert numbers.lag == pytest.approx(LAG, rel=0.1)
    assert numbers.from_log == ["mechanical.J", "mechanical.b"]
    # full command is 1 N m: b is its torque over the speed
    assert numbers.values["mechanical.b"] == pytest.approx(1.0 / GAIN, rel=0.02)


def test_a_stated_speed_and_lag_need_no_log(tmp_path):
    mapping, _ = written(tmp_path, DRIVE + 'speed = "48 deg/s"\nlag = "150 ms"\n', {"t": np.arange(3.0)})
    values = made_for(mapping).numbers.values
    assert values["mechanical.b"] == pytest.approx(1.0 / np.radians(48.0))
    assert values["mechanical.J"] == pytest.approx(0.15 / np.radians(48.0))


def test_what_the_log_tells_is_fitted_to_every_log(drive, tmp_path, monkeypatch):
    """A guess is no nominal value: with and without --calibrate it is free; what is stated is trusted to 1 %."""
    mapping, log = drive
    logged = load_log(log, mapping)
    guessed = machine_of(None, logged, mapping)
    assert guessed.options.free == ("mechanical.J", "mechanical.b")
    stated = written(tmp_path, DRIVE + 'speed = "0.8 rad/s"\nlag = "150 ms"\n', {"t": [0.0, 1.0]})[0]
    known = replace(guessed, options=Options(trusted=tuple(made_for(stated).diagnose["trusted"])))
    trusts = []
    monkeypatch.setattr(steps, "stages", lambda found, logs, parts, tracker, trust, *_: trusts.append(trust))
    for machine, calibrate in ((guessed, False), (guessed, True), (known, False), (known, True)):
        diagnose(logged, model=machine, calibrate=calibrate)
    assert trusts == [GUESSED_TRUST, GUESSED_TRUST, NOMINAL_TRUST, GUESSED_TRUST]


def test_a_parameter_is_trusted_or_free():
    with pytest.raises(DataError, match="give 'trusted' or 'free', not both"):
        options_of({"trusted": ["mechanical.J"], "free": ["mechanical.b"]}, "axis.toml")


def test_an_axis_is_told_in_kilograms_and_newtons(axis):
    mapping, log = axis
    loaded = load_log(log, mapping)
    numbers = made_for(mapping, loaded).numbers
    assert numbers.values["mechanical.b"] == pytest.approx(DRAG, rel=0.02)
    assert numbers.values["mechanical.J"] == pytest.approx(MASS, rel=0.1)
    found = machine_of(None, loaded, mapping)
    assert found.lexicon.units["kg.m2"] == "kg"
    (group,) = found.groups
    assert group.trusted == ("mechanical.J", "mechanical.b")
    assert group.starts == (("mechanical.theta_0", "position"),)


def test_stated_quantities_are_converted(tmp_path):
    text = AXIS + '[machine.parameters]\n"mechanical.J" = "95000 g"\n"mechanical.b" = "0.2 kN.s/m"\n'
    mapping, _ = written(tmp_path, text, {"t": np.arange(3.0)})
    values = made_for(mapping).numbers.values
    assert (values["mechanical.J"], values["mechanical.b"]) == (pytest.approx(95.0), pytest.approx(200.0))


def test_the_package_follows_the_log(drive):
    mapping, log = drive
    loaded = load_log(log, mapping)
    made = made_for(mapping, loaded)
    with Comparator(loaded, open_model(str(made.ssd)), table=made.table) as bench:
        error = loaded["slew"] - bench.simulate()["slew"]
    assert np.std(error) < 0.02 * np.std(loaded["slew"])


def test_searches_begin_at_the_size_of_the_machine(drive):
    mapping, log = drive
    loaded = load_log(log, mapping)
    tenth = loaded["slew"] * 0.1
    scale = made_for(mapping, loaded).diagnose["scale"]
    slow = made_for(mapping, load_log(with_angle(log, tenth), mapping)).diagnose["scale"]
    # a tenth of the way: gap and speeds a tenth, torques as before, for full command is 1 N m on either
    assert slow["mechanical.gap"] == pytest.approx(0.1 * scale["mechanical.gap"], rel=0.01)
    assert slow["mechanical.omega_s"] == pytest.approx(0.1 * scale["mechanical.omega_s"], rel=0.02)
    assert slow["mechanical.tau_c"] == pytest.approx(scale["mechanical.tau_c"], rel=0.1)
    assert "mechanical.phi_r" not in scale


def test_a_torque_of_unknown_scale_is_a_part_of_full_command(drive):
    mapping, log = drive
    assert machine_of(None, load_log(log, mapping), mapping).lexicon.units["N.m"] == "full command"
    mapping.write_text(mapping.read_text() + '[machine.parameters]\n"continuity.K_c" = "5 bar/mm"\n')
    assert "N.m" not in machine_of(None, load_log(log, mapping), mapping).lexicon.units


def with_angle(log: Path, angle: np.ndarray) -> Path:
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    table[:, 2] = angle
    target = log.with_name("other.csv")
    np.savetxt(target, table, delimiter=",", header="t,duty,angle", comments="", fmt="%.9g")
    return target


def test_given_scales_and_exclusions_stand(drive):
    mapping, log = drive
    mapping.write_text(
        mapping.read_text()
        + '[diagnose]\nexclude = ["mechanical.gear_ripple"]\n[diagnose.scale]\n"rad" = 7.0\n'
    )
    found = made_for(mapping, load_log(log, mapping)).diagnose
    assert found["scale"]["rad"] == 7.0
    assert "mechanical.gap" not in found["scale"]  # in rad: the given factor is the one
    # neither spool nor pressure was measured: these gains are one number with J and b
    assert {"mechanical.gear_ripple", "dcv.gain", "continuity.flow_gain", "sensor.gain"} <= set(
        found["exclude"]
    )


def test_files_for_other_tools(drive, tmp_path):
    mapping, log = drive
    made, files = write_machine(mapping, tmp_path / "out", load_log(log, mapping))
    assert [f.suffix for f in files] == [".ssd", *[".ssv"] * 5, ".ssp"]
    with read_system(files[-1]) as system:
        assert list(system.components) == list(made.machine.chain)
        assert (list(system.inputs), list(system.outputs)) == (["u"], ["slew"])
        assert system.components["mechanical"].starts["b"] == made.numbers.values["mechanical.b"]


def test_simulate_takes_the_file_itself(drive):
    mapping, log = drive
    assert model_path(str(mapping), with_input=True, log=log).suffix == ".ssp"


def test_what_only_a_log_can_tell_is_asked_for(tmp_path):
    mapping, _ = written(tmp_path, DRIVE, {"t": np.arange(3.0)})
    with pytest.raises(UsageError, match=r"mechanical\.J and mechanical\.b must be told by a log"):
        made_for(mapping)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"dcv", ', '"dvc", ', "no block 'dvc'"),
        ('"dead_zone", "dcv"', '"dcv", "dead_zone"', "'dead_zone' takes command"),
        ('"continuity", ', "", "put 'continuity' or 'continuity_physical' between them"),
        ("[machine]", '[machine]\nspeed = "3 kg"', "'speed': unit 'kg' has the wrong dimension"),
        ("[machine]", '[machine]\nsped = "3 rad/s"', "'machine.sped' is not a key of a machine; did you mean speed"),
        ("[machine]", '[machine]\nparameters = { "dcv.W0" = "?" }', "the chain has no 'dcv.W0'; did you mean dcv.w0"),
        ("[machine]", '[machine]\noutput = "angle"', "machine.output = 'angle' is no signal"),
        ('name = "small drive"', 'name = "x"\nmodel = "full_order"', "either a model or a table"),
    ],
)  # fmt: skip
def test_mistakes_are_named(tmp_path, old, new, words):
    mapping, _ = written(tmp_path, DRIVE.replace(old, new), {"t": np.arange(3.0)})
    with pytest.raises((DataError, UsageError)) as caught:
        made_for(mapping)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "left_out", [(), ("input",), ("output",), ("motion",), ("input", "output", "motion")]
)
def test_what_the_signals_leave_no_choice_of_need_not_be_said(axis, left_out):
    mapping, log = axis
    text = AXIS.replace("position =", "travel =").replace('output = "position"', 'output = "travel"')
    lines = [line for line in text.splitlines() if line.partition(" =")[0] not in left_out]
    mapping.write_text("\n".join(lines), encoding="utf-8")
    machine = made_for(mapping, load_log(log, mapping)).machine
    assert (machine.input, machine.output, machine.motion) == ("force", "travel", "travel")


def test_a_load_pressure_that_is_to_drive_is_mapped_as_the_difference_of_its_ports(tmp_path):
    """A hydraulic rotary actuator without a logged command: "'p_load' is no signal", beside both of its ports."""
    text = """
    time = { column = "t", unit = "s" }
    [signals]
    p_a = { column = "PG_1", unit = "psi" }
    p_b = { column = "PG_2", unit = "psi" }
    slew = { column = "Angle", unit = "deg" }
    [machine]
    chain = ["mechanical"]
    input = "p_load"
    """
    mapping = tmp_path / "actuator.toml"
    mapping.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=r'torque = { column = "PG_1", minus = "PG_2", unit = "psi" }'):
        made_for(mapping)


def test_of_two_motions_neither_is_taken(drive):
    mapping, log = drive
    both = DRIVE.replace("slew =", "travel =") + '[signals.speed]\ncolumn = "angle"\nunit = "rad/s"\n'
    mapping.write_text(both, encoding="utf-8")
    with pytest.raises(DataError, match=r"machine\.output = 'slew' is no signal"):
        made_for(mapping, load_log(log, mapping))


def test_a_log_against_the_command_is_refused(drive):
    mapping, log = drive
    mapping.write_text(mapping.read_text().replace('unit = "rad"', 'unit = "rad", sign = -1'))
    with pytest.raises(DataError, match="goes against 'u'"):
        made_for(mapping, load_log(log, mapping))


def test_a_mapping_without_a_machine_is_refused(tmp_path):
    mapping, _ = written(tmp_path, DRIVE[: DRIVE.index("[machine]")], {"t": np.arange(3.0)})
    with pytest.raises(DataError, match=r"no table \[machine\]"):
        made_for(mapping)
    assert not load_mapping(mapping)[0].machine


def test_several_logs_tell_a_machine_together(tmp_path, drive, excitation):
    mapping, moving = drive
    time, creep = STEP * np.arange(excitation.size), 1e-4 * GAIN
    # within the dead zone it hardly moves: alone this log tells a machine of a ten-thousandth of the speed
    columns = {"t": time, "duty": 50.0 + 10.0 * excitation, "angle": moved(excitation, creep, STEP)}
    (tmp_path / "still").mkdir()
    _, still = written(tmp_path / "still", DRIVE, columns)
    logs = [load_log(path, mapping) for path in (still, moving)]
    alone, both = made_for(mapping, logs[0]).numbers, made_for(mapping, logs).numbers
    assert alone.speed < 1e-2 * GAIN
    of_moving = made_for(mapping, logs[1]).numbers
    assert (both.speed, both.lag) == (of_moving.speed, of_moving.lag)
    assert both.speed == pytest.approx(GAIN, rel=0.1)
    assert machine_of(None, logs, mapping).values == machine_of(None, logs[::-1], mapping).values


@pytest.mark.parametrize("end", [0.3, 30.0])
def test_a_place_counts_where_a_rough_machine_stands_at_its_end(
    tmp_path, drive, excitation, monkeypatch, end
):
    mapping, path = drive
    read = load_log(path, mapping)
    middle = float(np.median(read.signals["slew"]))
    columns = {
        "t": read.time,
        "duty": 50.0 + 50.0 * excitation,
        "angle": np.clip(read.signals["slew"], middle - end, middle + end),
    }
    log = load_log(written(tmp_path, DRIVE, columns)[1], mapping)
    monkeypatch.setattr(steps, "stages", lambda *_: None)
    machine = machine_of(None, log, mapping)
    assert not machine.groups[-1].absolute
    assert diagnose(log, model=machine).groups[-1].absolute == (end == 0.3)
    stated = replace(machine, options=Options(trusted=machine.options.free))
    assert not diagnose(log, model=stated).groups[-1].absolute


def test_a_response_that_does_not_integrate(excitation):
    time = STEP * np.arange(excitation.size)
    kept = np.exp(-STEP / 0.3)
    response = 2.0 + 5.0 * lfilter([0.0, 1.0 - kept], [1.0, -kept], excitation)
    found = first_order(time, excitation, response, integrates=False)
    assert found.gain == pytest.approx(5.0, rel=0.03)
    assert found.lag == pytest.approx(0.3, rel=0.15)
    assert found.share > 0.99


@pytest.mark.slow
def test_a_mass_without_friction_is_a_model_too(tmp_path):
    """The friction that it lacks is named with its size: 1 % is more than five of its standard deviations."""
    fine = 0.001 * np.arange(12000)
    force = 60.0 * np.sin(0.9 * fine) + 40.0 * np.sin(2.3 * fine + 1.0)
    kept = np.exp(-0.001 * DRAG / MASS)
    speed = lfilter([1.0 - kept], [1.0, -kept], force / DRAG)
    position = 1e3 * 0.001 * np.cumsum(speed) + np.random.default_rng(1).normal(0.0, 5.0, fine.size)
    columns = {"t": fine, "force": force, "position": position}
    text = AXIS + '[machine.parameters]\n"mechanical.J" = "40 kg"\n"mechanical.b" = "0 N.s/m"\n'
    mapping, log = written(tmp_path, text, {name: values[::20] for name, values in columns.items()})
    loaded = load_log(log, mapping)
    found = diagnose(loaded, model=machine_of(None, loaded, mapping))
    (cause,) = found.causes
    assert cause.effect.name == "mechanical.viscous_friction"
    assert cause.parameters["b"][0] == pytest.approx(DRAG, rel=0.01)


def test_a_force_that_is_held_from_sample_to_sample_is_no_cause(tmp_path, excitation):
    """As a straight line from stamp to stamp it came half a sample early, and a machine as stated had play."""
    time, force = STEP * np.arange(excitation.size), 100.0 * excitation
    noise = np.random.default_rng(1).normal(0.0, 0.5, time.size)
    position = 1e3 * moved(force, 1.0 / DRAG, MASS / DRAG) + noise
    stated = '[machine.parameters]\n"mechanical.J" = "40 kg"\n"mechanical.b" = "90 N.s/m"\n'
    mapping, path = written(tmp_path, AXIS + stated, {"t": time, "force": force, "position": position})
    log = load_log(path, mapping)
    found = diagnose(log, model=machine_of(None, log, mapping))
    assert (found.verdict, found.causes) == ("adequate", [])
    assert curve_of(found, log) is None  # a force has no dead zone of a valve
