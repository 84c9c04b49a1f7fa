"""The position loops: margins against the source's polynomial, and what the FMUs do at them."""

import json
import math

import numpy as np
import pytest

from cosim.closed_loop import describing_function, is_loop, limit_cycle, margins, why
from cosim.closed_loop import swing as kept_up
from cosim.master import Runner
from cosim.paths import ssp_folder
from cosim.ssp.build import LOOPS
from cosim.ssp.read import read_system
from cosim.ssp.stimulus import default_command, stimulus_csv
from cosim.ssp.write import write_ssp

DEG = math.pi / 180.0
DENOMINATOR = np.array([1.0, 71.5, 2164.0, 3.673e4, 2.02e5, 0.0])  # (5.12), theta/u in deg
GAIN = 4.582e5


@pytest.fixture(scope="module")
def loops(tmp_path_factory):
    """The closed packages by name; the stimulus is that of a default build."""
    folder = tmp_path_factory.mktemp("loops")
    stimulus = stimulus_csv(*default_command())
    return {n: write_ssp(ssp_folder() / f"{n}.ssd", folder / f"{n}.ssp", stimulus=stimulus) for n in LOOPS}


def found(path):
    system = read_system(path)
    try:
        assert is_loop(system)
        return margins(system)
    finally:
        system.close()


def rightmost(gain):
    """Largest real part of the closed loop's poles with a proportional gain [1/deg]: (5.2) on (5.12)."""
    return np.roots(DENOMINATOR + np.array([0, 0, 0, 0, 0, GAIN * gain])).real.max()


def test_the_gain_limit_is_the_sources(loops) -> None:
    loop = found(loops["position_loop"])
    assert loop["gain_limit"] == pytest.approx(6.345, rel=2e-4)
    assert rightmost(0.999 * loop["gain_limit"]) < 0.0 < rightmost(1.001 * loop["gain_limit"])
    assert loop["gain"] == pytest.approx(1.0)
    assert loop["stable"]


def test_the_phase_margin_is_the_phase_of_the_polynomial_at_crossover(loops) -> None:
    loop = found(loops["position_loop"])
    value = GAIN / np.polyval(DENOMINATOR, 1j * loop["crossover"])
    # the printed digits of (5.12) hold to 2e-4
    assert abs(value) == pytest.approx(1.0, rel=1e-3)
    assert loop["phase_margin"] == pytest.approx(180.0 + math.degrees(np.angle(value)), abs=0.05)


def test_the_margin_of_the_observers_loop_is_that_of_its_state_space(loops) -> None:
    """Drive and observer as one matrix of seven states: at the limit its rightmost pole passes the axis."""
    loop = found(loops["position_loop_observer"])
    plant = np.zeros((5, 5))
    plant[:4, 1:] = np.eye(4)
    plant[4] = -DENOMINATOR[:0:-1]
    A, B, C = np.array([[-4.4, 0.0], [1.0, 0.0]]), np.array([4.0, 0.0]), np.array([0.0, 2.5])
    L, K = np.array([7.744, 6.16]), np.array([5.0 * DEG * 2.5, 2.5])
    y = np.array([GAIN, 0.0, 0.0, 0.0, 0.0])

    def pole(factor):
        whole = np.zeros((7, 7))
        whole[:5, :5] = plant
        whole[4, 5:] = -factor * K
        whole[5:, :5] = np.outer(L, y)
        whole[5:, 5:] = A - np.outer(L, C) - np.outer(B, K)
        return np.linalg.eigvals(whole)

    # all gains together are a factor in front of the plant; within the observer they stay
    assert pole(0.998 * loop["gain_margin"]).real.max() < 0.0 < pole(1.002 * loop["gain_margin"]).real.max()
    assert pole(1.0).real.max() < 0.0


def swing(path, gain):
    """Growth of the angle's swing over 6 s, small enough for no limit, with an exact inverse of the dead zone (2.3)."""
    times = np.arange(0.0, 12.0, 1e-3)
    kicked = np.where(times < 0.3, 0.002, 0.0)
    settings = {
        "controller.k_p": gain / DEG,
        "compensator.form": 2,
        "reference.w_max": 1e3,
        "reference.a_max": 1e6,
    }
    with Runner(path) as runner:
        result = runner.run(
            11.9,
            1e-3,
            parameters=settings,
            inputs={"reference.command": (times, kicked)},
            hold=["reference.command"],
            record=["sensor.slew", "controller.u"],
        )
    assert np.abs(result.signals["controller.u"]).max() < 1.0
    slew = result.signals["sensor.slew"]
    return np.ptp(slew[8000:11000]) / np.ptp(slew[2000:5000])


