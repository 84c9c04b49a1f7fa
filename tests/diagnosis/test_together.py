"""What all blocks together say of a cause that its own block cannot tell from another."""

from dataclasses import FrozenInstanceError, replace

import pytest
from hidden_logs import off, only

from cosim.diagnosis.extension import estimate
from cosim.diagnosis.extension.together import against_rivals, in_best_form
from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.trials import charged, tried
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.residuals.cross_validation import held_out_gain
from cosim.diagnosis.verdict.verdict import cause_of
from cosim.rig import Noise, make_log
from cosim.rig.write import as_log
from fmus.contract import Effect

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
    # what a valve passes less under load is a smaller gain, too, where the load is about the same
    assert set(cause.indistinguishable) <= {"continuity.flow_pressure"}
    behind = {e.name: far for e, far in cause.rivals}
    assert behind[LEAKAGE] > 6.0


@pytest.fixture(scope="module")
def apart(log) -> Diagnosis:
    """What is found where the blocks behind have no say."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimate, "weighed", lambda found, groups, fitted, near, tolerance: fitted((), near))
        return diagnose(log, model=only("dcv", "continuity"))


def test_without_the_blocks_behind_the_two_are_declared_indistinguishable(apart: Diagnosis) -> None:
    (cause,) = apart.causes
    assert LEAKAGE in (cause.effect.name, *cause.indistinguishable)


def test_a_cause_that_takes_the_place_of_another_has_figures_of_its_own(apart: Diagnosis) -> None:
    """As if all blocks together preferred the other one by 20: its gain, its held-out gain and its rivals are its own."""
    before, finding = apart.causes[0], apart.findings["continuity"]
    rival = next(n for n in (FLOW_GAIN, LEAKAGE) if n != before.effect.name)
    trial = next(t for t in finding.rivals[before.effect.name] if t.names == (rival,))
    best = finding.chosen.fit
    found = replace(apart, causes=list(apart.causes), findings=dict(apart.findings), rests=list(apart.rests))

    def instead(effect: Effect, begin: dict[str, float]) -> Fit:
        ahead = 20.0 if effect.name == rival else -20.0
        own = next(t for t in finding.rivals[before.effect.name] if t.names == (effect.name,))
        price = charged(own.price - finding.chosen.price, own.fit)
        return replace(own.fit, log_likelihood=best.log_likelihood + ahead + price)

    against_rivals(found, 0, instead, best, 0.01)
    (after,) = found.causes
    chosen = found.findings["continuity"].chosen
    assert (after.effect.name, chosen.names) == (rival, (rival,))
    assert after.gain == trial.fit.log_likelihood - finding.null.fit.log_likelihood != before.gain
    assert after.held_out == held_out_gain(finding.task, trial.fit, finding.null.fit) != before.held_out
    assert after.parameters.keys() == trial.effects[0].free.keys()
    assert {e.name: far for e, far in after.rivals}[before.effect.name] == pytest.approx(20.0)
    assert before.effect.name not in after.indistinguishable
    # a value: what was found before stands as it was
    assert (apart.causes[0], finding.chosen.names) == (before, (before.effect.name,))
    with pytest.raises(FrozenInstanceError):
        finding.chosen = trial  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError):
        before.gain = 0.0  # type: ignore[misc]


def test_a_cause_in_another_form_of_its_law_has_the_figures_of_that_form(apart: Diagnosis) -> None:
    """As if all blocks together asked for a leak that turns turbulent."""
    finding = apart.findings["continuity"]
    trials = [finding.chosen, *finding.rivals[apart.causes[0].effect.name]]
    trial = next(t for t in trials if t.names == (LEAKAGE,))
    finding = replace(finding.accept(trial, apart.record), rivals={})
    cause = replace(cause_of(finding, trial.effects[0], 0.01), indistinguishable=[FLOW_GAIN])
    found = replace(apart, causes=[cause], findings={"continuity": finding}, rests=[])
    formed = cause.effect.formed("k_t")

    def instead(effect: Effect, begin: dict[str, float]) -> Fit:
        own = tried(finding.task, (effect,), 0.01, trial.fit).fit
        return replace(own, log_likelihood=trial.fit.log_likelihood + (30.0 if effect.is_formed else 0.0))

    best = in_best_form(found, 0, instead, trial.fit, 0.01)
    assert best.log_likelihood == trial.fit.log_likelihood + 30.0
    (after,) = found.causes
    chosen = found.findings["continuity"].chosen
    assert after.parameters.keys() == formed.free.keys() > cause.parameters.keys()
    assert after.effect.is_formed
    assert after.indistinguishable == [FLOW_GAIN]  # told of the effect, whatever its form
    assert after.gain == chosen.fit.log_likelihood - finding.null.fit.log_likelihood
    assert chosen.fit.values.keys() >= {"continuity.k_t"}


@pytest.mark.slow
def test_sets_that_span_the_same_two_numbers_are_declared_indistinguishable() -> None:
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
