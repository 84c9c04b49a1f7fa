"""White from coloured: exact against the dense Cholesky factor, and noise learned from samples is the noise put in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

from cosim.inference import noise as noise_module
from cosim.inference.noise import Noise, correlation_times, quietest
from cosim.inference.spectrum import BANDS, LOWEST, bands, learn
from cosim.inference.thresholds import NEGLIGIBLE
from cosim.rig import Noise as RigNoise


def dense(noise: Noise, places: np.ndarray) -> np.ndarray:
    lags = np.abs(places[:, None] - places)
    parts = [s * np.exp(-lags / t) for s, t in zip(noise.sizes, noise.times, strict=True)]
    return noise.white * np.eye(places.size) + sum(parts, np.zeros(lags.shape))


@given(
    white=st.floats(0.01, 2.0),
    # none is negligible (below 1e-3 of the spectrum at its corner), where it would be left out
    sizes=st.lists(st.floats(0.5, 10.0), min_size=0, max_size=4),
    seed=st.integers(0, 1000),
)
@settings(max_examples=30, deadline=None)
def test_whitening_is_the_inverse_cholesky_factor(white: float, sizes: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = np.sort(rng.choice(300, 120, replace=False)).astype(np.int64)  # with gaps
    noise = Noise(white, tuple(3.0 ** np.arange(len(sizes))), tuple(sizes))
    rows = rng.standard_normal((2, 120))
    expected = np.linalg.solve(np.linalg.cholesky(dense(noise, places)), rows.T).T
    np.testing.assert_allclose(
        noise.whiten(rows, places), expected, rtol=0.0, atol=1e-8 * np.abs(expected).max()
    )
    sign, logarithm = np.linalg.slogdet(dense(noise, places))
    assert (sign, noise.log_determinant(places)) == (1.0, pytest.approx(logarithm, abs=1e-8))


def test_the_factor_that_is_kept_is_that_of_the_places_asked_for() -> None:
    noise = Noise(0.5, (1.0, 9.0), (2.0, 1.0))
    rows = np.random.default_rng(2).standard_normal((2, 40))
    spread = [np.arange(40), np.arange(0, 80, 2), np.sort(np.random.default_rng(3).permutation(90)[:40])]
    for places in (*spread, *spread[::-1]):
        expected = np.linalg.solve(np.linalg.cholesky(dense(noise, places)), rows.T).T
        np.testing.assert_allclose(noise.whiten(rows, places), expected, rtol=0.0, atol=1e-9)
    assert np.array_equal(noise.whiten(rows), noise.whiten(rows, spread[0]))


def test_a_factor_is_made_once_for_the_places_of_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    factored = noise_module._factored

    def counted(gaps: np.ndarray, *words: object) -> object:
        made.append(gaps.size)
        return factored(gaps, *words)

    monkeypatch.setattr(noise_module, "_factored", counted)
    noise, places, rows = Noise(0.5, (9.0,), (1.0,)), np.arange(0, 80, 2), np.ones((1, 40))
    for _ in range(3):
        noise.whiten(rows, places)
    assert made == [40]


def test_a_computed_signal_is_as_quiet_as_a_part_of_its_steps() -> None:
    pace = 2.0 * np.pi * 8.0 / 4000.0  # whole turns
    signal = np.sin(pace * np.arange(4001))
    step = pace * np.sqrt(0.5)  # root mean square of its differences
    assert quietest(signal) == pytest.approx(noise_module.COMPUTED * step, rel=1e-3)


def test_what_is_left_out_of_the_whitening_hardly_matters() -> None:
    rng = np.random.default_rng(1)
    places = np.arange(120)
    noise = Noise(8.0, (1.0, 3.0), (0.01, 6.0))
    rows = rng.standard_normal((2, 120))
    expected = np.linalg.solve(np.linalg.cholesky(dense(noise, places)), rows.T).T
    np.testing.assert_allclose(noise.whiten(rows, places), expected, rtol=0.0, atol=1e-3)


@pytest.mark.parametrize(("white", "times", "sizes"), [(1.0, (), ()), (0.2, (5.0, 60.0), (1.0, 0.4))])
def test_effective_samples_are_those_of_the_mean(white: float, times: tuple, sizes: tuple) -> None:
    noise = Noise(white, times, sizes)
    covariance = dense(noise, np.arange(400))
    assert noise.effective(400) == pytest.approx(noise.rms**2 / covariance.mean(), rel=1e-9)


# five standard deviations of a correlation of independent samples; sums of exponentials spaced by a factor of three
# follow 1/f to a few per cent only
@pytest.mark.parametrize(
    ("kind", "tau", "left"), [("white", 0.01, 0.025), ("ar1", 0.03, 0.025), ("pink", 0.01, 0.04)]
)
def test_noise_learned_is_the_noise_put_in(kind: str, tau: float, left: float) -> None:
    noise = RigNoise(kind=kind, correlation_time=tau, sizes={"slew": 1.0})
    x = noise.draw("slew", 40_000, seed=5)
    found = learn({"x": bands(x, np.empty((0, x.size)))}, np.empty((0, 0)))["x"]
    assert found.rms == pytest.approx(1.0, rel=0.12)  # slow noise: few independent samples
    white = found.whiten(x[None, :], np.arange(x.size))[0]
    assert np.var(white) == pytest.approx(1.0, abs=0.05)
    for lag in (1, 3, 10, 30, 100, 300):
        assert abs(np.mean(white[lag:] * white[:-lag])) < left, lag


def test_a_computed_log_has_the_noise_that_two_programs_differ_by() -> None:
    x = np.zeros(5000)
    least = quietest(np.sin(np.arange(5000) * 0.01))
    assert 1e-5 < least < 1e-3
    found = learn({"x": bands(x, np.ones((1, 5000)), least)}, np.zeros((1, 1)))["x"]
    assert found.rms == pytest.approx(least, rel=0.05)
    assert quietest(np.full(100, 170e5)) == pytest.approx(17.0)  # a supply that never changes
    assert quietest(np.zeros(100)) > 0.0


@given(scale=st.floats(0.3, 3.0), kind=st.sampled_from(["white", "ar1", "pink"]))
@settings(max_examples=15, deadline=None)
def test_noise_of_sensors_counts_as_it_is(scale: float, kind: str) -> None:
    """What a computed log is given fills nothing up where there is noise."""
    noise = RigNoise(kind=kind, correlation_time=0.02, sizes={"slew": scale}).draw("slew", 4000, seed=7)
    still = np.empty((0, noise.size))
    plain, filled = bands(noise, still), bands(noise, still, quietest(noise + np.linspace(0.0, 1e3, 4000)))
    assert np.array_equal(plain.power, filled.power)


@pytest.mark.parametrize("place", [0, 1, 40, -1])
def test_the_power_of_a_sine_is_in_its_band(place: int) -> None:
    """All of it but what the taper spreads beyond the lowest frequency: a sine of unit size has a variance of a half."""
    n = 4000
    count = bands(np.zeros(n), np.zeros((1, n))).count
    edges = LOWEST + np.concatenate([[0.0], np.cumsum(count)])
    k = round(0.5 * (edges[:-1] + edges[1:])[place] - 0.5)
    found = bands(np.sin(2.0 * np.pi * k * np.arange(n) / n), np.zeros((1, n)))
    assert np.argmax(found.power) == place % count.size
    assert found.power.sum() == pytest.approx(0.25 * n, rel=0.35 if place == 0 else 0.01)


def test_what_a_fit_absorbs_is_put_back() -> None:
    """A cubic takes the slow part out of a residual; the noise learned is nevertheless the noise that was there."""
    n, p = 2_000, 4
    rng = np.random.default_rng(3)
    basis = np.vander(np.linspace(-1.0, 1.0, n), p).T
    true = Noise(1.0, (400.0,), (1.0,))
    power = []
    step = np.exp(-1.0 / 400.0)
    for _ in range(20):
        kicks = np.sqrt(1.0 - step**2) * rng.standard_normal(n)
        slow, _ = lfilter([1.0], [1.0, -step], kicks, zi=[step * rng.standard_normal()])
        x = slow + rng.standard_normal(n)
        coefficients = np.linalg.lstsq(basis.T, x, rcond=None)[0]
        with threadpool_limits(1):
            found = learn({"x": bands(x - coefficients @ basis, basis)}, np.zeros((p, p)))["x"]
        power.append(found.effective(n))
    # the mean of 2000 such samples is worth six independent ones; with nothing put back it is taken for eight times as many
    assert true.effective(n) / 3.0 < np.median(power) < 5.0 * true.effective(n)


def test_correlation_times_reach_from_a_sample_to_the_log() -> None:
    times = correlation_times(10_000)
    assert times[0] == 1.0
    assert 3_000 < times[-1] <= 10_000


@pytest.mark.parametrize(("share", "kept"), [(0.9, (8.0,)), (1.1, (2.0, 8.0))])
def test_a_part_is_left_out_where_it_is_negligible_beside_all_at_its_own_rate(
    share: float, kept: tuple
) -> None:
    """Its spectrum at its own corner, against white noise and the slower part there; that of white noise is 1."""

    def spectrum(tau: float, w: float) -> float:
        phi = np.exp(-1.0 / tau)
        return (1.0 - phi**2) / (1.0 - 2.0 * phi * np.cos(w) + phi**2)

    beside = 0.3 + 5.0 * spectrum(8.0, 0.5)
    limit = NEGLIGIBLE * beside / (1.0 - NEGLIGIBLE) / spectrum(2.0, 0.5)
    rates, sizes = Noise(0.3, (2.0, 8.0), (share * limit, 5.0))._correlated
    assert 1.0 / rates == pytest.approx(kept)
    assert sizes[-1] == 5.0


def test_bands_widen_by_one_ratio_and_hold_every_frequency_once() -> None:
    """From the lowest to below half of the sampling rate."""
    count = bands(np.zeros(40_000), np.zeros((1, 40_000))).count
    assert count.sum() == 20_000 - LOWEST
    assert count[-1] == round(20_000 * (1.0 - (20_000 / LOWEST) ** (-1.0 / BANDS)))
    assert (np.diff(count) >= -1.0).all()  # but for rounding


def test_an_unknown_that_does_not_act_absorbs_nothing() -> None:
    rng = np.random.default_rng(6)
    x, acting = np.cumsum(rng.standard_normal(500)), np.linspace(-1.0, 1.0, 500)[None]
    idle = np.concatenate([acting, np.zeros((1, 500))])
    with threadpool_limits(1):
        one, two = (
            learn({"x": bands(x, slopes)}, np.zeros((len(slopes),) * 2))["x"] for slopes in (acting, idle)
        )
    # one that acts absorbs a 500th of the power; the search stops where a likelihood changes by 2e-9 of itself
    assert two.rms == pytest.approx(one.rms, rel=1e-4)
    assert two.sizes == pytest.approx(one.sizes, rel=1e-3, abs=1e-4 * one.rms**2)
