"""The observer beside a log: its FMU fed with the measured command and slew, as on the real-time target.

Its estimates are held against the logged ones, and against the measured slew itself and its derivative: a polynomial
over a short window (Savitzky and Golay) that shifts nothing in time, which no observer can do.
"""

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from cosim.compare.comparator import Comparator
from cosim.compare.metrics import fit_percent, rms
from cosim.errors import DataError, UsageError
from cosim.master import Runner
from cosim.ssp.system import System

Array = NDArray[np.float64]
COMPONENT = "observer"
ANGLE, RATE = "slew_estimate", "slew_rate_estimate"
DERIVATIVE_WINDOW = 0.3  # s: follows some 3 Hz, and its noise is a tenth of a difference's over 50 ms
SETTLING = 2.0  # s at the start that do not count: the observer's error has died out (slowest pole 6.6 1/s)
LONGEST_LAG = 1.0  # s by which an estimate may trail what it estimates
REFERENCE = {ANGLE: "measured slew", RATE: "derivative of the measured slew"}


@dataclass(frozen=True)
class Trace:
    """One estimate of the FMU beside something else, SI.

    Attributes:
        estimate: name of the signal.
        against: what it is compared with.
        rmse, largest: of the estimate minus the other, behind the settling time.
        fit_percent: NRMSE fit of the estimate to the other; None where that is constant.
        lag: s by which the estimate trails the other; NaN where that is constant.
        floor: error of the other by itself, where it is known: that of the derivative from the sensor's noise.
    """

    estimate: str
    against: str
    rmse: float
    largest: float
    fit_percent: float | None
    lag: float
    floor: float | None


@dataclass(frozen=True)
class ObserverRun:
    """The observer FMU on a log.

    Attributes:
        traces: comparisons.
        real_time_factor: duration of the log over the time that the FMU's steps took.
        step_seconds: that time per step, s.
        step: communication step, s.
        time: (n,) s, as in the log.
        estimates: signal -> (n,) SI of the FMU.
        others: "logged", "measured" -> signal -> (n,) SI.
        notes: what the reader should know.
    """

    traces: list[Trace]
    real_time_factor: float
    step_seconds: float
    step: float
    time: Array = field(repr=False)
    estimates: dict[str, Array] = field(repr=False)
    others: dict[str, dict[str, Array]] = field(repr=False)
    notes: list[str] = field(default_factory=list)


NO_ESTIMATES = "the log holds no estimates of its own: compared with the measured slew only"


def alone(system: System) -> System:
    """The observer of a system by itself."""
    return dataclasses.replace(
        system,
        components={COMPONENT: system.components[COMPONENT]},
        wires=(),
        inputs={},
        outputs={},
        parameters={},
        notes=[],
        folder=None,
    )


def run_observer(comparator: Comparator, parameters: dict[str, Any] | None = None) -> ObserverRun:
    """Run the model's observer on the log's command and slew.

    Args:
        comparator: log and model.
        parameters: ``observer.parameter`` -> value; others are ignored.

    Raises:
        UsageError: the model has no observer.
        DataError: the log has no command or slew, or is too short.
        SimulationError: the FMU fails.
    """
    system, log = comparator.system, comparator.log
    if COMPONENT not in system.components:
        raise UsageError(
            f"--observer: '{system.name}' has no component '{COMPONENT}'; it has {', '.join(system.components)}"
        )
    slew = log.require("slew", "the observer")
    u = log.require("u", "the observer")
    h = comparator.step
    if comparator.time[-1] < SETTLING + 1.0:
        raise DataError(f"{log.source}: {comparator.time[-1]:.3g} s are too short for the observer to settle")
    own = {n: v for n, v in (parameters or {}).items() if n.startswith(COMPONENT + ".")}
    with Runner(alone(system)) as runner:
        result = runner.run(
            float(comparator.time[-1]),
            h,
            parameters=own,
            inputs={f"{COMPONENT}.u": (comparator.time, u), f"{COMPONENT}.slew": (comparator.time, slew)},
            hold=[f"{COMPONENT}.u"],
            record=[f"{COMPONENT}.{ANGLE}", f"{COMPONENT}.{RATE}"],
        )
    estimates = {n: result.signals[f"{COMPONENT}.{n}"] for n in (ANGLE, RATE)}
    rate, spread = differentiated(slew, h, comparator.floors.get("slew", 0.0))
    measured = {ANGLE: slew, RATE: rate}
    logged = {n: log[n] for n in (ANGLE, RATE) if n in log}
    traces = [_trace(n, "logged", estimates[n], logged[n], h, None) for n in logged]
    traces += [
        _trace(n, REFERENCE[n], estimates[n], measured[n], h, spread if n == RATE else None) for n in measured
    ]
    steps = comparator.time.size - 1
    return ObserverRun(
        traces,
        float(comparator.time[-1]) / max(result.wall_time, 1e-12),
        result.wall_time / steps,
        h,
        log.time[0] + comparator.time,
        estimates,
        {"logged": logged, "measured": measured},
        [] if len(logged) == 2 else [NO_ESTIMATES],
    )


def differentiated(angle: Array, h: float, noise: float) -> tuple[Array, float]:
    """Time derivative (n,) of an angle (n,) by a cubic over `DERIVATIVE_WINDOW`, and the error that white noise makes."""
    width = max(5, 2 * round(0.5 * DERIVATIVE_WINDOW / h) + 1)
    width = min(width, angle.size - 1 + angle.size % 2)
    weights = savgol_coeffs(width, 3, deriv=1, delta=h)
    return np.asarray(savgol_filter(angle, width, 3, deriv=1, delta=h)), noise * float(
        np.linalg.norm(weights)
    )


def _trace(name: str, against: str, estimate: Array, other: Array, h: float, floor: float | None) -> Trace:
    use = slice(round(SETTLING / h), None)
    error = estimate[use] - other[use]
    return Trace(
        name,
        against,
        rms(error),
        float(np.abs(error).max()),
        fit_percent(other[use], estimate[use]),
        lag_of(estimate[use], other[use], h),
        floor,
    )


def lag_of(late: Array, early: Array, h: float) -> float:
    """Time (s) by which one signal (n,) trails another: where the mean square of their difference is least.

    Found on whole samples within `LONGEST_LAG` and refined by a parabola; NaN where nothing moves.
    """
    if np.ptp(early) <= 1e-12 * max(float(np.abs(early).max()), 1e-300):
        return math.nan
    reach = min(round(LONGEST_LAG / h), early.size // 4)
    middle = slice(reach, early.size - reach)
    shifts = np.arange(-reach, reach + 1)
    step = max(1, reach // 100)

    def error(shift: int) -> float:
        moved = early[middle.start - shift : middle.stop - shift]
        difference = late[middle] - moved
        return float(np.mean((difference - difference.mean()) ** 2))

    coarse = shifts[::step]
    best = int(coarse[int(np.argmin([error(s) for s in coarse]))])
    near = [s for s in range(best - step, best + step + 1) if -reach <= s <= reach]
    costs = [error(s) for s in near]
    k = int(np.argmin(costs))
    if 0 < k < len(near) - 1:
        a, b, c = costs[k - 1 : k + 2]
        bend = a - 2.0 * b + c
        return float((near[k] + (0.5 * (a - c) / bend if bend > 0.0 else 0.0)) * h)
    return float(near[k] * h)
