"""Logs of which one run of the model takes long: a diagnosis makes thousands, and uses a part that it can run so often.

A part begins where the log does, or where the machine stands as it stood there: elsewhere nobody knows the model's state.
Among these it is the one whose inputs visit most. What is named is then run over the whole log, too.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from cosim.anysystem.model import Segment
from cosim.anysystem.read import Recording
from cosim.anysystem.thin import ENOUGH
from cosim.compare.metrics import white_noise
from cosim.diagnosis.record.signatures import cells

Array = NDArray[np.float64]
RUN = 0.05  # s that one run over all logs may take: real logs took 300 to 6000 of them, in the median 1500
USUAL = 600.0  # s that a diagnosis may take; where --budget allows more, a run may take as many times longer
SAMPLE = 2e-6  # s that a sample costs beside the FMUs
COARSELY = 4.0  # times: so coarsely is it asked how long a sample takes, that another run of it says the same
PROBES = 500, 1500  # samples that are run to learn it: what a start takes is in both
STANDING = 50  # parts of the length wanted, for which the machine stands before a part begins
AS_BEFORE = 0.02  # of a reading's range: so near to where the log begins it stands as it did there
NEARLY_ALL = 0.6  # of the samples: such a part saves little and may miss what the rest shows
BEGINS = 60  # places at most where a part may begin
QUIET = 6.0  # times a reading's noise, over which it ranges where the machine stands


def head(segment: Segment, count: int) -> Segment:
    """The first samples of a log, to be run only."""
    return replace(
        segment,
        signals={n: v[:count] for n, v in segment.signals.items()},
        driving={n: v[:count] for n, v in segment.driving.items()},
        fitted=segment.fitted[:count],
        windows=segment.windows[:count],
        missing={n: m[:count] for n, m in segment.missing.items()},
        recorded={},
        stamps=np.zeros(0),
    )


def coarse_cost(seconds: float) -> float:
    """Time that a sample takes [s], to the next power of `COARSELY` of what it costs at least."""
    times = max(seconds + SAMPLE, SAMPLE) / SAMPLE
    return float(SAMPLE * COARSELY ** round(math.log(times, COARSELY)))


def most_samples(seconds: float, allowed: float) -> int:
    """Samples of all logs together that a diagnosis can run often enough.

    Args:
        seconds: that a sample takes in one run of all groups.
        allowed: time that the diagnosis may take [s]; infinite where nobody said.
    """
    more = max(1.0, allowed / USUAL) if math.isfinite(allowed) else 1.0
    return max(int(RUN * more / coarse_cost(seconds)), ENOUGH)


def lengths(counts: Sequence[int], most: int) -> list[int] | None:
    """Samples to use of each log, or None for all of all.

    Args:
        counts: samples of each.
        most: samples of all together that can be run.
    """
    if sum(counts) <= most:
        return None
    wanted = [min(n, max(n * most // sum(counts), ENOUGH)) for n in counts]
    return None if sum(wanted) > NEARLY_ALL * sum(counts) else wanted


def stands(log: Recording, judged: Collection[str], told: Collection[str], count: int) -> NDArray[np.int64]:
    """Samples of a log at which a model may begin: the first, and the last ones of where the machine stands as at the first.

    Args:
        log: the log.
        judged: signals that the model makes; all others drive it.
        told: those of them of which the model is told where they begin.
        count: samples wanted.
    """
    width = max(count // STANDING, 2)
    quiet = np.ones(log.time.size, dtype=np.bool_)
    for name, values in log.signals.items():
        span = float(np.ptp(values))
        near = QUIET * white_noise(values) + 1e-3 * span if name in judged else 1e-3 * span
        moved = np.abs(np.diff(values, prepend=values[:1])) > near
        mean = uniform_filter1d(values, width, origin=(width - 1) // 2)  # of the samples before
        quiet &= ~moved & (np.abs(values - mean) <= near)
        if name not in told:
            quiet &= np.abs(values - np.median(values[:width])) <= max(near, AS_BEFORE * span)
    quiet[:width] = False
    last = np.flatnonzero(quiet[:-1] & ~quiet[1:])
    last = last[last + count <= log.time.size]
    return np.concatenate([[0], last[:: max(1, last.size // BEGINS + 1)]]).astype(np.int64)


def visited(drives: Mapping[str, Array], span: slice) -> tuple[int, float]:
    """Cells of level and direction that inputs visit in a part of a log, and how far they move, in parts of their range."""
    count, way = 0, 0.0
    for values in drives.values():
        part, size = values[span], max(float(np.ptp(values)), 1e-300)
        count += np.unique(cells(part, float(values.min()), size)).size
        way += float(np.abs(np.diff(part)).sum()) / size
    return count, round(way, 6)


def part_of(log: Recording, judged: Collection[str], told: Collection[str], count: int) -> Recording:
    """So many samples of a log, of which its inputs visit most; the log itself if it has no more."""
    if count >= log.time.size:
        return log
    drives = {n: v for n, v in log.signals.items() if n not in judged}
    begins = stands(log, judged, told, count).tolist()
    first = max(begins, key=lambda k: (*visited(drives, slice(k, k + count)), -k))
    span = slice(first, first + count)
    time = log.time[span]
    return replace(
        log,
        time=time,
        signals={n: v[span] for n, v in log.signals.items()},
        missing={n: m[span] for n, m in log.missing.items() if m[span].any()},
        gaps=tuple((a, b) for a, b in log.gaps if time[0] <= a and b <= time[-1]),
    )
