"""``cosim identify mechanics``: inertia and friction of synthetic cranes within their intervals; what it refuses."""

import dataclasses
import json
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from identify_truth import TRUTH, inside, least
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.signal import lfilter
from test_identify_command import call

from cosim.diagnosis.model.choice import machine_of
from cosim.errors import DataError, UsageError
from cosim.identify.data import travels
from cosim.identify.inverse_dynamics import Motion, _Problem, coherent_band, identify_mechanics
from cosim.identify.picture import mechanics_figure
from cosim.identify.run_mechanics import _sentences, motion_of
from cosim.lexicon import Lexicon, speaking
from cosim.logs import write_log
from cosim.machines.table import TRAVEL
from cosim.rig import Noise, as_log, make_log

FRICTION, WEIGHT = 120.0, -60.0
HIDDEN = (f"mechanical.coulomb_friction:tau_c={FRICTION} N.m",)
CRANE = {name.partition(".")[2]: value for name, value in TRUTH.items() if name.startswith("mechanical.")}


def motion(log):
    return motion_of(log, machine_of(None, log, None))


@cache
def rubbing(seed=1, excitation="mixed", seconds=40.0, kind="white", **options):
    return as_log(make_log(excitation, seconds, HIDDEN, seed=seed, noise=Noise(kind=kind), **options))


def pulled(found, torque):
    """The same motion, more torque behind it."""
    return dataclasses.replace(found, torque=found.torque + torque)


@pytest.mark.parametrize(
    ("excitation", "kind"),
    [
        pytest.param("mixed", "white", marks=pytest.mark.slow),
        pytest.param("steps", "ar1", marks=pytest.mark.slow),
        ("multisine", "pink"),
    ],
)
def test_intervals_hold_the_truth(excitation, kind):
    """Friction and, added to the torque, a weight: eight logs a kind, four numbers each; not more miss than 5 % leave."""
    truth = {**CRANE, "tau_c": FRICTION, "tau_load": WEIGHT}
    hits = trials = 0
    for seed in range(8):
        found = identify_mechanics(pulled(motion(rubbing(100 + seed, excitation, kind=kind)), WEIGHT))
        known = found.values | found.not_shown
        hits += sum(inside(known[name], value) for name, value in truth.items())
        trials += len(truth)
    assert hits >= least(trials, 0.93), (hits, trials)


def test_what_is_not_there_is_left_out(mixed):
    found = identify_mechanics(motion(mixed(seed=3, seconds=40.0)))
    assert set(found.values) == {"J", "b"}
    assert all(inside(found.not_shown[name], 0.0) for name in ("tau_c", "tau_load"))
    assert all(inside(found.values[name], CRANE[name]) for name in ("J", "b"))


def test_without_noise_to_five_digits(clean):
    found = identify_mechanics(motion(clean))
    assert {n: found.values[n].value for n in ("J", "b")} == pytest.approx(CRANE, rel=1e-4)
    assert found.fit > 99.9
    shown = found.used
    np.testing.assert_allclose(found.torque()[shown], found.motion.torque[shown], atol=2.0)


def test_instruments_take_off_the_bias_of_differentiated_noise():
    """Plain least squares reads an inertia too small, by far more than its interval; the instruments do not."""
    ratios, scores = [], []
    for seed in range(6):
        given = motion(rubbing(200 + seed))
        problem = _Problem(given, 8.0)
        rows, torque = problem.numbers(problem.rows), problem.numbers(given.torque)
        found = identify_mechanics(given, highest=8.0).values["J"]
        ratios.append(np.linalg.lstsq(rows.T, torque, rcond=None)[0][0] / CRANE["J"])
        scores.append((found.value - CRANE["J"]) / found.deviation)
    assert np.mean(ratios) < 0.8
    assert abs(np.mean(scores)) < 1.5


@pytest.mark.parametrize("factor", [0.25, 40.0])
def test_numbers_scale_with_the_torque(factor):
    """Twice the torque for the same motion is twice the inertia, friction and load, each interval with it."""
    given = motion(rubbing())
    known = {**given.values, "A": given.values["A"] * factor}
    one = identify_mechanics(given)
    other = identify_mechanics(dataclasses.replace(given, torque=factor * given.torque, values=known))
    assert set(one.values) == set(other.values)
    for name, quantity in one.values.items():
        assert other.values[name].value == pytest.approx(factor * quantity.value, rel=1e-6)
        assert other.values[name].deviation == pytest.approx(factor * quantity.deviation, rel=1e-6)


