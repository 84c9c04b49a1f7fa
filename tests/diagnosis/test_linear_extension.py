"""Where linear dynamics are missing that no block has, the extended model is the linear one, and it predicts."""

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import cont2discrete, lfilter

from cosim.diagnosis.extension.linear import drive_values, starts
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.record.record import Record
from cosim.inference.linear import LinearModel, Sections
from cosim.logs import Log, load_log
from cosim.master import Runner
from cosim.report.deliver import delivered
from cosim.report.screen import lines
from cosim.rig import as_log, make_log
from fmus import linear_drive
from fmus.build import composed_block
from fmus.compose import compose

NOISE = 2e-5  # rad
MODES = ((7.0, 0.08), (20.0, 0.06))  # rad/s, damping


def swinging(seed: int, seconds: float = 12.0) -> Log:
    """A synthetic log of a drive whose boom and base swing: two lightly damped modes behind an integrator."""
    log = as_log(make_log("steps", seconds, [], seed=seed))
    bottom = np.array([1.0, 0.0])
    for w, zeta in MODES:
        bottom = np.polymul(bottom, [1.0 / w**2, 2.0 * zeta / w, 1.0])
    b, a, _ = cont2discrete((0.04 * np.array([0.02, -0.1, 1.0]), bottom), log.step)
    u = log.signals["u"]
    noise = NOISE * np.random.default_rng(seed).standard_normal(u.size)
    return dataclasses.replace(log, signals={"u": u, "slew": 0.1 + lfilter(np.ravel(b), a, u) + noise})


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, Path]:
    folder = tmp_path_factory.mktemp("swinging")
    found = diagnose(swinging(1), held_out=swinging(2), calibrate=True, folder=folder / "drafts")
    return found, folder


def test_the_linear_model_predicts_the_held_out_log_to_its_noise(told: tuple[Diagnosis, Path]) -> None:
    found, _ = told
    assert found.verdict == "unexplained"
    assert not found.causes
    gain = found.gains["slew"]
    assert gain.before > 50 * NOISE
    assert gain.after < 1.2 * NOISE
    assert gain.ratio_ci95[1] < 0.1
    assert found.in_place is not None
    modes = sorted(found.in_place.sections.second)
    assert np.allclose(modes, MODES, rtol=0.02)
    assert np.sqrt(np.mean((found.held_after["slew"] - swinging(2).signals["slew"]) ** 2)) == pytest.approx(
        gain.after, rel=1e-6
    )


def test_it_is_said_and_its_package_runs(told: tuple[Diagnosis, Path]) -> None:
    found, folder = told
    log = swinging(1)
    answer = delivered(found, log, folder / "out")
    assert answer.extended is not None
    assert "a mode at 7 rad/s with damping 0.08" in str(answer.extended.in_place)
    told_lines = lines(answer, folder / "out")
    assert any("a linear model stands in the place of the blocks" in line for line in told_lines)
    assert told_lines[-1] == f"Next: cosim simulate {answer.extended.ssp} runs the linear model"
    with Runner(Path(answer.extended.ssp)) as runner:
        run = runner.run(
            float(log.time[-1]), log.step, inputs={"u": (log.time, log.signals["u"])}, record=["slew"]
        )
    assert np.sqrt(np.mean((run.signals["slew"] - log.signals["slew"]) ** 2)) < 1.2 * NOISE


def springy(folder: Path, seed: int) -> Path:
    """A synthetic log of a motor behind two springy couplings that is measured by its speed, and that moves as it begins."""
    rng, h = np.random.default_rng(seed), 0.01
    u = np.repeat(rng.uniform(0.2, 1.0, 32), 125)
    bottom = np.array([0.4, 1.0])
    for w, zeta in MODES:
        bottom = np.polymul(bottom, [1.0 / w**2, 2.0 * zeta / w, 1.0])
    b, a, _ = cont2discrete(([0.02, -0.1, 90.0], bottom), h)
    speed = lfilter(np.ravel(b), a, u)[300:] + 0.01 * rng.standard_normal(3700)
    file = folder / f"{seed}.csv"
    pd.DataFrame({"t": h * np.arange(3700), "u": u[300:], "speed": speed}).to_csv(file, index=False)
    return file


@pytest.mark.slow
def test_a_speed_has_a_linear_model_too(tmp_path: Path) -> None:
    mapping = tmp_path / "motor.toml"
    mapping.write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n[signals.u]\ncolumn = "u"\nunit = "1"\n'
        '[signals.speed]\ncolumn = "speed"\nunit = "rad/s"\n[machine]\ndrive = "electric"\n'
        'chain = ["dead_zone", "dcv", "continuity", "mechanical"]\ninput = "u"\noutput = "speed"\n'
    )
    logs = [load_log(springy(tmp_path, seed), mapping) for seed in (1, 2)]
    machine = machine_of(None, logs[:1], mapping)
    found = diagnose(logs[0], model=machine, held_out=logs[1], folder=tmp_path / "drafts")
    assert not found.causes
    assert found.in_place is not None
    assert np.allclose(sorted(found.in_place.sections.second), MODES, rtol=0.03)
    assert found.gains["speed"].before > 0.1
    assert found.gains["speed"].after < 0.03  # noise, and a start told by the first part of the log
    answer = delivered(found, logs[0], tmp_path / "out")
    assert answer.extended is not None
    with Runner(Path(answer.extended.ssp)) as runner:
        run = runner.run(36.99, 0.01, inputs={"u": (logs[0].time, logs[0].signals["u"])}, record=["speed"])
    left = run.signals["speed"] - logs[0].signals["speed"]
    assert np.sqrt(np.mean(left**2)) < 0.03


