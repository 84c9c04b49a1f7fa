"""Flow and pressure from first principles, (4.17)-(4.21): balance, symmetry, order, what it keeps of the identified form."""

import math

import numpy as np
import pytest
from fmu_bench import bare, orders, run
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

BLOCK = bare("continuity_physical")
EQ = BLOCK.module
P = run(BLOCK, 1e-3, [0.0, 0.0]).p
P_S, MIDDLE = 170e5, 85e5
J, B_IDENTIFIED, B_PHYSICAL = 763.9437268410978, 26661.636066754313, 33102.35  # N m s/rad
K_VALVE = 2.375e-3

pressure = st.floats(0.0, P_S)
spool = st.floats(-2.6e-3, 2.6e-3)
velocity = st.floats(-0.05, 0.05)


@given(pressure, pressure, st.floats(1e5, P_S), spool)
def test_flows_are_4_17_and_4_18_with_the_signs_of_section_9_5(
    p_a: float, p_b: float, p_s: float, x: float
) -> None:
    def turbulent(dp: float) -> float:
        return P.C_d * P.w * abs(x) * math.sqrt(2 / P.rho * abs(dp)) * math.copysign(1.0, dp)

    q_a, q_b = EQ.port_flows(p_a, p_b, p_s, x, P)
    if x >= 0:
        expected = turbulent(p_s - p_a), -turbulent(p_b)
        drops = p_s - p_a, p_b
    else:
        expected = -turbulent(p_a), turbulent(p_s - p_b)
        drops = p_a, p_s - p_b
    for found, exact, drop in zip((q_a, q_b), expected, drops, strict=True):
        if abs(drop) > 1e5:  # smoothed below 0.1 bar: one part in 400 at ten times that
            assert found == pytest.approx(exact, rel=0.003)
        # below the normal numbers (1e-308 m3/s) products round in the first digits already
        assert abs(found) <= abs(exact) * (1 + 1e-12) + 1e-300, "the smoothed orifice never passes more"


@given(pressure, pressure, spool, velocity)
def test_mass_balance(p_a: float, p_b: float, x: float, omega: float) -> None:
    """Piston and leakage only move oil from one chamber to the other: what is compressed is what the ports let in."""
    q_a, q_b = EQ.port_flows(p_a, p_b, P_S, x, P)
    rate_a, rate_b, _ = EQ.rates(p_a, p_b, P_S, 0.0, x, omega, P)
    stored = (P.V_L + P.V_A) / P.beta * rate_a + (P.V_L + P.V_B) / P.beta * rate_b
    assert stored == pytest.approx(q_a + q_b, abs=1e-12 * (abs(q_a) + abs(q_b) + 1e-3))


@given(
    pressure, pressure, st.floats(1e5, P_S), st.floats(-0.2, 0.2), spool, velocity, st.floats(0.0, 1e11),
    st.floats(0.01, 1.0), st.floats(0.0, 1e-11),
)  # fmt: skip
def test_rates_are_4_19_and_4_20(
    p_a: float,
    p_b: float,
    p_s: float,
    rack: float,
    x: float,
    omega: float,
    R_s: float,
    tau_p: float,
    C_B: float,
) -> None:
    """The chambers' volumes follow the rack; what leaks from a chamber to the tank goes with its pressure."""
    p = P._replace(R_s=R_s, tau_p=tau_p, C_A=2e-12, C_B=C_B, p_t=1e5)
    q_a, q_b = EQ.port_flows(p_a, p_b, p_s, x, p)
    piston, leak = p.A * p.r * omega, p.C_L * (p_a - p_b)
    drawn = q_a if x >= 0 else q_b
    expected = (
        7e8 / (4.5e-3 + 8.4193e-3 * rack) * (q_a - piston - leak - 2e-12 * (p_a - 1e5)),
        7e8 / (4.5e-3 - 8.4193e-3 * rack) * (q_b + piston + leak - C_B * (p_b - 1e5)),
        (P_S - R_s * drawn - p_s) / tau_p,
    )
    assert EQ.rates(p_a, p_b, p_s, rack, x, omega, p) == pytest.approx(expected, rel=1e-11, abs=1e-2)


