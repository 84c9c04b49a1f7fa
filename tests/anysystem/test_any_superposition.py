"""What a linear unit gives is superposed, what is not linear is run, and nobody has to say which is which."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts
from cosim.ssp.read import read_system
from cosim.ssp.system import Port
from cosim.system.graph import Unit
from cosim.system.runs import Runs

COUNT = 600
TRIALS = 40


@pytest.fixture
def unit(tmp_path: Path) -> Callable[[str], Path]:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    return lambda kind: parts.native(kind, tmp_path)


def tried(fmu: Path, inputs: list[np.ndarray]) -> tuple[Runs, float]:
    """The runs of an FMU for some inputs, and the largest error of its output over that output's range."""
    name = fmu.stem
    one, ports = Unit((name,)), (Port(name, "u"), Port(name, "y"))
    worst = 0.0
    with (
        read_system(fmu) as system,
        Runs(system, apart=False) as runs,
        Runs(system, apart=False) as real,
        real.exact(),
    ):
        for u in inputs:
            found, true = (
                r.run(one, 0.0, systems.H, {ports[0]: u}, ports[1:], {})[ports[1]] for r in (runs, real)
            )
            worst = max(worst, float(np.abs(found - true).max() / np.ptp(true)))
        assert real.count == len(inputs)
        assert real.spared == 0
    return runs, worst


def variants(rng: np.random.Generator, size: float = 1.0) -> list[np.ndarray]:
    """A command with gains, offsets, delays and dead zones, as candidates have it."""
    u = size * systems.command(rng, COUNT)
    found = [u]
    for k in range(TRIALS):
        way = (
            u * rng.uniform(0.8, 1.1),
            u + size * rng.uniform(-0.1, 0.1),
            u[np.maximum(np.arange(COUNT) - k, 0)],
            np.sign(u) * np.maximum(np.abs(u) - 0.01 * size * k, 0.0),
        )
        found.append(way[k % 4])
    return found


@pytest.mark.parametrize("kind", ["lag", "second"])
def test_a_linear_unit_is_run_a_few_times_only(unit: Callable[[str], Path], kind: str) -> None:
    runs, worst = tried(unit(kind), variants(np.random.default_rng(1)))
    assert runs.spared > 0.6 * TRIALS
    assert runs.count + runs.spared == TRIALS + 1 + 2  # a pulse at each of two samples
    assert worst < 1e-9


@pytest.mark.parametrize("kind", ["saturating", "damped", "stiffening"])
def test_what_is_not_linear_is_run_every_time(unit: Callable[[str], Path], kind: str) -> None:
    runs, worst = tried(unit(kind), variants(np.random.default_rng(2)))
    assert runs.spared == 0
    assert worst == 0.0


def test_what_is_linear_up_to_a_limit_is_run_beyond_it(unit: Callable[[str], Path], tmp_path: Path) -> None:
    """A stop that the first inputs never meet: only a run can tell of it."""
    from test_any_faults import changed

    fmu = changed(
        tmp_path, "stop", "double h = step / 4;", "double h = step / 4; if (p->x[0] > 5) p->x[0] = 5;"
    )
    rng = np.random.default_rng(3)
    runs, worst = tried(fmu, [*variants(rng), *(5.0 + u for u in variants(rng))])
    assert runs.spared > 0.5 * TRIALS
    assert worst < 1e-9
