"""Several logs of one machine: each keeps its start and its noise, and nothing passes from one to the next."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.compare.metrics import rms
from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.noise import Windows, learned, plain
from cosim.diagnosis.fitting.trials import tried
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.held_out import causes
from cosim.diagnosis.held_out.causes import each_in_turn, left_out_errors
from cosim.diagnosis.held_out.free_run import errors, onward, refitted
from cosim.diagnosis.held_out.gain import measure
from cosim.diagnosis.held_out.over_logs import over_logs
from cosim.diagnosis.hypotheses.naming import find, nominal
from cosim.diagnosis.model.groups import MODELS, Group
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import (
    diagnose,
    least_sure,
    none_between_logs,
    prepare,
    untenable_taken_back,
    with_less,
)
from cosim.diagnosis.record.grid import Grid, Pieces, grid_of
from cosim.diagnosis.record.record import Record, each_left_out, fixed_values, joined
from cosim.diagnosis.residuals.cross_validation import (
    fold_cuts,
    fold_numbers,
    fold_of,
    repetitions,
    window_numbers,
)
from cosim.diagnosis.residuals.finding import Finding, lacking, learn_noise
from cosim.diagnosis.thresholds import CALIBRATED_TRUST
from cosim.diagnosis.verdict.verdict import Cause, adequate, cause_of
from cosim.errors import DataError, UsageError
from cosim.inference.between import combined
from cosim.inference.held_out import HeldOutGain
from cosim.inference.linear import Sections, columns
from cosim.logs import Log, Tracker
from cosim.rig import Noise, make_log
from cosim.rig.write import as_log
from fmus import registry
from fmus.contract import Effect

VALVE, _, MECHANICS = MODELS["full_order"]
FRICTION = "mechanical.coulomb_friction"
H = 1e-3


def log(seed: int, *hidden: str, noise: float = 1.0, start: float = 15.0, seconds: float = 20.0) -> Log:
    """A log of steps with noise of `noise` times the usual size, from a start angle in degrees."""
    made = make_log(
        "steps", seconds, hidden, seed=seed, noise=Noise(scale=noise), start=float(np.deg2rad(start))
    )
    return as_log(made)


def record(seed: int, *hidden: str, **options: float) -> Record:
    """The same, prepared."""
    return prepare(log(seed, *hidden, **options), our_machine("full_order"))


def with_friction(record: Record) -> Finding:
    """Dry friction named in a record of mechanics of which no number is trusted."""
    task = task_for(MECHANICS, record, [])
    null = nominal(task, record, CALIBRATED_TRUST)
    effect = registry.effects()[FRICTION]
    return Finding(task, null, tried(task, (effect,), CALIBRATED_TRUST, null.fit), free=True)


@pytest.fixture(scope="module")
def pair() -> list[Record]:
    """Two logs that hide friction of 25 N m, the second with three times the noise and from another angle."""
    return [
        record(1, f"{FRICTION}:tau_c=25", noise=0.7, start=5.0),
        record(2, f"{FRICTION}:tau_c=25", noise=2.1, start=40.0),
    ]


@pytest.fixture(scope="module")
def clean() -> list[Record]:
    """Two logs that hide nothing, with noise of different sizes, from different angles."""
    return [record(3, noise=0.5, start=5.0), record(4, noise=2.0, start=40.0)]


def test_one_log_is_itself(clean: list[Record]) -> None:
    """Bit for bit, also where it is written as the only piece of several."""
    assert joined(clean[:1]) is clean[0]
    alone = clean[0]
    piece = replace(alone, grid=Pieces((alone.time.size,), (alone.h,), (None,)))
    tasks = [task_for(MECHANICS, r, []) for r in (alone, piece)]
    one, other = (tried(task, (), 0.01).fit for task in tasks)
    assert one.values == other.values
    assert one.log_likelihood == other.log_likelihood
    np.testing.assert_array_equal(one.rows, other.rows)


def test_each_log_is_simulated_from_its_own_start(pair: list[Record]) -> None:
    whole = joined(pair)
    assert whole.cuts == (pair[0].time.size,)
    fixed = fixed_values(whole, MECHANICS)
    assert fixed["mechanical.theta_0"] == pytest.approx(np.deg2rad(5.0), abs=1e-3)
    assert fixed["mechanical.theta_0@1"] == pytest.approx(np.deg2rad(40.0), abs=1e-3)
    found = GroupModel(MECHANICS, whole.signals["p_load"], whole.h, fixed, whole.grid).simulate({})
    alone = [
        GroupModel(MECHANICS, r.signals["p_load"], r.h, fixed_values(r, MECHANICS)).simulate({}) for r in pair
    ]
    np.testing.assert_array_equal(found["slew"], np.concatenate([a["slew"] for a in alone]))


def test_filters_and_rates_do_not_see_across_a_seam(pair: list[Record]) -> None:
    whole = joined(pair)
    for of in ("smooth", "rate", "lost", "fresh"):
        apart = np.concatenate([getattr(r, of)("slew") for r in pair])
        np.testing.assert_array_equal(getattr(whole, of)("slew"), apart)
    for own, back in zip(pair, whole.pieces, strict=True):
        np.testing.assert_array_equal(own.signals["slew"], back.signals["slew"])
        np.testing.assert_array_equal(own.time, back.time)


def test_irregular_logs_keep_their_own_stamps() -> None:
    rng = np.random.default_rng(1)
    records = []
    for count in (400, 300):
        time = np.cumsum(rng.uniform(0.045, 0.062, count))
        grid, h = grid_of(time, 0.01)
        records.append(Record(h, {"u": rng.normal(size=count), "slew": np.zeros(count)}, grid))
    whole = joined(records)
    assert isinstance(whole.grid, Pieces)
    assert np.all(np.diff(whole.time) > 0.0)
    np.testing.assert_allclose(np.diff(whole.time[400:]), np.diff(records[1].time))
    rows = [np.sin(r.grid.time) for r in records if isinstance(r.grid, Grid)]
    expected = [r.grid.sampled(row) for r, row in zip(records, rows, strict=True) if r.grid is not None]
    np.testing.assert_array_equal(whole.grid.sampled(np.concatenate(rows)), np.concatenate(expected))


def test_logs_of_different_intervals_are_refused() -> None:
    records = [Record(h, {"u": np.zeros(100)}) for h in (1e-3, 2e-3)]
    with pytest.raises(DataError, match="every 1 ms, 2 ms: diagnosed together they must have one interval"):
        joined(records)


def test_windows_lie_within_one_log_and_skip_the_start_of_each() -> None:
    rule = plain(2, 5, False, skip=3, cuts=(27,))
    numbers = rule.layout.numbers(60)
    assert np.all(numbers[[0, 1, 2, 27, 28, 29]] == -1)
    assert np.all(numbers[3:23] == np.repeat([0, 1], 10))
    assert np.all(numbers[23:27] == -1)
    assert np.all(numbers[30:60] == np.repeat([2, 3, 4], 10))
    assert rule.log_of(60).tolist() == [0, 0, 1, 1, 1]
    np.testing.assert_allclose(rule.windows(numbers.astype(float)).mean(axis=1), np.arange(5))


def test_noise_has_one_spectrum_and_a_size_in_each_log() -> None:
    count, sizes = 30_000, (1e-4, 4e-4)
    noise = np.concatenate(
        [s * Noise(kind="ar1", correlation_time=0.05).draw("slew", count, i) for i, s in enumerate(sizes)]
    )
    drift = np.linspace(0.0, 1.0, 2 * count)
    rule = learned(plain(10, 495, True, cuts=(count,)), noise, [drift, np.sin(20.0 * drift)])
    # 2970 values in each log: sizes are known to 1.3 %, and the spectrum's part they share
    assert rule.scales[1] / rule.scales[0] == pytest.approx(4.0, rel=0.06)
    white, log_of = rule(noise), rule.log_of(noise.size)
    for i in range(2):
        assert np.mean(white[log_of == i] ** 2) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("group", [VALVE, MECHANICS])
def test_a_seam_leaves_nothing(group: Group, clean: list[Record]) -> None:
    """A jump of the command, of the angle or of the noise from log to log is nothing systematic."""
    whole = joined(clean)
    task = task_for(group, whole, [])
    learn_noise(task, whole, tried(task, (), 0.01).fit)
    assert not lacking(task, whole, tried(task, (), 0.01).fit)


@pytest.mark.slow
@pytest.mark.parametrize("group", [VALVE, MECHANICS])
def test_a_clean_pair_is_adequate(group: Group, clean: list[Record]) -> None:
    whole = joined(clean)
    finding = find(task_for(group, whole, []), whole)
    assert finding.chosen.effects == ()
    assert adequate(finding)


def test_two_logs_know_a_hidden_effect_better_than_one(pair: list[Record]) -> None:
    effect = registry.effects()[FRICTION]
    known = []
    for r in (*pair, joined(pair)):
        task = task_for(MECHANICS, r, [])
        begin = tried(task, (effect,), 0.01).fit
        task.set_rules({s: learned(rule, begin.residuals[s], []) for s, rule in task.rules.items()})
        found = tried(task, (effect,), 0.01, begin).fit
        known.append((found.values["mechanical.tau_c"], found.deviations["mechanical.tau_c"]))
    first, second, both = known
    assert both[1] < first[1] < second[1]
    assert abs(both[0] - 25.0) < 3.0 * both[1]
    # each log at its own noise: both know what the one and the other know, and share the inertia; 5 % for the noise learned
    assert both[1] ** -2 > 0.95 * (first[1] ** -2 + second[1] ** -2)


def test_each_log_is_held_out_in_turn(pair: list[Record]) -> None:
    (fitted, held), (other, first) = each_left_out(joined(pair))
    np.testing.assert_array_equal(fitted.signals["slew"], pair[1].signals["slew"])
    np.testing.assert_array_equal(held.signals["slew"], pair[0].signals["slew"])
    np.testing.assert_array_equal(other.signals["slew"], pair[0].signals["slew"])
    np.testing.assert_array_equal(first.signals["slew"], pair[1].signals["slew"])
    assert each_left_out(pair[0]) == []


@pytest.mark.parametrize("estimator", [refitted, onward])
def test_a_log_left_out_by_one_step_errs_as_one_that_was_not_fitted(
    pair: list[Record], estimator: Callable[..., Fit]
) -> None:
    """One Gauss-Newton step from the fit to both logs, against fitting the other log alone."""
    effect, record = registry.effects()["mechanical.coulomb_friction"], joined(pair)

    def found(record: Record) -> tuple[Finding, Fit]:
        finding = with_friction(record)
        return finding, estimator(finding, (effect,), CALIBRATED_TRUST, finding.chosen.fit)

    finding, both = found(record)
    each = left_out_errors(finding, (effect,), both, "slew", CALIBRATED_TRUST, estimator is onward)
    fitted = np.split(both.residuals["slew"], record.cuts)
    left_out = each_left_out(record)[:1]
    for own, inside, (other, held) in zip(each, fitted, left_out, strict=False):
        alone, fit = found(other)
        assert rms(own) == pytest.approx(rms(errors(alone, fit, held)["slew"]), rel=0.15)
        # the free run is what the one estimator makes smallest; of the other it is no more than about as small
        assert rms(own) > (1.0 if estimator is refitted else 0.99) * rms(inside)


def test_a_quarter_of_one_log_is_left_out_as_a_log_is_of_several() -> None:
    alone, two = plain(2, 5, False, skip=3), plain(2, 5, False, skip=3, cuts=(27,))
    assert fold_of(alone, 109).tolist() == [0, 0, 0, 1, 1, 2, 2, 2, 3, 3]
    assert fold_cuts(alone, 109) == (33, 53, 83)
    numbers = alone.layout.numbers(109)
    for i, part in enumerate(np.split(numbers, fold_cuts(alone, 109))):
        inside = part[part >= 0]
        assert np.all(fold_of(alone, 109)[inside] == i)
    assert fold_of(two, 60).tolist() == two.log_of(60).tolist()
    assert fold_cuts(two, 60) == (27,)
    walked = fold_numbers({"slew": alone}, 109, walked=True)
    assert walked.tolist() == [*np.repeat(fold_of(alone, 109), 5), *fold_of(alone, 109)[:-1]]


def test_a_log_of_a_few_windows_judges_nothing_by_its_quarters() -> None:
    rule, record = plain(2, 5, False), Record(H, {"u": np.zeros(79)})
    assert each_in_turn(record, rule, CALIBRATED_TRUST) is None
    longer = Record(H, {"u": np.zeros(80)})
    held = each_in_turn(longer, rule, CALIBRATED_TRUST)
    assert held is not None
    assert held.in_turn
    assert each_in_turn(longer, rule, 0.01) is None  # what is trusted judges by windows


@pytest.mark.parametrize("estimator", [refitted, onward])
def test_a_quarter_left_out_by_one_step_errs_as_one_that_was_not_fitted(
    pair: list[Record], estimator: Callable[..., Fit]
) -> None:
    """The step from the fit to all of one log, against a fit to the windows of its other quarters."""
    record, finding = pair[0], with_friction(pair[0])
    task, (effect,) = finding.task, finding.chosen.effects
    whole = estimator(finding, (effect,), CALIBRATED_TRUST, finding.chosen.fit)
    walked = estimator is onward
    each = left_out_errors(finding, (effect,), whole, "slew", CALIBRATED_TRUST, walked)
    assert sum(e.size for e in each) == record.time.size
    rule = task.rules["slew"]
    others = fold_of(rule, record.time.size) != 3
    cut = fold_cuts(rule, record.time.size)[-1]
    alone = refitted(finding, (effect,), CALIBRATED_TRUST, finding.chosen.fit, mask=others)
    assert rms(each[3]) == pytest.approx(rms(alone.residuals["slew"][cut:]), rel=0.3 if walked else 0.15)


def test_a_step_that_leads_astray_is_not_taken(pair: list[Record], monkeypatch) -> None:
    """Far from where it was taken a straight line says nothing: without a quarter the others would be described worse."""
    record, finding = pair[0], with_friction(pair[0])
    task, (effect,) = finding.task, finding.chosen.effects
    fit = refitted(finding, (effect,), CALIBRATED_TRUST, finding.chosen.fit)
    inside = np.split(fit.residuals["slew"], fold_cuts(task.rules["slew"], record.time.size))
    monkeypatch.setattr(
        causes, "steps_without", lambda rows, slopes, block: np.full((4, slopes.shape[1]), 40.0)
    )
    each = left_out_errors(finding, (effect,), fit, "slew", CALIBRATED_TRUST, False)
    for own, fitted in zip(each, inside, strict=True):
        np.testing.assert_allclose(own, fitted)


def test_of_logs_of_one_window_nothing_goes_on_to_the_next() -> None:
    """Two short motions, as robots are recorded: the fit in windows is all there is, and each log can be left out."""
    effect = registry.effects()["mechanical.coulomb_friction"]
    both = joined(
        [record(seed, "mechanical.coulomb_friction:tau_c=25 N.m", seconds=5.0) for seed in (31, 32)]
    )
    finding = with_friction(both)
    found = onward(finding, (effect,), CALIBRATED_TRUST, finding.chosen.fit)
    assert found.values["mechanical.tau_c"] == pytest.approx(
        finding.chosen.fit.values["mechanical.tau_c"], rel=0.02
    )
    each = left_out_errors(finding, (effect,), found, "slew", CALIBRATED_TRUST, True)
    assert len(each) == 2
    assert np.isfinite(np.concatenate(each)).all()


def test_of_several_logs_each_is_left_out_as_one(pair: list[Record]) -> None:
    """Windows of one log have its temper in common: the log is the repetition."""
    group = MODELS["full_order"][1]
    task, alone = task_for(group, joined(pair), []), task_for(group, pair[0], [])
    found = repetitions(task)
    assert found.shape == window_numbers(task).shape
    assert np.unique(found).tolist() == [0, 1]
    assert repetitions(alone).tolist() == window_numbers(alone).tolist()


def test_held_out_windows_of_the_gain_are_those_of_the_fits(pair: list[Record]) -> None:
    whole, window = joined(pair), 4990
    own = Windows(window, 0, whole.cuts).numbers(whole.time.size)
    y = whole.signals["slew"]
    inside = (own % 3 == 2) & (own >= 0)
    exact = {"slew": np.where(inside, y, y + 1.0)}
    gain = measure(whole, {"slew": y + 1.0}, exact, window)["slew"]
    assert gain.before == pytest.approx(1.0)
    assert gain.after == 0.0


def test_a_linear_reference_begins_anew_in_each_log() -> None:
    u = np.random.default_rng(1).normal(size=500)
    sections = Sections((2.0,), ((5.0, 0.3),), 0.02)
    driven, free = columns(sections, u, 0.01, 5.0, (200,))
    alone = [columns(sections, part, 0.01, 5.0) for part in (u[:200], u[200:])]
    np.testing.assert_array_equal(driven, np.concatenate([d for d, _ in alone], axis=1))
    assert free.shape == (6, 500)
    first, second = free[:, :200].any(axis=1), free[:, 200:].any(axis=1)
    assert first.sum() == second.sum() == 3
    assert not (first & second).any()


@pytest.mark.parametrize("scatter", [0.0, 0.05, 0.1, 0.3])
@pytest.mark.parametrize("logs", [2, 3, 5])
def test_intervals_between_logs_hold(logs: int, scatter: float) -> None:
    """Of the machine's value, 10, and of the next log's, where logs differ by up to a third of that."""
    rng, repeats, size = np.random.default_rng(7), 500, 10.0
    deviations = np.geomspace(0.3, 0.6, logs)
    weights = deviations**-2 / np.sum(deviations**-2)
    inside = np.zeros(2)
    for _ in range(repeats):
        values = size + rng.normal(size=logs) * deviations + scatter * size * rng.normal(size=logs)
        told = float(weights @ values)
        found = combined(told, float(np.sum(deviations**-2) ** -0.5), values, deviations, abs(told))
        following = size + rng.normal() * float(np.median(deviations)) + scatter * size * rng.normal()
        pairs = ((found.ci95, size), (found.next_ci95, following))
        inside += [low < value < high for (low, high), value in pairs]
    # 90 % wanted; 500 repeats know it to 1.3 %
    assert np.all(inside / repeats > 0.87)


def regression(columns: np.ndarray, rows: np.ndarray, names: tuple[str, ...]) -> Fit:
    """Least squares of rows (n,) by columns (n, k) as a fit: its residuals have the slopes -columns."""
    found = np.linalg.lstsq(columns, rows, rcond=None)[0]
    left = rows - columns @ found
    covariance = np.linalg.inv(columns.T @ columns)
    values = dict(zip(names, found.tolist(), strict=True))
    deviations = dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    scales = dict.fromkeys(names, 1.0)
    return Fit(values, deviations, 0.0, left.size, {}, covariance, slopes=-columns, rows=left, scales=scales)


def test_where_each_log_draws_a_parameter_is_what_a_fit_to_that_log_alone_gives() -> None:
    rng = np.random.default_rng(4)
    x, log = rng.normal(size=300), np.repeat([0, 1, 2], 100)
    x[log == 2] = 0.0  # it says nothing
    y = np.where(log == 0, 2.0, 2.5) * x + rng.normal(size=300)
    told = over_logs(regression(x[:, None], y, ("a.k",)), log, lambda _: 0.0)["a.k"]
    for one in (0, 1):
        mine = log == one
        assert told.values[one] == pytest.approx(float(x[mine] @ y[mine] / (x[mine] @ x[mine])))
        assert told.deviations[one] == pytest.approx(float((x[mine] @ x[mine]) ** -0.5))
    assert np.isinf(told.deviations[2])
    assert over_logs(regression(x[:, None], y, ("a.k",)), np.zeros(300, dtype=np.int64), lambda _: 0.0) == {}


def test_logs_that_tell_two_parameters_only_together_do_not_lose_their_way() -> None:
    """One step each, to two speeds: a gain and a dead zone, of which neither log alone knows anything."""
    rng = np.random.default_rng(5)
    log = np.repeat([0, 1], 100)
    columns = np.stack([np.where(log == 0, 0.5, 0.9), -np.ones(200)], axis=1)
    rows = columns @ np.array([10.0, 3.0]) + 0.1 * rng.normal(size=200)
    told = over_logs(regression(columns, rows, ("a.gain", "a.zone")), log, lambda _: 0.0)
    for name, true in (("a.gain", 10.0), ("a.zone", 3.0)):
        low, high = told[name].ci95
        assert 0.0 < low < true < high
        assert np.all(np.abs(told[name].values - true) < 0.5 * true)


def test_a_size_that_the_next_log_may_not_have_is_no_cause() -> None:
    friction = registry.effects()[FRICTION]
    cause = Cause(friction, "mechanical", {"tau_c": (20.0, 1.0)}, 100.0, HeldOutGain(10.0, 1.0), [], [])
    model = SimpleNamespace(nominal=lambda _: 0.0)
    for values, wanted in (((20.0, 21.0), False), ((60.0, -20.0), True)):
        told = combined(20.0, 1.0, np.array(values), np.array([1.4, 1.4]), 20.0)
        found = SimpleNamespace(between={"mechanical.tau_c": told})
        assert none_between_logs(found, cause, model) == wanted  # type: ignore[arg-type]
    assert not none_between_logs(SimpleNamespace(between={}), cause, model)  # type: ignore[arg-type]


def test_a_cause_whose_size_the_logs_draw_apart_is_told_with_its_figures(pair: list[Record]) -> None:
    """It went without a word, and the block was said to be explained by no effect of the library."""
    joint = joined(pair)
    finding = with_friction(joint)
    finding = finding.accept(finding.chosen, joint)
    machine = our_machine("full_order")
    found = Diagnosis("interrupted", joint, machine, (MECHANICS,))
    (effect,) = finding.chosen.effects
    found.findings, found.causes = {"mechanical": finding}, [cause_of(finding, effect, CALIBRATED_TRUST)]
    found.values = machine.values | finding.chosen.fit.values
    found.between = {
        "mechanical.tau_c": combined(20.0, 1.0, np.array([60.0, -20.0]), np.array([1.4, 1.4]), 20.0)
    }
    assert untenable_taken_back(found, CALIBRATED_TRUST)
    assert found.causes == []
    (refused,) = found.refused
    assert refused.effect == effect
    assert not refused.sure
    assert refused.with_it < refused.without


GROUP = SimpleNamespace(name="mechanical")


def fitted(**slopes: float) -> dict[str, object]:
    """A finding of the group whose fit has such a slope along each parameter."""
    fit_ = SimpleNamespace(values=slopes, slopes=np.array([list(slopes.values())]), count=1, deviations={})
    return {GROUP.name: SimpleNamespace(chosen=SimpleNamespace(fit=fit_))}


STRIBECK, STOP, DELAY = (
    registry.effects()[n] for n in ("mechanical.stribeck_friction", "mechanical.end_stop", "dcv.delay")
)


@pytest.mark.parametrize(
    ("deviations", "correlation", "named"),
    [
        # of a motor whose friction was "0 to 17" of its full torque
        ({"mechanical.tau_c": 60.0, "mechanical.tau_s": 50.0, "dcv.tau_d": 1e-3}, 0.0, [STRIBECK]),
        # level and peak make up for one another, and are sure together
        ({"mechanical.tau_c": 60.0, "mechanical.tau_s": 50.0, "dcv.tau_d": 1e-3}, -0.99, []),
        # of two the one that the log says least of goes first
        ({"mechanical.tau_c": 60.0, "mechanical.tau_s": 50.0, "dcv.tau_d": 0.5}, 0.0, [DELAY]),
        # what was not estimated says nothing against a name
        ({}, 0.0, []),
    ],
)
def test_a_cause_whose_size_may_be_none_goes(
    deviations: dict[str, float], correlation: float, named: list[Effect]
) -> None:
    found = SimpleNamespace(
        values={
            "mechanical.tau_c": 100.0,
            "mechanical.tau_s": 80.0,
            "mechanical.omega_s": 0.01,
            "dcv.tau_d": 0.02,
        },
        deviations=deviations,
        correlations={("mechanical.tau_c", "mechanical.tau_s"): correlation},
        findings=fitted(),
        between={},
    )
    model = SimpleNamespace(nominal=lambda name: 0.0, group=GROUP)
    assert least_sure(found, [STRIBECK, DELAY], model) == named  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("windows", "between", "kept"), [(0.1, False, True), (0.6, False, False), (0.6, True, True)]
)
def test_the_interval_that_is_told_decides_whether_a_size_may_be_none(
    windows: float, between: bool, kept: bool
) -> None:
    """A soft arm's valve: a shifted neutral of "4 % of full command, -6 to 14" was named; the whole's own was 2.5 to 6.4.

    Of several logs the interval between them is told, and that has been asked already.
    """
    offset = registry.effects()["dcv.offset"]
    findings = fitted(**{"dcv.x_0": 1e-3})
    findings["dcv"] = findings.pop(GROUP.name)
    findings["dcv"].chosen.fit.deviations["dcv.x_0"] = windows  # type: ignore[attr-defined]
    found = SimpleNamespace(
        values={"dcv.x_0": 0.9},
        deviations={"dcv.x_0": 0.1},
        correlations={},
        findings=findings,
        between={"dcv.x_0": None} if between else {},
    )
    model = SimpleNamespace(nominal=lambda name: 0.0, group=SimpleNamespace(name="dcv"))
    assert (least_sure(found, [offset], model) == []) == kept  # type: ignore[arg-type]


def test_a_size_beyond_which_nothing_changes_is_not_held_against_its_cause() -> None:
    """Friction that holds a drive: beyond its torque any size says the same, and its deviation is the search's."""
    level = registry.effects()["mechanical.coulomb_friction"]
    model = SimpleNamespace(nominal=lambda name: 0.0, group=GROUP)
    sizes = {"mechanical.tau_c": 300.0}, {"mechanical.tau_c": 150.0}
    for slope, named in ((0.0, []), (1e-3, [level])):
        findings = fitted(**{"mechanical.tau_c": slope})
        found = SimpleNamespace(
            values=sizes[0], deviations=sizes[1], correlations={}, findings=findings, between={}
        )
        assert least_sure(found, [level], model) == named  # type: ignore[arg-type]