@given(st.lists(st.tuples(spool, velocity), min_size=1, max_size=15))
def test_mirror_images(rows: list[tuple[float, float]]) -> None:
    """Spool and motion turned round exchange the ports: equal areas on both sides."""
    forward = run(BLOCK, 5e-3, [0.0, 0.0]).play(rows)
    back = run(BLOCK, 5e-3, [0.0, 0.0]).play([(-x, -w) for x, w in rows])
    assert np.abs(forward - back[:, [0, 2, 1, 3]] * [-1, 1, 1, 1]).max() < 1e-6


def test_closed_and_still_it_stays_where_it_is() -> None:
    outputs = run(BLOCK, 0.01, [0.0, 0.0]).play([(0.0, 0.0)] * 100)
    assert np.all(outputs == [0.0, MIDDLE, MIDDLE, P_S])


def test_trapped_oil_is_a_spring() -> None:
    """Valve shut, no leakage: a turn presses V + A dx into V, (4.19); its stiffness grows as the chamber gets smaller."""
    omega, t = 1e-3, 0.2
    r = run(BLOCK, 1e-3, [0.0, -omega], {"C_L": 0.0})
    p_load, p_a, p_b, _ = r.play([(0.0, -omega)] * round(t / 1e-3))[-1]
    share = P.A * P.r * omega * t / (P.V_L + P.V_A)
    rises = -P.beta * math.log(1.0 - share), P.beta * math.log(1.0 + share)
    assert (p_a - MIDDLE, MIDDLE - p_b, p_load) == pytest.approx((*rises, sum(rises)), rel=1e-9)
    assert rises[0] > rises[1]


def test_what_leaks_to_the_tank_empties_a_chamber_that_is_shut() -> None:
    values = {"C_L": 0.0, "C_A": 5e-11}
    _, p_a, p_b, _ = run(BLOCK, 1e-3, [0.0, 0.0], values).play([(0.0, 0.0)] * 100)[-1]
    assert p_a == pytest.approx(MIDDLE * math.exp(-0.1 * P.beta * 5e-11 / (P.V_L + P.V_A)), rel=1e-9)
    assert p_b == MIDDLE


def test_an_empty_chamber_leaves_the_line() -> None:
    """Beyond the end of its stroke a chamber has no volume, and the pressure stays finite."""
    full, empty = (EQ.rates(MIDDLE, MIDDLE, P_S, rack, 0.0, 0.01, P)[0] for rack in (0.0, -1.0))
    assert empty / full == pytest.approx((P.V_L + P.V_A) / P.V_L)


@pytest.mark.parametrize("supply", [{}, {"R_s": 5e10, "tau_p": 0.02}], ids=["stiff", "sagging"])
def test_fourth_order(supply: dict[str, float]) -> None:
    """Runge-Kutta 4 on a smooth problem. A hundred times the bulk modulus, so that its error stands clear of rounding."""
    values = {"beta": 7e10} | supply
    p = P._replace(**values)
    end, x_end, w_end = 0.016, 2.4e-3, 0.02

    def rates(t: float, y: np.ndarray) -> tuple[float, ...]:
        return EQ.rates(*y, 0.5 * P.r * w_end * t * t / end, x_end * t / end, w_end * t / end, p)

    start = [MIDDLE, MIDDLE, P_S]
    exact = solve_ivp(rates, (0, end), start, "DOP853", rtol=1e-13, atol=1e-6).y[:, -1]
    errors = []
    for n in (16, 32, 64, 128):  # at most 1 ms each, or the block divides the step itself
        line = np.linspace(0, 1, n + 1)
        rows = np.column_stack([x_end * line[1:], w_end * line[:-1]])
        found = run(BLOCK, end / n, [0.0, -w_end / n], values).play(rows)[-1]
        errors.append(np.abs(found[1:] - exact).max())
    assert errors[-1] > 1e-6, "above rounding"
    assert orders(errors)[-1] == pytest.approx(4.0, abs=0.3)


