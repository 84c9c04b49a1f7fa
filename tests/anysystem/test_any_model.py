"""Models and mappings of all sorts: plain pythonfmu, a single FMU, other names and units, what does not fit."""

import copy
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden
from cosim.anysystem.read import read
from cosim.errors import DataError
from cosim.logs import load_mapping
from cosim.master import Runner
from cosim.ssp.read import read_system

MAPPING = """
[time]
column = "Zeit"
unit = "ms"

[signals."command"]
column = "Cmd"
unit = "1"

[signals.first]
column = "Out1"
unit = "1"

[signals."plant.y"]
column = "Out2"
unit = "1"

[compare.signals.first]
variable = "valve.y"

[diagnose]
trusted = {{ "plant.W" = "2 %", "plant.K" = "1 %", "{third}" = "1 %" }}
"""


def renamed(source: Path, target: Path) -> Path:
    """A log with headings of a stranger and time in ms."""
    rows = source.read_text().splitlines()
    changed = [f"{1000 * float(r.partition(',')[0])!r},{r.partition(',')[2]}" for r in rows[1:]]
    target.write_text("\n".join(["Zeit,Cmd,Out1,Out2", *changed]) + "\n")
    return target


def test_plain_pythonfmu_with_a_mapping_names_a_trusted_parameter(
    plain: Path, command, tmp_path: Path
) -> None:
    values = copy.deepcopy(systems.VALUES)
    values["plant"]["W"] = 6.0
    log = renamed(systems.log(tmp_path / "a.csv", [], 6, values=values), tmp_path / "b.csv")
    mapping = tmp_path / "m.toml"
    mapping.write_text(MAPPING.format(third="valve.T"))
    code, out, err = command(
        "diagnose", log, "--model", plain, "--mapping", mapping, "--out", tmp_path / "o", "--json"
    )
    assert code == 0, err
    found = json.loads(out)
    assert "InitialUnknowns" in err
    (cause,) = found["causes"]
    assert (cause["effect"], cause["component"], cause["connector"]) == ("parameter", "plant", "W")
    assert cause["parameters"]["W"]["value"] == pytest.approx(6.0, rel=0.01)


def test_all_that_a_mapping_has_wrong_is_told_at_once(native: Path, command, tmp_path: Path) -> None:
    log = renamed(systems.log(tmp_path / "a.csv", [], 6), tmp_path / "b.csv")
    mapping = tmp_path / "m.toml"
    mapping.write_text(MAPPING.format(third="valve.tau").replace('"valve.y"', '"valve.out"'))
    code, _, err = command("diagnose", log, "--model", native, "--mapping", mapping, "--out", tmp_path / "o")
    assert code == 3
    said = " ".join(err.split())
    assert "valve.out" in said
    assert "valve.tau" in said


def test_a_log_without_any_connector_of_the_system_is_refused_with_the_remedy(
    native, command, tmp_path: Path
) -> None:
    log = renamed(systems.log(tmp_path / "a.csv", [], 6), tmp_path / "b.csv")
    code, _, err = command("diagnose", log, "--model", native, "--out", tmp_path / "o")
    assert code == 3
    assert "cosim init" in " ".join(err.split())


def test_a_single_fmu_is_diagnosed_by_the_names_of_its_connectors(command, tmp_path: Path) -> None:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    fmu = parts.native("lag", tmp_path)
    rng = np.random.default_rng(3)
    u = systems.command(rng)
    x = np.zeros(u.size)
    for k in range(1, u.size):  # T = K = 1, exact for the mean of the step; the FMU hears 1.2 u
        x[k] = x[k - 1] + (1.0 - np.exp(-systems.H)) * (1.2 * 0.5 * (u[k] + u[k - 1]) - x[k - 1])
    y = x + 0.003 * rng.standard_normal(u.size)
    log = tmp_path / "log.csv"
    rows = [
        f"{k * systems.H!r},{a!r},{b!r}" for k, (a, b) in enumerate(zip(u.tolist(), y.tolist(), strict=True))
    ]
    log.write_text("\n".join(["time [s],u [1],y [1]", *rows]) + "\n")
    code, out, err = command("diagnose", log, "--model", fmu, "--out", tmp_path / "o", "--json")
    assert code == 0, err
    (cause,) = json.loads(out)["causes"]
    assert cause["effect"] == "port.gain"
    assert cause["parameters"]["gain"]["value"] == pytest.approx(1.2, rel=0.02)
    assert any("(input)" in other for other in cause["indistinguishable_from"])


