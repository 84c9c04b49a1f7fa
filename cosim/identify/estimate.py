"""Least squares with honest intervals: the noise's colour is learned from the residual, and the intervals account for that.

A model is a sum of rows with free factors, the rows depending on a few more numbers theta (separable least squares, Golub
and Pereyra, 1973). Records (logs, or parts of one) share theta and some of the factors, others are each record's own (its
start, its offset). The fit is weighted by the residual's density (`cosim.identify.spectrum`), learned in turn with it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from cosim.errors import DataError
from cosim.identify.spectrum import Bins, Density, density

Array = NDArray[np.float64]
Rows = tuple[Array, Array]
"""Rows of a record that all share (m, n), and its own (o, n)."""
Model = Callable[[Array, int], Rows]
"""Rows for theta (q,) and the record's number."""

ROUNDS = 3  # of learning the noise and fitting again
WORSE = 1.1  # times the misfit of equal weights: what weighing may cost where the model is right
FEWEST_BINS = 24
REMEMBERED = 24  # values of theta whose rows are kept: each round begins where the last one ended


@dataclass(frozen=True)
class Series:
    """What is to be explained.

    Attributes:
        values: (n,), one every `step` s.
        step: [s].
        keep: (n,), False where a sample says nothing.
        name: for messages.
    """

    values: Array
    step: float
    keep: NDArray[np.bool_]
    name: str = "the log"


