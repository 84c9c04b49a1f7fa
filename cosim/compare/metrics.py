"""How far a simulated signal is from a measured one, and how far the measurement's own noise reaches."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WINDOW = 5.0  # s, over which an integrating signal is judged with a free offset
NOISE_WINDOW = 0.5  # s, in which a signal's motion passes for a cubic
NOISE_SAMPLES = 16  # at least this many samples in such a window
NOISE_WINDOWS = 10  # of a log at least, where its samples allow it: one of ten is a quietest tenth
FEWEST = 6  # samples that leave a cubic two degrees of freedom
RUNG = math.sqrt(2.0)  # from one length of such windows to the next
SURE = 2.0  # standard errors by which a spread must grow too fast
SATURATED = (
    4  # rungs below the longest window at which noise that was filtered before it was sampled is as large
)
FLAT = 1.2  # growth of a variance over these rungs that is none
STILL = 0.1  # of the spread of the whole signal: more than that within a window is its motion
QUIET = 4.0  # standard errors of a window's spread above that of the quietest tenth: noise alone, no motion
STAND_OUT = 1.5  # a signal whose spread is below this many times its noise is constant


@dataclass(frozen=True)
class Score:
    """A signal's error, measured minus simulated; numbers in the signal's unit.

    Attributes:
        rmse: root mean square error, a constant offset removed where `offset` is given.
        fit_percent: ``100 (1 - |y - yhat| / |y - mean(y)|)`` (MATLAB's NRMSE fit) of the same error; None for a
            constant measurement.
        max_error: largest absolute error, at `max_time` [s].
        noise_floor: standard deviation of the measurement's noise, see `noise_floor`.
        rmse_windows: root mean square error with a free offset in every window of `WINDOW`; None where not asked for.
        offset: constant that was removed; None where none was.
        constant: the measurement does not stand out from its noise, so the fit says nothing.
        samples: number of measured samples compared.
    """

    rmse: float
    fit_percent: float | None
    max_error: float
    max_time: float
    noise_floor: float
    rmse_windows: float | None
    offset: float | None
    constant: bool
    samples: int

    @property
    def ratio(self) -> float | None:
        """Error in units of the noise: of the windows where they are asked for; None without noise."""
        error = self.rmse if self.rmse_windows is None else self.rmse_windows
        return error / self.noise_floor if self.noise_floor > 0.0 else None


def rms(values: Array) -> float:
    """Root mean square of values (n,), n >= 1."""
    return math.sqrt(float(np.mean(np.square(values))))


def fit_percent(measured: Array, simulated: Array) -> float | None:
    """``100 (1 - |y - yhat| / |y - mean(y)|)`` with Euclidean norms, for (n,) each (SYSTEM section 8).

    None where y is constant.
    """
    spread = float(np.linalg.norm(measured - measured.mean()))
    if spread == 0.0:
        return None
    return 100.0 * (1.0 - float(np.linalg.norm(measured - simulated)) / spread)


def score(
    measured: Array,
    simulated: Array,
    time: Array,
    valid: Mask,
    floor: float,
    *,
    drifts: bool,
    free_offset: bool,
) -> Score:
    """Compare two signals.

    Args:
        measured: (n,).
        simulated: (n,) in the same unit.
        time: (n,) [s], uniform.
        valid: (n,) False where the measurement was filled in.
        floor: noise of the measurement.
        drifts: also judge it in windows, each with a free offset.
        free_offset: remove a constant offset from the whole.
    """
    y, error, stamps = measured, measured - simulated, time
    if not valid.all():
        y, error, stamps = y[valid], error[valid], stamps[valid]
    offset = float(error.mean()) if free_offset else None
    if offset is not None:
        error = error - offset
    worst = int(np.argmax(np.abs(error)))
    return Score(
        rmse=rms(error),
        fit_percent=fit_percent(y, y - error),
        max_error=float(abs(error[worst])),
        max_time=float(stamps[worst]),
        noise_floor=floor,
        rmse_windows=rms(without_offsets(error, stamps)) if drifts else None,
        offset=offset,
        constant=bool(np.std(y) <= STAND_OUT * floor),
        samples=len(y),
    )


def without_offsets(error: Array, time: Array, window: float = WINDOW) -> Array:
    """An error (n,) less its mean in each of the equal windows of about `window` s; `time` (n,) [s]."""
    count = max(1, round(float(time[-1] - time[0]) / window))
    return np.concatenate([part - part.mean() for part in np.array_split(error, min(count, len(error)))])


def noise_floor(values: Array, step: float, cuts: Sequence[int] = ()) -> float:
    """Standard deviation of the noise of a measured signal (n,), in its unit.

    Spread about a cubic in windows of `NOISE_WINDOW` (a tenth of a log that is short), taken where the signal is quietest,
    and at least the spread that rounding to its resolution causes. Noise slower than a window is not counted. A motion that
    is no cubic within so long a window gives itself away: with the window its spread grows faster than that of any noise
    (`without_motion`).

    Args:
        values: as measured, one every `step` s.
        step: [s].
        cuts: first sample of each log but the first, where several are behind one another.
    """
    rounding = resolution(values, cuts) / math.sqrt(12.0)
    values, every = fresh(values)
    size = max(min(round(NOISE_WINDOW / (every * step)), len(values) // NOISE_WINDOWS), NOISE_SAMPLES)
    if len(values) < size:
        return rounding
    rows = values[: len(values) // size * size].reshape(-1, size)
    variance, freedom = about_cubics(rows, size)
    spread = np.sqrt(variance)
    limit = np.quantile(spread, 0.1, method="higher") * (1.0 + QUIET / math.sqrt(2.0 * freedom))
    noise = without_motion(rows[spread <= limit], float(np.var(values)), rounding**2)
    return max(math.sqrt(noise), rounding)


def without_motion(quiet: Array, whole: float, rounding: float) -> float:
    """Variance of the noise in the quietest windows (m, size) of a signal.

    Shorter and shorter windows are tried, down to one that leaves a cubic two degrees of freedom. White noise has one spread
    in all of them, and that of correlated noise grows no faster than the window, whatever its time. A motion with a kink
    grows with the third power of the window, a smooth one faster. The longest windows count up to which nothing grows so.
    Noise that was filtered before it was sampled grows so, too, but comes to an end of it: what is no larger in windows four
    times as long, and a small part of the signal, is no motion.

    Args:
        quiet: readings.
        whole: variance of the signal.
        rounding: variance that rounding causes.
    """
    sizes = [quiet.shape[1]]
    while sizes[-1] / RUNG >= FEWEST:
        sizes.append(int(sizes[-1] / RUNG))
    spreads = [about_cubics(quiet, size) for size in sizes]
    found = [float(np.mean(variance)) for variance, _ in spreads]
    free = [freedom * len(quiet) for _, freedom in spreads]
    chance = [1.0 + SURE * math.sqrt(2.0 / a + 2.0 / b) for a, b in pairwise(free)]
    if len(found) > SATURATED:
        ends = found[0] <= FLAT * chance[0] * found[SATURATED]
        if ends and found[0] <= STILL**2 * whole:
            return found[0]
    noise = found[-1]
    for rung in range(len(found) - 2, -1, -1):
        if found[rung] > max(noise, rounding) * sizes[rung] / sizes[rung + 1] * chance[rung]:
            break
        noise = found[rung]
    return noise


def about_cubics(rows: Array, size: int) -> tuple[Array, int]:
    """(m,) variance of windows (m, n) about a cubic in each stretch of `size` samples, and its degrees of freedom."""
    count = rows.shape[1] // size
    parts = rows[:, : count * size].reshape(-1, size)
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), 4))
    rest = parts - (parts @ basis) @ basis.T
    freedom = count * (size - basis.shape[1])
    return np.sum(np.square(rest).reshape(len(rows), -1), axis=1) / freedom, freedom


def fresh(values: Array) -> tuple[Array, float]:
    """Of a signal whose readings are repeated between new ones the new ones, and how many samples each stands for.

    A reading that stays within one step of its resolution is no repeated one.
    """
    changed = np.flatnonzero(np.diff(values)) + 1
    if len(changed) < NOISE_SAMPLES:
        return values, 1.0
    every = float(np.median(np.diff(changed)))
    change = float(np.median(np.abs(values[changed] - values[changed - 1])))
    if every < 2.0 or change < 1.5 * resolution(values):
        return values, 1.0
    return values[changed], every


def white_noise(values: Array) -> float:
    """Standard deviation of what is independent from sample to sample in a signal (n,); 0 where most samples repeat.

    Fourth differences leave nothing of a smooth motion and 70 times the variance of noise; the median leaves jumps out.
    """
    if values.size < 20:
        return 0.0
    return float(np.median(np.abs(np.diff(values, 4)))) / (0.6745 * np.sqrt(70.0))


def resolution(values: Array, cuts: Sequence[int] = ()) -> float:
    """Smallest difference between two values of a signal, larger than rounding of the numbers themselves.

    Of several logs behind one another (`cuts`: first sample of each but the first) that within one: logs that were zeroed
    each by itself have the same steps, and not the same levels.
    """
    if len(cuts):
        each = [resolution(part) for part in np.split(values, list(cuts))]
        return min((step for step in each if step > 0.0), default=0.0)
    levels = np.diff(np.unique(values))
    levels = levels[levels > 1e-9 * max(float(np.ptp(values)), float(np.abs(values).max()) * 1e-3)]
    return float(levels.min()) if len(levels) else 0.0
