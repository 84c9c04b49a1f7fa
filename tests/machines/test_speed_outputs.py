"""A machine whose measured output is a speed, and one that is slow: what the file leaves open comes from the log."""

from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.answer.remarks import as_stated, one_way
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.errors import DataError, UsageError
from cosim.lexicon import Lexicon, speaking
from cosim.logs import Log, load_log
from cosim.machines.make import made_for
from cosim.report.language import catalogue
from cosim.report.words import block_name, called, with_signals

MACHINE = """
name = "motor"
time = {{ column = "t", unit = "s" }}
[signals]
u = {{ column = "u", unit = "1" }}
speed = {{ column = "w", unit = "{unit}" }}
{more}
[machine]
chain = ["dead_zone", "dcv", "continuity", "mechanical"]
input = "u"
output = "speed"
speed = "?"
lag = "?"
"""
LAG, GAIN = 0.05, 200.0  # s; rad/s at full command


def motor(
    folder: Path, unit: str = "rad/s", more: str = "", lag: float = LAG, interval: float = 2e-3
) -> tuple[Path, Log]:
    """The mapping and a log of a motor of first order with a rocking command (synthetic)."""
    t = np.arange(0.0, 20.0, interval)
    u = np.sin(2.0 * np.pi * 0.5 * t) + 0.3 * np.sin(2.0 * np.pi * 3.1 * t)
    w = np.zeros_like(t)
    keep = np.exp(-interval / lag)
    for k in range(1, t.size):
        w[k] = keep * w[k - 1] + (1.0 - keep) * GAIN * u[k - 1]
    file = folder / "log.csv"
    np.savetxt(file, np.column_stack([t, u, w]), delimiter=",", header="t,u,w", comments="")
    mapping = folder / "motor.toml"
    mapping.write_text(MACHINE.format(unit=unit, more=more), encoding="utf-8")
    return mapping, load_log(file, mapping)


@pytest.mark.parametrize(("unit", "size"), [("rad/s", 1.0), ("rpm", 2.0 * np.pi / 60.0)])
def test_an_output_in_a_unit_of_speed_is_one(tmp_path: Path, unit: str, size: float) -> None:
    made = made_for(*motor(tmp_path, unit), folder=tmp_path / "made")
    assert made.table.signals["speed"].variable == "mechanical.omega"
    assert made.table.start == {}, "a speed is not where the angle starts"
    values = made.numbers.values
    assert values["mechanical.J"] / values["mechanical.b"] == pytest.approx(LAG, rel=0.05)
    assert made.numbers.speed == pytest.approx(GAIN * size, rel=0.02)
    assert 'startConnector="omega" endConnector="speed"' in made.ssd.read_text()
    assert made.sizes.speed == pytest.approx(1.2 * GAIN * size, rel=0.1)


@pytest.mark.parametrize(
    ("lag", "interval", "shown"),
    [(0.01, 1e-3, 1e-3), (0.05, 2e-3, 5e-3), (0.05, 8e-3, 5e-3), (0.012, 8e-3, 8e-3), (0.4, 2e-3, 15e-3)],
)
def test_blocks_of_which_nothing_is_said_stay_below_what_the_log_shows(
    tmp_path: Path, lag: float, interval: float, shown: float
) -> None:
    """Valve and oil add no more than a tenth of the own lag that a log tells, and else no more than an interval."""
    values = made_for(*motor(tmp_path, lag=lag, interval=interval), folder=tmp_path / "made").numbers.values
    added = 2.0 * values["dcv.zeta"] / values["dcv.w0"] + values["continuity.T"]
    assert added == pytest.approx(shown, rel=0.15)
    assert values["dcv.w0"] * values["continuity.T"] == pytest.approx(1.0, rel=1e-3), "both alike"


def test_blocks_of_which_something_is_said_stay_as_they_are(tmp_path: Path) -> None:
    mapping, log = motor(tmp_path, lag=0.01, interval=1e-3)
    mapping.write_text(
        mapping.read_text() + '[machine.parameters]\n"dcv.w0" = "50 rad/s"\n"continuity.T" = "20 ms"\n',
        encoding="utf-8",
    )
    values = made_for(mapping, log, folder=tmp_path / "made").numbers.values
    assert (values["dcv.w0"], values["continuity.T"]) == (50.0, 0.02)