@dataclass(frozen=True)
class Quantity:
    """An identified number.

    Attributes:
        value: best estimate, in `unit`.
        deviation: its standard deviation.
        freedom: degrees of freedom behind that deviation.
        unit: FMI's spelling.
    """

    value: float
    deviation: float
    freedom: float
    unit: str = "1"

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval."""
        reach = self.deviation * float(student.ppf(0.975, max(self.freedom, 1.0)))
        return self.value - reach, self.value + reach

    def as_data(self) -> dict[str, object]:
        """As the JSON answers show it."""
        return {"value": self.value, "unit": self.unit, "ci95": list(self.interval), "sd": self.deviation}


@dataclass(frozen=True)
class Fit:
    """What a fit found.

    Attributes:
        theta: (q,).
        shared: factors (m,) of the rows that all records share.
        own: of each record its own factors (o,).
        residuals: of each record measured minus model (n,), unweighted.
        influence: (p, N): what each unit of noise, in its own standard deviation, does to theta, shared and all own.
        densities: of each record the noise.
        bins: of each record.
        freedom: degrees of freedom where there are no densities: a fit to a frequency response.
    """

    theta: Array
    shared: Array
    own: list[Array]
    residuals: list[Array]
    influence: Array = field(repr=False)
    densities: list[Density] = field(repr=False)
    bins: list[Bins] = field(repr=False)
    freedom: float = 0.0

    def derived(self, value: Callable[[Array, Array], float], unit: str = "1") -> Quantity:
        """A number that follows from theta and the shared factors, its deviation by the delta method."""
        q, m = self.theta.size, self.shared.size
        point = np.concatenate([self.theta, self.shared])
        deviations = np.sqrt(np.sum(self.influence[: q + m] ** 2, axis=1))
        gradient = np.zeros(self.influence.shape[0])
        for i in range(q + m):
            # a tenth of the deviation: small against the estimate's spread, large against rounding
            # where it is not told at all that would leave what can be computed
            move = min(0.1 * deviations[i], abs(point[i]) or 1.0) or 1e-6 * (abs(point[i]) or 1.0)
            up, down = point.copy(), point.copy()
            up[i] += move
            down[i] -= move
            gradient[i] = (value(up[:q], up[q:]) - value(down[:q], down[q:])) / (2.0 * move)
        return Quantity(value(self.theta, self.shared), *self._deviation(gradient), unit)

    def _deviation(self, gradient: Array) -> tuple[float, float]:
        """Standard deviation along a gradient, and degrees of freedom (Satterthwaite, the density being estimated)."""
        parts = (gradient @ self.influence) ** 2
        variance = float(parts.sum())
        if variance <= 0.0:
            return 0.0, 1e6
        if not self.densities:
            return float(np.sqrt(variance)), self.freedom
        parts = parts / variance
        error, start = 0.0, 0
        for bins, noise in zip(self.bins, self.densities, strict=True):
            own = parts[start : start + bins.size]
            shares = own[1 : bins.last + 1] + own[bins.last + 1 :]
            shares[0] += own[0]
            error += noise.relative_error(shares)
            start += bins.size
        # weights that are estimates: the covariance they give is too small by twice their error (Kenward, Roger, 1997)
        return float(np.sqrt(variance * (1.0 + 2.0 * error))), 2.0 / max(error, 1e-9)


class _Problem:
    """A model over records, weighted."""

    def __init__(self, series: Sequence[Series], model: Model, highest: float) -> None:
        self.series, self.model = series, model
        self.bins = [Bins.up_to(s.values.size, s.step, highest) for s in series]
        self.weights = [np.ones(b.size) for b in self.bins]
        self.known: dict[bytes, list[tuple[Array, Array]]] = {}
        for s, b in zip(series, self.bins, strict=True):
            if b.last < FEWEST_BINS:
                raise DataError(
                    f"{s.name}: {s.values.size * s.step:.3g} s are too short for the noise to be told from the signal:"
                    f" at least {FEWEST_BINS / highest:.3g} s are needed, record a longer log"
                )
        self.data = [b(np.where(s.keep, s.values, 0.0)) for s, b in zip(series, self.bins, strict=True)]

    def parts(self, theta: Array) -> list[tuple[Array, Array]]:
        """Of each record its shared and its own rows as real numbers (m, size) and (o, size), unweighted."""
        key = theta.tobytes()
        if key not in self.known:
            if len(self.known) >= REMEMBERED:
                self.known.pop(next(iter(self.known)))
            self.known[key] = [self._transformed(theta, i) for i in range(len(self.series))]
        return self.known[key]

    def _transformed(self, theta: Array, i: int) -> tuple[Array, Array]:
        common, mine = self.model(theta, i)
        keep, bins = self.series[i].keep, self.bins[i]
        both = np.vstack([common, mine])
        numbers = bins(both if keep.all() else np.where(keep, both, 0.0))
        return numbers[: common.shape[0]], numbers[common.shape[0] :]

    def rows(self, theta: Array) -> tuple[Array, Array]:
        """Weighted rows as columns (N, m + all own), and weighted data (N,)."""
        blocks = self.parts(theta)
        m, own = blocks[0][0].shape[0], sum(b[1].shape[0] for b in blocks)
        matrix = np.zeros((sum(b.size for b in self.bins), m + own))
        top, left = 0, m
        for (common, mine), bins, weight in zip(blocks, self.bins, self.weights, strict=True):
            matrix[top : top + bins.size, :m] = (common * weight).T
            matrix[top : top + bins.size, left : left + mine.shape[0]] = (mine * weight).T
            top, left = top + bins.size, left + mine.shape[0]
        return matrix, np.concatenate([d * w for d, w in zip(self.data, self.weights, strict=True)])

    def factors(self, theta: Array) -> tuple[Array, Array]:
        """Best factors for theta, and the weighted residual (N,)."""
        matrix, data = self.rows(theta)
        scale = np.linalg.norm(matrix, axis=0)
        scale[scale == 0.0] = 1.0
        beta = np.linalg.lstsq(matrix / scale, data, rcond=1e-12)[0] / scale
        return beta, data - matrix @ beta

    def solve(self, start: Array, bounds: tuple[Array, Array]) -> Array:
        """The best theta from a start."""
        if not start.size:
            return start
        found = least_squares(
            lambda theta: self.factors(theta)[1],
            start,
            bounds=bounds,
            x_scale="jac",
            diff_step=1e-5,
            xtol=1e-9,
            ftol=1e-9,
            max_nfev=30,
        )
        return np.asarray(found.x)

    def jacobian(self, theta: Array, beta: Array) -> Array:
        """Weighted Jacobian (N, p) in theta and factors."""
        matrix, _ = self.rows(theta)
        columns = []
        for i in range(theta.size):
            move = 1e-5 * max(abs(theta[i]), 1e-2)
            up, down = theta.copy(), theta.copy()
            up[i] += move
            down[i] -= move
            columns.append((self.rows(up)[0] @ beta - self.rows(down)[0] @ beta) / (2.0 * move))
        return np.column_stack([*columns, matrix])

    def learned(self, jacobian: Array, residual: Array) -> list[Density]:
        """The noise's density of every record, from the weighted residual (N,) of a fit with that Jacobian."""
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0.0] = 1.0
        q, _ = np.linalg.qr(jacobian / scale)
        leverage = np.sum(q**2, axis=1)
        found, top = [], 0
        for weight, bins in zip(self.weights, self.bins, strict=True):
            part = slice(top, top + bins.size)
            found.append(density(bins, residual[part] / weight, leverage[part]))
            top += bins.size
        return found

    def weigh(self, densities: Sequence[Density] | None) -> None:
        """Weigh by densities, or all alike."""
        found = [np.ones(b.size) for b in self.bins]
        if densities is not None:
            found = [1.0 / np.sqrt(b.spread(d.values)) for b, d in zip(self.bins, densities, strict=True)]
        self.weights = found

    def misfit(self, theta: Array) -> float:
        """Norm of the residual of the best weighted factors, itself unweighted."""
        return float(np.linalg.norm(self.factors(theta)[1] / np.concatenate(self.weights)))

    def result(self, theta: Array, densities: list[Density]) -> Fit:
        """The fit at theta, with the noise's densities."""
        beta, _ = self.factors(theta)
        jacobian = self.jacobian(theta, beta)
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0.0] = 1.0
        inverse = np.linalg.pinv(jacobian / scale, rcond=1e-10) / scale[:, None]
        noise = [np.sqrt(b.spread(d.values)) for b, d in zip(self.bins, densities, strict=True)]
        influence = inverse * np.concatenate([n * w for n, w in zip(noise, self.weights, strict=True)])
        own: list[Array] = []
        residuals, m = list[Array](), 0
        for i, s in enumerate(self.series):
            common, mine = self.model(theta, i)
            m = common.shape[0]
            left = m + sum(o.size for o in own)
            own.append(beta[left : left + mine.shape[0]])
            residuals.append(np.where(s.keep, s.values - beta[:m] @ common - own[-1] @ mine, 0.0))
        return Fit(theta, beta[:m], own, residuals, influence, densities, self.bins)


