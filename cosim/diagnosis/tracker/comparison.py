"""The slew sensor against the external tracker: the tracker's clock, its seam, and the sensor's own errors.

A tracker stamp s stands for the instant offset + rate s of the log. There the tracker reads the true angle, plus a constant
below the seam at 12 deg where its first marker model is in use (Table 3.4); its zero and scale are trusted. Offset and rate
are estimated always and together with everything else: a clock error would otherwise pass for a delay.

The estimate is a least-squares one with the noise of the difference made white, so its covariance is the inverse of Fisher's
information: the Cramer-Rao bound for the noise found.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import median_abs_deviation
from threadpoolctl import threadpool_limits

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.record.signatures import coarse_step, grid_step
from cosim.diagnosis.thresholds import (
    CHI_SQUARE_95,
    CLOCK_SURE,
    CLOCK_TRUST,
    INDISTINGUISHABLE,
    NAMING_GAIN,
    NEAR_SEAM,
    TRACKER_CUTOFF,
    TRACKER_EDGE,
    TRACKER_WINDOWS,
)
from cosim.diagnosis.tracker.alignment import first_offsets
from cosim.diagnosis.tracker.model import ERRORS, OFFSET, RATE, SEAM, SEAM_ANGLE, TrackerModel
from cosim.diagnosis.verdict.verdict import Cause
from cosim.errors import DataError
from cosim.inference.held_out import HeldOutGain, gain_between, left_out
from cosim.logs import Tracker
from fmus import registry
from fmus.contract import Effect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrackerFinding:
    """What the tracker says.

    Attributes:
        fit: offset, rate and the accepted errors.
        causes: named causes.
        time: (m,) instants of the log at which the tracker reads, s.
        measured, predicted: (m,) rad.
        noise: size of the noise of one reading, rad.
        seam_angle: (angle at which the seam fits best, lower and upper end of its 95 % interval), rad; None without a seam.
        everything: fit of offset, rate and all errors, accepted or not.
        never: errors that these records could not have shown even at a moderate size: a seam that the motion stays above.
        rounds: which way readings in steps are rounded, where that is not to the nearest step and explains an offset.
    """

    fit: Fit
    causes: list[Cause]
    time: Array = field(repr=False)
    measured: Array = field(repr=False)
    predicted: Array = field(repr=False)
    noise: float
    seam_angle: tuple[float, float, float] | None
    everything: Fit = field(repr=False)
    never: list[str] = field(default_factory=list)
    rounds: str = ""


def compare_tracker(
    record: Record, tracker: Tracker, lag: tuple[float, float] = (0.0, 0.0)
) -> TrackerFinding:
    """Find clock, seam and sensor errors from a log and a tracker's record.

    Args:
        record: the log.
        tracker: the tracker's record.
        lag: time constant of the slew sensor's lag and its standard deviation, s: a slow motion shows it as an offset of
            the clock, so it must be known from elsewhere.

    Raises:
        DataError: the log has no slew angle, or the two records cannot be laid over each other.
    """
    if "slew" not in record.signals:
        raise DataError("the tracker can only be compared with a measured slew angle, which this log lacks")
    readings = record.signals["slew"]
    quick = record.fresh("slew") + lag[0] * record.rate("slew", TRACKER_CUTOFF)
    record = replace(record, signals=record.signals | {"slew": quick})
    with threadpool_limits(1):  # small matrices: more threads only wait for one another
        model, fits, best = explained(record, tracker)
        rounds, count = "", fits[best].count
        # a converter that cuts off reads half a step too little on average, and would pass for an error or for slow noise
        for way, less in cut_off(readings).items() if best or coarse_step(readings) else ():
            whole = replace(record, signals=record.signals | {"slew": record.signals["slew"] + less})
            other = explained(whole, tracker)
            if beside_noise(*other) > beside_noise(model, fits, best) + 1.0 / count:
                (model, fits, best), rounds = other, way
    everything = fits[ERRORS]
    each = price(everything)
    found = fits[best]
    found.deviations[OFFSET] = float(np.hypot(found.deviations[OFFSET], lag[1]))
    predicted, _ = model.predict(found.values)
    causes = [named(name, best, fits, model) for name in best] + clock_cause(found, model)
    angle = seam_angle(model, found) if SEAM in best else None
    moderate = {name: effect_of(name).free[name.partition(".")[2]].scale for name in ERRORS}
    spread = {name: fits[(name,)].deviations[name] for name in ERRORS}
    never = [n for n, size in moderate.items() if n not in best and 0.5 * size**2 < each * spread[n] ** 2]
    return TrackerFinding(
        found,
        causes,
        model.instants(found.values),
        model.readings,
        predicted,
        model.noise.rms,
        angle,
        everything,
        never,
        rounds,
    )


def explained(
    record: Record, tracker: Tracker
) -> tuple[TrackerModel, dict[tuple[str, ...], Fit], tuple[str, ...]]:
    """The model of the noise found, its fits with each set of errors, and the set to be believed."""
    model, everything = off_the_seam(*synchronised(record, tracker))
    for _ in range(2):
        model.learn(everything)
        everything = model.fit(ERRORS, everything.values)
    fits = {
        chosen: model.fit(chosen, everything.values)
        for size in range(len(ERRORS) + 1)
        for chosen in itertools.combinations(ERRORS, size)
    }
    return model, fits, borne_out(fits, max(fits, key=lambda chosen: believed(fits, chosen)))


def borne_out(fits: Mapping[tuple[str, ...], Fit], chosen: tuple[str, ...]) -> tuple[str, ...]:
    """A set of errors without those whose gain on left-out windows may be nothing, the worst first."""
    while chosen:
        gains = {name: held_out(fits[chosen], fits[beside(chosen, name)]) for name in chosen}
        worst = min(chosen, key=lambda name: gains[name].ci95[0])
        if gains[worst].sure:
            break
        chosen = beside(chosen, worst)
    return chosen


def beside(chosen: tuple[str, ...], name: str) -> tuple[str, ...]:
    """The others of a set of errors."""
    return tuple(n for n in chosen if n != name)


def price(everything: Fit) -> float:
    """Log-likelihood that each error must gain."""
    return NAMING_GAIN + 0.5 * float(np.log(everything.count))


def believed(fits: Mapping[tuple[str, ...], Fit], chosen: tuple[str, ...]) -> float:
    """Log-likelihood of a set of errors less their price."""
    return fits[chosen].log_likelihood - price(fits[ERRORS]) * len(chosen)


def beside_noise(model: TrackerModel, fits: Mapping[tuple[str, ...], Fit], chosen: tuple[str, ...]) -> float:
    """The same of a reading, where the noise was learned with it: what is taken for larger noise explains less."""
    return (believed(fits, chosen) - model.log_scale) / fits[chosen].count


def cut_off(readings: Array) -> dict[str, Array]:
    """How a converter may round other than to the nearest step -> (n,) what readings (n,) lack on average, rad."""
    half = 0.5 * grid_step(readings)
    if half == 0.0:
        return {}
    down = np.full(readings.size, half)
    ways = {"down": down, "up": -down}
    inward = half * np.sign(readings)
    # an angle that keeps its sign tells towards zero from neither
    return (
        ways if any(np.array_equal(inward, way) for way in ways.values()) else ways | {"towards zero": inward}
    )


def synchronised(record: Record, tracker: Tracker) -> tuple[TrackerModel, Fit]:
    """The model over the overlap of both records, with white noise, and its fit of everything.

    Raises:
        DataError: the two records cannot be laid over each other.
    """
    valid = tracker.valid
    slew = record.smooth("slew", TRACKER_CUTOFF)
    best: tuple[float, TrackerModel, Fit] | None = None
    for offset, rate in first_offsets(record.time, slew, tracker.time[valid], tracker.slew_external[valid]):
        t = offset + rate * tracker.time
        use = (t > TRACKER_EDGE) & (t < record.time[-1] - TRACKER_EDGE) & valid
        places = np.rint((tracker.time[use] - tracker.time[use][0]) / tracker.step).astype(np.int64)
        model = TrackerModel(record, tracker.time[use], tracker.slew_external[use], places)
        found = model.fit(ERRORS, {OFFSET: offset, RATE: rate})
        spread = -2.0 * found.log_likelihood / found.count
        if best is None or spread < best[0]:
            best = spread, model, found
    assert best is not None
    _, model, found = best
    model = model.smoothed(model.shared(found, tracker.step))
    return model, model.fit(ERRORS, found.values)


def off_the_seam(model: TrackerModel, found: Fit) -> tuple[TrackerModel, Fit]:
    """The model without readings so near the seam that noise may put them on its wrong side, and its fit.

    One such reading would count with the whole height of the seam.
    """
    angle, _ = model.predict({**found.values, SEAM: 0.0})
    # of the many: the few that noise has put on the wrong side are off by the whole seam
    noise = float(median_abs_deviation(found.residuals["slew_external"], scale="normal"))
    distance = np.abs(angle - SEAM_ANGLE)
    kept = distance >= min(NEAR_SEAM * noise, float(np.median(distance)))  # half of them at least
    if kept.all():
        return model, found
    fewer = model.only(kept)
    return fewer, fewer.fit(ERRORS, found.values)


def seam_angle(model: TrackerModel, found: Fit) -> tuple[float, float, float]:
    """Angle at which a seam fits best, with its 95 % interval by the likelihood ratio, all else estimated anew."""
    values = {**found.values, SEAM: 0.0}
    others = [n for n in found.values if n != SEAM]
    angle, slopes = model.predict(values, others)
    grid = np.quantile(angle, np.linspace(0.02, 0.98, 97))
    grid = np.unique(np.concatenate([grid, SEAM_ANGLE + np.radians(np.arange(-1.0, 1.01, 0.02))]))
    grid = grid[(grid > angle.min()) & (grid < angle.max())]
    steps = (angle[None, :] < grid[:, None]).astype(np.float64)
    white = model.white(np.vstack([model.readings - angle, slopes, steps]))
    basis, _ = np.linalg.qr(white[1 : 1 + len(others)].T)
    rest = white - (white @ basis) @ basis.T
    residual, columns = rest[0], rest[1 + len(others) :]
    gain = (columns @ residual) ** 2 / np.maximum(np.sum(columns**2, axis=1), 1e-300)
    inside = grid[gain > gain.max() - CHI_SQUARE_95]
    return float(grid[int(np.argmax(gain))]), float(inside.min()), float(inside.max())


def effect_of(name: str) -> Effect:
    """The effect of the library that a parameter belongs to."""
    known = registry.effects()
    return known[name] if name in known else known["tracker.clock"]


def named(name: str, best: tuple[str, ...], fits: dict[tuple[str, ...], Fit], model: TrackerModel) -> Cause:
    """One accepted error as a cause, with the others as rivals."""
    found = fits[best]
    without = beside(best, name)
    rivals = []
    for other in ERRORS:
        if other not in best:
            swapped = tuple(n for n in ERRORS if n in (*without, other))
            rivals.append((effect_of(other), found.log_likelihood - fits[swapped].log_likelihood))
    rivals.sort(key=lambda item: item[1])
    return Cause(
        effect_of(name),
        "sensor",
        {name.partition(".")[2]: (found.values[name], found.deviations[name])},
        found.log_likelihood - fits[without].log_likelihood,
        held_out(found, fits[without]),
        rivals,
        [e.name for e, behind in rivals if behind < INDISTINGUISHABLE],
    )


def clock_cause(found: Fit, model: TrackerModel) -> list[Cause]:
    """The tracker's clock as a cause, where it is measurably off."""
    offset, rate = found.values[OFFSET], found.values[RATE]
    spread = (found.deviations[OFFSET], found.deviations[RATE])
    if not (
        abs(offset) > max(CLOCK_TRUST[0], CLOCK_SURE * spread[0])
        or abs(rate - 1.0) > max(CLOCK_TRUST[1], CLOCK_SURE * spread[1])
    ):
        return []
    synchronous = model.fit([n for n in found.values if n in ERRORS], found.values, clock=False)
    gain = found.log_likelihood - synchronous.log_likelihood
    held = held_out(found, synchronous)
    if gain < NAMING_GAIN + float(np.log(found.count)) or not held.sure:  # BIC's price of two parameters
        return []
    parameters = {"offset": (offset, spread[0]), "rate": (rate, spread[1])}
    return [Cause(effect_of("tracker.clock"), "tracker", parameters, gain, held)]


def held_out(richer: Fit, poorer: Fit) -> HeldOutGain:
    """What one fit gains over another on windows of the record that had no share in either."""
    block = np.arange(richer.count) * TRACKER_WINDOWS // richer.count
    return gain_between(alone(richer, block), alone(poorer, block), block)


def alone(found: Fit, block: NDArray[np.int64]) -> Array:
    """(n,) whitened residuals of each window with the estimate that the others give."""
    assert found.rows is not None
    assert found.slopes is not None
    return left_out(found.rows, found.slopes, block)
