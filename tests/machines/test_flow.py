"""A load pressure between command and motion, and one that the load makes while flow sets the speed (synthetic)."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from cosim.compare import Comparator, open_model
from cosim.diagnosis.answer.remarks import one_way
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.pipeline.diagnose import prepare
from cosim.logs import Log, load_log
from cosim.logs.guess import guesses
from cosim.logs.overview import overview
from cosim.machines import made_for
from cosim.machines.flow import set_by_flow
from cosim.rig import make_log

STEP = 0.02
CYLINDER = """
name = "cylinder"
time = { column = "t", unit = "s" }
[signals]
u = { column = "u", unit = "1" }
p_a = { column = "pa", unit = "bar" }
p_b = { column = "pb", unit = "bar" }
travel = { column = "x", unit = "mm" }
[machine]
chain = ["dead_zone", "dcv", "continuity", "mechanical", "sensor"]
motion = "travel"
output = "travel"
speed = "?"
lag = "?"
"""


def lagged(values: np.ndarray, lag: float) -> np.ndarray:
    kept = float(np.exp(-STEP / lag))
    return lfilter([0.0, 1.0 - kept], [1.0, -kept], values)


def moved(kind: str, seed: int = 2) -> dict[str, np.ndarray]:
    """40 s of a cylinder: driven by its pressure, or by flow with dry friction and a weight that make the pressure."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, 40) * (rng.uniform(size=40) < 0.7), 50)
    t = STEP * np.arange(u.size)
    if kind == "pressure":
        load = lagged(60.0 * u, 0.1)
        speed = lagged(load * 2.0, 0.15)
    else:
        speed = lagged(120.0 * u, 0.15)
        load = 8.0 * np.tanh(speed / 2.0) + 20.0 + 15.0 * np.sin(np.cumsum(speed) * STEP / 40.0)
    x = np.cumsum(speed) * STEP
    noise = rng.normal(size=(3, u.size))
    return {
        "t": t,
        "u": u,
        "pa": 50.0 + load / 2.0 + 0.1 * noise[0],
        "pb": 50.0 - load / 2.0 + 0.1 * noise[1],
        "x": x,
    }


def written(folder: Path, kind: str) -> tuple[Path, Log]:
    columns = moved(kind)
    file, mapping = folder / "log.csv", folder / "cylinder.toml"
    np.savetxt(
        file, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="",
        fmt="%.9g",
    )  # fmt: skip
    mapping.write_text(CYLINDER, encoding="utf-8")
    return mapping, load_log(file, mapping)


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_a_pressure_that_drives_is_told_from_one_that_the_load_makes(seed):
    for kind, aside in (("pressure", False), ("flow", True)):
        c = moved(kind, seed)
        why = set_by_flow(c["t"], c["u"], c["pa"] - c["pb"], c["x"], integrates=True)
        assert bool(why) is aside, (kind, why)


@pytest.mark.parametrize(
    "hidden",
    [
        [],
        ["mechanical.coulomb_friction:tau_c=300 N.m"],
        ["mechanical.gravity_load:tau_g=400 N.m"],
        ["continuity.cracking_pressure:p_c=3 bar"],
        ["dcv.offset:x_0=0.2 mm"],
    ],
    ids=["none", "friction", "gravity", "cracking", "offset"],
)
@pytest.mark.parametrize("excitation", ["steps", "triangle"])
def test_faults_of_the_crane_do_not_make_its_pressure_a_load(hidden, excitation):
    run = make_log(excitation, 30.0, hidden, seed=3)
    assert not set_by_flow(run.time, run.u, run.p_a - run.p_b, run.slew, integrates=True)


def test_a_pressure_that_the_load_makes_is_left_aside_and_that_is_said(tmp_path):
    mapping, log = written(tmp_path, "flow")
    made = made_for(mapping, log, folder=tmp_path / "made")
    assert set(made.table.aside) == {"p_load", "p_a", "p_b"}
    assert made.numbers.speed == pytest.approx(0.12, rel=0.1), "told by command and motion alone"
    machine = machine_of(None, log, mapping)
    assert "p_a and p_b are left aside" in machine.aside["p_load"]
    assert set(prepare(log, machine).signals) == {"u", "travel"}
    with Comparator(log, open_model(str(made.ssd)), table=made.table) as comparator:
        assert any("left aside" in note for note in comparator.notes)
        assert not any("not compared" in note for note in comparator.notes)


