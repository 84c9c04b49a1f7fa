"""Pressure effects, each by an independent look at the log."""

import numpy as np
import pytest
from rig_helpers import LEVER, PRESSURE, B, clean, follows, held, lively
from scipy.optimize import brentq

from cosim.errors import UsageError
from cosim.rig import make_log

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


def test_the_physical_system_keeps_4_19_and_4_20():
    """Compressed oil, in chambers that follow the motion, is what comes in less what the piston and the leaks take."""
    values = {"continuity.C_A": 3e-12, "continuity.R_s": 2e10, "continuity.p_t": 2e5}
    run = make_log(
        lively(), hidden=["continuity.leakage:c_l=2", "continuity.compressibility:c_beta=0.5"], settings=values,
        model="physical", noise=0.0,
    )  # fmt: skip
    true, beta, volume = run.true, 7e8 / 1.5, 4.5e-3
    p_a, p_b = (0.5 * (true["p_sum"] + sign * true["p_load"]) for sign in (1.0, -1.0))
    rate_a, rate_b, rate_s = (np.gradient(p, 1e-3, edge_order=2) for p in (p_a, p_b, true["p_supply"]))
    k = 0.65 * 1.6980384670641e-4 * np.sqrt(2.0 / 870.0) * true["spool"]
    opened = true["spool"] > 0.0
    q_a = k * np.sqrt(np.where(opened, true["p_supply"] - p_a, p_a - 2e5))
    q_b = -k * np.sqrt(np.where(opened, p_b - 2e5, true["p_supply"] - p_b))
    swept = LEVER * true["omega"] + 3.0 * 2.1215307141765915e-12 * true["p_load"]
    moved = LEVER * (true["theta"] - true["theta"][0])
    assert np.ptp(moved) > 1e-5
    for rate, flow, room in (
        (rate_a, q_a - swept - 3e-12 * (p_a - 2e5), volume + moved),
        (rate_b, q_b + swept, volume - moved),
    ):
        expected = beta / room * flow
        assert np.abs(rate - expected)[5:-5].max() < 2e-3 * np.abs(expected).max()
    drawn = np.where(opened, q_a, q_b)
    # its rate has kinks where the flow changes ports
    off = 0.1 * rate_s - (P_S - 2e10 * drawn - true["p_supply"])
    assert np.abs(off)[5:-5].max() < 1e-2 * 2e10 * drawn.max()


def test_the_two_hydraulics_have_parameters_of_their_own():
    with pytest.raises(
        UsageError, match=r"continuity\.w acts in the physical system only: add --model physical"
    ):
        make_log("steps", 1.0, settings={"continuity.w": 1e-4})
    for hidden in ("continuity.flow_gain", "continuity.supply_sag", "continuity.flow_pressure"):
        with pytest.raises(UsageError, match="has no place in the physical system: set"):
            make_log("steps", 1.0, [hidden], model="physical")
    with pytest.raises(UsageError, match="is chosen by the model: --model physical"):
        make_log("steps", 1.0, settings={"continuity.physical": 1.0})
    with pytest.raises(UsageError, match="no model 'phisical' of the rig: did you mean physical"):
        make_log("steps", 1.0, model="phisical")
    run = make_log("steps", 1.0, ["mechanical.inertia", "continuity.leakage:c_l=1"], model="physical")
    assert run.truth["model"] == "physical"
    off = run.truth["not_nominal"]
    assert set(off) == {"mechanical.J", "mechanical.theta_0", "continuity.c_l", "continuity.C_L"}
    assert off["continuity.C_L"]["value"] == pytest.approx(2.0 * 2.1215307141765915e-12, rel=1e-12)
