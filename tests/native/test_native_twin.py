"""Each native FMU against its Python twin: random parameters, inputs and step sizes, every effect on and off.

The composed equations in CPython stand for the Python FMU, which gives their numbers bit for bit
(tests/fmus/test_fmu_run.py); a whole package is compared FMU against FMU below.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fmu_bench import Run, run
from fmu_raw import ERROR, OK, STIMULUS, Instance
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.master import Runner
from cosim.native.package import write_native_ssp
from cosim.paths import ssp_folder
from cosim.ssp.stimulus import default_command, stimulus_csv
from cosim.ssp.write import write_ssp
from fmus import registry
from fmus.build import composed_block
from fmus.compose import Composed

EXACT = 1e-12  # of the range; the compiler keeps every operation, so that the numbers are the same but for libm's last bit
ROWS = [[float(cell) for cell in row.split(",")] for row in STIMULUS.decode().splitlines()[1:]]
TABLE = [list(column) for column in zip(*ROWS, strict=True)]


@pytest.fixture(scope="module")
def slaves(unpacked):
    """One instance of each block, to be reset."""
    found = {name: Instance(folder, name) for name, folder in unpacked.items()}
    yield found
    for slave in found.values():
        slave.close()


def lively(composed: Composed, seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs of typical size with rests and reversals, and step sizes that change now and then."""
    rng = np.random.default_rng(seed)
    size = np.array([2.0 * v.nominal for v in composed.inputs.values()])
    rows = np.repeat(rng.normal(0.0, 1.0, (count // 4 + 1, len(size))), 4, axis=0)[:count] * size
    rows[rng.random(len(rows)) < 0.1] = 0.0
    return rows, np.repeat(rng.choice([1e-3, 1e-3, 2.5e-3, 0.02], len(rows) // 10 + 1), 10)[: len(rows)]


def twin(composed: Composed, h: float, values: dict[str, float], time: float) -> Run:
    """The composed equations at their start."""
    first = [v.start for v in composed.inputs.values()] + ([time] if composed.takes_time else [])
    return run(composed, h, first, values, TABLE if composed.takes_time else None)


def compare(slave: Instance, composed: Composed, values: dict[str, float], seed: int, count: int) -> int:
    """Step both side by side; how many steps both made before both refused."""
    rows, steps = lively(composed, seed, count)
    slave.fmu.reset()
    slave.messages.clear()
    slave.fmu.setupExperiment(startTime=0.0)
    slave.set(**values)
    try:
        python = twin(composed, 1e-3, values, 0.0)
    except (ArithmeticError, ValueError):
        assert slave.status(slave.fmu.enterInitializationMode) == ERROR
        assert "initialisation failed" in slave.messages[0]
        return 0
    slave.fmu.enterInitializationMode()
    slave.fmu.exitInitializationMode()
    found, wanted, now = [], [], 0.0
    for row, h in zip(rows.tolist(), steps.tolist(), strict=True):
        if slave.inputs:
            slave.fmu.setReal([slave.vr[n] for n in slave.inputs], row)
        try:
            python.c = composed.module.coefficients(python.p, h)
            expected = python.step(*row, *((now + h,) if composed.takes_time else ()))
            good = all(-1e300 < v < 1e300 for v in expected)
        except (ArithmeticError, ValueError, IndexError):
            good = False
        status = slave.step(now, h)
        if not good:
            assert status == ERROR
            assert "the step at t =" in slave.messages[-1]
            break
        assert status == OK, slave.messages
        now += h
        found.append(slave.get(*slave.outputs))
        wanted.append(expected)
    if found:
        one, other = np.array(found), np.array(wanted)
        span = np.maximum(np.ptp(other, axis=0), np.abs(other).max(axis=0))
        assert np.all(np.abs(one - other) <= EXACT * span), (values, np.max(np.abs(one - other) / span))
    return len(found)


@pytest.mark.parametrize(
    "effect", [n for n, e in registry.effects().items() if e.component in registry.BLOCKS]
)
def test_each_effect_on_and_off(slaves, effect) -> None:
    known = registry.effects()[effect]
    composed = composed_block(known.component)
    on = {n: f.starts[0] for n, f in known.free.items() if n in composed.parameters}
    for values in (on, {}):
        assert compare(slaves[known.component], composed, values, 3, 120) == 120


def test_all_effects_of_a_block_together(slaves, name) -> None:
    composed = composed_block(name)
    on = {n: f.starts[-1] for e in composed.effects for n, f in e.free.items() if n in composed.parameters}
    assert compare(slaves[name], composed, on, 5, 150) == 150


@st.composite
def cases(draw: Callable[..., Any]) -> tuple[str, dict[str, float], int]:
    """A block, values of any of its parameters anywhere within their bounds or near their start, and a seed of inputs."""
    name = draw(st.sampled_from(registry.BLOCKS))
    parameters = composed_block(name).parameters
    chosen = draw(st.lists(st.sampled_from(sorted(parameters)), unique=True, max_size=8))
    values = {}
    for key in chosen:
        v = parameters[key]
        near = st.floats(-2.0, 2.0).map(
            lambda a, v=v: min(v.high, max(v.low, v.start + a * (v.start or v.nominal)))
        )
        value = draw(st.one_of(near, st.floats(v.low, v.high)))
        values[key] = float(round(value)) if v.kind == "integer" else value
    return name, values, draw(st.integers(0, 1000))


@settings(max_examples=120, deadline=None)
@given(case=cases())
def test_any_parameters_inputs_and_steps(slaves, case) -> None:
    """Both agree or both refuse, whatever the parameters."""
    name, values, seed = case
    compare(slaves[name], composed_block(name), values, seed, 30)


# Packages, FMU against FMU

CHANGED = {
    "compensator": {"form": 2.0, "m_r": 1.1, "b_l": -0.35},
    "dead_zone": {"b_r": 0.40, "b_l": -0.38, "play": 0.02},
    "dcv": {"K": 2.5e-3, "w0": 22.0, "x_0": 1e-4, "v_max": 0.02, "x_max": 1.1e-3, "tau_d": 0.0153},
    "mechanical": {"J": 900.0, "tau_c": 30.0, "tau_s": 20.0, "tau_g": 80.0, "tau_r": 15.0, "gap": 1e-4, "mu": 0.3},
    "sensor": {"gain": 1.02, "bias": 0.01, "drift": 1e-3, "quantum": 1e-5, "tau_l": 0.02, "p_drop": 0.2},
}  # fmt: skip


def test_a_package_gives_the_numbers_of_its_python_twin(tmp_path) -> None:
    """With every effect on, under our runner."""
    ssd, stimulus = ssp_folder() / "full_order.ssd", stimulus_csv(*default_command(17.0))
    results = []
    for write in (write_ssp, write_native_ssp):
        package = write(ssd, tmp_path / write.__name__ / "full_order.ssp", stimulus=stimulus, values=CHANGED)
        with Runner(package) as runner:
            results.append(runner.run(3.0, 1e-3, parameters={"stimulus.gain": 1.5}))
    python, native = results
    assert list(python.signals) == list(native.signals)
    for name, values in python.signals.items():
        span = np.ptp(values) or 1.0
        assert math.isfinite(span)
        assert np.max(np.abs(values - native.signals[name])) <= EXACT * span, name
    assert native.units == python.units