def test_a_motor_has_no_oil_and_no_spool(tmp_path: Path) -> None:
    mapping, log = motor(tmp_path)
    plain = made_for(mapping, log, folder=tmp_path / "made").diagnose
    mapping.write_text(
        mapping.read_text().replace('output = "speed"', 'output = "speed"\ndrive = "electric"')
    )
    electric = made_for(mapping, log, folder=tmp_path / "made").diagnose
    left_out = set(electric["exclude"]) - set(plain["exclude"])
    assert {"continuity.cracking_pressure", "continuity.compressibility", "dcv.hysteresis"} <= left_out
    assert not {"dcv.delay", "dcv.rate_limit", "dcv.stroke_limit", "dead_zone.mismatch"} & set(
        electric["exclude"]
    )
    assert not any(name.startswith("mechanical.") for name in left_out)
    with speaking(Lexicon(blocks=electric["blocks"])):
        assert called("dcv.stroke_limit") == "a stop of the driver's output"
        assert called("dcv.delay") == "a delay of the driver"
        assert with_signals("log p_load") == "log motor current"
        assert block_name("dcv+continuity+mechanical") == "driver + winding + motor"
        german = catalogue("de").messages
        assert german[called("dcv.delay")] == "eine Totzeit des Stellglieds"
        assert german[called("dcv.rate_limit")] == "eine Grenze der Geschwindigkeit des Ausgangs"
    with speaking(Lexicon(blocks=plain["blocks"])):
        assert called("dcv.delay") == "a delay of the valve"


def test_what_nobody_measured_is_a_part_of_full_command(tmp_path: Path) -> None:
    """Full command is 1 mm of spool and 1 bar only by convention: no reader should take them for lengths and pressures."""
    lexicon = Lexicon(units=made_for(*motor(tmp_path), folder=tmp_path / "made").diagnose["units"])
    for si, value in (("m", 1e-3), ("Pa", 1e5), ("N.m", 1.0)):
        unit, scale = lexicon.quantity(si)
        assert (unit, scale * value) == ("full command", pytest.approx(1.0))
        assert lexicon.to_si("full command", si) == pytest.approx(value)
    assert lexicon.quantity("m/s") == ("full command/s", pytest.approx(1e3))
    assert lexicon.to_si("mm", "m") == pytest.approx(1e-3), "what is not told so stays as it is"
    measured = 'spool = { column = "w", unit = "mm" }\n'
    mapping, log = motor(tmp_path, more=measured)
    assert "m" not in made_for(mapping, log, folder=tmp_path / "made").diagnose["units"]


def test_a_variable_that_a_block_lacks_is_named(tmp_path: Path) -> None:
    more = '[compare.signals]\nspeed = { variable = "mechanical.speed" }\n'
    with pytest.raises(UsageError, match="'mechanical' has no 'speed' for the signal 'speed'"):
        made_for(*motor(tmp_path, more=more), folder=tmp_path / "made")


def test_a_speed_against_the_command_is_refused(tmp_path: Path) -> None:
    mapping, _ = motor(tmp_path)
    mapping.write_text(
        mapping.read_text().replace('column = "w"', 'column = "w", sign = -1'), encoding="utf-8"
    )
    with pytest.raises(DataError, match="goes against 'u'"):
        made_for(mapping, load_log(tmp_path / "log.csv", mapping), folder=tmp_path / "made")