def test_an_input_that_is_held_over_each_sample_is_no_fault_of_a_fast_component(
    command, tmp_path: Path
) -> None:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    model = parts.write_ssp(
        tmp_path / "fast.ssp",
        {"valve": parts.native("lag", tmp_path)},
        [("command", "valve.u")],
        {"valve": {"K": 2.0, "T": 0.01}},
    )
    rng = np.random.default_rng(3)
    u = systems.command(rng)
    y = np.zeros(u.size)
    for k in range(1, u.size):  # exact for a controller that holds its output
        y[k] = y[k - 1] + (1.0 - np.exp(-systems.H / 0.01)) * (2.0 * u[k - 1] - y[k - 1])
    y += 0.003 * rng.standard_normal(u.size)
    rows = [
        f"{k * systems.H!r},{a!r},{b!r}" for k, (a, b) in enumerate(zip(u.tolist(), y.tolist(), strict=True))
    ]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["time [s],command [1],valve.y [1]", *rows]) + "\n")
    code, out, err = command("diagnose", log, "--model", model, "--out", tmp_path / "o", "--json")
    assert code == 0, err
    assert json.loads(out)["verdict"] == "adequate"


def test_a_reading_in_steps_and_one_with_stale_samples_are_named(
    native: Path, command, tmp_path: Path
) -> None:
    for hidden, key in (
        (Hidden("port.quantisation", "plant.y", "sensor", {"quantum": 0.05}), "quantum"),
        (Hidden("port.dropout", "plant.y", "sensor", {"probability": 0.2}), "probability"),
    ):
        log = systems.log(tmp_path / "log.csv", [hidden], 8)
        code, out, err = command("diagnose", log, "--model", native, "--out", tmp_path / "o", "--json")
        assert code == 0, err
        (cause,) = json.loads(out)["causes"]
        assert (cause["effect"], cause["where"]) == (hidden.effect, "sensor")
        assert cause["parameters"][key]["value"] == pytest.approx(hidden.values[key], rel=0.15)


def test_an_fmu_that_cannot_run_at_all_ends_with_its_name_and_exit_code_4(command, tmp_path: Path) -> None:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    fmu = tmp_path / "part_broken.fmu"
    parts.native("lag", tmp_path).rename(fmu)
    with zipfile.ZipFile(fmu) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    library = next(n for n in entries if n.startswith("binaries"))
    source = (
        (parts.HERE / "part.c")
        .read_text()
        .replace("double h = step / 4;", "double h = step / 4; if (t > 1) abort();")
    )
    (tmp_path / "broken.c").write_text(source)
    target = parts.library(tmp_path / "broken.c", tmp_path, "KIND=LAG")
    with zipfile.ZipFile(fmu, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, target.read_bytes() if name == library else content)
    log = tmp_path / "log.csv"
    log.write_text(
        "time [s],u [1],y [1]\n" + "".join(f"{k / 100},{np.sin(k / 9)},{k / 300}\n" for k in range(300))
    )
    code, _, err = command("diagnose", log, "--model", fmu, "--out", tmp_path / "o")
    assert code == 4
    assert "component 'part_broken'" in " ".join(err.split())


