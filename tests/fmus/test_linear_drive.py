"""The linear drive against scipy: sections side by side, delay and start, and the simplified drive as its nominal case."""

import numpy as np
import pytest
from fmu_bench import bare, ramp_response, run
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from fmus.linear import held_pair

BLOCK = bare("linear_drive")
THREE = {
    "b1_1": 0.3, "b0_1": 0.2, "a1_1": 4.4, "a0_1": 0.0,
    "b1_2": -0.1, "b0_2": 2.0, "a1_2": 0.8, "a0_2": 30.0,
    "b1_3": 0.0, "b0_3": -1.0, "a1_3": 9.0, "a0_3": 14.0,
}  # fmt: skip


@given(
    st.one_of(st.just(0.0), st.floats(1e-6, 1e3)),
    st.one_of(st.just(0.0), st.floats(1e-8, 1e4)),
    st.floats(1e-4, 1.0),
)
def test_a_section_answers_a_held_command_as_the_exponential_says(a1: float, a0: float, h: float) -> None:
    whole = expm(np.array([[0.0, 1.0, 0.0], [-a0, -a1, 1.0], [0.0, 0.0, 0.0]]) * h)
    s, r = held_pair(a1, a0, h)
    # where it dies out within the step, parts of 1e-11 of what it was at most are rounding
    size = min(h, 1.0 / max(a1, np.sqrt(a0), 1e-300))
    assert s == pytest.approx(whole[0, 2], rel=1e-10, abs=1e-11 * size**2)
    assert r == pytest.approx(whole[1, 2], rel=1e-10, abs=1e-10 * size)


@pytest.mark.parametrize("h", [1e-3, 0.05, 2.0])
def test_exact_for_a_held_command(h: float) -> None:
    u = np.random.default_rng(4).uniform(-1, 1, (50, 1))
    expected = np.zeros(49)
    for k in (1, 2, 3):
        b1, b0, a1, a0 = (THREE[f"{n}_{k}"] for n in ("b1", "b0", "a1", "a0"))
        A, B = np.array([[0.0, 1.0], [-a0, -a1]]), np.array([[0.0], [1.0]])
        expected += ramp_response(A, B, [0.0, 0.0], u, h, [True]) @ [b0, b1]
    found = run(BLOCK, h, u[0], THREE | {"offset": 0.2}).play(u[1:])[:, 0]
    assert np.abs(found - 0.2 - expected).max() < 1e-12 * (1.0 + np.abs(expected).max())


def test_nominally_it_is_the_simplified_drive() -> None:
    u = np.random.default_rng(5).uniform(-1, 1, (200, 1))
    one, other = (run(block, 0.02, u[0]).play(u[1:])[:, 0] for block in (BLOCK, bare("simplified")))
    assert np.abs(one - other).max() < 1e-14


def test_the_linear_speed_is_nominally_the_speed_of_that_drive() -> None:
    u = np.random.default_rng(5).uniform(-1, 1, (200, 1))
    found = run(bare("linear_speed"), 0.02, u[0]).play(u[1:])[:, 0]
    simplified = bare("simplified")
    speed = list(simplified.outputs).index("omega")
    assert np.abs(found - run(simplified, 0.02, u[0]).play(u[1:])[:, speed]).max() < 1e-14


def test_the_linear_speed_has_the_equations_of_the_linear_drive_and_units_one_derivative_on() -> None:
    speed = bare("linear_speed")
    one, other = run(BLOCK, 0.01, [0.3], THREE), run(speed, 0.01, [0.3], THREE)
    u = np.random.default_rng(8).uniform(-1, 1, (100, 1))
    assert np.array_equal(one.play(u), other.play(u))
    units = {n: (BLOCK.parameters[n].unit, v.unit) for n, v in speed.parameters.items()}
    assert units["b0_1"] == ("rad/s2", "rad/s3")
    assert units["offset"] == ("rad", "rad/s")
    assert units["a0_1"] == ("1/s2", "1/s2")


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.05, 0.053])
def test_a_delay_shifts_the_command_straight_between_its_steps(delay: float) -> None:
    h, u = 0.01, np.random.default_rng(6).uniform(-1, 1, 300)
    past = np.concatenate([np.zeros(20), u])
    whole, part = divmod(delay / h + 1e-12, 1.0)
    at = np.arange(20, past.size) - int(whole)
    late = (1.0 - part) * past[at] + part * past[at - 1]
    found = run(BLOCK, h, [0.0], THREE | {"delay": delay}).play(u[:, None])
    assert np.abs(found - run(BLOCK, h, [0.0], THREE).play(late[:, None])).max() < 1e-12


def test_settled_it_stands_where_the_first_command_has_brought_it() -> None:
    still = THREE | {"b0_1": 0.0, "b1_1": 0.0, "offset": 0.1, "settled": 1.0, "delay": 0.035}
    found = run(BLOCK, 0.01, [0.4], still).play([[0.4]] * 100)[:, 0]
    assert found == pytest.approx(0.1 + 0.4 * (2.0 / 30.0 - 1.0 / 14.0), rel=1e-12)


def test_it_stands_at_the_command_that_moves_nothing() -> None:
    still = THREE | {"offset": 0.7, "u_0": 0.4, "delay": 0.02}
    assert np.all(run(BLOCK, 0.01, [0.4], still).play([[0.4]] * 50) == 0.7)
    u = np.random.default_rng(7).uniform(-1, 1, (60, 1))
    from_zero = run(BLOCK, 0.01, [0.0], still | {"u_0": 0.0}).play(u)
    assert run(BLOCK, 0.01, [0.4], still).play(u + 0.4) == pytest.approx(from_zero, rel=1e-12)


def test_at_rest_it_starts_at_its_offset() -> None:
    assert np.all(run(BLOCK, 0.01, [0.4], THREE | {"offset": 0.7}).play([[0.0]] * 50) == 0.7)


def test_a_delay_of_more_steps_than_it_remembers_is_that_of_all_it_remembers() -> None:
    found = run(BLOCK, 1e-4, [0.0], {"delay": 1e3}).play([[1.0]] * 20000)[:, 0]
    assert np.all(found[:16380] == 0.0)
    assert found[-1] > 0.0