def test_what_ended_at_its_off_values_is_no_cause() -> None:
    """Of an end of the travel out of reach nothing is left, however well it is known to be there."""
    ends = {"mechanical.theta_max": 1e9, "mechanical.theta_min": -1e9}
    model = SimpleNamespace(nominal=ends.__getitem__, group=GROUP)
    for farthest, named in ((1e9, [STOP]), (0.3, [])):
        values = ends | {"mechanical.theta_max": farthest}
        deviations = dict.fromkeys(ends, 1e-3)
        found = SimpleNamespace(
            values=values, deviations=deviations, correlations={}, findings=fitted(), between={}
        )
        assert least_sure(found, [STOP], model) == named  # type: ignore[arg-type]


def test_a_limit_that_the_whole_log_meets_is_no_less_sure_for_windows_that_do_not() -> None:
    """An excavator's arm: its end stop of -38 deg (-48 to -29) was taken back, and a saturating sensor stood there."""
    ends = {"mechanical.theta_max": 1e9, "mechanical.theta_min": -1e9}
    model = SimpleNamespace(nominal=ends.__getitem__, group=GROUP)
    found = SimpleNamespace(
        values=ends | {"mechanical.theta_max": -0.67},
        deviations={"mechanical.theta_max": 0.05, "mechanical.theta_min": 0.1},
        correlations={},
        # the other end, out of reach in both, is where the windows' slopes say something by chance
        findings=fitted(**{"mechanical.theta_max": 0.0, "mechanical.theta_min": 1e-3}),
        between={},
    )
    assert least_sure(found, [STOP], model) == []  # type: ignore[arg-type]


