"""What a log calls by the name of a port is read beyond the effects that an extended model has there."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from benchmarks.systems import parts
from cosim.anysystem.actions import Action
from cosim.anysystem.extend import write_package
from cosim.compare.binding import _bound
from cosim.ssp.read import read_system
from cosim.ssp.system import Port
from fmus.build import build_fmu

H, N, NOISE, GAIN = 0.01, 1500, 0.003, 1.4
MAPPING = """
[time]
column = "time [s]"
unit = "s"
[signals."part_lag.u"]
column = "part_lag.u [1]"
unit = "1"
[signals."part_lag.y"]
column = "part_lag.y [1]"
unit = "deg"
[compare.units]
"part_lag.y" = "deg"
"""


def log(file: Path) -> Path:
    """A lag of which everything is 1.4 times as large."""
    rng = np.random.default_rng(8)
    u = np.repeat(rng.uniform(-1.0, 1.0, N // 75), 75)
    y = np.zeros(N)
    for k in range(1, N):
        y[k] = y[k - 1] + (1.0 - np.exp(-H)) * (0.5 * GAIN * (u[k] + u[k - 1]) - y[k - 1])
    table = np.column_stack([H * np.arange(N), u, y + NOISE * rng.standard_normal(N)])
    np.savetxt(file, table, "%.9g", ",", header="time [s],part_lag.u [1],part_lag.y [1]", comments="")
    return file


@pytest.mark.skipif(parts.COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("mapped", [False, True], ids=["by name", "mapped"])
@pytest.mark.parametrize(
    ("port", "where"), [("u", "input"), ("y", "output"), ("y", "sensor")], ids=["input", "output", "sensor"]
)
def test_all_commands_read_behind_what_was_found(
    command, tmp_path: Path, port: str, where: str, mapped: bool
) -> None:
    """A comparison of the extended model took the FMU's output before the effect, and the error stayed as it was."""
    path, model, to = log(tmp_path / "log.csv"), tmp_path / "extended.ssp", tmp_path / "run.csv"
    with read_system(parts.native("lag", tmp_path)) as system:
        action = Action("port.gain", Port("part_lag", port), where)  # type: ignore[arg-type]
        write_package(system, [(action, {"gain": GAIN})], {}, model, build_fmu)
    words: tuple[object, ...] = ()
    if mapped:
        (tmp_path / "m.toml").write_text(MAPPING)
        words = ("--mapping", tmp_path / "m.toml")
    code, out, err = command("compare", path, "--model", model, *words, "--json")
    assert code == 0, err
    shown = json.loads(out)["signals"]["part_lag.y"]
    assert (shown["rmse"], shown["unit"]) == (pytest.approx(NOISE, rel=0.8), "deg" if mapped else "1")
    code, _, err = command("simulate", model, "--input", path, *words, "--step-size", f"{H} s", "--out", to)
    assert code == 0, err
    header, *rows = to.read_text().splitlines()
    heads = [name.partition(" ")[0] for name in header.split(",")]
    place = heads.index("part_lag.y" if port == "u" else f"gain_part_lag_y_{where}.y")
    ran = np.array([float(row.split(",")[place]) for row in rows])
    measured = np.loadtxt(path, delimiter=",", skiprows=1)[: ran.size, 2]
    assert np.sqrt(np.mean((ran - measured) ** 2)) < 1.8 * NOISE
    if where == "output":
        code, out, err = command(
            "diagnose", path, "--model", model, *words, "--out", tmp_path / "o", "--json"
        )
        assert code == 0, err
        assert json.loads(out)["verdict"] == "adequate"


def test_a_unit_that_a_wire_tells_is_told_of_the_port_behind_an_effect(native: Path, tmp_path: Path) -> None:
    """An angle in degrees was "1" in the extended package, and the mapping that had found the effect no longer fitted it."""
    told, model = tmp_path / "told.ssp", tmp_path / "extended.ssp"
    with zipfile.ZipFile(native) as old, zipfile.ZipFile(told, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "SystemStructure.ssd":
                root = etree.fromstring(content)
                (outer,) = root.findall(".//{*}System/{*}Connectors/{*}Connector[@name='command']")
                for child in outer:
                    child.set("unit", "deg")
                assert len(outer) == 1
                content = etree.tostring(root)
            new.writestr(name, content)
    port = Port("valve", "u")
    with read_system(told) as system:
        assert system.variable(port).unit == "deg"
        write_package(system, [(Action("port.gain", port, "input"), {"gain": GAIN})], {}, model, build_fmu)
    with read_system(model) as system:
        assert system.variable(port).unit == "deg"
        assert system.variable(Port("gain_valve_u_input", "u")).unit == "deg"


@pytest.mark.skipif(parts.COMPILER is None, reason="no C compiler")
def test_behind_an_effect_a_reading_is_in_the_unit_of_its_port(tmp_path: Path) -> None:
    """A log in volts went with an FMU that states no unit, and not with the model extended by a delay: "expected '1'"."""
    model = tmp_path / "extended.ssp"
    with read_system(parts.native("lag", tmp_path)) as system:
        action = Action("port.gain", Port("part_lag", "y"), "output")
        write_package(system, [(action, {"gain": GAIN})], {}, model, build_fmu)
    with read_system(model) as system:
        assert system.variable(Port("part_lag", "y")).unit == ""
        found = _bound(system, "part_lag.y", "V", "part_lag.y", None)
    assert (found.port, found.unit, found.gain) == (Port("gain_part_lag_y_output", "y"), "V", 1.0)
