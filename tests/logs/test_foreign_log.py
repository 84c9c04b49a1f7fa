"""The first contact with a log of other names: what `cosim info` shows, what `cosim init` guesses and writes."""

import json
import re
import time

import numpy as np
import pytest
from log_files import TOP
from scipy.io import savemat

from cosim.api.matching import write_mapping
from cosim.errors import ColumnsError
from cosim.logs import load_log, load_mapping
from cosim.logs.clocks import counted, plain
from cosim.logs.guess import NAMES, guesses, likely, mapping_text, of_other_axis, once_more
from cosim.logs.overview import overview, spelled
from cosim.machines import made_for
from cosim.rig import make_log
from cosim.signals import SIGNALS

GERMAN = {
    "time": ("Zeit (ms)", 1e3),
    "u": ("Ventilbefehl (%)", 100.0),
    "spool": ("Schieberweg (mm)", 1e3),
    "p_supply": ("Systemdruck (bar)", 1e-5),
    "p_a": ("Druck A (bar)", 1e-5),
    "p_b": ("Druck B (bar)", 1e-5),
    "slew": ("Schwenkwinkel (Grad)", 180.0 / np.pi),
}


@pytest.fixture(scope="module")
def rig():
    """Three seconds of the virtual rig, SI."""
    run = make_log("steps", 3.0, [], seed=1)
    return {"time": np.arange(run.u.size) * 1e-3} | {n: run.signals[n] for n in GERMAN if n in run.signals} | {
        "u": run.u, "p_supply": run.p_supply, "p_a": run.p_a, "p_b": run.p_b
    }  # fmt: skip


@pytest.fixture
def german(rig, write):
    """The same as a German logger writes it."""
    columns = [rig[name] * scale for name, (_, scale) in GERMAN.items()]
    head = ";".join([*(text for text, _ in GERMAN.values()), "Öltemperatur (°C)"])
    lines = [
        ";".join(f"{x:.9g}".replace(".", ",") for x in (*row, 45.5)) for row in zip(*columns, strict=True)
    ]
    return write("\n".join([head, *lines]) + "\n", "messung.csv", encoding="cp1252")


@pytest.fixture
def cosim(finished, monkeypatch):
    """Runs the command line in this process."""
    monkeypatch.chdir(TOP)
    return finished


def test_a_german_log_is_shown_guessed_and_read(cosim, german, rig):
    shown = cosim("info", german, "--plot")
    assert shown.returncode == 0, shown.stderr
    first = "samples, 3 s at 1000 a second, no gap; time is 'Zeit (ms)' in ms; 6 of 8 columns look like signals of the crane"
    assert first in shown.stdout.splitlines()[0]
    assert "Öltemperatur (°C)" in shown.stdout
    assert "u is probably 'Ventilbefehl (%)' [%]: its name ('Ventilbefehl')" in shown.stdout
    assert len(re.findall("[▁▂▃▄▅▆▇█]{60}", shown.stdout)) == 8
    assert shown.stdout.splitlines()[-1].startswith(f"Next: cosim init {german}")
    made = cosim("init", german)
    assert made.returncode == 0, made.stderr
    log = load_log(german, german.with_suffix(".toml"))
    assert set(log.signals) == set(GERMAN) - {"time"}
    np.testing.assert_allclose(log.time, rig["time"], atol=1e-12)
    for name in log.signals:
        # nine digits were written; the scale of a pressure is some 1e7 Pa
        np.testing.assert_allclose(
            log[name], rig[name], rtol=1e-8, atol=1e-8 * np.max(np.abs(rig[name])), err_msg=name
        )
    assert cosim("init", german).returncode == 2, "a mapping is not written over"


def test_columns_as_json_and_a_model_by_option(cosim, german):
    facts = json.loads(cosim("info", german, "--json").stdout)
    assert facts["kind"] == "log with other columns"
    assert {name: g["column"] for name, g in facts["guesses"].items()} == {
        name: text for name, (text, _) in GERMAN.items() if name != "time"
    }
    assert "cosim init" in facts["why"]
    out = german.with_name("own.toml")
    assert cosim("init", german, "--model", "simplified", "--out", out).returncode == 0
    assert load_log(german, out).model == "simplified"


def test_every_message_about_columns_names_the_command(cosim, german, write):
    for text in ("time [s],slew\n0,1\n1,2\n", "slew [deg]\n1\n2\n", "time [s],u [deg]\n0,1\n1,2\n"):
        path = write(text, "a.csv")
        with pytest.raises(ColumnsError, match=re.escape(f"'cosim init {path}'")):
            load_log(path)
    assert f"'cosim init {german}'" in cosim("diagnose", german).stderr


@pytest.mark.parametrize(
    ("signal", "headings"),
    [
        ("u", ["Command", "valve_cmd", "Ventilansteuerung", "Stellgröße", "commande", "mando joystick", "ohjaus", "PWM"]),
        ("spool", ["spoolPosition", "Schieberweg", "tiroir", "corredera", "luistin asento", "slide pos"]),
        ("p_supply", ["Supply pressure", "pump_pressure", "Pumpendruck", "Versorgungsdruck", "pression d'alimentation",
                      "p0", "presión bomba"]),
        ("p_a", ["pA", "PA", "p_a1", "Druck A", "pressure port A", "pression A", "tryck A", "paine A"]),
        ("p_b", ["pB", "PB", "Druck_B", "pressure.B", "presión B"]),
        ("slew", ["Slew angle", "swing", "Schwenkwinkel", "Drehwinkel", "angle", "ángulo de giro", "kulma", "theta"]),
        ("slew_estimate", ["slew estimate", "geschätzter Winkel", "observer angle"]),
    ],
)  # fmt: skip
def test_names_in_several_languages(signal, headings, write):
    for heading in headings:
        path = write(f"t,{heading}\n" + "".join(f"{k / 100},{k % 7}\n" for k in range(50)))
        assert list(guesses(overview(path))) == [signal], heading


def test_a_car_s_throttle_is_its_command_and_a_throttle_s_position_is_not(write):
    """Its safety switch was, the only column that moves in steps."""
    time = np.arange(400) / 10
    throttle = 0.2 + 0.02 * np.sin(time) + 0.01 * np.sin(5.3 * time)
    safe, speed = (time > 3.0).astype(float), np.where(time > 3.0, 6.0 * throttle, 0.0)
    for name, drives in (("throttle", "throttle"), ("throttle position", "safety_value")):
        rows_ = "".join(
            f"{t},{s:g},{v:.4f},{u:.4f}\n" for t, s, v, u in zip(time, safe, speed, throttle, strict=True)
        )
        made = guesses(overview(write(f"t,safety_value,vel encoder,{name}\n" + rows_)), machine=True)
        assert made["u"].column.label.name == drives


def test_names_that_say_something_else_are_left_alone(write):
    for heading in (
        "oil temperature",
        "slew speed (deg/s)",
        "Drehzahl (1/min)",
        "Drehmoment (Nm)",
        "battery",
        "x",
    ):
        ramp = np.sin(np.arange(50.0))
        path = write(f"t,{heading}\n" + "".join(f"{k / 100},{ramp[k]}\n" for k in range(50)))
        assert guesses(overview(path)) == {}, heading


