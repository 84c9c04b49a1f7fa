"""Frequency responses: the source's experiment played by the rig and read back, and Welch's method."""

import numpy as np
import pytest
from identify_truth import TRUTH, score

from cosim.errors import DataError, UsageError
from cosim.identify.blocks import parameters
from cosim.identify.data import Record, record
from cosim.identify.experiment import stepped_sine
from cosim.identify.frf import hold, sine_periods, stepped, welch_frf
from cosim.identify.frf_fit import fit_frf, frf_best_fit, response_of, without_transients
from cosim.identify.linear import simulate
from cosim.identify.transfer_function import Structure
from cosim.rig import as_log, make_log

FREQUENCIES = np.concatenate([np.linspace(3.0, 9.0, 6), np.linspace(10.0, 60.0, 24)])
W0, ZETA = 25.23, 0.545


def valve(w):
    s = 1j * w
    return 2.375e-3 * W0**2 / (s**2 + 2 * ZETA * W0 * s + W0**2)


@pytest.fixture(scope="module")
def played():
    """A stepped sine at two amplitudes on the rig."""
    return as_log(make_log(stepped_sine("test", FREQUENCIES, (1.0, 0.75)).command))


@pytest.fixture(scope="module")
def spool(played, known):
    return record(played, "u", "spool", known)


def command_of(played, item):
    return played["u"][: item.input.size]


def test_periods_are_found_with_their_frequency_and_amplitude(played):
    periods = sine_periods(played["u"], 1e-3)
    assert len(periods) == 2 * FREQUENCIES.size
    assert [p.frequency for p in periods[: FREQUENCIES.size]] == pytest.approx(FREQUENCIES, rel=1e-6)
    assert {round(p.amplitude, 6) for p in periods} == {1.0, 0.75}
    ends = 3.0 + np.cumsum(2 * np.pi / FREQUENCIES)
    assert [p.start for p in periods[1 : FREQUENCIES.size]] == pytest.approx(ends[:-1], abs=1e-6)


def test_other_commands_have_no_periods(clean):
    """Steps, ramps and rests are no sines; the sweep's periods are."""
    steps = clean.slice(0.0, 9.0)["u"]
    assert sine_periods(steps, 1e-3) == []
    assert sine_periods(np.zeros(1000), 1e-3) == []
    assert len(sine_periods(clean["u"], 1e-3)) > 3


def test_settled_sines_give_the_response_itself():
    """Long settled and without noise: (4.12) is exact but for the hold, which is corrected."""
    w, step = 12.3, 1e-3
    t = np.arange(round(20 * 2 * np.pi / w / step)) * step
    u = np.sin(w * t)
    y = simulate([2.375e-3 * W0**2], [1.0, 2 * ZETA * W0, W0**2], u, step, held=True)
    late = t > 10 * 2 * np.pi / w - 1e-9
    cut = int(np.argmax(late))
    part = Record("x", step, u[cut:], y[cut:], np.ones(u.size - cut, bool), True)
    found = stepped([(part, part.input)] * 3)
    assert found.response[0] == pytest.approx(valve(w), rel=2e-6)
    assert abs(hold(np.array([w]), step)[0] - np.exp(-0.5j * w * step)) < 1e-4


def test_extremes_are_the_amplitude_that_4_12_prints(spool, played):
    least, extremes = (
        stepped([(spool, command_of(played, spool))], m) for m in ("least squares", "extremes")
    )
    assert np.angle(extremes.amplitudes[0.75]) == pytest.approx(np.angle(least.amplitudes[0.75]), abs=1e-9)
    # noise widens the extremes: half its peak to peak, some 4 deviations of 0.005 mm
    excess = np.abs(extremes.response) - np.abs(least.response)
    assert np.median(excess) == pytest.approx(0.015e-3, abs=0.015e-3)
    assert np.abs(excess[0]) > 0.0


