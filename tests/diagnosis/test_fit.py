"""Fits: intervals hold the truth as often as they say, priors pull, doubt counts as noise, held-out windows do not count."""

from typing import Any

import numpy as np
import pytest

from cosim.diagnosis.fitting import starts
from cosim.diagnosis.fitting.fit import Fit, Task, Unknown, fit
from cosim.diagnosis.fitting.noise import plain
from cosim.diagnosis.fitting.starts import fit_from_starts
from cosim.diagnosis.held_out.free_run import whole

X = np.linspace(-1.0, 1.0, 2000)
RULE = plain(1, 100, False)


class Parabola:
    """y = a x + c x^2, as the narrow interface that a fit sees."""

    def simulate(self, values: dict[str, float]) -> dict[str, np.ndarray]:
        """The signal y."""
        return {"y": values.get("m.a", 0.0) * X + values.get("m.c", 0.0) * X**2}


def task(measured: np.ndarray, **more: object) -> Task:
    """A task with unit white noise."""
    return Task(Parabola(), {"y": measured}, {"y": RULE}, **more)  # type: ignore[arg-type]


class Drive(Parabola):
    """y = x / b: a speed per command with the friction b."""

    def simulate(self, values: dict[str, float]) -> dict[str, np.ndarray]:
        """The signal y."""
        return {"y": X / values["m.b"]}


@pytest.mark.parametrize("truth", [2e-3, 0.05, 4.0, 900.0])
def test_a_guess_that_is_a_thousand_times_off_is_found(truth: float) -> None:
    """By the guess's own size each step of the search would end on a bound, or go on for ever."""
    guessed = Unknown("m.b", 2.0, 2.0, 1e-3, 2e3, ratio=True)
    drive = Task(Drive(), {"y": X / truth}, {"y": RULE})  # type: ignore[arg-type]
    found = fit(drive, [guessed], rounds=20)
    assert found.values["m.b"] == pytest.approx(truth, rel=1e-3)
    # slopes and deviation are told of the value itself, not of its logarithm
    spread = 1.0 / np.sqrt(np.sum((X / truth**2) ** 2))
    assert found.deviations["m.b"] == pytest.approx(spread, rel=1e-3)
    assert found.slopes is not None
    assert np.linalg.norm(found.slopes[:, 0]) == pytest.approx(2.0 / spread, rel=1e-3)


@pytest.mark.parametrize("away", [1e9, -1e9])
def test_a_limit_out_of_reach_does_not_end_the_search_of_the_others(away: float) -> None:
    """Steps were held against the length of all unknowns together, so that the first was the last."""
    limit = Unknown("m.theta_max", away, 0.1, -1e9, 1e9)
    drive = Task(Drive(), {"y": X / 0.05}, {"y": RULE})  # type: ignore[arg-type]
    found = fit(drive, [Unknown("m.b", 2.0, 2.0, 1e-3, 2e3, ratio=True), limit], rounds=20)
    assert found.values["m.b"] == pytest.approx(0.05, rel=1e-3)
    assert found.values["m.theta_max"] == away
    assert found.settled


def unknown(name: str, prior: tuple[float, float] | None = None) -> Unknown:
    """An unknown that starts at zero."""
    return Unknown(name, 0.0, 1.0, -50.0, 50.0, prior)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(200):
        found = fit(task(2.0 * X - X**2 + rng.normal(size=X.size)), [unknown("m.a"), unknown("m.c")])
        held += abs(found.values["m.a"] - 2.0) < 1.96 * found.deviations["m.a"]
    assert 180 <= held <= 199  # 190 expected, four standard deviations of the count are 12


def test_slopes_are_those_of_the_whitened_residual_and_of_the_priors() -> None:
    doubt = {"y": np.stack([np.sin(3.0 * X), X**3])}
    measured = task(2.0 * X - X**2, discrepancy=doubt)
    measured.set_rules(measured.rules)
    found = fit(measured, [unknown("m.a", (1.0, 0.5)), unknown("m.c")])
    assert found.slopes is not None
    for i, change in enumerate((-X, -(X**2))):
        np.testing.assert_allclose(found.slopes[:-1, i], measured.white({"y": change}), atol=1e-9)
    np.testing.assert_allclose(found.slopes[-1], [1.0 / 0.5, 0.0], atol=1e-12)


def test_a_prior_pulls_by_its_weight() -> None:
    exact = 1.0 / np.sum(X**2)
    found = fit(task(2.0 * X), [unknown("m.a", (1.0, np.sqrt(exact)))])
    assert found.values["m.a"] == pytest.approx(1.5, abs=1e-3)
    assert found.deviations["m.a"] == pytest.approx(np.sqrt(exact / 2.0), rel=1e-3)