def test_a_pressure_that_drives_stays_a_cut(tmp_path):
    mapping, log = written(tmp_path, "pressure")
    made = made_for(mapping, log, folder=tmp_path / "made")
    assert made.table.aside == {}
    assert "p_load" in prepare(log, machine_of(None, log, mapping)).signals


def test_a_log_that_stands_still_says_nothing():
    t = STEP * np.arange(500)
    assert not set_by_flow(t, np.sin(t), np.full(500, 3.0), np.sin(t), integrates=True)


def test_the_chambers_of_the_axis_are_found_by_side_and_direction(tmp_path):
    """As a test stand names them; pilot pressures and other cylinders are no chambers of this axis."""
    c = moved("flow")
    columns = {
        "time": c["t"],
        "Boom_up_duty": np.maximum(c["u"], 0.0),
        "Boom_dn_duty": np.maximum(-c["u"], 0.0),
        "Boom_Up_eppr_P": 20.0 * np.maximum(c["u"], 0.0),
        "Boom_Dn_eppr_P": 20.0 * np.maximum(-c["u"], 0.0),
        "Arm_InH_Cyl_P": c["pb"] + 3.0,
        "Arm_OutR_Cyl_P": c["pa"] + 3.0,
        "Boom_DnR_Cyl_P": c["pb"],
        "Boom_UpH_Cyl_P": c["pa"],
        "Boom_ang": c["x"] / 10.0,
    }
    file = tmp_path / "stand.csv"
    np.savetxt(
        file, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments=""
    )
    made = guesses(overview(file), machine=True)
    assert {s: g.column.label.text for s, g in made.items() if s.startswith("p_")} == {
        "p_a": "Boom_UpH_Cyl_P",
        "p_b": "Boom_DnR_Cyl_P",
    }
    assert made["p_a"].check


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["up", "down"])
def test_port_a_is_the_same_in_logs_of_either_direction(tmp_path: Path, sign: float) -> None:
    """A mapping made of a log in which the boom is lowered had the chambers the other way round than its command."""
    t = STEP * np.arange(600)
    u = 70.0 * (t > 1.0)
    angle = sign * np.cumsum(lagged(u, 0.2)) * STEP / 10.0
    columns = {
        "time": t,
        "Boom_dn_duty": u if sign < 0.0 else 0.0 * u,
        "Boom_up_duty": u if sign > 0.0 else 0.0 * u,
        "Boom_DnR_Cyl_P": 20.0 - sign * 0.2 * u,
        "Boom_UpH_Cyl_P": 40.0 + sign * 0.3 * u,
        "Boom_ang": angle,
    }
    file = tmp_path / "stand.csv"
    table = np.column_stack(list(columns.values()))
    np.savetxt(file, table, delimiter=",", header=",".join(columns), comments="")
    made = guesses(overview(file), machine=True)
    assert made["u"].column.label.text == "Boom_up_duty"
    assert made["u"].minus is not None
    assert made["p_a"].column.label.text == "Boom_UpH_Cyl_P"


