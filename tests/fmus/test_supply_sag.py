"""The supply falls with the flow drawn: of second order in the step."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmus import registry

REMEMBER = registry.effects()["continuity.supply_sag"].remember
P_S, K_S, TAU = 170e5, 1.5e9, 0.12


def spool(t):
    """Never through zero, where the flow has a corner, m."""
    return 1.5e-3 + 0.8e-3 * np.sin(7.0 * t)


def played(h: float) -> np.ndarray:
    """Supply at the end of each step over two seconds, Pa."""
    p, c = SimpleNamespace(p_s=P_S, k_s=K_S, tau_s=TAU), SimpleNamespace(h=h)
    supply, last, found = P_S, float(spool(0.0)), []
    for k in range(1, round(2.0 / h) + 1):
        m = SimpleNamespace(sag_supply=supply, sag_spool=last)
        supply, last = REMEMBER(None, None, SimpleNamespace(spool=float(spool(k * h))), m, p, c)
        found.append(supply)
    return np.array(found)


def error(h: float) -> float:
    """Largest distance from scipy's solution, Pa."""

    def rate(t, supply):
        return (P_S - K_S * spool(t) * np.sqrt(supply / P_S) - supply) / TAU

    t = np.arange(1, round(2.0 / h) + 1) * h
    exact = solve_ivp(rate, (0.0, 2.0 + 1e-9), [P_S], "DOP853", t, rtol=1e-11, atol=1e-3).y[0]
    return float(np.abs(played(h) - exact).max())


def test_a_millisecond_is_exact_to_a_thousandth_of_the_sensors_noise() -> None:
    assert error(1e-3) < 1e-3 * 0.1e5


def test_half_the_step_has_a_quarter_of_the_error() -> None:
    assert error(8e-3) / error(4e-3) == pytest.approx(4.0, rel=0.15)


def test_at_rest_it_stays() -> None:
    p, c = SimpleNamespace(p_s=P_S, k_s=K_S, tau_s=TAU), SimpleNamespace(h=1e-3)
    m, u = SimpleNamespace(sag_supply=P_S, sag_spool=0.0), SimpleNamespace(spool=0.0)
    assert REMEMBER(None, None, u, m, p, c) == (P_S, 0.0)