@pytest.mark.parametrize("start", [0.0, 1e-9])
def test_a_bound_does_not_end_the_search(start: float) -> None:
    held = Unknown("m.a", start, 1.0, 0.0, 50.0)
    found = fit(task(-X - 2.0 * X**2), [held, Unknown("m.c", 1.0, 1.0, -50.0, 50.0)])
    assert found.values == pytest.approx({"m.a": 0.0, "m.c": -2.0}, abs=1e-6)
    assert found.at_bound == ("m.a",)


@pytest.mark.parametrize("lost", [np.nan, np.inf, -1e300])
@pytest.mark.parametrize("bins", [1, 4])
def test_what_leaves_the_numbers_is_bad_whatever_offsets_are_free(lost: float, bins: int) -> None:
    free = Task(Parabola(), {"y": X}, {"y": plain(bins, 50, True)})  # type: ignore[arg-type]
    near = free.white(free.residuals({"m.a": 40.0}))
    gone = free.white(free.against({"y": np.full(X.size, lost)}))
    assert np.all(np.isfinite(gone))
    assert float(gone @ gone) > 1e6 * float(near @ near)
    part = free.against({"y": np.where(X < 0.9, X, lost)})["y"]
    np.testing.assert_array_equal(part[X < 0.9], 0.0)


def test_doubt_along_a_direction_leaves_nothing_to_gain_there() -> None:
    unsure = task(5.0 * X)
    before = float(np.sum(unsure.white(unsure.residuals({})) ** 2))
    unsure.discrepancy = {"y": 100.0 * X[None, :]}
    unsure.set_rules(unsure.rules)
    after = float(np.sum(unsure.white(unsure.residuals({})) ** 2))
    assert after < 1e-2 * before
    other = X**2 - X @ X**2 / (X @ X) * X
    assert np.sum(unsure.white({"y": other}) ** 2) == pytest.approx(float(other @ other), rel=1e-6)


def test_windows_outside_the_mask_do_not_count() -> None:
    measured = 2.0 * X
    measured[1000:] += 100.0
    mask = np.arange(20) < 10
    assert fit(task(measured, mask=mask), [unknown("m.a")]).values["m.a"] == pytest.approx(2.0, abs=1e-6)


def test_starts_that_change_nothing_come_last() -> None:
    starts = {"m.a": (0.0, 9.0)}
    found = fit_from_starts(task(2.0 * X), [unknown("m.a")], starts, keep=1)
    assert found.values["m.a"] == pytest.approx(2.0, abs=1e-6)


def test_what_an_earlier_fit_drove_to_the_end_of_its_range_is_sought_from_where_it_was_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From an inertia next to nothing a search of few rounds does not come back."""
    begun: list[float] = []

    def followed(task: Task, unknowns: list[Unknown], **more: Any) -> Fit:
        begun.append(unknowns[0].start)
        return fit(task, unknowns, **more)

    monkeypatch.setattr(starts, "fit", followed)
    for start in (1e-3, 0.5, 9.0):
        wanted = [Unknown("m.a", start, 0.4, 1e-3, 9.0, (0.4, 9.0), ratio=True), unknown("m.c")]
        fit_from_starts(task(2.0 * X + 3.0 * X**2), wanted, {"m.c": (0.0, 1.0)})
    assert begun == [1e-3, 0.4, 0.5, 0.5, 9.0, 0.4]


def test_an_estimate_on_its_bound_says_so() -> None:
    found = fit(task(99.0 * X), [Unknown("m.a", 0.0, 1.0, -50.0, 50.0)])
    assert found.at_bound == ("m.a",)


def test_rows_of_one_signal_are_its_windows() -> None:
    both = Task(Parabola(), {"y": X, "z": X}, {"y": RULE, "z": RULE})  # type: ignore[arg-type]
    rows = both.white_of("z", {"y": np.zeros(2000), "z": np.ones(2000)})
    assert rows.shape == (20, 100)
    assert np.all(rows == 1.0)


def test_a_quick_fit_differences_its_slopes_once() -> None:
    class Counted(Parabola):
        runs = 0

        def simulate(self, values: dict[str, float]) -> dict[str, np.ndarray]:
            Counted.runs += 1
            return super().simulate({**values, "m.c": values["m.c"] ** 3})

    measured = 2.0 * X + 1.5**3 * X**2
    start = [unknown("m.a"), Unknown("m.c", 1.0, 1.0, -50.0, 50.0)]
    quick = fit(Task(Counted(), {"y": measured}, {"y": RULE}), start, quick=True)  # type: ignore[arg-type]
    assert quick.values == pytest.approx({"m.a": 2.0, "m.c": 1.5}, abs=1e-3)
    assert not quick.settled
    assert Counted.runs <= 2 + 12 + 1  # a column each, the rounds, and the residuals at the end


def test_a_signal_met_to_its_last_digit_can_be_judged_over_the_whole_log() -> None:
    """A reading that stands still is met without any error; beside it the others still count."""
    judged = whole(task(X**2), {"y": 0.0})
    assert np.isfinite(judged.rules["y"].matrix).all()
    assert np.isfinite(judged.white({"y": np.zeros_like(X)})).all()
