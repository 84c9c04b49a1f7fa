"""A slow oscillation that the machine's motion does not explain: a vessel that rolls, a load that swings, a returning gust.

A window holds too few of its periods for a line to stand out there, and slow noise may look like one. Over the whole log a
line is as narrow as the log is long, and noise is not. Each frequency is asked what the residual's transforms by several
orthogonal tapers have in common with those of a pure oscillation (Thomson 1982, Spectrum Estimation and Harmonic
Analysis, Proc. IEEE 70, section XIII), after what they have in common with those of the motion is taken out.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend
from scipy.signal.windows import dpss
from scipy.special import fdtrc

from cosim.diagnosis.residuals.local import NO_EVENT, Event
from cosim.diagnosis.thresholds import (
    CHANCES_A_FREQUENCY,
    OFF_THE_MOTION,
    OSCILLATION_PERIODS,
    VALUES_A_TAPER,
)

Array = NDArray[np.float64]
Transforms = NDArray[np.complex128]  # (frequencies, tapers)

BANDWIDTH = 4.0  # half-width of a taper's band, in frequencies of one period a log
TAPERS = 7  # of that bandwidth that leak next to nothing
PADDED = 4  # how much finer than one period a log the frequencies lie


def slow_oscillation(residual: Array, motions: Sequence[Array], interval: float, highest: float) -> Event:
    """The frequency at which a residual holds an oscillation over the whole log that no motion has.

    Args:
        residual: (n,) measured less predicted.
        motions: signals (n,) that may leave something of themselves in the residual.
        interval: s between values.
        highest: Hz up to which is looked.

    Returns:
        the clearest oscillation; its `excess` is its mean square over that of all the rest, plus one.
    """
    n = residual.size
    length = n * interval
    tests = (highest - OSCILLATION_PERIODS / length) * length
    if tests < 1.0 or n < VALUES_A_TAPER * TAPERS or not residual.any():
        return NO_EVENT
    tapers, count = dpss(n, BANDWIDTH, TAPERS), PADDED * n
    frequencies = np.fft.rfftfreq(count, interval)
    asked = (frequencies >= OSCILLATION_PERIODS / length) & (frequencies <= highest)

    def transforms(signal: Array) -> Transforms:
        return np.asarray(np.fft.rfft(tapers * detrend(signal), count, axis=1).T[asked])

    target = transforms(residual)
    basis = spanned([transforms(m) for m in motions if np.ptp(m) > 0.0] or [np.zeros_like(target)])
    pure = tapers.sum(axis=1)  # of an oscillation at that frequency
    wave, rest = without(basis, np.broadcast_to(pure + 0j, target.shape)), without(basis, target)
    power = np.sum(np.abs(wave) ** 2, axis=1)
    size = np.sum(wave.conj() * rest, axis=1) / np.maximum(power, 1e-300)
    explained = np.abs(size) ** 2 * power
    left = np.maximum(np.sum(np.abs(rest) ** 2, axis=1) - explained, 1e-300)
    freedom = TAPERS - 1 - basis.shape[2]
    # a motion that is itself an oscillation there leaves nothing to tell the two apart by
    ratio = np.where(power > OFF_THE_MOTION * float(pure @ pure), explained / left, 0.0)
    at = int(np.argmax(ratio))
    p_value = float(fdtrc(2, 2 * freedom, ratio[at] * freedom))
    amplitude = 2.0 * float(np.abs(size[at]))
    others = max(float(np.mean(detrend(residual) ** 2)) - 0.5 * amplitude**2, 1e-300)
    frequency = float(frequencies[asked][at])
    return Event(
        min(1.0, p_value * tests * CHANCES_A_FREQUENCY),
        (TAPERS - 1) * float(np.log1p(ratio[at])),
        1.0 + 0.5 * amplitude**2 / others,
        frequency,
        frequency,
        amplitude / math.sqrt(2.0),
    )


def spanned(transforms: list[Transforms]) -> Transforms:
    """(frequencies, tapers, k) orthonormal directions of several signals' transforms; zeros where two are the same."""
    stacked = np.stack(transforms, axis=2)
    stacked = stacked / np.maximum(np.linalg.norm(stacked, axis=1, keepdims=True), 1e-300)
    basis, sizes, _ = np.linalg.svd(stacked, full_matrices=False)
    return np.asarray(basis * (sizes > 1e-6)[:, None, :])


def without(basis: Transforms, rows: Transforms) -> Transforms:
    """(frequencies, tapers) without what lies along the directions of `basis`."""
    return rows - np.einsum("ftm,fm->ft", basis, np.einsum("ftm,ft->fm", basis.conj(), rows))
