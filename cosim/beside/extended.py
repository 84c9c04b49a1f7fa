"""The extended observer beside a log: disturbance torque and, with a tracker, the slew sensor's own error and a fused angle.

Its FMU is fed with the measured slew and load pressure. Where the log has no pressures the model's own valve and
pressure make the load pressure from the command: an observer on the full-order model. Whether its stated noises fit the
log is judged by the normalised innovations squared (NIS): their mean is 1 where they do (Bar-Shalom, Li, Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001, section 5.4).
"""

import dataclasses
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from cosim.closed_loop import values
from cosim.compare.comparator import Comparator
from cosim.compare.observer import SETTLING
from cosim.errors import DataError, UsageError
from cosim.files import Scratch
from cosim.identify.kalman import BAR, DEG, ExtendedObserver, Mechanics, Noises, design
from cosim.master import Runner
from cosim.master.inputs import Series
from cosim.ssp.read import read_system
from cosim.ssp.write import fmu_bytes

Array = NDArray[np.float64]
BLOCK = "observer_extended"
ESTIMATES = ("slew_estimate", "slew_rate_estimate", "disturbance", "sensor_error")
# the torque that a model may lack, and how long it stays: our choice, of the moderate sizes of docs/design.md
DISTURBANCE, T_TAU = 100.0, 1.0  # N.m, s
SENSOR_ERROR, T_BETA = 0.1 * DEG, 10.0  # rad, s; with a tracker alone
QUIETEST = 1e-5 * DEG  # rad, noise of a sensor that has none: the filter needs some
MECHANICAL = "mechanical"


@dataclass(frozen=True)
class Readings:
    """Readings of a tracker on the log's clock.

    Attributes:
        time: (m,) s since the log's first sample, rising.
        angle: (m,) rad, without seam.
        noise: of one, rad.
    """

    time: Array
    angle: Array
    noise: float


@dataclass(frozen=True)
class Consistency:
    """Mean of the normalised innovations squared, behind the settling time.

    Attributes:
        mean: 1 where noise and disturbance are as stated.
        interval: in which 95 % of the means lie then.
        count: of innovations.
    """

    mean: float
    interval: tuple[float, float]
    count: int


@dataclass(frozen=True)
class ExtendedRun:
    """The extended observer on a log.

    Attributes:
        designed: the filter.
        measured_pressure: the load pressure is the log's; otherwise the model's.
        time: (n,) s, as in the log.
        estimates: of `ESTIMATES` -> (n,) SI.
        nis, nis_external: consistency of slew sensor and tracker; None where there is no tracker.
        notes: what the reader should know.
    """

    designed: ExtendedObserver
    measured_pressure: bool
    time: Array = field(repr=False)
    estimates: dict[str, Array] = field(repr=False)
    nis: Consistency
    nis_external: Consistency | None
    notes: list[str] = field(default_factory=list)


def run_extended(
    comparator: Comparator,
    parameters: dict[str, Any] | None = None,
    readings: Readings | None = None,
    noises: Noises | None = None,
) -> ExtendedRun:
    """Run the extended observer on a log.

    Args:
        comparator: log and model.
        parameters: start values by name; those of the mechanics are used.
        readings: of a tracker; without them the sensor is taken as right.
        noises: what the filter is told; by default the noise found in the log and the sizes above.

    Raises:
        UsageError: the model has no mechanics, or the noises make no filter.
        DataError: the log has no slew, or neither pressures nor a command.
        SimulationError: an FMU fails.
    """
    log, h = comparator.log, comparator.step
    slew = log.require("slew", "the extended observer")
    system = comparator.system
    if MECHANICAL not in system.components:
        raise UsageError(
            f"the extended observer corrects the component '{MECHANICAL}', which '{system.name}' does not have; "
            "use full_order"
        )
    if comparator.time[-1] < SETTLING + 1.0:
        raise DataError(f"{log.source}: {comparator.time[-1]:.3g} s are too short for the observer to settle")
    given = parameters or {}
    own = {f"{MECHANICAL}.{n}": v for n, v in values(system, MECHANICAL).items()}
    own |= {n: float(v) for n, v in given.items() if n in own}
    measured = "p_load" in log
    p_load = log["p_load"] if measured else _modelled(comparator, given)
    if noises is None:
        noises = _noises(comparator, measured, readings)
    designed = design(Mechanics.of(own), noises)
    estimates = filtered(designed, h, p_load, slew, readings)
    nis, external = consistency(designed, h, slew, estimates, readings)
    notes = (
        [] if measured else ["the log has no pressures: the load pressure is the model's, from the command"]
    )
    return ExtendedRun(designed, measured, log.time[0] + comparator.time, estimates, nis, external, notes)


def _modelled(comparator: Comparator, parameters: dict[str, Any]) -> Array:
    """Load pressure (n,) of the model, driven by the log's command alone, Pa."""
    if "u" not in comparator.log or "continuity" not in comparator.system.components:
        raise DataError(
            f"{comparator.log.source}: the extended observer needs p_a and p_b, or u and a model with 'continuity'"
        )
    stop = float(comparator.time[-1])
    target = "u" if "u" in comparator.system.inputs else "compensator.command"
    system = comparator.system
    wires = tuple(w for w in system.wires if w.source.component != "stimulus")
    system = dataclasses.replace(system, wires=wires)
    with Runner(system) as runner:
        result = runner.run(
            stop,
            comparator.step,
            parameters=parameters,
            inputs={target: (comparator.time, comparator.log["u"])},
            hold=[target],
            record=["continuity.p_load"],
        )
    return result.signals["continuity.p_load"]