def test_amplitudes_are_averaged(spool, played):
    found = stepped([(spool, command_of(played, spool))])
    assert sorted(found.amplitudes) == [0.75, 1.0]
    full, less = found.amplitudes[1.0], found.amplitudes[0.75]
    assert np.isfinite(less).all()
    both = np.isfinite(
        full
    )  # at full command the spool's resonance meets its stop: such periods are left out
    assert 20 < np.count_nonzero(both) < both.size
    assert np.abs(found.response - 0.5 * (full + less))[both].max() < 0.02 * np.abs(less).max()
    assert found.response[~both] == pytest.approx(less[~both])


def test_transient_of_one_period_is_corrected(spool, played, known):
    """One period leaves no time to settle: as read the points are off by percents, corrected within their deviation."""
    driven = [(spool, command_of(played, spool))]
    raw = stepped(driven)
    first = fit_frf(raw, Structure(2))
    found, model = without_transients(raw, driven, first)
    truth = valve(raw.frequency)
    before, after = (np.abs(f.response / truth - 1.0) for f in (raw, found))
    assert before.max() > 0.02
    assert after.max() < 0.2 * before.max()
    values = parameters("dcv", model, known)
    assert all(abs(score(q, TRUTH[name])) < 4.0 for name, q in values.items())
    assert frf_best_fit(found, model) > frf_best_fit(raw, first)
    assert np.abs(response_of(model, raw.frequency) / truth - 1.0).max() < 5e-3


def test_welch_with_intervals_from_coherence(known):
    log = as_log(make_log("multisine", 40.0, seed=3))
    found = welch_frf(record(log, "u", "spool", known))
    assert found.coherence.min() > 0.5
    inner = found.band(2.0, 19.0)
    error = np.abs(inner.response / valve(inner.frequency) - 1.0)
    # lines between those of the comb are read by leakage: the coherence says so
    assert np.median(error) < 0.01
    assert np.median(error / (np.sqrt(2.0) * inner.deviation / np.abs(inner.response))) < 1.5


def test_welch_of_an_integrating_block(known):
    log = as_log(make_log("multisine", 40.0, seed=3))
    found = welch_frf(record(log, "u", "slew", known), integrates=True).band(2.0, 15.0)
    s = 1j * found.frequency
    truth = np.deg2rad(4.582e5) / (s * np.polyval([1, 71.5, 2164, 3.673e4, 2.02e5], s))  # (5.12)
    assert np.median(np.abs(found.response / truth - 1.0)) < 0.03


def test_smoothing_as_the_source_does(spool, played):
    found = stepped([(spool, command_of(played, spool))])
    smooth = found.smoothed(11, 25)
    assert np.abs(smooth.magnitude - found.magnitude).max() < 0.5
    # what is nearly a polynomial of the order passes through nearly unchanged: a logarithm over an octave
    w = np.linspace(1.0, 2.0, 30)
    line = type(found)(w, (w * np.exp(-0.1j * w)).astype(complex), 0.01 * w, None, {}, "stepped sine")
    assert line.smoothed(11, 25).response == pytest.approx(line.response, rel=1e-5)
    with pytest.raises(UsageError, match="does not fit 30 points"):
        line.smoothed(11, 31)


def test_logs_without_the_experiment_are_refused(known, noisy, spool, played):
    steps = noisy.slice(0.0, 4.6)
    item = record(steps, "u", "spool", known)
    with pytest.raises(DataError, match=r"0 whole periods of a sine.*experiment.*welch"):
        stepped([(item, steps["u"][: item.input.size])])
    with pytest.raises(
        DataError, match=r"excites nothing, or too little, between 200 and 300 rad/s.*experiment"
    ):
        stepped([(spool, command_of(played, spool))]).band(200.0, 300.0)
    with pytest.raises(UsageError, match="segment of 30 s does not fit"):
        welch_frf(item, segment=30.0)
    with pytest.raises(DataError, match=r"samples are missing, filled or at a stop.*--from, --to"):
        welch_frf(Record("x", 1e-3, item.input, item.output, item.output > 1e-4, True))
    with pytest.raises(DataError, match=r"3 points .* cannot determine 5 numbers"):
        fit_frf(stepped([(spool, command_of(played, spool))]).band(2.9, 6.0), Structure(4))
