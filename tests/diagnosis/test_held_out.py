"""Which causes held-out data keep: those whose absence makes the prediction worse, even where they help together only."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_logs import only

from cosim.diagnosis.answer.remarks import at_supply, turned_down
from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.limits import Passed
from cosim.diagnosis.fitting.trials import Trial
from cosim.diagnosis.held_out import causes as held_out
from cosim.diagnosis.held_out.causes import (
    Held,
    Refused,
    Step,
    balanced,
    borne,
    cancelling,
    key_of,
    least,
    likeliest,
    next_best,
    predicts_better,
    reconsider,
    spreads,
    stepper,
)
from cosim.diagnosis.held_out.gain import begun_anew
from cosim.diagnosis.hypotheses.naming import find
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.verdict.verdict import causes
from cosim.inference.held_out import HeldOutGain
from cosim.report.language import reported_in, said
from cosim.rig import make_log
from cosim.rig.write import as_log
from fmus import registry
from fmus.contract import Effect

COULOMB, STRIBECK, BACKLASH = (
    registry.effects()[f"mechanical.{name}"] for name in ("coulomb_friction", "stribeck_friction", "backlash")
)
STOP = registry.effects()["mechanical.end_stop"]
CRACKING = registry.effects()["continuity.cracking_pressure"]
# all that is asked of a finding here is which candidates there are
MECHANICS = SimpleNamespace(
    task=SimpleNamespace(model=SimpleNamespace(group=MODELS["full_order"][2])),
    rivals={},
    chosen=SimpleNamespace(effects=()),
)
FIT = Fit({}, {}, 0.0, 0, {}, np.empty((0, 0)))


@dataclass(frozen=True)
class FakeFinding:
    """As much of a finding as weighing rivals on held-out data needs."""

    task: object
    chosen: object
    rivals: dict[str, list[object]]
    undecided: dict[str, list[str]] = field(default_factory=dict)
    held_squares: object = None
    borne: dict[str, object] = field(default_factory=dict)


def kept(
    errors: list[tuple[tuple[Effect, ...], float]], begin: tuple[Effect, ...], *named: Effect
) -> set[str]:
    """Names of what is kept of the named effects; `errors` are those on held-out data, 100 for any other set.

    From window to window a mean square varies by a tenth, of each set in its own way.
    """
    listed = {frozenset(e.name for e in effects): error for effects, error in errors}

    def step(effects: tuple[Effect, ...]) -> Step:
        names = frozenset(e.name for e in effects)
        error = listed.get(names, 100.0)
        vary = np.random.default_rng(len("".join(names))).normal(1.0, 0.1, 24)
        return Step(effects, FIT, 1.0, error, squares=error**2 * vary / vary.mean())

    return {e.name for e in balanced(MECHANICS, step(begin), named, step, {}).effects}  # type: ignore[arg-type]


@pytest.mark.parametrize("begin", [(), (COULOMB, BACKLASH)])
def test_a_cause_that_does_not_help_goes(begin: tuple[Effect, ...]) -> None:
    errors = [((), 10.0), ((COULOMB,), 5.0), ((BACKLASH,), 9.0), ((COULOMB, BACKLASH), 4.99)]
    assert kept(errors, begin, COULOMB, BACKLASH) == {COULOMB.name}


@pytest.mark.parametrize("begin", [(), (COULOMB, BACKLASH), (COULOMB, BACKLASH, CRACKING)])
def test_two_that_help_together_only_stay(begin: tuple[Effect, ...]) -> None:
    errors = [((), 10.0), ((COULOMB,), 11.0), ((BACKLASH,), 11.0), ((COULOMB, BACKLASH), 3.0)]
    assert kept(errors, begin, COULOMB, BACKLASH, CRACKING) == {COULOMB.name, BACKLASH.name}


def test_what_goes_by_small_steps_goes_no_further_than_one_step_might() -> None:
    """Two are clearly better than none, either alone is clearly neither worse than both nor better than none: one stays."""
    rng = np.random.default_rng(3)
    noise = rng.normal(size=(2, 24))
    noise = (noise - noise.mean(axis=1, keepdims=True)) / noise.std(axis=1, keepdims=True)
    fewer, none = 0.05 * np.cumsum(1.0 / np.sqrt(24) + noise, axis=0)
    logs = {2: np.zeros(24), 1: fewer, 0: none}

    def step(effects: tuple[Effect, ...]) -> Step:
        return Step(effects, FIT, 1.0, 1.0, squares=np.exp(2.0 * logs[len(effects)]))

    named = (COULOMB, BACKLASH)
    assert not step(named).clearly_better(step((COULOMB,)))
    assert not step((COULOMB,)).clearly_better(step(()))
    assert step(named).clearly_better(step(()))
    found = balanced(MECHANICS, step(named), named, step, {COULOMB.name: 1.0})  # type: ignore[arg-type]
    assert found.effects == (COULOMB,)
    # what decided: the two against none
    assert borne(found, COULOMB, step) == step(named).gain_over(step(()))
    assert borne(found, COULOMB, step).borne_out


def test_what_the_fitted_log_asks_for_needs_less_than_an_exchange() -> None:
    """The same errors: a cause more is borne out by them, another cause in its place is not clearly better."""
    noise = np.random.default_rng(3).normal(size=24)
    noise = (noise - noise.mean()) / noise.std()
    poorer = np.exp(2.0 * 0.05 * (1.6 / np.sqrt(24) + noise))  # 1.6 standard errors from none
    one, both, other = (
        Step(effects, FIT, 1.0, 1.0, squares=squares)
        for effects, squares in (
            ((COULOMB,), poorer),
            ((COULOMB, BACKLASH), np.ones(24)),
            ((BACKLASH,), np.ones(24)),
        )
    )
    assert both.clearly_better(one)
    assert not other.clearly_better(one)
    assert not both.gain_over(one).sure


@pytest.mark.parametrize(("ratio", "as_good"), [(1.08, True), (1.12, False)])
@pytest.mark.parametrize("placed", [True, False])
def test_a_tenth_of_the_error_is_what_decides_however_gains_are_measured(
    ratio: float, as_good: bool, placed: bool
) -> None:
    """A wheel: dry friction, 1.23 rad/s, gave way to a dead zone, 1.39: by parts a gain is half as large."""
    squares = np.linspace(0.5, 1.5, 8)
    friction = Step((COULOMB,), FIT, 1.0, 1.0, squares=squares, placed=placed)
    other = Step((DEAD_ZONE,), FIT, 1.0, ratio, squares=ratio**2 * squares, placed=placed)
    assert other.about_as_good(friction) is as_good
    assert friction.about_as_good(other)


def test_a_cause_does_not_go_where_a_simpler_one_in_its_place_is_about_as_good() -> None:
    """Coulomb friction is hardly worse than Stribeck friction, none hardly worse than Coulomb, but clearly than Stribeck."""
    rng = np.random.default_rng(3)
    noise = rng.normal(size=(2, 24))
    noise = (noise - noise.mean(axis=1, keepdims=True)) / noise.std(axis=1, keepdims=True)
    simple, none = 0.05 * np.cumsum(1.0 / np.sqrt(24) + noise, axis=0)
    logs = {(STRIBECK,): np.zeros(24), (COULOMB,): simple, (): none}

    def step(effects: tuple[Effect, ...]) -> Step:
        return Step(effects, FIT, 1.0, 1.0, squares=np.exp(2.0 * logs[effects]))

    assert not step((STRIBECK,)).clearly_better(step((COULOMB,)))
    assert not step((COULOMB,)).clearly_better(step(()))
    found = balanced(MECHANICS, step((STRIBECK,)), (STRIBECK,), step, {})  # type: ignore[arg-type]
    assert found.effects == (COULOMB,)


@pytest.mark.parametrize(("fuller", "expected"), [(4.98, COULOMB), (4.0, STRIBECK)])
@pytest.mark.parametrize("begin", [(), (STRIBECK,)])
def test_the_fuller_of_two_must_be_better_than_the_simpler(
    begin: tuple[Effect, ...], fuller: float, expected: Effect
) -> None:
    errors = [((), 10.0), ((COULOMB,), 5.0), ((STRIBECK,), fuller)]
    assert kept(errors, begin, STRIBECK) == {expected.name}


def test_an_effect_whose_size_is_in_doubt_goes_before_one_that_gains_less() -> None:
    """Of three of which one is not determined, that one goes, though another gains less; what is left stays."""
    sets = {
        (COULOMB, BACKLASH, CRACKING): (4.0, (BACKLASH.name,)),
        (COULOMB, CRACKING): (4.0, ()),
        (COULOMB,): (6.0, ()),
        (CRACKING,): (9.0, ()),
    }
    tried: list[frozenset[str]] = []

    def step(effects: tuple[Effect, ...]) -> Step:
        tried.append(frozenset(e.name for e in effects))
        error, unsure = next((v for k, v in sets.items() if {e.name for e in k} == tried[-1]), (100.0, ()))
        return Step(effects, FIT, 1.0, error, unsure, np.full(24, error**2))

    named = (COULOMB, BACKLASH, CRACKING)
    losses = {COULOMB.name: 500.0, BACKLASH.name: 50.0, CRACKING.name: 5.0}
    found = balanced(MECHANICS, step(named), named, step, losses)  # type: ignore[arg-type]
    assert {e.name for e in found.effects} == {COULOMB.name, CRACKING.name}
    assert frozenset({COULOMB.name, BACKLASH.name}) not in tried[: tried.index(frozenset({COULOMB.name}))]


DEAD_ZONE = registry.effects()["dead_zone.mismatch"]


@pytest.mark.parametrize(("without", "expected"), [(10.0, {DEAD_ZONE.name}), (1.0, set())])
def test_where_the_log_does_not_tell_the_size_of_a_cause_it_may_tell_that_of_a_rival(
    without: float, expected: set[str]
) -> None:
    """A small excavator's swing: Stribeck friction whose size nobody knew, or nothing, 29 deg; a dead zone has 2.7."""
    sets = {
        (STRIBECK, BACKLASH): (1.0, (STRIBECK.name,)),
        (COULOMB, BACKLASH): (without, ()),
        (BACKLASH,): (without, ()),
        (DEAD_ZONE, BACKLASH): (2.0, (BACKLASH.name,)),  # what is unsure in it yet goes next
        (DEAD_ZONE,): (2.0, ()),
    }
    tried: list[set[str]] = []

    def step(effects: tuple[Effect, ...]) -> Step:
        tried.append({e.name for e in effects})
        error, unsure = next((v for k, v in sets.items() if {e.name for e in k} == tried[-1]), (without, ()))
        return Step(effects, FIT, 1.0, error, unsure, np.full(24, error**2))

    named = (STRIBECK, BACKLASH)
    rival = Trial((DEAD_ZONE, BACKLASH), replace(FIT, log_likelihood=-1e3), 0)
    finding = FakeFinding(MECHANICS.task, Trial(named, FIT, 0), {STRIBECK.name: [rival]})
    found = balanced(finding, step(named), named, step, {})  # type: ignore[arg-type]
    assert {e.name for e in found.effects} == expected
    assert ({DEAD_ZONE.name, BACKLASH.name} in tried) == bool(expected), "no fit where nothing hangs on it"


