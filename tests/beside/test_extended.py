"""The extended observer on rig logs, against the truth: consistent (NEES, NIS), and better than the simple one."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter
from scipy.stats import chi2

from cosim.beside.extended import DEG, Readings, consistency, filtered, innovations, run_extended
from cosim.beside.tracker import readings_of, run_tracker
from cosim.compare.comparator import Comparator
from cosim.compare.observer import run_observer
from cosim.errors import UsageError
from cosim.identify.kalman import Mechanics, Noises, design
from cosim.identify.nominal import nominal
from cosim.logs import write_log
from cosim.paths import ssp_folder
from cosim.rig import as_log, make_log
from cosim.rig.write import write_tracker
from cosim.ssp.write import write_ssp

H, SECONDS = 1e-3, 22.0
MECHANICS = Mechanics.of(nominal())
NAMES = {
    "theta": "slew_estimate",
    "omega": "slew_rate_estimate",
    "tau": "disturbance",
    "beta": "sensor_error",
}
CASES = {
    "pressure measured": Noises(),
    "pressure of the model": Noises(p_load=0.0),
    "fused with the tracker": Noises(sensor_error=0.1 * DEG, tracker=0.01 * DEG),
}
SEEDS = range(6)


@pytest.fixture(scope="module")
def crane():
    """The nominal crane's true motion."""
    return make_log("mixed", SECONDS, noise=0.0, seed=1, start=5.0 * DEG)


def gauss_markov(rng, size, correlation, count):
    """(count,) samples of a stationary first-order Gauss-Markov process."""
    kept = np.exp(-H / correlation)
    white = rng.standard_normal(count)
    return size * lfilter(
        [np.sqrt(1.0 - kept**2)], [1.0, -kept], np.r_[white[0] / np.sqrt(1.0 - kept**2), white[1:]]
    )


def driven(torque):
    """Angle and velocity (n,) of the column under a torque on straight lines alone; exact, and adds to the rig's motion."""
    lag = MECHANICS.J / MECHANICS.b
    block = np.zeros((4, 4))
    block[0, 1], block[1, 1], block[1, 2], block[2, 3] = 1.0, -1.0 / lag, 1.0 / MECHANICS.J, 1.0
    once = expm(block * H)
    push = np.r_[0.0, once[1, 2] * torque[:-1] + once[1, 3] / H * np.diff(torque)]
    omega = lfilter([1.0], [1.0, -once[1, 1]], push)
    steps = once[0, 1] * omega[:-1] + once[0, 2] * torque[:-1] + once[0, 3] / H * np.diff(torque)
    return np.r_[0.0, np.cumsum(steps)], omega


def record(crane, noises, seed):
    """Truth by state, and what the sensors show of it: the rig's motion, a torque that the model lacks, noise as stated."""
    rng = np.random.default_rng(seed)
    n = crane.u.size
    tau = gauss_markov(rng, noises.disturbance, noises.T_tau, n)
    moved, turned = driven(tau)
    theta = crane.true["theta"] + moved
    beta = gauss_markov(rng, noises.sensor_error, noises.T_beta, n) if noises.sensor_error else np.zeros(n)
    slew = theta + beta + noises.slew * rng.standard_normal(n)
    p_load = crane.true["p_load"] + noises.p_load * rng.standard_normal(n)
    readings = None
    if noises.tracker:
        at = np.arange(1, round(SECONDS / noises.tracker_step)) * noises.tracker_step
        angle = np.interp(at, crane.time, theta) + noises.tracker * rng.standard_normal(at.size)
        readings = Readings(at, angle, noises.tracker)
    truth = {"theta": theta, "omega": crane.true["omega"] + turned, "tau": tau, "beta": beta}
    return truth, p_load, slew, readings


def nees(found, truth, estimates):
    """(k,) normalised errors squared, a second apart: the errors of one have died out by the next."""
    errors = np.array([estimates[NAMES[s]] - truth[s] for s in found.states])[:, 3000::1000]
    return np.einsum("ik,ij,jk->k", errors, np.linalg.inv(found.covariance), errors)


