"""Something that happens once, or rings at one frequency, stands out; noise does not."""

from types import SimpleNamespace

import numpy as np
import pytest
from hidden_logs import only

from cosim.diagnosis.answer.answer import answer
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.diagnosis.residuals.freeform import Leftover
from cosim.diagnosis.residuals.local import apart, burst, line, near
from cosim.diagnosis.verdict import verdict
from cosim.rig import make_log
from cosim.rig.write import as_log

INTERVAL = 0.01


def test_noise_alone_hardly_ever_stands_out() -> None:
    rng = np.random.default_rng(8)
    for _ in range(100):
        white = rng.normal(size=(12, 495))
        assert burst(white, INTERVAL).p_value > 1e-4
        assert line(white, INTERVAL).p_value > 1e-4


def test_an_event_is_found_where_it_is() -> None:
    rng = np.random.default_rng(9)
    white = rng.normal(size=(12, 500))
    white[4, 100:300] *= 3.0  # from 21 s on, 2 s long
    found = burst(white, INTERVAL)
    assert found.p_value < 1e-9
    assert found.start == pytest.approx(21.0, abs=0.6)
    assert found.end == pytest.approx(23.0, abs=0.6)


def test_a_faint_line_is_found_at_its_frequency() -> None:
    rng = np.random.default_rng(10)
    time = np.arange(6000) * INTERVAL
    white = (rng.normal(size=6000) + 0.45 * np.sin(2.0 * np.pi * 7.0 * time)).reshape(12, 500)
    found = line(white, INTERVAL)
    assert found.p_value < 1e-9
    assert found.start == pytest.approx(7.0, abs=0.21)


@pytest.mark.parametrize(("frequency", "rings"), [(0.2, False), (0.6, True)])
def test_one_period_in_a_window_is_slow_noise_as_well_as_a_line(frequency: float, rings: bool) -> None:
    rng = np.random.default_rng(12)
    time = np.arange(6000) * INTERVAL
    slow = rng.normal(size=12).repeat(500) * np.sin(2.0 * np.pi * frequency * time)
    white = (rng.normal(size=6000) + 0.45 * slow).reshape(12, 500)
    assert (line(white, INTERVAL).p_value < 1e-5) == rings


def test_what_happened_once_is_no_line_and_a_line_is_no_matter_of_one_stretch() -> None:
    rng = np.random.default_rng(13)
    ringing = np.sin(2.0 * np.pi * 2.0 * np.arange(6000) * INTERVAL).reshape(12, 500)
    white = rng.normal(size=(12, 500))
    once = white + ringing * (np.arange(12) == 5)[:, None] * 4.0
    event = burst(once, INTERVAL)
    assert event.p_value < 1e-9
    assert line(once, INTERVAL).p_value < 1e-5
    assert line(apart(once, event, INTERVAL), INTERVAL).p_value > 1e-3
    always = white + ringing
    assert line(apart(always, burst(always, INTERVAL), INTERVAL), INTERVAL).p_value < 1e-9


def test_the_start_of_the_log_shifts_the_times() -> None:
    rng = np.random.default_rng(11)
    white = rng.normal(size=(12, 500))
    white[0, 200:400] *= 4.0
    shifted = burst(white, INTERVAL, skip=0.5)
    assert shifted.start == pytest.approx(burst(white, INTERVAL).start, abs=0.55)
    assert shifted.end > shifted.start


def test_too_few_values_say_nothing() -> None:
    assert line(np.ones((1, 30)), INTERVAL).p_value == 1.0
    assert burst(np.ones((1, 30)), INTERVAL).p_value == 1.0


def test_a_faint_event_in_a_narrow_band_is_found() -> None:
    """A push that rings for four seconds, well below what its share of the whole spectrum could show."""
    rng = np.random.default_rng(12)
    age = np.arange(320) * INTERVAL
    white = rng.normal(size=(12, 400))
    ringing = np.sin(np.pi * age / 3.2) ** 2 * np.cos(12.0 * age)
    white[5, 40:360] += ringing * np.sqrt(130.0 / np.sum(ringing**2))
    found = burst(white, INTERVAL)
    assert found.p_value < 1e-7
    assert found.gain == pytest.approx(65.0, rel=0.5)
    assert 20.0 < found.start < found.end < 24.2
    assert found.end - found.start < 3.0


