"""Fitting a group's parameters to its measured signals under priors."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from cosim.correlation import correlations
from cosim.diagnosis.budget import current
from cosim.diagnosis.fitting.coordinates import Coordinates
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.noise import Whitener
from cosim.diagnosis.fitting.rounded import beyond
from cosim.diagnosis.record.signatures import bridged
from cosim.inference.pieces import by_piece, slope
from cosim.interrupts import often_uninterrupted

Array = NDArray[np.float64]
T = TypeVar("T")

ABSURD = 1e9  # SI; stands for a residual that is no number
AT_ONCE = 1_000_000  # samples of residuals that are kept to be whitened together: 8 MB
SLOPE_STEP = 2e-3  # of a scale, over which slopes are differenced
START_STEP = 1e-5  # of a scale, in which searches begin
FAR_OFF = 1e3  # scales: an unknown that begins farther from 0 is counted from where it begins


@dataclass(frozen=True)
class Unknown:
    """A parameter to estimate.

    Attributes:
        name: ``component.parameter``.
        start: where the search begins, SI.
        scale: size of a typical change, SI.
        low, high: bounds, SI.
        prior: (mean, standard deviation) of what is known beforehand, or None.
        amplitude: of a phase, the unknown that is the amplitude of its sine.
        within: another unknown and how many times as large as that this one can be; neither is negative.
        ratio: hardly its order of magnitude is known: it is sought by its logarithm. Its low bound is positive.
    """

    name: str
    start: float
    scale: float
    low: float
    high: float
    prior: tuple[float, float] | None = None
    amplitude: str = ""
    within: tuple[str, float] | None = None
    ratio: bool = False


def placed(unknowns: list[Unknown], values: Mapping[str, float]) -> list[Unknown]:
    """The unknowns, beginning at these values where there is one, SI."""
    return [replace(u, start=values.get(u.name, u.start)) for u in unknowns]


@dataclass
class Fit:
    """What a fit found.

    Attributes:
        values: ``component.parameter`` -> estimate, SI.
        deviations: standard deviation of each, SI.
        log_likelihood: of residuals and priors, up to a constant that all fits to the same data share.
        count: number of independent residuals.
        residuals: signal -> (n,) measured minus predicted, SI; of readings in steps what lies beyond the step.
        covariance: of the estimates, in the order of `values`.
        at_bound: names of the estimates that ended on a bound.
        slopes: (rows, unknowns) slopes of whitened residuals and priors, in units of each unknown's scale.
        settled: the search ended by itself and not by its limit of rounds.
        predicted: signal -> (n,) SI, of readings in steps or stale; of the others it is what was measured less the residual.
        scales: ``component.parameter`` -> unit of the slopes in it, SI.
        sketched: the slopes were followed and not differenced anew: a quick fit.
    """

    values: dict[str, float]
    deviations: dict[str, float]
    log_likelihood: float
    count: int
    residuals: dict[str, Array] = field(repr=False)
    covariance: Array = field(repr=False)
    at_bound: tuple[str, ...] = ()
    settled: bool = True
    slopes: Array | None = field(default=None, repr=False)
    rows: Array | None = field(default=None, repr=False)
    predicted: dict[str, Array] = field(default_factory=dict, repr=False)
    scales: dict[str, float] = field(default_factory=dict, repr=False)
    sketched: bool = False

    @property
    def correlations(self) -> dict[tuple[str, str], float]:
        """Correlation of each pair of estimates."""
        names = list(self.values)[: self.covariance.shape[0]]  # signatures in the samples have none
        return correlations(names, self.covariance)


@dataclass
class Task:
    """Data, model and noise of one group.

    Attributes:
        model: the group over the log.
        measured: signal -> (n,) SI.
        rules: signal -> whitening rule.
        discrepancy: signal -> (k, n) changes of the prediction by one standard deviation of what is not known exactly of
            the blocks before this group; it counts as noise.
        mask: (windows,) windows that count, or None for all.
        late: standard deviation of the timing of observed signals against the drive, s; its discrepancy is the first row.
        steps: signal -> step of its readings where that is coarser than their noise, SI.
        lost: signal -> (n,) True where its sample is stale: there its residual lies on a straight line, not its reading.
    """

    model: GroupModel
    measured: Mapping[str, Array]
    rules: dict[str, Whitener]
    discrepancy: Mapping[str, Array] = field(default_factory=dict)
    mask: NDArray[np.bool_] | None = None
    shrink: tuple[Array, Array] | None = field(default=None, repr=False)
    late: float = 0.0
    steps: Mapping[str, float] = field(default_factory=dict)
    lost: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)

    def retime(self, predicted: Mapping[str, Array], time: Array) -> None:
        """Take the discrepancy of the timing from what is predicted now, signal -> (n,) SI, at these times (n,), s."""
        if self.late > 0.0:
            rows = {s: -self.late * slope(y, time, self.model.cuts)[None] for s, y in predicted.items()}
            self.discrepancy = {s: np.concatenate([row, self.discrepancy[s][1:]]) for s, row in rows.items()}

    def set_rules(self, rules: dict[str, Whitener]) -> None:
        """Take over whitening rules, and prepare how discrepancy shrinks what lies along it."""
        self.rules = rules
        self.shrink = None
        if self.discrepancy:
            each = zip(*self.discrepancy.values(), strict=True)
            columns = self.rows_of([dict(zip(self.discrepancy, row, strict=True)) for row in each]).T
            left, values, _ = np.linalg.svd(columns, full_matrices=False)
            self.shrink = (left, 1.0 - 1.0 / np.sqrt(1.0 + values**2))

    def residuals(self, values: dict[str, float]) -> dict[str, Array]:
        """Measured minus predicted, signal by signal, SI; of readings in steps what lies beyond the step."""
        return self.against(self.model.simulate(values))

    def kept(self, values: dict[str, float]) -> tuple[dict[str, Array], dict[str, Array]]:
        """Residuals, and the predictions that they do not tell, signal -> (n,) SI."""
        predicted = self.model.simulate(values)
        return self.against(predicted), {s: predicted[s] for s in {*self.steps, *self.lost}}

    def predicted(self, found: "Fit") -> dict[str, Array]:
        """What a fit makes of the measured signals, signal -> (n,) SI."""
        return {s: found.predicted.get(s, self.measured[s] - r) for s, r in found.residuals.items()}

    def against(self, predicted: Mapping[str, Array]) -> dict[str, Array]:
        """Residuals of a prediction, signal -> (n,) SI."""
        found = {}
        for name, measured in self.measured.items():
            off = measured - predicted[name]
            if not np.abs(off).max(initial=0.0) < ABSURD:  # a trial far off may leave the numbers
                off = np.where(np.abs(off) < ABSURD, off, ABSURD * uneven(off.size))
            if name in self.lost:
                over = partial(bridged, time=None, of=self.rules[name].bins)
                off = by_piece(over, self.model.cuts, off, self.lost[name])
            found[name] = beyond(off, self.steps[name], self.rules[name]) if name in self.steps else off
        return found

    def rows(self, residuals: Mapping[str, Array]) -> Array:
        """All signals' residuals, independent and of unit size but for discrepancy, in one row."""
        return np.asarray(self.rows_of([residuals])[0])

    def rows_of(self, residuals: Sequence[Mapping[str, Array]]) -> Array:
        """The same of several sets of residuals: (sets, values)."""
        parts = []
        for name, rule in self.rules.items():
            rows = rule.each([own[name] for own in residuals])
            parts.append((rows if self.mask is None else rows[:, self.mask]).reshape(len(residuals), -1))
        return np.concatenate(parts, axis=1)

    def white_of(self, signal: str, residuals: Mapping[str, Array]) -> Array:
        """(windows, bins) of one signal's residual, independent and of unit size."""
        row, at = self.white(residuals), 0
        for name, rule in self.rules.items():
            shape = rule.windows(self.measured[name]).shape
            rows = shape[0] if self.mask is None else int(self.mask.sum())
            if name == signal:
                return row[at : at + rows * shape[1]].reshape(rows, shape[1])
            at += rows * shape[1]
        raise KeyError(signal)

    def white(self, residuals: Mapping[str, Array]) -> Array:
        """All signals' residuals, independent and of unit size, in one row."""
        return np.asarray(self.white_rows([residuals])[0])

    def white_rows(self, residuals: Sequence[Mapping[str, Array]]) -> Array:
        """The same of several sets of residuals: (sets, values). Linear in the residuals."""
        rows = self.rows_of(residuals)
        if self.shrink is not None:
            left, share = self.shrink
            rows = rows - ((rows @ left) * share) @ left.T
        return rows


