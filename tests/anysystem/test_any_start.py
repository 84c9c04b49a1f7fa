"""`cosim init`, what the graph alone can tell apart, and how the system is cut."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import systems

from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden
from cosim.anysystem.initial import fit as initial_fit
from cosim.anysystem.meant import behind, clearly
from cosim.anysystem.start import ALIKE, akin, by_meaning, likeness, matches, only_by_unit, words
from cosim.compare.binding import gain_between
from cosim.errors import UsageError
from cosim.logs.source import Label
from cosim.ssp.read import read_system
from cosim.system.graph import cut
from cosim.system.structure import signatures, structure


def test_init_matches_columns_and_its_mapping_is_diagnosed(native: Path, command, tmp_path: Path) -> None:
    hidden = Hidden("port.gain", "valve.y", "output", {"gain": 1.15})
    log = systems.log(tmp_path / "log.csv", [hidden], 2)
    rows = log.read_text().splitlines()
    log.write_text("\n".join(["Time (s),Command (1),valve_y,plant_y (1)", *rows[1:]]) + "\n")
    code, _, err = command("init", native, log)
    assert code == 0, err
    mapping = tmp_path / "log.toml"
    assert "check" in mapping.read_text()  # valve_y has no unit
    assert mapping.read_text().count("held = true") == 1  # the one input
    assert command("init", native, log)[0] == 2  # not written over
    code, out, err = command("diagnose", log, "--mapping", mapping, "--out", tmp_path / "o", "--json")
    assert code == 0, err
    assert [c["effect"] for c in json.loads(out)["causes"]] == ["port.gain"]
    code, out, err = command("compare", log, "--mapping", mapping, "--json")
    assert code == 0, err
    assert {"valve.y", "plant.y"} <= json.loads(out)["signals"].keys()


def test_an_fmu_that_states_no_unit_takes_any() -> None:
    assert gain_between("torque", "N.m", "", None) == 1.0
    with pytest.raises(UsageError, match="wrong dimension"):
        gain_between("torque", "N.m", "1", None)


def test_a_column_that_fits_nothing_stays_a_comment(native: Path, command, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("time [s],command [1],oil temperature [K]\n0,0,300\n1,1,301\n")
    code, out, err = command("init", native, log, "--json")
    assert code == 0, err
    assert json.loads(out)["open"] == ["column 'oil temperature [K]'"]
    assert '# column = "oil temperature [K]"' in log.with_suffix(".toml").read_text()


def test_a_log_of_which_no_column_is_known_gets_a_mapping_to_complete(
    native: Path, command, tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    log.write_text("first,second\n0.5,3.0\n0.1,1.0\n0.2,1.5\n")
    code, out, err = command("init", native, log)
    assert code == 0, err
    assert "Missing: a column for what was measured (" in out
    assert "the interval between samples" in out
    assert '# column = "first"' in log.with_suffix(".toml").read_text()


def test_the_last_column_is_the_last_connector(native: Path) -> None:
    with read_system(native) as system:
        *others, last = matches(system, [Label("time", "time", None)]).units
        labels = [Label(n, n, None) for n in ("time", *others, "what")]
        found = matches(system, labels)
        assert (found.taken[len(labels) - 1], found.check(len(labels) - 1)) == (
            last,
            "the only ones left over",
        )
        assert len(labels) - 2 not in matches(system, [*labels[:-2], labels[-1]]).taken, (
            "of two it may be either"
        )


def test_what_only_goes_on_inside_an_fmu_is_matched_by_its_own_name(native: Path, tmp_path: Path) -> None:
    """Many exporters leave states without the causality output, and people log them."""
    with read_system(native) as system:
        plant = system.components["plant"].fmu.variables
        inside = replace(plant["y"], name="spool.x", causality="local")
        plant |= {"spool.x": inside, "spool.v": replace(inside, name="spool.v")}
        labels = [Label(n, n, None) for n in ("time", "command", "spool.x", "plant_y")]
        assert matches(system, labels).taken == {1: "command", 2: "plant.spool.x", 3: "plant.y"}
        assert "plant.spool.v" not in matches(system, labels).units


@pytest.fixture(scope="module")
def ring(tmp_path_factory) -> Path:
    """A loop: the sum hears the command and what comes back."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("ring")
    fmus = {
        "add": parts.native("sum", folder),
        "lag": parts.native("lag", folder),
        "out": parts.native("damped", folder),
    }
    values = {
        "add": {"K": 1.0, "C": -0.5, "T": 0.1},
        "lag": {"K": 1.0, "T": 0.2},
        "out": {"K": 1.0, "T": 0.1, "C": 0.3},
    }
    wires = [("command", "add.u"), ("add.y", "lag.u"), ("lag.y", "add.v2"), ("lag.y", "out.u")]
    return parts.write_ssp(folder / "ring.ssp", fmus, wires, values)


