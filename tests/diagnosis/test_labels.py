"""Labels that the data contradict are the verdict, before any cause is looked for."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.labels import MISTAKES, changed, said
from benchmarks.real_logs import DATA, MAPPINGS
from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.labels import against_tracker, contradictions, other_machine, saturated, units, wrapping
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose, labelled, prepare
from cosim.diagnosis.thresholds import CALIBRATED_TRUST, LONGEST, NOMINAL_TRUST
from cosim.diagnosis.tracker.comparison import compare_tracker
from cosim.logs import Log, Tracker, load_log
from cosim.report.deliver import delivered
from cosim.rig import make_log
from cosim.rig.write import as_log


@pytest.fixture(scope="module")
def log() -> Log:
    """A synthetic log with dry friction."""
    return as_log(make_log("mixed", 21.0, ["mechanical.coulomb_friction:tau_c=100"], seed=3))


@pytest.mark.parametrize("name", MISTAKES)
def test_each_wrong_label_is_told(log: Log, name: str) -> None:
    make, signals = MISTAKES[name]
    told = said(make(log, np.random.default_rng(1)))
    assert {t.signal for t in told} <= signals
    assert told
    assert all(t.remedy for t in told)


@pytest.mark.parametrize(
    ("name", "finding"),
    [
        ("ports exchanged", "p_a and p_b look exchanged"),
        ("psi labelled bar", "p_a and p_b: looks like psi labelled bar"),
        ("spool reversed", "spool looks reversed in sign"),
        ("mm labelled m", "spool: looks like mm labelled m"),
        ("spool and slew exchanged", "spool and slew look exchanged"),
    ],
)
def test_signals_that_the_short_model_does_not_read_are_held_against_the_whole_one(
    log: Log, name: str, finding: str
) -> None:
    wrong = MISTAKES[name][0](log, np.random.default_rng(1))
    assert [t.finding for t in said(wrong, "simplified")] == [finding]
    assert said(log, "simplified") == []


def test_of_another_machine_nothing_is_said_of_what_the_short_model_does_not_read(log: Log) -> None:
    wrong = MISTAKES["ports exchanged"][0](log, np.random.default_rng(1))
    for machine, trust in (
        (our_machine("simplified", {"simplified.k": 1.0}), NOMINAL_TRUST),
        (our_machine("simplified"), CALIBRATED_TRUST),
    ):
        assert [t for t in labelled(wrong, machine, trust)[2] if t.signal == "p_a"] == []


def test_the_unit_and_its_factor_are_named(log: Log) -> None:
    (told,) = said(changed(log, slew=log.signals["slew"] * 180.0 / np.pi))
    assert told.finding == "slew: looks like deg labelled rad"
    assert told.factor == pytest.approx(180.0 / np.pi)


def test_an_angle_beyond_all_machines_is_told_where_its_motion_is_too_small_for_the_model_so_far_away() -> (
    None
):
    small = as_log(make_log("small_steps", 30.0, ["sensor.dropout:p_drop=0.02"], seed=4))
    assert said(small) == []
    wrong = changed(small, slew=(small.signals["slew"] + np.radians(90.0)) * 180.0 / np.pi)
    assert [t.finding for t in said(wrong)] == ["slew: looks like deg labelled rad"]


@pytest.mark.parametrize(
    "hidden",
    [
        [],
        ["mechanical.coulomb_friction:tau_c=400"],
        ["continuity.leakage:c_l=0.6"],
        ["dcv.stroke_limit:x_max=1.0 mm,x_min=-1.0 mm"],
        ["mechanical.backlash:gap=2 deg"],
    ],
    ids=str,
)
def test_right_labels_are_left_alone_whatever_is_wrong_with_the_machine(hidden: list[str]) -> None:
    assert said(as_log(make_log("mixed", 21.0, hidden, seed=5))) == []


def test_the_finding_is_the_verdict_and_nothing_physical_stands_beside_it(log: Log, tmp_path) -> None:
    wrong = changed(log, p_a=14.5038 * log.signals["p_a"], p_b=14.5038 * log.signals["p_b"])
    found = diagnose(wrong)
    assert (found.verdict, found.causes) == ("implausible_data", [])
    assert answer(found, wrong, None).data[0].finding == "p_a and p_b: looks like psi labelled bar"
    delivered(found, wrong, tmp_path)
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert written["verdict"] == "implausible_data"
    assert "looks like psi" in (tmp_path / "report.html").read_text()


def test_signs_are_all_that_is_asked_of_a_machine_whose_gains_are_not_known(log: Log) -> None:
    scaled = replace(log, signals=log.signals | {"slew": 30.0 * log.signals["slew"]})
    machine = our_machine("full_order")
    assert contradictions(scaled, prepare(scaled, machine), machine, trusted=False) == []


def test_gains_are_held_against_the_machine_as_it_is_told_to_be_not_against_our_crane(log: Log) -> None:
    # pressure and slew of a drive that opens eight times as far for the same command: right for that machine only
    eight = {"dcv.K": 8.0 * 2.375e-3, "dcv.x_max": 0.1, "dcv.x_min": -0.1, "continuity.K_c": 5.28e8 / 8.0}
    other = changed(log, spool=8.0 * log.signals["spool"])
    machine = our_machine("full_order", eight)
    assert labelled(other, machine, NOMINAL_TRUST)[2] == []
    (told,) = labelled(changed(other, slew=57.3 * log.signals["slew"]), machine, NOMINAL_TRUST)[2]
    assert told.finding == "slew: looks like deg labelled rad"


def test_a_reversed_sign_is_told_whatever_the_gains_of_a_machine(log: Log) -> None:
    machine = our_machine("full_order")
    wrong = changed(log, spool=30.0 * log.signals["spool"], u=-log.signals["u"])
    assert [t.signal for t in labelled(wrong, machine, CALIBRATED_TRUST)[2]] == ["u"]


def test_of_command_and_answer_alone_nobody_knows_which_is_reversed(log: Log) -> None:
    alone = replace(log, signals={"u": -log.signals["u"], "slew": log.signals["slew"]})
    (told,) = said(alone)
    assert told.finding == "u and slew go against one another: one of the two looks reversed in sign"


def test_a_clock_in_ms_is_told_of_a_slow_log_before_its_part_is_cut_out(log: Log) -> None:
    thin = replace(
        log,
        time=1000.0 * log.time[::10],
        signals={n: v[::10] for n, v in log.signals.items()},
    )
    assert thin.duration > 60.0 * LONGEST
    assert [(t.signal, t.finding) for t in said(thin)] == [("time", "time looks like ms labelled s")]


def test_a_slow_log_with_the_right_clock_is_left_alone_though_it_would_do_in_ms() -> None:
    hours = np.arange(20000.0)
    u = 0.6 * np.sin(2.0 * np.pi * hours / 3000.0)
    demand = np.clip(
        u + np.where(u > 0, 0.45, 0.40) * np.tanh(50.0 * u) - 0.45 * (u > 0) + 0.40 * (u < 0), -1, 1
    )
    signals = {"u": u, "spool": 2.375e-3 * demand}
    slow = Log(
        time=hours,
        source=Path("slow.csv"),
        warnings=(),
        synthetic=True,
        sha256="",
        signals=signals,
        units={"u": "1", "spool": "m"},
        display={"u": "1", "spool": "mm"},
        held=frozenset({"u"}),
    )
    assert said(slow) == []


def test_a_command_that_is_one_as_labelled_is_in_no_other_unit(log: Log) -> None:
    units_of_u = [m.reported.finding for m in units(log, prepare(log, our_machine("full_order")), "u")]
    assert units_of_u
    assert not [finding for finding in units_of_u if finding.startswith("u:")]


REAL = {
    "excavator_arm": "excavator/arm-in-70-L-single.csv",
    "excavator_boom": "excavator/boom-up-90-H-coupled.csv",
    "excavator_bucket": "excavator/bucket-out-50-H-single.csv",
    "mini_excavator_boom": "mini_excavator/manual_1101_2326.csv",
    "mini_excavator_stick": "mini_excavator/manual_shyam_1101_2012.csv",
    "mini_excavator_swing": "mini_excavator/manual_1101_2326.csv",
    "emps": "emps/DATA_EMPS.mat",
    "actuator_forest_crane": "actuator_forest_crane/actuator.mat",
}


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="no measured data: set COSIM_DATA to their folder")
@pytest.mark.parametrize("name", REAL)
def test_real_logs_are_left_alone_and_a_reversed_sign_is_told(name: str) -> None:
    mapping = MAPPINGS / f"{name}.toml"
    real = load_log(DATA / REAL[name], mapping)
    machine = machine_of(None, real, mapping)
    for trust in (NOMINAL_TRUST, CALIBRATED_TRUST):
        assert labelled(real, machine, trust)[2] == []
    if name in ("mini_excavator_swing", "emps"):
        turned = changed(real, **{machine.drive: -real.signals[machine.drive]})
        assert "reversed in sign" in labelled(turned, machine, CALIBRATED_TRUST)[2][0].finding


def tracker_of(log: Log, by: float) -> Tracker:
    """A tracker's record of a log in which every angle is larger by a factor."""
    time = np.arange(2.0, 19.0, 0.04)
    return Tracker(
        time=time,
        slew_external=by * np.interp(time, log.time, log.signals["slew"]),
        valid=np.ones(time.size, bool),
        source=Path("tracker.csv"),
        warnings=(),
        synthetic=True,
        sha256="",
    )


