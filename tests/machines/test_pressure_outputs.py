"""A machine that builds up a pressure and moves nothing, as a pump does in a vessel (synthetic)."""

from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.model.choice import machine_of
from cosim.errors import DataError
from cosim.logs import load_log
from cosim.logs.guess import guesses, mapping_text
from cosim.logs.overview import overview
from cosim.machines import made_for

STEP, LAG, MOST = 0.02, 1.5, 80.0  # s, s, bar at full command


@pytest.fixture
def vessel(tmp_path: Path) -> tuple[Path, Path]:
    """A log of a pump in steps and of the pressure, and its mapping as `cosim init --machine` writes it."""
    time = STEP * np.arange(4000)
    rng = np.random.default_rng(4)
    pump = np.repeat(rng.uniform(0.0, 50.0, 40), 100)  # per cent
    pressure, kept = np.zeros(time.size), np.exp(-STEP / LAG)
    for k in range(1, time.size):
        pressure[k] = kept * pressure[k - 1] + (1.0 - kept) * MOST * pump[k - 1] / 100.0
    pressure += rng.normal(0.0, 0.05, time.size)
    log, mapping = tmp_path / "vessel.csv", tmp_path / "vessel.toml"
    np.savetxt(
        log, np.column_stack([time, pump, pressure]), delimiter=",", comments="", fmt="%.6g",
        header="time (s),pump (%),pressure (bar)",
    )  # fmt: skip
    found = overview(log)
    mapping.write_text(mapping_text(found, guesses(found, machine=True), None), encoding="utf-8")
    return log, mapping


@pytest.mark.parametrize("head", ["time,PWM,Setpoint_kPa,Feedback_kPa", "time,PWM,Target pressure,Pressure"])
def test_what_was_asked_of_a_pressure_is_no_reading(tmp_path, head):
    """The demanded pressure, in kPa, was the pressure at port A: the end of its name was read as "k Pa"."""
    t = STEP * np.arange(500)
    asked = np.repeat([10.0, 20.0, 5.0, 15.0, 30.0], 100)
    shown = np.convolve(asked, np.full(30, 1.0 / 30.0))[: t.size] + 0.1 * np.sin(t)
    log = tmp_path / "pump.csv"
    np.savetxt(
        log,
        np.column_stack([t, 2.0 * asked + 0.1 * np.cos(t), asked, shown]),
        delimiter=",",
        comments="",
        header=head,
    )
    made = guesses(overview(log), machine=True)
    assert {name: guess.column.index for name, guess in made.items()} == {"u": 1, "p_a": 3}


@pytest.mark.parametrize("head", ["time,Setpoint_kPa,Feedback_kPa", "time,demand,pressure (bar)"])
def test_what_was_asked_of_a_regulator_drives_its_pressure(tmp_path, head):
    """A pressure-reducing valve with its own loop: "Missing: a column for u"."""
    t = STEP * np.arange(500)
    asked = np.repeat([10.0, 20.0, 5.0, 15.0, 30.0], 100)
    shown = np.convolve(asked, np.full(30, 1.0 / 30.0))[: t.size] + 0.1 * np.sin(t)
    log = tmp_path / "valve.csv"
    np.savetxt(log, np.column_stack([t, asked, shown]), delimiter=",", comments="", header=head)
    found = overview(log)
    made = guesses(found, machine=True)
    assert {name: guess.column.index for name, guess in made.items()} == {"u": 1, "p_a": 2}
    assert made["u"].gain == pytest.approx(1.0 / 30.0, rel=1e-3)
    assert 'output = "p_a"' in mapping_text(found, made, None)


def test_the_only_pressure_is_what_was_measured_where_nothing_moves(vessel):
    """It said "Missing: a column for what was measured, such as ... the pressures", beside a column called pressure."""
    log, mapping = vessel
    machine = made_for(mapping, load_log(log, mapping)).machine
    assert (machine.chain, machine.output) == (("dead_zone", "dcv", "continuity"), "p_a")


def test_the_log_tells_the_lag_of_a_measured_pressure_as_well_as_its_gain(vessel):
    """A lag of 1.5 s beside an oil column of 5 ms was named a limit of the spool's speed, 0.099 mm/s."""
    log, mapping = vessel
    made = made_for(mapping, load_log(log, mapping))
    assert made.numbers.values["continuity.T"] == pytest.approx(LAG, rel=0.3), "where a fit begins"
    gain = made.numbers.values["continuity.K_c"] * made.numbers.values["dcv.K"]
    assert gain == pytest.approx(1e5 * MOST, rel=0.3)
    assert {"continuity.T", "continuity.K_c"} <= set(made.diagnose["free"])


def test_what_the_file_states_of_the_pressure_is_not_asked_for(vessel):
    log, mapping = vessel
    stated = mapping.read_text(encoding="utf-8") + '\n[machine.parameters]\n"continuity.T" = "40 ms"\n'
    mapping.write_text(stated, encoding="utf-8")
    assert made_for(mapping, load_log(log, mapping)).numbers.values["continuity.T"] == pytest.approx(0.04)


def test_a_spool_before_a_measured_pressure_is_told_in_parts_of_full_command(vessel):
    """A stop was told at 0.26 mm of a spool that nobody has seen."""
    log, mapping = vessel
    words = machine_of(None, [load_log(log, mapping)], mapping).options.units
    assert (words["m"], words["Pa/m"]) == ("1000 full command", "1e-08 bar/full command")
    assert "Pa" not in words


def test_speed_and_lag_of_a_chain_that_ends_with_a_pressure_are_answered_with_what_to_write(vessel):
    log, mapping = vessel
    asked = mapping.read_text(encoding="utf-8") + 'speed = "?"\n'
    mapping.write_text(asked, encoding="utf-8")
    with pytest.raises(DataError, match=r"leave them out: the log tells .*continuity\.T"):
        made_for(mapping, load_log(log, mapping))
