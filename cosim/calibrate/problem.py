"""The calibration as a least-squares problem: parameters in, independent residuals of unit size out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.calibrate.free import Free
from cosim.calibrate.twin import Twin
from cosim.compare import Comparator
from cosim.errors import DataError, SimulationError, UsageError
from cosim.inference.noise import Noise, quietest
from cosim.ssp.hints import did_you_mean
from cosim.ssp.system import Value

Array = NDArray[np.float64]
Places = NDArray[np.int64]
ABSURD = 1e6  # residual, in standard deviations, of a trial that the model refuses
DIFFERENCE = 1e-3  # step of the central differences, in parts of a parameter's size: dry friction makes costs jagged below
# estimates are made of other signals of the log, and p_load of p_a and p_b: they are no news
NO_NEWS = ("slew_estimate", "slew_rate_estimate")


@dataclass(frozen=True)
class Unknown:
    """One unknown of the search: a free parameter, or a start value that is estimated beside them.

    Attributes:
        name, start, low, high, prior: as in `Free`.
        size: unit of the search, in the parameter's unit.
    """

    name: str
    start: float
    low: float
    high: float
    size: float
    prior: tuple[float, float] | None = None


class Problem:
    """A comparator, its free parameters, and the signals they are fitted to.

    Attributes:
        free: the free parameters.
        fixed: those of them that are kept at their start.
        nuisances: start values that are estimated beside them.
        signals: fitted signals.
        places: signal -> (m,) sample numbers that count.
        engine, why_fmu: as in `Calibration`.
        evaluations: simulations so far.
    """

    def __init__(
        self,
        comparator: Comparator,
        free: Sequence[Free],
        *,
        given: Mapping[str, Value] | None = None,
        signals: Sequence[str] = (),
        stop: int | None = None,
        engine: str = "auto",
        progress: Callable[[int], None] | None = None,
    ) -> None:
        """Choose signals and engine.

        Args:
            comparator: log and model.
            free: what to fit.
            given: other values that differ from the model's own, ``component.variable`` -> FMU's unit.
            signals: fit to these; by default to all that are measured and not made of others.
            stop: fit to the samples before this one.
            engine: "auto", "compiled" or "fmu".
            progress: called with the number of simulations so far.

        Raises:
            UsageError: an unknown signal, or there is no twin where one is asked for.
            DataError: the log holds nothing to fit to.
        """
        self.comparator, self.given, self.progress = comparator, dict(given or {}), progress
        self.evaluations = 0
        self.count = len(comparator.log) if stop is None else stop
        self.signals = self._choose(signals)
        self.places = {
            name: np.flatnonzero(comparator.log.valid_mask(name)[: self.count]).astype(np.int64)
            for name in self.signals
        }
        self.twin, self.why_fmu = self._twin(engine)
        self.engine = "fmu" if self.twin is None else "compiled"
        self.fixed: dict[str, float] = {}
        self.free = list(free)
        self.nuisances = self._start_values({f.name for f in free})

    @property
    def unknowns(self) -> list[Unknown]:
        """The free parameters that are not fixed, then start values."""
        own = [
            Unknown(f.name, f.start, f.low, f.high, f.size, f.prior)
            for f in self.free
            if f.name not in self.fixed
        ]
        return own + self.nuisances

    def fix(self, name: str) -> None:
        """Keep a free parameter at its start."""
        self.fixed[name] = next(f.start for f in self.free if f.name == name)

    def _choose(self, wanted: Sequence[str]) -> tuple[str, ...]:
        comparator = self.comparator
        possible = [n for n in comparator.outputs if not comparator.missing(n)]
        for name in wanted:
            if name not in possible:
                raise UsageError(
                    f"--fit-to: '{name}' cannot be fitted to{did_you_mean(name, possible)}: this log and model allow "
                    f"{', '.join(possible) or 'none'}"
                )
        chosen = tuple(dict.fromkeys(wanted)) or tuple(
            n
            for n in possible
            if n not in NO_NEWS and not (n == "p_load" and {"p_a", "p_b"} <= set(possible))
        )
        if not chosen:
            lacking = sorted({repr(m) for n in comparator.outputs for m in comparator.missing(n)})
            raise DataError(
                f"{comparator.log.source}: nothing to compare: "
                + (
                    f"the log has no {', '.join(lacking)} to drive the model with"
                    if lacking
                    else "no signal is news"
                )
            )
        return chosen

    def _twin(self, engine: str) -> tuple[Twin | None, str]:
        if engine == "fmu":
            return None, "the FMUs were asked for"
        try:
            return Twin(self.comparator), ""
        except LookupError as error:
            if engine == "compiled":
                raise UsageError(f"'{self.comparator.system.name}' cannot run compiled: {error}") from None
            return None, str(error)

    def _start_values(self, taken: set[str]) -> list[Unknown]:
        """Start values that the log only shows through noise."""
        found = []
        values = self.comparator.start_values()
        for name, signal in self.comparator.starts.items():
            if name not in values:
                continue
            value = values[name]
            if signal in self.signals and name not in taken and name not in self.given:
                size = abs(self.comparator.bindings[signal].gain) * self.floor(signal)
                found.append(Unknown(name, value, -np.inf, np.inf, 10.0 * size))
        return found

    def floor(self, signal: str) -> float:
        """Noise of a signal before anything is known; never 0, as in a log without noise."""
        return max(self.comparator.floors[signal], quietest(self.comparator.log[signal]))

    @property
    def first_noise(self) -> dict[str, Noise]:
        """White noise of the size that each signal shows by itself."""
        return {name: Noise(self.floor(name) ** 2) for name in self.signals}

    def values(self, z: Array) -> dict[str, Value]:
        """Unknowns (in units of their sizes) as parameters of the model."""
        numbers = {
            u.name: min(max(float(x) * u.size, u.low), u.high) for u, x in zip(self.unknowns, z, strict=True)
        }
        return {**self.given, **self.fixed, **numbers}

    def simulate(self, values: Mapping[str, Value]) -> dict[str, Array]:
        """Signals (n,) SI of the whole log, driven by the command alone.

        Raises:
            SimulationError: the model refuses the values.
        """
        self.evaluations += 1
        if self.progress is not None:
            self.progress(self.evaluations)
        return (self.twin or self.comparator).simulate(values)

    def residuals(self, z: Array) -> dict[str, Array] | None:
        """Measured minus simulated (m,) of each signal at `places`, SI; None where the model refuses the values."""
        try:
            simulated = self.simulate(self.values(z))
        except SimulationError:
            return None
        return {n: (self.comparator.log[n] - simulated[n])[self.places[n]] for n in self.signals}

    def slopes(self, z: Array) -> dict[str, Array]:
        """Slopes (p, m) of the residuals by the unknowns, in SI per size of the unknown.

        Raises:
            SimulationError: the model refuses values beside these.
        """
        rows: dict[str, list[Array]] = {n: [] for n in self.signals}
        for i, u in enumerate(self.unknowns):
            up, down = z.copy(), z.copy()
            up[i] = min(z[i] + DIFFERENCE, u.high / u.size)
            down[i] = max(z[i] - DIFFERENCE, u.low / u.size)
            ahead, behind = (self.simulate(self.values(x)) for x in (up, down))
            for n in self.signals:
                rows[n].append((behind[n] - ahead[n])[self.places[n]] / (up[i] - down[i]))
        return {n: np.stack(parts) for n, parts in rows.items()}

    def white(self, residuals: Mapping[str, Array] | None, noise: Mapping[str, Noise], z: Array) -> Array:
        """Residuals of all signals and priors, independent and of unit size, in one row."""
        if residuals is None:
            total = sum(p.size for p in self.places.values())
            return np.full(total + len(self.priors), ABSURD)
        parts = [noise[n].whiten(residuals[n][None, :], self.places[n])[0] for n in self.signals]
        extra = [(z[i] * self.unknowns[i].size - mean) / deviation for i, (mean, deviation) in self.priors]
        return np.concatenate([*parts, np.array(extra)])

    def white_slopes(self, slopes: Mapping[str, Array], noise: Mapping[str, Noise]) -> Array:
        """(rows, p) slopes of `white`, priors included."""
        parts = [noise[n].whiten(slopes[n], self.places[n]).T for n in self.signals]
        extra = np.zeros((len(self.priors), len(self.unknowns)))
        for row, (i, (_, deviation)) in enumerate(self.priors):
            extra[row, i] = self.unknowns[i].size / deviation
        return np.vstack([*parts, extra])

    @property
    def priors(self) -> list[tuple[int, tuple[float, float]]]:
        """(number of the unknown, (mean, deviation))."""
        return [(i, u.prior) for i, u in enumerate(self.unknowns) if u.prior is not None]
