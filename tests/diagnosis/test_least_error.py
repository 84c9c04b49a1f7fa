"""Where much is wrong and parameters are free, causes are first sought by the error itself."""

import dataclasses
import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.noise import broad, plain
from cosim.diagnosis.fitting.trials import Trial, candidates_of, copied, starting, tried, unused
from cosim.diagnosis.hypotheses import naming
from cosim.diagnosis.hypotheses.naming import least_error, nominal
from cosim.diagnosis.hypotheses.screening import promising
from cosim.diagnosis.model.groups import Group, merged
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import prepare
from cosim.diagnosis.record.record import Record, joined
from cosim.diagnosis.thresholds import CALIBRATED_TRUST, GUESSED_TRUST, IN_VAIN
from cosim.rig import make_log
from cosim.rig.write import as_log
from fmus.contract import Effect

HIDDEN = ("mechanical.coulomb_friction:tau_c=300", "mechanical.end_stop")
START = {"mechanical.theta_0": np.radians(15.0), "mechanical.J": 3000.0, "mechanical.b": 9000.0}


@pytest.mark.parametrize("correlation", [0.0, 0.8, 0.98])
def test_a_sum_over_bins_weighs_as_many_values_as_are_independent(correlation: float) -> None:
    """The mean over a window is as certain under the rule as it truly is, within a factor of two."""
    rule = plain(1, 2000, False)
    values = lfilter([1.0], [1.0, -correlation], np.random.default_rng(3).standard_normal(200_000))
    truth = float(np.var(rule.windows(values).mean(axis=1)))
    assert broad(rule, values).sizes[0] / 2000 == pytest.approx(truth, rel=1.2, abs=0.6 * truth)
    assert not any(broad(rule, values).sizes[1:])


@pytest.fixture(scope="module")
def pair() -> tuple[Record, Group]:
    """Two short synthetic logs of a drive far from its nominal numbers, of which command and angle are known."""
    machine = our_machine("full_order")
    records = []
    for seed in (5, 6):
        log = as_log(make_log("steps", 9.0, list(HIDDEN), seed=seed, settings=START))
        log = dataclasses.replace(log, signals={n: log.signals[n] for n in ("u", "slew")})
        records.append(prepare(log, machine))
    record = joined(records)
    (group,) = merged(machine.groups, record.signals)
    return record, group


Begun = tuple[Task, Trial, tuple[Effect, ...]]


@pytest.fixture(scope="module")
def fitted(pair: tuple[Record, Group]) -> Begun:
    """The model without effects, fitted to these logs once."""
    record, group = pair
    task = task_for(group, record, [])
    candidates = tuple(e for e in candidates_of(task) if e.component == "mechanical")
    return task, nominal(task, record, CALIBRATED_TRUST), candidates


@pytest.fixture
def begun(fitted: Begun) -> Begun:
    """Where a search in these logs begins, each in a task of its own, and the effects of the mechanics."""
    task, null, candidates = fitted
    return copied(task), null, candidates


def test_an_end_of_the_travel_that_was_met_is_among_the_first(begun: Begun) -> None:
    task, null, candidates = begun
    rules = dict(task.rules)
    upstream = tuple(e for e in candidates_of(task) if e.name == "dead_zone.mismatch")
    found = least_error(task, null, (*candidates, *upstream), CALIBRATED_TRUST, 2)
    assert found is not None
    assert "mechanical.end_stop" in found.names
    assert task.rules == rules  # the noise is as it was learned


def test_rounding_does_not_decide_how_large_the_noise_is(pair: tuple[Record, Group]) -> None:
    """Readings that differ in their twelfth digit, as another processor's sums do, gave another likelihood by 0.02."""
    record, group = pair
    found = []
    for by in (0.0, 5e-12, -3e-12):
        signals = {n: v * (1.0 + by * k) for k, (n, v) in enumerate(record.signals.items(), 1)}
        task = task_for(group, replace(record, signals=signals), [])
        found.append(nominal(task, record, CALIBRATED_TRUST).fit.log_likelihood)
    np.testing.assert_allclose(found, found[0], atol=1e-3)


def test_a_law_is_not_sought_beside_one_that_holds_it(begun: Begun) -> None:
    """Coulomb's and Stribeck's friction share a level: both named would say the same thing twice."""
    task, null, candidates = begun
    frictions = [
        e for e in candidates if e.name in ("mechanical.coulomb_friction", "mechanical.stribeck_friction")
    ]
    assert len(frictions) == 2
    assert set(promising(task, null, frictions, CALIBRATED_TRUST)) == set(frictions)
    for friction, other in itertools.permutations(frictions):
        with_it = replace(null, effects=(friction,))
        assert promising(task, with_it, [other], CALIBRATED_TRUST) == []