def test_what_names_do_not_say_units_and_shapes_may(write):
    time = np.arange(400) / 100
    columns = {
        "ch0 (V)": np.where(time % 2 < 1, 5.0, -5.0),
        "ch1 (bar)": 80 + time,
        "ch2 (bar)": 170 + np.sin(time),
        "ch3 (bar)": 90 - time,
        "ch4 (deg)": 10 * np.sin(time),
        "ch5 (mm)": np.cos(time),
    }
    rows = zip(time, *columns.values(), strict=True)
    text = (
        ",".join(["ch", *columns]) + "\n" + "".join(",".join(f"{x:.6f}" for x in row) + "\n" for row in rows)
    )
    found = overview(write(text))
    made = guesses(found)
    assert {n: g.column.label.name for n, g in made.items()} == {
        "u": "ch0", "p_a": "ch1", "p_supply": "ch2", "p_b": "ch3", "slew": "ch4", "spool": "ch5"
    }  # fmt: skip
    assert (made["u"].gain, made["u"].unit, made["u"].check) == (0.2, "1", True)
    assert found.clock is not None
    assert (found.clock.column, found.clock.unit) == (0, "s")
    log = load_log(found.path, _written(found, made))
    assert np.max(np.abs(log["u"])) == pytest.approx(1.0)


def _written(found, made):
    path = found.path.with_suffix(".toml")
    path.write_text(mapping_text(found, made, "full_order"), encoding="utf-8")
    return path


@pytest.mark.parametrize(("step", "unit"), [(0.001, "s"), (0.05, "s"), (1, "ms"), (20, "ms"), (1000, "us")])
def test_the_unit_of_a_clock_without_one(step, unit, write):
    found = overview(write("t,slew\n" + "".join(f"{k * step},{k % 5}\n" for k in range(100))))
    assert found.clock is not None
    assert found.clock.unit == unit
    assert "samples a second if it counts" in found.clock.guessed
    assert "# CHECK: steps of" in mapping_text(found, guesses(found), "full_order")


def test_gaps_and_text_are_shown_and_do_not_stop_anything(cosim, write):
    rows = [f"{k / 100},{k % 3},{'auto' if k < 50 else 'hand'}" for k in range(100) if k not in (40, 41, 42)]
    path = write("time,angle,mode\n" + "\n".join(rows) + "\n")
    found = overview(path)
    assert found.clock is not None
    assert (found.clock.gaps, found.clock.backwards) == (1, 0)
    assert found.columns[2].kind == "text"
    shown = cosim("info", path)
    assert shown.returncode == 0
    assert "'mode': row 2, column 'mode': 'auto' is not a number" in shown.stderr
    assert guesses(found)["slew"].unit == "rad"


def test_a_log_of_simulink(tmp_path, rig):
    signals = [
        {"values": rig[name][:, None] * scale, "label": label, "dimensions": 1.0}
        for name, label, scale in (("u", "valve cmd", 1.0), ("slew", "slew angle [deg]", 180 / np.pi))
    ]
    fields = np.array([tuple(s.values()) for s in signals], dtype=[(k, object) for k in signals[0]])
    path = tmp_path / "simout.mat"
    time = 10.0 * rig["time"]  # not the interval that is proposed where nothing is known
    savemat(path, {"simout": {"time": time[:, None], "signals": fields, "blockName": "model/To Workspace"}})
    found = overview(path)
    made = guesses(found)
    assert set(made) == {"u", "slew"}
    mapping = _written(found, made)
    log = load_log(path, mapping)
    np.testing.assert_allclose(log["slew"], rig["slew"], rtol=1e-12)
    np.testing.assert_allclose(log.time, time)
    text = mapping_text(found, made, "full_order")
    assert "no column looks like a time" not in text
    assert "[signals.time]" not in text, "the stamps are no column that was left over"


def test_two_columns_of_one_name_are_told_apart_by_number(write):
    path = write("t,Druck A,Druck A\n" + "".join(f"{k / 100},{80 + k % 7},{k % 5}\n" for k in range(50)))
    found = overview(path)
    log = load_log(path, _written(found, guesses(found)))
    assert log["p_a"].max() == pytest.approx(86e5)


def test_words_and_units():
    assert plain("SchwenkWinkel_ist (Größe)") == "schwenk winkel ist grosse"
    assert [spelled(u) for u in ("Grad", "Nm", "U/min", "°", "-", "mm", "nonsense", None)] == [
        "deg", "N.m", "rpm", "deg", "1", "mm", None, None
    ]  # fmt: skip
    assert set(NAMES) <= set(SIGNALS)


def test_a_unit_may_be_said_in_a_sentence(write):
    headings = (
        "Time (in ms)",
        "Laser (in mm)",
        "Force (in N)",
        "Width (in)",
        "Rate (in/s)",
        "Druck [Einheit: bar]",
    )
    found = overview(write(",".join(headings) + "\n" + rows(np.column_stack([np.arange(40.0)] * 6))))
    assert [c.unit for c in found.columns] == ["ms", "mm", "N", "in", "in/s", "bar"]


def test_a_length_beside_a_force_is_the_place_of_the_axis(write):
    """A cylinder on a test stand: no command was logged, and nothing is called a position."""
    t = np.arange(0.0, 20.0, 0.01)
    table = np.column_stack([1e3 * t, 20.0 + 20.0 * np.sin(t), 150.0 + 6.0 * np.sign(np.cos(t))])
    path = write("Time (in ms),Laser (in mm),Force (in N)\n" + rows(table))
    made = guesses(overview(path), machine=True)
    assert {name: guess.column.label.name for name, guess in made.items()} == {
        "travel": "Laser",
        "force": "Force",
    }


def test_init_needs_a_log(cosim, tmp_path):
    done = cosim("init", tmp_path / "a.ssp")
    assert (done.returncode, "name the log too" in done.stderr) == (2, True)


NAMELESS = ("time", "u", "spool", "p_supply", "p_b", "p_a", "slew")
UNITS = {
    "u": 1.0,
    "spool": 1e3,
    "p_supply": 1e-5,
    "p_a": 1e-5,
    "p_b": 1e-5,
    "slew": 180.0 / np.pi,
    "time": 1.0,
}


@pytest.fixture(scope="module")
def nameless():
    """Twenty seconds of a drive whose pressures have traded places, in the units that people read."""
    run = make_log("multisine", 20.0, [], seed=4)
    columns = {"time": np.arange(run.u.size) * 1e-3, "u": run.u, **run.signals}
    return np.column_stack([columns[name] * UNITS[name] for name in NAMELESS])


def rows(table):
    return "\n".join(",".join(f"{x:.9g}" for x in row) for row in table) + "\n"


@pytest.mark.parametrize("head", ["Time,u,Var3,Var4,Var5,Var6,Var7\n", ""])
def test_columns_without_names_are_told_by_how_they_move(write, nameless, head):
    path = write(head + rows(nameless), "export.csv")
    found = overview(path)
    made = guesses(found)
    assert found.header == bool(head)
    if not head:  # a smooth command among nameless columns is nobody's to guess
        assert "u" not in made
        assert {n: g.column.index for n, g in made.items()} == {"p_supply": 3, "p_a": 4, "p_b": 5}
        return
    assert {n: g.column.index for n, g in made.items()} == {n: NAMELESS.index(n) for n in made}
    assert set(made) == set(NAMELESS) - {"time"}
    assert [made[n].unit for n in ("spool", "p_a", "slew")] == ["mm", "bar", "deg"]
    assert all(guess.check for guess in made.values())


