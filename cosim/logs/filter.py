"""Low-pass filter for logs: the source's input filter (2.1, 3.1), a Butterworth of order 2, on every signal alike.

Command and response go through the same filter, so a linear relation between them stays what it was: filtering only one
of them would put the filter's lag into the model. The filter is causal, as the one on the input card is, and starts
settled at the first sample.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

from cosim.errors import DataError, UsageError
from cosim.logs.log import Log

Array = NDArray[np.float64]

ORDER = 2  # (2.1), (3.1)
CARD_RATE, CARD_CUTOFF = 250e3, 1e3  # Hz, of the input card: 2 Fc/Fs = 0.008 (2.1), (3.1)
PIECE = 4000  # samples at a time: a log of hours is not held at 250 kHz


def low_pass(values: Array, step: float, cutoff: float, order: int = ORDER) -> Array:
    """Values (..., n) behind a Butterworth low-pass, settled at the first of them.

    Args:
        values: one every `step` s along the last axis.
        step: [s].
        cutoff: [Hz], where the gain is 1/sqrt(2).
        order: of the filter.

    Raises:
        UsageError: the cut-off is not between zero and half the sampling rate, or the order is below 1.
    """
    limit = 0.5 / step
    if order < 1:
        raise UsageError(f"a filter of order {order} is none: use 1 or more")
    if not 0.0 < cutoff < limit:
        raise UsageError(
            f"a cut-off of {cutoff:g} Hz does not lie between 0 and half the sampling rate, {limit:g} Hz: choose a lower one"
            " (the input card's own 1 kHz acts at 250 kHz, before the log is sampled)"
        )
    sections = butter(order, cutoff, fs=1.0 / step, output="sos")
    data = np.asarray(values, dtype=np.float64)
    settled = sosfilt_zi(sections).reshape(sections.shape[0], *([1] * (data.ndim - 1)), 2)
    found, _ = sosfilt(sections, data, zi=settled * data[..., :1])
    return np.asarray(found)


def input_card(values: Array, step: float) -> Array:
    """What the input card passes of a channel: its Butterworth filter in samples at 250 kHz (2.1), (3.1).

    The channel moves on straight lines between its values and stands still before the first. What comes out is what the card
    hands on at the same instants; it trails by sqrt(2)/(2 pi 1 kHz), 0.225 ms. The block `sensor` has the same filter in
    continuous time (`sensor.f_c`).

    Args:
        values: (n,), one every `step` s.
        step: [s], a whole number of periods of 250 kHz.

    Raises:
        UsageError: it is not.
    """
    times = round(step * CARD_RATE)
    if times < 1 or abs(step * CARD_RATE - times) > 1e-6 * times:
        raise UsageError(
            f"a step of {step:g} s is no whole number of the card's samples of {1.0 / CARD_RATE:g} s"
        )
    sections = butter(ORDER, CARD_CUTOFF, fs=CARD_RATE, output="sos")
    data = np.asarray(values, dtype=np.float64)
    state = sosfilt_zi(sections) * data[0]
    found = np.empty(data.size)
    found[0] = data[0]
    for first in range(0, data.size - 1, PIECE):
        last = min(first + PIECE, data.size - 1)
        at = np.arange(1, (last - first) * times + 1) / times
        fine = np.interp(at, np.arange(last - first + 1), data[first : last + 1])
        passed, state = sosfilt(sections, fine, zi=state)
        found[first + 1 : last + 1] = passed[times - 1 :: times]
    return found


def low_pass_without_shift(values: Array, step: float, cutoff: float, order: int) -> Array:
    """Values (n,), one every `step` s, below `cutoff` Hz: a Butterworth forth and back, at most at 0.9 of half the rate."""
    sections = butter(order, min(2.0 * cutoff * step, 0.9), output="sos")
    return np.asarray(sosfiltfilt(sections, values))


def filter_log(log: Log, cutoff: float, order: int = ORDER, signals: Sequence[str] | None = None) -> Log:
    """A log whose signals have all passed the same low-pass.

    Args:
        log: at an even rate.
        cutoff: [Hz].
        order: of the filter.
        signals: filter only these; a model of one that is filtered and one that is not has the filter's lag in it.

    Raises:
        DataError: the log's rate is uneven, so that no filter is the same everywhere; or a signal is not in it.
        UsageError: see `low_pass`.
    """
    if not log.uniform:
        raise DataError(f"{log.source}: the sampling is uneven: resample the log before it is filtered")
    chosen = (
        list(log.signals) if signals is None else [name for name in signals if log.require(name) is not None]
    )
    filtered = {name: low_pass(log.signals[name], log.step, cutoff, order) for name in chosen}
    note = f"{', '.join(chosen)}: filtered, Butterworth of order {order}, cut-off {cutoff:g} Hz"
    return dataclasses.replace(log, signals=log.signals | filtered, warnings=(*log.warnings, note))
