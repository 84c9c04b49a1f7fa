"""The slew sensor against the external tracker: the tracker's clock, its seam, and the sensor's own errors.

A tracker stamp s stands for the instant offset + rate s of the log. There the tracker reads the true angle, plus a constant
below the seam at 12 deg where its first marker model is in use (Table 3.4); its zero and scale are trusted. Offset and rate
are estimated always and together with everything else: a clock error would otherwise pass for a delay.
"""

import itertools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.crossval import held_windows
from cosim.diagnosis.data import Record
from cosim.diagnosis.fit import Fit, Task, Unknown, fit
from cosim.diagnosis.groups import Group
from cosim.diagnosis.naming import CLOSE, SURE
from cosim.diagnosis.noise import learned, plain
from cosim.diagnosis.verdict import Cause
from cosim.errors import DataError
from cosim.logs import Tracker
from fmus import registry
from fmus.contract import Effect

Array = NDArray[np.float64]

SEAM_ANGLE = np.radians(12.0)  # Table 3.4
CLOCK = (2e-3, 1e-5)  # s and relative rate: a clock this good is synchronised
ERRORS = ("tracker.seam", "sensor.gain", "sensor.bias", "sensor.drift")
NOMINAL = {
    "tracker.offset": 0.0,
    "tracker.rate": 1.0,
    "tracker.seam": 0.0,
    "sensor.gain": 1.0,
    "sensor.bias": 0.0,
    "sensor.drift": 0.0,
}
SCALES = {
    "tracker.offset": 1e-2,
    "tracker.rate": 1e-4,
    "tracker.seam": 1e-3,
    "sensor.gain": 1e-2,
    "sensor.bias": 1e-3,
    "sensor.drift": 1e-5,
}
GROUP = Group("sensor", (), "slew", ("slew_external",))


@dataclass
class TrackerFinding:
    """What the tracker says.

    Attributes:
        fit: offset, rate and the accepted errors.
        causes: named causes.
        time: (m,) instants of the log at which the tracker reads, s.
        measured, predicted: (m,) rad.
        noise: size of the noise of one reading, rad.
    """

    fit: Fit
    causes: list[Cause]
    time: Array = field(repr=False)
    measured: Array = field(repr=False)
    predicted: Array = field(repr=False)
    noise: float


class TrackerModel:
    """Tracker readings predicted from the slew sensor, for `fit`."""

    group = GROUP

    def __init__(self, record: Record, stamps: Array) -> None:
        self.time = record.time
        self.slew = record.smooth("slew", 10.0)
        self.stamps = stamps

    def nominal(self, name: str) -> float:
        """Value where nothing is wrong."""
        return NOMINAL[name]

    def simulate(self, values: dict[str, float]) -> dict[str, Array]:
        """(m,) readings, rad."""
        v = NOMINAL | values
        t = v["tracker.offset"] + v["tracker.rate"] * self.stamps
        angle = (np.interp(t, self.time, self.slew) - v["sensor.bias"] - v["sensor.drift"] * t) / v[
            "sensor.gain"
        ]
        return {"slew_external": angle + v["tracker.seam"] * (angle < SEAM_ANGLE)}


def first_offset(record: Record, stamps: Array, readings: Array) -> float:
    """Offset, s, that lays the tracker's record over the log best, to 20 ms; rate one.

    Raises:
        DataError: the two records do not overlap enough, or neither moves.
    """
    time, slew = record.time, record.smooth("slew", 10.0)
    thin = max(1, round(0.1 / float(np.median(np.diff(stamps)))))
    s, y = stamps[::thin], readings[::thin]
    span = s[-1] - s[0]
    shortest = 0.5 * min(span, time[-1])
    offsets = np.arange(-s[0] - span + shortest, time[-1] - s[0] - shortest, 0.02)
    best = (np.inf, 0.0)
    for offset in offsets:
        t = s + offset
        inside = (t >= 0.0) & (t <= time[-1])
        if inside.sum() < 10:
            continue
        error = y[inside] - np.interp(t[inside], time, slew)
        best = min(best, (float(np.var(error)), float(offset)))
    if not np.isfinite(best[0]) or np.ptp(slew) < 1e-4:
        raise DataError(
            "the tracker's record cannot be laid over the log: they do not overlap, or the slew does not move"
        )
    return best[1]


