"""One faulty parameter among thirty that are trusted is named, also where time is short: the likely ones are tried first."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from benchmarks.systems import parts
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.pipeline import diagnose_system
from cosim.anysystem.read import Column, Recording
from cosim.diagnosis.budget import Budget
from cosim.ssp.read import read_system
from cosim.system.runs import Runs

H, COUNT, SECTIONS = 0.01, 2000, 10
VALUES = {
    f"{name}{k}": round(value, 4)
    for k in range(SECTIONS)
    for name, value in (("g", 1.0 - 0.05 * k), ("w", 2.0 * 1.35**k), ("z", 0.04 + 0.01 * (k % 4)))
}


def build(folder: Path) -> None:
    """``many.fmu``."""
    parameters = {name: (k + 2, value) for k, (name, value) in enumerate(VALUES.items())}
    starts = "STARTS=" + ",".join(map(repr, VALUES.values()))
    binary = parts.library(Path(__file__).with_name("many.c"), folder, starts)
    parts.packed(folder, "many", parts.described("many", {"u": 1}, parameters), binary)


@pytest.fixture(scope="module")
def many(made_once) -> Path:
    """The FMU."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    return made_once("many_parameters", build) / "many.fmu"


def log(changed: dict[str, float], seed: int) -> Recording:
    """Steps and sines through the oscillators, each solved by itself, with 0.5 % noise."""
    rng = np.random.default_rng(seed)
    t = H * np.arange(COUNT)
    u = np.repeat(rng.uniform(-1.0, 1.0, COUNT // 150 + 1), 150)[:COUNT]
    u = u + sum(0.2 * np.sin(2.0 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.3, 1.1, 2.9))
    p = VALUES | changed
    y = np.zeros(COUNT)
    for k in range(SECTIONS):
        g, w, z = (p[f"{n}{k}"] for n in "gwz")
        y += lsim(([g * w**2], [1.0, 2.0 * z * w, w**2]), u, t)[1]
    y += 0.005 * np.std(y) * rng.standard_normal(COUNT)
    signals = {"many.u": u, "many.y": y}
    return Recording(Path("log.csv"), t, signals, {n: Column(n, n, "1", 1.0, 0.0) for n in signals})


def diagnosed(many: Path, recording: Recording, most: float):
    """The diagnosis within this many runs of the FMU; a run is the clock's second, so that no machine is too slow."""
    options = AnyOptions(trusted={f"many.{n}": None for n in VALUES})
    with read_system(many) as system, Runs(system, apart=False) as runs:
        budget = Budget(most, lambda: float(runs.count))
        return diagnose_system(system, [recording], runs, options, budget=budget)


@pytest.mark.parametrize(("name", "factor"), [("w6", 1.2), ("g8", 0.7), ("z1", 2.0)])
def test_the_faulty_one_of_thirty_parameters_is_named_in_a_short_time(
    many: Path, name: str, factor: float
) -> None:
    found = diagnosed(many, log({name: factor * VALUES[name]}, 1), 400.0)
    ((group, action),) = found.causes()
    assert (action.effect, str(action.port)) == ("parameter", f"many.{name}")
    value = found.findings[group].chosen.fit.values[f"parameter|many.{name}"]
    assert value == pytest.approx(factor * VALUES[name], rel=0.03)


def test_none_of_thirty_is_named_where_all_are_as_trusted(many: Path) -> None:
    found = diagnosed(many, log({}, 2), 400.0)
    assert (found.causes(), found.verdict) == ([], "adequate")