def test_band_ends_where_noise_begins(clean):
    quiet = motion(clean)
    noisy = motion(rubbing())
    wide, narrow = (coherent_band(m.torque, m.angle, m.step) for m in (quiet, noisy))
    assert wide > 2.0 * narrow
    assert narrow > 1.5


def test_a_motor_s_torque_and_speed_are_enough(tmp_path):
    """A random torque up to 30 Hz at 240 samples a second, as test stands play: it moves faster than noise is looked for."""
    truth = {"J": 5.6e-4, "b": 5.5e-3, "tau_c": 0.04}
    rng, h, fine = np.random.default_rng(8), 1.0 / 240.0, 40
    t = np.arange(0.0, 40.0, h)
    w, phase = 2.0 * np.pi * rng.uniform(0.3, 30.0, 120), rng.uniform(0.0, 2.0 * np.pi, 120)
    torque = 0.03 * np.sin(w * t[:, None] + phase).sum(axis=1)
    omega, speed = 0.0, np.empty(t.size)
    for k, ends in enumerate(zip(torque, np.append(torque[1:], torque[-1]), strict=True)):
        speed[k] = omega
        for push in np.linspace(*ends, fine, endpoint=False):
            omega += h / fine / truth["J"] * (push - truth["b"] * omega - truth["tau_c"] * np.sign(omega))
    speed += 0.05 * rng.standard_normal(t.size)
    rows = np.column_stack([t, torque, speed])
    (tmp_path / "log.csv").write_text(
        "t [s],torque [N.m],speed [rad/s]\n" + "\n".join(",".join(f"{x:.9g}" for x in row) for row in rows)
    )
    (tmp_path / "m.toml").write_text(
        '[time]\ncolumn = "t [s]"\n[signals.torque]\ncolumn = "torque [N.m]"\ntext = "torque"\n[signals.speed]\n'
        'column = "speed [rad/s]"\n[machine]\nchain = ["mechanical"]\ndrive = "electric"\ninput = "torque"\n'
        'output = "speed"\nspeed = "?"\nlag = "?"\n'
    )
    done = call("mechanics", tmp_path / "log.csv", "--mapping", tmp_path / "m.toml", "--json")
    found = json.loads(done.stdout)["parameters"]
    for name, value in truth.items():
        assert found[f"mechanical.{name}"]["value"] == pytest.approx(value, rel=0.1), name


def test_missing_samples_say_nothing():
    """A second of nonsense that the log marks as filled changes no number by more than its deviation."""
    given = motion(rubbing())
    angle, keep = given.angle.copy(), given.keep.copy()
    hole = slice(15_000, 16_000)
    angle[hole], keep[hole] = np.linspace(angle[14_999], angle[16_000], 1000), False
    whole = identify_mechanics(given).values
    holed = identify_mechanics(dataclasses.replace(given, angle=angle, keep=keep)).values
    for name, quantity in whole.items():
        assert abs(holed[name].value - quantity.value) < 1.5 * quantity.deviation


def test_command_writes_a_parameter_set_a_picture_and_json(tmp_path):
    file = write_log(rubbing(), tmp_path / "log.parquet")
    out = tmp_path / "found"
    found = json.loads(call("mechanics", file, "--out", out, "--json").stdout)
    assert found["synthetic"]
    assert set(found["parameters"]) == {"mechanical.J", "mechanical.b", "mechanical.tau_c"}
    assert 'name="mechanical.tau_c"' in (out / "mechanics.ssv").read_text(encoding="utf-8")
    assert (out / "mechanics.png").stat().st_size > 20_000
    text = call("mechanics", file).stdout
    assert "from a synthetic log" in text
    assert "no constant load shows in this log" in text
    assert "mechanical.tau_c = " in text
    assert "95 % from" not in text  # the table
    assert "95 % from" in call("mechanics", file, "--verbose").stdout


def test_picture_shows_the_friction_law():
    found = identify_mechanics(motion(rubbing().slice(8.0, None)))
    figure = mechanics_figure(found, machine_of(None, rubbing(), None).lexicon)
    assert isinstance(figure, Figure)
    FigureCanvasAgg(figure)
    law = figure.axes[0]
    left, right = (line.get_ydata() for line in law.lines[1:3])
    # the law jumps by twice the dry friction at standstill
    assert right[0] - left[-1] == pytest.approx(2.0 * found.values["tau_c"].value, rel=1e-6)
    assert law.get_xlabel() == "velocity [deg/s]"
    assert figure.axes[1].lines[0].get_xdata()[0] == pytest.approx(8.0)  # the log's own time


