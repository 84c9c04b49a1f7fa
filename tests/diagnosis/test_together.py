"""What all blocks together say of a cause that its own block cannot tell from another."""

import pytest
from hidden_logs import off

import cosim.diagnosis.extension as extension
from cosim.diagnosis.story import diagnose
from cosim.rig import Noise, make_log
from cosim.rig.write import as_log

FLOW_GAIN, LEAKAGE = "continuity.flow_gain", "continuity.leakage"


def settings(seed: int) -> dict[str, float]:
    """Nominal parameters off by 1 %, but for the flow gain that is hidden."""
    return off(seed, FLOW_GAIN)


@pytest.fixture(scope="module")
def log():
    """A smaller flow gain in slow noise of twice the usual size: by the pressure alone it might be a leak."""
    noise = Noise(scale=2.0, kind="ar1", correlation_time=0.05)
    hidden = [f"{FLOW_GAIN}:K_c=4.96e8"]
    run = make_log("sweep", 25.0, hidden, seed=7, noise=noise, settings=settings(31), amplitude=0.8)
    return as_log(run)


def test_the_slew_tells_a_smaller_flow_gain_from_a_leak(log) -> None:
    (cause,) = diagnose(log).causes
    assert cause.effect.name == FLOW_GAIN
    assert cause.alike == []
    behind = {e.name: far for e, far in cause.rivals}
    assert behind[LEAKAGE] > 6.0


def test_without_the_blocks_behind_the_two_are_declared_alike(log, monkeypatch) -> None:
    monkeypatch.setattr(extension, "weighed", lambda found, groups, fitted, near: fitted((), near))
    (cause,) = diagnose(log).causes
    assert LEAKAGE in (cause.effect.name, *cause.alike)


def test_sets_that_span_the_same_two_numbers_are_declared_alike() -> None:
    """Of flow gain, leakage and compressibility any two do what any other two do."""
    hidden = [f"{FLOW_GAIN}:K_c=7e8", f"{LEAKAGE}:c_l=0.65"]
    found = diagnose(as_log(make_log("small_steps", 40.0, hidden, seed=12, settings=settings(12))))
    assert len(found.causes) == 2
    assert not found.rests
    reported = {n for c in found.causes for n in (c.effect.name, *c.alike)}
    assert {FLOW_GAIN, LEAKAGE} <= reported <= {FLOW_GAIN, LEAKAGE, "continuity.compressibility"}
