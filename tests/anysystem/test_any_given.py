"""What a mapping says of inputs that were not measured, and of parameters, is the same to all commands."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.systems.parts import by_pythonfmu
from cosim.ssp.read import read_system

GEARED = """
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real


class Geared(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.gear, self.on, self.y = 0.0, 1, False, 0.0
        self.K, self.first, self.teeth = 1.0, 0.0, 1
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Integer("gear", causality=Fmi2Causality.input))
        self.register_variable(Boolean("on", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        for name in ("K", "first"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Integer("teeth", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def exit_initialization_mode(self):
        self.y = self.first

    def do_step(self, t, step):
        drive = self.K * self.gear * self.teeth * self.u if self.on else 0.0
        self.y += (1.0 - 2.718281828459045 ** (-step / 0.4)) * (drive - self.y)
        return True
"""
H, N = 0.02, 900
MAPPING = """
[time]
column = "time"
unit = "s"
[signals."Geared.u"]
column = "u"
unit = "1"
held = true
[signals."Geared.y"]
column = "y"
unit = "1"
[compare.start]
"Geared.first" = "Geared.y"
[diagnose]
trusted = ["Geared.K"]
constant = {CONSTANT}
"""
STATED = '{ "Geared.gear" = 3, "Geared.on" = true, "Geared.teeth" = 2, "Geared.K" = 1.5 }'


@pytest.fixture(scope="module")
def geared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("geared")
    return by_pythonfmu("Geared", GEARED, folder)


def log(file: Path, gain: float, first: float = 4.0) -> Path:
    """A log of the lag of `gain`, which begins at a place of its own."""
    rng = np.random.default_rng(7)
    u = np.repeat(rng.uniform(-1.0, 1.0, N // 45), 45)
    u[:45] = first / gain
    y = np.full(N, first)
    for k in range(1, N):
        y[k] = y[k - 1] + (1.0 - np.exp(-H / 0.4)) * (gain * u[k - 1] - y[k - 1])
    table = np.column_stack([H * np.arange(N), u, y + 0.005 * rng.standard_normal(N)])
    np.savetxt(file, table, "%.9g", delimiter=",", header="time,u,y", comments="")
    return file


def compared(command, model: Path, path: Path, mapping: Path) -> float:
    code, out, err = command("compare", path, "--model", model, "--mapping", mapping, "--json")
    assert code == 0, err
    return json.loads(out)["signals"]["Geared.y"]["rmse"]


def simulated(command, model: Path, path: Path, mapping: Path, to: Path) -> float:
    words = ("--input", path, "--mapping", mapping, "--step-size", f"{H} s", "--out", to)
    code, _, err = command("simulate", model, *words)
    assert code == 0, err
    header, *rows = to.read_text().splitlines()
    place = next(k for k, name in enumerate(header.split(",")) if name.partition(" ")[0].endswith("y"))
    ran = np.array([float(row.split(",")[place]) for row in rows])
    measured = np.loadtxt(path, delimiter=",", skiprows=1)[: ran.size, 2]
    return float(np.sqrt(np.mean((ran - measured) ** 2)))


def test_all_commands_take_the_same_of_a_mapping_and_the_extended_model_holds_it(
    command, geared: Path, tmp_path: Path
) -> None:
    """The mapping's K of 1.5 is 1.8 in the log: what is found stands before what the mapping says."""
    path, mapping, out = log(tmp_path / "log.csv", 3.0 * 2.0 * 1.8), tmp_path / "m.toml", tmp_path / "o"
    mapping.write_text(MAPPING.replace("{CONSTANT}", STATED))
    words = (path, "--model", geared, "--mapping", mapping, "--out", out, "--json")
    code, told, err = command("diagnose", *words)
    assert code == 0, err
    found = json.loads(told)
    before = found["signals"]["Geared.y"]["rmse"]
    assert not any(w.startswith("assumed: ") for w in found["warnings"])
    assert compared(command, geared, path, mapping) == pytest.approx(before, rel=0.02)
    assert simulated(command, geared, path, mapping, tmp_path / "run.csv") == pytest.approx(before, rel=0.02)
    extended = Path(found["extended"]["ssp"])
    assert compared(command, extended, path, mapping) == pytest.approx(0.005, rel=0.2)
    assert simulated(command, extended, path, mapping, tmp_path / "ext.csv") == pytest.approx(0.005, rel=0.2)
    with read_system(extended) as system:
        starts = system.components["Geared"].starts
    assert (starts["gear"], starts["on"], starts["teeth"]) == (3, True, 2)
    assert all(type(starts[n]) is kind for n, kind in (("gear", int), ("on", bool), ("teeth", int)))


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ('{ "Geared.gear" = 2.5 }', "constant 'Geared.gear' = 2.5: Geared.gear takes a whole number"),
        ('{ "Geared.on" = 2 }', "constant 'Geared.on' = 2: Geared.on takes true or false (1 or 0)"),
        (
            '{ "Geared.geer" = 2 }',
            "the system has no connector 'Geared.geer', nor a parameter (closest: 'Geared.gear'",
        ),
        ('{ "Geared.y" = 2 }', "constant 'Geared.y': it is no input"),
        ('{ "Geared.u" = 2 }', "constant 'Geared.u': it is measured: leave it out"),
    ],
)
def test_a_constant_that_cannot_be_is_told_alike(
    command, geared: Path, tmp_path: Path, stated: str, said: str
) -> None:
    path, mapping = log(tmp_path / "log.csv", 6.0), tmp_path / "m.toml"
    mapping.write_text(MAPPING.replace("{CONSTANT}", stated))
    for words in (
        ("diagnose", path, "--model", geared, "--mapping", mapping, "--out", tmp_path / "o"),
        ("compare", path, "--model", geared, "--mapping", mapping),
        ("simulate", geared, "--input", path, "--mapping", mapping),
    ):
        code, _, err = command(*words)
        assert (code, said in " ".join(err.split())) == (3, True), err