def test_a_file_without_a_header_is_mapped_by_place(cosim, write, nameless):
    path = write(rows(nameless), "export.csv")
    shown = cosim("info", path)
    assert shown.returncode == 0, shown.stderr
    assert "time is column 1, taken to count s" in shown.stdout.splitlines()[0]
    refused = cosim("diagnose", path)
    assert (refused.returncode, f"'cosim init {path}' write a mapping" in refused.stderr) == (3, True)
    assert cosim("init", path).returncode == 0
    mapping = path.with_suffix(".toml")
    mapping.write_text(mapping.read_text() + '[signals.u]\ncolumn = 2\nunit = "1"\n')
    log = load_log(path, mapping)
    assert set(log.signals) == {"u", "p_supply", "p_a", "p_b"}
    np.testing.assert_allclose(log["u"], nameless[:, 1], atol=1e-8)


@pytest.fixture
def servo():
    """(n, 3) time, pulse of a valve servo in % (7.5 is none) and angle of the drive: it stands between its strokes."""
    rng = np.random.default_rng(4)
    command = np.repeat(np.where(np.arange(60) % 3 == 1, rng.uniform(-1.0, 1.0, 60), 0.0), 40)
    command[[200, 900]] = 1.0, -1.0
    time = np.arange(command.size) / 20
    return np.column_stack([time, 7.5 + 2.5 * command, np.cumsum(0.8 * command / 20)])


def test_a_command_that_rests_where_the_machine_stands_has_its_zero_there(write, servo):
    made = guesses(overview(write("t,Swing Cmd,Swing angle\n" + rows(servo))))
    assert (made["u"].zero, made["u"].unit, made["u"].gain) == (7.5, "1", 0.4)
    assert "the machine stands at 7.5" in made["u"].why


def test_a_command_of_which_no_reading_is_near_0_is_asked_for_its_zero(write, servo):
    """A joystick of 1 to 4 V without a rest in the log: a gain alone would make a constant load of its middle."""
    servo[:, 1] = np.where(servo[:, 1] == 7.5, 5.2, servo[:, 1])
    found = overview(write("t,Swing Cmd,Swing angle\n" + rows(servo)))
    made = guesses(found)
    assert "`zero` may be missing" in made["u"].why
    assert "# zero = ?    # CHECK" in mapping_text(found, made, "full_order")
    servo[:, 1] -= 7.5
    found = overview(write("t,Swing Cmd,Swing angle\n" + rows(servo)))
    assert "zero" not in guesses(found)["u"].why


def test_a_servo_s_pulse_is_the_command_where_nothing_is_called_one(write, servo):
    """Not a measured torque beside it, and not a channel that stays empty."""
    made = guesses(
        overview(
            write(
                "t,ESC signal (µs),Servo 3 (µs),Torque (N·m),Motor Speed (RPM)\n"
                + "\n".join(
                    f"{t},,{1500 + 40 * u},{1e-2 * u * u:.4f},{80 * u:.3f}"
                    for t, u in servo[:, :2] - [0, 7.5]
                )
            )
        )
    )
    assert made["u"].column.label.name == "Servo 3"
    assert made["u"].unit == "1"
    assert "torque" not in made


def test_a_level_that_is_held_while_the_machine_moves_is_no_zero(write, servo):
    servo[:, 1] = np.where(servo[:, 1] == 7.5, 5.2, servo[:, 1])
    servo[:, 2] = np.cumsum(np.where(servo[:, 1] == 5.2, -0.05, 0.02))
    assert guesses(overview(write("t,Swing Cmd,Swing angle\n" + rows(servo))))["u"].zero == 0.0


def test_init_makes_a_machine_of_its_own(cosim, write, servo):
    path = write("t,Swing Cmd,Swing angle\n" + rows(servo))
    done = cosim("init", path, "--machine")
    assert done.returncode == 0, done.stderr
    made = made_for(path.with_suffix(".toml"), load_log(path, path.with_suffix(".toml")))
    assert made.numbers.speed == pytest.approx(0.8, rel=0.05)
    assert made.diagnose["free"] == ["mechanical.J", "mechanical.b"]
    # a machine as slow as its log is not simulated in milliseconds
    assert made.diagnose["step"] == f"{min(0.05 / 5, made.numbers.lag / 10):.6g} s"
    refused = cosim("init", path, "--machine", "--model", "simplified", "--force")
    assert (refused.returncode, "--machine makes a model of its own" in refused.stderr) == (2, True)


def test_init_makes_a_machine_of_a_cylinder(cosim, write, servo):
    """A valve's voltage and the positions of two cylinders, one as it was asked for: the one that its valve moves counts."""
    boom = 100.0 * servo[:, 2]  # mm: 80 mm/s at full command
    table = np.column_stack([servo[:, :2], 0.5 * boom[::-1], boom + 3.0, boom])
    path = write(
        "t,Boom valve (V),Arm cylinder (mm),Boom position ref (mm),Boom position (mm)\n" + rows(table)
    )
    done = cosim("init", path, "--machine")
    assert (done.returncode, "Boom position (mm) -> travel [mm]" in done.stdout) == (0, True), done.stderr
    mapping = path.with_suffix(".toml")
    log = load_log(path, mapping)
    np.testing.assert_allclose(log["travel"], boom / 1000)
    made = made_for(mapping, log)
    assert made.numbers.speed == pytest.approx(0.08, rel=0.05)
    assert made.diagnose["units"]["kg.m2"].endswith("s2/m"), "a mass as a command that moves it"


def test_init_makes_a_machine_of_a_motor(cosim, write, servo):
    """A motor whose speed is read: no angle, no sensor of one, and the command rests where the speed is none."""
    speed = np.gradient(servo[:, 2], servo[:, 0]) * 60 / (2 * np.pi)
    path = write(
        "Zeit (s),PWM,Drehzahl soll (1/min),Drehzahl\n"
        + rows(np.column_stack([servo[:, :2], speed + 1, speed]))
    )
    done = cosim("init", path, "--machine")
    assert (done.returncode, "Drehzahl -> speed [rpm]" in done.stdout) == (0, True), done.stderr
    mapping = path.with_suffix(".toml")
    made = made_for(mapping, load_log(path, mapping))
    assert made.numbers.speed == pytest.approx(0.8, rel=0.1)
    assert "zero = 7.5" in mapping.read_text()
    assert '"sensor"' not in mapping.read_text()


@pytest.mark.parametrize(
    ("signal", "headings"),
    [
        ("travel", ["PosFb", "cylinder_position", "Zylinderweg", "Hub (mm)", "stroke_act", "Boom displacement", "Lage"]),
        ("speed", ["omega", "motor speed", "Drehzahl (1/min)", "EXP_Velocity", "rpm"]),
        (None, ["PosRef", "Position soll", "target position", "set speed", "Solldrehzahl"]),
        ("slew", ["Winkel", "angle (deg)", "motor position [rad]", "Position (°)"]),
    ],
)  # fmt: skip
def test_what_the_axis_of_another_machine_shows(signal, headings, write):
    ramp = np.sin(np.arange(50.0))
    for heading in headings:
        path = write(f"t,{heading}\n" + "".join(f"{k / 100},{ramp[k]}\n" for k in range(50)))
        made = guesses(overview(path), machine=True)
        assert list(made) == ([] if signal is None else [signal]), heading
        assert not {"travel", "speed"} & set(guesses(overview(path))), "the crane's axis shows an angle"


