"""Flow and pressure as identified: (4.26), (4.33), (5.4)."""

import math

import numpy as np
import pytest
from fmu_bench import bare, ramp_response, run
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import StateSpace, cont2discrete, dlsim

from fmus import registry
from fmus.compose import compose

BLOCK = bare("continuity")
K_C, T, P_S = 5.28e8, 0.11, 170e5


def test_exact_for_a_spool_that_moves_on_straight_lines() -> None:
    rng = np.random.default_rng(2)
    for h in (1e-3, 0.05, 1.0):
        spool = rng.uniform(-2.6e-3, 2.6e-3, (40, 1))
        expected = ramp_response(np.array([[-1 / T]]), np.array([[K_C / T]]), [0.0], spool, h, [False])
        found = run(BLOCK, h, spool[0]).play(spool[1:])[:, 0]
        assert np.abs(found - expected[:, 0]).max() < 1e-13 * K_C * 2.6e-3


def test_the_same_as_scipys_first_order_hold() -> None:
    h = 0.02
    spool = np.sin(np.arange(200) * h * 3.0)[:, None] * 2e-3
    system = StateSpace([[-1 / T]], [[K_C / T]], [[1.0]], [[0.0]])
    _, expected, _ = dlsim(cont2discrete((system.A, system.B, system.C, system.D), h, "foh"), spool)
    found = run(BLOCK, h, spool[0]).play(spool[1:])[:, 0]
    assert np.abs(found - expected[1:, 0]).max() < 1e-13 * K_C * 2e-3


@given(st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3), st.floats(1e-4, 5.0), st.integers(2, 20))
def test_one_step_equals_many(old: float, new: float, h: float, n: int) -> None:
    whole = run(BLOCK, h, [old], p_load=3e5).step(new)[0]
    line = np.linspace(old, new, n + 1)[1:, None]
    parts = run(BLOCK, h / n, [old], p_load=3e5).play(line)[-1, 0]
    assert whole == pytest.approx(parts, abs=1e-14 * n * K_C * 2e-3)


def test_gain_and_time_constant_of_table_4_4() -> None:
    """5.28 bar per mm at rest; 63 % of it after 0.11 s."""
    r = run(BLOCK, T, [0.0], opening=1e-3)
    assert r.step(1e-3)[0] == pytest.approx(5.28e5 * (1 - math.exp(-1)), rel=1e-14)
    assert r.play([[1e-3]] * 400)[-1, 0] == pytest.approx(5.28e5, rel=1e-14)


@given(st.lists(st.floats(-2.6e-3, 2.6e-3), min_size=1, max_size=20))
def test_ports_are_symmetric_about_half_the_supply(spool: list[float]) -> None:
    """CONTRACT section 6; (4.21)."""
    outputs = run(BLOCK, 0.01, [0.0]).play([[s] for s in spool])
    p_load, p_a, p_b, p_supply = outputs.T
    assert np.all(p_supply == P_S)
    assert np.abs(p_a - p_b - p_load).max() < 1e-8
    assert np.abs(p_a + p_b - P_S).max() < 1e-8
    assert np.abs(p_load).max() <= K_C * 2.6e-3, "a first order never exceeds its largest input"


def test_linear_and_odd() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.uniform(-1e-3, 1e-3, (2, 60, 1))

    def respond(spool: np.ndarray) -> np.ndarray:
        return run(BLOCK, 0.01, spool[0]).play(spool[1:])[:, 0]

    assert np.abs(respond(a + 2 * b) - respond(a) - 2 * respond(b)).max() < 1e-8
    assert np.array_equal(respond(-a), -respond(a))


LEAKING = compose(registry.block("continuity"), [registry.effects()["continuity.leakage"]])


def leaking(c_l: float, k_t: float, h: float) -> np.ndarray:
    """Load pressure at the end of each step under a spool that swings, with leakage."""
    times = np.arange(0.0, 1.0 + h / 2, h)[:, None]
    return run(LEAKING, h, [0.0], {"c_l": c_l, "k_t": k_t}).play(2e-3 * np.sin(6.0 * times[1:]))[:, 0]


def test_turbulent_leakage_agrees_with_its_differential_equation_to_second_order() -> None:
    c_l, k_t = 0.4, 1e-4

    def rate(t: float, p: np.ndarray) -> np.ndarray:
        root = np.sqrt((1.0 + k_t * 1e6) / (1.0 + k_t * np.abs(p)))
        return (K_C * 2e-3 * math.sin(6.0 * t) - p - c_l * p * root) / T

    exact = solve_ivp(rate, (0.0, 1.0), [0.0], "DOP853", rtol=1e-11, atol=1e-3).y[0, -1]
    errors = [abs(leaking(c_l, k_t, h)[-1] - exact) for h in (4e-3, 2e-3, 1e-3)]
    assert errors[2] < 1e-4 * abs(exact)
    assert errors[2] < errors[0] / 12.0


@given(st.floats(0.01, 2.0))
def test_leakage_that_hardly_turns_turbulent_is_laminar(c_l: float) -> None:
    assert leaking(c_l, 1e-15, 1e-3) == pytest.approx(leaking(c_l, 0.0, 1e-3), abs=2e-4 * K_C * 2e-3)
