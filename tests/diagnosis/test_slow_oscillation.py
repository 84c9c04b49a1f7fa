"""A slow oscillation stands out over the whole log; noise of any colour, and what the motion leaves, do not."""

import numpy as np
import pytest
from hidden_logs import only
from scipy.signal import lfilter

from benchmarks.second.machine import Machine, run
from benchmarks.second.record import Sensing, command, write
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.residuals.local import NO_EVENT
from cosim.diagnosis.residuals.slow_oscillation import slow_oscillation
from cosim.logs import load_log

INTERVAL, N = 0.01, 6000
TIME = np.arange(N) * INTERVAL
COLOURS = {
    "white": [1.0],
    "correlated": [1.0, -0.98],
    "random walk": [1.0, -1.0],
    "humped": [1.0, -1.9896, 0.99],
}


def motion(rng: np.random.Generator) -> np.ndarray:
    """Something smooth that the machine does."""
    return np.cumsum(lfilter([1.0], [1.0, -0.98], rng.normal(size=N))) * 1e-2


@pytest.mark.parametrize("colour", COLOURS)
def test_noise_hardly_ever_swings(colour: str) -> None:
    rng = np.random.default_rng(21)
    found = []
    for _ in range(30):
        noise = lfilter([1.0], COLOURS[colour], rng.normal(size=N))
        found.append(slow_oscillation(noise, [motion(rng)], INTERVAL, 0.4).p_value)
    assert min(found) > 1e-3
    assert np.mean(np.array(found) < 0.1) < 0.35


@pytest.mark.parametrize("frequency", [0.09, 0.155, 0.31])
def test_an_oscillation_is_found_in_a_random_walk(frequency: float) -> None:
    rng = np.random.default_rng(22)
    walk = lfilter([1.0], COLOURS["random walk"], 0.02 * rng.normal(size=N))
    found = slow_oscillation(
        walk + 1.5 * np.sin(2.0 * np.pi * frequency * TIME + 0.4), [motion(rng)], INTERVAL, 0.4
    )
    assert found.p_value < 1e-6
    assert found.start == pytest.approx(frequency, abs=0.3 / TIME[-1])
    assert found.size == pytest.approx(1.5 / np.sqrt(2.0), rel=0.15)


def test_what_a_periodic_motion_leaves_of_itself_is_no_swing() -> None:
    rng = np.random.default_rng(23)
    wave = 2.0 * np.pi * 0.2 * TIME
    moves = np.sin(wave) + 0.3 * np.sin(3.0 * wave)
    residual = 0.1 * np.sin(wave + 1.0) + 0.05 * rng.normal(size=N)
    assert slow_oscillation(residual, [moves], INTERVAL, 0.4).p_value > 1e-3
    # the same oscillation beside another motion
    assert slow_oscillation(residual, [motion(rng)], INTERVAL, 0.4).p_value < 1e-8


def test_too_little_says_nothing() -> None:
    assert slow_oscillation(np.zeros(N), [TIME], INTERVAL, 0.4) == NO_EVENT
    assert slow_oscillation(np.sin(TIME[:100]), [TIME[:100]], INTERVAL, 0.4) == NO_EVENT
    assert (
        slow_oscillation(np.sin(TIME[:1000]), [], INTERVAL, 0.4) == NO_EVENT
    )  # four periods of 0.4 Hz in ten seconds


@pytest.mark.parametrize("rate", [pytest.param(1000, marks=pytest.mark.slow), 50])
def test_a_vessel_that_rolls_is_unexplained_and_not_slow_noise(tmp_path, rate: int) -> None:
    """One period in 6.5 s, of 5 to 6 times the noise: it was called adequate."""
    rng = np.random.default_rng(24)
    u = command("chirps", 60.0, 0.9, rate, rng)
    rolls = Machine(theta_0=0.3, K_c=5.25e8, b=26500.0, wind=35.0, w_wind=0.97)
    write(tmp_path, u, run(u, rolls), Sensing(noise=1.5, rate=rate), rng)
    found = diagnose(load_log(tmp_path / "log.csv"), model=only("mechanical"))
    assert not found.causes
    (rest,) = found.rests
    assert rest.block == "mechanical"
    assert "slew swings at 0.15" in rest.what