@lru_cache(maxsize=8)
def uneven(count: int) -> Array:
    """(count,) numbers of unit size that no offset of a window and no mean of a bin takes up: what stands for no number."""
    return np.random.default_rng(0).standard_normal(count)


@often_uninterrupted()
def fit(
    task: Task,
    unknowns: list[Unknown],
    fixed: Mapping[str, float] | None = None,
    rounds: int = 12,
    quick: bool = False,
) -> Fit:
    """Maximum a posteriori estimate from the unknowns' starts, with intervals from the curvature.

    Args:
        task: data, model and noise.
        unknowns: what to estimate.
        fixed: other parameters that differ from nominal, SI.
        rounds: iterations at most.
        quick: the slopes are differenced once and then follow from what each iteration shows (Broyden 1965): enough to see
            whether a set is worth a fit. Such a fit never counts as settled.
    """
    base = dict(fixed or {})
    names = [u.name for u in unknowns]
    start = np.array([np.clip(begun(u), u.low, u.high) for u in unknowns])
    pairs = [(names.index(u.amplitude), i) for i, u in enumerate(unknowns) if u.amplitude in names]
    most = np.array([max(abs(u.low), abs(u.high)) for u in unknowns])
    shares = [
        (i, names.index(u.within[0]), u.within[1])
        for i, u in enumerate(unknowns)
        # a size that is known roughly is bound by what is known of it
        if u.within is not None and u.within[0] in names and unknowns[names.index(u.within[0])].low == 0.0
    ]
    scales = np.array([u.scale for u in unknowns])
    ratios = [i for i, u in enumerate(unknowns) if u.ratio]
    coordinates = Coordinates(pairs, scales, start, most, shares, ratios)
    low, high = coordinates.bounds(np.array([u.low for u in unknowns]), np.array([u.high for u in unknowns]))
    priors = [(i, u.prior) for i, u in enumerate(unknowns) if u.prior is not None]
    many = max(1, AT_ONCE // sum(values.size for values in task.measured.values()))

    def at(z: Array) -> tuple[dict[str, Array], list[float]]:
        x = coordinates.reported(z)
        extra = [(x[i] - mean) / deviation for i, (mean, deviation) in priors]
        return task.residuals(base | dict(zip(names, x.tolist(), strict=True))), extra

    def cost(z: Array) -> Array:
        residuals, extra = at(z)
        return np.concatenate([task.white(residuals), extra])

    def slopes(z: Array) -> Array:
        # to whiten is linear: it is done with the differences, and with those of many unknowns at once
        columns = []
        for several in batches(list(differenced(z, low, high)), many):
            changes, extras = [], []
            for up, down, length in several:
                (after, more), (before, less) = at(up), at(down)
                changes.append({s: (after[s] - before[s]) / length for s in after})
                extras.append((np.array(more) - np.array(less)) / length)
            columns.append(np.concatenate([task.white_rows(changes), np.stack(extras)], axis=1))
        return np.concatenate(columns).T

    if quick:
        follower = Follower(cost, low, high)
        cost, slopes = follower.cost, follower.slopes
    z0 = coordinates.sought(start)
    if not unknowns:
        residuals, stepped = task.kept(base)
        white = task.white(residuals)
        reached = -0.5 * float(white @ white)
        return Fit({}, {}, reached, white.size, residuals, np.empty((0, 0)), predicted=stepped)
    found = searched(cost, slopes, z0, (low, high), rounds)
    fitted = summarised(task, names, base, coordinates, found, (low, high), len(priors))
    return replace(fitted, settled=False, sketched=True) if quick else fitted


def begun(unknown: Unknown) -> float:
    """Where a search for an unknown begins, SI: what the last digits of sums made of an earlier fit ends here.

    Without that another processor's rounding grows from fit to fit, until it decides the names.
    """
    if unknown.start in (unknown.low, unknown.high) or abs(unknown.start) > FAR_OFF * unknown.scale:
        return unknown.start
    place = unknown.start / unknown.scale
    if unknown.ratio:
        return float(np.exp(round(np.log(place) / START_STEP) * START_STEP)) * unknown.scale
    return round(place / START_STEP) * START_STEP * unknown.scale


class Follower:
    """A cost whose slopes are differenced once, on one side, and then corrected by what each iteration shows.

    Broyden, A class of methods for solving nonlinear simultaneous equations, Math. Comp. 19 (1965).
    """

    def __init__(self, cost: Callable[[Array], Array], low: Array, high: Array) -> None:
        self._cost, self._low, self._high = cost, low, high
        self._known: dict[bytes, Array] = {}
        self._last: tuple[Array, Array, Array] | None = None  # where, cost there, slopes

    def cost(self, z: Array) -> Array:
        """(rows,) the cost, remembered."""
        found = self._cost(z)
        self._known[z.tobytes()] = found
        return found

    def slopes(self, z: Array) -> Array:
        """(rows, unknowns) slopes at a point."""
        here = self._known.get(z.tobytes())
        if here is None:  # moved by rounding onto a bound
            here = self._cost(z)
        if self._last is None:
            found = one_sided(self._cost, z, here, self._low, self._high)
        else:
            before, there, found = self._last
            moved = z - before
            moved = np.where(found.any(axis=0), moved, 0.0)  # what had no effect did not make the change
            if length := float(moved @ moved):
                found = found + np.outer(here - there - found @ moved, moved / length)
        self._known.clear()
        self._known[z.tobytes()] = here
        self._last = (z.copy(), here, found)
        return found


class _TimeGoneError(Exception):
    """The time of the diagnosis is gone in the middle of a search."""


def searched(
    cost: Callable[[Array], Array],
    slopes: Callable[[Array], Array],
    z: Array,
    bounds: tuple[Array, Array],
    rounds: int,
) -> OptimizeResult:
    """Least squares from `z` within bounds, at most `rounds` iterations.

    A step ends where it meets a bound, and scipy takes a step cut that short for the end of the search: from there it
    goes on, that unknown held. For the same reason a search begins on a bound and not beside it. How small a step ends
    the search goes by the length of all unknowns together: beside an end of travel that is out of reach (1e9 rad) every
    step would. When the time of the diagnosis is gone it ends where it is.
    """
    budget = current()
    last: list[Array] = []
    origin = np.where(np.abs(z) > FAR_OFF, z, 0.0)

    def in_time(z: Array) -> Array:
        if last and budget.gone:
            raise _TimeGoneError
        last[:] = z.copy(), slopes(z)
        return np.asarray(last[1])

    while True:
        try:
            with np.errstate(over="ignore"):  # a trial far out may overflow; the search turns back by itself
                found = least_squares(
                    lambda y: cost(y + origin),
                    z - origin,
                    lambda y: in_time(y + origin),
                    bounds=(bounds[0] - origin, bounds[1] - origin),
                    method="dogbox",
                    max_nfev=rounds,
                    xtol=1e-5,
                    ftol=1e-6,
                    gtol=1e-12,
                )
        except _TimeGoneError:
            fun = cost(last[0])
            return OptimizeResult(x=last[0], fun=fun, jac=last[1], cost=0.5 * float(fun @ fun), status=0)
        found.x = np.clip(found.x + origin, *bounds)
        rounds -= found.nfev
        before = (z == bounds[0]) | (z == bounds[1])
        if found.status <= 0 or rounds < 2 or not np.any((found.active_mask != 0) & ~before):
            return found
        z = found.x


def summarised(
    task: Task,
    names: list[str],
    base: dict[str, float],
    coordinates: Coordinates,
    found: OptimizeResult,
    bounds: tuple[Array, Array],
    priors: int,
) -> Fit:
    """What an optimiser found in these coordinates, with intervals from the curvature; `bounds` of these."""
    turn = coordinates.turn(found.x)
    scaled = turn * coordinates.scales[:, None]
    covariance = scaled @ np.linalg.pinv(found.jac.T @ found.jac) @ scaled.T
    deviations = dict(zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), strict=True))
    estimate = dict(zip(names, coordinates.reported(found.x).tolist(), strict=True))
    ends = zip(names, found.x, *bounds, strict=True)
    residuals, stepped = task.kept(base | estimate)
    return Fit(
        estimate,
        deviations,
        -float(found.cost),
        int(found.fun.size - priors),
        residuals,
        covariance,
        tuple(n for n, z, a, b in ends if z - a < 1e-4 or b - z < 1e-4),
        found.status > 0,
        found.jac @ np.linalg.inv(turn) if coordinates.transformed else found.jac,
        found.fun,
        stepped,
        dict(zip(names, coordinates.scales.tolist(), strict=True)),
    )