def compare_tracker(record: Record, tracker: Tracker) -> TrackerFinding:
    """Find clock, seam and sensor errors from a log and a tracker's record.

    Raises:
        DataError: the log has no slew angle, or the two records cannot be laid over each other.
    """
    if "slew" not in record.signals:
        raise DataError("the tracker can only be compared with a measured slew angle, which this log lacks")
    offset = first_offset(record, tracker.time, tracker.slew_external)
    t = tracker.time + offset
    use = (t > 0.05) & (t < record.time[-1] - 0.05) & tracker.valid
    stamps, readings = tracker.time[use], tracker.slew_external[use]
    model = TrackerModel(record, stamps)
    window = max(20, min(400, stamps.size // 6))
    task = Task(model, {"slew_external": readings}, {"slew_external": plain(1, window, False)})  # type: ignore[arg-type]
    clock = [
        Unknown("tracker.offset", offset, SCALES["tracker.offset"], offset - 1.0, offset + 1.0),
        Unknown("tracker.rate", 1.0, SCALES["tracker.rate"], 0.9, 1.1),
    ]
    everything = fit(task, [*clock, *(unknown(n) for n in ERRORS)], rounds=30)
    angle = model.simulate(everything.values)["slew_external"]
    absorbed = np.stack(
        [np.ones_like(angle), stamps, angle, (angle < SEAM_ANGLE).astype(float), np.gradient(angle)]
    )
    task.set_rules(
        {
            "slew_external": learned(
                task.rules["slew_external"], everything.residuals["slew_external"], absorbed
            )
        }
    )
    fits = {}
    for size in range(len(ERRORS) + 1):
        for chosen in itertools.combinations(ERRORS, size):
            fits[chosen] = fit(task, [*clock, *(unknown(n) for n in chosen)], rounds=20)
    each = SURE + 0.5 * float(np.log(everything.count))
    best = max(fits, key=lambda c: fits[c].log_likelihood - each * len(c))
    found = fits[best]
    predicted = model.simulate(found.values)["slew_external"]
    instants = found.values["tracker.offset"] + found.values["tracker.rate"] * stamps
    causes = [named(name, best, fits, task, clock) for name in best] + clock_cause(found, fits[()], task)
    return TrackerFinding(found, causes, instants, readings, predicted, task.rules["slew_external"].rms)


def unknown(name: str) -> Unknown:
    """One of the errors, to be estimated."""
    reach = 1e4 * SCALES[name]
    low = 0.2 if name == "sensor.gain" else NOMINAL[name] - reach
    return Unknown(name, NOMINAL[name], SCALES[name], low, NOMINAL[name] + reach)


def effect_of(name: str) -> Effect:
    """The effect of the library that a parameter belongs to."""
    known = registry.effects()
    return known[name] if name in known else known["tracker.clock"]


def named(
    name: str, best: tuple[str, ...], fits: dict[tuple[str, ...], Fit], task: Task, clock: list[Unknown]
) -> Cause:
    """One accepted error as a cause, with the others as rivals."""
    found = fits[best]
    without = tuple(n for n in best if n != name)
    rivals = []
    for other in ERRORS:
        if other not in best:
            swapped = tuple(n for n in ERRORS if n in (*without, other))
            rivals.append((effect_of(other), found.log_likelihood - fits[swapped].log_likelihood))
    rivals.sort(key=lambda item: item[1])
    effect = effect_of(name)
    return Cause(
        effect,
        "sensor",
        {name.partition(".")[2]: (found.values[name], found.deviations[name])},
        found.log_likelihood - fits[without].log_likelihood,
        held_out(task, clock, best, without),
        rivals,
        [e.name for e, behind in rivals if behind < CLOSE],
    )


def clock_cause(found: Fit, null: Fit, task: Task) -> list[Cause]:
    """The tracker's clock as a cause, where it is measurably off."""
    offset, rate = found.values["tracker.offset"], found.values["tracker.rate"]
    spread = (found.deviations["tracker.offset"], found.deviations["tracker.rate"])
    off = abs(offset) > max(CLOCK[0], 4.0 * spread[0]) or abs(rate - 1.0) > max(CLOCK[1], 4.0 * spread[1])
    if not off:
        return []
    errors = {n: v for n, v in found.values.items() if n in ERRORS}
    synchronised = task.white(task.residuals(errors))
    gain = found.log_likelihood + 0.5 * float(synchronised @ synchronised)
    parameters = {"offset": (offset, spread[0]), "rate": (rate, spread[1])}
    return [Cause(effect_of("tracker.clock"), "tracker", parameters, gain, float("nan"))]


def held_out(task: Task, clock: list[Unknown], best: tuple[str, ...], without: tuple[str, ...]) -> float:
    """Log-likelihood that an error gains on held-out windows."""
    rows = task.rules["slew_external"].windows(task.measured["slew_external"]).shape[0]
    held = held_windows(rows)
    if not held.any() or held.all():
        return float("nan")
    scores = []
    for names in (best, without):
        fitting = Task(task.model, task.measured, task.rules, mask=~held)
        values = fit(fitting, [*clock, *(unknown(n) for n in names)], rounds=20).values
        judged = Task(task.model, task.measured, task.rules, mask=held)
        white = judged.white(judged.residuals(values))
        scores.append(-0.5 * float(white @ white))
    return scores[0] - scores[1]