def test_a_unit_of_another_dimension_is_refused(command, packages, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    rows = "".join(f"{k / 100},{np.sin(k / 9)},{k / 300}\n" for k in range(300))
    log.write_text("time [s],u [1],dcv.spool [bar]\n" + rows)
    code, _, err = command("diagnose", log, "--model", packages["full_order"], "--out", tmp_path / "o")
    assert code == 3
    assert "'dcv.spool' is in 'bar'" in " ".join(err.split())


CLUTCH = """
import math

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Integer, Real


class Clutch(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.gear, self.on, self.y, self.shown = 0.0, 1, True, 0.0, 0
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Integer("gear", causality=Fmi2Causality.input))
        self.register_variable(Boolean("on", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        self.register_variable(Integer("shown", causality=Fmi2Causality.output))

    def do_step(self, t, h):
        new = self.gear * self.u if self.on else 0.0
        self.y += (1.0 - math.exp(-h / 0.2)) * (new - self.y)
        self.shown = self.gear
        return True
"""


def test_whole_numbers_and_switches_drive_a_component(command, tmp_path: Path) -> None:
    parts.by_pythonfmu("Clutch", CLUTCH, tmp_path)
    rng = np.random.default_rng(2)
    count = 800
    u = systems.command(rng, count)
    gear, on = 1 + np.arange(count) // 250, (np.arange(count) // 130) % 3 != 1
    y = np.zeros(count)
    for k in range(1, count):  # the gear is lower than it says by a fifth
        new = 0.8 * gear[k - 1] * 0.5 * (u[k] + u[k - 1]) * on[k - 1]
        y[k] = y[k - 1] + (1.0 - np.exp(-systems.H / 0.2)) * (new - y[k - 1])
    table = np.column_stack(
        [systems.H * np.arange(count), u, gear, on, y + 0.003 * rng.standard_normal(count), gear]
    )
    log = tmp_path / "log.csv"
    heading = "time [s],u [1],gear [1],on [1],y [1],shown [1]"
    np.savetxt(log, table, "%.12g", delimiter=",", header=heading, comments="")
    code, out, err = command(
        "diagnose", log, "--model", tmp_path / "Clutch.fmu", "--out", tmp_path / "o", "--json"
    )
    assert code == 0, err
    found = json.loads(out)
    (cause,) = found["causes"]
    assert cause["effect"] == "port.gain"
    assert "port.gain at Clutch.u (input)" in {
        f"port.gain at Clutch.{cause['connector']} ({cause['where']})",
        *cause["indistinguishable_from"],
    }
    assert cause["parameters"]["gain"]["value"] == pytest.approx(0.8, rel=0.01)
    assert list(found["signals"]) == ["Clutch.y"]
    with Runner(Path(found["extended"]["ssp"])) as runner:  # its package takes them, too
        time = systems.H * np.arange(count)
        inputs = {"u": (time, u), "gear": (time, gear), "on": (time, on.astype(float))}
        result = runner.run(time[-1], systems.H, inputs=inputs, record=["y"], hold=())
    # the master hands u over half a sample earlier than it acted here; without the gain 25 % are left
    assert np.std(result["y"] - y) < 0.02 * np.std(y)


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("first", [0.0, 1.0])
def test_a_switch_may_act_at_its_sample_or_at_the_next(
    command, tmp_path: Path, late: int, first: float
) -> None:
    """Which of the two is how a log was made, and no fault of a component that hands straight on.

    Nor is what it gives before its first step, where it does not say that it has calculated anything by then.
    """
    parts.by_pythonfmu("Clutch", CLUTCH.replace("(1.0 - math.exp(-h / 0.2))", "1.0"), tmp_path)
    rng = np.random.default_rng(4)
    k = np.arange(800)
    u = first + np.sin(k / 40) + 0.3 * np.sin(k / 11)
    on = (k // 97) % 3 != 1
    y = u * on[np.maximum(k - late, 0)]
    table = np.column_stack([systems.H * k, u, on, y + 0.005 * rng.standard_normal(k.size)])
    log = tmp_path / "log.csv"
    np.savetxt(log, table, "%.12g", delimiter=",", header="time [s],u [1],on [1],y [1]", comments="")
    code, out, err = command(
        "diagnose", log, "--model", tmp_path / "Clutch.fmu", "--out", tmp_path / "o", "--json"
    )
    assert code == 0, err
    found = json.loads(out)
    assert (found["verdict"], found["causes"], found["unexplained"]) == ("adequate", [], [])


LATCH = """
import math

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Latch(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.y, self.high, self.on = 0.0, 0.0, False, False
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, t, h):
        if self.u > 0.6 and not self.high:
            self.on = not self.on
        self.high = self.u > 0.6
        self.y += (1.0 - math.exp(-h / 0.3)) * (self.on - self.y)
        return True
"""


def test_a_contact_hears_pulses_that_are_held_over_a_sample(command, tmp_path: Path) -> None:
    """Between two samples, half of each, they never reach it: nobody's fault (MapleSim's clutches had two causes)."""
    parts.by_pythonfmu("Latch", LATCH, tmp_path)
    rng = np.random.default_rng(6)
    count = 800
    u = 0.1 * np.sin(np.arange(count) / 30)
    u[[60, 170, 210, 330, 470, 520, 610, 730]] = 0.8
    y, on = np.zeros(count), False
    for k in range(1, count):
        on ^= u[k - 1] > 0.6
        y[k] = y[k - 1] + (1.0 - np.exp(-systems.H / 0.3)) * (on - y[k - 1])
    table = np.column_stack([systems.H * np.arange(count), u, y + 0.003 * rng.standard_normal(count)])
    log = tmp_path / "log.csv"
    np.savetxt(log, table, "%.12g", delimiter=",", header="time [s],u [1],y [1]", comments="")
    code, out, err = command(
        "diagnose", log, "--model", tmp_path / "Latch.fmu", "--out", tmp_path / "o", "--json"
    )
    assert code == 0, err
    found = json.loads(out)
    assert (found["verdict"], found["causes"], found["unexplained"]) == ("adequate", [], [])


def test_an_input_called_u_is_not_held_against_the_crane_s_command(native, tmp_path):
    """Of another system neither unit nor range of a name that we use too is ours."""
    log = tmp_path / "log.csv"
    rows = [f"{k / 100},{12.0 * np.sin(k / 30):.6f},{np.cos(k / 20):.6f}" for k in range(400)]
    log.write_text("t,volts,y\n" + "\n".join(rows) + "\n")
    mapping = tmp_path / "log.toml"
    mapping.write_text(
        'model = "drive.ssp"\n[time]\ncolumn = "t"\nunit = "s"\n[signals.u]\ncolumn = "volts"\nunit = "V"\n'
        '[signals."plant.y"]\ncolumn = "y"\nunit = "1"\n[compare.signals.u]\nvariable = "command"\n'
    )
    with read_system(native) as system:
        (recording,), _, _ = read([log], system, mapping)
    assert recording.warnings == []
    assert np.ptp(recording.signals["command"]) == pytest.approx(24.0, rel=0.01)


def test_a_command_of_the_crane_in_volts_is_refused_as_before(tmp_path):
    mapping = tmp_path / "log.toml"
    text = '[time]\nstep = 1\nunit = "s"\n[signals.u]\ncolumn = "volts"\nunit = "V"\n'
    mapping.write_text(text)
    with pytest.raises(DataError, match="'V' has the wrong dimension"):
        load_mapping(mapping)
    mapping.write_text(f'model = "drive.fmu"\n{text}')
    assert load_mapping(mapping).signals["u"].unit == "V"


COUNTER = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Integer


class Counter(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.counter = 0
        self.register_variable(Integer("counter", causality=Fmi2Causality.output))

    def do_step(self, t, h):
        self.counter = int(t + h)
        return True
"""


def test_a_measured_output_that_is_a_whole_number_is_said_to_be_one(command, tmp_path: Path) -> None:
    parts.by_pythonfmu("Counter", COUNTER, tmp_path)
    log = tmp_path / "log.csv"
    log.write_text("time [s],counter [1]\n" + "".join(f"{0.1 * k!r},{k // 10}\n" for k in range(100)))
    code, _, err = command("diagnose", log, "--model", tmp_path / "Counter.fmu", "--out", tmp_path / "o")
    assert code == 3
    assert "only Counter.counter was measured, and what is whole or true or false is not judged" in " ".join(
        err.split()
    )


UNITS = (
    '<UnitDefinitions><Unit name="mA"><BaseUnit A="1" factor="1e-3"/></Unit>'
    '<Unit name="L/min"><BaseUnit m="3" s="-1" factor="6e-4"/></Unit></UnitDefinitions>'
)


@pytest.fixture
def valve(tmp_path: Path) -> Path:
    """An FMU from mA to L/min that defines the second as if a minute were 1.7 s, as a valve of Parker's does."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    made, target = parts.native("lag", tmp_path), tmp_path / "valve.fmu"
    with zipfile.ZipFile(made) as source, zipfile.ZipFile(target, "w") as archive:
        for name in source.namelist():
            data = source.read(name)
            if name == "modelDescription.xml":
                text = data.decode().replace("<ModelVariables>", UNITS + "<ModelVariables>")
                text = text.replace(
                    'causality="input"><Real start="0.0"', 'causality="input"><Real unit="mA" start="0.0"'
                )
                data = text.replace("<Real/>", '<Real unit="L/min"/>').encode()
            archive.writestr(name, data)
    return target


def test_a_unit_that_log_and_fmu_call_alike_is_the_same_whatever_the_fmu_says_of_it(valve, tmp_path):
    log = tmp_path / "log.csv"
    rows = "".join(f"{0.01 * k!r},{k % 7},{k % 5}\n" for k in range(100))
    with read_system(valve) as system:
        log.write_text("time [s],u [mA],y [L/min]\n" + rows)
        ((alike,), _, _) = read([log], system, None)
        log.write_text("time [s],u [A],y [m3/s]\n" + rows)
        ((other,), _, _) = read([log], system, None)
    np.testing.assert_allclose(alike.signals["u"], np.arange(100) % 7, rtol=1e-12)
    np.testing.assert_allclose(alike.signals["valve.y"], np.arange(100) % 5, rtol=1e-12)
    np.testing.assert_allclose(other.signals["u"], 1e3 * (np.arange(100) % 7), rtol=1e-12)
    np.testing.assert_allclose(other.signals["valve.y"], np.arange(100) % 5 / 6e-4, rtol=1e-12)
    for found, told in (
        (alike, "the log's numbers are taken as they are"),
        (other, "the FMU's definition is taken"),
    ):
        (warning,) = found.warnings
        assert "'L/min' is defined as 0.0006" in warning
        assert told in warning


def test_a_unit_that_is_not_what_it_is_called_is_a_warning_of_validate(valve, command):
    _, out, _ = command("validate", valve)
    assert "the unit 'L/min' is defined as 0.0006" in " ".join(out.split())
    assert "'mA'" not in out


@pytest.mark.parametrize("unit", ["mA", "A"])
def test_an_input_of_a_mapped_log_reaches_an_fmu_in_its_own_unit(valve, command, tmp_path, unit):
    log, mapping, out = tmp_path / "log.csv", tmp_path / "m.toml", tmp_path / "run.csv"
    size = {"mA": 400.0, "A": 0.4}[unit]
    log.write_text("Zeit,Strom\n" + "".join(f"{0.1 * k!r},{size!r}\n" for k in range(300)))
    for target in ("u", "valve.u"):
        mapping.write_text(
            'model = "valve.fmu"\n[time]\ncolumn = "Zeit"\nunit = "s"\n'
            + f'[signals."{target}"]\ncolumn = "Strom"\nunit = "{unit}"\n'
        )
        code, _, err = command(
            "simulate", valve, "--input", log, "--mapping", mapping, "--step-size", "0.1 s", "--out", out
        )
        assert code == 0, err
        last = np.genfromtxt(out, delimiter=",", skip_header=1)[-1]
        heading = out.read_text().partition("\n")[0].split(",")
        place = next(k for k, name in enumerate(heading) if name.startswith("valve.y"))
        assert last[place] == pytest.approx(400.0, rel=1e-6), heading  # K = 1, long settled