def test_a_loop_is_one_unit_until_a_measurement_cuts_it(ring: Path) -> None:
    with read_system(ring) as system:
        one, two = cut(system, ["command", "lag.y", "out.y"])
        assert (one.name, two.name) == ("add+lag", "out")
        assert {str(d.port) for d in one.drives} == {"add.u", "add.v2"}
        assert [u.components for u in one.units] == [
            ("add",),
            ("lag",),
        ]  # the measured wire drives: no loop is left
        (all_,) = cut(system, ["command", "out.y"])
        assert [u.components for u in all_.units] == [("add", "lag"), ("out",)]
        assert len(cut(system, ["command", "add.y", "lag.y", "out.y"])) == 3


def test_a_reading_shows_in_the_groups_on_both_of_its_sides(ring: Path) -> None:
    with read_system(ring) as system:
        felt = signatures(system, ["command", "add.y", "lag.y", "out.y"], ["lag.T"])
        assert felt["at lag.y (output)"] == ("lag",)
        assert set(felt["at lag.y (sensor)"]) == {"lag", "add", "out"}
        assert felt["parameter lag.T"] == ("lag",)
        assert felt["at out.u (input)"] == ("out",)
        less = structure(system, ["command", "out.y"])
        assert any("lag.y" in advice for advice in less.advice)
        assert structure(system, ["command", "add.y", "lag.y", "out.y"]).advice == ()


@pytest.mark.parametrize(
    ("column", "unit", "connector"),
    [
        ("wheel pos", None, "Wheel.position"),
        ("wheelVel", None, "Wheel.velocity"),
        ("Cmd", None, "command"),
        ("Position_mm", "mm", "Wheel.position"),
        ("U_measured", None, "motor.U"),
        ("spring force", "N", "Wheel.out_spring_force"),
    ],
)
def test_a_column_is_matched_by_its_words_and_what_they_are_short_for(
    column: str, unit: str | None, connector: str
) -> None:
    units = {
        "Wheel.position": "m", "Wheel.velocity": "m/s", "Wheel.acceleration": "m/s2", "Wheel.out_spring_force": "N",
        "in_vel": "m/s", "command": "1", "motor.U": "V", "motor.I": "A",
    }  # fmt: skip
    fits = {name: likeness(Label(column, column, unit), name, own) for name, own in units.items()}
    assert max(fits, key=lambda name: fits[name]) == connector
    assert fits[connector] >= ALIKE
    assert sum(fit >= ALIKE for fit in fits.values()) == 1 or column == "wheelVel"


def test_a_column_of_a_unit_that_only_one_connector_has_is_guessed_to_be_checked() -> None:
    labels = [Label("strom", "strom", "mA"), Label("a", "a", "m"), Label("b", "b", "m")]
    units = {"motor.I": "A", "motor.U": "V", "one.x": "m", "two.x": "m", "part.y": "1"}
    assert only_by_unit(labels, (), {}, units) == {0: "motor.I"}


def test_info_shows_the_connectors_of_a_package_and_what_they_are_joined_with(native: Path, command) -> None:
    code, out, err = command("info", native, "--json")
    assert code == 0, err
    rows = {row["connector"]: row["joined with"] for row in json.loads(out)["connectors"]}
    assert rows == {
        "valve.u": "command (from outside)",
        "valve.y": "plant.u",
        "plant.u": "valve.y",
        "plant.y": "",
    }
    said = command("info", native)[1]
    assert said.startswith(
        f"{native}: system of 2 components (SSP), driven from outside by command\n  valve: resources/"
    )
    assert "kind: ssp" not in said
    assert f"Next: cosim simulate {native} --input LOG runs it; cosim init {native} LOG " in said
    assert "kind: ssp" in command("info", native, "--verbose")[1]