@pytest.fixture(scope="module", params=CASES)
def evidence(request, crane):
    """Filter, and of each seed the NEES and the consistencies of its innovations."""
    noises = CASES[request.param]
    found = design(MECHANICS, noises)
    rows = []
    for seed in SEEDS:
        truth, p_load, slew, readings = record(crane, noises, seed)
        estimates = filtered(found, H, p_load, slew, readings)
        rows.append((nees(found, truth, estimates), *consistency(found, H, slew, estimates, readings)))
    return found, rows


def interval(freedom, level=0.99):
    """Chi-square interval of a mean of squares with so many degrees of freedom."""
    return tuple(chi2.ppf(q, freedom) / freedom for q in (0.5 - level / 2, 0.5 + level / 2))


def test_errors_are_as_large_as_the_filter_says(evidence):
    """NEES over all seeds within its chi-square interval."""
    found, rows = evidence
    squares = np.concatenate([row[0] for row in rows])
    freedom = squares.size * len(found.states)
    low, high = interval(freedom)
    assert low < squares.sum() / freedom < high
    assert high - low < 0.45, "the interval is narrow enough to tell"


def test_innovations_are_as_large_as_the_filter_says(evidence):
    """NIS of all seeds together within its chi-square interval, for the slew sensor and the tracker."""
    _, rows = evidence
    for k in (1, 2):
        parts = [row[k] for row in rows if row[k] is not None]
        if parts:
            low, high = interval(sum(p.count for p in parts))
            assert low < np.mean([p.mean for p in parts]) < high


def test_a_filter_told_a_third_of_the_disturbance_is_found_out(crane):
    """The same logs: what the tests above would refuse."""
    truth, p_load, slew, _ = record(crane, Noises(), 0)
    wrong = design(MECHANICS, Noises(disturbance=100.0 / 3.0))
    estimates = filtered(wrong, H, p_load, slew)
    squares = nees(wrong, truth, estimates)
    assert squares.mean() / 3.0 > 1.5 * interval(3 * squares.size)[1]
    nis, _ = consistency(wrong, H, slew, estimates, None)
    assert nis.mean > nis.interval[1]


def test_innovations_are_white(crane):
    """What a sample tells is new: its correlation with those before lies within 3.3 standard deviations of none."""
    _, p_load, slew, _ = record(crane, Noises(), 3)
    found = design(MECHANICS, Noises())
    e, _ = innovations(found, H, slew, filtered(found, H, p_load, slew), None)
    e = e[3000:]
    for lag in (1, 5, 20, 100):
        assert abs(np.mean(e[lag:] * e[:-lag]) / np.mean(e**2)) < 3.3 / np.sqrt(e.size)


# Rig logs as a user has them


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    file = tmp_path_factory.mktemp("model") / "full_order_open.ssp"
    return write_ssp(ssp_folder() / "full_order.ssd", file, open=True)


FRICTION = 100.0


@pytest.fixture(scope="module")
def rubbing():
    """A crane with dry friction, steps of either sign."""
    levels = np.repeat([0.0, 0.9, -0.9, 0.6, 0.0, -0.6, 0.9, 0.0], 1500)
    return make_log(
        levels, hidden=[f"mechanical.coulomb_friction:tau_c={FRICTION} N.m"], seed=5, observer=True
    )


def test_dry_friction_is_found_where_the_crane_moves(package, rubbing):
    with Comparator(as_log(rubbing), package) as comparator:
        found = run_extended(comparator)
    omega = rubbing.true["omega"]
    friction = -FRICTION * np.sign(omega)
    steady = np.convolve(np.abs(omega) > 0.3 * DEG, np.ones(400), "valid") == 400
    steady = np.r_[np.zeros(399, dtype=bool), steady]  # has slid one way for 0.4 s
    steady[:2000] = False
    assert steady.sum() > 4000
    error = found.estimates["disturbance"][steady] - friction[steady]
    # a Gauss-Markov disturbance of 1 s pulls a constant one towards zero by a few per cent
    assert np.abs(np.mean(error * np.sign(friction[steady]))) < 0.12 * FRICTION
    assert np.std(error) < 1.2 * found.designed.deviations["tau"]


