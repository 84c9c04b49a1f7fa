"""Calibration end to end: true values inside their intervals, bounds, priors, blind directions, held-out data."""

import dataclasses

import numpy as np
import pytest

from cosim.calibrate import calibrate, read_free
from cosim.calibrate.pipeline import Options
from cosim.compare import Comparator
from cosim.errors import DataError, UsageError
from cosim.rig import Noise

QUICK = Options(starts=1)
HIDDEN = {"mechanical.J": 900.0, "mechanical.b": 24e3, "dcv.K": 2.5e-3}


def fitted(log, package, texts, options=QUICK, priors=(), **more):
    with Comparator(log, package) as comparator:
        return calibrate(comparator, read_free(comparator.system, texts, priors), options, **more)


@pytest.fixture(scope="module")
def off(rig_log):
    """Three parameters that are not nominal."""
    return rig_log(settings=HIDDEN)


def error_to_come(log, package, noise, first=0):
    """RMSE of the nominal model's slew [rad] from a sample on: what the hidden values change, and the noise."""
    with Comparator(log, package) as bench:
        wrong = (bench.simulate(HIDDEN)["slew"] - bench.simulate({})["slew"])[first:]
    return float(np.hypot(np.sqrt(np.mean(wrong**2)), noise))


def test_values_that_were_hidden_are_found(off, packages):
    found = fitted(off, packages["full_order"], ["mechanical.J", "mechanical.b", "dcv.K"], Options(starts=3))
    assert found.engine == "compiled"
    for p in found.parameters:
        assert abs(p.value - HIDDEN[p.name]) < 4.0 * p.deviation, p  # four standard deviations
        assert p.deviation < 0.01 * p.value
        assert p.ci95[0] < p.value < p.ci95[1]
        assert p.determined
        assert p.at_bound is None
    slew = found.signals["slew"]
    assert slew.held_after.rmse < 1.05 * slew.held_after.noise_floor
    first = round(0.7 * len(off))
    expected = error_to_come(off, packages["full_order"], slew.held_after.noise_floor, first)
    assert slew.held_before.rmse == pytest.approx(expected, rel=0.05)
    assert all(start.same for start in found.starts)
    assert found.notes == []
    held = found.series[-1]
    assert held.held_from == round(0.7 * len(held.time))


def test_the_fmus_give_what_the_twin_gives(off, packages):
    texts, white = ["mechanical.J", "dcv.K=2:3 mm"], Options(starts=1, coloured=False)
    ours = fitted(off, packages["full_order"], texts, white)
    fmus = fitted(off, packages["full_order"], texts, dataclasses.replace(white, engine="fmu"))
    assert (ours.engine, fmus.engine) == ("compiled", "fmu")
    for one, other in zip(ours.parameters, fmus.parameters, strict=True):
        assert one.value == pytest.approx(other.value, rel=1e-7)
        assert one.deviation == pytest.approx(other.deviation, rel=1e-4)


def test_a_prior_pulls_as_its_weight_says(off, packages):
    free = fitted(off, packages["full_order"], ["mechanical.J"])
    (alone,) = free.parameters
    strong = fitted(
        off, packages["full_order"], ["mechanical.J"], priors=[f"mechanical.J=700+-{alone.deviation} kg.m2"]
    )
    # a prior as sure as the data: half way, and surer by the root of two
    assert strong.parameters[0].value == pytest.approx(0.5 * (700.0 + alone.value), rel=0.02)
    assert strong.parameters[0].deviation == pytest.approx(alone.deviation / np.sqrt(2.0), rel=0.1)


def test_a_bound_is_said(off, packages):
    found = fitted(off, packages["full_order"], ["mechanical.J=700:850 kg.m2", "mechanical.b", "dcv.K"])
    J = found.parameters[0]
    assert (J.value, J.at_bound, J.ci95, J.deviation) == (850.0, "upper", None, None)
    assert "upper bound" in J.remark
    assert found.parameters[1].ci95 is not None


def test_what_acts_only_together_is_said_and_not_pretended(off, packages):
    found = fitted(off, packages["full_order"], ["mechanical.A", "mechanical.r", "dcv.K"])
    A, r, K = found.parameters
    assert not A.determined
    assert not r.determined
    assert A.ci95 is None
    assert r.ci95 is None
    assert K.determined
    (blind,) = found.undetermined
    assert set(blind.changes) == {"mechanical.A", "mechanical.r"}
    # A up and r down by the same part changes nothing
    assert blind.changes["mechanical.A"] == pytest.approx(-blind.changes["mechanical.r"], rel=1e-3)
    # one was kept at its start; the product is what the log shows: that of a crane whose J and b are those of the model
    assert A.value == A.start or r.value == r.start


