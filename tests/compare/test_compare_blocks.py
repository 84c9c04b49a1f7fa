"""Logs of the virtual rig: a clean one is matched to its noise, a hidden effect shows in its own block alone."""

import dataclasses

import numpy as np
import pytest

from cosim.compare import Comparator
from cosim.errors import DataError, UsageError
from cosim.paths import ssp_folder
from cosim.rig import as_log, make_log
from cosim.rig.noise import SIZES
from cosim.ssp.write import write_ssp

VALVE, CONTINUITY = ("compensator", "dead_zone", "dcv"), ("continuity",)
MECHANICS, OBSERVER = ("mechanical", "sensor"), ("observer",)
SIGNAL = {VALVE: "spool", CONTINUITY: "p_load", MECHANICS: "slew"}


def without(log, *names):
    """The log less some of its signals."""
    left = {name: values for name, values in log.signals.items() if name not in names}
    return dataclasses.replace(log, signals=left)


def compared(log, package, **parameters):
    with Comparator(log, package) as comparator:
        return comparator.run(parameters)


@pytest.fixture(scope="module")
def comparison(clean, packages):
    return compared(clean, packages["full_order"])


def test_groups_follow_the_measured_signals(comparison):
    assert {b.components: b.driven_by for b in comparison.blocks} == {
        VALVE: ("u",),
        CONTINUITY: ("spool",),
        MECHANICS: ("p_load",),
        OBSERVER: ("u", "slew"),
    }
    assert comparison.command == ("u",)
    assert comparison.not_judged == []
    assert comparison.notes == []


def test_clean_log_is_matched_to_its_noise(comparison):
    sizes = SIZES | {"p_load": np.sqrt(2.0) * SIZES["p_a"]}
    for block in comparison.blocks:
        for name, found in block.signals.items():
            if name in sizes:
                assert found.score.noise_floor == pytest.approx(sizes[name], rel=0.1), name
                error = found.score.rmse if found.score.rmse_windows is None else found.score.rmse_windows
                # 8000 samples: 1 %; the noise that drives a block adds a little to its own
                assert error == pytest.approx(sizes[name], rel=0.05), name
    for name, found in comparison.signals.items():
        if name in sizes:
            assert found.score.rmse == pytest.approx(sizes[name], rel=0.1), name
    observer = comparison.blocks[-1].signals["slew_estimate"]
    assert observer.score.fit_percent > 99.9


def test_the_start_angle_is_that_of_the_log(comparison, clean):
    # the mean of 500 samples at rest
    assert comparison.parameters["mechanical.theta_0"] == pytest.approx(
        float(clean["slew"][:500].mean()), abs=SIZES["slew"] / 10
    )


@pytest.mark.parametrize(
    ("hidden", "guilty"),
    [
        ("mechanical.coulomb_friction:tau_c=150 N.m", MECHANICS),
        ("dcv.gain:K=2.0 mm", VALVE),
        ("continuity.leakage:c_l=0.15", CONTINUITY),
    ],
)
def test_a_hidden_effect_raises_the_error_of_its_own_block_only(hidden, guilty, rig_log, packages):
    found = compared(rig_log(hidden), packages["full_order"])
    ratios = {b.components: b.signals[SIGNAL[b.components]].score.ratio for b in found.blocks}
    for components, ratio in ratios.items():
        if components == guilty:
            assert ratio > 3.0
        else:
            assert ratio == pytest.approx(1.0, abs=0.1), components
    block, signal = found.worst
    assert (block.components, signal.signal) == (guilty, SIGNAL[guilty])


def test_true_parameters_bring_the_error_back_to_the_noise(rig_log, packages):
    log = rig_log("dcv.gain:K=2.0 mm")
    with Comparator(log, packages["full_order"]) as comparator:
        wrong = comparator.run().signals["spool"].score
        right = comparator.run({"dcv.K": 2.0e-3}).signals["spool"].score
        assert wrong.rmse > 10 * right.rmse
        assert right.rmse == pytest.approx(SIZES["spool"], rel=0.05)
        with pytest.raises(UsageError, match=r"dcv\.gain.*"):
            comparator.run({"dcv.gain": 1.0})


def test_blocks_without_a_measurement_between_are_judged_together(clean, packages):
    found = compared(
        without(clean, "p_a", "p_b", "slew_estimate", "slew_rate_estimate"), packages["full_order"]
    )
    parts = {b.components: b.driven_by for b in found.blocks}
    assert parts[("continuity", "mechanical", "sensor")] == ("spool",)
    assert "'p_load' is not measured, so continuity and mechanical are judged together" in found.notes
    assert [(item.components, item.missing) for item in found.not_judged] == [
        (OBSERVER, ("slew_estimate", "slew_rate_estimate"))
    ]


def test_without_the_command_only_what_follows_from_measurements_is_judged(clean, packages):
    found = compared(without(clean, "u"), packages["full_order"])
    assert found.signals == {}
    assert {b.components for b in found.blocks} == {CONTINUITY, MECHANICS}
    assert {item.components: item.missing for item in found.not_judged} == {VALVE: ("u",), OBSERVER: ("u",)}
    assert any("'u'" in note for note in found.notes)


