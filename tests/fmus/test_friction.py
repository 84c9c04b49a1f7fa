"""Dry friction of the slew mechanics: it sticks truly, breaks away at the right instant, and only takes energy."""

import math

import numpy as np
import pytest
from fmu_bench import Run, bare, orders, run, with_fill
from friction_reference import AR, B, J, reference
from hypothesis import given
from hypothesis import strategies as st

from fmus.contract import Variable, equation

BLOCK = bare("mechanical")
LEVEL = 200.0


def pressures(torques: np.ndarray) -> np.ndarray:
    return (np.asarray(torques) / AR)[:, None]


def on_lines(times: np.ndarray, torques: np.ndarray, n: int) -> np.ndarray:
    """Torques at n steps in each interval between `times`."""
    fine = np.linspace(times[0], times[-1], n * (len(times) - 1) + 1)
    return np.interp(fine, times, torques)


def test_sticks_truly() -> None:
    """A net torque at or below the level moves nothing, not by one bit in 1e5 steps."""
    rng = np.random.default_rng(8)
    torques = np.clip(rng.normal(0.0, LEVEL, 100_001), -LEVEL, LEVEL) * (1 - 1e-15)
    found = run(BLOCK, 1e-3, pressures(torques)[0], {"tau_c": LEVEL, "theta_0": 0.123}).play(
        pressures(torques)
    )
    assert np.all(found[:, 0] == 0.123)
    assert np.all(found[:, 1] == 0.0)


@pytest.mark.parametrize("h", [1e-3, 0.1, 1.0])
def test_breaks_away_at_the_right_instant(h: float) -> None:
    """A torque rising at 100 N m/s passes 200 N m after 2 s; the motion after it is the linear one from there."""
    rate, end = 100.0, 4.0
    torques = rate * np.arange(0.0, end + h / 2, h)
    found = run(BLOCK, h, [0.0], {"tau_c": LEVEL}).play(pressures(torques[1:]))
    t = end - LEVEL / rate
    a = B / J
    omega = rate / J * (a * t - 1 + math.exp(-a * t)) / a**2
    assert found[-1, 1] == pytest.approx(omega, rel=1e-11)
    before = h * np.arange(1, len(found) + 1) < LEVEL / rate - 1e-9
    assert np.all(found[before] == 0.0)


@pytest.mark.parametrize("h", [1e-3, 0.013, 0.5])
def test_stopping_time(h: float) -> None:
    """Without drive, w0 dies out after J/b ln(1 + b w0/tau_c), and stays zero."""
    omega = 0.05
    stop = J / B * math.log(1 + B * omega / LEVEL)
    way = J / B * (omega - LEVEL / J * stop)
    r = run(BLOCK, h, [0.0], {"tau_c": LEVEL}, omega=omega)
    found = r.play([[0.0]] * (math.ceil(stop / h) + 3))
    at_rest = np.flatnonzero(found[:, 1] == 0.0)[0] + 1
    assert (at_rest - 1) * h < stop <= at_rest * h
    assert found[-1, 0] == pytest.approx(way, rel=1e-11)
    assert np.all(found[at_rest:, 1] == 0.0)


@pytest.mark.parametrize("n", [1, 3, 100])
def test_events_lie_inside_steps_of_any_length(n: int) -> None:
    """Coulomb friction under a torque of straight pieces: stick, break away, slide, stop, reverse, against solve_ivp."""
    times = np.arange(0.0, 1.3, 0.1)
    torques = np.array([0, 500, 900, 100, -150, 150, 250, 700, -700, -300, -180, 0, 0], dtype=float)
    expected = reference(times, torques, lambda omega: LEVEL)
    fine = on_lines(times, torques, n)
    found = run(BLOCK, 0.1 / n, [0.0], {"tau_c": LEVEL}).play(pressures(fine[1:]))[n - 1 :: n]
    assert np.abs(found - expected).max(axis=0) == pytest.approx([0, 0], abs=1e-11)
    assert {0.0} < set(expected[:, 1])