def test_one_axis_of_several_is_taken_for_any_machine(tmp_path: Path) -> None:
    """`cosim info` took the largest motion and the first command, `cosim init --machine` two that go together."""
    rng = np.random.default_rng(6)
    one, two = (np.repeat(rng.uniform(-1.0, 1.0, 60), 50) for _ in range(2))
    t = STEP * np.arange(one.size)
    drift = 300.0 * np.sin(t / 20.0)  # an angle that nothing logged moves is the largest
    columns = {"time [s]": t, "valve 1 [%]": 100.0 * one, "valve 2 [%]": 100.0 * two,
               "angle left [deg]": drift, "angle right [deg]": np.cumsum(lagged(two, 0.1)) * STEP * 20.0}  # fmt: skip
    file = tmp_path / "two.csv"
    table = np.column_stack(list(columns.values()))
    np.savetxt(file, table, delimiter=",", header=",".join(columns), comments="")
    for machine in (True, False):
        made = guesses(overview(file), machine=machine)
        assert {s: made[s].column.label.short for s in ("u", "slew")} == {
            "u": "valve 2",
            "slew": "angle right",
        }


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("head side pressure", "rod side pressure"),
        ("Druck Kolbenseite", "Druck Ringseite"),
        ("lift extension pressure", "lift retraction pressure"),
    ],
)
def test_chambers_by_other_names(tmp_path, a, b):
    c = moved("flow")
    columns = {"time": c["t"], "valve command": c["u"], "cylinder position": c["x"], b: c["pb"], a: c["pa"]}
    file = tmp_path / "stand.csv"
    np.savetxt(
        file, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments=""
    )
    made = guesses(overview(file), machine=True)
    assert (made["p_a"].column.label.text, made["p_b"].column.label.text) == (a, b)


def test_of_several_axes_and_commands_without_a_common_word_those_are_taken_that_go_together(tmp_path):
    """A wheel loader: the lift joystick moves the boom, the tilt joystick the bucket, which moves farther."""
    lift, tilt = moved("pressure", 2), moved("pressure", 3)
    columns = {
        "time": lift["t"],
        "bucket_angle_deg": tilt["x"] + lift["x"],
        "boom_angle_deg": lift["x"],
        "tilt_joystick": tilt["u"],
        "lift_joystick": lift["u"],
    }
    file = tmp_path / "loader.csv"
    np.savetxt(
        file, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments=""
    )
    made = guesses(overview(file), machine=True)
    assert (made["u"].column.label.text, made["slew"].column.label.text) == (
        "lift_joystick",
        "boom_angle_deg",
    )


@pytest.mark.parametrize("name", ["Flowm3Ps", "oil flow a", "Durchfluss PB"])
def test_a_flow_is_no_pressure(tmp_path, name):
    c = moved("flow")
    columns = {"time": c["t"], "valve command": c["u"], "cylinder position": c["x"], name: c["pb"]}
    file = tmp_path / "stand.csv"
    np.savetxt(
        file, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments=""
    )
    assert not {"p_a", "p_b", "p_supply"} & set(guesses(overview(file), machine=True))


def test_a_supply_of_which_nothing_is_said_is_not_held_against_the_crane_s(tmp_path):
    mapping, _ = written(tmp_path, "pressure")
    file = tmp_path / "log.csv"
    lines = file.read_text().splitlines()
    file.write_text("\n".join([lines[0] + ",ps", *(f"{line},207" for line in lines[1:])]) + "\n")
    text = CYLINDER.replace("travel = {", 'p_supply = { column = "ps", unit = "bar" }\ntravel = {')
    mapping.write_text(text, encoding="utf-8")
    log = load_log(file, mapping)
    machine = machine_of(None, log, mapping)
    assert "p_supply is not judged" in machine.aside["p_supply"]
    assert "p_supply" not in prepare(log, machine).signals
    mapping.write_text(text + '[machine.parameters]\n"continuity.p_s" = "200 bar"\n', encoding="utf-8")
    assert machine_of(None, log, mapping).aside == {}


def test_the_missing_column_of_the_other_direction_is_asked_for_on_a_linear_axis_too(tmp_path):
    mapping, log = written(tmp_path, "flow")
    machine = machine_of(None, log, mapping)
    record = prepare(log, machine)
    assert not one_way(record, machine)
    u = record.signals["u"]
    # as far forth as back, of which the log shows the command of one way only
    record.signals["travel"] = (
        np.cumsum(np.where(u > 0.0, u, u * u[u > 0.0].sum() / -u[u < 0.0].sum())) * 1e-3
    )
    record.signals["u"] = np.maximum(u, 0.0)
    (text,) = one_way(record, machine)
    assert text.startswith("travel goes back by ")
