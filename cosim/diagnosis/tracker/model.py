"""Readings of the tracker predicted from the slew sensor, and the least-squares fit of what is between the two."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import csd, periodogram

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.thresholds import TRACKER_CUTOFF, TRACKER_LOWEST_CUTOFF
from cosim.inference.noise import Noise, quietest
from cosim.inference.sight import sight
from cosim.inference.spectrum import bands, learn

Array = NDArray[np.float64]

SEAM_ANGLE = float(np.radians(12.0))  # Table 3.4
OFFSET, RATE, SEAM = "tracker.offset", "tracker.rate", "tracker.seam"
ERRORS = (SEAM, "sensor.gain", "sensor.bias", "sensor.drift")
NOMINAL = {OFFSET: 0.0, RATE: 1.0, SEAM: 0.0, "sensor.gain": 1.0, "sensor.bias": 0.0, "sensor.drift": 0.0}
SCALES = {
    OFFSET: 1e-2,
    RATE: 1e-4,
    SEAM: 1e-3,
    "sensor.gain": 1e-2,
    "sensor.bias": 1e-3,
    "sensor.drift": 1e-5,
}
REACH = {OFFSET: 2.0, RATE: 0.1, SEAM: 10.0, "sensor.gain": 0.8, "sensor.bias": 10.0, "sensor.drift": 0.1}


class TrackerModel:
    """Tracker readings predicted from the slew sensor.

    Args:
        record: the log.
        stamps: (m,) of the tracker's own clock, s.
        readings: (m,) rad.
        places: (m,) numbers of the readings on the tracker's uniform grid.
        cutoff: Hz; the slew is smoothed above.
    """

    def __init__(
        self,
        record: Record,
        stamps: Array,
        readings: Array,
        places: NDArray[np.int64],
        cutoff: float = TRACKER_CUTOFF,
    ) -> None:
        self.record = record
        self.time = record.time
        self.slew = record.smooth("slew", cutoff)
        self.speed = np.gradient(self.slew, record.h)
        self.stamps, self.readings, self.places = stamps, readings, places
        self.noise = Noise(1.0)
        self.mask = np.ones(stamps.size, dtype=bool)

    def only(self, kept: NDArray[np.bool_]) -> "TrackerModel":
        """The same for some of the readings."""
        fewer = copy(self)
        fewer.stamps, fewer.readings, fewer.places = self.stamps[kept], self.readings[kept], self.places[kept]
        fewer.mask = np.ones(fewer.stamps.size, dtype=bool)
        return fewer

    def shared(self, found: Fit, step: float) -> float:
        """Cut-off, Hz, of the smoothing that leaves the slew nearest to the motion.

        A lower one loses motion, and with a higher one the clock would be fitted to the sensor's noise. The cross spectrum
        of the speeds tells motion from noise, since the noises of sensor and tracker have nothing in common. `step` is that
        of the tracker's grid, s.
        """
        whole = np.arange(self.places[0], self.places[-1] + 1)
        seen = np.interp(self.instants(found.values), self.time, self.slew)
        pair = [np.gradient(np.interp(whole, self.places, row)) for row in (seen, self.readings)]
        frequency, power = periodogram(pair[0], fs=1.0 / step, window="hann")
        _, motion = csd(*pair, fs=1.0 / step, window="hann", nperseg=whole.size)
        cutoffs = np.geomspace(TRACKER_LOWEST_CUTOFF, TRACKER_CUTOFF, 60)
        response = 1.0 / (1.0 + (frequency / cutoffs[:, None]) ** 4)  # second order, forwards and backwards
        # mean square of motion minus smoothed reading, but for what no cut-off changes
        error = np.sum(response**2 * power - 2.0 * response * motion.real, axis=1)
        return float(cutoffs[int(np.argmin(error))])

    def smoothed(self, cutoff: float) -> "TrackerModel":
        """The same with the slew smoothed above another frequency, Hz."""
        other = TrackerModel(self.record, self.stamps, self.readings, self.places, cutoff)
        other.noise, other.mask = self.noise, self.mask
        return other

    def instants(self, values: Mapping[str, float]) -> Array:
        """(m,) instants of the log, s."""
        return values[OFFSET] + values[RATE] * self.stamps

    def predict(self, values: Mapping[str, float], names: Sequence[str] = ()) -> tuple[Array, Array]:
        """Readings (m,), rad, and their slopes (names, m)."""
        v = {**NOMINAL, **values}
        t = self.instants(v)
        angle = (np.interp(t, self.time, self.slew) - v["sensor.bias"] - v["sensor.drift"] * t) / v[
            "sensor.gain"
        ]
        below = (angle < SEAM_ANGLE).astype(np.float64)
        if not names:
            return angle + v[SEAM] * below, np.empty((0, t.size))
        speed = (np.interp(t, self.time, self.speed) - v["sensor.drift"]) / v["sensor.gain"]
        slopes = {
            OFFSET: speed,
            RATE: speed * self.stamps,
            SEAM: below,
            "sensor.gain": -angle / v["sensor.gain"],
            "sensor.bias": np.full(t.size, -1.0 / v["sensor.gain"]),
            "sensor.drift": -t / v["sensor.gain"],
        }
        return angle + v[SEAM] * below, np.array([slopes[n] for n in names]).reshape(len(names), t.size)

    def white(self, rows: Array) -> Array:
        """Rows (k, m) with the noise made independent and of unit size; only what `mask` leaves counts."""
        white = self.noise.whiten(rows, self.places)
        return white if self.mask.all() else white[:, self.mask]

    @property
    def log_scale(self) -> float:
        """Log-likelihood that readings cost by the size of their noise, those left out by `mask` too."""
        return 0.5 * self.noise.log_determinant(self.places)

    def fit(self, names: Sequence[str], start: Mapping[str, float], clock: bool = True) -> Fit:
        """Least squares over offset, rate and `names`, from `start` and from the seam alone: the better one.

        Where the motion is hardly longer than the seam is high, a wrong scale of the sensor is a local minimum of its own.

        Args:
            names: of the errors.
            start: where the search begins.
            clock: False takes offset and rate as nominal.
        """
        if not clock:
            return self.fit_from(tuple(names), start)
        found = self.fit_from((OFFSET, RATE, *names), start)
        if SEAM not in names or len(names) == 1:
            return found
        near = {n: start[n] for n in (OFFSET, RATE) if n in start}
        alone = self.fit_from((OFFSET, RATE, SEAM), near)
        other = self.fit_from((OFFSET, RATE, *names), alone.values)
        return max(found, other, key=lambda one: one.log_likelihood)

    def fit_from(self, chosen: tuple[str, ...], start: Mapping[str, float]) -> Fit:
        """Least squares over the parameters chosen, from `start`; all others are nominal."""
        if not chosen:
            left = {"slew_external": self.readings - self.predict({})[0]}
            row = self.white(left["slew_external"][None, :])[0]
            none = np.empty((0, 0))
            likelihood = -0.5 * float(row @ row)
            return Fit({}, {}, likelihood, row.size, left, none, slopes=np.empty((row.size, 0)), rows=row)
        scales = np.array([SCALES[n] for n in chosen])
        centre = np.array([start.get(n, NOMINAL[n]) for n in chosen])
        reach = np.array([REACH[n] for n in chosen])

        def values(z: Array) -> dict[str, float]:
            return dict(zip(chosen, (centre + z * scales).tolist(), strict=True))

        def cost(z: Array) -> Array:
            return self.white((self.readings - self.predict(values(z))[0])[None, :])[0]

        def slopes(z: Array) -> Array:
            _, rows = self.predict(values(z), chosen)
            return -(self.white(rows) * scales[:, None]).T

        ends = reach / scales
        done = least_squares(
            cost, np.zeros(scales.size), slopes, bounds=(-ends, ends), x_scale="jac", xtol=1e-10
        )
        norms = np.linalg.norm(done.jac, axis=0)
        norms = np.maximum(
            norms, 1e-9 * max(float(norms.max()), 1e-300)
        )  # what nothing shows is all but unknown
        unit = done.jac / norms
        scaled = scales / norms
        covariance = np.linalg.pinv(unit.T @ unit, rcond=1e-12, hermitian=True) * np.outer(scaled, scaled)
        # what two errors only show together (bias and seam, where the motion does not cross it) has no deviation of its own
        own = sight(unit, np.empty((unit.shape[0], 0))).own * scaled
        deviations = dict(zip(chosen, own.tolist(), strict=True))
        found = values(done.x)
        residuals = {"slew_external": self.readings - self.predict(found)[0]}
        return Fit(
            found,
            deviations,
            -float(done.cost),
            done.fun.size,
            residuals,
            covariance,
            slopes=done.jac,
            rows=done.fun,
            scales=dict(zip(chosen, scales.tolist(), strict=True)),
        )

    def learn(self, found: Fit) -> None:
        """Take over the noise that a fit leaves."""
        _, slopes = self.predict(found.values, list(found.values))
        size = np.maximum(np.linalg.norm(slopes, axis=1), 1e-300)[:, None]
        whole = np.arange(self.places[0], self.places[-1] + 1)
        even = [
            np.interp(whole, self.places, row) for row in (found.residuals["slew_external"], *(slopes / size))
        ]
        one = bands(even[0], np.stack(even[1:]), quietest(self.readings))
        noise = learn({"slew_external": one}, np.zeros((len(slopes),) * 2))["slew_external"]
        self.noise = extrapolated(noise, whole.size, len(slopes))


def extrapolated(noise: Noise, count: int, unknowns: int) -> Noise:
    """Noise slower than a record can tell is taken to go on as that just fast enough: as 1/f, which sensors have.

    A record has few frequencies at which slow noise shows, and what is estimated takes as many of them up. Held to be
    none, such noise would pass for a drift together with a wrong scale.

    Args:
        noise: as learned.
        count: samples of the record.
        unknowns: estimates that the fit has made: a kind of noise is told from fewer frequencies below its corner by none.
    """
    told = [k for k, tau in enumerate(noise.times) if count / (2.0 * np.pi * tau) >= unknowns]
    if not told:
        return noise
    least = noise.sizes[told[-1]]
    sizes = tuple(s if k in told else max(s, least) for k, s in enumerate(noise.sizes))
    return replace(noise, sizes=sizes)
