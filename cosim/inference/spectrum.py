"""Learning the noise of each signal from what a fit leaves over.

The tapered periodogram of a residual is averaged over bands that widen with frequency. Expected spectra are fitted to it
by Whittle's likelihood. What the fit itself took out of the residual is put back (restricted likelihood): slow noise has
few degrees of freedom, and free parameters absorb many of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal.windows import hann

from cosim.inference.noise import Noise, correlation_times, density

Array = NDArray[np.float64]
BANDS = 80
LOWEST = 2  # the taper spreads a constant over the first two frequencies
SMALLEST_SHARE = 1e-8  # smallest share of a kind of noise
SPARING = 1.0  # weight against power at rest that the data do not ask for: absorbed frequencies leave it open
RESTORED = 8  # rounds in which absorbed power is put back


@dataclass(frozen=True)
class Bands:
    """Power of one signal's residual and slopes in bands of frequency, per unit of white noise.

    Attributes:
        count: (b,) frequencies in each band.
        power: (b,) summed over the band, squares of the signal's unit.
        gram: (b, p, p) of the slopes, summed over the band.
        shapes: (1 + j, b) mean spectrum of white noise and of noise of each correlation time, of unit variance.
        times: (j,) those times, in samples.
    """

    count: Array
    power: Array
    gram: Array
    shapes: Array
    times: tuple[float, ...]


def bands(residual: Array, slopes: Array, least: float = 0.0) -> Bands:
    """Bands of a residual (n,) and slopes (p, n) of the prediction, uniformly sampled, same unit.

    A residual smaller than `least` is taken to hold white noise that fills it up to that size.
    """
    n = residual.size
    taper = hann(n, sym=False)
    rows = np.fft.rfft(np.vstack([residual - residual.mean(), slopes]) * taper, axis=1)
    rows /= np.sqrt(np.sum(taper**2))
    last = (n - 1) // 2
    edges = np.unique(np.rint(np.geomspace(LOWEST, last + 1, BANDS + 1)).astype(int))
    count = np.diff(edges).astype(np.float64)
    times = correlation_times(n)
    k = np.arange(edges[0], edges[-1])
    fine = np.stack([np.ones(k.size)] + [density(tau, 2.0 * np.pi * k / n) for tau in times])
    starts = edges[:-1] - edges[0]
    shapes = np.add.reduceat(fine, starts, axis=1) / count
    used = rows[:, edges[0] : edges[-1]]
    power = np.add.reduceat(np.abs(used[0]) ** 2, starts)
    power += max(0.0, least**2 - float(power.sum() / count.sum())) * count
    gram = np.stack([(part @ part.conj().T).real for part in np.split(used[1:], starts[1:], axis=1)])
    return Bands(count, power, gram, shapes, times)


def learn(signals: dict[str, Bands], prior: Array) -> dict[str, Noise]:
    """Noise of each signal, by the restricted Whittle likelihood of all together.

    Args:
        signals: signal -> bands; the slopes are with respect to the same parameters in each.
        prior: (p, p) information that priors bring.
    """
    found = {name: _fit(b, b.power) for name, b in signals.items()}
    if not any(b.gram.any() for b in signals.values()):  # nothing was absorbed
        return found
    for _ in range(RESTORED):
        spectra = {name: _spectrum(b, found[name]) for name, b in signals.items()}
        information = prior + sum(
            2.0 * np.tensordot(1.0 / spectra[name], b.gram, axes=1) for name, b in signals.items()
        )
        covariance = np.linalg.pinv(information, rcond=1e-12, hermitian=True)
        found = {
            name: _fit(b, b.power + np.einsum("ij,bji->b", covariance, b.gram)) for name, b in signals.items()
        }
    return found


def _spectrum(b: Bands, noise: Noise) -> Array:
    return np.asarray(np.array([noise.white, *noise.sizes]) @ b.shapes)


def _fit(b: Bands, power: Array) -> Noise:
    """Sizes of largest Whittle likelihood: multiplicative updates, then a quasi-Newton search in logarithms.

    The updates can bring back a kind that was small for a while, where a search in logarithms stays stuck (Fevotte,
    Bertin, Durrieu, Neural Computation 21(3), 2009).
    """
    mean = power / b.count
    total = max(float(power.sum() / b.count.sum()), 1e-300)
    sizes = np.full(len(b.shapes), total / len(b.shapes))
    for _ in range(200):
        model = sizes @ b.shapes
        sizes = sizes * np.sqrt((b.shapes @ (b.count * mean / model**2)) / (b.shapes @ (b.count / model)))

    still = np.array([1.0] + [float(density(tau, np.zeros(1))[0]) for tau in b.times])

    def cost(logs: Array) -> tuple[float, Array]:
        parts = np.exp(logs)[:, None] * b.shapes
        model = parts.sum(axis=0)
        slow = np.exp(logs) * still
        value = float(b.count @ (np.log(model) + mean / model)) + SPARING * float(np.log(slow.sum()))
        return value, parts @ (b.count * (1.0 - mean / model) / model) + SPARING * slow / slow.sum()

    low, high = np.log(SMALLEST_SHARE * total), np.log(1e8 * total)
    start = np.clip(np.log(np.maximum(sizes, 1e-300)), low, high)
    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=[(low, high)] * start.size)
    white, *rest = np.exp(found.x).tolist()
    return Noise(white, b.times, tuple(rest))