def test_what_rings_more_than_it_follows_has_no_sign(tmp_path: Path) -> None:
    """The acceleration of a flexible arm against its torque: a first order says nothing about the sign."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 10.0, 1e-2)
    u = rng.standard_normal(t.size)
    y = np.zeros_like(t)
    for k in range(2, t.size):  # a mode with almost no damping, against its drive
        y[k] = 1.4 * y[k - 1] - 0.98 * y[k - 2] - 0.1 * u[k - 1]
    file, mapping = tmp_path / "arm.csv", tmp_path / "arm.toml"
    np.savetxt(file, np.column_stack([t, u, y]), delimiter=",", header="t,u,y", comments="")
    mapping.write_text(
        'time = { column = "t", unit = "s" }\n[signals]\nu = { column = "u", unit = "1" }\n'
        'y = { column = "y", unit = "bar" }\n[machine]\nchain = ["dcv", "continuity"]\ninput = "u"\noutput = "y"\n'
        'parameters = { "dcv.w0" = "30 rad/s", "continuity.K_c" = "?", "continuity.T" = "?" }\n'
        '[compare.signals]\ny = { variable = "continuity.p_load" }\n',
        encoding="utf-8",
    )
    made = made_for(mapping, load_log(file, mapping), tmp_path / "made")
    assert made.numbers.values["continuity.K_c"] > 0.0


def turned(folder: Path, unit: str, chain: str = '"mechanical"', size: float = 1.0) -> tuple[Path, Log]:
    """The mapping and a log of an axis of 0.1 s whose drive is measured in some unit: 0.02 N m s/rad, or that many bar."""
    t = np.arange(0.0, 20.0, 2e-3)
    drive = np.sin(2.0 * np.pi * 0.5 * t) + 0.3 * np.sin(2.0 * np.pi * 3.1 * t)
    w = np.zeros_like(t)
    for k in range(1, t.size):
        w[k] = w[k - 1] + 2e-3 / 0.1 * (drive[k - 1] / 0.02 - w[k - 1])
    table = np.column_stack([t, drive * size, w])
    np.savetxt(folder / "log.csv", table, delimiter=",", header="t,d,w", comments="")
    mapping = folder / "axis.toml"
    mapping.write_text(
        f"""