def test_where_other_data_have_the_last_word_a_parameter_costs_what_it_costs_a_prediction(
    begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What gains 1.5 by one parameter pays AIC's price of 1, and not BIC's, which of 100 values is 2.3."""
    task, null, candidates = begun
    candidates = tuple(e for e in candidates if e.prior == 0.0)

    def tried(_: Task, effects: tuple[Effect, ...], *__: object, **___: object) -> Trial:
        left = -50.0 * float(np.exp(-2.0 * 1.5 / 100.0 * len(effects)))
        return Trial(effects, replace(null.fit, log_likelihood=left), len(effects))

    monkeypatch.setattr(naming, "tried", tried)
    monkeypatch.setattr(naming, "tried_all", lambda task, sets, *_: [tried(task, one) for one in sets])
    monkeypatch.setattr(naming, "believable", lambda *_: True)
    monkeypatch.setattr(naming, "broad", lambda rule, _: rule)
    assert least_error(task, null, candidates, CALIBRATED_TRUST, 1) is None
    assert least_error(task, null, candidates, CALIBRATED_TRUST, 1, better=lambda *_: True) is not None


def test_a_search_ends_where_the_data_that_judge_it_gain_nothing_more(
    begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is sure of them stays; two effects that help together only are waited for, and no third."""
    task, null, candidates = begun

    def tried(_: Task, effects: tuple[Effect, ...], *__: object, **___: object) -> Trial:
        """Every further effect takes nine tenths of the error away."""
        return Trial(effects, replace(null.fit, log_likelihood=-1e6 * 0.1 ** len(effects)), len(effects))

    monkeypatch.setattr(naming, "tried", tried)
    monkeypatch.setattr(naming, "tried_all", lambda task, sets, *_: [tried(task, one) for one in sets])
    monkeypatch.setattr(naming, "fitted_on", lambda _, ahead, *__: ahead)
    monkeypatch.setattr(naming, "believable", lambda *_: True)
    monkeypatch.setattr(naming, "swapped", lambda _, more, *__: more)
    monkeypatch.setattr(naming, "promising", lambda _, __, further, *___: further)
    steps: list[tuple[int, int]] = []

    def found(gaining: set[int]) -> int:
        steps.clear()

        def better(_: Task, __: Trial, one: Trial, other: Trial) -> bool:
            steps.append((len(one.effects), len(other.effects)))
            return len(steps) in gaining

        end = least_error(task, null, candidates, CALIBRATED_TRUST, 5, better=better)
        assert end is not None
        return len(end.effects)

    assert (found(set()), steps) == (IN_VAIN, [(1, 0), (2, 0)])
    assert (found({1}), steps) == (1, [(1, 0), (2, 1), (3, 1)])
    assert (found({2}), steps) == (2, [(1, 0), (2, 0), (3, 2), (4, 2)])


def test_where_few_values_count_what_pays_its_price_stays(
    begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An effect that takes nine tenths away gains less there than naming asks for: that is asked later."""
    task, null, candidates = begun
    left = {2: -1.0, 1: -9.0}

    def tried(_: Task, effects: tuple[Effect, ...], *__: object) -> Trial:
        return Trial(effects, replace(null.fit, log_likelihood=left[len(effects)]), 0)

    monkeypatch.setattr(naming, "tried_all", lambda task, sets, *_: [tried(task, one) for one in sets])
    monkeypatch.setattr(naming, "without", lambda task, chosen, out, *_: tried(task, chosen.effects[1:]))
    monkeypatch.setattr(naming, "promising", lambda *_: [])
    both = tried(task, candidates[:2])
    assert len(naming.swapped(task, both, candidates, CALIBRATED_TRUST).effects) == 1
    kept = naming.swapped(task, both, candidates, CALIBRATED_TRUST, lambda t: t.fit.log_likelihood)
    assert kept is both


def test_the_other_end_of_the_travel_is_sought_though_one_was_found(begun: Begun) -> None:
    task, null, _ = begun
    stop = next(e for e in candidates_of(task) if e.name == "mechanical.end_stop")
    off = {n: task.model.nominal(n) for n in ("mechanical.theta_max", "mechanical.theta_min")}
    near = replace(null.fit, values=null.fit.values | off | {"mechanical.theta_max": 0.3})
    starts = (1.0, -0.2)
    assert unused(task, (stop,), "mechanical.theta_min", near, starts) == starts
    assert unused(task, (stop,), "mechanical.theta_max", near, starts) == ()
    assert unused(task, (stop,), "mechanical.J", near, starts) == ()


def test_a_stop_within_a_model_of_guesses_is_sought_where_the_fitted_model_meets_it(
    pair: tuple[Record, Group],
) -> None:
    record, group = pair
    task = task_for(group, record, [])
    stop = next(e for e in candidates_of(task) if e.name == "dcv.stroke_limit")
    null = tried(task, (), GUESSED_TRUST)
    spool = task.model.inside("dcv", stop.free["x_max"].limits, null.fit.values)
    assert spool is not None
    # before any fit the guesses say nothing of it
    before, begun = (
        starting(task, (stop,), GUESSED_TRUST, near)[1]["dcv.x_max"] for near in (None, null.fit)
    )
    assert any(0.9 * spool.max() < at < spool.max() for at in set(begun) - set(before))


def test_a_limit_is_sought_where_it_can_be_though_what_it_limits_never_moves(
    pair: tuple[Record, Group],
) -> None:
    """A command within the dead zone moves no spool; at a speed of 0 the equation of its limit divides by it."""
    record, group = pair
    task = task_for(group, record, [])
    limit = next(e for e in candidates_of(task) if e.name == "dcv.rate_limit")
    null = tried(task, (), GUESSED_TRUST).fit
    still = replace(null, values=null.values | {"dead_zone.b_r": 5.0, "dead_zone.b_l": -5.0})
    spool = task.model.inside("dcv", "spool", still.values)
    assert spool is not None
    assert np.abs(spool).max() < 1e-15
    wanted, starts = starting(task, (limit,), GUESSED_TRUST, still)
    low = next(u.low for u in wanted if u.name == "dcv.v_max")
    assert min(starts["dcv.v_max"]) >= low > 0.0


def test_where_the_size_of_the_best_is_not_known_the_next_is_taken(
    begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    task, null, candidates = begun
    offered: list[tuple[str, ...]] = []

    def all_but_the_first(new: Trial, *_: object) -> bool:
        offered.append(new.names)
        return len(offered) > 1

    monkeypatch.setattr(naming, "believable", all_but_the_first)
    few = [e for e in candidates if e.name in ("mechanical.gravity_load", "mechanical.gear_ripple")]
    found = least_error(task, null, tuple(few), CALIBRATED_TRUST, 1)
    assert found is not None
    assert offered[0] != offered[1] == found.names