def test_velocity_is_far_nearer_to_the_truth_than_the_simple_observer_s(package, rubbing):
    with Comparator(as_log(rubbing), package) as comparator:
        simple, found = run_observer(comparator), run_extended(comparator)
    errors = [
        np.sqrt(np.mean((run.estimates["slew_rate_estimate"] - rubbing.true["omega"])[2000:] ** 2)) / DEG
        for run in (simple, found)
    ]
    assert errors[1] < 0.07
    assert errors[1] < 0.5 * errors[0]


def test_without_pressures_it_runs_on_the_full_order_model(package, rubbing):
    """Command and slew alone: the model makes the pressure, and friction is found as well."""
    whole, keep = as_log(rubbing), ("u", "slew")
    parts = {part: {n: getattr(whole, part)[n] for n in keep} for part in ("signals", "units", "display")}
    log = dataclasses.replace(whole, **parts)
    with Comparator(log, package) as comparator:
        found = run_extended(comparator)
    assert not found.measured_pressure
    assert "the load pressure is the model's" in found.notes[0]
    moving = np.abs(rubbing.true["omega"]) > 0.8 * DEG
    moving[:2000] = False
    size = np.mean(found.estimates["disturbance"][moving] * -np.sign(rubbing.true["omega"][moving]))
    assert size == pytest.approx(FRICTION, rel=0.2)


def test_fused_angle_is_right_where_the_slew_sensor_is_not(package, tmp_path):
    """Sensor 0.3 deg off, tracker with a seam and a clock of its own: both found from the records, then fused."""
    hidden = ["sensor.bias:bias=0.3 deg", "tracker.seam", "tracker.clock"]
    run = make_log("mixed", 25.0, hidden=hidden, seed=6, tracker=True)
    write_tracker(run, tmp_path / "tracker.csv")
    log = as_log(run)
    readings = readings_of(run_tracker(log, tmp_path / "tracker.csv"))
    with Comparator(log, package) as comparator:
        found = run_extended(comparator, readings=readings)
    error = (found.estimates["slew_estimate"] - run.true["seen"])[3000:] / DEG
    sensor = (run.slew - run.true["seen"])[3000:] / DEG
    assert np.sqrt(np.mean(sensor**2)) > 0.3
    # what is left is the zero that the records tell, to a few thousandths, and the filter's own noise
    assert np.sqrt(np.mean(error**2)) < 0.01
    assert np.mean(found.estimates["sensor_error"][3000:]) / DEG == pytest.approx(0.3, abs=0.01)
    low, high = found.nis_external.interval
    assert low - 0.05 < found.nis_external.mean < high + 0.05


def test_a_model_without_mechanics_is_refused(package, tmp_path, rubbing):
    simple = write_ssp(ssp_folder() / "simplified.ssd", tmp_path / "simplified_open.ssp", open=True)
    with (
        Comparator(as_log(rubbing), simple) as comparator,
        pytest.raises(
            UsageError, match="corrects the component 'mechanical', which 'simplified' does not have"
        ),
    ):
        run_extended(comparator)


def test_the_screen_tells_the_observers_in_sentences_and_the_table_on_demand(
    package, rubbing, command, tmp_path
):
    log = write_log(as_log(rubbing), tmp_path / "log.parquet")
    words = ("compare", log, "--model", package, "--observer")
    code, told, err = command(*words)
    assert code == 0, err
    angles = [line for line in told.splitlines() if line.startswith("Observer: its slew angle is ")]
    assert sum(" deg RMSE off the measured slew, " in line for line in angles) == 1
    assert "Observer FMU on the log" not in told
    assert "NIS" not in told
    assert "By the readings of the slew sensor " in told
    assert "Observer FMU on the log" in command(*words, "--verbose")[1]