def motor(count=3000, step=0.005, lag=0.1):
    """Stamps, a command in volts that is random in steps and rests now and then, and the speed that follows, in rad/s."""
    rng = np.random.default_rng(3)
    command = np.repeat(np.round(rng.uniform(-12, 12, count // 60), 1), 60) * (np.arange(count) % 600 < 480)
    speed = np.zeros(count)
    for k in range(1, count):
        speed[k] = speed[k - 1] + step / lag * (18.0 * command[k - 1] - speed[k - 1])
    return np.arange(count) * step, command, speed


@pytest.mark.parametrize(
    ("heading", "found"),
    [
        ("t,Input,Velo", {"u": "Input", "speed": "Velo"}),
        ("t,input signal,Motor Angular Velocity", {"u": "input signal", "speed": "Motor Angular Velocity"}),
        ("t,Chirp,AngVel", {"u": "Chirp", "speed": "AngVel"}),
        ("t,voltage,Drehzahl", {"u": "voltage", "speed": "Drehzahl"}),
        ("t,u,y", {"u": "u", "speed": "y"}),
        ("t,Analog Input 1,omega", {"u": "Analog Input 1", "speed": "omega"}),
        ("t,torque,omega", {"torque": "torque", "speed": "omega"}),
    ],
)
def test_the_command_of_a_motor_is_what_its_motion_follows(heading, found, write):
    table = np.column_stack(motor())
    made = guesses(overview(write(f"{heading}\n{rows(table)}")), machine=True)
    assert {name: g.column.label.name for name, g in made.items()} == found


@pytest.mark.parametrize(("name", "unit"), [("voltage", "1"), ("Spannung", "1"), ("u", "%")])
def test_a_voltage_without_a_unit_is_no_per_cent(name, unit, write):
    time, command, speed = motor()
    command = command / np.abs(command).max() * 4.66
    made = guesses(
        overview(write(f"t,{name},rpm\n{rows(np.column_stack([time, command, speed]))}")), machine=True
    )
    assert made["u"].unit == unit
    assert made["u"].gain == pytest.approx(1.0 if unit == "%" else 1.0 / 4.66, rel=1e-3)


def test_the_motion_of_a_motor_is_what_follows_its_command(write):
    time, command, speed = motor()
    noise = np.random.default_rng(4).normal(size=time.size)
    table = np.column_stack([time, command, 20 + noise, speed + noise, 0.7 * speed + 9 * noise])
    made = guesses(overview(write(f"t,u,ch1,ch2,ch3\n{rows(table)}")), machine=True)
    assert {n: g.column.label.name for n, g in made.items()} == {"u": "u", "speed": "ch2"}
    assert "(as 1 more does)" in made["speed"].why
    assert made["speed"].check
    turned = np.column_stack([time, command, np.cumsum(speed) * 0.005])
    made = guesses(overview(write(f"t,u,y\n{rows(turned)}")), machine=True)
    assert set(made) == {"u", "slew"}, "its rate of change follows"


@pytest.mark.parametrize(
    ("heading", "drive"),
    [
        ("t,u,omega", True),
        ("t,pwm,angle", True),
        ("t,u,angle", False),  # nothing tells
        ("t,valve,omega", False),
        ("t,motor_cmd,cylinder_position", False),
    ],
)
def test_a_machine_is_electric_where_a_motor_is_shown_and_no_oil(heading, drive, write):
    time, command, speed = motor()
    found = overview(write(f"{heading}\n{rows(np.column_stack([time, command, speed]))}"))
    text = mapping_text(found, guesses(found, machine=True), None)
    assert ('drive = "electric"' in text) == drive


def test_a_speed_that_was_logged_in_steps_is_no_command(write):
    time, command, speed = motor()
    held = np.repeat(speed[::5], 5)
    smooth = command + 1e-3 * np.sin(time)
    found = guesses(
        overview(write(f"t,Angular_Velocity,other\n{rows(np.column_stack([time, held, smooth]))}"))
    )
    assert "u" not in found


def test_columns_that_move_otherwise_are_left_alone(write):
    time = np.arange(4000) / 100
    rng = np.random.default_rng(1)
    command = np.repeat(rng.uniform(-1, 1, 40), 100)
    columns = [
        time,
        command,
        rng.normal(size=4000).cumsum(),
        20 + 5 * np.sin(time),
        40 + rng.normal(size=4000),
    ]
    found = guesses(overview(write("t,u,Data_1,Data_2,Data_3\n" + rows(np.column_stack(columns)))))
    assert list(found) == ["u"]
    mirrored = [
        time,
        command,
        85 + 5 * command,
        85 - 5 * command,
        np.full(4000, 170.0) + rng.normal(size=4000),
    ]
    table = rows(np.column_stack(mirrored))
    assert list(guesses(overview(write("t,u,oil,air,water\n" + table)))) == ["u"], (
        "names that say something else"
    )
    assert set(guesses(overview(write("t,u,ch1,ch2,ch3\n" + table)))) == {"u", "p_a", "p_b", "p_supply"}


def test_the_command_of_the_axis_whose_angle_is_there(write):
    moving = np.sin(np.arange(50.0))
    lines = "".join(f"{k / 20},{x},{0.5 * x},{x},{x}\n" for k, x in enumerate(moving))
    made = guesses(overview(write(f"Time,Boom Cmd,Swing Cmd,Boom Ms,Swing Ms\n{lines}")))
    assert {n: g.column.label.name for n, g in made.items()} == {"u": "Swing Cmd", "slew": "Swing Ms"}
    lines = "".join(f"{k / 20},0,{x}\n" for k, x in enumerate(moving))
    made = guesses(overview(write(f"Time,Arm duty,Boom duty\n{lines}")))
    assert made["u"].column.label.name == "Boom duty", "one that moves is the likelier one"


def test_milliseconds_that_were_scaled_from_seconds_are_milliseconds():
    """1000 * 0.003 is not quite 3: one log of 25 s lasted seven hours."""
    assert counted(1000.0 * (0.001 * np.arange(5000))) == "ms"
    assert counted(0.656 * np.arange(5000)) == "s"


def test_stamps_of_too_few_digits_tell_the_interval_and_are_no_command(write):
    """A clock of six digits after 1000 s repeats itself: it was guessed to be the command."""
    t = np.round(1000.0 + 0.001 * np.arange(2000), 2)
    columns = overview(write("t,cmd,pos\n" + rows(np.column_stack([t, np.sin(t), np.cos(t)]))))
    assert columns.interval is not None
    assert columns.interval[1] == pytest.approx(0.001, rel=0.01)
    assert columns.times == {0}
    assert "u" not in guesses(columns) or guesses(columns)["u"].column.label.name == "cmd"


def test_a_reference_is_no_spool(write):
    t = 0.01 * np.arange(400)
    table = np.column_stack([t, np.sin(t), np.sin(t)])
    columns = overview(write("time [s],Pos ref [m],Position [m]\n" + rows(table)))
    assert {n: g.column.label.name for n, g in guesses(columns, machine=True).items()} == {
        "travel": "Position"
    }


@pytest.mark.parametrize("down", [True, False])
def test_a_command_with_a_column_for_each_direction(down, write, tmp_path):
    time = np.arange(200) / 20
    duty = np.where((time > 2) & (time < 8), 50.0, 0.0)
    angle = np.cumsum(duty) / 100 * (-1 if down else 1)
    up, dn = (0 * duty, duty) if down else (duty, 0 * duty)
    table = np.column_stack([time, 0 * time, up, dn, 0.001 * np.sin(time), angle])
    path = write("time,Arm_in_duty,Boom_up_duty,Boom_dn_duty,Arm_ang,Boom_ang\n" + rows(table))
    made = guesses(overview(path))
    assert {n: g.column.label.name for n, g in made.items()} == {"u": "Boom_up_duty", "slew": "Boom_ang"}
    assert made["u"].minus.label.name == "Boom_dn_duty"
    # a boom is no slew drive: the page of `cosim open` diagnosed it with the crane's model
    assert of_other_axis(made) == "Boom_ang"
    assert likely(overview(path))[1]
    assert made["u"].unit == "%"
    mapping = tmp_path / "m.toml"
    mapping.write_text(mapping_text(overview(path), made, None))
    log = load_log(path, mapping=mapping)
    assert np.allclose(log.signals["u"], (up - dn) / 100)


def test_the_commands_of_two_wheels_are_not_the_directions_of_one(write):
    time = np.arange(200) / 20
    left = 40.0 * (time > 2) + 20.0 * (time > 5)
    table = np.column_stack([time, left, 0.9 * left, np.cumsum(left), np.cumsum(0.9 * left)])
    path = write("time,leftCommand,rightCommand,left_position,right_position\n" + rows(table))
    made = guesses(overview(path), machine=True)
    assert (made["u"].column.label.name, made["u"].minus) == ("leftCommand", None)
    assert made["travel"].column.label.name == "left_position"


def test_tags_of_a_plant(write):
    """ISA-5.1: FT measures a flow and FV is its valve; PV may be the valve of a pressure or what is measured."""
    t = np.arange(100) / 10
    table = rows(np.column_stack([t, 34.0 + np.sin(t), 80.0 + np.sin(t - 0.1)]))
    made = guesses(overview(write("time,FV_211,FT_211\n" + table)), machine=True)
    assert {n: g.column.label.name for n, g in made.items()} == {"u": "FV_211", "flow": "FT_211"}
    assert "u" not in guesses(overview(write("time,PV_211,TT_211\n" + table)), machine=True)


def test_the_travel_of_the_crane_is_not_that_of_another_machine(write, tmp_path):
    path = write(
        "time [s],u [1],slew [deg]\n" + rows([[k / 20, 0.1 * (k % 3), 500.0 + k] for k in range(50)])
    )
    mapping = tmp_path / "m.toml"
    text = '[time]\ncolumn = "time [s]"\n[signals]\nu = {column = "u [1]"}\nslew = {column = "slew [deg]"}\n'
    machine = '[machine]\nchain = ["dead_zone", "dcv", "continuity", "mechanical"]\nspeed = "?"\nlag = "?"\n'
    warned = []
    for content in (text, text + machine):
        mapping.write_text(content)
        warned.append(any("plausible" in w for w in load_log(path, mapping=mapping).warnings))
    assert warned == [True, False]


def test_a_log_of_which_nothing_is_known_ends_with_what_to_do(cosim, write):
    path = write(
        "t,qm,vir\n"
        + rows(np.column_stack([np.arange(50) / 100, *np.random.default_rng(3).normal(size=(2, 50))]))
    )
    made = cosim("init", path)
    assert made.returncode == 0, made.stderr
    *_, written, missing, last = made.stdout.splitlines()
    mapping = path.with_suffix(".toml")
    assert written == f"written to {mapping}: complete it"
    assert missing.startswith("Missing: a column for u (slew valve command")
    assert "one for what was measured, such as slew" in missing
    assert (
        last == f"Next: complete {mapping} in an editor, or choose the columns on a page: cosim open {path}"
    )
    refused = cosim("diagnose", path, "--mapping", mapping)
    assert refused.returncode == 3
    assert "'signals' is missing: a table such as [signals.u] with 'column' and 'unit'" in refused.stderr
    text = mapping.read_text()
    assert "# [signals.u]" in text
    text = text.replace("# [signals.slew]", "[signals.slew]").replace(
        '# column = "?"\n# unit = "deg"', 'column = "qm"\nunit = "deg"', 1
    )
    mapping.write_text(text)
    assert set(load_log(path, mapping).signals) == {"slew"}, (
        "what is marked is taken by taking the marks away"
    )


def test_an_uneven_clock_is_told_as_such_and_its_pauses_counted_as_the_loader_does(write, cosim):
    stamps = np.cumsum(np.tile([0.02, 0.05, 0.09], 60))
    path = write(
        "Time,Swing Cmd,Swing Ms\n" + "".join(f"{t:.4f},{k % 7},{k % 5}\n" for k, t in enumerate(stamps))
    )
    clock = overview(path).clock
    assert clock is not None
    assert (clock.gaps, clock.even) == (0, False)
    shown = cosim("info", path)
    assert "a second, unevenly spaced, no gap; time is" in shown.stdout.replace("\n", " ")
    assert "--machine: of another machine than the crane" in shown.stdout


def test_without_a_time_the_interval_is_asked_for_and_long_lists_are_cut(write, cosim):
    names = [f"chan {k}" for k in range(12)]
    path = write(
        "u,angle," + ",".join(names) + "\n" + "".join(f"{k % 3},{k % 11}{',1' * 12}\n" for k in range(60))
    )
    shown = cosim("init", path, "--machine").stdout
    assert "Missing: the interval between samples ('step', for which 0.001 s stands now)\n" in shown
    assert "column 'chan 6'; and 5 more" in shown
    assert "--machine" not in shown, "it was given"
    assert "complete" in shown
    assert "Another machine than the crane: --machine" in cosim("init", path, "--force").stdout


def two_loggers(path, **more):
    """Speed of a drive at 500 Hz and a force at 2 kHz, in one file, each with a time of its own."""
    slow, fast = np.arange(400) / 500.0, 0.1 + np.arange(1200) / 2000.0
    savemat(path, {"t_drive": slow, "v": np.sin(slow), "t_daq": fast, "F": np.cos(fast), **more})
    return path


def test_vectors_of_two_loggers_go_with_the_time_of_their_length(tmp_path):
    path = two_loggers(tmp_path / "two.mat")
    found = overview(path)
    assert found.clock.column is None
    assert [c.label.name for c in found.columns if c.index not in found.times] == ["v", "F"]
    mapping = tmp_path / "two.toml"
    mapping.write_text(
        '[time]\ncolumn = "t_daq"\nunit = "s"\n[signals.speed]\ncolumn = "v"\nunit = "m/s"\n'
        '[signals.force]\ncolumn = "F"\nunit = "N"\n'
    )
    log = load_log(path, mapping)
    assert log.time.size == 1200
    # a straight line between samples of 2 ms is off by h^2/8 of the curvature at most
    np.testing.assert_allclose(log["speed"], np.sin(log.time), atol=6e-7)
    assert any("'speed': on a clock of their own" in text for text in log.warnings)


def test_two_times_of_one_length_say_nothing_of_the_others(tmp_path):
    found = overview(two_loggers(tmp_path / "three.mat", t_other=np.arange(400) / 400.0))
    assert found.clock.column is not None


def test_a_file_without_numbers_is_no_log(cosim, write):
    path = write(
        "[2019-06-10 20:12:13]: valves loaded\n[2019-06-10 20:12:17]: parsing error\n", name="events.txt"
    )
    for command in ("info", "init"):
        result = cosim(command, path)
        assert result.returncode == 3  # bad data
        assert "holds no column of numbers: a log is a table with a row for each sample" in result.stderr


def servo_drive(write, speed="Servo motor speed", torque="Torque"):
    """What a servo amplifier records of one move: speed, torque, a pulse count and a flag, no command."""
    time = np.arange(900) / 1500.0
    w, moved = np.zeros(900), 0.0
    drive = np.interp(time, [0.0, 0.05, 0.06, 0.25, 0.26, 0.5, 0.51], [0.0, 0.0, 20.0, 20.0, 2.0, 2.0, 0.0])
    for k in range(1, 900):  # 0.01 kg m2 and 0.2 N m s/rad
        w[k] = w[k - 1] + (drive[k - 1] - 0.2 * w[k - 1]) / 0.01 / 1500.0
        moved += w[k] / 1500.0
    lines = [
        f"{t:.6f},{x * 30.0 / np.pi:.6f},{d:.4f},{200.0 * x:.1f},{2.5 if x < 1.0 else 0.0}"
        for t, x, d in zip(time, w, drive, strict=True)
    ]
    return write(
        "\n".join([f"Time (s),{speed},{torque},Droop pulses,INP digital", *lines]) + "\n", "move.csv"
    )


def test_a_measured_torque_drives_an_axis_without_a_command(write, tmp_path):
    path = servo_drive(write)
    found = overview(path)
    made = guesses(found, machine=True)
    assert {name: g.column.label.short for name, g in made.items()} == {
        "torque": "Torque",
        "speed": "Servo motor speed",
    }
    assert made["speed"].unit == "rpm"  # 940 of them; no motor turns at 940 rad/s
    assert made["torque"].unit == "N.m"
    assert made["torque"].check
    mapping = tmp_path / "move.toml"
    mapping.write_text(mapping_text(found, made, None))
    made_now = made_for(mapping, load_log(path, mapping))
    assert made_now.machine.chain == ("mechanical",)
    # least squares at the samples: 1.3 % of the lag is a sample
    assert made_now.numbers.values["mechanical.J"] == pytest.approx(0.01, rel=0.05)
    assert made_now.numbers.values["mechanical.b"] == pytest.approx(0.2, rel=0.05)


def test_of_several_torques_the_one_of_the_axis_drives(write):
    path = servo_drive(write, "dq 2 velocity", "tau 2")
    head, *lines = path.read_text().splitlines()
    path.write_text("\n".join([f"{head},tau 1", *(f"{line},{k % 7}" for k, line in enumerate(lines))]) + "\n")
    assert guesses(overview(path), machine=True)["torque"].column.label.short == "tau 2"


def test_a_robot_s_joints_are_no_flows(write):
    path = servo_drive(write, "dq_2", "tau_2")
    text = path.read_text().replace("Droop pulses", "q_2")
    path.write_text(text)
    made = guesses(overview(path), machine=True)
    assert {n: made[n].column.label.short for n in ("slew", "torque")} == {"slew": "q_2", "torque": "tau_2"}
    path.write_text(text.replace(",q_2", ",q_2 [l/min]"))
    assert "slew" not in guesses(overview(path), machine=True), "a unit tells more than a name"


def test_a_flag_is_no_command(write):
    path = servo_drive(write, torque="Temperature")
    assert "INP digital" not in [g.column.label.short for g in guesses(overview(path), machine=True).values()]
    t = np.arange(400) / 100
    drive = np.sign(np.sin(t))
    table = rows(np.column_stack([t, drive + 0.01 * np.sin(9 * t), np.cumsum(drive)]))
    made = guesses(overview(write("Time,Lim_3,Angle\n" + table)), machine=True)
    assert list(made) == ["slew"], "nor is a limit switch, whatever it does"


@pytest.mark.parametrize(
    ("names", "signals"),
    [
        (("Tempo_s", "Controle", "Posição", "Pressão_A"), {"u", "travel", "p_a"}),
        (("Tijd (s)", "Stuursignaal", "Snelheid", "Druk B"), {"u", "speed", "p_b"}),
        (("Tempo (s)", "Comando", "Ângulo", "Vazão"), {"u", "slew"}),
        (("Time (s)", "cmd", "Pan Position", "Tilt Position"), {"u", "slew"}),
    ],
)
def test_names_in_portuguese_and_dutch_and_of_pan_and_tilt(write, names, signals):
    lines = [f"{k * 0.01:.2f},{k % 50 - 25},{(k // 3) % 40 + 0.5},{k % 9 + 20}" for k in range(200)]
    found = overview(write("\n".join([",".join(names), *lines]) + "\n"))
    assert found.columns[found.clock.column].label.text == names[0]
    assert set(guesses(found, machine=True)) == signals


def test_what_is_no_crane_is_shown_as_a_drive_of_its_own(cosim, write, german):
    time, command, speed = motor()
    path = write("t,u,y\n" + rows(np.column_stack([time, command / 12.0, speed])))
    shown = cosim("info", path)
    assert "2 of 3 columns look like signals of a drive of its own" in shown.stdout
    assert "speed is probably 'y' [rad/s]" in shown.stdout
    assert f"cosim init {path} --machine writes these guesses" in shown.stdout
    assert json.loads(cosim("info", path, "--json").stdout)["machine"] is True
    crane = cosim("info", german).stdout
    assert "6 of 8 columns look like signals of the crane" in crane
    assert json.loads(cosim("info", german, "--json").stdout)["machine"] is False


def motor_table(n=3000):
    """(n, 4) time, steps of a voltage, motor speed (rad/s) and its angle within a turn (deg), at 100 samples a second."""
    time = np.arange(n) / 100.0
    u = np.repeat(np.random.default_rng(8).uniform(2.0, 12.0, n // 150), 150)
    w = np.zeros(n)
    for k in range(1, n):
        w[k] = w[k - 1] + (2.0 * u[k - 1] - w[k - 1]) / 30.0
    return np.column_stack([time, u, w, np.degrees(np.cumsum(w) / 100.0) % 360.0])


def test_a_setpoint_is_no_command_and_the_voltage_of_a_motor_is_one(write):
    """A closed loop in German: the demanded speed moves in steps, the voltage drives; the position begins anew each turn."""
    time, u, w, angle = motor_table().T
    rpm = w * 30.0 / np.pi
    asked = np.where(time < 15.0, 100.0, 150.0)
    path = write(
        "Zeit,Geschwindigkeit,Sollgeschwindigkeit,Position,Motorspannung\n"
        + rows(np.column_stack([time, rpm + 700.0, asked, angle, u + 1e-3 * np.sin(90.0 * time)]))
    )
    made = guesses(overview(path), machine=True)
    assert {name: g.column.label.text for name, g in made.items()} == {
        "u": "Motorspannung",
        "speed": "Geschwindigkeit",
    }


def test_a_demanded_speed_drives_where_nothing_else_was_logged(write):
    """A drive with a loop of its own: its speed by the unit alone, beside an angle that begins anew with each turn."""
    time, u, w, angle = motor_table().T
    head = "time_s,commanded_deg_s,angle_deg,feedback_deg_s\n"
    path = write(head + rows(np.column_stack([time, np.degrees(2.0 * u), angle, np.degrees(w)])))
    made = guesses(overview(path), machine=True)
    assert {name: (g.column.label.text, g.unit) for name, g in made.items()} == {
        "u": ("commanded_deg_s", "1"),
        "speed": ("feedback_deg_s", "deg/s"),
    }
    assert made["u"].gain == pytest.approx(1.0 / np.degrees(2.0 * u.max()), rel=1e-3)


def test_what_was_asked_for_drives_a_speed_without_a_name(write):
    """A wheel with a loop of its own, whose columns are a reference and readings that are called nothing."""
    time, u, w, _ = motor_table().T
    rng = np.random.default_rng(5)
    wheels = [w + rng.normal(size=w.size), w + 2.0 * rng.normal(size=w.size)]
    path = write("t,reference,w1,w2\n" + rows(np.column_stack([time, 2.0 * u, *wheels])))
    made = guesses(overview(path), machine=True)
    assert {name: g.column.label.text for name, g in made.items()} == {"u": "reference", "speed": "w1"}
    assert "what was asked for" in made["u"].why
    still = write("t,reference,w1\n" + rows(np.column_stack([time, u, rng.normal(size=w.size)])))
    assert not guesses(overview(still), machine=True), "nothing follows it"


def test_a_measured_speed_is_no_command_and_a_place_beside_a_torque_is_an_angle(write):
    """An actuator's record: demands that are constant, torque, place and speed, and what is amiss."""
    time, u, w, _ = motor_table().T
    place = np.cumsum(w) / 100.0
    zero = np.full(time.size, 0.7)
    path = write(
        "t,torDes,posDes,torAct,posAct,velAct,velErr,posErr\n"
        + rows(np.column_stack([time, u, zero, u + 0.1 * np.sin(time), place, w, -w, zero - place]))
    )
    made = guesses(overview(path), machine=True)
    assert {name: g.column.label.text for name, g in made.items()} == {"torque": "torAct", "slew": "posAct"}
    # without a torque nothing drives it: its own speed is the rate of change of the place by itself
    path = write("t,posAct,velAct\n" + rows(np.column_stack([time, place, w])))
    assert "u" not in guesses(overview(path), machine=True)


def test_what_falls_back_by_itself_is_a_speed(write):
    """A slow motor: its rate of change follows the command as well, and only a place stays where it is."""
    time, u, w, _ = motor_table().T
    path = write("t,u1,y1\n" + rows(np.column_stack([time, u - 7.0, w - 14.0])))
    assert {"u", "speed"} == guesses(overview(path), machine=True).keys()
    path = write("t,u1,y1\n" + rows(np.column_stack([time, u - 7.0, np.cumsum(u - 7.0)])))
    assert {"u", "slew"} == guesses(overview(path), machine=True).keys()


def test_the_same_column_once_more_is_not_what_moves(tmp_path):
    time, u, w, _ = motor_table().T
    savemat(tmp_path / "log.mat", {"a": {"t": time, "u": u, "y": w}, "b": {"u": u, "y": w}})
    made = guesses(overview(tmp_path / "log.mat"), machine=True)
    assert {name: g.column.label.short for name, g in made.items()} == {"u": "u", "speed": "y"}


def test_counts_of_an_encoder_are_an_angle_with_a_gain_to_give(write):
    time, u, w, _ = motor_table().T
    path = write(
        "Timestamp,MotorPWM,Encoder\n" + rows(np.column_stack([1000 * time, u, np.cumsum(w).round()]))
    )
    made = guesses(overview(path), machine=True)
    assert (made["slew"].column.label.text, made["slew"].unit, made["slew"].check) == ("Encoder", "deg", True)
    assert "`gain` is 360 over those of a turn" in made["slew"].why


def test_a_pressure_gauge_is_no_command(write):
    time, u, w, _ = motor_table().T
    path = write("t,PG_2,Drive,speed_rpm\n" + rows(np.column_stack([time, np.floor(w / 8.0), u, w])))
    assert guesses(overview(path), machine=True)["u"].column.label.text == "Drive"


def test_coordinates_of_another_machine_are_no_markers(cosim, write):
    """A pose takes three markers with nothing beside them; before, `cosim info` asked for two marker models."""
    time, u, w, _ = motor_table(300).T
    head = "t,u,pos_x,pos_y,pos_z,vel_x,vel_y,vel_z,acc_x,acc_y,acc_z,mode\n"
    done = cosim("info", write(head + rows(np.column_stack([time, u, *[w] * 9, 0 * u]))))
    assert (done.returncode, "pos_x" in done.stdout) == (0, True), done.stderr
    done = cosim(
        "info",
        write("t,info_position_x,info_position_y,info_position_z\n" + rows(np.column_stack([time, u, w, w]))),
    )
    assert (done.returncode, "info_position_x" in done.stdout) == (0, True), done.stderr


@pytest.mark.parametrize(
    ("names", "constants"),
    [
        (("uEst", "yEst", "uVal", "yVal"), {"Ts": 0.05}),
        (("u_train", "y_train", "u_test", "y_test"), {"fs": 20.0}),
        (("u_est", "y_est", "u_val", "y_val"), {"fs": 20.0}),
    ],
)
def test_a_second_record_and_the_interval_of_a_benchmark_are_found(cosim, tmp_path, names, constants):
    """Estimation and validation data in one file, with the interval as a number: nothing is left to be completed."""
    _, u, w, _ = motor_table(1500).T
    path = tmp_path / "benchmark.mat"
    savemat(path, dict(zip(names, (u, w, u[::-1], w[::-1]), strict=True)) | constants)
    done = cosim("init", path, "--machine")
    assert done.returncode == 0, done.stderr
    assert f"{names[3]} -> speed of a record held out" in done.stdout
    assert "Missing" not in done.stdout
    assert "left without" not in done.stdout
    mapping = load_mapping(path.with_suffix(".toml"))
    assert mapping.time.step == pytest.approx(0.05)
    assert mapping.held_out == {"u": names[2], "speed": names[3]}
    np.testing.assert_array_equal(load_log(path, mapping.of_held_out)["speed"], w[::-1])


def test_the_same_values_under_another_name_are_no_second_record(tmp_path):
    time, u, w, _ = motor_table(1500).T
    path = tmp_path / "twice.mat"
    savemat(path, {"t": time, "uEst": u, "yEst": w, "uVal": u, "yVal": w})
    found = overview(path)
    assert "[held_out]" not in mapping_text(found, guesses(found, machine=True), None)


def test_an_angle_within_a_turn_is_made_to_go_on(write):
    time, u, _, angle = motor_table().T
    path = write("t,u,angle (deg)\n" + rows(np.column_stack([time, u, angle])))
    found = overview(path)
    mapping = path.with_suffix(".toml")
    mapping.write_text(mapping_text(found, guesses(found, machine=True), None), encoding="utf-8")
    assert load_mapping(mapping).signals["slew"].period == 360
    assert np.all(np.diff(load_log(path, mapping)["slew"]) >= 0.0)
    path = write("t,u,angle (deg)\n" + rows(np.column_stack([time, u, np.unwrap(angle, period=360)])))
    found = overview(path)
    assert "period" not in mapping_text(found, guesses(found, machine=True), None)


def test_a_torque_that_was_set_drives_and_a_current_that_was_read_does_not(write):
    """Two motors on one shaft: the noisy current was "the only voltage or current", so the command, and not the torque."""
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 4.0, 0.01)
    torque = np.where(time < 2.0, -0.03, -0.045)
    speed = np.cumsum(0.01 * (torque - 2e-4 * np.cumsum(torque) * 0.01))
    noise = rng.normal(size=(2, time.size))
    table = np.column_stack([time, speed, torque, torque + 0.02 * noise[0], 20.0 * torque + 0.5 * noise[1]])
    heading = "Time [s],Velocity [rad/s],Input Torque [N.m],Torque Measurement [N.m],Motor Current [A]"
    made = guesses(overview(write(f"{heading}\n{rows(table)}")), machine=True)
    assert made["torque"].column.label.name == "Input Torque"
    assert "u" not in made


def test_a_command_once_more_is_no_motion(write):
    """Of three runs in one file the second's command, 1.5 times the first's, was taken for the speed that it made."""
    time = np.arange(0.0, 4.0, 0.01)
    command = np.sign(np.sin(7.0 * time + np.sin(time)))
    table = np.column_stack([time, command, 1.5 * command, np.sin(1.7 * time) ** 2])
    made = guesses(overview(write(f"t,u1,u2,z1\n{rows(table)}")), machine=True)
    assert "u2" not in {g.column.label.name for g in made.values()} - {made["u"].column.label.name}


def test_columns_of_text_are_no_copies_of_each_other(write):
    found = overview(
        write("t,u,mode,state,again\n" + "".join(f"{0.1 * k},{k % 3},auto,run,{k % 3}\n" for k in range(40)))
    )
    used = {c.index for c in found.columns if c.label.short in ("t", "u")}
    assert [c.label.short for c in once_more(found, used)] == ["again"]


def test_columns_that_hold_the_same_once_more_are_no_further_candidates(tmp_path):
    """A .mat of signals and of the object made of them: "as 1 more does", and `[signals.i]` twice in the mapping."""
    time = 0.02 * np.arange(1000)
    u = np.repeat(np.random.default_rng(2).uniform(0.2, 1.0, 20), 50)
    speed = 90.0 * u + np.random.default_rng(3).normal(0.0, 0.1, time.size)
    current = np.gradient(speed)
    file = tmp_path / "motor.csv"
    rows = np.column_stack([time, u, speed, current, u, speed, current])
    np.savetxt(file, rows, delimiter=",", comments="", fmt="%.6g", header="t [s],u,y,i,data.u,data.y,data.i")
    matched = write_mapping(file, machine=True)
    text = matched.file.read_text(encoding="utf-8")
    assert "more do" not in text
    assert text.count("# [signals.i]") == 1
    assert "# the same readings once more: data.u, data.y, data.i" in text
    assert matched.left == ["column 'i'", "the same readings once more (data.u, data.y, data.i)"]


def a_servo(t: np.ndarray, fastest: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    """Demanded places and a drive that follows them, no faster than so much a second."""
    asked = np.repeat(np.random.default_rng(3).uniform(-50.0, 50.0, 10), t.size // 10)
    place = np.zeros(t.size)
    for k in range(1, t.size):
        step = 0.1 * (asked[k - 1] - place[k - 1])
        place[k] = place[k - 1] + np.clip(step, -fastest * 0.02, fastest * 0.02)
    return asked, place + np.random.default_rng(4).normal(0.0, 0.05, t.size)


@pytest.mark.parametrize(
    ("asked", "shown"),
    [
        ("pos_cmd", "pos"),
        ("Position Command", "Position Feedback"),
        ("Commanded Pos", "Encoder 1 Pos"),
        ("setpoint", "angle"),
        ("rudder_ref", "rudder_encoder"),
    ],
)
def test_a_command_called_as_the_place_is_the_place_demanded(write, asked, shown):
    """It was a command whose sum over time the place is."""
    t = 0.02 * np.arange(1000)
    goal, place = a_servo(t, 15.0 if asked == "rudder_ref" else np.inf)
    rows = "".join(f"{a:.3f},{b:.4f},{c:.4f}\n" for a, b, c in zip(t, goal, place, strict=True))
    made = guesses(overview(write(f"t,{asked},{shown}\n" + rows)), machine=True)
    assert (made["u"].column.label.text, made["u"].place) == (asked, True)
    assert made["slew" if "slew" in made else "travel"].column.label.text == shown


@pytest.mark.parametrize("head", ["t,Commanded Pos,Control Effort,Encoder 1 Pos", "t,setpoint,duty,position"])
def test_what_a_controller_puts_out_goes_before_what_it_was_given(write, head):
    t = 0.02 * np.arange(1000)
    goal, place = a_servo(t)
    rows = zip(t, goal, np.gradient(place, t), place, strict=True)
    text = "".join(",".join(f"{x:.4f}" for x in row) + "\n" for row in rows)
    made = guesses(overview(write(head + "\n" + text)), machine=True)
    assert (made["u"].column.index, made["u"].place) == (2, False)


def test_a_swing_that_its_command_sums_up_to_is_no_demanded_place(write):
    """A sine and its sum have the same shape a quarter of a period apart."""
    t = 0.02 * np.arange(1000)
    rows = "".join(f"{a:.3f},{np.sin(2 * a):.4f},{-0.5 * np.cos(2 * a):.4f}\n" for a in t)
    made = guesses(overview(write("t,Swing Cmd,Swing\n" + rows)), machine=True)
    assert (made["u"].column.index, made["u"].place, made["slew"].column.index) == (1, False, 2)


def test_columns_of_a_recorder_are_told_by_which_comes_first(write):
    """CHANNEL0 to 2 of a test stand were no signal, though one follows another by 17 ms."""
    t = 0.005 * np.arange(2000)
    asked = np.sin(2.0 * np.pi * (0.2 + 0.3 * t) * t)
    rng = np.random.default_rng(2)
    shown = np.interp(t - 0.015, t, asked) + rng.normal(0.0, 0.01, t.size)
    force = 0.2 * np.gradient(asked, t) + rng.normal(0.0, 0.1, t.size)
    rows = zip(t, shown, force, asked, strict=True)
    text = "".join(",".join(f"{x:.5f}" for x in row) + "\n" for row in rows)
    found = overview(write("Time,CHANNEL0,CHANNEL1,CHANNEL2\n" + text))
    made = guesses(found, machine=True)
    assert {n: g.column.index for n, g in made.items()} == {"u": 3, "slew": 1}
    assert made["u"].place
    assert all(guess.check for guess in made.values())
    assert 'command = "place"' in mapping_text(found, made, None)


@pytest.mark.parametrize("follows", [True, False])
def test_a_motion_that_follows_its_command_itself_is_asked_about(write, follows):
    t = 0.02 * np.arange(1000)
    goal, place = a_servo(t)
    shown = place if follows else np.cumsum(goal) * 0.02
    rows = "".join(f"{a:.3f},{b:.4f},{c:.4f}\n" for a, b, c in zip(t, goal, shown, strict=True))
    found = overview(write("t,u,theta\n" + rows))
    assert (
        '# command = "place"    # CHECK' in mapping_text(found, guesses(found, machine=True), None)
    ) is follows


def test_a_matrix_of_numbers_without_names_takes_no_time(write):
    """Eight rows of five thousand numbers are no recorder: of each two columns it was looked which comes first."""
    rows = np.random.default_rng(1).uniform(size=(8, 3000))
    text = "".join(",".join(f"{x:.3f}" for x in row) + "\n" for row in rows)
    begin = time.process_time()
    assert guesses(overview(write(text)), machine=True) == {}
    assert time.process_time() - begin < 20.0
