"""Noise of a measured pressure that drives the mechanics, where the hydraulics are not understood, makes no cause there."""

import numpy as np
import pytest

from benchmarks.second.machine import Machine, run
from benchmarks.second.record import Sensing, command, write
from cosim.diagnosis.fitting.noise import CORRELATION_TIMES, Whitener, centred, learned, plain
from cosim.diagnosis.fitting.propagated import drawn, walk
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.logs import load_log


def rule_of(white: float, tau: float, size: float, bins: int = 10, window: int = 300) -> Whitener:
    """White noise and one kind of correlated noise, standard deviations of a bin's mean."""
    kinds = [size**2 if t == tau else 0.0 for t in CORRELATION_TIMES]
    return Whitener(bins, window, True, (white**2, *kinds))


@pytest.mark.parametrize(
    ("white", "tau", "size"), [(1.0, 1.0, 0.0), (0.5, 6.0, 2.0), (0.0, 2.5, 1.0), (0.3, 40.0, 1.0)]
)
def test_drawn_noise_is_that_of_the_rule(white: float, tau: float, size: float) -> None:
    rule = rule_of(white, tau, size)
    noise = drawn(rule, 600_000, np.random.default_rng(3))
    assert np.var(rule.windows(noise)) == pytest.approx(white**2 + size**2, rel=0.1)
    found = learned(plain(10, 300, True), noise, [])
    assert found.rms == pytest.approx(rule.rms, rel=0.1)


def test_noise_that_may_be_an_error_of_the_model_is_not_drawn() -> None:
    assert not drawn(rule_of(0.0, 400.0, 1.0), 1000, np.random.default_rng(4)).any()


def test_the_walk_is_that_of_integrated_noise() -> None:
    rule = rule_of(0.2, 6.0, 1.0)
    noise = drawn(rule, 3_000_000, np.random.default_rng(5))
    rows = centred(rule, np.cumsum(noise))
    centre = np.eye(300) - 1.0 / 300
    expected = centre @ walk(rule, 300) @ centre
    assert np.trace(expected) / 300 == pytest.approx(1.0)
    seen = rows.T @ rows / len(rows) / np.mean(rows**2)
    assert seen == pytest.approx(expected, abs=0.15 * expected.max())


def test_what_is_known_beforehand_is_not_learned_again() -> None:
    rng = np.random.default_rng(6)
    rule = rule_of(0.0, 6.0, 1.0)
    walks = np.cumsum(drawn(rule, 300_000, rng)) * 0.01
    own = rng.normal(size=300_000)
    size = float(np.mean(centred(rule, walks) ** 2))
    blank = Whitener(10, 300, True, (1.0,) + (0.0,) * len(CORRELATION_TIMES), 0, size * walk(rule, 300))
    found = learned(blank, walks + own, [])
    assert found.rms == pytest.approx(np.sqrt(0.1), rel=0.15)
    white = found(walks + own)
    assert np.mean(white[:, :40] ** 2) == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("flaw", [{"p_relief": 4.2e5}, {"line": 0.06}], ids=["relief valve", "hose"])
def test_hydraulics_that_are_not_understood_leave_the_mechanics_adequate(
    tmp_path, flaw: dict[str, float]
) -> None:
    """Correlated noise of the pressure: the angle's random walk was called a torque that the library lacks."""
    rng = np.random.default_rng(31)
    u = command("jog", 60.0, 0.8, 500, rng)
    sensing = Sensing(noise=1.7, colour=0.07, rate=500)
    write(tmp_path, u, run(u, Machine(theta_0=0.2, K_c=5.3e8, b=26500.0, **flaw)), sensing, rng)
    found = diagnose(load_log(tmp_path / "log.csv"))
    assert not found.causes
    assert {rest.block for rest in found.rests} == {"continuity"}