def test_the_last_blocks_need_their_own_measurement(clean, packages):
    found = compared(without(clean, "slew", "slew_estimate", "slew_rate_estimate"), packages["full_order"])
    assert {b.components for b in found.blocks} == {VALVE, CONTINUITY}
    blamed = {c: item.missing for item in found.not_judged for c in item.components}
    assert "slew" in blamed["mechanical"]
    assert "slew_estimate" in blamed["observer"]


def test_closed_package_follows_the_log_not_its_own_stimulus(clean, packages, tmp_path, comparison):
    from cosim.ssp.stimulus import default_command, stimulus_csv

    closed = write_ssp(
        ssp_folder() / "full_order.ssd", tmp_path / "closed.ssp", stimulus=stimulus_csv(*default_command(5.0))
    )
    found = compared(clean, closed)
    for name, outcome in comparison.signals.items():
        np.testing.assert_array_equal(found.signals[name].simulated, outcome.simulated)
    assert compared(without(clean, "u"), closed).signals == {}


def test_pressure_that_is_not_handed_on_is_no_cut(rig_log, tmp_path):
    log = rig_log("continuity.cracking_pressure:p_c=2 bar")
    package = write_ssp(
        ssp_folder() / "full_order.ssd", tmp_path / "c.ssp", values={"continuity": {"p_c": 2e5}}, open=True
    )
    found = compared(log, package)
    parts = {b.components: b for b in found.blocks}
    assert any("hands on something else" in note for note in found.notes)
    assert parts[("continuity", "mechanical", "sensor")].signals["slew"].score.ratio < 1.3
    assert "p_load" in parts[CONTINUITY].signals


def test_simplified_model_compares_the_angle_alone(clean, packages):
    found = compared(clean, packages["simplified"])
    assert set(found.signals) == {"slew", "slew_estimate", "slew_rate_estimate"}
    assert found.signals["slew"].score.fit_percent > 90.0
    assert any("spool" in note and "not compared" in note for note in found.notes)


def test_feedback_within_the_model_is_followed(clean, packages):
    found = compared(clean, packages["physical"])
    parts = {b.components: b.driven_by for b in found.blocks}
    assert parts[MECHANICS] == ("p_load",)
    assert parts[("continuity", "mechanical")] == ("spool", "p_load")


def test_what_is_fed_back_comes_from_the_step_before_though_no_loop_is_left(packages):
    """Measured pressure drives the mechanics, and their speed the pressure: a step early, it would be off by 5000 Pa."""
    log = as_log(make_log("steps", 4.0, model="physical", noise=0.0, seed=2))
    found = compared(log, packages["physical"])
    parts = {b.components: b.signals for b in found.blocks}
    assert parts[("continuity", "mechanical")]["p_load"].score.rmse < 100.0
    assert found.signals["slew"].score.rmse < 1e-7


def test_irregular_log_is_resampled_and_says_so(clean, packages):
    keep = np.sort(np.random.default_rng(2).choice(len(clean), 4000, replace=False))
    keep[0] = 0
    log = dataclasses.replace(
        clean, time=clean.time[keep], signals={n: v[keep] for n, v in clean.signals.items()}
    )
    found = compared(log, packages["full_order"])
    assert any("resampled" in note and "irregular" in note for note in found.notes)
    # steps of the command are known to a sampling interval only
    assert found.signals["slew"].score.fit_percent > 98.0


def test_step_size_can_be_chosen(clean, packages):
    with Comparator(clean, packages["full_order"], step=0.01) as comparator:
        found = comparator.run()
    assert found.step == 0.01
    assert len(found.time) == 800
    assert found.signals["slew"].score.rmse < 3 * SIZES["slew"]
    for bad in (-1.0, np.nan, 100.0):
        with pytest.raises(UsageError, match="step"):
            Comparator(clean, packages["full_order"], step=bad)


def test_a_log_that_begins_in_motion_is_followed_from_its_first_sample(clean, packages):
    """Velocity, spool and load pressure begin where the log does; a user's own start values come first."""
    cut = clean.slice(1.5, 6.0)  # full speed there
    found = compared(cut, packages["full_order"])
    assert not any("already moves" in note for note in found.notes)
    rest = {"mechanical.omega_0": 0.0, "dcv.spool_0": 0.0, "continuity.p_load_0": 0.0}
    at_rest = compared(cut, packages["full_order"], **rest)
    for name in ("slew", "spool", "p_load"):
        assert found.signals[name].score.rmse < 0.5 * at_rest.signals[name].score.rmse, name


def test_nothing_in_common_is_an_error(clean, packages):
    log = without(clean, *[n for n in clean.signals if n not in ("u", "spool")])
    with pytest.raises(DataError, match=r"holds nothing that 'simplified' simulates.*u, spool"):
        Comparator(log, packages["simplified"])