def test_known_numbers_can_be_given(tmp_path):
    """Half the arm: half the torque behind the same motion."""
    file = write_log(rubbing(), tmp_path / "log.parquet")
    whole, half = (
        json.loads(call("mechanics", file, "--json", *extra).stdout)["parameters"]["mechanical.b"]["value"]
        for extra in ((), ("--set", "mechanical.r=50 mm"))
    )
    assert half == pytest.approx(0.5 * whole, rel=1e-6)


@pytest.mark.parametrize("text", ["mechanical.J=800", "dcv.K=2 mm", "mechanical.r", "mechanical.r=2 bar"])
def test_impossible_settings_are_refused(text, tmp_path):
    file = write_log(rubbing(), tmp_path / "log.parquet")
    with pytest.raises(UsageError, match=r"mechanical|bar"):
        call("mechanics", file, "--set", text)


@pytest.mark.parametrize("highest", [0.0, -3.0, 300.0, float("nan")])
def test_frequencies_that_the_log_does_not_resolve_are_refused(highest):
    with pytest.raises(UsageError, match=r"--highest .* between 0 and .* 200 Hz"):
        identify_mechanics(motion(rubbing()), highest=highest)


def test_a_model_without_mechanics_is_refused():
    log = rubbing()
    with pytest.raises(UsageError, match=r"'simplified' has no block 'mechanical'.*simplified"):
        motion_of(log, machine_of("simplified", log, None))


def test_refusals_name_the_signal_and_the_remedy():
    log = rubbing()
    with pytest.raises(DataError, match=r"no signal 'slew'.*the mechanics"):
        motion(dataclasses.replace(log, signals={n: v for n, v in log.signals.items() if n != "slew"}))
    with pytest.raises(DataError, match=r"no signal 'p_a' and 'p_b'"):
        motion(
            dataclasses.replace(
                log, signals={n: v for n, v in log.signals.items() if n not in ("p_a", "p_b")}
            )
        )
    with pytest.raises(DataError, match=r"'slew' hardly moves.*record a log"):
        motion(dataclasses.replace(log, signals=log.signals | {"slew": np.zeros(len(log))}))
    given = motion(log)
    with pytest.raises(DataError, match="check the signs and units"):
        identify_mechanics(dataclasses.replace(given, torque=-given.torque))
    with pytest.raises(DataError, match=r"moves in .* of the log only"):
        identify_mechanics(dataclasses.replace(given, keep=np.arange(given.angle.size) < 9000))


def test_what_a_linear_axis_would_take_is_said_in_its_units():
    """A torque recorded with the wrong sign: a negative mass, in kg where the axis is a line."""
    found = motion(rubbing())
    with (
        speaking(Lexicon(units=TRAVEL)),
        pytest.raises(DataError, match=r"it would take J -\d+(\.\d+)? kg and b -?\d+(\.\d+)?(e\+\d+)? N s/m"),
    ):
        identify_mechanics(dataclasses.replace(found, torque=-found.torque))


def test_a_motor_driven_one_way_by_two_torques_tells_friction_and_load_as_one_number() -> None:
    """A motor with 0.05, then 0.06 N m: "hardly moves", and half of the friction was told as a load, each to 1.5 %."""
    h, count = 1e-3, 20_000
    torque = np.repeat([0.05, 0.06], count // 2)
    J, b, friction = 1.4e-4, 1.35e-4, 0.0312
    kept = np.exp(-h * b / J)
    speed = lfilter([0.0, (1.0 - kept) / b], [1.0, -kept], torque - friction)
    log = SimpleNamespace(
        source="m.csv",
        step=h,
        require=lambda name, what: torque,
        display={"torque": "N.m"},
        units={"torque": "N.m"},
    )
    assert travels(log, "torque", driven=True) is torque
    with pytest.raises(DataError, match="hardly moves"):
        travels(log, "torque")  # of a reading two steps of its rounding are no motion
    values = {**CRANE, "A": 1.0, "r": 1.0, "J": J, "b": b}
    angle = np.cumsum(speed) * h
    found = identify_mechanics(Motion("m", h, torque, angle, np.ones(count, dtype=bool), values), 5.0)
    assert found.one_way
    assert "tau_load" not in found.values
    assert found.values["tau_c"].value == pytest.approx(friction, rel=0.01)
    assert found.values["b"].value == pytest.approx(b, rel=0.02)
    assert any("one way only" in line for line in _sentences(found, Lexicon()))
