"""Tests that an average over the log misses: something that happens once, and something that rings at one frequency.

Noise is learned over the whole log, so a short event is taken for a little more noise everywhere, and a faint line for
a little more noise around it. Both stand out once the whitened residual is looked at piece by piece: against the other
pieces, so that noise of unknown size drops out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

Array = NDArray[np.float64]

PIECES = (40, 120)  # bins in a piece: about half a second and a second
INDEPENDENT = (
    0.6  # share of a piece's values that count as independent: noise is neither quite white nor quite normal
)


@dataclass(frozen=True)
class Event:
    """A stretch of the log, or a frequency, where the residual is larger than elsewhere.

    Attributes:
        p_value: probability of the largest of all pieces (or lines) by chance.
        gain: log-likelihood that it carries beyond chance.
        excess: its mean square over that of the rest.
        start, end: s for a stretch, Hz for a line (both the same).
    """

    p_value: float
    gain: float
    excess: float
    start: float
    end: float


NOTHING = Event(1.0, 0.0, 1.0, 0.0, 0.0)


def burst(white: Array, interval: float, skip: float = 0.0) -> Event:
    """The stretch in which white residuals (windows, bins) are largest, against all others.

    Args:
        white: independent values of unit size.
        interval: s a bin.
        skip: s at the start of the log that are not judged.
    """
    row = white.ravel()
    row = row[round(skip / interval) :]
    best = NOTHING
    for piece in PIECES:
        count = 2 * (row.size // piece) - 1  # half overlapping
        if count < 8:
            continue
        starts = np.arange(count) * (piece // 2)
        sums = np.concatenate([[0.0], np.cumsum(row**2)])
        energy = sums[starts + piece] - sums[starts]
        # the size of all the rest: without its largest tenth, which would hide the event in its own measure
        level = float(np.mean(np.sort(row**2)[: int(0.99 * row.size)])) / 0.9262
        ratio = energy / (piece * level)
        at = int(np.argmax(ratio))
        one = float(f_distribution.sf(ratio[at], INDEPENDENT * piece, INDEPENDENT * (row.size - piece)))
        p_value = min(1.0, one * count * len(PIECES))
        if p_value < best.p_value:
            above = ratio > 1.0 + 4.0 * np.sqrt(2.0 / (INDEPENDENT * piece))
            first, last = at, at
            while first > 0 and above[first - 1]:
                first -= 1
            while last + 1 < count and above[last + 1]:
                last += 1
            stretch = slice(starts[first], starts[last] + piece)
            gain = 0.5 * float(np.sum(row[stretch] ** 2) / level - (stretch.stop - stretch.start))
            best = Event(
                p_value,
                gain,
                float(ratio[at]),
                skip + stretch.start * interval,
                skip + stretch.stop * interval,
            )
    return best


def line(white: Array, interval: float) -> Event:
    """The frequency at which white residuals (windows, bins) are largest, against those around it."""
    windows, bins = white.shape
    if windows < 2 or bins < 60:
        return NOTHING
    taper = np.sin(
        np.pi * (np.arange(bins) + 0.5) / bins
    )  # two neighbouring frequencies stay nearly independent
    power = np.mean(np.abs(np.fft.rfft(white * taper, axis=1)[:, 1:]) ** 2, axis=0)
    # of what the whitening could not flatten a smooth part may remain: compare with the neighbourhood
    reach = 12
    padded = np.pad(power, reach, mode="reflect")
    around = np.array([np.median(padded[i : i + 2 * reach + 1]) for i in range(power.size)])
    freedom = INDEPENDENT * 2.0 * windows
    around /= 1.0 - 2.0 / (9.0 * 2.0 * windows) * 3.0  # median of a chi-square against its mean
    ratio = power / np.maximum(around, 1e-300)
    at = int(np.argmax(ratio))
    one = float(f_distribution.sf(ratio[at], freedom, freedom * reach))
    frequency = (at + 1) / (bins * interval)
    gain = windows * (ratio[at] - 1.0 - float(np.log(ratio[at])))
    return Event(min(1.0, one * power.size), float(gain), float(ratio[at]), frequency, frequency)