def one_sided(cost: Callable[[Array], Array], z: Array, here: Array, low: Array, high: Array) -> Array:
    """Differences to one side, that with more room, in units of each unknown's scale; `here` is the cost at `z`."""
    columns = []
    for i in range(z.size):
        other = z.copy()
        other[i] = (
            min(z[i] + SLOPE_STEP, high[i])
            if high[i] - z[i] >= z[i] - low[i]
            else max(z[i] - SLOPE_STEP, low[i])
        )
        columns.append((cost(other) - here) / (other[i] - z[i]))
    return np.stack(columns, axis=1)


def jacobian(
    cost: Callable[[Array], Array], z: Array, low: Array, high: Array, step: float = SLOPE_STEP
) -> Array:
    """Central differences in units of each unknown's scale, one-sided at a bound."""
    each = differenced(z, low, high, step)
    return np.stack([(cost(up) - cost(down)) / length for up, down, length in each], axis=1)


def batches(items: Sequence[T], size: int) -> Iterator[Sequence[T]]:
    """The items, so many at a time."""
    return (items[first : first + size] for first in range(0, len(items), size))


def differenced(
    z: Array, low: Array, high: Array, step: float = SLOPE_STEP
) -> Iterator[tuple[Array, Array, float]]:
    """For each unknown two points, to both sides of `z` but not beyond a bound, and how far they lie apart.

    The step is a fraction of a typical change, not of rounding: friction and play make the cost jagged at small scale.
    """
    for i in range(z.size):
        up, down = z.copy(), z.copy()
        up[i] = min(z[i] + step, high[i])
        down[i] = max(z[i] - step, low[i])
        yield up, down, float(up[i] - down[i])
