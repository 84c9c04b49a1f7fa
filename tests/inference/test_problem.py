"""The core of a comparison of hypotheses: it knows functions of values, and neither machines nor FMUs."""

from contextlib import contextmanager

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from cosim.errors import SimulationError
from cosim.inference.freeform import explained
from cosim.inference.noise import Noise
from cosim.inference.problem import ABOUT, Problem
from cosim.inference.unknowns import Unknown

N = 3000
T = 0.01 * np.arange(N)
U = np.sin(T) + 0.5 * np.sin(3.7 * T)
WINDOW = (np.arange(N) * 30 // N).astype(np.int64)
FITTED = WINDOW % 3 != 1
GAIN = Unknown("gain", -5.0, 5.0, 0.3)


def model(values):
    """A gain that cannot be run beyond 3."""
    if values.get("gain", 1.0) > 3.0:
        raise SimulationError("component 'part' fell over")
    return {"y": values.get("gain", 1.0) * U}


def problem(rng, gain=1.2, shift=0.0, noise=0.01):
    """Data of the gain, read late by a share of a sample."""
    y = gain * np.interp(T - 0.01 * shift, T, U) + noise * rng.standard_normal(N)
    made = Problem({"y": y}, {"y": FITTED}, {"y": WINDOW}, model, {"y": 1e-4})
    made.noise["y"] = Noise(noise**2)
    return made


def test_an_estimate_lies_in_its_interval_as_often_as_it_says() -> None:
    inside = 0
    for seed in range(40):
        fit = problem(np.random.default_rng(seed)).fit([GAIN], {"gain": 1.0})
        inside += abs(fit.values["gain"] - 1.2) < 1.96 * fit.deviation("gain")
        # what white noise leaves open; the scatter of twenty windows makes it a little larger
        assert fit.deviation("gain") == pytest.approx(0.01 / np.sqrt(np.sum(U[FITTED] ** 2)), rel=0.5)
    assert 33 <= inside <= 40  # 95 % of 40 is 38


def test_the_likelihood_is_that_of_the_fitted_part_and_of_what_is_believed() -> None:
    made = problem(np.random.default_rng(8))
    rows = made.rows({"gain": 1.1})
    plain = -0.5 * float(np.sum(rows[FITTED] ** 2))
    assert made.log_likelihood(rows, {"gain": 1.1}, [GAIN]) == pytest.approx(plain)
    believed = Unknown("gain", -5.0, 5.0, 0.3, 0.02)  # of zero, unless another centre is named
    assert made.log_likelihood(rows, {"gain": 1.1}, [believed]) == pytest.approx(plain - 0.5 * 55.0**2)
    centred = Unknown("gain", -5.0, 5.0, 0.3, 0.02, 1.06)
    assert made.log_likelihood(rows, {"gain": 1.1}, [centred]) == pytest.approx(plain - 0.5 * 2.0**2)


def test_before_anything_is_learned_residuals_are_of_the_least_noise_and_no_nuisance_takes_of_them() -> None:
    made = Problem({"y": 1.5 * U}, {"y": FITTED}, {"y": WINDOW}, model, {"y": 1e-3})
    assert made.residuals({"gain": 1.0})["y"] == pytest.approx(0.5 * U)
    assert made.rows({"gain": 1.0}) == pytest.approx(0.5 * U / 1e-3)
    assert made.nuisances({}) == {}
    assert made.fit((), {"gain": 1.0}).covariance.shape == (0, 0)


def test_what_is_believed_of_a_nuisance_holds_it_back_as_it_does_in_least_squares() -> None:
    """Noise of 0.2 over two thousand values, against a belief of 0.01: it goes most of the way and not all of it."""
    noise, prior = 0.2, 0.01
    y = U + 0.03 * np.cos(T) + noise * np.random.default_rng(12).standard_normal(N)
    made = Problem({"y": y}, {"y": FITTED}, {"y": WINDOW}, model, {"y": 1e-4})
    made.noise["y"] = Noise(noise**2)
    made.share([Unknown("n", -1.0, 1.0, 1.0, prior)], {"y": np.cos(T)[None]})
    column, rest = np.cos(T)[FITTED] / noise, (y - U)[FITTED] / noise
    best = column @ rest / (column @ column + prior**-2)
    assert 0.6 < best / (column @ rest / (column @ column)) < 0.8
    assert made.nuisances({})["n"] == pytest.approx(best, rel=1e-6)


def test_a_value_at_which_the_model_fails_is_refused_with_its_words() -> None:
    made = problem(np.random.default_rng(1))
    assert made.rows({"gain": 4.0}) is None
    assert made.failures == ["component 'part' fell over"]
    assert made.fit([GAIN], {"gain": 4.0}) is None
    assert made.fit([GAIN], {"gain": 1.0}).values["gain"] == pytest.approx(1.2, rel=0.01)


def test_a_nuisance_is_taken_out_within_its_bounds_only() -> None:
    late = Unknown("late", -1.0, 1.0, 1.0, 0.7)
    for shift, gone in ((0.5, True), (8.0, False)):
        made = problem(np.random.default_rng(2), 1.0, shift, 1e-3)
        made.share([late], {"y": -np.gradient(U)[None, :]})
        left = made.residuals({})["y"]
        assert (float(np.std(left)) < 2e-3) is gone
        assert made.rows({})[-1] == pytest.approx(min(shift, 1.0) / 0.7, rel=0.1)


def test_values_that_have_moved_a_nuisance_already_are_judged_as_by_its_slope_where_the_model_is_linear() -> (
    None
):
    """The same rows, the whole of what was moved held against its prior and its bounds."""
    noise, key = 0.01, ABOUT + "n"
    y = U + 0.9 * np.sin(T) + noise * np.random.default_rng(6).standard_normal(N)
    made = Problem(
        {"y": y}, {"y": FITTED}, {"y": WINDOW}, lambda v: {"y": U + v.get(key, 0.0) * np.sin(T)}, {"y": 1e-4}
    )
    made.noise["y"] = Noise(noise**2)
    for bound in (2.0, 0.5):
        made.share([Unknown("n", -bound, bound, 1.0, 0.3)], {"y": np.sin(T)[None]})
        for moved in (0.4, 1.1):
            assert made.rows({key: moved}) == pytest.approx(made.rows({}), abs=1e-6)
            assert made.residuals({key: moved})["y"] == pytest.approx(made.residuals({})["y"], abs=1e-9)
            assert made.nuisances({key: moved})["n"] == pytest.approx(min(0.9, bound), abs=0.01)


def test_nuisances_beside_one_at_its_bound_are_those_of_bounded_least_squares() -> None:
    rng = np.random.default_rng(6)
    slopes = np.stack([np.sin(T), np.sin(T) + 0.3 * np.cos(2.0 * T), np.ones(N)])
    noise = 0.01
    y = U + np.array([0.9, 0.4, -0.2]) @ slopes + noise * rng.standard_normal(N)
    made = Problem({"y": y}, {"y": FITTED}, {"y": WINDOW}, model, {"y": 1e-4})
    made.noise["y"] = Noise(noise**2)
    bounds = [(-0.5, 0.5), (-2.0, 2.0), (-2.0, 2.0)]  # the first is wanted beyond
    prior = 3.0
    made.share([Unknown(f"n{k}", *b, 1.0, prior) for k, b in enumerate(bounds)], {"y": slopes})
    rows = np.concatenate([slopes[:, FITTED].T / noise, np.eye(3) / prior])
    target = np.concatenate([(y - U)[FITTED] / noise, np.zeros(3)])
    best = lsq_linear(rows, target, tuple(np.transpose(bounds)), tol=1e-12).x
    assert best[0] == pytest.approx(0.5)
    assert prior * made.rows({})[-3:] == pytest.approx(best, abs=1e-6)


def test_a_nuisance_of_data_held_out_is_estimated_there_and_sways_no_fit() -> None:
    """Two logs, the second held out: each is read late by a share of a sample of its own."""
    rng, noise = np.random.default_rng(9), 1e-3
    names, shifts = ("y", "z"), (0.2, -0.6)
    data = {
        n: 1.2 * np.interp(T - 0.01 * s, T, U) + noise * rng.standard_normal(N)
        for n, s in zip(names, shifts, strict=True)
    }
    fitted = {"y": np.ones(N, dtype=bool), "z": np.zeros(N, dtype=bool)}
    both = lambda values: dict.fromkeys(names, model(values)["y"])  # noqa: E731
    made = Problem(data, fitted, {"y": WINDOW, "z": WINDOW + 30}, both, dict.fromkeys(names, 1e-4))
    alone = Problem({"y": data["y"]}, {"y": fitted["y"]}, {"y": WINDOW}, model, {"y": 1e-4})
    slope, none = -1.2 * np.gradient(U)[None], np.zeros((1, N))
    late = [Unknown(f"late#{k}", -1.0, 1.0, 1.0, 0.7) for k in range(2)]
    for one, shared, slopes in (
        (made, late, {"y": np.concatenate([slope, none]), "z": np.concatenate([none, slope])}),
        (alone, late[:1], {"y": slope}),
    ):
        for n in slopes:
            one.noise[n] = Noise(noise**2)
        one.share(shared, slopes)
    fit, own = made.fit([GAIN], {"gain": 1.0}), alone.fit([GAIN], {"gain": 1.0})
    assert fit.values["gain"] == pytest.approx(own.values["gain"], rel=1e-9)
    assert fit.log_likelihood == pytest.approx(own.log_likelihood, rel=1e-9)
    assert list(made.nuisances(fit.values).values()) == pytest.approx(shifts, abs=0.05)
    assert np.std(made.residuals(fit.values)["z"]) == pytest.approx(noise, rel=0.1)
    assert made.pull(fit.rows) == pytest.approx(alone.pull(own.rows), rel=1e-9)


def test_what_a_nuisance_would_gain_if_nothing_were_believed_of_it_is_what_least_squares_give() -> None:
    rng, noise = np.random.default_rng(10), 0.01
    slopes = np.stack([np.sin(T), np.cos(2.0 * T), np.sin(T) + 0.5 * np.cos(5.0 * T)])
    y = U + np.array([2.0, 0.3, 0.2]) @ slopes + noise * rng.standard_normal(N)
    made = Problem({"y": y}, {"y": FITTED}, {"y": WINDOW}, model, {"y": 1e-4})
    made.noise["y"] = Noise(noise**2)
    believed = [Unknown(f"n{k}", -0.5, 0.5, 1.0, 0.2) for k in range(3)]
    made.share(believed, {"y": slopes})
    gains = made.freed({})
    here = made.fit((), {}).log_likelihood
    # the first is wanted far beyond its bound; the others stay within theirs when it is free
    free = [Unknown("n0", -np.inf, np.inf, 1.0, 1e9), *believed[1:]]
    made.share(free, {"y": slopes})
    assert gains["n0"] == pytest.approx(made.fit((), {}).log_likelihood - here, rel=0.05)
    assert gains["n0"] > 100.0 * gains["n1"]
    assert "n0" not in made.freed({"n0": 0.0})  # it is an unknown of the hypothesis itself


@pytest.mark.parametrize("runs", [1, 4])
def test_a_fit_that_is_hurried_ends_with_the_best_it_has(runs: int) -> None:
    made, asked = problem(np.random.default_rng(13)), []
    made.hurried = lambda: asked.append(True) or len(asked) > runs
    fit = made.fit([GAIN], {"gain": 1.0})
    if runs == 1:  # where it began, but for the distance that is kept to bounds
        assert fit.values["gain"] == pytest.approx(1.0)
    else:  # two runs for the slope, and a step: the model is linear
        assert fit.values["gain"] == pytest.approx(1.2, abs=0.01)
    assert fit.rows == pytest.approx(made.rows(fit.values))
    assert fit.deviation("gain") > 0.0


@pytest.mark.parametrize(("low", "high"), [(-5.0, 1.1), (1.3, 5.0), (0.999, 1.001)])
def test_the_model_is_never_run_beyond_the_bounds_of_an_unknown(low: float, high: float) -> None:
    """The estimate ends at a bound: its slope is taken on the other side, over half of a range that is narrower."""
    tried = []

    def watched(values):
        tried.append(values["gain"])
        return model(values)

    made = problem(np.random.default_rng(7))
    made.model = watched
    fit = made.fit([Unknown("gain", low, high, 0.3)], {"gain": 1.0})
    assert fit.values["gain"] == pytest.approx(np.clip(1.2, low, high), abs=1e-3)
    assert low <= min(tried) < max(tried) <= high


def test_held_out_windows_bear_a_true_gain_out_and_not_one_of_chance() -> None:
    made = problem(np.random.default_rng(3))
    with_gain, without = made.fit([GAIN], {"gain": 1.0}), made.fit((), {})
    assert made.held_out(with_gain.rows, without.rows).sure
    made = problem(np.random.default_rng(4), gain=1.0)
    with_gain, without = made.fit([GAIN], {"gain": 1.0}), made.fit((), {})
    assert not made.held_out(with_gain.rows, without.rows).sure


def test_a_free_function_tells_what_a_residual_depends_on_and_nothing_of_noise() -> None:
    rng = np.random.default_rng(5)
    other = rng.standard_normal(N // 50).repeat(50)
    found = explained(0.1 * U**2 + 0.02 * rng.standard_normal(N), {"u": U, "v": other}, FITTED, WINDOW, 0.01)
    assert found.sure
    assert found.after == pytest.approx(0.02, rel=0.1)
    assert max(found.by, key=lambda name: found.by[name]) == "u"
    noise = explained(0.02 * rng.standard_normal(N), {"u": U, "v": other}, FITTED, WINDOW, 0.01)
    assert noise.size < 0.2 * noise.before


def test_trusted_numbers_bent_to_their_limits_are_no_gain_of_the_poorer_on_windows_held_out() -> None:
    made = problem(np.random.default_rng(2), gain=1.06)
    made.share(
        [Unknown("trusted", -3.0, 3.0, 1.0, 1.0)], {"y": 0.02 * U[None]}
    )  # it makes up for the gain, at its limit
    poorer = made.fit((), {"gain": 1.0})
    richer = made.fit([GAIN], {"gain": 1.0})
    assert made.nuisances(poorer.values)["trusted"] == pytest.approx(3.0, abs=0.1)
    assert made.pull(poorer.rows) == pytest.approx(4.5, abs=0.3)
    gain = made.held_out(richer.rows, poorer.rows)
    assert gain.sure
    assert gain.gain == pytest.approx(4.5, abs=1.5)


def test_slopes_at_a_fit_are_those_of_what_was_fitted() -> None:
    made = problem(np.random.default_rng(3))
    fit = made.fit([GAIN], {"gain": 1.0})
    slopes = made.slopes(fit)
    np.testing.assert_allclose(slopes[FITTED, 0], -0.3 * U[FITTED] / 0.01, rtol=1e-6)
    assert not slopes[~FITTED].any()
    for low, high in ((-5.0, 1.1), (1.3, 5.0)):
        at_bound = made.fit([Unknown("gain", low, high, 0.3)], {"gain": 1.0})
        assert not made.slopes(at_bound).any()


def test_of_changes_that_do_the_same_the_largest_is_kept() -> None:
    made = problem(np.random.default_rng(3))
    late = np.gradient(U)
    changes = {
        "one": {"y": 0.1 * U},
        "same": {"y": 0.2 * U},
        "late": {"y": late},
        "sum": {"y": 0.1 * U + 0.1 * late},
    }
    assert made.apart(changes, 10.0) == ["same", "late"]
    # what is as small as the noise of the log shows by nothing
    assert made.apart({"faint": {"y": 1e-4 * U}}, 10.0) == []
    assert made.apart({}, 10.0) == []
    # a model that runs away with a number says nothing of it
    assert made.apart({"one": {"y": 0.1 * U}, "away": {"y": np.full(N, np.inf)}}, 10.0) == ["one"]


def test_a_number_is_spared_where_the_others_make_up_for_it() -> None:
    slope = np.linspace(0.0, 1.0, N)
    columns = {"a": U, "b": U + 0.001 * slope, "c": slope}
    made = problem(np.random.default_rng(4))
    made.model = lambda values: {"y": sum(values[n] * column for n, column in columns.items())}
    made.measured["y"] = 1.5 * U + 0.5 * slope + 0.01 * np.random.default_rng(4).standard_normal(N)
    unknowns = [Unknown(n, -5.0, 5.0, 0.2) for n in columns]
    nothing = dict.fromkeys(columns, 0.0)
    fit = made.fit(unknowns, {"a": 0.7, "b": 0.6, "c": 0.1}, 30)
    ((name, follow),) = made.spare(fit, nothing, 10.0)
    assert name in ("a", "b")
    # the model is linear: where the others are said to go they are at their best
    assert follow[name] == pytest.approx(0.0, abs=1e-9)
    fewer = made.fit([u for u in unknowns if u.name != name], follow, 30)
    assert fewer.values == pytest.approx(follow, abs=2e-3)
    assert fit.log_likelihood - fewer.log_likelihood < 10.0
    every = made.spare(fit, nothing, 1e9)
    assert {n for n, _ in every} == set(columns)
    assert all(v == pytest.approx(0.0, abs=1e-3) for v in every[-1][1].values())


def test_what_stays_wrong_passes_for_no_coloured_noise() -> None:
    made = problem(np.random.default_rng(6))
    slow = np.sin(0.2 * T)
    made.learn({"y": slow})
    assert made.noise["y"].times
    made.learn({"y": slow}, ["y"])
    assert made.noise["y"].times == ()
    # thirty windows count as independent
    assert made.noise["y"].rms ** 2 == pytest.approx(np.mean(slow**2) * N / 30, rel=0.2)


def test_fits_run_nothing_for_a_log_that_is_held_out() -> None:
    """Its rows are those of the last values all the same."""
    rng = np.random.default_rng(12)
    data = {n: 1.2 * U + 0.01 * rng.standard_normal(N) for n in ("fitted", "held")}
    run = {"fitted": 0, "held": 0}
    spared: set[str] = set()

    def two(values):
        found = {}
        for name in data:
            run[name] += name not in spared
            found[name] = data[name] if name in spared else values["gain"] * U
        return found

    @contextmanager
    def sparing(names):
        spared.update(names)
        yield
        spared.clear()

    fitted = {"fitted": np.ones(N, dtype=bool), "held": np.zeros(N, dtype=bool)}
    made = Problem(data, fitted, {"fitted": WINDOW, "held": WINDOW + 100}, two, dict.fromkeys(data, 1e-4))
    plain = made.fit([GAIN], {"gain": 1.0})
    made.sparing = sparing
    run.update(fitted=0, held=0)
    fit = made.fit([GAIN], {"gain": 1.0})
    assert (fit.values, fit.log_likelihood) == (plain.values, plain.log_likelihood)
    np.testing.assert_array_equal(fit.rows, plain.rows)
    assert run["held"] <= 2 < run["fitted"]
    with made.whole():
        run.update(fitted=0, held=0)
        made.fit([GAIN], {"gain": 1.0})
    assert run["held"] == run["fitted"], "the last estimate is by all logs"


def test_a_robust_fit_leads_out_of_an_optimum_in_which_all_errors_are_middling() -> None:
    """A drive with a dead zone integrates; without it the model runs away."""
    rng = np.random.default_rng(2)
    command = 0.3 + np.repeat(np.where(rng.random(40) < 0.6, 0.0, rng.uniform(-2.0, 2.2, 40)), 50)
    n = command.size

    def drive(v):
        over = v["up"] * np.maximum(command - v["high"], 0.0) + v["down"] * np.minimum(
            command - v["low"], 0.0
        )
        return {"y": 0.02 * np.cumsum(over)}

    true = {"high": 1.0, "low": -0.5, "up": 1.8, "down": 1.7}
    y = drive(true)["y"] + 0.01 * np.random.default_rng(3).standard_normal(n)
    made = Problem({"y": y}, {"y": np.ones(n, dtype=bool)}, {"y": np.arange(n) * 30 // n}, drive, {"y": 1e-4})
    made.noise["y"] = Noise(1e-4)
    unknowns = [Unknown("high", -1.0, 5.0, 0.04), Unknown("low", -5.0, 1.0, 0.04)]
    unknowns += [Unknown(name, 5e-3, 100.0, 1.0) for name in ("up", "down")]
    start = {"high": 0.2, "low": 0.1, "up": 5.0, "down": 5.0}
    plain, robust = (made.fit(unknowns, start, 25, robust=way) for way in (False, True))
    assert plain.log_likelihood < robust.log_likelihood - 1000.0
    rows = made.rows(robust.values)
    assert robust.log_likelihood == pytest.approx(-0.5 * float(rows @ rows)), (
        "of the values, whatever led to them"
    )
    fit = made.fit(unknowns, robust.values, 25)
    for name, value in true.items():
        assert fit.values[name] == pytest.approx(value, abs=0.01)


def test_with_some_nuisances_alone_the_others_take_nothing() -> None:
    made = problem(np.random.default_rng(4), gain=1.0, shift=0.5)
    slopes = np.stack([np.gradient(U), U])
    made.share([Unknown("shift", -1.0, 1.0, 1.0, 0.7), Unknown("size", -1.0, 1.0, 1.0, 1.0)], {"y": slopes})
    both = made.residuals({"gain": 0.9})["y"]
    with made.sharing(["shift"]):
        one = made.residuals({"gain": 0.9})["y"]
        assert [u.name for u in made.nuisances_shared] == ["shift"]
    assert np.std(both) == pytest.approx(0.01, rel=0.1)
    assert np.std(one) == pytest.approx(0.1 * np.std(U), rel=0.1)
    assert [u.name for u in made.nuisances_shared] == ["shift", "size"]


def test_of_changes_that_do_the_same_rounding_does_not_choose() -> None:
    """A neutral that moves is one dead zone larger and the other smaller: which of these two goes beside it is a rule."""
    up, down = np.maximum(U, 0.0), np.maximum(-U, 0.0)
    made = problem(np.random.default_rng(3))
    for tiny in (-1e-13, 0.0, 1e-13):  # what another unit of the log changes
        changes = {"dead_up": up * (1.0 + tiny), "dead_down": down, "neutral": down - up}
        changes = {n: {"y": c} for n, c in changes.items()}
        assert made.apart(changes, 6.0) == ["dead_up", "neutral"]
    assert made.apart({"one": {"y": up}, "other": {"y": down}}, 6.0) == ["one", "other"]
    assert made.apart({"one": {"y": 1e-6 * up}}, 6.0) == []


def test_unknowns_that_change_nothing_are_spared_without_a_loss() -> None:
    made = Problem({"y": U}, {"y": FITTED}, {"y": WINDOW}, lambda values: {"y": 0.0 * U}, {"y": 1e-3})
    unknowns = [GAIN, Unknown("idle", -5.0, 5.0, 0.3)]
    fit = made.fit(unknowns, {"gain": 1.0, "idle": 2.0})
    spared = made.spare(fit, {"gain": 0.5, "idle": 1.0}, 6.0)
    assert {name for name, _ in spared} == {"gain", "idle"}
    assert spared[-1][1] == pytest.approx({"gain": 0.5, "idle": 1.0})


def bent(rng):
    """A gain, a dead zone and a lag of an input: three unknowns, one of which bends the model."""
    made = []

    def three(values):
        made.append(dict(values))
        u = np.sign(U) * np.maximum(np.abs(U) - values["dead"], 0.0)
        lag = values["lag"]
        y = np.empty(N)
        y[0] = u[0]
        for k in range(1, N):
            y[k] = y[k - 1] + (u[k] - y[k - 1]) * 0.01 / (0.01 + lag)
        return {"y": values["gain"] * y}

    unknowns = [Unknown("gain", 0.1, 5.0, 0.3), Unknown("dead", 0.0, 1.0, 0.2), Unknown("lag", 0.0, 2.0, 0.2)]
    true = {"gain": 1.3, "dead": 0.15, "lag": 0.3}
    y = three(true)["y"] + 0.01 * rng.standard_normal(N)
    found = Problem({"y": y}, {"y": FITTED}, {"y": WINDOW}, three, {"y": 1e-4})
    found.noise["y"] = Noise(0.01**2)
    return found, unknowns, true, made


def test_with_slopes_that_are_known_roughly_a_fit_ends_where_others_end_with_half_of_their_runs() -> None:
    found, unknowns, true, made = bent(np.random.default_rng(2))
    start = {"gain": 1.1, "dead": 0.1, "lag": 0.4}
    made.clear()
    plain = found.fit(unknowns, start)
    runs = len({tuple(v.values()) for v in made})
    known = found.slopes(found.fit(unknowns, start, 1))
    made.clear()
    rough = found.fit(unknowns, start, roughly=known)
    assert len({tuple(v.values()) for v in made}) <= runs / 2
    assert rough.log_likelihood == pytest.approx(plain.log_likelihood, rel=1e-3)
    for name, value in true.items():
        assert rough.values[name] == pytest.approx(value, abs=0.02)
        assert rough.deviation(name) == pytest.approx(plain.deviation(name), rel=0.5)


def test_slopes_that_lead_nowhere_are_taken_anew() -> None:
    found, unknowns, true, _ = bent(np.random.default_rng(3))
    start = {"gain": 1.1, "dead": 0.1, "lag": 0.4}
    wrong = -found.slopes(found.fit(unknowns, start, 1))
    rough = found.fit(unknowns, start, roughly=wrong)
    for name, value in true.items():
        assert rough.values[name] == pytest.approx(value, abs=0.02)
