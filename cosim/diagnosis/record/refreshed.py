"""Readings that are refreshed more rarely than they are logged: between two refreshes the log holds the last one.

A sensor behind a bus, or read in a slower loop, gives a staircase. Its sawtooth against a motion that goes on passes for
noise, for a vibration at the rate of refreshing and for lateness; what was measured is what was read at the refreshes. Lost
packets come at random, and readings in coarse steps change by one step at a time: neither is a staircase of even treads.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.record.signatures import bridged, finest
from cosim.diagnosis.thresholds import EVEN_TREADS, FEWEST_TREADS, JUMPED_STEPS, TREAD_SPREAD
from cosim.logs import Log

Array = NDArray[np.float64]


def refreshed_every(values: Array) -> int:
    """Samples after which readings (n,) are refreshed; 1 where they may be at every sample.

    Only readings that jump on tell it, by more than the steps in which they come: of those that stay or creep the next may
    be the same.
    """
    change = np.diff(values)
    at = np.flatnonzero(change)
    treads = np.diff(at)
    # most logs have a new reading at every sample
    if np.count_nonzero(treads > 1) < max(FEWEST_TREADS, 0.5 * treads.size):
        return 1
    told = treads[np.abs(change[at[1:]]) > JUMPED_STEPS * finest(values)]
    if told.size < FEWEST_TREADS:
        return 1
    usual = int(np.median(told))
    spread = max(1, round(TREAD_SPREAD * usual))
    even = (told >= max(2, usual - spread)) & (told <= usual + spread)
    return usual if usual > 1 and float(np.mean(even)) > EVEN_TREADS else 1


def held_over(values: Array, every: int) -> NDArray[np.bool_]:
    """(n,) True where readings (n,) that are refreshed every so many samples only stay from the last refresh.

    What stays longer than two treads has been read again and was the same, all but the treads at both ends.
    """
    held = np.zeros(values.size, dtype=bool)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [values.size]])
    for first, last in pairwise(edges):
        held[first + 1 : last] = True
        if last - first > 2 * every:
            held[first + every : last - every + 1] = False
    held[-1] = False  # a line needs an end
    return held


def at_refreshes(log: Log, drive: str) -> tuple[Log, list[str]]:
    """The log with only what was read: samples between the refreshes of a signal are filled in, as missing ones are.

    Args:
        log: a log.
        drive: the command, which a controller may hold as it likes.

    Returns:
        The log, and what is said of it, one sentence for each such signal.
    """
    signals, valid, told = dict(log.signals), dict(log.valid), list[str]()
    for name, values in log.signals.items():
        every = 1 if name == drive or name in log.held else refreshed_every(values)
        if every == 1:
            continue
        held = held_over(values, every)
        signals[name] = bridged(values, held, log.time)
        valid[name] = log.valid_mask(name) & ~held
        told.append(
            f"{log.name}: {name} has a new reading every {every} samples only: what it repeats between them counts as "
            "missing"
        )
    return replace(log, signals=signals, valid=valid) if told else log, told