@pytest.mark.slow
def test_without_another_log_windows_judge_that_had_no_share_in_it(tmp_path: Path) -> None:
    found = diagnose(swinging(3, 40.0), calibrate=True, folder=tmp_path)
    assert not found.causes
    assert found.in_place is not None
    assert found.gains["slew"].before > 30 * NOISE
    assert found.gains["slew"].after < 1.2 * NOISE
    assert found.after["slew"].size == found.record.time.size


@pytest.mark.parametrize(
    "sections",
    [
        Sections((4.4,)),
        Sections((1e-4, 4.4), (), 0.037),
        Sections((0.7, 4.4, 9.0), ((6.0, 0.2),)),
        Sections((), ((3.0, 0.1), (8.0, 2.0), (20.0, 0.05)), 0.02),
    ],
)
def test_the_block_is_the_model(sections: Sections) -> None:
    """At any step that the model is simulated with, from rest."""
    h, rng = 0.01, np.random.default_rng(3)
    u = np.repeat(rng.uniform(-1.0, 1.0, 20), 25)
    count = sections.order
    driven, frees = rng.standard_normal(count), np.zeros(count)
    empty = np.zeros(0)
    model = LinearModel(sections, np.concatenate([driven, frees, [0.3]]), h, 5.0, empty, empty)
    module = compose(linear_drive.BLOCK).module
    starts = {n: v.start for n, v in linear_drive.BLOCK.parameters.items()}
    p = module.Parameters(**starts | drive_values(model) | {"settled": 0.0, "offset": 0.3})
    x = module.start(module.Input(0.0), p)
    m, c = module.begin(x, module.Input(0.0), p, [np.zeros(linear_drive.RING)]), module.coefficients(p, h)
    found = []
    for command in u:
        x, m = module.advance(x, m, module.Input(command), p, c)
        found.append(module.output(x, module.Input(command), m, p).theta)
    # a sample of the model is what the command before it has made
    expected = model.predicted(u, h)[1:]
    assert np.allclose(found[:-1], expected, atol=1e-9 * np.ptp(expected))


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize(
    "sections",
    [
        Sections((0.02, 4.4)),
        Sections((4.4, 0.02), ((6.0, 0.2),), 0.015),
        Sections((4.4,), ((6.0, 0.2), (0.3, 8.0))),
        Sections((1.5,), ((2.0, 0.1),)),
    ],
)
def test_it_starts_where_the_log_begins(sections: Sections, moving: bool) -> None:
    """In motion or at rest; a lag of 50 s in a log of 5 s counts as an integrator."""
    h, rng = 0.01, np.random.default_rng(4)
    u = np.concatenate([np.full(50, 0.2), np.repeat(rng.uniform(-1.0, 1.0, 18), 25)])
    count = sections.order
    gains = np.concatenate([rng.uniform(0.5, 1.0, count), np.zeros(count), [0.3]])
    model = LinearModel(sections, gains, h, 5.0, np.zeros(0), np.zeros(0))
    # as the model itself begins in such a state: the first twentieth of the log tells it
    forced, free = model.responses(u, h, not moving)
    states = rng.uniform(-1.0, 1.0, count) if moving else np.zeros(count)
    states[model.place_of_slowest] = 1.7 if moving or model.integrates else 0.0
    y = 0.3 + forced + states @ free
    if not moving:
        y[:50] = y[50]  # a lag of 50 s creeps
    record = Record(h, {"u": u, "slew": y})
    begin = model.beginning(u, y, h)
    assert begin.settled is not moving
    values = drive_values(model, 2.0)
    (start,) = starts(model, record, "u", "slew", 2.0)
    module = compose(linear_drive.BLOCK).module
    p = module.Parameters(**{n: v.start for n, v in linear_drive.BLOCK.parameters.items()} | values | start)
    x = module.start(module.Input(u[0]), p)
    m, c = module.begin(x, module.Input(u[0]), p, [np.zeros(linear_drive.RING)]), module.coefficients(p, h)
    found = [module.output(x, module.Input(u[0]), m, p).theta]
    for command in u[:-1]:
        x, m = module.advance(x, m, module.Input(command), p, c)
        found.append(module.output(x, module.Input(command), m, p).theta)
    assert np.allclose(found, 2.0 * model.simulate(u, y, h), atol=1e-9)
    if (
        not moving
    ):  # in how far a lag of 50 s, taken for an integrator, creeps back a log of 5 s does not tell
        assert np.allclose(found, 2.0 * y, atol=2.0 * 1.7 * 0.02 if model.integrates else 1e-9)


@pytest.mark.parametrize("block", ["linear_drive", "linear_speed"])
def test_the_block_takes_whatever_drives_a_machine(block: str) -> None:
    """A force of 150 N on a test stand is no command of 1.5 times full: it was refused, and the extended model with it."""
    command = composed_block(block).inputs["command"]
    driving = composed_block("mechanical").inputs["p_load"]
    assert (command.low, command.high) == (driving.low, driving.high)


def test_its_noise_is_no_more_than_the_linear_model_leaves(told: tuple[Diagnosis, Path]) -> None:
    """A drive that never rests has no quiet place, and what the blocks leave of it swings: both passed for noise."""
    found, _ = told
    assert 0.8 * NOISE < found.noise["slew"] < 1.2 * NOISE