def _noises(comparator: Comparator, measured: bool, readings: Readings | None) -> Noises:
    """The noise found in the log beside the usual disturbance."""
    floors, log = comparator.floors, comparator.log
    pressure = 0.0
    if measured:
        parts = [floors[n] for n in ("p_a", "p_b") if n in floors]
        pressure = math.hypot(*parts) if len(parts) == 2 else floors.get("p_load", 0.1 * BAR)
    slew = max(floors.get("slew", 0.0), QUIETEST)
    if readings is None:
        return Noises(slew, pressure, DISTURBANCE, T_TAU, step=comparator.step)
    apart = float(np.median(np.diff(readings.time))) if readings.time.size > 1 else log.step
    return Noises(
        slew,
        pressure,
        DISTURBANCE,
        T_TAU,
        SENSOR_ERROR,
        T_BETA,
        max(readings.noise, QUIETEST),
        round(apart / comparator.step * 4.0) / 4.0 * comparator.step,
        comparator.step,
    )


def placed(readings: Readings | None, h: float, count: int) -> tuple[Array, Array]:
    """(count,) angle and age of the reading that each sample's step ends with; age -1 where there is none.

    Of two readings within a step the later one counts.
    """
    angle, age = np.zeros(count), np.full(count, -1.0)
    if readings is not None:
        ending = np.ceil(readings.time / h - 1e-9).astype(int)
        inside = (ending > 0) & (ending < count)
        at = ending[inside]
        angle[at] = readings.angle[inside]
        age[at] = np.maximum(at * h - readings.time[inside], 0.0)
    return angle, age


def filtered(
    designed: ExtendedObserver, h: float, p_load: Array, slew: Array, readings: Readings | None = None
) -> dict[str, Array]:
    """The FMU's estimates on a record: of `ESTIMATES` -> (n,) SI.

    Args:
        designed: the filter.
        h: step, s.
        p_load: (n,) Pa.
        slew: (n,) rad.
        readings: of the tracker.

    Raises:
        SimulationError: the FMU fails.
    """
    time = np.arange(slew.size) * h
    angle, age = placed(readings, h, slew.size)
    with Scratch("observer_") as folder:
        file = Path(folder, f"{BLOCK}.fmu")
        file.write_bytes(fmu_bytes(BLOCK, (), None))
        system = read_system(file)
        try:
            (name,) = system.components
            inputs: dict[str, Series] = {
                f"{name}.{n}": (time, v)
                for n, v in (
                    ("p_load", p_load),
                    ("slew", slew),
                    ("slew_external", angle),
                    ("external_age", age),
                )
            }
            with Runner(system) as runner:
                result = runner.run(
                    float(time[-1]),
                    h,
                    parameters={f"{name}.{n}": v for n, v in designed.values().items()},
                    inputs=inputs,
                    hold=[],
                    record=[f"{name}.{n}" for n in ESTIMATES],
                )
        finally:
            system.close()
    return {n: result.signals[f"{name}.{n}"] for n in ESTIMATES}


def innovations(
    designed: ExtendedObserver, h: float, slew: Array, estimates: dict[str, Array], readings: Readings | None
) -> tuple[Array, Array]:
    """What each sample, (n,), and each reading, (k,), told beyond its prediction, rad, from the estimates behind it."""
    have = dict(zip(designed.states, designed.gain, strict=True))
    jumps = dict(zip(designed.states, designed.reading, strict=True))
    angle, age = placed(readings, h, slew.size)
    theta, omega = estimates["slew_estimate"], estimates["slew_rate_estimate"]
    fresh = age >= 0.0
    kept = 1.0 - jumps["theta"] + np.maximum(age, 0.0) * jumps["omega"]
    d = np.where(fresh, (angle - theta + np.maximum(age, 0.0) * omega) / kept, 0.0)
    before = theta + estimates["sensor_error"] - (jumps["theta"] + jumps.get("beta", 0.0)) * d
    e = (slew - before) / (1.0 - h * (have["theta"] + have.get("beta", 0.0)))
    return e, d[fresh & (np.arange(slew.size) * h >= SETTLING)]


def consistency(
    designed: ExtendedObserver, h: float, slew: Array, estimates: dict[str, Array], readings: Readings | None
) -> tuple[Consistency, Consistency | None]:
    """NIS of the slew sensor and of the tracker, behind the settling time."""
    e, d = innovations(designed, h, slew, estimates, readings)
    own = normalised(e[round(SETTLING / h) :], designed.innovation)
    if readings is None or not d.size:
        return own, None
    return own, normalised(d, designed.innovation_external)


def normalised(innovation: Array, variance: float) -> Consistency:
    """Mean of squares (m,) over their variance, and the chi-square interval of m independent ones."""
    m = innovation.size
    low, high = (float(chi2.ppf(q, m)) / m for q in (0.025, 0.975))
    return Consistency(float(np.mean(innovation**2)) / variance, (low, high), m)