CRANE = {  # connector -> variable, description, component
    "valve_cmd": ("valve_cmd", "duty of the boom valve, up positive [%]", "Boom"),
    "Boom.p_A": ("p_A", "boom cylinder pressure, head side [bar]", "Boom"),
    "Boom.p_B": ("p_B", "boom cylinder pressure, rod side [bar]", "Boom"),
    "Boom.x": ("x", "cylinder displacement of the boom [cm]", "Boom"),
    "Boom.w": ("w", "slew rate of the upper carriage [rad/s]", "Boom"),
}


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        (("Boom_UpH_Cyl_P", "Boom_DnR_Cyl_P", "Arm_InH_Cyl_P"), {0: "Boom.p_A", 1: "Boom.p_B"}),
        (("Boom_up_duty", "Boom_dn_duty", "Arm_in_duty"), {0: "valve_cmd"}),
        (
            ("Boom Cmd", "Stick Cmd", "Boom Ms", "Stick Ms"),
            {0: "valve_cmd"},
        ),  # pressure or displacement: not told
        (("Boom stroke", "Boom stroke setpoint"), {0: "Boom.x"}),
        (("Boom pressure 1", "Boom pressure 2"), {}),  # whatever side they are of
        (("swing speed", "swing angle"), {0: "Boom.w"}),
        (
            ("Zylinderdruck Boom Kolbenseite", "Zylinderdruck Boom Stangenseite"),
            {0: "Boom.p_A", 1: "Boom.p_B"},
        ),
    ],
)
def test_a_description_tells_which_column_it_means_where_it_means_one(
    columns: tuple[str, ...], expected: dict[int, str]
) -> None:
    labels = [Label(name, name, None) for name in columns]
    assert clearly(by_meaning(labels, (), {}, CRANE, dict.fromkeys(CRANE, ""))) == expected


def test_a_demanded_place_is_no_measured_one() -> None:
    assert behind("pos_ref", "axis.pos position") == "reference"
    assert behind("pos_ref", "axis.pos_set demanded position") == ""
    assert behind("pos_meas", "axis.pos position") == ""


@pytest.mark.parametrize(
    ("name", "said", "least", "most"),
    [
        ("x_0", "", 1.2, 1.2),
        ("x_start", "", 1.2, 1.2),
        ("offset_0", "start of the boom cylinder's displacement [cm]", 0.6, 1.0),
        ("x_0", "time at which it begins [s]", 0.0, 0.0),
        ("p_0", "initial pressure of the accumulator", 0.0, 0.59),
        ("stiffness", "of the boom cylinder", 0.0, 0.0),
    ],
)
def test_an_initial_value_is_told_by_its_name_or_its_description(
    name: str, said: str, least: float, most: float
) -> None:
    parameter = SimpleNamespace(name=name, description=said, unit="")
    output = SimpleNamespace(name="x", description="boom cylinder displacement [cm]", unit="")
    assert least <= initial_fit(parameter, output, words, akin) <= most


BOOM = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Boom(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.boom_duty, self.boom_ang, self.boom_ang_0 = 0.0, 0.0, 0.0
        self.register_variable(Real("boom_duty", causality=Fmi2Causality.input, description="command [%]"))
        self.register_variable(Real("boom_ang", causality=Fmi2Causality.output, description="angle [deg]"))
        self.register_variable(Real("boom_ang_0", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def exit_initialization_mode(self):
        self.boom_ang = self.boom_ang_0

    def do_step(self, t, step):
        self.boom_ang += 0.2 * step * self.boom_duty
        return True
"""


def test_a_command_of_two_columns_is_their_difference_and_descriptions_tell_units(
    command, tmp_path: Path
) -> None:
    """The column of one direction was taken alone: of a log of the other the model heard nothing.

    The log begins at 12 deg: the mapping lets the model begin there.
    """
    parts.by_pythonfmu("Boom", BOOM, tmp_path)
    t = 0.02 * np.arange(500)
    down = 50.0 * ((t > 1.0) & (t < 4.0))
    angle = 12.0 - 0.2 * 0.02 * np.concatenate([[0.0], np.cumsum(down)[:-1]])
    log, mapping = tmp_path / "log.csv", tmp_path / "m.toml"
    table = np.column_stack([t, 0.0 * t, down, angle])
    np.savetxt(
        log, table, "%.6g", delimiter=",", header="time,Boom_up_duty,Boom_dn_duty,Boom_ang", comments=""
    )
    code, out, err = command("init", tmp_path / "Boom.fmu", log, "--out", mapping)
    assert code == 0, err
    assert "Boom_up_duty minus Boom_dn_duty -> boom_duty" in " ".join(out.split())
    found = tomllib.loads(mapping.read_text(encoding="utf-8"))
    assert found["signals"]["boom_duty"]["minus"] == "Boom_dn_duty"
    assert found["signals"]["boom_duty"]["held"]
    assert found["compare"]["units"] == {"boom_duty": "%", "Boom.boom_ang": "deg"}
    assert found["compare"]["start"] == {"Boom.boom_ang_0": "Boom.boom_ang"}
    assert "Boom.boom_ang begins at 12: the model begins there by Boom.boom_ang_0" in " ".join(out.split())
    code, out, err = command("compare", log, "--mapping", mapping, "--json")
    assert code == 0, err
    shown = json.loads(out)["signals"]["Boom.boom_ang"]
    assert shown["unit"] == "deg"
    assert shown["rmse"] < 0.01
