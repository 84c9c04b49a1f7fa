"""Rounding and stale samples are read from the samples themselves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.hypotheses.naming import nominal, sampled
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import prepare
from cosim.diagnosis.record.signatures import Signature, grid_step, signatures, stale_share
from cosim.diagnosis.verdict.verdict import Cause, of_signatures, rank
from cosim.inference.held_out import HeldOutGain
from cosim.rig import make_log
from cosim.rig.write import as_log
from fmus import registry

DEG = np.pi / 180.0


def rate_of(values: np.ndarray) -> np.ndarray:
    """Smoothed rate, rad/s, zero at both ends."""
    rate = np.gradient(np.convolve(values, np.ones(101) / 101, "same"), 1e-3)
    rate[:150] = rate[-150:] = 0.0
    return rate


def seen(*hidden: str, decimals: int = 9, noise: float = 1e-4) -> dict[str, float]:
    """Effects seen in a log printed with so many decimals of a degree."""
    slew = make_log("mixed", 25.0, list(hidden), seed=5).slew
    printed = np.round(slew / DEG, decimals) * DEG
    return {m.effect: m.value for m in signatures(printed, rate_of(printed), noise)}


@given(st.floats(1e-4, 0.01), st.integers(-3000, 3000))
@settings(max_examples=30, deadline=None)
def test_the_step_of_any_grid_is_found(step: float, first: int) -> None:
    rng = np.random.default_rng(abs(first))
    numbers = first + np.cumsum(rng.integers(-2, 3, size=4000))
    assert grid_step(numbers * step) == pytest.approx(step, rel=1e-6)


def test_continuous_readings_lie_on_no_grid() -> None:
    assert grid_step(np.random.default_rng(1).normal(size=5000)) == 0.0


def test_quantisation_is_seen_with_its_size() -> None:
    assert seen("sensor.quantisation:quantum=0.1 deg") == {"sensor.quantisation": pytest.approx(0.1 * DEG)}


def test_dropout_is_seen_with_its_share() -> None:
    assert seen("sensor.dropout:p_drop=0.08") == {"sensor.dropout": pytest.approx(0.08, abs=0.01)}


@pytest.mark.parametrize("decimals", [9, 6, 4, 3, 2])
def test_how_the_file_was_printed_is_no_effect(decimals: int) -> None:
    assert seen(decimals=decimals) == {}


def test_a_log_at_rest_without_noise_has_no_stale_samples() -> None:
    values = np.concatenate([np.zeros(4000), np.linspace(0.0, 0.2, 4000), np.full(4000, 0.2)])
    share, _, _ = stale_share(values, np.gradient(values, 1e-3))
    assert share < 1e-3


@pytest.mark.parametrize(("speed", "count"), [(0.3, 1.0), (0.3, 0.0659), (3.0, 1.0)])
def test_an_encoder_that_counts_slowly_loses_no_packets(speed: float, count: float) -> None:
    """Its reading repeats until the next count, whatever the link does, also where a count is printed as 0.06 or 0.07.

    At three counts a sample nothing repeats by itself, and what was lost is seen.
    """
    rng = np.random.default_rng(4)
    way = speed * 4000 / np.pi * (1.0 - np.cos(np.arange(8000) * np.pi / 4000))
    counts = np.round(count * np.round(way + rng.normal(0.0, 0.05, way.size)), 2)
    rate = np.gradient(way)
    assert stale_share(counts, rate)[0] < 0.005, "no more than may be left unsaid"
    held = rng.random(counts.size) < 0.1
    late = np.maximum.accumulate(np.where(held, 0, np.arange(counts.size)))
    if speed > 1.0:
        assert stale_share(counts[late], rate)[0] == pytest.approx(0.1, abs=0.02)


def test_a_cause_seen_in_the_samples_has_an_interval_of_its_gain() -> None:
    """Of 200 in log-likelihood two standard deviations are some 40; no number could not be read back from the answer."""
    task = SimpleNamespace(model=SimpleNamespace(group=SimpleNamespace(name="mechanical")))
    mark = Signature("sensor.quantisation", "quantum", 1e-3, 1e-6, 500.0, held_out=200.0)
    (cause,) = of_signatures(SimpleNamespace(task=task, signatures=[mark]))  # type: ignore[arg-type]
    assert cause.held_out.ci95 == pytest.approx((200.0 - 1.96 * 20.0, 200.0 + 1.96 * 20.0), abs=0.01)
    assert cause.held_out.sure


def test_what_the_samples_show_stands_behind_what_explains_the_motion() -> None:
    """An encoder's steps of 0.025 mm stood before the dead zone of a drive that was 7.5 mm off."""
    names = ["sensor.quantisation", "mechanical.coulomb_friction", "dead_zone.mismatch"]
    gain = HeldOutGain(1.0, 0.1)
    found = [
        Cause(registry.effects()[name], "mechanical", {}, size, gain, [], [])
        for name, size in zip(names, (2e5, 100.0, 3000.0), strict=True)
    ]
    assert [c.effect.name for c in sorted(found, key=rank)] == names[::-1]


@pytest.mark.parametrize(("stale_until", "wanted"), [(1.0, ["sensor.dropout"]), (0.25, [])])
def test_samples_that_are_stale_in_one_part_of_a_log_only_are_no_property_of_the_sensor(
    stale_until, wanted
) -> None:
    log = as_log(make_log("mixed", 21.0, [], seed=5))
    slew, draw = log.signals["slew"].copy(), np.random.default_rng(2)
    for k in range(1, int(stale_until * slew.size)):
        if draw.random() < 0.1:
            slew[k] = slew[k - 1]
    record = prepare(replace(log, signals={**log.signals, "slew": slew}), our_machine("full_order"))
    mechanics = MODELS["full_order"][-1]
    task = task_for(mechanics, record, [])
    seen = sampled(task, record, nominal(task, record, 0.01).fit)
    assert [m.effect for m in seen] == wanted
    assert all(m.held_out_gain.sure for m in seen)
