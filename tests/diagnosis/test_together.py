"""What all blocks together say of a cause that its own block cannot tell from another."""

import pytest
from hidden_logs import off

import cosim.diagnosis.extension.estimate as extension
from cosim.diagnosis.pipeline.diagnose import diagnose
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


@pytest.mark.slow
def test_the_slew_tells_a_smaller_flow_gain_from_a_leak(log) -> None:
    (cause,) = diagnose(log).causes
    assert cause.effect.name == FLOW_GAIN
    assert cause.indistinguishable == []
    behind = {e.name: far for e, far in cause.rivals}
    assert behind[LEAKAGE] > 6.0


def test_without_the_blocks_behind_the_two_are_declared_alike(log, monkeypatch) -> None:
    monkeypatch.setattr(extension, "weighed", lambda found, groups, fitted, near: fitted((), near))
    (cause,) = diagnose(log).causes
    assert LEAKAGE in (cause.effect.name, *cause.indistinguishable)


@pytest.mark.slow
def test_sets_that_span_the_same_two_numbers_are_declared_alike() -> None:
    """Of flow gain, leakage and compressibility any two do what any other two do."""
    hidden = [f"{FLOW_GAIN}:K_c=7e8", f"{LEAKAGE}:c_l=0.65"]
    found = diagnose(as_log(make_log("small_steps", 40.0, hidden, seed=12, settings=settings(12))))
    assert len(found.causes) == 2
    assert not found.rests
    reported = {n for c in found.causes for n in (c.effect.name, *c.indistinguishable)}
    assert {FLOW_GAIN, LEAKAGE} <= reported <= {FLOW_GAIN, LEAKAGE, "continuity.compressibility"}


@pytest.mark.slow
def test_a_slew_read_in_steps_weighs_nothing() -> None:
    """Its likelihood over the whole log is jagged: a turbulent leak took the place of a smaller flow gain."""
    noise = Noise(scale=0.93, kind="ar1", correlation_time=0.038)
    hidden = [f"{FLOW_GAIN}:K_c=4.79386e8", "sensor.quantisation:quantum=0.00177075 rad"]
    own = {"dcv.K": 2.404632e-3, "dcv.w0": 25.2826, "dcv.zeta": 0.544845, "continuity.T": 0.111033}
    own |= {"mechanical.J": 773.485, "mechanical.b": 26942.275}
    run = make_log("small_steps", 60.0, hidden, seed=1028124213, noise=noise, settings=own, amplitude=0.60367)
    found = diagnose(as_log(run))
    cause = next(c for c in found.causes if c.group == "continuity")
    assert FLOW_GAIN in (cause.effect.name, *cause.indistinguishable)
    value, deviation = cause.parameters["K_c"]
    assert value == pytest.approx(4.79386e8, abs=2.5 * deviation)
