"""Gains of the extended observer against python-control's other solvers, the whole drive, and the block's own numbers."""

import math

import control
import numpy as np
import pytest

from cosim.errors import UsageError
from cosim.identify.kalman import DEG, STATES, Mechanics, Noises, design, matrices
from cosim.identify.nominal import nominal
from cosim.identify.run_kalman import kalman_answer
from cosim.identify.state_space import design_observer, drive, error_dynamics, modal_form
from fmus import registry

KNOWN = nominal()
MECHANICS = Mechanics.of(KNOWN)
FUSED = Noises(sensor_error=0.1 * DEG, tracker=0.01 * DEG)


def test_the_block_s_defaults_are_the_filter_of_the_default_noises():
    found, declared = design(MECHANICS, Noises()).values(), registry.block("observer_extended").parameters
    for name, value in found.items():
        assert declared[name].start == pytest.approx(value, rel=2e-6), name


def test_valve_and_pressure_have_no_gain_in_the_filter_of_the_whole_drive():
    """Their states have no noise of their own: the filter of all six states is the one of three behind the model."""
    noises = Noises(p_load=0.0)
    m = MECHANICS
    w0, zeta, T = KNOWN["dcv.w0"], KNOWN["dcv.zeta"], KNOWN["continuity.T"]
    K_c = KNOWN["continuity.K_c"]
    # spool [mm], its rate, load pressure [bar], theta [deg], omega [deg/s], tau [100 N.m]
    A = np.zeros((6, 6))
    A[0, 1], A[1, 0], A[1, 1] = 1.0, -(w0**2), -2.0 * zeta * w0
    A[2, 0], A[2, 2] = K_c * 1e-3 / 1e5 / T, -1.0 / T
    A[3, 4], A[4, 2], A[4, 4], A[4, 5] = 1.0, m.A * m.r * 1e5 / m.J / DEG, -m.b / m.J, 100.0 / m.J / DEG
    A[5, 5] = -1.0 / noises.T_tau
    W = np.zeros((6, 6))
    W[5, 5] = 2.0 * (noises.disturbance / 100.0) ** 2 / noises.T_tau
    C = np.zeros((1, 6))
    C[0, 3] = 1.0
    L, _, _ = control.lqe(A, np.eye(6), C, W, [[(noises.slew / DEG) ** 2 * noises.step]])
    L = np.asarray(L).ravel()
    assert np.abs(L[:3]).max() < 1e-6 * np.abs(L[3:]).max()
    own = design(m, noises).gain
    assert L[3:] == pytest.approx(own * np.array([1.0, 1.0, DEG / 100.0]), rel=1e-5)


@pytest.mark.parametrize("noises", [Noises(), Noises(disturbance=20.0, T_tau=5.0), FUSED])
def test_gains_solve_the_riccati_equation(noises):
    """L = P C' / R with P of 0 = A P + P A' + W - P C' R^-1 C P, written out."""
    found = design(MECHANICS, noises)
    _, A, W, C = matrices(MECHANICS, noises)
    fused = noises.tracker > 0.0
    L = np.column_stack([found.gain, found.reading / noises.tracker_step] if fused else [found.gain])
    rows = C if fused else C[:1]
    R = np.diag([noises.slew**2 * noises.step, noises.tracker**2 * noises.tracker_step][: len(rows)])
    closed = A - L @ rows
    unit = np.array([{"tau": MECHANICS.J}.get(n, 1.0) * noises.slew for n in found.states])
    scaled = (W + L @ R @ L.T) / np.outer(unit, unit)
    P = np.outer(unit, unit) * control.lyap(closed * unit / unit[:, None], 0.5 * (scaled + scaled.T))
    size = np.sqrt(np.diag(P))
    assert pytest.approx(P @ rows.T @ np.linalg.inv(R), rel=1e-5, abs=1e-6 * float(np.abs(L).max())) == L
    left = A @ P + P @ A.T + W - P @ rows.T @ np.linalg.inv(R) @ rows @ P
    assert np.abs(left / np.outer(size, size)).max() < 1e-5 * float(np.abs(found.poles).max())


def test_covariance_of_samples_is_that_of_the_discrete_filter_for_short_steps():
    """python-control's own discrete filter for the same samples: the continuous gain loses next to nothing at 1 kHz."""
    from cosim.identify.kalman import discretised

    noises = Noises()
    found = design(MECHANICS, noises)
    _, A, W, C = matrices(MECHANICS, noises)
    F, Q = discretised(A, W, noises.step)
    S = np.diag([noises.slew, noises.slew, noises.slew * MECHANICS.J])
    T = np.linalg.inv(S)
    _, P, _ = control.dlqe(T @ F @ S, np.eye(3), C[:1] @ S, T @ Q @ T.T, [[noises.slew**2]])
    P = S @ np.asarray(P) @ S  # before the correction
    kept = P - P @ C[:1].T @ C[:1] @ P / (C[0] @ P @ C[0] + noises.slew**2)
    best = np.sqrt(np.diag(kept))
    own = np.array([found.deviations[n] for n in found.states])
    assert np.all(own >= best * (1.0 - 1e-9)), "no filter is better than the best"
    assert own == pytest.approx(best, rel=0.01)


def test_a_tracker_makes_every_estimate_better():
    alone, fused = design(MECHANICS, Noises()), design(MECHANICS, Noises(tracker=0.002 * DEG))
    assert all(fused.deviations[n] < alone.deviations[n] for n in alone.states)
    with_error = design(MECHANICS, FUSED)
    assert with_error.states == STATES
    assert with_error.deviations["beta"] < 0.1 * FUSED.sensor_error


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sensor_error": 0.01}, "shows only beside the tracker"),
        ({"disturbance": 0.0, "p_load": 0.0}, "the model is exact: give a disturbance"),
        ({"slew": 0.0}, "needs slew above 0, not 0"),
        ({"T_tau": -1.0}, "needs T_tau above 0"),
        ({"disturbance": math.nan}, "disturbance is a standard deviation"),
    ],
)
def test_noises_that_make_no_sense_are_refused(options, message):
    with pytest.raises(UsageError, match=message):
        Noises(**options)


def test_a_filter_too_fast_for_its_samples_is_refused():
    with pytest.raises(UsageError, match=r"too fast for samples every 0.001 s .* less disturbance"):
        design(MECHANICS, Noises(disturbance=1e7))


def test_answer_sets_the_component_observer():
    answer = kalman_answer(KNOWN, FUSED)
    assert {f"observer.{n}" for n in ("J", "T_tau", "T_beta", "l_theta", "k_beta")} <= set(answer.parameters)
    assert answer.data["standard_deviation"]["beta"]["unit"] == "deg"


def test_modal_form_of_the_plant_and_of_the_error():
    """Diagonal, the same transfer function, and one mode for each pole of (4.35) and (2.16)."""
    plant = drive()
    observer = design_observer(plant)
    for system, poles in ((plant, [0.0, -4.4]), (error_dynamics(observer), [-6.6, -13.2])):
        found = modal_form(system)
        assert found.poles == pytest.approx(poles, abs=1e-12)
        assert np.linalg.solve(found.T, system.A @ found.T) == pytest.approx(np.diag(poles), abs=1e-12)
        s = 3.0j
        whole = system.C @ np.linalg.solve(s * np.eye(2) - system.A, system.B)
        parts = np.sum(found.C.ravel() * found.B.ravel() / (s - found.poles))
        assert parts == pytest.approx(complex(whole[0, 0]), rel=1e-12)
    with pytest.raises(UsageError, match="no modal form"):
        modal_form(error_dynamics(design_observer(plant, [-8.0, -8.0])))