@pytest.mark.parametrize(
    ("by", "finding"),
    [
        (np.pi / 180.0, "slew_external: looks like rad labelled deg"),
        pytest.param(180.0 / np.pi, "slew_external: looks like deg labelled rad", marks=pytest.mark.slow),
        pytest.param(-1.0, "slew_external looks reversed in sign against slew", marks=pytest.mark.slow),
    ],
)
def test_a_tracker_with_a_wrong_label_is_the_verdict(log: Log, by: float, finding: str) -> None:
    found = diagnose(log, tracker=tracker_of(log, by))
    assert found.verdict == "implausible_data"
    assert [(d.signal, d.finding) for d in found.data] == [("slew_external", finding)]
    assert found.causes == []


def test_a_tracker_with_a_right_label_is_left_alone(log: Log) -> None:
    record = prepare(log, our_machine("full_order"))
    tracker = tracker_of(log, 1.06)
    assert against_tracker(record, tracker, compare_tracker(record, tracker)) == []


@pytest.mark.parametrize(
    "hidden", ["dcv.stroke_limit:x_max=1.0 mm,x_min=-1.0 mm", "sensor.dropout:p_drop=0.4"]
)
def test_a_stop_with_a_noisy_sensor_and_stale_samples_are_no_saturation(hidden: str) -> None:
    assert list(saturated(as_log(make_log("mixed", 21.0, [hidden], seed=6)))) == []


def test_a_log_all_of_whose_blocks_are_off_is_of_another_machine_and_one_of_them_is_not() -> None:
    (told,) = other_machine([(5.0, 0.9), (0.1, 0.99), (12.0, 0.95)])
    assert told.signal == "all"
    assert other_machine([(5.0, 0.9), (1.1, 0.99), (12.0, 0.95)]) == []
    assert other_machine([(5.0, 0.9)]) == []
    assert other_machine([(0.255, 0.9), (-1.05, 0.99), (-0.93, 0.99)]) == []


def test_an_angle_that_wraps_is_told_though_samples_are_missing(log: Log) -> None:
    """What a drive turned while nothing was logged is no jump, and hides none."""
    turning = (3.0 * log.time) % (2.0 * np.pi)
    kept = np.ones(len(log), dtype=bool)
    for first in range(1500, 20000, 900):
        kept[first : first + 500] = False
    assert kept.mean() < 0.8
    holed = replace(
        log,
        time=log.time[kept],
        signals={name: values[kept] for name, values in (log.signals | {"slew": turning}).items()},
        valid={},
    )
    record = prepare(holed, our_machine("full_order"))
    (told,) = wrapping(record)
    assert (told.signal, "wraps" in told.finding) == ("slew", True)
