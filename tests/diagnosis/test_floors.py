"""The noise floor is that of the sensors, white or not: the error of a simulation that is right comes down to it."""

from types import SimpleNamespace

import numpy as np
import pytest
from hidden_logs import diagnosed

from cosim.compare.metrics import noise_floor, resolution
from cosim.diagnosis import found as module
from cosim.diagnosis.held_out.gain import Gain
from cosim.diagnosis.model.options import Options
from cosim.diagnosis.record.record import Record, as_read, joined
from cosim.diagnosis.record.signatures import coarse_steps
from cosim.diagnosis.verdict.verdict import floor_of

DEG = np.pi / 180.0
SENSORS = {"spool": 0.005e-3, "p_load": 0.1e5 * np.sqrt(2.0), "p_supply": 0.1e5, "slew": 0.01 * DEG}


@pytest.mark.parametrize(
    ("kind", "blocks", "signals"),
    [
        ("white", ("dcv",), {"spool"}),
        pytest.param("white", (), set(SENSORS), marks=pytest.mark.slow),
        pytest.param("ar1", (), set(SENSORS), marks=pytest.mark.slow),
    ],
)
def test_the_floor_is_the_sensors_noise_sample_by_sample(
    kind: str, blocks: tuple[str, ...], signals: set[str]
) -> None:
    how = {"excitation": "steps", "seconds": 12.0} if blocks else {"seconds": 30.0}
    found = diagnosed("dcv.hysteresis", seed=5, kind=kind, blocks=blocks, **how)
    assert [c.effect.name for c in found.causes] == ["dcv.hysteresis"]
    assert {n: found.noise[n] for n in signals} == pytest.approx({n: SENSORS[n] for n in signals}, rel=0.1)


def test_no_model_errs_less_than_the_noise() -> None:
    """What was taken for noise and an extended model predicts on other data is none."""
    found = diagnosed("dcv.hysteresis", seed=5, blocks=("dcv",), excitation="steps", seconds=12.0)
    learned = found.noise["spool"]
    for part, expected in ((0.95, 1.0), (0.5, 0.5)):
        found.gains["spool"] = Gain(10.0 * learned, part * learned, (0.0, 1.0), 0.0, 0.0)
        assert found.noise["spool"] == pytest.approx(expected * learned)


def test_the_time_from_which_a_log_is_held_out_may_have_a_unit() -> None:
    assert Options(held_out_from="2 min").held_out_from == 120.0
    assert Options(held_out_from=512).held_out_from == 512.0, "a log that counts samples"
    with pytest.raises(ValueError, match="350 x"):
        Options(held_out_from="350 x")


@pytest.mark.slow
def test_readings_in_steps_are_off_by_their_rounding() -> None:
    quantum = 0.1 * DEG
    found = diagnosed(f"sensor.quantisation:quantum={quantum} rad", seed=6)
    assert found.noise["slew"] == pytest.approx(np.hypot(SENSORS["slew"], quantum / np.sqrt(12.0)), rel=0.25)


@pytest.mark.slow
def test_what_is_left_unexplained_does_not_count_as_noise() -> None:
    found = diagnosed("unknown.quadratic_drag", seed=7)
    assert found.rests
    assert floor_of(found.findings["mechanical"], "slew") == pytest.approx(SENSORS["slew"], rel=0.15)


def test_no_noise_is_less_than_rounding_where_a_linear_model_and_the_machine_both_stand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An encoder's speed in steps of 0.23 rad/s, at rest for half of the log: nothing is left there (1.9e-8 was told)."""
    measured = 0.23 * np.round(np.concatenate([50.0 * np.sin(np.arange(500) / 20.0), np.zeros(500)]) / 0.23)
    finding = SimpleNamespace(task=SimpleNamespace(rules={"speed": None}))
    found = SimpleNamespace(
        findings={"mechanical": finding},
        in_place=object(),
        after={"speed": measured + np.concatenate([np.sin(np.arange(500)), np.zeros(500)])},
        record=Record(1e-3, {"speed": measured}),
        gains={},
    )
    monkeypatch.setattr(module, "floor_of", lambda finding, signal: 3.0)
    floors = vars(module.Diagnosis)["noise"].fget(found)
    assert floors["speed"] == pytest.approx(0.23 / np.sqrt(12.0))


def test_logs_that_were_zeroed_each_by_itself_have_the_steps_of_their_converter() -> None:
    """Two runs of a trolley in steps of 2.4 mm, each from its own place: "the sensor's noise is 1.4e-07 m"."""
    step, way = 0.0024, np.cumsum(np.full(4000, 3.1e-4))
    first, second = (step * np.round((way + off) / step) - off for off in (0.0, 0.7137 * step))
    both, cuts = np.concatenate([first, second]), (first.size,)
    assert resolution(both) < 0.5 * step, "levels of one log lie between those of the other"
    assert resolution(both, cuts) == pytest.approx(step)
    assert noise_floor(both, 1e-3, cuts) >= 0.99 * step / np.sqrt(12.0)
    assert coarse_steps({"travel": both}, cuts) == pytest.approx({"travel": step}, rel=1e-3)
    record = joined([Record(1e-3, {"travel": y}) for y in (first, second)])
    assert record.rounding("travel") == pytest.approx(step / np.sqrt(12.0))


def test_what_stands_between_readings_that_are_refreshed_rarely_is_no_reading() -> None:
    """A pressure in steps of 0.01 bar, refreshed every 16 samples: "the sensor's noise is 0.00025 bar"."""
    step, every = 0.01, 16
    stamps = np.arange(0, 8000, every)
    read = step * np.round((30.0 + 10.0 * np.sin(stamps / 900.0)) / step)
    filled = np.ones(8000, dtype=bool)
    filled[stamps] = False
    values = np.interp(np.arange(8000), stamps, read)
    assert resolution(values) < 0.5 * step
    record = Record(1e-2, {"p_a": values}, filled={"p_a": filled})
    assert record.rounding("p_a") == pytest.approx(step / np.sqrt(12.0), rel=1e-3)
    both = joined([record, record])
    assert both.rounding("p_a") == pytest.approx(step / np.sqrt(12.0), rel=1e-3)
    alone, cuts = as_read(both.signals["p_a"], both.filled["p_a"], both.cuts)
    assert alone == pytest.approx(np.concatenate([read, read]))
    assert cuts == (stamps.size,)