@given(
    st.floats(-3000, 3000), st.floats(-0.1, 0.1), st.floats(0.0, 1000.0), st.sampled_from([1e-3, 0.05, 1.0])
)
def test_energy_is_never_created(torque: float, omega: float, tau_c: float, h: float) -> None:
    """Under a constant torque: what the kinetic energy gains is at most the torque's work less the friction's."""
    r = run(BLOCK, h, [torque / AR], {"tau_c": tau_c}, omega=omega)
    for _ in range(8):
        before = r.x
        theta, speed = r.step(torque / AR)
        gained = 0.5 * J * (speed**2 - before.omega**2)
        way = theta - before.theta
        rounding = 1e-11 * (1.0 + abs(torque) + tau_c)
        assert gained <= torque * way - tau_c * abs(way) + rounding


@given(st.lists(st.floats(-3000, 3000), min_size=2, max_size=20), st.floats(0.1, 1000.0))
def test_mirror_images(torques: list[float], tau_c: float) -> None:
    rows = pressures(np.array(torques))
    one = run(BLOCK, 0.05, rows[0], {"tau_c": tau_c}).play(rows)
    other = run(BLOCK, 0.05, -rows[0], {"tau_c": tau_c}).play(-rows)
    assert np.array_equal(one, -other)


def test_a_push_shorter_than_a_step_moves_it() -> None:
    """At rest under 300 N m, falling to zero within the step: it moves, and stops again, all inside one step."""
    h = 0.1
    expected = reference([0.0, h], [300.0, 0.0], lambda omega: LEVEL)[-1]
    found = run(BLOCK, h, [300.0 / AR], {"tau_c": LEVEL}).step(0.0)
    assert expected[0] > 1e-6
    assert found == pytest.approx(tuple(expected), abs=1e-12)


def test_vanishing_friction_tends_to_none() -> None:
    torques = 1000.0 * np.sin(0.05 * np.arange(400))
    free = run(BLOCK, 0.01, [0.0]).play(pressures(torques))
    nearly = run(BLOCK, 0.01, [0.0], {"tau_c": 1e-9}).play(pressures(torques))
    assert np.abs(free - nearly).max() < 1e-13


@equation
def trial_level(omega, m, p):
    """Friction that falls with speed."""
    return p.trial * math.exp(-((omega / 0.02) ** 2))


@equation
def trial_boom(s, theta, omega, x, m, p, c):
    """A torque that depends on angle and velocity."""
    return p.trial * (theta + 0.1 * omega)


def friction_run(fill: object, slot: str, size: float, h: float) -> Run:
    block = with_fill("mechanical", slot, fill, trial=Variable("N.m", "size", 0.0, source="test"))
    return run(block, h, [0.0], {"tau_c": LEVEL, "trial": size})


TIMES = np.array([0.0, 0.4, 0.8, 1.2, 1.6])
TORQUES = np.array([0.0, 1500.0, 900.0, 2500.0, 1000.0])


@pytest.mark.parametrize(
    ("slot", "fill", "size", "level", "load"),
    [
        ("friction_level", trial_level, 150.0, lambda w: LEVEL + 150.0 * math.exp(-((w / 0.02) ** 2)), None),
        ("load_torque", trial_boom, 2e4, lambda w: LEVEL, lambda q, w: 2e4 * (q + 0.1 * w)),
    ],
    ids=["level falls with speed", "load depends on angle and velocity"],
)
def test_second_order_where_terms_depend_on_the_state(slot, fill, size, level, load) -> None:
    exact = reference(TIMES, TORQUES, level, load or (lambda q, w: 0.0))[-1]
    errors = []
    for n in (40, 80, 160, 320):
        fine = on_lines(TIMES, TORQUES, n)
        last = friction_run(fill, slot, size, 0.4 / n).play(pressures(fine[1:]))[-1]
        errors.append(abs(last[0] - exact[0]))
    assert errors[0] > 1e-8, "the term acts"
    # the instant of breaking away falls anywhere within a step, so single ratios scatter about four
    assert math.log2(errors[0] / errors[-1]) / 3 > 1.75, (errors, orders(errors))
