"""From a log to the input and output of one block, checked: long enough, moving, with what it needs."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.fft import prev_fast_len

from cosim.compare.metrics import noise_floor
from cosim.errors import DataError
from cosim.identify.nominal import valve_demand
from cosim.logs import Log
from cosim.logs.filter import low_pass
from cosim.signals import SIGNALS
from cosim.units import factor

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SHORTEST = 2.0  # s
MOVES = 12.0  # times its noise that a signal must move from end to end; a million samples of noise span ten
SMALLEST_COMMAND = 0.02  # [1], peak to peak
AT_STOP = 0.985  # of the spool's travel: from here on a stop may hold it
SETTLING = 0.6  # s after a stop in which the valve's motion is still not that of a linear one

WHAT = {
    "u": "the valve",
    "spool": "valve or pressure",
    "p_load": "pressure or mechanics",
    "slew": "the mechanics",
}


@dataclass(frozen=True)
class Record:
    """Input and output of one block, at an even rate.

    Attributes:
        name: of the log, for messages and tables.
        step: [s].
        input: (n,) SI.
        output: (n,) SI.
        keep: (n,), False where the output says nothing.
        held: the input is constant between samples.
        start: time of the first sample [s].
        notes: what was done, one sentence each.
    """

    name: str
    step: float
    input: Array
    output: Array
    keep: Mask
    held: bool
    start: float = 0.0
    notes: tuple[str, ...] = field(default=())

    def part(self, first: int, last: int) -> "Record":
        """Samples ``first <= k < last``."""
        cut = slice(first, last)
        start = self.start + first * self.step
        return Record(
            self.name,
            self.step,
            self.input[cut],
            self.output[cut],
            self.keep[cut],
            self.held,
            start,
            self.notes,
        )

    @property
    def duration(self) -> float:
        """[s]."""
        return self.input.size * self.step


def even(log: Log) -> tuple[Log, list[str]]:
    """The log at an even rate, and what had to be done.

    Raises:
        DataError: its time is in samples, or it is too short.
    """
    if log.time_unit != "s":
        raise DataError(
            f"{log.source}: its time is in samples: name the step in seconds in the mapping ([time] step)"
        )
    if log.duration < SHORTEST:
        raise DataError(
            f"{log.source}: {log.duration:.3g} s are too short to identify anything: record at least {SHORTEST:g} s"
        )
    if log.uniform:
        return log, []
    return log.resample(log.step), [f"sampled unevenly: brought to every {log.step * 1e3:.4g} ms"]


def moving(log: Log, name: str) -> Array:
    """A signal of the crane (n,) that must move to be of use.

    Raises:
        DataError: it is not in the log, or does not stand out from its noise.
    """
    return travels(log, name, SMALLEST_COMMAND if name == "u" else None)


def travels(log: Log, name: str, least: float | None = None, driven: bool = False) -> Array:
    """A signal (n,) that must move by more than `least` [SI], or else than its noise, to be of use.

    A torque that was `driven` may move in a few steps, which are no rounding.

    Raises:
        DataError: it is not in the log, or does not stand out from its noise.
    """
    values = log.require(name, WHAT.get(name, "this"))
    travel = float(np.ptp(values))
    if least is None and driven and np.unique(values).size <= MOVES:
        least = 0.0
    if least is None:
        least = MOVES * noise_floor(values, log.step)
    if travel <= least or float(np.std(values)) == 0.0:
        unit = SIGNALS[name].unit if name in SIGNALS else log.display[name]
        si = SIGNALS[name].si if name in SIGNALS else log.units[name]
        raise DataError(
            f"{log.source}: '{name}' hardly moves ({travel * factor(si, unit):.3g} {unit} in all): nothing can be"
            " identified from it; record a log with an excitation, such as one of `cosim identify experiment`"
        )
    return values


def measured(log: Log, *names: str) -> Mask:
    """Mask (n,): True where all these signals were measured, neither filled nor within a gap."""
    keep = np.ones(len(log), dtype=bool)
    for name in names:
        keep &= log.valid_mask(name)
    for gap in log.gaps:
        keep &= (log.time <= gap.start) | (log.time >= gap.stop)
    return keep


def record(
    log: Log,
    source: str,
    target: str,
    known: Mapping[str, float],
    *,
    linear: bool = False,
    cutoff: float | None = None,
) -> Record:
    """Input and output of a block from a log.

    Args:
        log: the log.
        source: signal that drives the block; ``u`` goes through compensator and dead zone first.
        target: signal that it makes.
        known: nominal numbers.
        linear: take the command u as it is, as the source does.
        cutoff: low-pass [Hz] on both alike.

    Raises:
        DataError: a signal is missing or does not move, or the log is too short.
        UsageError: the cut-off does not fit the log.
    """
    log, notes = even(log)
    given = moving(log, source) if source == "u" else travels(log, source, driven=True)
    made = moving(log, target)
    if source == "u" and not linear:
        given = valve_demand(given, dict(known))
    keep = measured(log, source, target)
    if target == "spool":
        free = away_from_stops(made, known, log.step)
        if not free.all():
            notes.append(f"{100 * (1 - free.mean()):.2g} % of the samples left out: the spool was at a stop")
        keep &= free
    if keep.mean() < 0.5:
        raise DataError(
            f"{log.source}: more than half of '{target}' is missing, filled or at a stop: use another log"
        )
    if cutoff is not None:
        given, made = low_pass(given, log.step, cutoff), low_pass(made, log.step, cutoff)
        notes.append(f"input and output filtered alike, cut-off {cutoff:g} Hz")
    n = prev_fast_len(len(log), real=True)
    held = source in log.held
    return Record(
        log.name, log.step, given[:n], made[:n], keep[:n], held, float(log.time[0]), (*log.warnings, *notes)
    )


def away_from_stops(spool: Array, known: Mapping[str, float], step: float) -> Mask:
    """Mask (n,): False where the spool (n,) [m] is at a stop, and until the motion after it has settled."""
    hit = (spool >= AT_STOP * known["dcv.x_max"]) | (spool <= AT_STOP * known["dcv.x_min"])
    width = max(1, round(SETTLING / step))
    recent = np.convolve(hit.astype(np.float64), np.ones(width))[: spool.size] > 0.5
    return ~recent
