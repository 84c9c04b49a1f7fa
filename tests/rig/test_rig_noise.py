"""Noise has the stated size and colour, and its streams are independent and repeatable."""

from itertools import pairwise

import numpy as np
import pytest
from rig_helpers import held, lively

from cosim.errors import UsageError
from cosim.rig import Noise, make_log
from cosim.rig.noise import SIZES, UNITS

N = 40_000


@pytest.mark.parametrize("signal", SIZES)
def test_white_noise_has_the_size_of_the_contract(signal):
    noise = Noise().draw(signal, N, 5)
    assert np.std(noise) == pytest.approx(SIZES[signal], rel=4 / np.sqrt(2 * N))
    assert abs(np.mean(noise)) < 4 * SIZES[signal] / np.sqrt(N)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 4 / np.sqrt(N)


def test_logged_noise_is_what_was_drawn():
    run = make_log(lively(), seed=2)
    assert set(UNITS) == set(SIZES)
    for name, true in (("spool", run.true["spool"]), ("slew", run.true["seen"]), ("p_supply", 170e5)):
        assert np.std(getattr(run, name) - true) == pytest.approx(SIZES[name], rel=0.05)
    assert np.std(run.p_a - run.p_b - run.true["p_load"]) == pytest.approx(
        np.sqrt(2) * SIZES["p_a"], rel=0.05
    )


@pytest.mark.parametrize("correlation", [0.003, 0.05])
def test_ar1_forgets_over_its_correlation_time(correlation):
    noise = Noise(kind="ar1", correlation_time=correlation).draw("slew", 20 * N, 5) / SIZES["slew"]
    effective = 20 * N * 1e-3 / (2 * correlation + 1e-3)
    assert np.std(noise) == pytest.approx(1.0, rel=4 / np.sqrt(effective))
    for lag in (1, round(correlation / 1e-3)):
        expected = np.exp(-lag * 1e-3 / correlation)
        assert np.mean(noise[lag:] * noise[:-lag]) == pytest.approx(expected, abs=5 / np.sqrt(effective))


def test_ar1_starts_stationary():
    noise = Noise(kind="ar1", correlation_time=0.05)
    first = np.array([noise.draw("slew", 5, seed) for seed in range(400)]) / SIZES["slew"]
    assert np.std(first, axis=0) == pytest.approx(np.ones(5), rel=0.15)


def test_pink_noise_has_power_over_frequency():
    # the slowest waves make single records differ; the mean of 200 has the stated power within 4 sigma
    powers = [np.mean(Noise(kind="pink").draw("slew", 4096, seed) ** 2) for seed in range(200)]
    assert np.mean(powers) == pytest.approx(SIZES["slew"] ** 2, rel=4 * 0.15 / np.sqrt(200))
    noise = Noise(kind="pink").draw("slew", 2**17, 5) / SIZES["slew"]
    power = np.abs(np.fft.rfft(noise)[1:]) ** 2
    edges = 2 ** np.arange(5, 16)
    bands = [power[a:b].mean() for a, b in pairwise(edges)]
    slope = np.polyfit(np.arange(len(bands)), np.log2(bands), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.1)


def test_signals_are_independent():
    draws = np.array([Noise().draw(s, N, 5) for s in SIZES])
    correlation = np.corrcoef(draws) - np.eye(len(SIZES))
    assert np.max(np.abs(correlation)) < 5 / np.sqrt(N)


def test_hiding_an_effect_leaves_the_noise_as_it_was():
    u = lively()
    plain, changed = make_log(u, seed=7), make_log(u, hidden=["sensor.dropout", "dcv.delay"], seed=7)
    assert np.allclose(changed.spool - changed.true["spool"], plain.spool - plain.true["spool"], atol=1e-15)


def test_seed_decides_everything():
    first, again, other = (
        make_log("mixed", 21.0, ["sensor.dropout"], seed=s, tracker=True) for s in (3, 3, 4)
    )
    for name, values in first.signals.items():
        assert np.array_equal(values, again.signals[name])
        assert not np.array_equal(values, other.signals[name])
    assert np.array_equal(first.tracker[1], again.tracker[1])


def test_no_noise():
    run = make_log(held((0.5, 1.0)), noise=0)
    assert np.array_equal(run.spool, run.true["spool"])
    assert run.truth["noise"]["kind"] == "none"


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"kind": "brown"}, "white"),
        ({"scale": -1.0}, "scale"),
        ({"scale": float("nan")}, "scale"),
        ({"correlation_time": 0.0}, "correlation"),
        ({"sizes": {"theta": 1.0}}, "slew"),
        ({"sizes": {"slew": -1.0}}, "slew"),
    ],
)
def test_bad_noise_is_refused(options, word):
    with pytest.raises(UsageError, match=word):
        Noise(**options)


def test_negative_seed_is_refused():
    with pytest.raises(UsageError, match="seed"):
        make_log(held((0.5, 0.1)), seed=-1)
