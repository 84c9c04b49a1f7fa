"""Gains on left-out blocks: exact for linear models, and as sure as repetitions say."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from cosim.inference.held_out import (
    HeldOutGain,
    as_excited,
    contrast,
    course_of,
    gain_between,
    gain_of_errors,
    left_out,
    outside_asked,
    ratio_ci95,
    smaller_by,
    steps_without,
)
from cosim.inference.thresholds import ASKED_FOR

Array = NDArray[np.float64]
BLOCK = np.repeat(np.arange(10), 30)


def linear(seed: int, weak: float = 0.0) -> tuple[Array, Array]:
    """A design (n, 3) of a strong and a weak regressor and a useless one, and data of it, noise of unit size."""
    rng = np.random.default_rng(seed)
    design = rng.standard_normal((BLOCK.size, 3))
    return design, design @ np.array([2.0, weak, 0.0]) + rng.standard_normal(BLOCK.size)


def fitted(design: Array, y: Array) -> Array:
    return y - design @ np.linalg.lstsq(design, y, rcond=None)[0]


def test_a_left_out_block_is_what_fitting_again_without_it_gives() -> None:
    design, y = linear(1)
    rows, slopes = fitted(design, y), -design
    found = left_out(np.append(rows, 0.0), np.vstack([slopes, np.zeros(3)]), BLOCK)
    for one in range(10):
        mine = one == BLOCK
        # held within two standard deviations of the whole: a quarter of all data more
        gram = design[~mine].T @ design[~mine] + 0.25 * design.T @ design
        best = np.linalg.lstsq(design, y, rcond=None)[0]
        again = best + np.linalg.solve(gram, design[~mine].T @ (y - design @ best)[~mine])
        assert found[mine] == pytest.approx(y[mine] - design[mine] @ again)


def test_what_the_others_do_not_show_stays_where_it_is() -> None:
    design = np.zeros((BLOCK.size, 1))
    design[BLOCK == 3, 0] = 1.0
    y = 5.0 * design[:, 0] + np.random.default_rng(2).standard_normal(BLOCK.size)
    rows = fitted(design, y)
    assert np.abs(steps_without(rows, -design, BLOCK)).max() < 1e-9
    gain = gain_between(left_out(rows, -design, BLOCK), y, BLOCK)
    assert gain.sure  # it shows in one block only, and clearly


@pytest.mark.parametrize(("weak", "least", "most"), [(0.0, 0, 12), (0.5, 190, 200)])
def test_a_useless_regressor_is_hardly_ever_sure_and_a_real_one_nearly_always(
    weak: float, least: int, most: int
) -> None:
    count = 0
    for seed in range(200):
        design, y = linear(seed, weak)
        rich, poor = design[:, :2], design[:, :1]
        with_it = left_out(fitted(rich, y), -rich, BLOCK)
        without = left_out(fitted(poor, y), -poor, BLOCK)
        count += gain_between(with_it, without, BLOCK).sure
    # one-sided 2.5 % of 200 are 5; a gain of some 37 is 4 standard deviations
    assert least <= count <= most


def test_the_interval_of_a_gain_holds_the_gain_of_other_data() -> None:
    """Mean over many logs, against the intervals of each."""
    gains = []
    for seed in range(200):
        design, y = linear(seed, 0.5)
        rich, poor = design[:, :2], design[:, :1]
        gains.append(
            gain_between(
                left_out(fitted(rich, y), -rich, BLOCK), left_out(fitted(poor, y), -poor, BLOCK), BLOCK
            )
        )
    truth = np.mean([g.gain for g in gains])
    held = np.mean([g.ci95[0] < truth < g.ci95[1] for g in gains])
    # excitation is drawn anew in each as well, which the interval takes as given
    assert held > 0.85


def test_a_gain_is_sure_where_its_interval_excludes_none() -> None:
    assert HeldOutGain(0.5, 0.25).sure
    assert not HeldOutGain(0.5, 0.26).sure  # 1.96 of them are more
    assert not HeldOutGain(-0.5, 0.01).sure


def test_what_fitted_data_ask_for_is_borne_out_by_less() -> None:
    """At the end of its interval the odds, with those of before, are those of any cause at the end of 95 %."""
    tail = 0.5 * outside_asked()
    assert (1.0 - tail) / tail * ASKED_FOR / (1.0 - ASKED_FOR) == pytest.approx(0.975 / 0.025)
    reach = norm.ppf(1.0 - tail)
    assert HeldOutGain(0.5, 0.499 / reach).borne_out
    assert not HeldOutGain(0.5, 0.499 / reach).sure
    assert not HeldOutGain(0.5, 0.501 / reach).borne_out
    assert not HeldOutGain(-0.5, 0.01).borne_out


def test_of_causes_at_the_edge_of_being_borne_out_one_in_forty_does_not_help() -> None:
    """Of many causes, as many of which help as is said, those whose measured gain is just enough to be named."""
    rng = np.random.default_rng(12)
    helps = rng.random(2_000_000) < ASKED_FOR
    true = np.where(helps, 1.0, -1.0) * rng.uniform(0.0, 8.0, helps.size)
    measured = true + rng.standard_normal(helps.size)
    edge = np.abs(measured - norm.ppf(1.0 - 0.5 * outside_asked())) < 0.05
    assert np.mean(~helps[edge]) == pytest.approx(0.025, abs=0.004)


def test_an_unknown_deviation_is_never_sure() -> None:
    assert not HeldOutGain(10.0).sure
    assert not HeldOutGain(10.0).borne_out


def test_the_ratio_of_equal_errors_includes_one_and_of_halves_does_not() -> None:
    rng = np.random.default_rng(5)
    one, other = rng.chisquare(50, 40), rng.chisquare(50, 40)
    low, high = ratio_ci95(one, other)
    assert low < 1.0 < high
    low, high = ratio_ci95(0.25 * one, other)
    assert 0.4 < low < 0.5 < high < 0.6


def test_of_few_repetitions_the_interval_is_students() -> None:
    """Five logs tell little of their own scatter: 2.571 standard deviations and not 1.960."""
    rng = np.random.default_rng(4)
    richer, poorer, log = rng.standard_normal(100), rng.standard_normal(100), np.repeat(np.arange(5), 20)
    few = gain_between(richer, poorer, log)
    assert few.ci95[1] - few.gain == pytest.approx(2.5706 * few.deviation, rel=1e-4)
    many = gain_between(richer, poorer, np.repeat(np.arange(20), 5))
    assert many.ci95[1] - many.gain == pytest.approx(1.95996 * many.deviation, rel=1e-4)


@pytest.mark.parametrize(("share", "sure"), [(0.8, True), (1.0, False), (1.25, False)])
def test_a_gain_on_other_data_is_sure_where_the_error_is_smaller_in_part_after_part(
    share: float, sure: bool
) -> None:
    rng = np.random.default_rng(5)
    poorer = rng.uniform(0.5, 1.5, 24)
    richer = share**2 * poorer * rng.uniform(0.9, 1.1, 24)
    found = gain_of_errors(richer, poorer)
    assert found.ci95[0] < found.gain < found.ci95[1]
    assert found.sure == sure


def test_one_event_among_many_parts_does_not_decide() -> None:
    """In one part somebody pushes the machine: its error is larger with the cause, and hides all others in a mean."""
    poorer = np.full(22, 0.01)
    richer = np.full(22, 0.0004)
    poorer[4], richer[4] = 0.49, 0.9
    assert ratio_ci95(richer, poorer)[1] > 1.0
    assert gain_of_errors(richer, poorer).sure
    assert not gain_of_errors(poorer, richer).sure


def test_the_contrast_is_antisymmetric_and_counts_nothing_below_what_half_of_the_parts_leave() -> None:
    rng = np.random.default_rng(8)
    one, other = rng.chisquare(3, 30), 4.0 * rng.chisquare(3, 30)
    assert contrast(one, other) == pytest.approx(-contrast(other, one))
    quiet = np.array([1.0, 1.0, 1.0, 1e-8]), np.array([1.0, 1.0, 1.0, 1e-4])
    assert abs(contrast(*quiet)[3]) < 1e-4
    assert smaller_by(np.ones(9), 4.0 * np.ones(9))[0] == pytest.approx(0.5 * np.log(2.5))


@pytest.mark.parametrize("parts", [8, 24, 60])
def test_of_two_equal_errors_with_heavy_tails_hardly_one_in_twenty_is_called_smaller(parts: int) -> None:
    rng = np.random.default_rng(parts)
    pairs = [rng.standard_t(2, (2, parts)) ** 2 for _ in range(300)]
    called = sum(smaller_by(one, other)[1][0] > 0.0 for one, other in pairs)
    assert called <= 0.08 * len(pairs)


def shown(one: Array, other: Array) -> HeldOutGain:
    """What an error (parts,) gains over another of a run whose place counts, each one number in each part."""
    return gain_of_errors(one**2, other**2, True, (one - other) ** 2)


def test_what_shows_by_far_in_one_part_of_a_run_is_sure() -> None:
    """A machine meets the end of its travel in one part of a log: resampled parts often lack that one."""
    left = 0.02 * np.random.default_rng(4).standard_normal(11)
    without = left.copy()
    without[-1] += 2.0
    assert not gain_of_errors(left**2, without**2, True).sure
    assert shown(left, without).sure
    assert not shown(without, left).sure
    fast = gain_of_errors(left**2 + 1e-4, left**2 + 2e-4, True, np.zeros(11))
    assert fast.ci95 == gain_of_errors(left**2 + 1e-4, left**2 + 2e-4, True).ci95  # no part shows it by far
    half = np.where(np.arange(11) == 10, 0.5, 0.0) * without + np.where(np.arange(11) == 10, 0.0, 1.0) * left
    assert not shown(half, without).sure  # it may be chance that it is half as large there


@pytest.mark.parametrize("parts_that_show", [1, 2, 11])
@pytest.mark.parametrize("size", [0.5, 1.0, 2.0])
def test_what_is_not_there_is_hardly_ever_sure_of_the_excitation(parts_that_show: int, size: float) -> None:
    """An effect whose change of the error is as large as the error, of chance signs, in few parts or in all."""
    rng = np.random.default_rng(5)
    count = 0
    for _ in range(2000):
        error = rng.standard_normal(11)
        change = np.where(np.arange(11) < parts_that_show, size, 0.0) * rng.choice([-1.0, 1.0], 11)
        count += as_excited((error + change) ** 2, error**2, change**2)[0] > 0.0
    assert count <= 66  # one-sided 2.5 % of 2000 are 50, and 2.3 standard deviations of the count 16


def test_a_course_is_the_mean_over_short_spans_of_each_part() -> None:
    found = course_of(np.repeat([1.0, 2.0, 3.0, 4.0], 160), 2)
    assert found.shape == (2, 32)
    assert found.mean(axis=1) == pytest.approx([1.5, 3.5])
    assert np.isfinite(course_of(np.ones(9), 8)).all()  # shorter than its spans


@pytest.mark.parametrize("parts", [1, 2, 11])
def test_an_interval_of_the_excitation_is_students_of_as_many_parts_as_matter(parts: int) -> None:
    """In some parts of a run the effect takes an error of 2 to 1, changing it by 1.5; in the others it does nothing."""
    matters = np.arange(11) < parts
    richer, poorer, apart = np.ones(11), np.where(matters, 4.0, 1.0), np.where(matters, 2.25, 0.0)
    low, high = as_excited(richer, poorer, apart)
    # each part that matters gains (4 - 1)/2, give or take |d||e| = 1.5
    gain, reach = 1.5 * parts, 1.5 * np.sqrt(parts) * student.ppf(0.975, parts)
    ends = [0.5 * np.log(max(1.0 + 2.0 * g / 11.0, 1e-300)) for g in (gain - reach, gain + reach)]
    assert (low, high) == pytest.approx(ends)


@pytest.mark.parametrize("large", [0, 11])
def test_the_first_and_the_last_part_are_resampled_as_often_as_any(large: int) -> None:
    one = np.where(np.arange(12) == large, 100.0, 1.0)
    low, high = ratio_ci95(one, np.ones(12))
    # not drawn in a third of the times, and three times or more in one of twelve
    assert low == 1.0
    assert high == pytest.approx(np.sqrt(1.0 + 99.0 * 3.0 / 12.0), rel=0.01)
    assert smaller_by(np.where(np.arange(12) == large, 1e-9, 1.0), np.ones(12))[1] == pytest.approx(
        (0.0, 3.0 / 12.0 * 0.5 * np.log(2.0))
    )


def test_of_a_single_block_there_is_one_step() -> None:
    assert steps_without(np.ones(4), np.ones((4, 2)), np.zeros(4, dtype=np.int64)).shape == (1, 2)
