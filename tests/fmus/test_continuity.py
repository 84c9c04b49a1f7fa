"""Flow and pressure as identified: (4.26), (4.33), (5.4)."""

import math
from types import SimpleNamespace

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


@given(st.floats(0.05, 20.0), st.floats(1e-3, 0.3), st.booleans())
def test_a_falling_pressure_has_its_own_lag(r_T: float, h: float, rises: bool) -> None:
    own = compose(registry.block("continuity"), [registry.effects()["continuity.lag_asymmetry"]])
    begin, end = (1e5, 1.5e6) if rises else (1.5e6, 1e5)
    opening = end / K_C
    found = run(own, h, [opening], {"r_T": r_T}, p_load=begin, opening=opening).play([[opening]] * 5)[:, 0]
    lag = T if rises else r_T * T
    expected = end + (begin - end) * np.exp(-h * np.arange(1, 6) / lag)
    assert found == pytest.approx(expected, rel=1e-12)


def test_its_steps_converge_to_the_equation_where_the_direction_changes() -> None:
    own, r_T, w = (
        compose(registry.block("continuity"), [registry.effects()["continuity.lag_asymmetry"]]),
        3.0,
        2.0 * math.pi,
    )

    def rate(t, p):
        ahead = K_C * 1e-3 * math.sin(w * t) - p[0]
        return [ahead / (T if ahead > 0.0 else r_T * T)]

    exact = solve_ivp(rate, (0.0, 3.0), [0.0], rtol=1e-10, atol=1e-3, max_step=1e-3).y[0, -1]
    errors = []
    for n in (300, 3000):
        spool = 1e-3 * np.sin(w * np.linspace(0.0, 3.0, n + 1))
        errors.append(abs(run(own, 3.0 / n, [0.0], {"r_T": r_T}).play(spool[1:, None])[-1, 0] - exact))
    assert errors[0] < 1e-3 * K_C * 1e-3
    assert errors[1] < 0.03 * errors[0]


def test_gain_and_time_constant_of_table_4_4() -> None:
    """5.28 bar per mm at rest; 63 % of it after 0.11 s."""
    r = run(BLOCK, T, [0.0], opening=1e-3)
    assert r.step(1e-3)[0] == pytest.approx(5.28e5 * (1 - math.exp(-1)), rel=1e-14)
    assert r.play([[1e-3]] * 400)[-1, 0] == pytest.approx(5.28e5, rel=1e-14)


@given(st.lists(st.floats(-2.6e-3, 2.6e-3), min_size=1, max_size=20))
def test_ports_are_symmetric_about_half_the_supply(spool: list[float]) -> None:
    """(4.21)."""
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


def felt(p_load: float, p_c: float, s_c: float) -> float:
    """What the mechanics feel of a load pressure behind a counterbalance valve."""
    law = registry.effects()["continuity.cracking_pressure"].fills["driving_pressure"]
    return law(p_load, None, SimpleNamespace(p_c=p_c, s_c=s_c))


PRESSURE, CRACKING, SOFTNESS = st.floats(-3e7, 3e7), st.floats(0.0, 1e8), st.floats(0.0, 1.0)


@given(PRESSURE, PRESSURE, CRACKING, SOFTNESS)
def test_a_valve_that_opens_gradually_is_odd_and_rises_and_holds_back_no_more_than_its_cracking_pressure(
    one: float, other: float, p_c: float, s_c: float
) -> None:
    low, high = sorted((one, other))
    slack = 1e-12 * max(abs(low), abs(high))
    assert felt(-one, p_c, s_c) == -felt(one, p_c, s_c)
    assert felt(low, p_c, s_c) <= felt(high, p_c, s_c) + slack
    assert -slack <= abs(one) - abs(felt(one, p_c, s_c)) <= min(p_c, abs(one)) + slack


@given(PRESSURE, CRACKING)
def test_a_valve_that_hardly_opens_gradually_opens_at_once(p_load: float, p_c: float) -> None:
    """The corner is rounded by ln(2) of its softness at most."""
    assert felt(p_load, p_c, 1e-9) == pytest.approx(
        felt(p_load, p_c, 0.0), abs=1e-9 * p_c + 1e-12 * abs(p_load)
    )


@given(PRESSURE, SOFTNESS)
def test_without_a_cracking_pressure_nothing_is_held_back(p_load: float, s_c: float) -> None:
    assert felt(p_load, 0.0, s_c) == p_load