time = {{ column = "t", unit = "s" }}
[signals]
drive = {{ column = "d", unit = "{unit}" }}
speed = {{ column = "w", unit = "rad/s" }}
[machine]
chain = [{chain}]
input = "drive"
output = "speed"
speed = "?"
lag = "?"
""",
        encoding="utf-8",
    )
    return mapping, load_log(folder / "log.csv", mapping)


def test_a_torque_or_a_pressure_drives_the_mechanics(tmp_path: Path) -> None:
    by_torque = made_for(*turned(tmp_path, "N.m"), folder=tmp_path / "torque")
    assert by_torque.numbers.values["mechanical.b"] == pytest.approx(0.02, rel=0.05)
    assert by_torque.diagnose["units"] == {"Pa": "N.m"}
    by_pressure = made_for(*turned(tmp_path, "bar"), folder=tmp_path / "pressure")
    # on an area and an arm of one the friction of 0.02 bar a rad/s is one of 2000 N m
    assert by_pressure.numbers.values["mechanical.b"] == pytest.approx(2000.0, rel=0.05)
    shown = Lexicon(units=by_pressure.diagnose["units"]).quantity("N.m.s/rad")
    assert shown == ("bar.s/rad", pytest.approx(1e-5))


def test_what_is_no_torque_is_told_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(
        DataError, match=r"signals\.drive: .* is a torque \[N\.m\] or a pressure, and no '%'; .*'gain'"
    ):
        made_for(*turned(tmp_path, "%"), folder=tmp_path / "made")


def test_of_a_speed_too_the_missing_column_of_the_other_direction_is_asked_for(tmp_path: Path) -> None:
    mapping, log = motor(tmp_path)
    machine = machine_of(None, log, mapping)
    record = prepare(log, machine)
    assert not one_way(record, machine)
    record.signals["u"] = np.maximum(record.signals["u"], 0.0)
    (text,) = one_way(record, machine)
    # a symmetric command: as far back as forth, but for the lag with which the motor turns at the end of each half
    assert 80 <= int(text.partition("goes back ")[2].partition(" %")[0]) <= 110
    assert "name it as `minus`" in text


def test_what_a_machine_file_lacks_is_said_with_its_remedy(tmp_path: Path) -> None:
    mapping, log = motor(tmp_path)
    text = mapping.read_text(encoding="utf-8")
    mapping.write_text(text.replace('output = "speed"', 'output = "slew"'), encoding="utf-8")
    with pytest.raises(DataError, match='it has u, speed; say output = "speed" in'):
        made_for(mapping, log)
    forced = text.replace('["dead_zone", "dcv", "continuity", "mechanical"]', '["mechanical"]')
    forced = forced.replace('input = "u"', 'input = "pull"').replace("u = {", "pull = {", 1)
    mapping.write_text(
        forced.replace('column = "u", unit = "1"', 'column = "u", unit = "kip"'), encoding="utf-8"
    )
    with pytest.raises(DataError, match="'kip' is a force, and the axis turns: say motion = \"travel\""):
        made_for(mapping)


STATED = 'speed = "2 rad/s"\nlag = "100 ms"'


def stated(folder: Path, largest: float, stated: str = STATED) -> tuple[Path, Log]:
    """A motor of 2 rad/s and 100 ms at a command of 1 that steps every second (synthetic), and what a file states of it."""
    rng = np.random.default_rng(2)
    t = 0.01 * np.arange(2000)
    u = np.repeat(rng.uniform(-largest, largest, 20), 100)
    w = np.zeros_like(t)
    keep = np.exp(-0.1)
    for k in range(1, t.size):
        w[k] = keep * w[k - 1] + (1.0 - keep) * 2.0 * u[k - 1]
    w += rng.normal(0.0, 0.01 * largest, t.size)
    file, mapping = folder / "log.csv", folder / "motor.toml"
    np.savetxt(file, np.column_stack([t, u, w]), delimiter=",", header="t,u,w", comments="")
    text = MACHINE.format(unit="rad/s", more="").replace('speed = "?"\nlag = "?"', stated)
    mapping.write_text(text, encoding="utf-8")
    return mapping, load_log(file, mapping)


@pytest.mark.parametrize("largest", [1.0, 24.0])
def test_a_motor_as_its_file_states_it_is_adequate(tmp_path: Path, largest: float) -> None:
    """Whatever the unit of the command, 1 or volts: no limit, valve or oil of which nothing was said shows."""
    mapping, log = stated(tmp_path, largest)
    found = diagnose(log, model=machine_of(None, log, mapping))
    assert found.verdict == "adequate"
    # one of the command is one of the torque: what the answer shows is in the command's unit
    assert found.values["mechanical.b"] == pytest.approx(0.5, rel=0.01)


def test_a_wrong_speed_is_told_in_the_file_s_own_numbers(tmp_path: Path) -> None:
    """Within 1 %: noise of a hundredth of the largest speed leaves a tenth of that."""
    mapping, log = stated(tmp_path, 24.0, 'speed = "2.2 rad/s"\nlag = "100 ms"')
    found = diagnose(log, model=machine_of(None, log, mapping))
    (said,) = as_stated(found)
    number = said.partition("speed ")[2].partition(" rad/s instead of 2.2 rad/s and lag ")
    assert float(number[0]) == pytest.approx(2.0, rel=0.01)
    assert float(number[2].partition(" ms instead of 100 ms")[0]) == pytest.approx(100.0, rel=0.01)


def test_a_record_that_begins_with_its_only_step_tells_speed_and_lag(tmp_path: Path) -> None:
    t = 0.01 * np.arange(200)
    file, mapping = tmp_path / "log.csv", tmp_path / "motor.toml"
    w = 20.0 * -np.expm1(-t / 0.1)
    np.savetxt(file, np.column_stack([t, 10.0 + 0.0 * t, w]), delimiter=",", header="t,u,w", comments="")
    mapping.write_text(MACHINE.format(unit="rad/s", more=""), encoding="utf-8")
    numbers = made_for(mapping, load_log(file, mapping), folder=tmp_path / "made").numbers
    assert (numbers.speed, numbers.lag) == (pytest.approx(2.0, rel=0.02), pytest.approx(0.1, rel=0.05))


def test_what_is_stated_is_not_asked_of_a_log_that_stands_still(tmp_path: Path) -> None:
    mapping, log = stated(tmp_path, 0.0)
    assert made_for(mapping, log, folder=tmp_path / "made").numbers.speed == pytest.approx(2.0)
