"""Values and distributions as users write them, and how they are drawn."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.batch.design import crossed, drawn, grid, side_by_side
from cosim.batch.values import Z95, Distribution, read_distribution, swept_values
from cosim.errors import UsageError


def variable(kind: str = "Real", unit: str = "kg.m2", low: float = -np.inf, high: float = np.inf) -> Any:
    return SimpleNamespace(kind=kind, unit=unit, low=low, high=high)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("700:900:5 kg.m2", [700.0, 750.0, 800.0, 850.0, 900.0]),
        ("700:900:3", [700.0, 800.0, 900.0]),
        ("700, 800, 900 kg.m2", [700.0, 800.0, 900.0]),
        ("0.7 t.m2, 800 kg.m2", [700.0, 800.0]),
        ("900:700:2 kg.m2", [900.0, 700.0]),
        (["0.7 t.m2", 800, 900.5], [700.0, 800.0, 900.5]),
    ],
)
def test_swept_values(text: Any, expected: list[float]) -> None:
    assert swept_values("mechanical.J", text, variable()) == pytest.approx(expected, rel=1e-15)


def test_units_that_begin_with_a_digit_are_read() -> None:
    assert swept_values("simplified.a", "1:3:3 1/s", variable(unit="1/s")) == [1.0, 2.0, 3.0]
    assert read_distribution("simplified.a", "1:3 1/s", variable(unit="1/s")).high == 3.0


def test_values_of_other_types() -> None:
    assert swept_values("c.form", "1, 3", variable("Integer")) == [1, 3]
    assert swept_values("c.on", [True, False], variable("Boolean")) == [True, False]
    assert swept_values("c.label", "plain,other", variable("String")) == ["plain", "other"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("700:900 kg.m2", "how many"),
        ("700:900:5 bar", "wrong dimension"),
        ("700:900:1 kg.m2", "from 2 to"),
        ("700:900:2.5 kg.m2", "should read"),
        ("heavy", "is not a number"),
        ("700,,900", "is not a number"),
    ],
)
def test_bad_sweeps_name_the_parameter_and_the_fault(text: str, said: str) -> None:
    with pytest.raises(UsageError, match=f"(?s)mechanical.J: .*{said}"):
        swept_values("mechanical.J", text, variable())


def test_distributions_are_read_with_their_units() -> None:
    uniform = read_distribution("J", "0.7:0.9 t.m2", variable())
    assert (uniform.kind, uniform.low, uniform.high) == (
        "uniform",
        pytest.approx(700.0),
        pytest.approx(900.0),
    )
    half = read_distribution("J", "760 +- 20 kg.m2", variable())
    assert (half.kind, half.low, half.middle, half.high) == ("normal", 740.0, 760.0, 780.0)
    interval = read_distribution("J", "-760 [-800, -755] kg.m2", variable())
    assert (interval.low, interval.middle, interval.high) == (-800.0, -760.0, -755.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("900:700 kg.m2", "empty"),
        ("760 [770, 780] kg.m2", "does not hold"),
        ("760 +- 0 kg.m2", "empty"),
        ("760 kg.m2", "no distribution"),
        ("700:900:5 kg.m2", "no distribution"),
        ("-5 +- 1 kg.m2", "is not within"),
    ],
)
def test_bad_distributions_name_the_parameter_and_the_fault(text: str, said: str) -> None:
    with pytest.raises(UsageError, match=f"^J: .*{said}"):
        read_distribution("J", text, variable(low=0.0))


@given(
    middle=st.floats(-1e3, 1e3),
    below=st.floats(1e-3, 1e3),
    above=st.floats(1e-3, 1e3),
)
def test_the_interval_is_the_95_percent_interval_and_the_middle_the_median(
    middle: float, below: float, above: float
) -> None:
    found = Distribution("normal", middle - below, middle + above, middle)
    levels = found.quantile(np.array([0.025, 0.5, 0.975]))
    assert levels == pytest.approx([middle - below, middle, middle + above], rel=1e-9, abs=1e-9)


@given(
    middle=st.floats(0.0, 10.0),
    width=st.floats(1e-3, 100.0),
    least=st.floats(-10.0, 0.0),
    span=st.floats(10.0, 20.0),
    parts=st.lists(st.floats(0.0, 1.0), min_size=2, max_size=20),
)
def test_draws_keep_to_the_bounds_and_to_their_order(
    middle: float, width: float, least: float, span: float, parts: list[float]
) -> None:
    found = Distribution("normal", middle - width, middle + width, middle, least, least + span)
    values = found.quantile(np.sort(parts))
    assert np.all(np.diff(values) >= 0.0)
    assert np.all((values >= least) & (values <= least + span))


def test_a_truncated_normal_is_that_of_scipy() -> None:
    from scipy.stats import truncnorm

    found = Distribution("normal", -1.0, 3.0, 1.0, 0.5, 4.0)
    sd = 2.0 / 1.959963984540054
    exact = truncnorm((0.5 - 1.0) / sd, (4.0 - 1.0) / sd, loc=1.0, scale=sd)
    parts = np.linspace(0.01, 0.99, 25)
    assert found.quantile(parts) == pytest.approx(exact.ppf(parts), rel=1e-9)


def test_grid_changes_the_last_fastest_and_zip_goes_side_by_side() -> None:
    values: dict[str, Any] = {"a": [1.0, 2.0], "b": [3.0, 4.0]}
    assert [tuple(r.values()) for r in grid(values)] == [(1.0, 3.0), (1.0, 4.0), (2.0, 3.0), (2.0, 4.0)]
    assert [tuple(r.values()) for r in side_by_side(values)] == [(1.0, 3.0), (2.0, 4.0)]
    assert crossed([{"a": 1.0}], [{"b": 2.0}, {"b": 3.0}]) == [{"a": 1.0, "b": 2.0}, {"a": 1.0, "b": 3.0}]
    with pytest.raises(UsageError, match="a 2, b 1"):
        side_by_side({"a": [1.0, 2.0], "b": [3.0]})
    with pytest.raises(UsageError, match="1000000000000 runs"):
        grid({f"p{k}": [0.0] * 1000 for k in range(4)})


@given(samples=st.integers(2, 40), seed=st.integers(0, 2**31))
def test_a_latin_hypercube_has_one_draw_in_every_stratum(samples: int, seed: int) -> None:
    unit = {"a": Distribution("uniform", 0.0, 1.0), "b": Distribution("uniform", 0.0, 1.0)}
    rows, _ = drawn(unit, samples, "latin_hypercube", seed)
    for name in unit:
        strata = sorted(int(float(row[name]) * samples) for row in rows)
        assert strata == list(range(samples))


def test_sobol_takes_a_power_of_two_and_says_so() -> None:
    unit = {"a": Distribution("uniform", 0.0, 1.0), "b": Distribution("uniform", 0.0, 1.0)}
    rows, notes = drawn(unit, 100, "sobol", 1)
    assert len(rows) == 128
    assert "128 samples in place of 100" in notes[0]
    # balanced: each half of each axis holds half of the points
    for name in unit:
        assert sum(float(row[name]) < 0.5 for row in rows) == 64
    assert drawn(unit, 64, "sobol", 1)[1] == []


@given(
    roots=st.lists(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), min_size=3, max_size=3),
    seed=st.integers(0, 2**31),
)
def test_correlated_draws_keep_their_own_distributions(roots: list[list[float]], seed: int) -> None:
    """Whatever the correlations (of any rank), and however rounded in a file; an independent neighbour is left alone."""
    rows = np.array(roots)
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = np.where(size > 1e-6, rows / np.maximum(size, 1e-6), 0.0)  # a row of nothing depends on no other
    matrix = rows @ rows.T
    names = ["a", "b", "c"]
    pairs = {
        (names[i], names[k]): round(float(matrix[i, k]), 2)
        for i, k in ((0, 1), (0, 2), (1, 2))
        if matrix[i, k]
    }
    listed = {name: Distribution("normal", 5.0 - Z95, 5.0 + Z95, 5.0) for name in names}
    listed["d"] = Distribution("uniform", 0.0, 1.0)
    found, _ = drawn(listed, 1024, "sobol", seed, pairs)
    plain, _ = drawn(listed, 1024, "sobol", seed)
    assert [row["d"] for row in found] == [row["d"] for row in plain]
    values = np.array([[float(row[name]) for name in names] for row in found]).T
    assert values.mean(axis=1) == pytest.approx(5.0, abs=0.1)
    assert values.std(axis=1) == pytest.approx(1.0, abs=0.1)
    for i, k in ((0, 1), (0, 2), (1, 2)):
        known = pairs.get((names[i], names[k]), 0.0)
        # what no distribution can have is brought to the nearest that one can
        assert np.corrcoef(values[i], values[k])[0, 1] == pytest.approx(known, abs=0.12)


def test_the_seed_decides_the_draws() -> None:
    one = {"a": Distribution("normal", -1.0, 1.0)}
    for design in ("random", "latin_hypercube", "sobol"):
        assert drawn(one, 8, design, 3) == drawn(one, 8, design, 3)
        assert drawn(one, 8, design, 3)[0] != drawn(one, 8, design, 4)[0]
