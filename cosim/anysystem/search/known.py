"""A group before any cause is looked for: its run as it is, noise, nuisances, and what may be wrong in it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import (
    PARAMETER,
    Action,
    Reach,
    moderate,
    off,
    sides,
    starts,
    unknowns,
)
from cosim.anysystem.model import DRIVE, HOLD, SHIFT, GroupModel, place
from cosim.anysystem.readings import Grid, Stale, grid_of, stale_of
from cosim.anysystem.search.finding import Candidate, Trust, parameter
from cosim.compare.metrics import white_noise
from cosim.diagnosis.budget import Budget
from cosim.errors import SimulationError
from cosim.inference.freeform import Explained, explained
from cosim.inference.noise import Noise, quietest
from cosim.inference.problem import ABOUT, DIFFERENCE, Fit, Problem
from cosim.inference.unknowns import Unknown
from cosim.ssp.system import Port
from cosim.system.effects import EFFECTS

Array = NDArray[np.float64]

ROUNDED = 0.1  # of a step: smaller noise of a rounded reading is not believed: little is left, and at its edges only
LEAST = 1e-3  # of a signal's spread: two programs that integrate the same model differ by that
SIZE = 2e-3  # of a signal's spread: what is smaller does not matter to anybody
SOLVERS = 1.25  # times the error of the model's solvers: what is smaller may be theirs
TOLD = 0.05  # share of a residual's variance that inputs must tell before it counts as systematic
UNTOLD = 0.025  # of a signal's spread, and
LOUD = 3.0  # times its white noise: a residual beyond both is no noise even if no input tells it
MOST_COARSE = 0.1  # of a reading's spread: what changes more with half the step is another model
PARTS = 8  # of a log, in each of which a drive may be off by the mean of its reading's noise
KEPT_ON = 0.05  # of a response: so much of it at the end of the log is not forgotten
AGREES = 1e-3  # of a log-likelihood: two fits that differ by less ended in one place
NOTHING = 0.01  # log-likelihood: a number that changes no more is not told
RUNAWAY = 1e9  # spreads of a signal: a model that a small change moves so far is unstable there
DECADES = 9  # of an FMU's unit: from nano to giga
EARLY = 1.0  # samples, at most
FAR_MORE = 20.0  # log-likelihood: two ways to hand inputs over differ by less than 1 for each input where slopes hold
FAR_LESS = (
    0.5  # of what is left: a hidden fault seems to leave a little less (0.995 of it), contacts leave 1e-4
)
SURE = 3.0  # deviations of a trusted parameter: beyond them it is a cause
# of a parameter's scale, a fifth of its size: as far as slopes say how it follows a cause
SLOPES_REACH = 1.0
FOLLOWING_STEPS = 8  # evaluations of causes and of the parameters that follow, together
SETTLED_STEPS = 4  # evaluations of the causes beside these
JITTER = 0.7  # samples, prior of the moment at which an input acts or an output is read


class Known:
    """What a group does as it is, and what may be wrong in it.

    Attributes:
        model, problem: the group, and its readings held against it.
        budget: the time that is allowed.
        exclude: effects that are no candidates.
        trusted: parameters of the group -> (value, relative deviation).
        free: those that are fitted with every cause -> value.
        base: values of the model without causes.
        null: the group without causes.
        spreads: signal -> standard deviation of its reading.
        scales: trusted or free parameter -> its size.
        differs: signal -> RMS by which two runs of the same differ.
        read: causes that the readings show by themselves.
        slopes: trusted parameter -> what a deviation of it changes.
        wide, estimated: the free parameters, and what they came out as (value, standard deviation).
    """

    def __init__(
        self,
        model: GroupModel,
        trust: Trust,
        exclude: Sequence[str] = (),
        budget: Budget | None = None,
    ) -> None:
        """Run the group as it is.

        Args:
            model: the group.
            trust: what is known of the system's parameters.
            exclude: effects that are no candidates.
            budget: the time it may take; unlimited by default.

        Raises:
            SimulationError: it cannot be run at all.
        """
        self.model, self.exclude = model, tuple(exclude)
        self.budget = budget or Budget()
        segments = model.segments
        inside = set(model.group.components)
        self.trusted = {n: t for n, t in trust.trusted.items() if n.partition(".")[0] in inside}
        self.free = {n: v for n, v in trust.free.items() if n.partition(".")[0] in inside}
        measured, fitted, windows, least = {}, {}, {}, {}
        self.spreads = {}
        for signal, _ in model.group.judged:
            judging = model.judging(signal)
            whole = model.measured(signal)
            spread = max(float(np.std(whole)), 1e-9 * max(1.0, float(np.abs(whole).max())))
            self.spreads[signal] = spread
            for k in judging:
                segment, name = segments[k], place(signal, k)
                measured[name] = segment.signals[signal]
                fitted[name], windows[name] = segment.fitted, segment.windows
                least[name] = max(quietest(whole), LEAST * spread)
        self.problem = Problem(measured, fitted, windows, model, least)
        self.problem.missing = {
            place(s, k): segments[k].missing[s]
            for s, _ in model.group.judged
            for k in model.judging(s)
            if s in segments[k].missing
        }
        self.problem.hurried = lambda: self.budget.over
        self.problem.sparing = model.sparing
        self.base: dict[str, float] = {PARAMETER + "|" + n: v for n, v in self.free.items()}
        with model.runs.exact():
            first = model({**self.base})  # raises where the system itself cannot be run
            self._check(first)
            self.scales = self._scales(first)
            model.trusted = {n: (v, d * self.scales[n]) for n, (v, d) in self.trusted.items()}
            if not model.differs:
                model.runs.forget()
                again = model({**self.base})
                model.differs = {s: self._difference(first, again, s) for s, _ in model.group.judged}
                model.coarse = self._coarse(first)
        self.differs = model.differs
        for name in least:
            signal = name.partition("#")[0]
            self.problem.least[name] = max(least[name], self.differs[signal], model.coarse.get(signal, 0.0))
        self.reaches = self._reaches()
        self.read = self._read(first)
        self._learn_white()
        self.slow = self._slow(first)
        self.slopes: dict[str, dict[str, Array]] = {}  # what a deviation of each trusted parameter changes
        self.estimated: dict[str, tuple[float, float]] = {}
        self.wide: list[Unknown] = []  # the free parameters
        self.null = self._null()

    def _read(self, first: Mapping[str, Array]) -> dict[Action, Grid | Stale]:
        """What the readings show by themselves; stale samples are then modelled."""
        found: dict[Action, Grid | Stale] = {}
        for signal, port in self.model.group.judged:
            judging, names = self.model.judging(signal), self.model.places(signal)
            logs = [self.model.segments[k] for k in judging]
            series = [log.reading(signal) for log in logs]
            grid = grid_of(series)
            moved = [log.at_stamps(first[n]) for log, n in zip(logs, names, strict=True)]
            stale = None if grid else stale_of(series, moved)
            if grid is not None:
                self.model.steps[signal] = grid.step
                for name in names:
                    self.problem.least[name] = max(self.problem.least[name], ROUNDED * grid.step)
                if "port.quantisation" not in self.exclude:
                    found[Action("port.quantisation", port, "sensor")] = grid
            if stale is not None:
                own = [log.on_grid(held) for log, held in zip(logs, stale.held, strict=True)]
                self.model.held[signal] = dict(zip(judging, own, strict=True))
                if "port.dropout" not in self.exclude:
                    found[Action("port.dropout", port, "sensor")] = stale
        return found

    def _scales(self, first: Mapping[str, Array]) -> dict[str, float]:
        """Size of each trusted or free parameter: its value, or of one that is 0 a decade that moves the model."""
        values = {n: v for n, (v, _) in self.trusted.items()} | self.free
        return {n: abs(v) or self._decade(n, first) for n, v in values.items()}

    def _decade(self, name: str, first: Mapping[str, Array]) -> float:
        """Power of ten of a parameter that moves the model most nearly as much as a reading varies; 1 where none does."""
        tried = dict[int, float]()
        power = 0
        while (
            power not in tried and abs(power) <= DECADES and not (power > 2 and min(tried.values()) == np.inf)
        ):
            try:
                moved = self.model({**self.base, f"{PARAMETER}|{name}": 10.0**power})
                change = max(self._difference(first, moved, s) / self.spreads[s] for s in self.spreads)
            except SimulationError:
                change = np.inf
            tried[power] = abs(float(np.log(change))) if 0.0 < change < np.inf else np.inf
            power += 1 if change < 1.0 else -1
        best = min(tried, key=lambda p: tried[p])
        return 10.0**best if tried[best] < np.inf else 1.0

    def _difference(self, one: Mapping[str, Array], other: Mapping[str, Array], signal: str) -> float:
        """RMS by which two runs of the same differ: 0 for a system that is deterministic."""
        difference = self.model.whole(one, signal) - self.model.whole(other, signal)
        return float(np.sqrt(np.mean(difference**2)))

    def _coarse(self, first: Mapping[str, Array]) -> dict[str, float]:
        """RMS error that the model's own solvers make of each signal; nothing where that cannot be asked."""
        model, h = self.model, max(s.h for s in self.model.segments)
        units = dict.fromkeys(unit for own in model.cuts for unit in own.units)
        # what goes round within a loop comes a step late: that is no solver's error
        if any(len(unit.components) > 1 or not model.runs.can_halve(unit, h) for unit in units):
            return {}
        try:
            with model.runs.finer():
                fine = model({**self.base})
        except SimulationError:
            return {}
        # half the step leaves half the error of a solver of first order, a hundredth of the tolerance hardly any
        inside = model.group.components
        part = 1.0 if any(model.system.components[c].fmu.tolerance for c in inside) else 2.0
        found = {s: part * self._difference(first, fine, s) for s, _ in model.group.judged}
        # of a model far beyond its reading, as in another unit, the error falls with all that brings it there
        ranges = {s: float(np.std(model.whole(first, s))) for s in found}
        shares = {s: min(1.0, self.spreads[s] / max(ranges[s], 1e-300)) for s in found}
        # and of one that halves its steps and is another model, all would pass for its solvers' error
        return {
            s: min(shares[s] * size, MOST_COARSE * self.spreads[s])
            for s, size in found.items()
            if np.isfinite(size)
        }

    def matters(self, signal: str) -> float:
        """RMS of what matters: less is nobody's concern, or the error of the model's own solvers."""
        return max(SIZE * self.spreads[signal], SOLVERS * self.model.coarse.get(signal, 0.0))

    def _check(self, series: Mapping[str, Array]) -> None:
        for name, values in series.items():
            if not np.isfinite(values).all():
                raise SimulationError(
                    f"'{name.partition('#')[0]}' is not a finite number in the model's own run"
                )

    def _reaches(self) -> dict[str, Reach]:
        """Reach of each place where an effect may act, as the model has it."""
        found: dict[str, list[Array]] = {}
        for k in range(len(self.model.segments)):
            for name, series in self.model.ports(self.base, k).items():
                if name.startswith(("pure:", "in:")):
                    found.setdefault(name, []).append(series)
        h = self.model.segments[0].h
        return {name: Reach.of(np.concatenate(parts), h) for name, parts in found.items()}

    def reach(self, action: Action) -> Reach:
        """What the signal reaches on which an effect acts."""
        return self.reaches[f"{'in' if action.where == 'input' else 'pure'}:{action.port}"]

    def candidates(self) -> list[Action]:
        """Everything that may be wrong in this group."""
        group, found = self.model.group, []
        found += [parameter(n) for n in self.trusted]
        driven = {d.port for d in group.drives}
        judged = {p for _, p in group.judged}
        inputs = [
            p
            for p in [*(d.port for d in group.drives), *(w.target for w in group.inner)]
            if not self.model.looped(p)
        ]
        outputs = [
            p
            for p in [*(p for _, p in group.judged), *(w.source for w in group.inner)]
            if not self.model.looped(p)
        ]
        fans = [w.source for w in group.inner]
        for port in dict.fromkeys(inputs):
            if port in driven or not self._only_wire(port, fans, judged):
                found += [Action(e, port, "input") for e in self._at("input", port)]
        for port in dict.fromkeys(outputs):
            found += [Action(e, port, "output") for e in self._at("output", port)]
        for signal, port in group.judged:
            found.append(Action("port.drift", port, "sensor"))
            if (
                signal in self.model.own
            ):  # what the reading drives is here: it knows whether the reading alone is off
                found += [Action(e, port, "sensor") for e in self._at("sensor", port)]
        real = {
            p for p in dict.fromkeys(a.port for a in found) if self.model.system.variable(p).kind == "Real"
        }
        return [a for a in found if a.effect not in self.exclude and a.port in real]

    def _at(self, where: str, port: Port) -> list[str]:
        """Effects that may act at a place: those of any signal, and what can be run in a loop there."""
        loops = self.model.loops.get(f"{port}|{where}", {})
        return [
            e for e, effect in EFFECTS.items() if not effect.reading and (not effect.looped or e in loops)
        ]

    def _only_wire(self, port: Port, fans: Sequence[Port], judged: set[Port]) -> bool:
        """Whether an unmeasured wire into this port is the only one of its source: then both of its ends are one place."""
        source = next(w.source for w in self.model.group.inner if w.target == port)
        return fans.count(source) == 1 and source not in judged

    def numbers(self, action: Action) -> list[Unknown]:
        """Unknowns of a cause."""
        if action.effect == PARAMETER:
            name = str(action.port)
            value = self.trusted[name][0]
            variable = self.model.system.variable(action.port)
            size = self.scales[name]
            low, high = max(variable.low, value - 20.0 * size), min(variable.high, value + 20.0 * size)
            if value > 0.0:
                low = max(low, 1e-3 * value)  # a sign that turns is another model
            return [Unknown(f"{PARAMETER}|{name}", low, high, 0.2 * size)]
        return unknowns(action, self.reach(action))

    def moderate(self, action: Action) -> dict[str, float]:
        """A moderate size of it; nothing for what a reading shows by itself."""
        if action.effect == PARAMETER:
            value, deviation = self.trusted[str(action.port)]
            size = max(0.2, 5.0 * deviation) * self.scales[str(action.port)]
            (unknown,) = self.numbers(action)
            return {unknown.name: unknown.within(value + size)}
        return moderate(action, self.reach(action))

    def sides(self, action: Action) -> dict[str, list[float]]:
        """Numbers of a cause that act on one side alone, each with where it may begin."""
        return {} if action.effect == PARAMETER else sides(action, self.reach(action))

    def begins(self, action: Action) -> list[dict[str, float]]:
        """Where its search begins."""
        if action.effect == PARAMETER:
            value = self.trusted[str(action.port)][0]
            size = self.scales[str(action.port)]
            (unknown,) = self.numbers(action)
            near = dict.fromkeys(unknown.within(value + part * size) for part in (0.2, -0.2, 0.8))
            return [{unknown.name: v} for v in near if v != value]
        return starts(action, self.reach(action))

    def _learn_white(self) -> None:
        """A first idea of the noise: what is independent from sample to sample."""
        for name, values in self.problem.measured.items():
            read = values[~self.problem.missing[name]] if name in self.problem.missing else values
            self.problem.noise[name] = Noise(max(white_noise(read), self.problem.least[name]) ** 2)

    def _null(self) -> Candidate:
        problem = self.problem
        if self.free:
            wide = self.wide
            for name, value in self.free.items():
                variable = self.model.system.variable(Port(*name.split(".", 1)))
                size = self.scales[name]
                low, high = max(variable.low, value - 50.0 * size), min(variable.high, value + 50.0 * size)
                wide.append(
                    Unknown(
                        f"{PARAMETER}|{name}",
                        max(low, 1e-3 * value) if value > 0.0 else low,
                        high,
                        0.2 * size,
                    )
                )
            factors = (1.0, 0.5, 2.0)
            scaled = [{u.name: u.within(f * self.base[u.name]) for u in wide} for f in factors]
            best = self.best_of(wide, [self.base | own for own in scaled])
            if best is not None:
                self.base = best.values
                self.estimated = {
                    n: (best.values[f"{PARAMETER}|{n}"], best.deviation(f"{PARAMETER}|{n}"))
                    for n in self.free
                }
        self.share(self.base)
        self._hold()
        fit = problem.fit((), self.base)
        if fit is None:
            raise SimulationError(
                problem.failures[0] if problem.failures else "the model gives no finite numbers"
            )
        return Candidate((), self.followed(fit, ()), 0.0)

    def follower(self, name: str) -> Unknown:
        """A trusted parameter as what it is beside the causes: a number with a prior."""
        variable = self.model.system.variable(Port(*name.split(".", 1)))
        value, relative = self.trusted[name]
        size = relative * self.scales[name]
        low, high = max(variable.low, value - SURE * size), min(variable.high, value + SURE * size)
        return Unknown(f"{PARAMETER}|{name}", low, high, size, size, value)

    def _far(self, values: Mapping[str, float], moves: Mapping[str, float]) -> list[Unknown]:
        """Trusted parameters that follow values further than slopes say how."""
        found = []
        for name in self.trusted:
            unknown, own = self.follower(name), self.numbers(parameter(name))[0]
            if own.name in moves and own.name not in values:
                more = moves[own.name] - values.get(ABOUT + own.name, 0.0)
                if abs(more) * unknown.prior > SLOPES_REACH * own.scale:
                    found.append(unknown)
        return found

    def followed(self, fit: Fit, free: Sequence[Unknown]) -> Fit:
        """A fit with the model's parameters at their own best beside its causes, where slopes do not reach so far.

        Beside every cause the free parameters follow by their slopes, and so do the trusted ones as far as they are trusted.
        Where a cause moves one of them by much, as a delay does a time constant that has stood in for it, what slopes give
        is no model.

        Args:
            fit: a fit of causes.
            free: what was fitted of them.
        """
        problem, wide = self.problem, self.wide
        if not (wide or self.trusted) or self.budget.over:
            return fit
        moves = problem.nuisances(fit.values)
        follow = {u.name: moves.get(f"free:{u.name}", 0.0) for u in wide}
        trusted = self._far(fit.values, moves)
        if not trusted and all(abs(follow[u.name]) <= SLOPES_REACH * u.scale for u in wide):
            return fit
        every = [*free, *wide, *trusted]
        beside = {u.name for u in trusted}
        kept = [
            u.name
            for u in problem.nuisances_shared
            if u.name not in beside and not u.name.startswith("free:")
        ]
        moved = {u.name: u.within(fit.values[u.name] + follow[u.name]) for u in wide}
        moved |= {u.name: u.within(u.centre + moves[u.name] * u.prior) for u in trusted}
        here = {u.name: u.within(u.centre + fit.values.get(ABOUT + u.name, 0.0) * u.prior) for u in trusted}
        with problem.sharing(kept):
            found = [(start, problem.rows(start)) for start in (fit.values | here, fit.values | moved)]
            begins = [
                Fit(
                    dict(start),
                    np.zeros((0, 0)),
                    tuple(every),
                    rows,
                    problem.log_likelihood(rows, start, every),
                )
                for start, rows in found
                if rows is not None
            ]
            if not begins:
                return fit
            begin = max(begins, key=lambda f: f.log_likelihood)
            roughly = problem.slopes(begin, DIFFERENCE)
            best = problem.fit(every, begin.values, FOLLOWING_STEPS, roughly=roughly)
        if best is None:
            return fit
        values = {n: v for n, v in best.values.items() if n not in beside}
        values |= {ABOUT + u.name: (best.values[u.name] - u.centre) / u.prior for u in trusted}
        again = problem.fit(free, values, SETTLED_STEPS)
        return fit if again is None else again

    def _hold(self) -> None:
        """Begin with inputs that are held over each sample where that alone makes far more of a log.

        The moment at which an input acts is a nuisance with a slope. Where contacts and other switches within a component
        make half a sample more than the slope of it, the end of its range that controllers have is tried as it is.
        """
        held = {
            f"{HOLD}:{d.signal}>{d.port}": -0.5
            for d in self.model.group.drives
            if self.model.system.variable(d.port).kind == "Real"
        }
        before, after = self.problem.rows(self.base), self.problem.rows({**self.base, **held})
        if not held or before is None or after is None:
            return
        inside = self.problem.mask
        left, now = float(np.sum(before[inside] ** 2)), float(np.sum(after[inside] ** 2))
        if now < FAR_LESS * left and 0.5 * (left - now) > FAR_MORE:
            self.base |= held
            self.share(self.base)

    def share(self, at: Mapping[str, float]) -> None:
        """Slopes of the nuisances around some values."""
        model, problem = self.model, self.problem
        here = model(at)
        nuisances, rows = [], []

        def add(unknown: Unknown, moved: Mapping[str, Array], step: float) -> None:
            slope = {n: (moved[n] - here[n]) / step for n in problem.names}
            if self._bounded(slope):
                nuisances.append(unknown)
                rows.append(slope)

        def add_each(unknown: Unknown, slope: Mapping[str, Array]) -> None:
            for own, part in self._each(unknown, slope) if self._bounded(slope) else ():
                nuisances.append(own)
                rows.append(part)

        for drive in model.group.drives:
            name = f"{SHIFT}:{drive.signal}>{drive.port}"
            # half a sample: the slope is then exact for an input that is held over each step. What is true or false, or a
            # whole number, acts from its sample on or an interval earlier, where what is read at the same sample has seen it
            real = model.system.variable(drive.port).kind == "Real"
            try:
                moved = [model({**at, name: s}) for s in ((0.5, -0.5) if real else (1.0, 0.0))]
            except SimulationError:
                continue
            slope = {n: moved[0][n] - moved[1][n] for n in problem.names}
            add_each(Unknown(name, -EARLY, EARLY, 1.0, JITTER), slope)
        for signal, quantity in model.drives.items():
            for i in range(len(quantity.slopes)):
                name = f"{DRIVE}:{signal}:{i}"
                try:
                    moved_one = model({**at, name: 1.0})
                except SimulationError:
                    continue
                add(Unknown(name, -SURE, SURE, 1.0, 1.0), moved_one, 1.0)
        for signal, _ in model.group.judged:
            if signal in model.steps:
                continue  # a step hides by far more than what a sample's moment makes out
            shifted = {
                n: np.gradient(here[n]) * ~problem.missing.get(n, np.zeros(here[n].size, dtype=np.bool_))
                if n.partition("#")[0] == signal
                else np.zeros_like(here[n])
                for n in problem.names
            }
            add_each(Unknown(f"{SHIFT}:{signal}", -EARLY, EARLY, 1.0, JITTER), shifted)
        for name, (value, deviation) in self.trusted.items():
            key = f"{PARAMETER}|{name}"
            if any(k == key for k in at):
                continue  # it is a cause here
            step = deviation * self.scales[name]
            try:
                moved_one = model({**at, key: value + (at.get(ABOUT + key, 0.0) + 1.0) * step})
            except SimulationError:
                continue
            add(Unknown(key, -SURE, SURE, 1.0, 1.0), moved_one, 1.0)
            if nuisances and nuisances[-1].name == key:
                self.slopes[name] = rows[-1]
        for name in self.free:
            key = f"{PARAMETER}|{name}"
            step = 0.02 * (abs(at[key]) or self.scales[name])
            try:
                moved_one = model({**at, key: at[key] + step})
            except SimulationError:
                continue
            add(Unknown(f"free:{key}", -np.inf, np.inf, 1.0, 1e3), moved_one, 1.0)
        for unknown, slope in self.slow:
            nuisances.append(unknown)
            rows.append(slope)
        problem.share(
            nuisances, {n: np.array([r[n] for r in rows]).reshape(len(rows), -1) for n in problem.names}
        )

    def _bounded(self, slope: Mapping[str, Array]) -> bool:
        """Whether a model does not run away where it is moved: its slope says something."""
        return all(
            float(np.abs(s).max(initial=0.0)) < RUNAWAY * self.spreads[n.partition("#")[0]]
            for n, s in slope.items()
        )

    def _slow(self, first: Mapping[str, Array]) -> list[tuple[Unknown, dict[str, Array]]]:
        """Slow errors of what drives the group, as nuisances: what a component that integrates makes of them is no fault.

        A drive is off by no more than programs agree on, all along; and by the mean of its reading's noise in each part of
        the log, where the group does not forget it.
        """
        model, found = self.model, list[tuple[Unknown, dict[str, Array]]]()
        for drive in {d.signal: d for d in model.group.drives}.values():
            signal = drive.signal
            if model.system.variable(drive.port).kind != "Real":
                continue
            readings = [
                s.signals[signal]
                for s, own in zip(model.segments, model.cuts, strict=True)
                if any(d.signal == signal for d in own.drives)
            ]
            spread = float(np.std(np.concatenate(readings)))
            noise = max(white_noise(r) for r in readings)
            count = min(r.size for r in readings) / PARTS
            sizes = [(0.0, 1.0, LEAST * spread)]
            sizes += [
                (p / PARTS, (p + 1) / PARTS, noise / np.sqrt(count)) for p in range(PARTS) if noise > 0.0
            ]
            for number, (begin, end, size) in enumerate(sizes):
                if size <= 0.0:
                    continue
                # large enough to be seen in the digits of an FMU that controls its own step
                step = 0.02 * spread
                model.off[signal] = begin, end, step
                try:
                    moved = model({**self.base})
                except SimulationError:
                    break
                finally:
                    model.off.clear()
                slope = {n: (moved[n] - first[n]) / step for n in self.problem.names}
                if number == 1 and not self._kept(slope):
                    break
                unknown = Unknown(f"slow:{signal}:{number}", -SURE * size, SURE * size, size, size)
                found += self._each(unknown, slope)
        return found

    def _each(self, unknown: Unknown, slope: Mapping[str, Array]) -> list[tuple[Unknown, dict[str, Array]]]:
        """A nuisance with its slopes in each log by itself: when a logger reads, and how far a drive is off, differ."""
        count = len(self.model.segments)
        if count == 1:
            return [(unknown, dict(slope))]
        return [
            (
                replace(unknown, name=f"{unknown.name}#{k}"),
                {n: s if n.endswith(f"#{k}") else np.zeros_like(s) for n, s in slope.items()},
            )
            for k in range(count)
        ]

    @staticmethod
    def _kept(slope: Mapping[str, Array]) -> bool:
        """Whether what happened in the first part of a log is still there at its end."""
        return any(
            float(np.abs(s[-max(s.size // PARTS, 1) :]).mean()) > KEPT_ON * float(np.abs(s).max()) > 0.0
            for s in slope.values()
        )

    def off(self, action: Action) -> dict[str, float]:
        """Values at which a cause is none."""
        if action.effect == PARAMETER:
            return {f"{PARAMETER}|{action.port}": self.trusted[str(action.port)][0]}
        return off(action, self.reach(action))

    def nothing(self, actions: Sequence[Action]) -> dict[str, float]:
        """The same of several causes."""
        return {n: v for a in actions for n, v in self.off(a).items()}

    def left_out(self, what: str) -> None:
        """Keep for the answer that something was not tried."""
        self.budget.leave_out(self.model.group.name, what)

    def best_of(self, unknowns: Sequence[Unknown], starts: Sequence[dict[str, float]]) -> Fit | None:
        """The best fit of several numbers from these starts, each also by way of one that bears large errors.

        Where a law bends, as at a dead zone, and a model that integrates runs far away, least squares end where all errors
        are middling. A fit that lets some parts of a log be wrong finds the numbers that make the others right.
        """
        found: list[Fit] = []
        for at in starts:  # the first of fits that are as good stays the first
            if found and self.budget.over:
                break
            near = self.problem.fit(unknowns, at, 25, robust=True)
            begins = [at] if near is None else [at, near.values]
            found += [fit for v in begins if (fit := self.problem.fit(unknowns, v, 25)) is not None]
            found.sort(key=lambda f: -f.log_likelihood)
            top = found[0].log_likelihood if found else 0.0
            if len(found) > 1 and top - found[1].log_likelihood < 1.0 + AGREES * abs(top):
                break  # two ways lead there
        if not found:
            return None
        best = found[0]
        stated = dict[str, float]()
        for unknown in unknowns:  # one of which the data say nothing stays where it was
            moved = best.values | stated | {unknown.name: starts[0][unknown.name]}
            if self.at(moved) > best.log_likelihood - NOTHING:
                stated[unknown.name] = starts[0][unknown.name]
        return self.problem.fit(unknowns, best.values | stated, 1) if stated else best

    def at(self, values: Mapping[str, float]) -> float:
        """Log-likelihood of values; minus infinity where the model cannot be run."""
        with self.problem.fitted_alone():
            rows = self.problem.rows(values)
        return -np.inf if rows is None else self.problem.log_likelihood(rows, values, ())

    def white(self, signal: str) -> float:
        """White noise of a reading; what is rounded has at least that of its steps, and all what two runs differ by."""
        logs = [self.model.segments[k] for k in self.model.judging(signal)]
        readings = [log.signals[signal][log.known(signal)] for log in logs]
        return max(*(white_noise(r) for r in readings), self.problem.least[self.model.places(signal)[0]])

    def told(self, residual: Mapping[str, Array], candidate: Candidate) -> dict[str, Explained]:
        """What inputs and outputs of the group tell of a residual, signal by signal of the longest log."""
        found = {}
        for signal, _ in self.model.group.judged:
            judging = self.model.judging(signal)
            mixed = [
                k
                for k in judging
                if 0 < int(self.model.segments[k].fitted.sum()) < self.model.segments[k].count
            ]
            k = max(judging, key=lambda k: self.model.segments[k].count)
            if k not in mixed and mixed:
                k = mixed[0]
            segment = self.model.segments[k]
            before = self.model.before(signal, k)
            shown = {
                n.partition(":")[2]: v
                for n, v in self.model.ports(candidate.fit.values, k).items()
                if n.startswith(("in:", "out:")) and n in before
            }
            fitted = segment.fitted
            if k not in mixed:  # whole logs are held out: windows of this one are
                fitted = segment.windows % 3 != 1
            read = segment.known(signal)
            shown = {n: v[read] for n, v in shown.items()}
            own = residual[place(signal, k)][read]
            found[signal] = explained(own, shown, fitted[read], segment.windows[read], segment.h)
        return found

    def share_told(self, signal: str, item: Explained) -> float:
        """Share of a residual's variance that inputs tell on windows held out, where it is sure and matters; else 0."""
        share = 1.0 - (item.after / max(item.before, 1e-300)) ** 2
        return share if item.sure and share > TOLD and item.size > self.matters(signal) else 0.0

    def wrong(self, left: Mapping[str, Explained], residual: Mapping[str, Array]) -> dict[str, str]:
        """Signals whose residual is systematic, with words."""
        found = {}
        for signal, item in left.items():
            spread = self.spreads[signal]
            if share := self.share_told(signal, item):
                top = sorted(item.by.items(), key=lambda pair: -pair[1])[:2]
                names = " and ".join(n for n, part in top if part > 0.2) or top[0][0]
                found[signal] = (
                    f"the residual depends on {names}: {100 * share:.0f} % of its variance on windows held out"
                )
                continue
            own = self.model.whole(residual, signal)
            rms = float(np.std(own))
            if rms > UNTOLD * spread and rms > LOUD * max(self.white(signal), 1e-300):
                found[signal] = (
                    "the residual is far above the reading's noise, and what was measured does not tell it directly"
                )
        return found


class Stage:
    """A stage of the search in one group: what all of them work on.

    Attributes:
        known: the group without a cause.
        model, problem, budget, spreads: its own, as `Known` has them.
    """

    def __init__(self, known: Known) -> None:
        """Nothing is done yet."""
        self.known, self.model, self.problem = known, known.model, known.problem
        self.budget, self.spreads = known.budget, known.spreads