@pytest.mark.slow
def test_a_push_is_located_in_its_block_and_its_seconds() -> None:
    run = make_log("mixed", 40.0, ["unknown.torque_burst:t_burst=22 s,tau_burst=300 N.m"], seed=71)
    log = as_log(run)
    found = diagnose(log, model=only("continuity", "mechanical"))
    (rest,) = answer(found, log, None).unexplained
    assert rest.block == "mechanical"
    assert rest.span is not None
    assert 21.5 < rest.span[0] < 23.5 < 24.5 < rest.span[1] < 26.5
    shares = {row.signal: row.share for row in answer(found, log, None).localisation}
    assert shares["slew"] > 0.95


@pytest.mark.parametrize(("size", "leads"), [(3.0, True), (0.1, False)])
def test_an_event_smaller_than_what_is_left_everywhere_is_not_all_that_is_wrong(
    monkeypatch: pytest.MonkeyPatch, size: float, leads: bool
) -> None:
    """However much it weighs against the noise: an axis that is 40 deg off is not off by 0.2 deg in one second only."""

    def left(gain: float, rms: float) -> Leftover:
        return Leftover(0.0, gain, rms, np.zeros((1, 1)), {"torque(omega)": gain}, {}, gain)

    rest, event = left(10.0, 1.0), verdict.Rest("mechanical", "slew", left(1e6, size), "once", (1.0, 2.0))
    group = SimpleNamespace(model=SimpleNamespace(group=SimpleNamespace(name="mechanical")))
    finding = SimpleNamespace(after={"slew": rest}, task=group, lacks_linear=False, lacks_curve=0.0)
    monkeypatch.setattr(verdict, "stands", lambda _: True)
    monkeypatch.setattr(verdict, "notable", lambda *_: True)
    monkeypatch.setattr(verdict, "local_rests", lambda *_: [event])
    (found,) = verdict.rests(finding)  # type: ignore[arg-type]
    assert (found is event) == leads


def test_a_line_that_stands_out_is_no_larger_than_what_is_left_around_its_frequency():
    """A soft actuator 2.6 deg off was said to ring by 0.54 deg at 9.92 Hz, where it read 0.003 deg.

    So far one frequency rose above those beside it once the residual was white. A ripple of 0.3 rad/s was told as 4.1.
    """
    interval, time = 0.02, 0.02 * np.arange(1500)
    slow = 20.0 * np.sin(2.0 * np.pi * 0.3 * time)
    ripple = 0.3 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 5.65 * time)
    residual = (slow + ripple).reshape(5, 300)
    assert near(ripple.reshape(5, 300), interval, 5.65) == pytest.approx(0.3, rel=0.05)
    assert near(residual, interval, 5.65) == pytest.approx(0.3, rel=0.05), (
        "nothing of the slow one leaks there"
    )
    noise = np.random.default_rng(2).normal(size=(200, 301))
    share = (2.0**0.25 - 2.0**-0.25) * 8.0 / 25.0
    assert near(noise, interval, 8.0) == pytest.approx(np.sqrt(share), rel=0.05)


@pytest.mark.parametrize(("size", "leads"), [(3.0, True), (0.1, False)])
def test_nor_does_a_faint_line_lead_over_what_is_wrong_throughout(
    monkeypatch: pytest.MonkeyPatch, size: float, leads: bool
) -> None:
    def left(gain: float, rms: float) -> Leftover:
        return Leftover(0.0, gain, rms, np.zeros((1, 1)), {"torque(omega)": gain}, {}, gain)

    rest, ringing = left(10.0, 1.0), verdict.Rest("mechanical", "slew", left(1e6, size), "rings")
    group = SimpleNamespace(model=SimpleNamespace(group=SimpleNamespace(name="mechanical")))
    finding = SimpleNamespace(after={"slew": rest}, task=group, lacks_linear=False, lacks_curve=0.0)
    monkeypatch.setattr(verdict, "stands", lambda _: True)
    monkeypatch.setattr(verdict, "notable", lambda *_: True)
    monkeypatch.setattr(verdict, "local_rests", lambda *_: [ringing])
    (found,) = verdict.rests(finding)  # type: ignore[arg-type]
    assert (found is ringing) == leads
