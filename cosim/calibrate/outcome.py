"""What a calibration finds."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import Score
from cosim.inference.noise import Noise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """A fitted parameter; numbers in the FMU's unit.

    Attributes:
        name, unit, start, low, high, prior, display: as in `Free`.
        value: the estimate; where the log does not determine the parameter, the value that was kept.
        deviation: standard deviation, or None where none can be given.
        ci95: 95 % interval, or None.
        determined: the log determines it.
        at_bound: "lower" or "upper" where the search ended on that bound, else None.
        remark: what the reader should know, or empty.
    """

    name: str
    unit: str
    start: float
    low: float
    high: float
    prior: tuple[float, float] | None
    value: float
    deviation: float | None
    ci95: tuple[float, float] | None
    determined: bool
    at_bound: str | None
    remark: str = ""
    display: tuple[str, float] | None = None

    @property
    def shown(self) -> tuple[str, float]:
        """Unit in which people read it, and the factor to it."""
        return self.display or (self.unit or "1", 1.0)


@dataclass(frozen=True)
class Undetermined:
    """A change of parameters that the log does not see.

    Attributes:
        changes: parameter -> change in parts of its value (of its size where that is more), the largest 1.
        deviation: standard deviation of the whole change in the same measure; infinite where nothing moves at all.
        why: one sentence.
    """

    changes: dict[str, float]
    deviation: float
    why: str

    @property
    def most(self) -> str:
        """The parameter that changes most: it is kept, and the others are fitted."""
        return max(self.changes, key=lambda name: abs(self.changes[name]))


@dataclass(frozen=True)
class SignalFit:
    """One signal, SI.

    Attributes:
        fitted: it took part in the fit.
        noise: what was learned of its noise, or None.
        samples: measured samples in the fitted part.
        effective: independent samples that they are worth (for a mean).
        before, after: score of the start and the calibrated values on the fitted part.
        held_before, held_after: the same on the held-out part, or None.
    """

    fitted: bool
    noise: Noise | None
    samples: int
    effective: float | None
    before: Score
    after: Score
    held_before: Score | None
    held_after: Score | None


@dataclass(frozen=True)
class Start:
    """One start of the search.

    Attributes:
        values: where it began.
        cost: half the sum of squares where it ended, with the noise of the first stage.
        same: it ended where the best one did.
    """

    values: dict[str, float]
    cost: float
    same: bool


@dataclass(frozen=True)
class Series:
    """Measured and simulated signals of one log, for pictures.

    Attributes:
        source: the log's file.
        time: (n,) [s].
        measured, before, after: signal -> (n,) SI.
        held_from: index at which the held-out part begins; n where none is held out, 0 where all is.
    """

    source: Path
    time: Array = field(repr=False)
    measured: dict[str, Array] = field(repr=False)
    before: dict[str, Array] = field(repr=False)
    after: dict[str, Array] = field(repr=False)
    held_from: int = 0


@dataclass(frozen=True)
class Calibration:
    """A model fitted to a log.

    Attributes:
        model: name of the system.
        engine: "compiled" (our blocks' twin) or "fmu".
        why_fmu: why there is no twin, or empty.
        parameters: in the order in which they were named.
        covariance: (p, p) of those with an interval, in the order of `parameters`; NaN for the others.
        undetermined: what the log does not see.
        correlated: pairs with a correlation beyond 0.95: (name, name, correlation).
        start_values: start angles and the like that were estimated beside them, FMU's unit.
        signals: signal -> how it was and is simulated.
        starts: of the search, best first.
        evaluations: simulations of the whole model.
        seconds: time taken.
        series: the fitted log, then a second log that was held out.
        notes: what the reader should know.
    """

    model: str
    engine: str
    why_fmu: str
    parameters: list[Parameter]
    covariance: Array = field(repr=False)
    undetermined: list[Undetermined]
    correlated: list[tuple[str, str, float]]
    start_values: dict[str, float]
    signals: dict[str, SignalFit]
    starts: list[Start]
    evaluations: int
    seconds: float
    series: list[Series] = field(repr=False)
    notes: list[str]

    @property
    def values(self) -> dict[str, float]:
        """Parameter -> value for the model, in the FMU's unit."""
        return {p.name: p.value for p in self.parameters}