def test_the_fmus_swing_by_themselves_above_the_limit_and_come_to_rest_below(loops) -> None:
    limit = found(loops["position_loop"])["gain_limit"]
    # a command held for 1 ms costs half of it: 0.3 deg at 9.9 rad/s, less than 1 % of the gain limit
    assert swing(loops["position_loop"], 0.97 * limit) < 0.95
    assert swing(loops["position_loop"], 1.03 * limit) > 1.05


def integral(folder, k_i):
    """The proportional loop with an integral, 1/(rad.s); the reference is 10 deg away from the start on."""
    times = np.arange(101) * 1e-3
    return write_ssp(
        ssp_folder() / "position_loop.ssd",
        folder / f"integral_{k_i:g}.ssp",
        stimulus=stimulus_csv(times, np.ones_like(times)),
        values={"controller": {"k_i": k_i}},
    )


@pytest.mark.parametrize("k_i", [50.0, 200.0])
def test_the_margin_of_a_loop_with_an_integral_is_that_of_its_polynomial(tmp_path, k_i) -> None:
    loop = found(integral(tmp_path, k_i))

    def rightmost(factor):
        """(5.2) on (5.12), times s, with k_p + k_i/s."""
        gains = factor * GAIN * np.array([1.0, k_i * DEG])
        return np.roots(np.append(DENOMINATOR, 0.0) + np.append(np.zeros(5), gains)).real.max()

    # the printed digits of (5.12) hold to 2e-4
    assert rightmost(0.998 * loop["gain_margin"]) < 0.0 < rightmost(1.002 * loop["gain_margin"])
    assert loop["stable"]


def test_an_integral_too_large_for_any_gain_is_told(tmp_path, command) -> None:
    path = integral(tmp_path, 350.0)
    assert not found(path)["stable"]
    code, out, _ = command("info", path)
    assert code == 0
    assert "swings by itself at any gain with this integral" in " ".join(out.split())
    code, out, _ = command("info", path, "--json")
    assert code == 0
    assert not json.loads(out)["loop"]["stable"]


STICKING = {"mechanical.tau_c": 100.0, "mechanical.tau_s": 200.0, "mechanical.omega_s": 0.005}


@pytest.mark.parametrize(
    ("k_i", "friction", "seconds", "words"),
    [
        (100.0, STICKING, 60.0, "held by dry friction"),  # in 40 s it is not seen to last
        (0.0, STICKING, 60.0, ""),  # it stops a little off, and stays
        # of one size it makes the swing smaller from turn to turn
        (200.0, {"mechanical.tau_c": 300.0}, 60.0, ""),
        (350.0, {}, 30.0, "beyond its gain limit"),
    ],
)
def test_a_swing_that_friction_or_the_integral_keeps_up_is_found_and_explained(
    tmp_path, k_i, friction, seconds, words
) -> None:
    with Runner(integral(tmp_path, k_i)) as runner:
        result = runner.run(seconds, 1e-3, parameters=friction)
    told = kept_up(result)
    assert (told is not None) == bool(words)
    if told is None:
        return
    assert words in why(told)
    # the loop's own turns, counted on the command in the last 20 s
    u = result.signals["controller.u"][-20_000:]
    rises = np.flatnonzero((u[:-1] < 0.0) & (u[1:] >= 0.0))
    assert np.diff(rises).mean() * 1e-3 == pytest.approx(told["period"], rel=0.05)
    slew = result.signals["sensor.slew"][-20_000:]
    assert np.ptp(slew) / 2 / DEG == pytest.approx(told["angle"], rel=0.05)


def narrower(folder, gain, by):
    """The proportional loop with a dead zone narrower by `by` on each side than the compensator takes it to be."""
    times = np.arange(15_001) * 1e-3
    return write_ssp(
        ssp_folder() / "position_loop.ssd",
        folder / "narrower.ssp",
        stimulus=stimulus_csv(times, np.where(times > 0.5, 0.1, 0.0)),
        values={"dead_zone": {"b_r": 0.45 - by, "b_l": -0.40 + by}, "controller": {"k_p": gain / DEG}},
    )


@pytest.mark.parametrize(("gain", "by"), [(3.0, 0.1), (3.0, 0.05), (1.0, 0.1)])
def test_the_limit_cycle_that_is_predicted_is_the_one_that_the_fmus_keep_up(tmp_path, gain, by) -> None:
    path = narrower(tmp_path, gain, by)
    system = read_system(path)
    try:
        cycle = limit_cycle(system)
    finally:
        system.close()
    with Runner(path) as runner:
        signals = runner.run(15.0, 1e-3, record=["sensor.slew", "controller.u"]).signals
    slew, u = (signals[name][9000:] for name in ("sensor.slew", "controller.u"))
    assert (cycle is not None) == ((gain, by) == (3.0, 0.1))
    if cycle is None:
        assert np.ptp(u) < 1e-9
        return
    # a describing function knows the first harmonic alone: some per cent
    assert np.ptp(slew) / 2 / DEG == pytest.approx(cycle["angle"], rel=0.05)
    assert np.ptp(u) / 2 == pytest.approx(cycle["command"], rel=0.05)
    centred = slew - slew.mean()
    rises = np.flatnonzero((centred[:-1] < 0.0) & (centred[1:] >= 0.0))
    assert 2e3 * math.pi / np.diff(rises).mean() == pytest.approx(cycle["frequency"], rel=0.02)


