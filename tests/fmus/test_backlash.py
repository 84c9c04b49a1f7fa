"""Lost motion between rack and column: kinematic, or with a far side that creeps up to the flank."""

import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from fmus import registry

REMEMBER = registry.effects()["mechanical.backlash"].remember
GAP = 0.01


def followed(near: np.ndarray, h: float, tau: float) -> np.ndarray:
    """Far side for the near side's angles (n,), from the middle of the gap."""
    p, c = SimpleNamespace(gap=GAP, tau_b=tau), SimpleNamespace(h=h)
    m = SimpleNamespace(backlash_angle=float(near[0]))
    found = [m.backlash_angle]
    for one, two in pairwise(near):
        seen, _ = REMEMBER(SimpleNamespace(theta=one), SimpleNamespace(theta=two), None, m, p, c)
        m = SimpleNamespace(backlash_angle=seen)
        found.append(seen)
    return np.array(found)


def swing(h: float) -> np.ndarray:
    """Some reversals, at rest at the end."""
    t = np.arange(0.0, 4.0, h)
    return 0.03 * np.sin(2.0 * np.pi * t / 2.0) * (t < 3.2) + 0.03 * math.sin(3.2 * math.pi) * (t >= 3.2)


@pytest.mark.parametrize("tau", [0.005, 0.05, 0.5])
def test_the_far_side_creeps_up_to_the_flank(tau: float) -> None:
    """Against scipy: the far side's speed is its distance from where the flank would put it, by the time constant."""
    h = 1e-3
    near = swing(h)
    t = np.arange(near.size) * h

    def rate(now: float, far: np.ndarray) -> np.ndarray:
        theta = np.interp(now, t, near)
        return (np.clip(far, theta - 0.5 * GAP, theta + 0.5 * GAP) - far) / tau

    expected = solve_ivp(rate, (0.0, t[-1]), [near[0]], "RK45", t, max_step=h, rtol=1e-8, atol=1e-10).y[0]
    assert np.abs(followed(near, h, tau) - expected).max() < 2e-3 * GAP


def test_dragged_along_it_is_behind_by_half_the_gap_and_the_lag() -> None:
    near = 0.1 * np.arange(3000) * 1e-3
    assert followed(near, 1e-3, 0.05)[-1] == pytest.approx(near[-1] - 0.5 * GAP - 0.1 * 0.05, rel=1e-9)


@given(st.lists(st.floats(-0.05, 0.05), min_size=2, max_size=40))
def test_without_a_lag_it_is_the_play_operator(near: list[float]) -> None:
    angles = np.array(near)
    far = angles[0]
    expected = [far]
    for theta in angles[1:]:
        far = max(theta - 0.5 * GAP, min(theta + 0.5 * GAP, far))
        expected.append(far)
    assert followed(angles, 1e-3, 0.0).tolist() == expected


@given(st.lists(st.floats(-0.05, 0.05), min_size=2, max_size=40), st.floats(1e-4, 1.0))
def test_a_near_side_within_the_gap_never_moves_it(steps: list[float], tau: float) -> None:
    near = np.clip(np.array([0.0, *steps]), -0.5 * GAP, 0.5 * GAP)
    assert np.abs(followed(near, 1e-3, tau)).max() == 0.0