def test_where_the_size_of_a_law_is_unsure_one_that_it_holds_may_take_its_place(
    pair: list[Record], clean: list[Record]
) -> None:
    """Of friction whose level and peak may each be none one level was left, and nothing was named: 64 mm in place of 4."""
    friction = registry.effects()[FRICTION]
    for record, kept in ((pair[0], (friction,)), (clean[0], ())):
        task = task_for(MECHANICS, record, [])
        null = nominal(task, record, 0.01)
        finding = Finding(task, null, tried(task, (STRIBECK,), 0.01, null.fit))
        assert with_less(finding, [STRIBECK], null, 0.01).effects == kept
        assert with_less(finding, [DELAY], null, 0.01) is null  # it holds no other


def test_two_logs_that_differ_by_a_sixth_still_tell_a_size() -> None:
    """Student's quantile of one degree of freedom would let the interval of any cause include none."""
    low, high = combined(0.42, 0.005, np.array([0.37, 0.47]), np.array([0.005, 0.005]), 0.42).ci95
    assert 0.0 < low < 0.35
    assert high > 0.49


def test_logs_that_agree_are_better_than_one_and_logs_that_say_nothing_do_not_count() -> None:
    agreeing = combined(5.0, 0.07, np.array([5.02, 4.98]), np.array([0.1, 0.1]), 5.0)
    alone = combined(5.0, 0.1, np.array([5.0]), np.array([0.1]), 5.0)
    assert alone.ci95 == pytest.approx((5.0 - 1.96 * 0.1, 5.0 + 1.96 * 0.1), abs=1e-4)
    unlike = combined(5.0, 0.07, np.array([4.0, 6.0, 99.0]), np.array([0.1, 0.1, 0.0]), 5.0)
    assert agreeing.scatter < 0.5 * unlike.scatter
    assert unlike.ci95[0] < 4.0
    assert unlike.ci95[1] - unlike.ci95[0] > 2.0 * (agreeing.ci95[1] - agreeing.ci95[0])
    assert np.isinf(unlike.deviations[2])