def test_the_describing_function_is_that_of_the_books_for_a_dead_zone(tmp_path) -> None:
    """Without an inverse: N = 1 - (2/pi)(asin d + d sqrt(1 - d^2)), d = width over amplitude; here two halves."""
    path = write_ssp(
        ssp_folder() / "position_loop.ssd",
        tmp_path / "bare.ssp",
        stimulus=stimulus_csv(*default_command(0.1)),
        values={"compensator": {"d_plus": 0.0, "d_minus": 0.0}},
    )
    system = read_system(path)
    try:
        found = describing_function(system, [0.3, 0.6, 1.0])
    finally:
        system.close()

    def half(width, amplitude):
        d = min(1.0, width / amplitude)
        return 1.0 - 2.0 / math.pi * (math.asin(d) + d * math.sqrt(1.0 - d * d))

    expected = [0.5 * (half(0.45, a) + half(0.40, a)) for a in (0.3, 0.6, 1.0)]
    # the mean over 720 points of a curve with two kinks
    assert found == pytest.approx(expected, abs=2e-5)


def run(path, **settings):
    with Runner(path) as runner:
        result = runner.run(20.0, 1e-3, parameters={k.replace("__", "."): v for k, v in settings.items()})
    return result.signals


def test_state_feedback_with_feed_forward_follows_better(loops) -> None:
    errors = {}
    for name, path in loops.items():
        signals = run(path)
        errors[name] = np.abs(signals["sensor.slew"] - signals["reference.reference"]).max() / DEG
    # the proportional loop trails by rate over gain: 1.8 deg/s over 2.27 1/s, and a little for the dead band of (4.9)
    assert errors["position_loop"] == pytest.approx(1.8 / 2.268, rel=0.05)
    assert errors["position_loop_observer"] < 0.4 * errors["position_loop"]


def test_manual_goes_over_into_automatic_without_a_jump(loops) -> None:
    signals = run(loops["position_loop"], reference__t_switch=3.2)
    u, automatic = signals["controller.u"], signals["reference.automatic"]
    switch = int(np.flatnonzero(np.diff(automatic))[0])
    assert abs(switch - 3199) <= 1
    # in manual it is the stimulus, sampled at the start of each step
    assert np.abs(u[1:switch] - signals["stimulus.u"][: switch - 1]).max() < 1e-12
    assert np.abs(np.diff(u))[switch - 2 : switch + 200].max() < 3e-3


def test_info_prints_the_margins(command, loops) -> None:
    code, out, _ = command("info", loops["position_loop"])
    assert code == 0
    assert "swings by itself from 6.345 1/deg on" in " ".join(out.split())
    assert "Limit cycle: none" in out
    code, out, _ = command("info", loops["position_loop_observer"], "--json")
    facts = json.loads(out)
    assert code == 0
    assert facts["loop"]["phase_margin"] == pytest.approx(71.6, abs=0.1)


def test_simulate_runs_a_loop_by_name_and_says_that_it_has_no_input(
    command, loops, monkeypatch, tmp_path
) -> None:
    folder = next(iter(loops.values())).parent
    (folder / "ssp").symlink_to(folder, target_is_directory=True)
    monkeypatch.setenv("COSIM_BUILD", str(folder))
    code, out, _ = command("simulate", "position_loop", "--stop-time", "12 s", "--json")
    facts = json.loads(out)
    assert code == 0
    assert facts["signals"]["controller.u"]["unit"] == "1"
    # a proportional loop trails a slow reference by one over its velocity gain, 2.27 1/s
    assert facts["tracking"]["lag"] == pytest.approx(1.0 / 2.268, rel=0.05)
    assert 0.0 < facts["tracking"]["rmse"] < facts["tracking"]["largest"] < 1.0
    code, out, _ = command("simulate", "position_loop_observer", "--stop-time", "12 s")
    assert code == 0
    assert "tracking: error" in out
    log = tmp_path / "log.csv"
    log.write_text("time [s],u [1]\n0,0\n0.001,0\n")
    code, _, error = command("simulate", "position_loop", "--input", log)
    assert code == 2
    assert "has no input" in error