def test_long_steps_are_divided() -> None:
    """A step of 20 ms is twenty of 1 ms along the same lines: the velocity, told at its start, goes on as before."""
    whole = run(BLOCK, 0.02, [0.0, 0.0]).step(2e-3, 0.03)
    share = np.linspace(0, 1, 21)
    rows = np.column_stack([2e-3 * share[1:], 0.03 + 0.03 * share[:-1]])
    assert whole == pytest.approx(tuple(run(BLOCK, 1e-3, [0.0, 0.03 - 0.0015]).play(rows)[-1]), rel=1e-12)


def linearised(b: float) -> tuple[np.ndarray, np.ndarray]:
    """State matrix and input column (per m of spool) of (PA, PB, omega) about the centre, by central differences."""

    def rates(y: np.ndarray, x: float) -> np.ndarray:
        rate_a, rate_b, _ = EQ.rates(y[0], y[1], P_S, 0.0, x, y[2], P)
        return np.array([rate_a, rate_b, (P.A * P.r * (y[0] - y[1]) - b * y[2]) / J])

    y0, columns = np.array([MIDDLE, MIDDLE, 0.0]), []
    for k, d in enumerate((1e3, 1e3, 1e-4)):
        step = np.eye(3)[k] * d
        columns.append((rates(y0 + step, 0.0) - rates(y0 - step, 0.0)) / (2 * d))
    return np.column_stack(columns), (rates(y0, 1e-5) - rates(y0, -1e-5)) / 2e-5


def test_poles_of_the_linearised_drive_are_those_of_5_12() -> None:
    """9.09 and 34.9 rad/s, with the physical model's own viscous friction; the third is the common pressure, at rest."""
    A, _ = linearised(B_PHYSICAL)
    poles = np.sort(-np.linalg.eigvals(A).real)
    assert poles == pytest.approx([0.0, 1 / 0.11, 34.9], rel=1e-4, abs=1e-4)


def test_low_frequency_gain_is_the_identified_one() -> None:
    """2.27 deg/s per unit command (SYSTEM section 7)."""
    A, column = linearised(B_PHYSICAL)
    still, *_ = np.linalg.lstsq(A, -column * K_VALVE, rcond=None)
    identified = 4.582e5 / 2.02e5
    assert math.degrees(still[2]) == pytest.approx(identified, rel=1e-3)


def test_what_the_structure_cannot_keep() -> None:
    """Friction, and so the load pressure at a speed, is 1.24 times the identified one: the piston's flow feeds back."""
    A, column = linearised(B_PHYSICAL)
    still, *_ = np.linalg.lstsq(A, -column * K_VALVE, rcond=None)
    identified = 5.28e8 * K_VALVE
    assert (still[0] - still[1]) / identified == pytest.approx(1.24, abs=0.005)
    assert pytest.approx(1.24, abs=0.005) == B_PHYSICAL / B_IDENTIFIED
    with_identified_friction = np.sort(-np.linalg.eigvals(linearised(B_IDENTIFIED)[0]).real)[1:]
    assert abs(with_identified_friction / [1 / 0.11, 34.9] - 1).max() > 0.05, "so b cannot stay"


def test_the_drive_cannot_be_slower_damped_than_this() -> None:
    """Why: pole sum = leakage term + b/J and pole product hold b; b = (9.09 + 34.9 - leakage term) J."""
    leak = 2 * P.beta / (P.V_L + P.V_A) * P.C_L
    assert leak + B_PHYSICAL / J == pytest.approx(1 / 0.11 + 34.9, rel=1e-5)
    stiffness = 2 * P.beta / (P.V_L + P.V_A) * (P.A * P.r) ** 2
    assert leak * B_PHYSICAL / J + stiffness / J == pytest.approx(34.9 / 0.11, rel=1e-5)


def test_supply_sags_with_the_flow_drawn() -> None:
    """tau_p dPs/dt = p_s - R_s Q - Ps: at rest it has fallen by R_s times the flow."""
    values = {"R_s": 2e10, "tau_p": 0.05}
    r = run(BLOCK, 1e-3, [1e-3, 0.02], values)
    r.play([(1e-3, 0.02)] * 4000)
    drawn, _ = EQ.port_flows(*r.x[:3], 1e-3, r.p)
    assert drawn > 1e-6
    # the common pressure of the chambers still creeps, and the supply follows it tau_p behind
    assert r.x.p_supply == pytest.approx(P_S - 2e10 * drawn, rel=1e-5)
