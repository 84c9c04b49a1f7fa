"""Dry friction that an FMU of a stranger's lacks: named with its level, and put into the package as a loop."""

import json
from pathlib import Path

import numpy as np
import pytest
import systems
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from benchmarks.systems import parts
from cosim.errors import DataError
from cosim.master import Runner
from cosim.native.build import build_native
from cosim.ssp.read import read_system
from cosim.ssp.system import Port
from cosim.system.graph import cut
from fmus.build import build_fmu
from fmus.compose import compose
from fmus.port_friction import BLOCK

LEVEL, NOISE = 0.25, 0.003  # of the input; of the reading
MAPPING = """[time]
column = "time"
unit = "s"
[signals.command]
column = "command"
unit = "1"
[signals."plant.y"]
column = "plant.y"
unit = "1"
"""


@pytest.fixture(scope="module")
def axis(fmus: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An axis on a spring without friction, and the synthetic log of one that rubs."""
    folder = tmp_path_factory.mktemp("axis")
    values = systems.VALUES["plant"]
    model = parts.write_ssp(
        folder / "axis.ssp", {"plant": fmus["second"]}, [("command", "plant.u")], {"plant": values}
    )
    rng = np.random.default_rng(6)
    drive = systems.command(rng)
    time = systems.H * np.arange(drive.size)
    k, w, zeta = (values[n] for n in ("K", "W", "ZETA"))

    def rate(t: float, x: np.ndarray) -> list[float]:
        pushed = np.interp(t, time, drive) - LEVEL * np.tanh(x[1] / 0.01)
        return [x[1], w**2 * (k * pushed - x[0]) - 2.0 * zeta * w * x[1]]

    moved = solve_ivp(rate, (0.0, time[-1]), [0.0, 0.0], "LSODA", time, max_step=systems.H).y[0]
    table = np.column_stack([time, drive, moved + rng.normal(0.0, NOISE, time.size)])
    np.savetxt(
        folder / "log.csv", table, delimiter=",", header="time [s],command [1],plant.y [1]", comments=""
    )
    return model, folder / "log.csv"


def test_dry_friction_is_named_and_in_the_package(axis: tuple[Path, Path], command, tmp_path: Path) -> None:
    model, log = axis
    code, out, err = command("diagnose", log, "--model", model, "--out", tmp_path / "out", "--json")
    assert code == 0, err
    found = json.loads(out)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["component"], cause["connector"]) == ("port.friction", "plant", "u")
    level = cause["parameters"]["level"]
    assert level["value"] == pytest.approx(LEVEL, rel=0.03)
    assert level["ci95"][0] < LEVEL < level["ci95"][1]
    assert cause["indistinguishable_from"] == []
    gain = found["gain"]["plant.y"]
    assert gain["rmse_after"] < 0.1 * gain["rmse_before"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Dry friction takes its level off the signal" in page
    assert "at plant.u (input), against the motion of plant.y" in page

    # the package has it in a loop, in both kinds of code, and is right at a finer step too
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    errors = {}
    for name in ("extended.ssp", "extended_native.ssp"):
        with Runner(tmp_path / "out" / name) as runner:
            inputs = {"command": (table[:, 0], table[:, 1])}
            for step in (systems.H, systems.H / 5):
                result = runner.run(table[-1, 0], step, inputs=inputs, record=["plant.y"], hold=())
                rest = np.interp(table[:, 0], result.time, result.signals["plant.y"]) - table[:, 2]
                errors[name, step] = float(np.std(rest))
    assert errors["extended.ssp", systems.H / 5] < 1.3 * NOISE
    assert errors["extended.ssp", systems.H] < 0.1 * gain["rmse_before"]
    for step in (systems.H, systems.H / 5):
        assert errors["extended_native.ssp", step] == pytest.approx(errors["extended.ssp", step], rel=1e-9)

    # and the log shows nothing wrong with it: no reading cuts that loop
    again = command(
        "diagnose", log, "--model", tmp_path / "out" / "extended.ssp", "--out", tmp_path / "again", "--json"
    )
    assert json.loads(again[1])["verdict"] == "adequate"
    with read_system(tmp_path / "out" / "extended.ssp") as extended:
        (group,) = cut(extended, ["command", "plant.y"])
        assert len(group.units) == 1
        assert [d.port for d in group.drives] == [Port("friction_plant_u_input", "u")]


def test_an_excluded_friction_is_told_as_a_function_of_the_speed(
    axis: tuple[Path, Path], command, tmp_path: Path
) -> None:
    model, log = axis
    mapping = tmp_path / "m.toml"
    mapping.write_text(MAPPING + '[diagnose]\nexclude = ["port.friction"]\n')
    words = ["diagnose", log, "--model", model, "--mapping", mapping, "--out", tmp_path / "out", "--json"]
    code, out, err = command(*words)
    assert code == 0, err
    found = json.loads(out)
    assert found["causes"] == [], "play at the input leaves less than none, and more than friction would"
    (left,) = found["unexplained"]
    missing = left["missing"]
    assert missing["enters_at"] == ["plant.u (input)"]
    assert missing["depends_on"] == "speed of plant.y"
    assert missing["share"] > 0.7
    assert "the speed of plant.y (as friction is)" in left["what"]
    speed, force = np.array(missing["points"]).T
    fast = np.abs(speed) > 0.3 * np.abs(speed).max()
    np.testing.assert_allclose(force[fast], -LEVEL * np.sign(speed[fast]), atol=0.6 * LEVEL)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "What is missing at plant.u against speed of plant.y" in page


@pytest.mark.parametrize("make", [build_fmu, build_native])
@pytest.mark.parametrize("of_place", [0, 1])
def test_friction_is_its_level_against_the_motion(make, of_place: int, tmp_path: Path) -> None:
    h, level, acceleration = 0.01, 0.3, 4.0
    speed = np.concatenate([np.zeros(3), np.ones(5), -np.ones(5)])
    time = h * np.arange(speed.size)
    # a step reads the value at its start: the place then, or the speed
    x = np.concatenate([[0.0], np.cumsum(h * speed)[:-1]]) if of_place else speed
    starts = {"level": level, "acceleration": acceleration, "of_place": of_place}
    with Runner(make(compose(BLOCK), tmp_path / "f.fmu", starts)) as runner:
        inputs = {"u": (time, np.full(time.size, 2.0)), "x": (time, x)}
        y = runner.run(time[-1], h, inputs=inputs, record=["f.y"]).signals["f.y"]
    rubs = 2.0 - y
    assert rubs[:3] == pytest.approx(0.0)
    assert set(np.round(rubs, 12)) == {0.0, level, -level}
    assert rubs[-1] == pytest.approx(-level)


@settings(max_examples=50)
@given(
    load=st.floats(-1.5, 1.5).filter(lambda v: abs(abs(v) - 1.0) > 0.05),
    h=st.sampled_from([1e-3, 0.01, 0.05]),
    acceleration=st.floats(1e-2, 1e2),
    of_place=st.sampled_from([0.0, 1.0]),
)
def test_what_rubs_stays_where_it_is_held_and_slips_beyond_the_level(
    load: float, h: float, acceleration: float, of_place: float
) -> None:
    """A mass under a constant load, in parts of the level: below it it comes to rest, without creeping."""
    module = compose(BLOCK).module
    p = module.Parameters(level=1.0, acceleration=acceleration, of_place=of_place)
    c = module.coefficients(p, h)
    place = speed = 0.0
    at = [place]
    state = module.start(module.Input(load, 0.0), p)
    for _ in range(400):
        state = module.step(state, module.Input(load, place if of_place else speed), None, p, c)
        speed += acceleration * h * state.y
        place += h * speed
        at.append(place)
    rest = np.array(at)
    if abs(load) < 1.0:
        given_way = 2.0 * acceleration * h**2
        assert np.all(np.abs(rest) < 2.0 * given_way)
        assert abs(rest[-1] - rest[200]) < 1e-6 * given_way
    else:
        gained = np.diff(rest)[-1] - np.diff(rest)[-101]
        assert gained == pytest.approx(100 * h**2 * acceleration * (load - np.sign(load)), rel=1e-6)


def test_an_effect_that_is_no_candidate_is_refused_by_name(tmp_path: Path, command, axis) -> None:
    model, log = axis
    mapping = tmp_path / "m.toml"
    mapping.write_text(MAPPING + '[diagnose]\nexclude = ["port.rubs"]\n')
    code, _, err = command("diagnose", log, "--model", model, "--mapping", mapping, "--out", tmp_path / "o")
    assert code == DataError.exit_code
    assert "port.friction" in err
