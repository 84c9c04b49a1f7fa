"""Frequency responses from logs, each point with its uncertainty.

`stepped`: one period of a sine at a time, as the source does: offset and sine by least squares (4.12). `welch`: any
excitation, by averaged spectra; the uncertainty follows from the coherence (Bendat and Piersol, Random Data, 2010,
section 9.1). A held input is corrected for its hold, so that both give the response of the continuous block.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import coherence, csd, savgol_filter, welch

from cosim.errors import DataError, UsageError
from cosim.identify.data import Record
from cosim.identify.spectrum import effective_samples

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LEAST_AMPLITUDE = 0.02  # of full command: less is no experiment
SINE = 0.02  # of the amplitude: what a period may miss a sine by
SAMPLES = 16  # a period must have
SAME = 2e-3  # relative difference of two frequencies that are one
LOWEST_BIN = 2  # of a segment's spectrum: below, window and trend take their share
POWER = 1e-2  # of the strongest line: an input line below it is no excitation


@dataclass(frozen=True)
class Frf:
    """A frequency response.

    Attributes:
        frequency: (m,) [rad/s], rising.
        response: (m,) complex, output over input in SI.
        deviation: (m,) standard deviation of its real and of its imaginary part.
        coherence: (m,), or None where each point is one period.
        amplitudes: of a stepped sine: amplitude -> its own response, NaN where not measured.
        method: ``stepped sine`` or ``welch``.
    """

    frequency: Array
    response: Complex
    deviation: Array
    coherence: Array | None
    amplitudes: dict[float, Complex]
    method: str

    @property
    def magnitude(self) -> Array:
        """[dB], of SI units."""
        return np.asarray(20.0 * np.log10(np.abs(self.response)))

    @property
    def phase(self) -> Array:
        """[deg], without jumps."""
        return np.asarray(np.rad2deg(np.unwrap(np.angle(self.response))))

    def smoothed(self, order: int = 11, window: int = 25) -> "Frf":
        """Magnitude and phase behind a Savitzky-Golay filter over the points; the source's has the order 11.

        Raises:
            UsageError: too few points for the window, or the window too short for the order.
        """
        if not order < window <= self.frequency.size:
            raise UsageError(
                f"smoothing of order {order} over {window} points does not fit {self.frequency.size} points:"
                " the window must be longer than the order and at most as long as the response"
            )
        level, turn = (
            savgol_filter(part, window, order) for part in (self.magnitude, np.deg2rad(self.phase))
        )
        return replace(self, response=10.0 ** (level / 20.0) * np.exp(1j * turn))

    def band(self, low: float, high: float) -> "Frf":
        """The points between two frequencies [rad/s].

        Raises:
            DataError: there are fewer than three.
        """
        inside = (self.frequency >= low) & (self.frequency <= high)
        if np.count_nonzero(inside) < 3:
            raise DataError(
                f"the log excites nothing, or too little, between {low:g} and {high:g} rad/s: ask for another band, or"
                " play an experiment that covers this one (`cosim identify experiment`)"
            )
        kept = {a: values[inside] for a, values in self.amplitudes.items()}
        seen = None if self.coherence is None else self.coherence[inside]
        return Frf(
            self.frequency[inside], self.response[inside], self.deviation[inside], seen, kept, self.method
        )


@dataclass(frozen=True)
class Period:
    """One period of a sine in a command: when it starts [s], its frequency [rad/s] and amplitude [1]."""

    start: float
    frequency: float
    amplitude: float


def sine_periods(u: Array, step: float) -> list[Period]:
    """The whole periods of sines in a command (n,), each from one rise through zero to the next."""
    rising = np.flatnonzero((u[:-1] <= 0.0) & (u[1:] > 0.0))
    found = []
    for i, first in enumerate(rising):
        below = np.flatnonzero(u[first + 1 : rising[i + 1] + 1 if i + 1 < rising.size else None] < 0.0)
        if not below.size:
            continue
        last = first + 1 + int(below[-1])
        period = _period(u[first + 1 : last + 1], step)
        if period is not None:
            found.append(replace(period, start=period.start + (first + 1) * step))
    return found


def _period(values: Array, step: float) -> Period | None:
    """The sine that samples of one period follow, or None if they follow none; its start is from the first sample [s]."""
    size = 0.5 * float(np.ptp(values))
    if values.size < SAMPLES or size < LEAST_AMPLITUDE:
        return None
    time = np.arange(values.size) * step

    def missed(x: Array) -> Array:
        return x[0] * np.sin(x[1] * (time + x[2])) / size - values / size

    guess = np.array([size, 2.0 * np.pi / ((values.size + 0.5) * step), 0.5 * step])
    found = least_squares(missed, guess, x_scale=[size, guess[1], step])
    if np.sqrt(np.mean(found.fun**2)) > SINE or found.x[2] < -0.5 * step:
        return None
    return Period(-float(found.x[2]), float(found.x[1]), float(found.x[0]))


def _phasor(time: Array, values: Array, w: float) -> tuple[complex, Array]:
    """Amplitude and phase, as one complex number, of a sine with an offset by least squares, and the residual."""
    basis = np.column_stack([np.sin(w * time), np.cos(w * time), np.ones(time.size)])
    beta = np.linalg.lstsq(basis, values, rcond=None)[0]
    return complex(beta[0], beta[1]), values - basis @ beta


def hold(w: Array, step: float) -> Complex:
    """What holding a sampled sine over each step does to its first harmonic: (m,) for frequencies (m,) [rad/s]."""
    return np.asarray(np.sinc(w * step / (2.0 * np.pi)) * np.exp(-0.5j * w * step))


def stepped(
    records: Sequence[tuple[Record, Array]], method: Literal["least squares", "extremes"] = "least squares"
) -> Frf:
    """Frequency response from logs of stepped sines.

    Args:
        records: input and output with the command u (n,) that tells the periods.
        method: amplitude of the output by least squares, or by its extremes as (4.12) prints it; the phase is the same.

    Returns:
        The mean over the amplitudes, weighted by their uncertainty; the deviation also covers their scatter.

    Raises:
        DataError: there are fewer than three periods of a sine in the commands.
    """
    points: list[tuple[float, float, complex, float]] = []
    for item, u in records:
        time = np.arange(item.input.size) * item.step
        for period in sine_periods(u, item.step):
            length = 2.0 * np.pi / period.frequency
            part = slice(*np.searchsorted(time, [period.start - 1e-9, period.start + length - 1e-9]))
            if item.keep[part].mean() < 0.9:
                continue
            kept = item.keep[part]
            local, given, made = (
                time[part][kept] - period.start,
                item.input[part][kept],
                item.output[part][kept],
            )
            response, deviation = _point(np.asarray(local), given, made, period.frequency, method)
            factor = hold(np.array([period.frequency]), item.step)[0] if item.held else 1.0
            points.append((period.frequency, round(period.amplitude, 3), response / factor, deviation))
    if len(points) < 3:
        raise DataError(
            f"{records[0][0].name}: the command holds {len(points)} whole periods of a sine, at least 3 are needed: play"
            " `cosim identify experiment slew` or `dcv`, or take --method welch for another excitation"
        )
    return _merged(points)


def _point(time: Array, given: Array, made: Array, w: float, method: str) -> tuple[complex, float]:
    """Response and deviation from one period."""
    source, _ = _phasor(time, given, w)
    answer, rest = _phasor(time, made, w)
    if method == "extremes":
        answer *= 0.5 * float(np.ptp(made)) / abs(answer)
    # the variance of each of the two amplitudes is 2 s^2 / n for n independent samples
    worth = max(effective_samples(rest) - 3.0, 1.0)
    return answer / source, float(np.sqrt(2.0 * np.mean(rest**2) / worth)) / abs(source)


def _merged(points: list[tuple[float, float, complex, float]]) -> Frf:
    """Points of one frequency, at several amplitudes, as one."""
    points = sorted(points, key=lambda p: p[0])
    groups: list[list[tuple[float, float, complex, float]]] = []
    for point in points:
        if groups and point[0] <= groups[-1][0][0] * (1.0 + SAME):
            groups[-1].append(point)
        else:
            groups.append([point])
    sizes = sorted({p[1] for p in points}, reverse=True)
    single = {a: np.full(len(groups), np.nan + 0j) for a in sizes}
    response, deviation = np.empty(len(groups), dtype=complex), np.empty(len(groups))
    for k, group in enumerate(groups):
        values, errors = np.array([p[2] for p in group]), np.array([p[3] for p in group])
        weights = 1.0 / np.maximum(errors, 1e-3 * np.abs(values)) ** 2
        response[k] = np.sum(weights * values) / np.sum(weights)
        own = 1.0 / np.sqrt(np.sum(1.0 / np.maximum(errors, 1e-30) ** 2))
        scatter = np.sqrt(0.5 * np.mean(np.abs(values - response[k]) ** 2) / max(len(group) - 1, 1))
        deviation[k] = max(own, float(scatter))
        for point in group:
            single[point[1]][k] = point[2]
    return Frf(np.array([g[0][0] for g in groups]), response, deviation, None, single, "stepped sine")


def welch_frf(item: Record, *, segment: float | None = None, integrates: bool = False) -> Frf:
    """Frequency response by Welch's method (H1), Hann window, half overlapped.

    Args:
        item: input and output.
        segment: length of a segment [s]; an eighth of the log by default.
        integrates: the block has an integrator: its output is differenced first, or its drift would leak into every line.

    Raises:
        DataError: samples are missing, or no line is coherent.
        UsageError: the segment does not fit the log at least twice.
    """
    if not item.keep.all():
        raise DataError(
            f"{item.name}: {np.count_nonzero(~item.keep)} samples are missing, filled or at a stop, and spectra need all:"
            " choose a part of the log without them (--from, --to)"
        )
    length = round((segment or item.duration / 8.0) / item.step)
    if not 64 <= length <= item.input.size // 2:
        raise UsageError(
            f"a segment of {length * item.step:.3g} s does not fit a log of {item.duration:.3g} s at least twice with 64"
            " samples"
        )
    output = np.diff(item.output) / item.step if integrates else item.output
    given = item.input[: output.size]
    options = {"fs": 1.0 / item.step, "nperseg": length, "detrend": "linear"}
    f, cross = csd(given, output, **options)
    _, power = welch(given, **options)
    _, seen = coherence(given, output, **options)
    averages = _averages(output.size, length)
    w = 2.0 * np.pi * f
    strong = (
        (power > POWER * power[1:].max())
        & (f * length * item.step > LOWEST_BIN - 0.5)
        & (f < 0.4 / item.step)
    )
    strong &= seen > 1.0 - 0.05 ** (1.0 / max(averages - 1.0, 1.0))  # beyond what chance gives
    if np.count_nonzero(strong) < 3:
        raise DataError(
            f"{item.name}: input and output are not coherent at any frequency: the log has no excitation to learn from; play"
            " `cosim identify experiment slew` or `dcv`"
        )
    w, cross, power, seen = w[strong], cross[strong], power[strong], np.minimum(seen[strong], 1.0 - 1e-12)
    response = cross / power
    deviation = np.abs(response) * np.sqrt((1.0 - seen) / (2.0 * seen * averages))
    factor = hold(w, item.step) if item.held else np.ones(w.size)
    if integrates:  # the difference of the angle over a step, put back
        factor = factor * (np.exp(1j * w * item.step) - 1.0) / item.step
    return Frf(w, response / factor, deviation / np.abs(factor), seen, {}, "welch")


def _averages(count: int, length: int) -> float:
    """Independent segments to which the half-overlapping Hann ones amount (Welch, 1967)."""
    k = (count - length // 2) // (length - length // 2)
    return k / (1.0 + 2.0 * (k - 1.0) / k * (1.0 / 6.0) ** 2)
