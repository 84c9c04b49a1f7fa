"""Signals held against a model, with noise and nuisances: what every hypothesis is judged by.

A model is a function of named values to named series. Small unknowns that every hypothesis shares (nuisances, such as the
moment within a sampling interval at which an input acted) enter by their slopes and are eliminated from each residual by
linear least squares with their priors (variable projection: Golub and Pereyra 1973). Those that show in held-out data alone
are estimated there, beside the others, which are not. Values may say how far they have moved one already (`ABOUT`): its
slope then reaches on from there, and its prior counts the whole of it.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cosim.errors import SimulationError
from cosim.inference.held_out import HeldOutGain, gain_between
from cosim.inference.noise import Noise
from cosim.inference.spectrum import bands, learn
from cosim.inference.thresholds import BOUND
from cosim.inference.unknowns import Unknown

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Model = Callable[[Mapping[str, float]], Mapping[str, Array]]
DIFFERENCE = 0.02  # of an unknown's scale, for slopes: large enough for what acts on few samples only
FINE = 0.2  # of that in the last fit
EVALUATIONS = 14  # of one search
FAILED = 1e6  # whitened residual where the model cannot be run
LARGEST = 1e120  # of one that runs away: its square is a number
ROUGHLY = 1e-3  # of what is left: a search among many that would gain less has ended
# before a nuisance's name: where values already have it, beside which it follows by its slope
ABOUT = "about:"
EQUAL = 1e-6  # share by which sizes that are the same differ, by rounding and by the steps of an FMU


@dataclass(frozen=True)
class Fit:
    """A hypothesis at its best values.

    Attributes:
        values: name -> estimate.
        covariance: (k, k) of the unknowns, sandwich estimator over windows (White 1982), nuisances unknown too.
        unknowns: in the order of the covariance.
        rows: (n + k,) whitened residuals of all signals, nuisances eliminated, then the nuisances over their priors.
        log_likelihood: of the fitted part, up to a constant, priors included.
    """

    values: dict[str, float]
    covariance: Array
    unknowns: tuple[Unknown, ...]
    rows: Array = field(repr=False)
    log_likelihood: float

    def deviation(self, name: str) -> float:
        """Standard deviation of an estimate."""
        at = [u.name for u in self.unknowns].index(name)
        return float(np.sqrt(max(self.covariance[at, at], 0.0)))


class _HurryError(Exception):
    """A fit is to end."""


class _Learnt:
    """Slopes of a search, corrected by what each of its steps has changed (Broyden 1965)."""

    def __init__(self, of: Callable[[Array], Array], at: Array, slopes: Array) -> None:
        """Those known about a point.

        Args:
            of: (u,) -> (n,) rows.
            at: (u,) where the search begins.
            slopes: (n, u).
        """
        self.of, self.at, self.here, self.slopes = of, at, of(at), slopes

    def __call__(self, x: Array) -> Array:
        here, step = self.of(x), x - self.at
        if (size := float(step @ step)) > 0.0:
            beyond = here - self.here - self.slopes @ step
            self.slopes = self.slopes + np.outer(beyond, step / size)
        self.at, self.here = x.copy(), here
        return self.slopes


class Problem:
    """Measured series, a model of them, and what is known of the noise.

    Attributes:
        measured: name -> (n,).
        fitted: name -> (n,) mask of the part that fits use; the rest is held out.
        window: name -> (n,) number of the window of each sample, over all names.
        noise: name -> noise.
        mask: (n + k,) what fits use of all signals behind one another and of the nuisances; the rest is held out.
        failures: what the model said where it could not be run, each once.
        hurried: asked before each run of a fit; where it is true the fit ends with the best so far.
        missing: name -> (n,) True where nothing was measured and the model gives the measured series; of some names only.
        sparing: within what it gives for some names the model may give the measured series of these in the place of its own.
    """

    def __init__(
        self,
        measured: Mapping[str, Array],
        fitted: Mapping[str, Mask],
        window: Mapping[str, NDArray[np.int64]],
        model: Model,
        least: Mapping[str, float],
    ) -> None:
        """Take the data; the noise is learned from residuals later.

        Args:
            measured: name -> (n,).
            fitted: name -> (n,) mask of the part that fits use.
            window: name -> (n,) number of the window.
            model: values -> series of the same names.
            least: name -> smallest noise that a signal is taken to have.
        """
        self.measured, self.fitted, self.window, self.model = (
            dict(measured),
            dict(fitted),
            dict(window),
            model,
        )
        self.least = dict(least)
        self.names = list(self.measured)
        self.noise: dict[str, Noise] = {n: Noise(max(least[n], 1e-12) ** 2) for n in self.names}
        self._many = dict.fromkeys(self.names, 1.0)  # samples that count as one
        self.failures: list[str] = []
        self.missing: dict[str, Mask] = {}
        self.hurried: Callable[[], bool] = lambda: False
        self.sparing: Callable[[Collection[str]], AbstractContextManager[None]] = lambda names: nullcontext()
        self._data = np.concatenate([self.fitted[n] for n in self.names])
        self._numbers = np.concatenate([self.window[n] for n in self.names])
        self.mask, self.windows = self._data, self._numbers
        self._slopes: dict[str, Array] = {n: np.zeros((0, self.measured[n].size)) for n in self.names}
        self._nuisances: tuple[Unknown, ...] = ()
        self._elsewhere: Mask = np.zeros(0, dtype=bool)  # nuisances that show in held-out data alone
        self._projected: tuple[Array, Array, Array] | None = None

    # Nuisances and noise

    @property
    def independent(self) -> float:
        """How many of the samples that are fitted count as independent, beside the nuisances: the n of a BIC."""
        lost = sum(float(self.fitted[n].sum()) * (1.0 - 1.0 / many) for n, many in self._many.items())
        lost += sum(float((self.fitted[n] & away).sum()) / self._many[n] for n, away in self.missing.items())
        return float(self.mask.sum()) - lost

    def share(self, nuisances: Sequence[Unknown], slopes: Mapping[str, Array]) -> None:
        """Nuisances (k) with the slopes (k, n) of each signal, per unit of the nuisance."""
        self._nuisances, self._slopes, self._projected = tuple(nuisances), dict(slopes), None
        more = len(self._nuisances)
        shown = np.concatenate([self._slopes[n] for n in self.names], axis=1) != 0.0
        self._elsewhere = np.logical_and(shown.any(axis=1), ~shown[:, self._data].any(axis=1))
        self.mask = np.concatenate([self._data, ~self._elsewhere])
        first = shown.argmax(axis=1) if more else np.zeros(0, dtype=np.int64)
        own = np.where(self._elsewhere, self._numbers[first], 0)
        self.windows = np.concatenate([self._numbers, own])

    @property
    def nuisances_shared(self) -> tuple[Unknown, ...]:
        """The nuisances, in the order of their rows."""
        return self._nuisances

    @contextmanager
    def sharing(self, names: Collection[str]) -> Iterator[None]:
        """Within this there are no other nuisances than these."""
        before, slopes = self._nuisances, self._slopes
        kept = [k for k, u in enumerate(before) if u.name in names]
        self.share([before[k] for k in kept], {n: s[kept] for n, s in slopes.items()})
        try:
            yield
        finally:
            self.share(before, slopes)

    def hand_nuisances(self, other: "Problem") -> None:
        """Give the nuisances to a problem of some of the same signals."""
        other.share(self._nuisances, {n: self._slopes[n] for n in other.names})

    def learn(self, residuals: Mapping[str, Array], wrong: Collection[str] = ()) -> None:
        """Learn the noise of each signal from what some hypothesis leaves.

        What is left of a signal that stays `wrong` is no noise. Were its colour taken for one, fits would follow what
        changes fast and let the run drift; so the least error of the run decides, and the colour only says for how many
        samples it counts: no fewer than windows, which count as independent of one another.
        """
        for name in self.names:
            rest = residuals[name]
            if name in self.missing:  # where nothing is left the noise is as elsewhere
                rest = rest / np.sqrt(max(1.0 - float(self.missing[name].mean()), 1.0 / rest.size))
            table = bands(rest, np.zeros((1, rest.size)), self.least[name])
            noise = learn({name: table}, np.eye(1))[name]
            if name in wrong:
                many = rest.size / max(noise.effective(rest.size), np.unique(self.window[name]).size)
                noise = Noise(float(np.mean(rest**2)) * many)
            self.noise[name], self._many[name] = noise, many if name in wrong else 1.0
        self._projected = None

    def whitened(self, series: Mapping[str, Array]) -> Array:
        """(m, n) rows of all signals behind one another, (m, n_signal) each, made white."""
        parts = []
        for name in self.names:
            rows = np.atleast_2d(series[name])
            white, some = np.zeros(rows.shape), rows.any(axis=1)
            if some.any():  # nothing stays nothing, and of several logs a nuisance mostly is in one
                white[some] = self.noise[name].whiten(rows[some])
            parts.append(white)
        return np.concatenate(parts, axis=1)

    def _project(self) -> tuple[Array, Array, Array]:
        """Whitened nuisance slopes (n, k), those of the fitted part, and their information with the priors (k, k)."""
        if self._projected is None:
            slopes = self.whitened(self._slopes).T if self._nuisances else np.zeros((self._data.size, 0))
            inside = slopes[self._data]
            prior = np.diag([u.prior**-2 for u in self._nuisances]) if self._nuisances else np.zeros((0, 0))
            self._projected = slopes, inside, inside.T @ inside + prior + 1e-12 * np.eye(len(prior))
        return self._projected

    def _about(self, values: Mapping[str, float]) -> Array:
        """How far values have moved each nuisance (k,) themselves; nowhere one that is an unknown of the hypothesis."""
        return np.array(
            [0.0 if u.name in values else values.get(ABOUT + u.name, 0.0) for u in self._nuisances]
        )

    def eliminated(self, rows: Array, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Rows (n,) without what nuisances explain of them, and the nuisances (k,), within their bounds.

        An unknown of the hypothesis itself has no nuisance beside it.
        """
        slopes, inside, information = self._project()
        if not self._nuisances:
            return rows, np.zeros(0)
        rows = rows + slopes @ self._about(values)
        wanted = inside.T @ rows[self._data]
        found = np.linalg.solve(information, wanted)
        low = np.array([0.0 if u.name in values else u.low for u in self._nuisances])
        high = np.array([0.0 if u.name in values else u.high for u in self._nuisances])
        free = np.ones(found.size, dtype=bool)
        # what goes beyond its bound stays there, and the others are solved for again
        while (beyond := free & ((found < low) | (found > high))).any():
            found[beyond] = np.clip(found[beyond], low[beyond], high[beyond])
            free &= ~beyond
            if not free.any():
                break
            rest = wanted[free] - information[np.ix_(free, ~free)] @ found[~free]
            found[free] = np.linalg.solve(information[np.ix_(free, free)], rest)
        rest = rows - slopes @ found
        if not self._elsewhere.any():
            return rest, found
        own = slopes[:, self._elsewhere]
        priors = np.array([u.prior for u in self._nuisances])[self._elsewhere]
        theirs = np.linalg.solve(own.T @ own + np.diag(priors**-2), own.T @ rest)
        found[self._elsewhere] = np.clip(theirs, low[self._elsewhere], high[self._elsewhere])
        return rest - own @ found[self._elsewhere], found

    def _judged(self, series: Mapping[str, Array], values: Mapping[str, float]) -> Array:
        """Rows of a model's series: residuals, then how far the nuisances are from what is believed of them."""
        raw = {n: self.measured[n] - series[n] for n in self.names}
        rows, nuisances = self.eliminated(self.whitened(raw)[0], values)
        return np.concatenate([rows, [v / u.prior for u, v in zip(self._nuisances, nuisances, strict=True)]])

    def whole(self) -> AbstractContextManager[None]:
        """Within this, fits use what is held out as well: for the last estimate, once all is decided."""
        return self._using(np.ones_like(self._data))

    def first(self, counts: Mapping[str, int]) -> AbstractContextManager[None]:
        """Within this, fits use the first samples alone: name -> how many."""
        early = [np.arange(self.measured[n].size) < counts[n] for n in self.names]
        return self._using(self._data & np.concatenate(early))

    def fitted_alone(self) -> AbstractContextManager[None]:
        """Within this the model need give nothing of signals of which no sample is fitted; their rows say nothing."""
        ends = np.cumsum([self.measured[n].size for n in self.names])
        parts = np.split(self._data, ends[:-1])
        return self.sparing([n for n, part in zip(self.names, parts, strict=True) if not part.any()])

    @contextmanager
    def _using(self, data: NDArray[np.bool_]) -> Iterator[None]:
        before, self._data = self._data, data
        self.share(self._nuisances, self._slopes)
        try:
            yield
        finally:
            self._data = before
            self.share(self._nuisances, self._slopes)

    # Hypotheses

    def residuals(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Measured minus model, nuisances eliminated, each signal in its unit."""
        series = self.model(values)
        raw = {n: self.measured[n] - series[n] for n in self.names}
        _, nuisances = self.eliminated(self.whitened(raw)[0], values)
        more = nuisances - self._about(values)
        return {n: raw[n] - more @ self._slopes[n] for n in self.names}

    def nuisances(self, values: Mapping[str, float]) -> dict[str, float]:
        """The nuisances that go with values, each in its own unit."""
        series = self.model(values)
        raw = {n: self.measured[n] - series[n] for n in self.names}
        _, found = self.eliminated(self.whitened(raw)[0], values)
        return {u.name: float(v) for u, v in zip(self._nuisances, found, strict=True)}

    def freed(self, values: Mapping[str, float]) -> dict[str, float]:
        """Log-likelihood that each nuisance would gain were nothing believed of it: a step of Newton, others following."""
        series = self.model(values)
        _, inside, information = self._project()
        rows, found = self.eliminated(
            self.whitened({n: self.measured[n] - series[n] for n in self.names})[0], values
        )
        pulls = inside.T @ rows[self._data]
        follow = np.array(
            [u.low < v < u.high for u, v in zip(self._nuisances, found, strict=True)], dtype=bool
        )
        gains = {}
        for k, unknown in enumerate(self._nuisances):
            if unknown.name in values:
                continue
            others = follow.copy()
            others[k] = False
            cross = information[others, k]
            curve = information[k, k] - unknown.prior**-2
            curve -= float(cross @ np.linalg.solve(information[np.ix_(others, others)], cross))
            told = curve > 1e-9 * information[k, k]
            gains[unknown.name] = 0.5 * float(pulls[k]) ** 2 / curve if told else 0.0
        return gains

    def rows(self, values: Mapping[str, float]) -> Array | None:
        """(n + k,) whitened residuals, nuisances eliminated, then these over their priors; None where the model fails."""
        try:
            series = self.model(values)
        except SimulationError as error:
            if str(error) not in self.failures:
                self.failures.append(str(error))
            return None
        if not all(np.isfinite(series[n]).all() for n in self.names):
            return None
        rows = self._judged(series, values)
        return None if np.isnan(rows).any() else np.clip(rows, -LARGEST, LARGEST)

    def log_likelihood(self, rows: Array, values: Mapping[str, float], unknowns: Sequence[Unknown]) -> float:
        """Of the fitted part, up to a constant."""
        inside = rows[self.mask]
        beliefs = sum(((values[u.name] - u.centre) / u.prior) ** 2 for u in unknowns if np.isfinite(u.prior))
        return -0.5 * (float(inside @ inside) + beliefs)

    def fit(
        self,
        unknowns: Sequence[Unknown],
        start: Mapping[str, float],
        evaluations: int = EVALUATIONS,
        difference: float = DIFFERENCE,
        robust: bool = False,
        roughly: Array | None = None,
    ) -> Fit | None:
        """The best values of a hypothesis from a start; None where its model cannot be run there.

        A `robust` fit bears errors beyond the usual size of those of its start (Cauchy loss): where a law bends it may lead
        out of an optimum in which least squares end. Its likelihood is that of the values all the same. A fit that begins
        with slopes that are known `roughly` learns from its own steps how they change (Broyden, Math. Comp. 19, 1965); only
        where these lead nowhere it takes them anew.

        Args:
            unknowns: what is fitted.
            start: the values of all.
            evaluations: at most.
            difference: over which slopes are taken, in scales.
            robust: bear large errors.
            roughly: (n + k, u) slopes of the rows of `slopes` about the start, to do with few runs.
        """
        whole = dict(start)
        if not unknowns:
            rows = self.rows(whole)
            if rows is None:
                return None
            return Fit(whole, np.zeros((0, 0)), (), rows, self.log_likelihood(rows, whole, ()))
        low = np.array([u.low / u.scale for u in unknowns])
        high = np.array([u.high / u.scale for u in unknowns])
        begin = np.array([u.within(start[u.name]) / u.scale for u in unknowns])
        begin = np.clip(
            begin, low + 1e-9 * (high - low).clip(max=1.0), high - 1e-9 * (high - low).clip(max=1.0)
        )
        first = self.rows(whole | self._named(unknowns, begin))
        if first is None:
            return None

        def beliefs(x: Array) -> Array:
            return np.array(
                [
                    (x[k] * u.scale - u.centre) / u.prior
                    for k, u in enumerate(unknowns)
                    if np.isfinite(u.prior)
                ]
            )

        def rows_of(x: Array) -> Array:
            rows = self.rows(whole | self._named(unknowns, x))
            return np.full(self.mask.size, FAILED) if rows is None else rows

        best = begin, np.inf

        def rows_at(x: Array) -> Array:
            return np.concatenate([rows_of(x)[self.mask], beliefs(x)])

        def cost(x: Array) -> Array:
            nonlocal best
            if self.hurried():
                raise _HurryError
            found = rows_at(x)
            if (size := float(found @ found)) < best[1]:
                best = x.copy(), size
            return found

        def slopes(x: Array, of: Callable[[Array], Array] = cost) -> Array:
            here = of(x)
            return np.stack(
                [(of(moved) - here) / step for moved, step in self._moves(x, low, high, difference)], axis=1
            )

        usual = max(float(np.median(np.abs(first[self.mask]))), 1.0)

        def searched(at: Array, steep: Callable[[Array], Array], ends: float) -> Array:
            found = least_squares(
                cost,
                at,
                steep,
                bounds=(low, high),
                method="trf",
                loss="cauchy" if robust else "linear",
                f_scale=usual if robust else 1.0,
                max_nfev=evaluations,
                xtol=1e-4,
                ftol=ends,
            )
            return np.asarray(found.x)

        with self.fitted_alone():
            try:
                if roughly is None:
                    at = searched(begin, slopes, 1e-7)
                    steep = slopes(at)
                else:
                    held = [k for k, u in enumerate(unknowns) if np.isfinite(u.prior)]
                    sure = np.array([u.scale / u.prior if np.isfinite(u.prior) else 0.0 for u in unknowns])
                    learnt = _Learnt(cost, begin, np.concatenate([roughly[self.mask], np.diag(sure)[held]]))
                    before = best[1]
                    at = searched(begin, learnt, ROUGHLY)
                    if best[1] > (1.0 - ROUGHLY) * before:  # the slopes led nowhere
                        learnt = _Learnt(cost, at, slopes(at))
                        at = searched(at, learnt, ROUGHLY)
                    steep = learnt.slopes
            except _HurryError:
                at, steep = best[0], slopes(best[0], rows_at)
        values = whole | self._named(unknowns, at)
        rows = rows_of(at)
        return Fit(
            values,
            self._covariance(unknowns, at, rows, steep),
            tuple(unknowns),
            rows,
            self.log_likelihood(rows, values, unknowns),
        )

    def slopes(self, fit: Fit, difference: float = DIFFERENCE * FINE) -> Array:
        """(n + k, u) slopes of a fit's rows in each of its unknowns over its scale, those of one at its bound being zero.

        What is held out has rows of zeros, so that the slopes are those of what was fitted.
        """
        low = np.array([u.low / u.scale for u in fit.unknowns])
        high = np.array([u.high / u.scale for u in fit.unknowns])
        at = np.array([fit.values[u.name] / u.scale for u in fit.unknowns])
        found = np.zeros((self.mask.size, at.size))
        with self.fitted_alone():
            for k, (moved, step) in enumerate(self._moves(at, low, high, difference)):
                rows = self.rows(fit.values | self._named(fit.unknowns, moved))
                if rows is not None and low[k] + BOUND < at[k] < high[k] - BOUND:
                    found[self.mask, k] = (rows - fit.rows)[self.mask] / step
        return found

    def changed(self, values: Mapping[str, float], others: Mapping[str, float]) -> Array:
        """(n,) what the model's series have more with other values, made white; of the part that fits use."""
        here, there = self.model(values), self.model(others)
        return self.whitened({n: there[n] - here[n] for n in self.names})[0][self._data]

    def apart(self, changes: Mapping[str, Mapping[str, Array]], least: float) -> list[str]:
        """Names of the changes that show by more than `least` in log-likelihood beside all others, in the order given.

        Of changes that do the same the largest is kept (QR with pivots: Businger and Golub 1965), and of equal ones the
        first: which of them is a rounding error larger says nothing, and changes with the unit of the log.

        Args:
            changes: name -> what it changes of each signal.
            least: log-likelihood that a change gains at least where it is there.
        """
        white = {n: self.whitened(own)[0][self._data] for n, own in changes.items()}
        names = [n for n, own in white.items() if np.isfinite(own).all()]
        if not names:
            return []
        columns = np.stack([white[n] for n in names], axis=1)
        scale = float(np.abs(columns).max()) or 1.0
        left = columns / scale
        kept = set[str]()
        while len(kept) < len(names):
            sizes = np.sum(left**2, axis=0)
            k = int(np.argmax(sizes >= (1.0 - EQUAL) * sizes.max()))
            if 0.5 * sizes[k] * scale**2 <= least:
                break
            kept.add(names[k])
            for _ in range(2):  # a second time takes what rounding left of the first
                way = left[:, k] / np.sqrt(sizes[k])
                others = np.arange(len(names)) != k
                left[:, others] -= np.outer(way, way @ left[:, others])
            left[:, k] = 0.0
        return [n for n in names if n in kept]

    def spare(
        self, fit: Fit, without: Mapping[str, float], least: float
    ) -> list[tuple[str, dict[str, float]]]:
        """Unknowns of a fit that may be as they are `without`, the least missed first, the others following; by its slopes.

        Each adds less than `least` to the log-likelihood that is lost. With each stand the values that all unknowns then
        have, those before it being dropped, too.
        """
        slopes = self.slopes(fit)
        sizes, ways = np.linalg.eigh(slopes.T @ slopes)
        # of what the data do not tell apart nothing is known; where they tell nothing at all the inverse stays a number
        least_known = 1e-9 * max(float(sizes[-1]), float(np.sqrt(np.finfo(np.float64).tiny)))
        covariance = (ways / np.maximum(sizes, least_known)) @ ways.T
        away = np.array([(fit.values[u.name] - without[u.name]) / u.scale for u in fit.unknowns])
        dropped: list[int] = []
        found: list[tuple[str, dict[str, float]]] = []
        lost = 0.0
        while len(dropped) < away.size:
            losses = []
            for k in set(range(away.size)) - set(dropped):
                out = [*dropped, k]
                losses.append(
                    (0.5 * float(away[out] @ np.linalg.solve(covariance[np.ix_(out, out)], away[out])), k)
                )
            more, k = min(losses)
            if more - lost > least:
                break
            lost, dropped = more, [*dropped, k]
            follow = covariance[:, dropped] @ np.linalg.solve(
                covariance[np.ix_(dropped, dropped)], away[dropped]
            )
            values = {
                u.name: u.within(fit.values[u.name] - u.scale * float(f))
                for u, f in zip(fit.unknowns, follow, strict=True)
            }
            found.append((fit.unknowns[k].name, values))
        return found

    @staticmethod
    def _named(unknowns: Sequence[Unknown], x: Array) -> dict[str, float]:
        return {u.name: float(v) * u.scale for u, v in zip(unknowns, x, strict=True)}

    @staticmethod
    def _moves(x: Array, low: Array, high: Array, difference: float) -> list[tuple[Array, float]]:
        found = []
        for k in range(x.size):
            step = difference if x[k] + difference <= high[k] else -difference
            if x[k] + step < low[k]:  # a range narrower than that: half of it, to where there is room
                half = 0.5 * (high[k] - low[k])
                step = (half if x[k] <= low[k] + half else -half) or difference
            moved = x.copy()
            moved[k] += step
            found.append((moved, step))
        return found

    def _covariance(self, unknowns: Sequence[Unknown], x: Array, rows: Array, slopes: Array) -> Array:
        """Sandwich over the windows that were fitted, never smaller than what white noise gives."""
        scales = np.array([u.scale for u in unknowns])
        gram = slopes.T @ slopes
        inverse = np.linalg.pinv(gram, rcond=1e-12, hermitian=True)
        count = int(self.mask.sum())
        inside, numbers = rows[self.mask], self.windows[self.mask]
        scores = np.stack(
            [np.bincount(numbers, weights=slopes[:count, k] * inside) for k in range(len(unknowns))]
        )
        sandwich = inverse @ (scores @ scores.T) @ inverse
        own = np.sqrt(np.maximum(np.diag(sandwich), np.diag(inverse)))
        plain = np.sqrt(np.maximum(np.diag(sandwich), 1e-300))
        return np.asarray(sandwich * np.outer(own / plain, own / plain) * np.outer(scales, scales))

    def held_out(self, richer: Array, poorer: Array) -> HeldOutGain:
        """What one hypothesis gains over another on the windows that neither was fitted to; rows (n + k,) of both.

        How far each bends what is believed of the nuisances counts as well: else trusted numbers at their limits pass for a
        fault, and no window tells.
        """
        out = ~self.mask
        found = gain_between(richer[out], poorer[out], self.windows[out])
        return replace(found, gain=found.gain + self.pull(poorer) - self.pull(richer))

    def pull(self, rows: Array) -> float:
        """Log-likelihood that rows (n + k,) lose for how far they bend what is believed of the fitted nuisances."""
        return 0.5 * float(np.sum(rows[self._data.size :][~self._elsewhere] ** 2))