def without_stribeck(
    monkeypatch: pytest.MonkeyPatch, step: Callable[..., Step], sets: Iterable[tuple[Effect, ...]]
) -> tuple[dict[Effect, HeldOutGain], dict[Effect, list[Effect]]]:
    """The next best of sets that `step` has judged, Stribeck friction taken back."""
    task = SimpleNamespace(measured={"slew": None}, model=MECHANICS.task.model)
    finding = FakeFinding(task, SimpleNamespace(effects=(STRIBECK,)), {})
    monkeypatch.setattr(held_out, "stepper", lambda *_: step)
    monkeypatch.setattr(held_out, "compared", lambda *_: "slew")
    held = Held(SimpleNamespace(signals={"slew": None}), 0)  # type: ignore[arg-type]
    done = {key_of(effects): step(effects) for effects in sets}
    return next_best(finding, held, {STRIBECK.name}, 0.01, done)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("others", "named"),
    [(2.0, DEAD_ZONE.name), (10.0, ""), (None, "")],
    ids=["borne out", "no better", "unsure"],
)
def test_without_a_cause_whose_size_nobody_knows_what_else_the_held_out_data_bear_out_is_named(
    monkeypatch: pytest.MonkeyPatch, others: float | None, named: str
) -> None:
    """A small excavator's stick: Stribeck friction was taken back, and nothing named where a dead zone left a tenth."""
    unsure = others is None
    errors = {
        (STRIBECK,): 1.0,
        (): 10.0,
        **dict.fromkeys([(COULOMB,), (DEAD_ZONE,), (CRACKING,)], others or 2.0),
    }

    def step(effects: tuple[Effect, ...]) -> Step:
        doubt = (effects[0].name,) if unsure and len(effects) == 1 else ()
        vary = np.random.default_rng(len(effects)).normal(1.0, 0.1, 24)
        return Step(effects, FIT, 1.0, errors[effects], doubt, errors[effects] ** 2 * vary)

    gains, alike = without_stribeck(monkeypatch, step, errors)
    assert [e.name for e in gains] == ([named] if named else [])
    # the likeliest of those that they do not tell apart, which are told
    assert {e.name: {o.name for o in found} for e, found in alike.items()} == (
        {named: {COULOMB.name, CRACKING.name}} if named else {}
    )


