"""Tests that an average over the log misses: something that happens once, and something that rings at one frequency.

Noise is learned over the whole log, so a short event is taken for a little more noise everywhere, and a faint line for
a little more noise around it. Both stand out once the whitened residual is looked at piece by piece: against the other
pieces, so that noise of unknown size drops out.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.ndimage import median_filter
from scipy.special import fdtrc

from cosim.diagnosis.thresholds import (
    EVENT_EDGE,
    FEWEST_BINS_OF_LINE,
    FEWEST_STRETCHES,
    INDEPENDENT_OF_LINE,
    INDEPENDENT_VALUES,
    LEAST_LOCAL_NOISE,
    LINE_PERIODS,
    LOCAL,
)

Array = NDArray[np.float64]

PIECES = (40, 120, 360)  # bins in a piece: about half a second, a second and four
NARROWEST = 8  # values in a band of a piece


@dataclass(frozen=True)
class Event:
    """A stretch of the log, or a frequency, where the residual is larger than elsewhere.

    Attributes:
        p_value: probability of the largest of all pieces (or lines) by chance.
        gain: log-likelihood that it carries beyond chance.
        excess: its mean square over that of the rest.
        start, end: s for a stretch, Hz for a line (both the same).
        size: root mean square in the signal's unit, where it is known; otherwise `excess` says it.
    """

    p_value: float
    gain: float
    excess: float
    start: float
    end: float
    size: float = 0.0


NO_EVENT = Event(1.0, 0.0, 1.0, 0.0, 0.0)


def burst(white: Array, interval: float, skip: float = 0.0) -> Event:
    """The stretch in which white residuals (windows, bins) are largest in some band, against all others.

    An event fills some seconds and some part of the spectrum: each piece of the log is taken apart by frequency (discrete
    cosine transform, which keeps independent values independent), and every band of at least `NARROWEST` values is
    judged, the widest being the whole piece.

    Args:
        white: independent values of unit size.
        interval: s a bin.
        skip: s at the start of the log that are not judged.
    """
    row = white.ravel()
    row = row[round(skip / interval) :]
    best, tests = NO_EVENT, 0
    # the size of all the rest: without its largest hundredth, which would hide the event in its own measure
    kept = np.sort(row**2)[: int(0.99 * row.size)]
    overall = max(float(np.mean(kept)) / 0.9262, LEAST_LOCAL_NOISE) if kept.size else 0.0
    for piece in PIECES:
        count = 2 * (row.size // piece) - 1  # half overlapping
        if count < FEWEST_STRETCHES or overall <= 0.0:
            continue
        starts = np.arange(count) * (piece // 2)
        sums = band_sums(row[starts[:, None] + np.arange(piece)])
        for low, high in bands(piece):
            energy = sums[:, high] - sums[:, low]
            tests += count
            level = max(overall, float(np.median(energy)) / (high - low))
            ratio = energy / ((high - low) * level)
            at = int(np.argmax(ratio))
            freedom = INDEPENDENT_VALUES * (high - low)
            p_value = float(fdtrc(freedom, INDEPENDENT_VALUES * (row.size - piece), ratio[at]))
            if p_value >= best.p_value:
                continue
            first, last = stretch_of(ratio > 1.0 + EVENT_EDGE * np.sqrt(2.0 / freedom), at)
            start, stop = int(starts[first]), int(starts[last]) + piece
            share = (stop - start) / piece
            gain, begins, ends = heart(row[start:stop], low * share, high * share, level)
            best = Event(
                p_value,
                gain,
                1.0 + float(ratio[at] - 1.0) * (high - low) / piece,
                skip + (start + begins) * interval,
                skip + (start + ends) * interval,
            )
    return replace(best, p_value=min(1.0, best.p_value * max(tests, 1)))


def apart(white: Array, event: Event, interval: float, skip: float = 0.0) -> Array:
    """The windows (rows) that an event does not touch; all of them if it is no more than chance."""
    if event.p_value >= LOCAL:
        return white
    length = white.shape[1] * interval
    begins = skip + length * np.arange(white.shape[0])
    return white[(begins + length <= event.start) | (begins >= event.end)]


def heart(row: Array, low: float, high: float, level: float) -> tuple[float, int, int]:
    """Log-likelihood that one band of a stretch (n,) carries, and first and last bin of the part that carries it."""
    parts = dct(row, norm="ortho")
    first, last = round(low), round(high)
    parts[:first], parts[last:] = 0.0, 0.0
    gain = 0.5 * float(parts @ parts / level - (last - first))
    # where the band is at least twice as strong as elsewhere: the sum of what is beyond that is largest
    sums = np.cumsum(idct(parts, norm="ortho") ** 2 - 2.0 * level * (last - first) / row.size)
    sums = np.concatenate([[0.0], sums])
    end = int(np.argmax(sums - np.minimum.accumulate(sums)))
    return gain, int(np.argmin(sums[: end + 1])), end


def band_sums(rows: Array) -> Array:
    """(..., n) values to (..., n + 1) running sums of the squares of their cosine transform, from low frequency to high."""
    squares = dct(rows, norm="ortho", axis=-1) ** 2
    return np.concatenate([np.zeros((*rows.shape[:-1], 1)), np.cumsum(squares, axis=-1)], axis=-1)


def bands(piece: int) -> Iterator[tuple[int, int]]:
    """Half overlapping bands (first, last + 1) of a piece's transform, widths doubling up to the whole."""
    width = NARROWEST
    while 2 * width <= piece:
        for low in range(0, piece - width + 1, width // 2):
            yield low, low + width
        width *= 2
    yield 0, piece


def stretch_of(above: NDArray[np.bool_], at: int) -> tuple[int, int]:
    """First and last piece around `at` that stand out without a gap."""
    first, last = at, at
    while first > 0 and above[first - 1]:
        first -= 1
    while last + 1 < above.size and above[last + 1]:
        last += 1
    return first, last


def line(white: Array, interval: float) -> Event:
    """The frequency at which white residuals (windows, bins) are largest, against those around it."""
    windows, bins = white.shape
    if windows < 2 or bins < FEWEST_BINS_OF_LINE:
        return NO_EVENT
    taper = np.sin(
        np.pi * (np.arange(bins) + 0.5) / bins
    )  # two neighbouring frequencies stay nearly independent
    power = np.mean(np.abs(np.fft.rfft(white * taper, axis=1)[:, 1:]) ** 2, axis=0)
    # of what the whitening could not flatten a smooth part may remain: compare with the neighbourhood
    reach = 12
    around = median_filter(power, 2 * reach + 1, mode="mirror")
    freedom = INDEPENDENT_OF_LINE * 2.0 * windows
    around /= 1.0 - 2.0 / (9.0 * 2.0 * windows) * 3.0  # median of a chi-square against its mean
    ratio = power / np.maximum(around, LEAST_LOCAL_NOISE * float(taper @ taper))
    # fewer periods in a window are slow noise as well, and what free functions took of it has thinned the rest
    at = LINE_PERIODS - 1 + int(np.argmax(ratio[LINE_PERIODS - 1 :]))
    one = float(fdtrc(freedom, freedom * reach, ratio[at]))
    frequency = (at + 1) / (bins * interval)
    gain = windows * (ratio[at] - 1.0 - float(np.log(max(ratio[at], 1e-300))))
    return Event(min(1.0, one * power.size), float(gain), float(ratio[at]), frequency, frequency)


def near(rows: Array, interval: float, frequency: float) -> float:
    """RMS of residuals (windows, bins) around one frequency, half an octave wide, in their unit.

    Of white values a line rises above those beside it however little of the residual has that frequency.
    """
    windows, bins = rows.shape
    taper = np.sin(np.pi * (np.arange(bins) + 0.5) / bins) ** 2  # what is slow and large does not leak there
    own = (rows - rows.mean(axis=1, keepdims=True)) * taper / np.sqrt(np.mean(taper**2))
    power = np.abs(np.fft.rfft(own, axis=1)) ** 2
    power[:, 1 : (bins + 1) // 2] *= 2.0  # each but the first, and the last of an even number, stands for two
    at = np.fft.rfftfreq(bins, interval)
    inside = 2.0 * np.abs(np.log2(np.maximum(at, 1e-300) / frequency)) <= 0.5
    inside[np.argmin(np.abs(at - frequency))] = True
    return float(np.sqrt(np.sum(power[:, inside]) / windows)) / bins
