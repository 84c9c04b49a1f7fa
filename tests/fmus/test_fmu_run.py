"""Running FMUs: the same numbers as the equations, reset, many instances, jitter, saved states."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmu_bench import run
from fmu_raw import DISCARD, OK, STIMULUS, Instance

from fmus import registry
from fmus.build import build_fmu, composed_block

HERE = Path(__file__).resolve().parent
H = 1e-3
FEW = ["stimulus", "dcv", "mechanical"]


def inputs_of(name: str, n: int, seed: int = 0) -> np.ndarray:
    """n rows of lively inputs of typical size."""
    variables = [v for v in registry.block(name).inputs.values() if v.kind != "time"]
    size = np.array([2.0 * v.nominal for v in variables])
    t = np.arange(n)[:, None]
    return size * np.sin(0.05 * t + np.arange(len(size)) + seed)


def effects_on(name: str) -> dict[str, float]:
    """Values that switch on every effect with a memory of its own, so that a state has something to lose."""
    composed = composed_block(name)
    values = {}
    for effect in composed.effects:
        if effect.memory:
            values |= {n: f.starts[0] for n, f in effect.free.items() if n in composed.parameters}
            assert effect.key in values
    return values


def test_bit_for_bit_what_the_equations_compute(unpacked, name) -> None:
    composed, values = composed_block(name), effects_on(name)
    rows = inputs_of(name, 300)
    slave = Instance(unpacked[name]).initialise(**values)
    found = slave.play(rows, H)
    slave.close()
    buffers = None
    if name == "stimulus":
        table = [line.split(",") for line in STIMULUS.decode().splitlines()[1:]]
        buffers = [[float(row[i]) for row in table] for i in (0, 1)]
    if composed.takes_time:
        rows = np.column_stack([np.reshape(rows, (300, -1)), H * np.arange(300) + H])
    zero = [v.start for v in registry.block(name).inputs.values()]
    expected = run(composed, H, zero, values, buffers).play(rows)
    assert np.array_equal(found, expected)


def test_simulate_fmu_gives_every_row(fmu_files, name) -> None:
    """Without an output interval fmpy doubles it until a thousand rows are left (PITFALLS)."""
    result = simulate_fmu(str(fmu_files[name]), stop_time=2.0, step_size=H, output_interval=H)
    assert len(result) == 2001
    assert np.all(np.isfinite(result.view(float).reshape(len(result), -1)))


def test_reset_restores_everything(unpacked, name) -> None:
    rows = inputs_of(name, 60)
    slave = Instance(unpacked[name]).initialise(**effects_on(name))
    first = slave.play(rows)
    slave.fmu.reset()
    assert slave.initialise(**effects_on(name)).play(rows) == first
    slave.fmu.reset()
    starts = slave.initialise().play(rows)
    fresh = Instance(unpacked[name]).initialise()
    assert fresh.play(rows) == starts, "parameters set before a reset are forgotten"
    slave.close()
    fresh.close()


def test_instances_do_not_know_each_other(unpacked, name) -> None:
    rows, other_rows = inputs_of(name, 80), inputs_of(name, 80, seed=1)
    alone = Instance(unpacked[name]).initialise(**effects_on(name))
    expected = alone.play(rows)
    one = Instance(unpacked[name], "one").initialise(**effects_on(name))
    other = Instance(unpacked[name], "other").initialise()
    found = []
    for k in range(80):
        found += one.play(rows[k : k + 1], first=k)
        other.play(other_rows[k : k + 1], first=k)
        if k == 40:
            alone.close()  # ending one does not disturb the others
    assert found == expected
    one.close()
    other.close()


def test_an_initialisation_mode_reads_what_was_set(unpacked) -> None:
    """Outputs follow start values at once: the angle is theta_0 before the first step."""
    slave = Instance(unpacked["mechanical"])
    slave.fmu.setupExperiment(startTime=0.0)
    slave.fmu.enterInitializationMode()
    slave.set(theta_0=0.25)
    assert slave.get("theta", "omega") == [0.25, 0.0]
    slave.fmu.exitInitializationMode()
    assert slave.get("theta") == [0.25]
    slave.close()


def test_300_instances_in_one_process() -> None:
    """pythonfmu's loader miscounts references of the module at each instantiation (see slave.py); it must not add up."""
    done = subprocess.run(
        [sys.executable, str(HERE / "fmu_scenarios.py"), "many", "300"], capture_output=True, text=True, check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["300", "0.0"]


# Communication steps


def test_jitter_of_a_masters_clock_changes_nothing(unpacked, name) -> None:
    """Steps that differ by rounding (libcosim) are the same step, bit for bit."""
    rows = inputs_of(name, 200)
    steady = Instance(unpacked[name]).initialise().play(rows)
    slave = Instance(unpacked[name]).initialise()
    time, found = 0.0, []
    for k, row in enumerate(rows):
        if slave.inputs:
            slave.fmu.setReal([slave.vr[n] for n in slave.inputs], list(row))
        after = (k + 1) * H
        assert slave.step(time, after - time) == OK
        time = after
        found.append(slave.get(*slave.outputs))
    assert found == steady
    slave.close()


@pytest.mark.parametrize(
    "block",
    # the last three are sampled: what they do depends on how often they are asked
    [
        n
        for n in registry.BLOCKS
        if n not in ("stimulus", "continuity_physical", "observer_extended", "reference", "controller")
    ],
)
def test_steps_of_any_length_in_turn(unpacked, block) -> None:
    """A constant input: the state after 0.6 s does not depend on how the time was cut."""
    row = inputs_of(block, 20)[-1]
    ends = []
    for steps in ([0.1] * 6, [0.25, 0.05, 0.1, 0.2], [1e-4] * 1000 + [0.5]):
        slave = Instance(unpacked[block])
        slave.fmu.setupExperiment(startTime=0.0)
        slave.fmu.setReal([slave.vr[n] for n in slave.inputs], list(row))
        slave.fmu.enterInitializationMode()
        slave.fmu.exitInitializationMode()
        time = 0.0
        for h in steps:
            assert slave.step(time, h) == OK
            time += h
        ends.append(slave.get(*slave.outputs))
        slave.close()
    size = [v.nominal for v in registry.block(block).outputs.values()]
    # every block is exact under a constant input; a thousand steps round a thousand times
    assert np.abs((np.array(ends) - ends[0]) / size).max() < 1e-9


# States


def test_a_state_restored_continues_bit_for_bit(unpacked, name) -> None:
    """Saved in the middle, continued twice: also by another instance, and from serialised bytes."""
    rows = inputs_of(name, 120)
    slave = Instance(unpacked[name]).initialise(**effects_on(name))
    slave.play(rows[:50])
    state, data = slave.fmu.getFMUstate(), slave.state_bytes()
    expected = slave.play(rows[50:], first=50)
    slave.fmu.setFMUstate(state)
    assert slave.play(rows[50:], first=50) == expected
    slave.restore_bytes(data)
    assert slave.play(rows[50:], first=50) == expected
    slave.fmu.setFMUstate(state)
    assert slave.play(rows[50:], first=50) == expected, "a state can be restored more than once"
    slave.fmu.freeFMUstate(state)
    other = Instance(unpacked[name], "other").initialise()  # its parameters come with the state
    other.restore_bytes(data)
    assert other.play(rows[50:], first=50) == expected
    fresh = Instance(unpacked[name], "fresh")  # not even initialised
    fresh.restore_bytes(data)
    assert fresh.play(rows[50:], first=50) == expected
    assert not slave.messages + other.messages + fresh.messages
    for instance in (slave, other, fresh):
        instance.close()


def test_a_state_travels_to_another_process(unpacked, tmp_path) -> None:
    rows = inputs_of("mechanical", 100)
    slave = Instance(unpacked["mechanical"]).initialise(tau_c=50.0)
    slave.play(rows[:50])
    (tmp_path / "state").write_bytes(slave.state_bytes())
    np.save(tmp_path / "rows.npy", rows[50:])
    expected = slave.play(rows[50:], first=50)
    command = [
        sys.executable,
        str(HERE / "fmu_scenarios.py"),
        "continue",
        str(unpacked["mechanical"]),
        str(tmp_path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert np.array_equal(np.load(tmp_path / "found.npy"), expected), done.stderr
    slave.close()


def test_a_state_heals_a_failed_step(unpacked) -> None:
    """A master may go back to the last good state after a refused value."""
    slave = Instance(unpacked["dcv"]).initialise()
    slave.play([[0.5]] * 10)
    data, good = slave.state_bytes(), slave.get("spool")
    slave.fmu.setReal([slave.vr["demand"]], [math.nan])
    assert slave.step(0.01) == DISCARD
    assert "nan" in slave.messages[-1]
    slave.restore_bytes(data)
    assert slave.get("spool") == good
    assert slave.step(0.01) == OK
    slave.close()


def test_a_failed_state_stays_failed(unpacked) -> None:
    """Saved after a refusal, a state does not become good by being restored."""
    slave = Instance(unpacked["dcv"]).initialise()
    slave.fmu.setReal([slave.vr["demand"]], [math.inf])
    data = slave.state_bytes()
    slave.fmu.reset()
    slave.initialise()
    assert slave.step(0.0) == OK
    slave.restore_bytes(data)
    assert slave.step(0.0) == DISCARD
    slave.close()


# Two models in one process


def test_baseline_and_other_start_values_side_by_side(unpacked, tmp_path) -> None:
    from fmpy import extract

    changed = build_fmu(
        composed_block("mechanical"), tmp_path / "mechanical.fmu", {"J": 900.0, "tau_c": 80.0}
    )
    folder = Path(extract(str(changed), str(tmp_path / "unpacked")))
    rows = inputs_of("mechanical", 100) * 5
    base = Instance(unpacked["mechanical"]).initialise()
    other = Instance(folder).initialise()
    again = Instance(unpacked["mechanical"]).initialise(J=900.0, tau_c=80.0)
    nominal, found, expected = base.play(rows), other.play(rows), again.play(rows)
    assert found == expected
    assert found != nominal


def test_baseline_and_extended_equations_side_by_side(unpacked, tmp_path) -> None:
    """Modules are shared by name in one process: an FMU with other equations must not run the first one's (PITFALLS)."""
    from fmpy import extract

    from fmus.compose import compose

    block = registry.block("mechanical")
    plain = build_fmu(compose(block), tmp_path / "plain" / "mechanical.fmu")
    tilted = compose(block, [registry.effects()["mechanical.gravity_load"]])
    with_load = build_fmu(tilted, tmp_path / "tilted" / "mechanical.fmu", {"tau_g": 500.0, "theta_g": -0.5})
    folders = [Path(extract(str(p), str(p.parent / "unpacked"))) for p in (plain, with_load)]
    rows = inputs_of("mechanical", 100)
    one, two = (Instance(f).initialise() for f in folders)
    found = [], []
    for k in range(100):
        for slave, rows_found in zip((one, two), found, strict=True):
            rows_found += slave.play(rows[k : k + 1], first=k)
    assert np.array_equal(found[0], run(compose(block), H, [0.0]).play(rows))
    assert np.array_equal(found[1], run(tilted, H, [0.0], {"tau_g": 500.0, "theta_g": -0.5}).play(rows))
    assert found[0] != found[1]


def test_two_stimuli_play_their_own_tables(unpacked, tmp_path) -> None:
    """Their scripts are the same text and share a module; the tables lie in each FMU's own resources."""
    from fmpy import extract

    table = b"time,u\n0,0.125\n"
    other = build_fmu(
        composed_block("stimulus"), tmp_path / "stimulus.fmu", resources={"stimulus.csv": table}
    )
    folder = Path(extract(str(other), str(tmp_path / "unpacked")))
    one, two = Instance(unpacked["stimulus"]).initialise(), Instance(folder).initialise()
    assert one.play([[]] * 200)[-1] == [1.0]
    assert two.play([[]] * 200)[-1] == [0.125]


@pytest.mark.parametrize("start_time", [0.2, 0.5])
def test_a_stimulus_can_start_later(unpacked, start_time) -> None:
    slave = Instance(unpacked["stimulus"]).initialise(start_time)
    assert slave.get("u") == [1.0 if start_time < 0.35 else -0.5]
    slave.close()


def test_runs_with_the_standard_library_alone(unpacked) -> None:
    """One step of every FMU's script in an isolated interpreter whose imports of anything else are refused."""
    command = [
        sys.executable,
        "-I",
        "-S",
        str(HERE / "fmu_isolated.py"),
        *(str(unpacked[n]) for n in registry.BLOCKS),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [*registry.BLOCKS]