def test_a_tracker_goes_with_one_log() -> None:
    own = log(1)
    readings = own["slew"][::100]
    tracker = Tracker(own.time[::100], own.source, (), True, "", readings, np.ones(readings.size, dtype=bool))
    with pytest.raises(UsageError, match="an external tracker goes with one log"):
        diagnose([own, own], tracker=tracker)


@pytest.mark.slow
def test_two_logs_find_one_effect_and_intervals_that_hold_it() -> None:
    """The interval of the machine's value need not be tighter than one log's own: two logs hardly tell how it changes."""
    hidden = f"{FRICTION}:tau_c=25"
    logs = [log(1, hidden, noise=0.7, start=5.0), log(2, hidden, noise=2.1, start=40.0)]
    found = diagnose(logs)
    said = answer(found, logs, None)
    assert (said.verdict, [c.effect for c in said.causes]) == ("explained", [FRICTION])
    told = said.causes[0].parameters["tau_c"]
    assert told.ci95[0] < 25.0 < told.ci95[1]
    assert told.next_log_ci95 is not None
    assert told.next_log_ci95[0] < told.ci95[0] < told.ci95[1] < told.next_log_ci95[1]
    intervals = [own.ci95 for own in told.per_log if own.ci95 is not None]
    assert intervals
    assert all(low < 25.0 < high for low, high in intervals)
    # what is tighter with two logs is what their noise leaves unknown
    item = found.between["mechanical.tau_c"]
    assert all(item.within <= deviation**2 for deviation in item.deviations)
    assert any("20.001 s" in warning for warning in said.warnings)


def test_each_of_several_held_out_logs_has_its_own_error(pair: list[Record]) -> None:
    whole = joined(pair)
    y = whole.signals["slew"]
    off = np.where(np.arange(y.size) < whole.cuts[0], 1.0, 3.0)
    gain = measure(whole, {"slew": y + 2.0 * off}, {"slew": y + off}, 1000, 0)["slew"]
    assert gain.each == (pytest.approx((2.0, 1.0)), pytest.approx((6.0, 3.0)))


def test_a_held_out_log_shorter_than_a_window_still_tells_the_gain(pair: list[Record]) -> None:
    held = pair[0].until(700)
    y = held.signals["slew"]
    gain = measure(held, {"slew": y + 1.0}, {"slew": y + 0.5}, 5000, 0)["slew"]
    assert (gain.before, gain.after) == (pytest.approx(1.0), pytest.approx(0.5))