def test_what_the_log_never_exercises_is_said(off, packages):
    found = fitted(off, packages["full_order"], ["dcv.K", "dcv.x_max=2.5:2.8 mm"])
    K, stop = found.parameters
    assert K.determined
    assert not stop.determined
    assert stop.value == stop.start
    assert "depends on dcv.x_max" in found.undetermined[0].why


def test_the_start_angle_cannot_pass_for_a_bias(off, packages):
    found = fitted(off, packages["full_order"], ["sensor.bias=-1:1 deg", "mechanical.J"])
    assert [p.determined for p in found.parameters] == [False, True]


def test_a_prior_speaks_for_what_the_log_does_not_show(off, packages):
    found = fitted(off, packages["full_order"], ["dcv.x_max=2.6+-0.05 mm", "dcv.K"])
    stop = found.parameters[0]
    assert stop.determined
    assert "prior" in stop.remark
    assert stop.deviation == pytest.approx(0.05e-3, rel=1e-3)


def test_structure_that_is_missing_is_noted(friction, packages):
    found = fitted(friction, packages["full_order"], ["mechanical.J", "mechanical.b"])
    assert any("lacks something" in note and "slew" in note for note in found.notes)


def test_another_log_held_out(off, rig_log, packages):
    other = rig_log(seconds=4.0, seed=9, settings=HIDDEN)
    with Comparator(off, packages["full_order"]) as first, Comparator(other, first.system) as second:
        free = read_free(first.system, ["mechanical.J", "mechanical.b", "dcv.K"])
        found = calibrate(first, free, QUICK, second=second)
    slew = found.signals["slew"]
    assert slew.samples == len(off)
    assert slew.held_after.samples == len(other)
    assert slew.held_after.rmse < 1.05 * slew.held_after.noise_floor
    expected = error_to_come(other, packages["full_order"], slew.held_after.noise_floor)
    assert slew.held_before.rmse == pytest.approx(expected, rel=0.05)


def test_missing_samples_do_not_count(off, packages):
    hole = np.ones(len(off), dtype=bool)
    hole[1000:1400] = False
    signals = dict(off.signals)
    signals["slew"] = np.where(hole, signals["slew"], 7.0)  # absurd where nothing was measured
    damaged = dataclasses.replace(off, signals=signals, valid={"slew": hole})
    found = fitted(damaged, packages["full_order"], ["mechanical.J", "mechanical.b", "dcv.K"])
    assert abs(found.parameters[0].value - 900.0) < 4.0 * found.parameters[0].deviation


def test_coloured_noise_widens_the_intervals(rig_log, packages):
    deviations = {}
    for kind in ("white", "ar1"):
        log = rig_log(noise=Noise(kind=kind, correlation_time=0.05))
        found = fitted(log, packages["full_order"], ["mechanical.b", "continuity.K_c"])
        deviations[kind] = [p.deviation for p in found.parameters]
        effective = found.signals["slew"].effective
        assert effective == pytest.approx(
            found.signals["slew"].samples / (1.0 if kind == "white" else 100.0), rel=0.6
        )
    # noise correlated over 50 samples is worth about a hundredth of them: ten times as wide
    ratio = np.array(deviations["ar1"]) / np.array(deviations["white"])
    assert np.all((ratio > 4.0) & (ratio < 15.0))


def test_requests_that_make_no_sense(off, packages):
    with pytest.raises(UsageError, match="closest: 'slew'"):
        fitted(off, packages["full_order"], ["mechanical.J"], Options(signals=("slw",)))
    with pytest.raises(UsageError, match="held-out part"):
        fitted(off, packages["full_order"], ["mechanical.J"], Options(held_out=1.5))
    with pytest.raises(UsageError, match="cannot run compiled"):
        fitted(off, packages["physical"], ["mechanical.J"], Options(engine="compiled"))


def test_a_log_without_its_command_has_nothing_to_compare(off, packages):
    signals = {n: v for n, v in off.signals.items() if n != "u"}
    with pytest.raises(DataError, match="'u'"):
        fitted(dataclasses.replace(off, signals=signals), packages["full_order"], ["mechanical.J"])
