"""The controller and its reference: gains, limits, anti-windup, and switches without a jump."""

import math

import numpy as np
import pytest
from fmu_bench import bare, run
from hypothesis import given
from hypothesis import strategies as st

CONTROLLER, REFERENCE = bare("controller"), bare("reference")
H = 1e-3
OFF = {"k_f": 0.0, "k_d": 0.0}


def rows(n, **columns):
    """Inputs of the controller: columns are numbers or rows (n,)."""
    names = ("reference", "reference_rate", "slew", "slew_rate", "manual", "automatic")
    return np.column_stack([np.broadcast_to(columns.get(name, 0.0), n) for name in names])


def played(table, **parameters):
    return run(CONTROLLER, H, table[0], parameters).play(table)[:, 0]


def test_the_law_is_the_sum_of_its_terms() -> None:
    table = rows(
        1, reference=0.02, reference_rate=0.01, slew=0.015, slew_rate=0.004, manual=0.9, automatic=1.0
    )
    p = run(CONTROLLER, H, table[0]).p
    expected = p.k_p * 0.005 + p.k_f * 0.01 - p.k_d * 0.004
    assert played(table)[0] == pytest.approx(expected, rel=1e-14)


def test_manual_is_the_command_itself() -> None:
    manual = np.sin(np.arange(500) / 50.0) * 0.7
    assert np.array_equal(played(rows(500, manual=manual, slew=0.3)), manual)


def test_output_and_rate_are_limited() -> None:
    u = played(rows(3000, reference=1.0, automatic=np.arange(3000) >= 10), r_max=2.0, u_max=0.8)
    assert np.abs(np.diff(u)).max() <= 2.0 * H * (1 + 1e-12)
    assert u.max() == 0.8
    assert np.flatnonzero(u == 0.8)[0] >= 400


def test_integral_removes_a_constant_error_and_does_not_wind_up() -> None:
    """A drive without an integrator of its own, y = u - 0.2, and a reference out of reach for five seconds."""
    reference = np.where(np.arange(20_000) < 5000, 3.0, 0.5)
    step = run(CONTROLLER, H, rows(1, automatic=1.0)[0], {**OFF, "k_p": 0.5, "k_i": 5.0})
    y, seen, commands = -0.2, [], []
    for target in reference:
        (u,) = step.step(target, 0.0, y, 0.0, 0.0, 1.0)
        y += H / 0.05 * (u - 0.2 - y)
        seen.append(y)
        commands.append(u)
    assert max(commands) == 1.0
    assert seen[-1] == pytest.approx(0.5, abs=1e-6)
    back = np.flatnonzero(np.array(commands[5000:]) < 1.0)[0]
    assert back <= 1, "an integral that had wound up for 5 s would hold the limit for seconds"


@pytest.mark.parametrize("k_i", [0.0, 100.0])
def test_a_switch_does_not_jump_either_way(k_i) -> None:
    automatic = (np.arange(6000) // 1500) % 2
    table = rows(6000, reference=0.009, slew=0.001, manual=-0.3, automatic=automatic)
    u = played(table, k_i=k_i)
    law = 57.29577951308232 * 0.008
    largest = (law + 0.3) * H / 0.5 + k_i * 0.008 * H
    assert np.abs(np.diff(u))[:1499].max() == 0.0
    assert np.abs(np.diff(u)).max() <= (largest + abs(u).max() * H / 0.5) * 1.01
    if k_i == 0.0:
        assert u[2999] == pytest.approx(law - (law + 0.3) * math.exp(-3.0), abs=5e-3)


def test_without_the_bias_a_switch_would_jump() -> None:
    """What the test above measures: fading in a millisecond is the jump itself."""
    table = rows(100, reference=0.009, slew=0.001, manual=-0.3, automatic=np.arange(100) >= 50)
    assert np.abs(np.diff(played(table, T_bias=1e-6))).max() > 0.5


@given(st.floats(-1.0, 1.0))
def test_the_inverse_dead_zone_is_that_of_the_compensator(u) -> None:
    table = rows(1, manual=u)
    own = played(table, d_plus=0.45, d_minus=0.40, S=50.0)[0]
    other = run(bare("dead_zone"), H, [u], {"form": 3.0, "limit": 2.0}).step(u)[0]
    assert own == pytest.approx(other, abs=1e-15)


@given(st.floats(-1.0, 1.0), st.floats(0.002, 0.2), st.floats(0.01, 1.0), st.sampled_from([1e-3, 5e-3, 0.02]))
def test_the_reference_arrives_within_its_limits_and_stays(target, w_max, a_max, h) -> None:
    values = {"scale": 1.0, "w_max": w_max, "a_max": a_max}
    length = abs(target) / w_max + 2.0 * w_max / a_max + 1.0
    n = min(round(length / h), 40_000)
    time = h * np.arange(1, n + 1)
    found = run(REFERENCE, h, [target, 0.0, 0.0], values).play(
        np.column_stack([np.full(n, target), np.zeros(n), time])
    )
    angle, rate = found[:, 0], found[:, 1]
    assert np.abs(rate).max() <= w_max * (1 + 1e-12)
    assert np.abs(np.diff(rate, prepend=0.0)).max() <= a_max * h * (1 + 1e-9)
    # it brakes for whole steps, so the last one may pass the target by a part of what one step changes
    assert np.abs(angle).max() <= abs(target) + 0.25 * a_max * h * h
    if n < 40_000:
        assert angle[-1] == pytest.approx(target, abs=1e-9)


def test_the_reference_stands_at_the_measured_angle_until_the_switch() -> None:
    n = 2000
    time = H * np.arange(1, n + 1)
    slew = 0.1 + 0.01 * np.sin(time)
    found = run(REFERENCE, H, [0.5, 0.1, 0.0], {"t_switch": 1.0}).play(
        np.column_stack([np.full(n, 0.5), slew, time])
    )
    before = time < 1.0 - 1e-9
    assert np.array_equal(found[before, 0], slew[before])
    assert np.array_equal(found[:, 2], np.where(before, 0.0, 1.0))
    assert np.abs(np.diff(found[:, 0])).max() < 0.0315 * H + 1e-5
