"""Pressure effects, each by an independent look at the log."""

import numpy as np
import pytest
from rig_helpers import LEVER, PRESSURE, B, clean, follows, held, lively
from scipy.optimize import brentq

K, K_C, T, P_S = 2.375e-3, 5.28e8, 0.11, 170e5


@pytest.mark.parametrize(
    ("hidden", "gain", "time"),
    [
        ("continuity.flow_gain:K_c=4 bar/mm", 4e8, T),
        ("continuity.leakage:c_l=0.3", K_C / 1.3, T / 1.3),
        ("continuity.compressibility:c_beta=0.8", K_C, 1.8 * T),
    ],
)
def test_pressure_is_a_first_order_lag_of_the_spool(hidden, gain, time):
    run = clean(lively(), hidden)
    # the reference joins the spool's samples by lines: (w0 h)^2 / 8 of it off
    assert np.max(np.abs(run.p_a - run.p_b - follows([gain], [time, 1.0], run.true["spool"]))) < 3 * PRESSURE


def test_asymmetry_is_a_ratio_of_gains():
    load = clean(held((0.6, 3.0), (-0.6, 3.0)), "continuity.flow_asymmetry:a_q=0.2").true["p_load"]
    assert load[2999] / K_C == pytest.approx(0.6 * K * 1.2, rel=1e-6)
    assert load[-1] / load[2999] == pytest.approx(-0.8 / 1.2, rel=1e-6)


def test_leakage_leaves_the_first_rise_and_lowers_the_gain():
    u = held((0.6, 3.0))
    tight, leaky = clean(u).true["p_load"], clean(u, "continuity.leakage:c_l=0.25").true["p_load"]
    assert leaky[-1] / tight[-1] == pytest.approx(1 / 1.25, rel=1e-6)
    assert leaky[5] / tight[5] == pytest.approx(1.0, abs=0.01)


def test_supply_sags_to_its_balance_and_takes_pressure_along():
    run = clean(held((0.8, 4.0), (-0.8, 4.0)), "continuity.supply_sag:k_s=15 bar/mm,tau_s=0.2 s")
    x = 0.8 * K
    balance = brentq(lambda p: P_S - 15e8 * x * np.sqrt(p / P_S) - p, 1e6, P_S)
    for last, sign in ((3999, 1), (-1, -1)):
        assert run.p_supply[last] == pytest.approx(balance, rel=1e-6)
        assert run.true["p_load"][last] == pytest.approx(sign * K_C * x * np.sqrt(balance / P_S), rel=1e-6)
        assert run.p_a[last] + run.p_b[last] == pytest.approx(balance, rel=1e-6)


def test_supply_falls_with_its_own_time_constant():
    run = clean(held((0.8, 2.0), (0.0, 3.0)), "continuity.supply_sag:k_s=10 bar/mm,tau_s=0.3 s")
    drop = P_S - run.p_supply
    # 1 s after the valve began to close its spool is still: the supply recovers as exp(-t/tau_s)
    assert np.log(drop[3000] / drop[3500]) == pytest.approx(0.5 / 0.3, rel=1e-3)


def test_below_cracking_pressure_nothing_moves():
    quiet = clean(held((0.1, 5.0), (-0.1, 5.0)), "continuity.cracking_pressure:p_c=1.3 bar", start=0.2)
    assert np.abs(quiet.true["p_load"]).max() > 1.2e5
    assert np.all(quiet.slew == 0.2)


def test_above_cracking_pressure_the_excess_drives():
    run = clean(held((-0.8, 5.0)), "continuity.cracking_pressure:p_c=2 bar")
    assert run.true["omega"][-1] == pytest.approx(-(0.8 * K * K_C - 2e5) * LEVER / B, rel=1e-6)