def fit(
    series: Sequence[Series],
    model: Model,
    start: Array,
    *,
    highest: float,
    bounds: tuple[Array, Array] | None = None,
) -> Fit:
    """Fit a model to records.

    Args:
        series: what it is to explain.
        model: see `Model`.
        start: theta (q,) from which the search begins.
        highest: frequency [Hz] above which the model's output has nothing.
        bounds: lowest and highest theta.

    Raises:
        DataError: a record is too short.
    """
    limits = bounds or (np.full(start.size, -np.inf), np.full(start.size, np.inf))
    problem = _Problem(series, model, highest)
    plain = theta = problem.solve(np.asarray(start, dtype=np.float64), limits)
    size = problem.misfit(plain)
    for _ in range(ROUNDS):
        beta, residual = problem.factors(theta)
        densities = problem.learned(problem.jacobian(theta, beta), residual)
        problem.weigh(densities)
        theta = problem.solve(theta, limits)
    if problem.misfit(theta) > WORSE * size:
        # a structure that cannot follow the data: weights from its own misfit would hide where it fails
        problem.weigh(None)
        theta = plain
        beta, residual = problem.factors(theta)
        densities = problem.learned(problem.jacobian(theta, beta), residual)
    return problem.result(theta, densities)


def residual_size(series: Sequence[Series], model: Model, theta: Array, highest: float) -> float:
    """Norm of what is left, unweighted, with the best factors for theta."""
    return float(np.linalg.norm(_Problem(series, model, highest).factors(theta)[1]))