def test_what_is_worse_within_the_next_best_set_does_not_stand_there_as_something_unlikelier(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An excavator's boom at rest: a sensor that saturates stood where an end stop with as much left beside it fell."""
    saturation = registry.effects()["sensor.saturation"]
    # better in six parts of eight: enough for what the fitted data ask for
    less, more = np.ones(8), np.array([1.6] * 6 + [0.6] * 2)
    squares = {
        (STRIBECK,): 0.5 * less,
        (DEAD_ZONE, BACKLASH): less,
        (DEAD_ZONE,): more,
        (BACKLASH,): more,
        (saturation,): more,
        (): 100.0 * more,
    }

    def step(effects: tuple[Effect, ...]) -> Step:
        found = squares[effects]
        return Step(effects, FIT, 1.0, float(np.sqrt(found.mean())), (), found, placed=True)

    gains, _ = without_stribeck(monkeypatch, step, squares)
    assert {e.name for e in gains} == {DEAD_ZONE.name, BACKLASH.name}


def test_a_set_that_is_sure_is_not_left_for_nothing_by_way_of_sets_that_are_not() -> None:
    """Either of two alone does as well, but with a size that nothing holds; with none the error is ten times as large."""
    sets = {
        (COULOMB, BACKLASH): (1.0, ()),
        (COULOMB,): (1.0, (COULOMB.name,)),
        (BACKLASH,): (1.0, (BACKLASH.name,)),
        (): (10.0, ()),
    }

    def step(effects: tuple[Effect, ...]) -> Step:
        error, unsure = next(v for k, v in sets.items() if {e.name for e in k} == {e.name for e in effects})
        return Step(effects, FIT, 1.0, error, unsure, np.full(24, error**2))

    named = (COULOMB, BACKLASH)
    found = balanced(MECHANICS, step(named), named, step, {})  # type: ignore[arg-type]
    assert {e.name for e in found.effects} == {COULOMB.name, BACKLASH.name}


def test_what_is_told_of_a_kept_cause_is_what_has_decided() -> None:
    """The gain on held-out data with and without it, whose interval excludes none where the cause is kept."""
    errors = {frozenset({COULOMB.name, BACKLASH.name}): 4.0, frozenset({COULOMB.name}): 4.001}

    def step(effects: tuple[Effect, ...]) -> Step:
        error = errors.get(frozenset(e.name for e in effects), 8.0)
        return Step(effects, FIT, 1.0, error, squares=error**2 * np.linspace(0.8, 1.2, 24))

    at = step((COULOMB, BACKLASH))
    # of what half of the parts leave nothing counts: log((64 + 16) / (16 + 16)) / 2 in each
    assert borne(at, COULOMB, step).gain == pytest.approx(12 * np.log(2.5), rel=0.01)
    assert borne(replace(at, placed=True), COULOMB, step).gain == pytest.approx(24 * np.log(2.0))
    assert borne(at, COULOMB, step).sure == at.clearly_better(step((BACKLASH,)))
    assert borne(at, BACKLASH, step).gain < 0.1


def test_refused_effects_stay_rivals_where_held_out_data_tell_them_apart_no_better() -> None:
    """Weak dry friction and a weak cracking pressure act alike; gravity does not, and Stribeck friction holds Coulomb's."""
    hidden = ["mechanical.coulomb_friction:tau_c=6"]
    logs = [as_log(make_log("steps", 20.0, hidden, seed=s)) for s in (5, 6)]
    record, other = (prepare(log, our_machine("full_order")) for log in logs)
    refused = [CRACKING, STRIBECK, registry.effects()["mechanical.gravity_load"]]
    group = replace(MODELS["full_order"][2], excluded=tuple(e.name for e in refused))
    finding = find(task_for(group, record, []), record, better=lambda *_: True)
    assert finding.chosen.effects == (COULOMB,)
    assert not {e.name for t in finding.rivals[COULOMB.name] for e in t.effects} & {e.name for e in refused}
    turned_down = [Refused(e, group.name, "slew", 0.0, 1.0, 2.0) for e in refused]
    finding, _, _ = reconsider(finding, Held(other, 0), turned_down, 0.01)
    added = {e.name for t in finding.rivals[COULOMB.name] for e in t.effects} & {e.name for e in refused}
    assert added == {CRACKING.name}
    # and the answer says so: what held-out data leave undecided is what cannot be told apart
    assert CRACKING.name in finding.undecided[COULOMB.name]
    (cause,) = causes(finding, 0.01)
    assert set(cause.indistinguishable) == set(finding.undecided[COULOMB.name])


def test_of_two_that_make_up_for_each_other_neither_is_sure() -> None:
    offset, load = registry.effects()["dcv.offset"], registry.effects()["mechanical.constant_load"]
    names = ["mechanical.J", "dcv.x_0", "mechanical.tau_load"]
    model = SimpleNamespace(nominal=lambda _: 0.0)

    def fitted(correlation: float, size: float = 10.0) -> Fit:
        covariance = np.array([[1.0, 0.999, 0.0], [0.999, 1.0, correlation], [0.0, correlation, 1.0]])
        values = dict.fromkeys(names, size)  # in standard deviations
        return replace(FIT, values=values, covariance=covariance, deviations=dict.fromkeys(names, 1.0))

    def both(correlation: float, size: float = 10.0) -> set[str]:
        return cancelling((offset, load), fitted(correlation, size), model)  # type: ignore[arg-type]

    assert both(-0.999) == {"dcv.offset", "mechanical.constant_load"}
    assert both(0.9) == set()
    assert cancelling((offset,), fitted(-0.999), model) == set()  # type: ignore[arg-type]  # J is no cause
    # each is known to a hundredth, and to a quarter if the correlation spoils its deviation as much again
    assert both(-0.999, 100.0) == set()


def test_of_effects_that_cannot_be_told_apart_the_likeliest_is_named() -> None:
    """The mapping's order goes before the odds: an end of the travel before a sensor that saturates."""
    saturation, stop, friction = (
        registry.effects()[n]
        for n in ("sensor.saturation", "mechanical.end_stop", "mechanical.coulomb_friction")
    )
    assert likeliest(saturation, [friction, stop], ()) == friction
    assert likeliest(saturation, [stop], ()) == stop
    assert likeliest(stop, [saturation], ()) == stop
    assert likeliest(saturation, [stop], ("sensor.saturation",)) == saturation
    assert likeliest(saturation, [stop], ("mechanical.end_stop", "sensor.saturation")) == stop


def stepper_of(monkeypatch, refitted, rounding: float = 0.0, searched: tuple[Trial, ...] = ()):
    """A stepper whose fits are made up, over a log whose sensor rounds with this deviation."""
    monkeypatch.setattr(held_out, "refitted", refitted)
    monkeypatch.setattr(held_out, "errors", lambda finding, fit, record: fit.residuals)
    monkeypatch.setattr(held_out, "worth_naming", lambda *_: True)
    monkeypatch.setattr(held_out, "cannot_be", lambda *_: False)
    monkeypatch.setattr(held_out, "sizes_in", lambda *_: {})
    model = SimpleNamespace(group=replace(MODELS["full_order"][2], absolute=("slew",)), cuts=(), stages=())
    rule = SimpleNamespace(bins=1, window=6)
    finding = SimpleNamespace(
        task=SimpleNamespace(model=model, rules={"slew": rule}, measured={}),
        chosen=Trial((COULOMB, BACKLASH), FIT, 0),
        single=list(searched[:1]),
        rivals={COULOMB.name: list(searched[1:])},
    )
    record = SimpleNamespace(cuts=(), rounding=lambda _: rounding, signals={})
    return stepper(finding, Held(record, 0), "slew", 0.01)  # type: ignore[arg-type]


def test_a_machine_that_stands_does_not_decide(monkeypatch) -> None:
    """Where it stands one set errs by nothing and another by less than the sensor's rounding: neither gains there."""
    errors = {1: np.repeat([1e-2, 0.0], [12, 36]), 2: np.repeat([1e-2, 1e-9], [12, 36])}

    def refitted(finding, effects, tolerance, near):
        return replace(FIT, residuals={"slew": errors[len(effects)]})

    step = stepper_of(monkeypatch, refitted, rounding=1e-4)
    assert step((COULOMB,)).gain_over(step((COULOMB, BACKLASH))).gain == 0.0


def test_a_limit_that_held_out_readings_pass_is_not_sure(monkeypatch) -> None:
    def refitted(finding, effects, tolerance, near):
        return replace(FIT, residuals={"slew": np.ones(48)})

    step = stepper_of(monkeypatch, refitted)
    beyond = Passed("slew", 0.3, 0.4, False)
    monkeypatch.setattr(held_out, "passed", lambda task, effect, *_: [beyond] if effect is STOP else [])
    assert step((STOP, COULOMB)).unsure == (STOP.name,)
    told = turned_down(Refused(STOP, "mechanical", "slew", 5.0, 1.0, 0.5, False, passed=(beyond,)), ())
    assert told.why.endswith("pass the limit: slew reaches 22.92 deg, and it would end at 17.19")


def test_a_refused_cause_gains_no_negative_log_likelihood() -> None:
    """ "It gains -57 in log-likelihood": found in windows of its own, it explains nothing of the whole log."""
    told = turned_down(Refused(BACKLASH, "mechanical", "slew", -57.0, 0.1, 0.1, False), ())
    assert told.why == (
        "taken as a whole the fitted data are explained no better with it; on held-out data the error of slew stays at "
        "5.73 deg with it"
    )


def test_a_limit_that_no_reading_comes_near_is_not_sure(monkeypatch: pytest.MonkeyPatch) -> None:
    def refitted(finding, effects, tolerance, near):
        return replace(FIT, residuals={"slew": np.ones(48)})

    step = stepper_of(monkeypatch, refitted)
    monkeypatch.setattr(held_out, "unmet", lambda task, effect, *_: effect is STOP)
    assert step((STOP, COULOMB)).unsure == (STOP.name,)


@pytest.mark.parametrize(
    ("with_it", "told"),
    [
        (0.27324, "rises from 15.6551 to 15.6555"),
        (0.2732324561, "stays at 15.66"),
        (0.25, "falls only from 15.66 to 14.32"),
    ],
)
def test_how_an_error_changes_shows(with_it, told) -> None:
    """ "rises from 15.6610503 to 15.6610503" says nothing: what six digits do not tell apart stays as it is."""
    error = turned_down(Refused(COULOMB, "mechanical", "slew", 5.0, 0.2732324560, with_it), ())
    assert told in error.why


@pytest.mark.parametrize("in_fitted", [False, True])
def test_a_fall_that_was_not_held_against_a_cause_is_no_mere_one(in_fitted) -> None:
    """A delay that halved the error was refused for its interval, and "falls only" blamed the half."""
    item = Refused(COULOMB, "mechanical", "slew", 5.0, 0.2, 0.1, sure=False, in_fitted=in_fitted)
    why = turned_down(item, ()).why
    assert "do not determine its size" in why
    assert "falls from 11.46 to 5.73 deg" in why
    with reported_in("de"):
        assert "Größe nicht" in said(why)
        assert "nur" not in said(why)


def test_what_would_stand_in_place_of_a_cause_is_said_of_named_ones_only() -> None:
    item = Refused(BACKLASH, "mechanical", "slew", 0.5, 0.1, 0.2, instead=COULOMB.name)
    beside, alone = turned_down(item, {COULOMB.name}), turned_down(item, ())
    assert beside.why.startswith(f"in place of {COULOMB.name} it explains")
    assert f"as {COULOMB.name} does, which is not named either" in alone.why
    assert (beside.instead, alone.instead) == (COULOMB.name, None)


def test_a_set_that_the_search_has_fitted_is_judged_from_there(monkeypatch) -> None:
    """From the values of another set, in which something else did its part, it may not be found."""
    begun = []

    def refitted(finding, effects, tolerance, near):
        begun.append(near)
        return replace(FIT, residuals={"slew": np.ones(48)})

    alone, beside = (replace(FIT, values={"mechanical.backlash": v}) for v in (1.0, 2.0))
    searched = Trial((BACKLASH,), alone, 0), Trial((BACKLASH, STRIBECK), beside, 0)
    step = stepper_of(monkeypatch, refitted, searched=searched)
    for effects in ((BACKLASH,), (STRIBECK, BACKLASH), (STRIBECK,)):
        step(effects)
    assert begun == [alone, beside, FIT]


@pytest.mark.parametrize("first", [(COULOMB,), (COULOMB, BACKLASH)], ids=["the part", "the whole"])
def test_a_set_that_leaves_more_than_a_part_of_it_is_fitted_from_there(monkeypatch, first) -> None:
    """Whichever was fitted first: a search that ended in a worse minimum than that of a part of its set went astray."""
    good = replace(FIT, values={"mechanical.tau_c": 5.0}, residuals={"slew": np.ones(48)})
    astray = replace(FIT, values={"mechanical.tau_c": 0.1}, residuals={"slew": np.full(48, 9.0)})

    def refitted(finding, effects, tolerance, near):
        return good if len(effects) == 1 or near is good else astray

    step = stepper_of(monkeypatch, refitted)
    step(first)
    step((COULOMB,))
    assert step((BACKLASH, COULOMB)).fit is good


def test_an_effect_takes_the_place_of_one_only_and_of_none_at_the_cost_of_another(monkeypatch) -> None:
    """A dead zone is likelier than a shifted valve and than friction, but one cause; where it costs friction, it is none."""
    zone, offset = registry.effects()["dead_zone.mismatch"], registry.effects()["dcv.offset"]
    costly: set[str] = set()

    def step(effects: tuple[Effect, ...]) -> Step:
        names = {e.name for e in effects}
        error = 1.0 if len(names) == 2 else 4.0 + len(names)
        unsure = tuple(costly & names) if zone.name in names else ()
        return Step(effects, FIT, 1.0, error, unsure, error**2 * np.linspace(0.8, 1.2, 24))

    chosen = SimpleNamespace(effects=(offset, COULOMB), fit=FIT, score=0.0)
    known = [SimpleNamespace(effects=(e, zone), names=(), score=0.0) for e in (COULOMB, offset)]
    task = SimpleNamespace(measured={"slew": None}, model=MECHANICS.task.model)
    finding = FakeFinding(task, chosen, {offset.name: known[:1], COULOMB.name: known[1:]})
    monkeypatch.setattr(held_out, "stepper", lambda *_: step)
    monkeypatch.setattr(held_out, "tried_all", lambda *_: [])
    held = Held(SimpleNamespace(signals={"slew": None}), 0)  # type: ignore[arg-type]
    found, taken, _ = reconsider(finding, held, [], 0.01)  # type: ignore[arg-type]
    assert [e.name for e in taken].count(zone.name) == 1
    assert len(taken) == 2
    costly.update({offset.name, COULOMB.name})
    found, taken, _ = reconsider(finding, held, [], 0.01)  # type: ignore[arg-type]
    assert taken == chosen.effects
    assert found.undecided[offset.name] == [zone.name]


def test_an_exchange_that_is_taken_back_leaves_what_took_the_place_undecided(monkeypatch) -> None:
    """A dead zone is clearly better than a shifted valve beside friction, and what is left of the set with it is not."""
    zone, offset = registry.effects()["dead_zone.mismatch"], registry.effects()["dcv.offset"]
    errors = {
        (COULOMB, offset): 1.0,
        (COULOMB, zone): 0.5,
        (zone,): 9.0,
        (offset,): 9.0,
        (COULOMB,): 4.0,
        (): 9.0,
    }

    def step(effects: tuple[Effect, ...]) -> Step:
        error = errors[tuple(sorted(effects, key=lambda e: e is not COULOMB))]
        return Step(effects, FIT, 1.0, error, squares=error**2 * np.linspace(0.8, 1.2, 24))

    chosen = SimpleNamespace(effects=(COULOMB, offset), fit=FIT, score=0.0)
    task = SimpleNamespace(measured={"slew": None}, model=MECHANICS.task.model)
    rivals = {offset.name: [SimpleNamespace(effects=(COULOMB, zone), names=(), score=0.0)]}
    monkeypatch.setattr(held_out, "stepper", lambda *_: step)
    monkeypatch.setattr(held_out, "tried_all", lambda *_: [])
    monkeypatch.setattr(
        held_out, "shrunk", lambda _, begin, *__: replace(begin, held=9.0, squares=81.0 * begin.squares)
    )
    held = Held(SimpleNamespace(signals={"slew": None}), 0)  # type: ignore[arg-type]
    found, taken, _ = reconsider(FakeFinding(task, chosen, rivals), held, [], 0.01)  # type: ignore[arg-type]
    assert taken == chosen.effects
    assert found.undecided == {COULOMB.name: [], offset.name: [zone.name]}


def test_no_law_takes_the_place_of_another_cause_beside_one_that_it_holds(monkeypatch) -> None:
    """Stribeck's friction has Coulomb's in it: beside it there would be two names for one friction."""

    def step(effects: tuple[Effect, ...]) -> Step:
        error = 0.1 if STRIBECK in effects else 1.0 if len(effects) == 2 else 4.0
        return Step(effects, FIT, 1.0, error, squares=error**2 * np.linspace(0.8, 1.2, 24))

    chosen = SimpleNamespace(effects=(COULOMB, BACKLASH), fit=FIT, score=0.0)
    task = SimpleNamespace(measured={"slew": None}, model=MECHANICS.task.model)
    rivals = {BACKLASH.name: [SimpleNamespace(effects=(COULOMB, STRIBECK), names=(), score=0.0)]}
    monkeypatch.setattr(held_out, "stepper", lambda *_: step)
    monkeypatch.setattr(held_out, "tried_all", lambda *_: [])
    held = Held(SimpleNamespace(signals={"slew": None}), 0)  # type: ignore[arg-type]
    _, taken, _ = reconsider(FakeFinding(task, chosen, rivals), held, [], 0.01)  # type: ignore[arg-type]
    assert taken == chosen.effects


@pytest.mark.parametrize(
    ("error", "named", "refused"), [(0.5, "zone", "offset"), (1.0, "zone", ""), (2.0, "offset", "zone")]
)
def test_held_out_data_decide_between_a_cause_and_a_rival_that_fits_as_well(
    monkeypatch, error: float, named: str, refused: str
) -> None:
    """One that is clearly better there takes its place, one clearly worse is refused; of two alike the likelier is named."""
    effects = {"zone": registry.effects()["dead_zone.mismatch"], "offset": registry.effects()["dcv.offset"]}
    zone, offset = effects.values()

    def step(chosen: tuple[Effect, ...]) -> Step:
        rms = {(): 4.0, (offset,): 1.0, (zone,): error}[chosen]
        return Step(chosen, FIT, 1.0, rms, squares=rms**2 * np.linspace(0.8, 1.2, 24))

    chosen = SimpleNamespace(effects=(offset,), fit=FIT, score=0.0)
    task = SimpleNamespace(measured={"slew": None}, model=MECHANICS.task.model)
    rivals = {offset.name: [SimpleNamespace(effects=(zone,), names=(), score=0.0)]}
    monkeypatch.setattr(held_out, "stepper", lambda *_: step)
    monkeypatch.setattr(held_out, "tried_all", lambda *_: [])
    held = Held(SimpleNamespace(signals={"slew": None}), 0)  # type: ignore[arg-type]
    found, taken, worse = reconsider(FakeFinding(task, chosen, rivals), held, [], 0.01)  # type: ignore[arg-type]
    assert taken == (effects[named],)
    assert [(r.effect, r.instead) for r in worse] == (
        [(effects[refused], effects[named].name)] if refused else []
    )
    assert bool(found.undecided[effects[named].name]) == (not refused)


def test_of_two_that_explain_the_fitted_log_alike_the_held_out_log_takes_the_one_it_bears_out() -> None:
    """In a log of steps the play of a valve does what an overlap does; a log that goes back and forth shows which it is."""
    steps, back_and_forth = (
        as_log(make_log(shape, seconds, ["dead_zone.mismatch"], seed=seed))
        for shape, seconds, seed in (("steps", 16.0, 2801), ("mixed", 21.0, 2901))
    )
    found = diagnose(steps, model=only("dcv"), held_out=back_and_forth)
    assert [c.effect.name for c in found.causes] == ["dead_zone.mismatch"]
    assert "dcv.hysteresis" in [r.effect.name for r in found.refused]


@pytest.mark.parametrize(
    ("error", "unsure", "better"), [(0.5, (), True), (0.5, (BACKLASH.name,), False), (0.99, (), False)]
)
def test_a_search_goes_by_sets_whose_sizes_are_sure(
    monkeypatch, error: float, unsure: tuple[str, ...], better: bool
) -> None:
    """A set of which a size may be anything is no beginning, however well it predicts other data."""

    def step(chosen: tuple[Effect, ...]) -> Step:
        rms, of = (error, unsure) if BACKLASH in chosen else (1.0, ())
        return Step(chosen, FIT, 1.0, rms, of, rms**2 * np.linspace(0.8, 1.2, 24))

    monkeypatch.setattr(held_out, "stepper", lambda *_: step)
    monkeypatch.setattr(held_out, "compared", lambda *_: "slew")
    judge = predicts_better(Held(SimpleNamespace(signals={}), 0), 0.01, {})  # type: ignore[arg-type]
    one, other = Trial((COULOMB, BACKLASH), FIT, 2), Trial((COULOMB,), FIT, 1)
    assert bool(judge(MECHANICS.task, other, one, other)) is better


def test_a_set_is_as_sure_as_with_something_simpler_in_the_place_of_what_is_not(monkeypatch) -> None:
    """Stribeck's level and peak may not be told apart where there is friction beyond doubt: the search goes on."""

    def step(chosen: tuple[Effect, ...]) -> Step:
        names = {e.name for e in chosen}
        rms = {frozenset(): 1.0, frozenset({BACKLASH.name}): 0.99}.get(frozenset(names), 0.5)
        return Step(chosen, FIT, 1.0, rms, tuple(names & {STRIBECK.name}), rms**2 * np.linspace(0.8, 1.2, 24))

    monkeypatch.setattr(held_out, "stepper", lambda *_: step)
    monkeypatch.setattr(held_out, "compared", lambda *_: "slew")
    judge = predicts_better(Held(SimpleNamespace(signals={}), 0), 0.01, {})  # type: ignore[arg-type]
    one, other = Trial((STRIBECK, BACKLASH), FIT, 4), Trial((BACKLASH,), FIT, 1)
    assert judge(MECHANICS.task, other, one, other)


def test_the_set_that_errs_least_in_part_after_part_is_taken_and_a_sure_one_first() -> None:
    squares = np.full(22, 0.01)
    pushed = np.where(np.arange(22) == 4, 0.9, 0.0004)
    plain = Step((), FIT, 1.0, 0.1, squares=squares)
    better = Step((), FIT, 1.0, 0.2, squares=pushed)
    assert least([plain, better]) is better
    assert least([better, plain]) is better
    doubtful = replace(better, unsure=("dcv.offset",))
    assert least([doubtful, plain]) is plain
    assert least([doubtful]) is doubtful


def test_a_drifting_prediction_begins_in_each_window_where_the_machine_stands() -> None:
    time = np.arange(100) * 0.1
    measured = np.sin(time)
    record = Record(0.1, {"slew": measured, "u": measured})
    drifting = {"slew": measured + np.repeat([0.0, 5.0, -3.0, 7.0], 25), "u": measured + 1.0}
    found = begun_anew(record, drifting, ["slew"], 25, 25)
    assert found["slew"][25:] == pytest.approx(measured[25:])
    assert found["slew"][:25] == pytest.approx(drifting["slew"][:25])
    assert found["u"] is drifting["u"]


def test_a_part_of_a_log_that_stands_still_decides_nothing():
    """A servo valve's pressure at its supply over a quarter: 0 / 0, and 1409 to 199 psi was "no more than chance may do"."""
    reading = np.concatenate([np.sin(np.arange(300.0)), np.full(100, 3.0)])
    own, still = spreads(reading, SimpleNamespace(cuts=(300,)))
    assert own == pytest.approx(np.var(reading[:300]))
    assert still == pytest.approx(0.05 * own)
    assert all(v > 0.0 for v in spreads(np.zeros(400), SimpleNamespace(cuts=(300,))))


@pytest.mark.parametrize(("supply", "level"), [(False, 0.9), (True, 0.9), (False, 100.0)])
def test_a_stop_of_an_unseen_spool_may_be_a_pressure_that_ends_at_its_supply(supply, level):
    """Of a servo valve with blocked ports "a stop of the spool" was all that was said of 3000 psi, its supply."""
    swing = (
        np.linspace(-2.0, 2.0, 1000) ** 3
        if level < 1.0
        else np.random.default_rng(2).normal(size=1000) / 400.0
    )
    group = SimpleNamespace(stages=(("dead_zone", "dead_zone"), ("dcv", "dcv"), ("continuity", "continuity")))
    task = SimpleNamespace(
        model=SimpleNamespace(group=group), measured={"p_load": 2e7 * np.clip(level * swing, -1.0, 0.95)}
    )
    effect = SimpleNamespace(name="dcv.stroke_limit")
    diagnosis = SimpleNamespace(
        causes=[SimpleNamespace(group="dcv+continuity", effect=effect)],
        findings={"dcv+continuity": SimpleNamespace(task=task)},
        record=SimpleNamespace(has=lambda *names: supply),
    )
    said = at_supply(diagnosis)
    assert len(said) == (not supply and level < 1.0), "a pressure that rests at no end ends at none"
    assert all("between -200 and 190 bar" in one for one in said)


@pytest.mark.parametrize(("astray", "gains"), [(-3.6e6, 1000.0), (400.0, 500.0)])
def test_an_effect_gains_no_more_than_all_do_wherever_a_quick_fit_of_the_others_ends(
    monkeypatch, astray: float, gains: float
) -> None:
    """A motor of which a shifted neutral "gains 3571838 in log-likelihood", and the error fell by two per cent."""

    def fitted(likelihood: float) -> SimpleNamespace:
        return SimpleNamespace(fit=SimpleNamespace(log_likelihood=likelihood))

    monkeypatch.setattr(held_out, "without", lambda *args: fitted(astray))
    finding = SimpleNamespace(task=None, chosen=fitted(900.0), null=fitted(-100.0))
    assert held_out.loss(finding, COULOMB, 0.01) == gains
