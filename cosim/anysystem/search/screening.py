"""Which cause to add to a set: every candidate is looked at by what it changes, and the most promising are fitted."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import (
    PARAMETER,
    Action,
    acts,
    part_of,
)
from cosim.anysystem.search.finding import Candidate, parameter
from cosim.anysystem.search.fits import NAMED, OTHERS, PROMISE, SCREENED, Fits
from cosim.anysystem.search.known import PARTS, Stage
from cosim.inference.problem import DIFFERENCE, Fit
from cosim.inference.unknowns import Unknown
from cosim.system.effects import EFFECTS

Array = NDArray[np.float64]

GROWS = 2.0  # times what a parameter changes early in a log: where it changes so much late, it puts a model out of step
UNDONE = (
    0.5  # of what more of a parameter does: less of it undoes so much where the likelihood has one optimum
)
HORIZONS = (
    1 / 16,
    1 / 8,
    1 / 4,
    1 / 2,
)  # of a log: where a parameter that puts a model out of step is fitted first
HORIZON_STEPS = 6  # of each of these fits
OFF_STEP = 0.01  # of a parameter: where the first of them begins
LOOKED = 0.5  # of the time that is left: candidates are looked at before the best of them are fitted
KEPT = 3  # sets from which a second cause is looked for
FOLLOWED = 1e-3  # of the square of what a start changes: where the base's numbers leave less it is theirs
SMALLEST = 0.02  # of a start: less of it is hardly more than nothing


@dataclass
class Begin:
    """Where a fit of one cause more may begin.

    Attributes:
        promise: log-likelihood that it may gain, the others following.
        start: its numbers as they were tried.
        part: how much of them the log asks for, by slopes.
        follow: name -> by how much the others' numbers then move.
    """

    promise: float
    start: dict[str, float]
    part: float
    follow: dict[str, float]


@dataclass
class Base:
    """A set of causes beside which one more is looked for.

    Attributes:
        candidate: the set.
        rest: what it leaves, whitened.
        slopes: (n + k, u) of what it leaves in its unknowns over their scales, zero in what is held out.
        span: (n, m) an orthonormal base of these in the fitted part.
    """

    candidate: Candidate
    rest: Array
    slopes: Array
    span: Array

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Of its fit."""
        return self.candidate.fit.unknowns


@dataclass
class Look:
    """What was seen of a cause beside others.

    Attributes:
        base: the others.
        changes: what each start changes of what they leave.
        starts: where a fit may begin.
        fitted: those from which one was made.
    """

    base: Base
    changes: list[Array] = field(default_factory=list)
    starts: list[Begin] = field(default_factory=list)
    fitted: list[dict[str, float]] = field(default_factory=list)


class Screening(Stage):
    """The look at every candidate.

    Attributes:
        most: causes looked for.
        tried: all sets that were fitted.
        sizes: log-likelihood that each cause's starts change at most, at first sight.
    """

    def __init__(self, fits: Fits, most: int) -> None:
        """Nothing is tried yet."""
        super().__init__(fits.known)
        self.fits, self.most = fits, most
        self.tried: list[Candidate] = []
        self.sizes: dict[Action, float] = {}

    def stage(self, base: Candidate) -> list[Candidate]:
        """The set with each promising cause more: all are looked at, the best are fitted, and then what is dear is tried."""
        rest = self.problem.rows(base.fit.values)
        if rest is None:
            return []
        looks: dict[Action, Look] = {}
        followed: list[Action] = []
        gains = self._at_first_sight(base)
        beside = self._beside(base, rest)
        with self.budget.part(LOOKED):
            for action in self._most_likely_first(gains):
                if action in base.actions or self._twice(action, base.actions):
                    continue
                if action.effect != PARAMETER and not acts(action.effect, self.known.reach(action)):
                    self.sizes[action] = 0.0
                    continue
                if self.budget.over:
                    self.known.left_out(action.effect)
                    continue
                look = Look(beside)
                self._look(action, look)
                looks[action] = look
                # nobody follows what nobody sees
                if (
                    action.effect == PARAMETER
                    and any(0.5 * float(c @ c) > NAMED for c in look.changes)
                    and (self._loses_step(action) or self._other_optima(look.changes))
                ):
                    followed.append(action)
        found = self._best_fitted(beside, looks, {})
        if followed:
            early = self._at_first_sight(base, HORIZONS[1])
            followed.sort(key=lambda a: -max(gains.get(a, 0.0), early.get(a, 0.0)))
            with self.budget.part(LOOKED):
                for action in followed:
                    if self.budget.over:
                        self.known.left_out(f"{action.effect} followed from the first part of the log")
                        continue
                    self._reached(action, self._kept_in_step(base, action), looks[action])
            found = self._best_fitted(beside, looks, found)
        ordered = self.fits.by_score(list(found.values()))
        return [self.fits.both_sides(c) if k < KEPT else c for k, c in enumerate(ordered)]

    def with_numbers(self, singles: list[Candidate]) -> list[Candidate]:
        """The causes one by one, and before them several wrong numbers of the model at once where these explain more.

        One number in the place of several leaves so much that effects elsewhere seem to explain it better, and that what
        is left passes for noise. Hence they are fitted before the noise is learned.
        """
        best = singles[0]
        if min(len(self.known.trusted), self.most) < 2 or not self.fits.systematic(best, 2):
            return singles
        if self.budget.over:
            self.known.left_out("several parameters at once")
            return singles
        leading = next((c for c in singles if c.actions[0].effect == PARAMETER), None)
        actions = self._seen_apart(leading)
        if len(actions) < 2:
            return singles
        begin = {**self.known.nothing(actions), **self.known.null.fit.values}
        starts = [begin]
        if leading is not None and leading.actions[0] in actions:
            starts.append(begin | leading.fit.values)
        # slopes of the nuisances around numbers that are far off, as where a model runs away, say nothing of the right ones
        with self.problem.sharing(()):
            fit = self.known.best_of(self.fits.free(actions), starts)
        if fit is None:
            return singles
        self.known.share(fit.values)
        fit = self.fits.fit(actions, fit.values, 10)
        if fit is not None:
            several = self.fits.needed(self.fits.scored(Candidate(actions, fit, self.fits.price(actions))))
        if fit is None or len(several.actions) < 2 or several.score < best.score + NAMED:
            self.known.share(self.known.null.fit.values)
            return singles
        self.tried.append(several)
        return [several, *singles]

    def _seen_apart(self, leading: Candidate | None) -> tuple[Action, ...]:
        """Trusted parameters of which a moderate size shows beside all others: of two that do the same, one.

        Of the one that explains most by itself its own size: a limit that is just not met has no slope.
        """
        changes = {}
        for name, slope in self.known.slopes.items():
            value, deviation = self.known.trusted[name]
            (size,) = self.known.moderate(parameter(name)).values()
            times = (size - value) / (deviation * self.known.scales[name])
            changes[name] = {n: times * s for n, s in slope.items()}
        if leading is not None:
            here, there = (self.problem.model(f.values) for f in (self.known.null.fit, leading.fit))
            changes[str(leading.actions[0].port)] = {n: there[n] - here[n] for n in self.problem.names}
        return tuple(parameter(n) for n in self.problem.apart(changes, NAMED))

    def _at_first_sight(self, base: Candidate, part: float = 1.0) -> dict[Action, float]:
        """Log-likelihood that each trusted parameter would gain by its slope alone, in the first part of the log."""
        counts = {n: max(round(part * m.size), 1) for n, m in self.problem.measured.items()}
        with self.problem.first(counts) if part < 1.0 else nullcontext():
            freed = self.problem.freed(base.fit.values)
        names = {f"{PARAMETER}|{n}": parameter(n) for n in self.known.trusted}
        return {names[n]: gain for n, gain in freed.items() if n in names}

    def _most_likely_first(self, gains: Mapping[Action, float]) -> list[Action]:
        """All candidates: parameters whose slopes promise something, the best first; effects at ports; other parameters."""
        rank = {a: (0, -g) if (g := gains.get(a, 0.0)) > NAMED else (2, -g) for a in gains}
        return sorted(
            self.known.candidates(), key=lambda a: rank.get(a, (2 if a.effect == PARAMETER else 1, 0.0))
        )

    def _beside(self, base: Candidate, rest: Array) -> Base:
        """A set beside which one cause more is looked for, with what its numbers can make up for."""
        slopes = self.problem.slopes(replace(base.fit, rows=rest), DIFFERENCE)
        span, _ = np.linalg.qr(slopes[self.problem.mask][:, np.any(slopes != 0.0, axis=0)])
        return Base(base, rest, slopes, span)

    def _reached(self, action: Action, start: dict[str, float], look: Look) -> float:
        """What a start reaches as it is; kept with what it promises as the numbers beside it follow.

        That is the score test of the cause: what it changes beyond what these can make up for, and how far that goes along
        with what is left.
        """
        inside, base = self.problem.mask, look.base
        with self.problem.fitted_alone():
            rows = self.problem.rows({**base.candidate.fit.values, **start})
        if rows is None:
            return 0.0
        change = (base.rest - rows)[inside]
        with np.errstate(over="ignore"):  # a start that makes a model run away
            size = float(change @ change)
        if not np.isfinite(size):
            return 0.0
        look.changes.append(change)
        if not base.candidate.actions:
            self.sizes[action] = max(self.sizes.get(action, 0.0), 0.5 * size)
        if size <= 0.0:
            return 0.0
        reached = float(change @ base.rest[inside]) - 0.5 * size
        own = change - base.span @ (base.span.T @ change)
        beyond = float(own @ own)
        along = float(own @ base.rest[inside]) if beyond > FOLLOWED * size else 0.0
        part = along / beyond if along else 0.0
        promise = max(0.5 * along * abs(part), reached)
        if promise > 0.0:
            part = float(np.clip(part, SMALLEST, 1.0))
            moved = np.linalg.lstsq(base.slopes[inside], part * change, rcond=None)[0]
            follow = {u.name: u.scale * float(m) for u, m in zip(base.unknowns, moved, strict=True)}
            look.starts.append(Begin(promise, start, part, follow))
        return reached

    def _begun(self, base: Base, action: Action, begin: Begin) -> dict[str, float]:
        """Where a fit begins: at a start as it was tried, or at as much of it as the log asks for, others following."""
        values = base.candidate.fit.values
        plain = {**values, **begin.start}
        if begin.part == 1.0 and not begin.follow:
            return plain
        known = {u.name: u for u in (*base.unknowns, *self.fits.free((action,)))}
        less = {**values, **self._part_of(action, begin.start, begin.part)}
        less |= {n: values[n] + m for n, m in begin.follow.items()}
        less = {n: known[n].within(v) if n in known else v for n, v in less.items()}
        return less if self.known.at(less) > self.known.at(plain) else plain

    def _part_of(self, action: Action, start: Mapping[str, float], part: float) -> dict[str, float]:
        """So much of a cause as a part of a start is."""
        if action.effect == PARAMETER:
            return {n: v + part * (start[n] - v) for n, v in self.known.off(action).items()}
        return part_of(action, self.known.reach(action), start, part)

    def _look(self, action: Action, look: Look) -> None:
        """What a cause does from where its search would begin, and which of its sides do more."""
        limits = self.known.sides(action)
        nothing = self.known.off(action) if limits else {}
        both = dict(nothing)
        for name, values in limits.items():
            reached = [self._reached(action, {**nothing, name: value}, look) for value in values]
            if max(reached) > 0.0:
                both[name] = values[int(np.argmax(reached))]
        if sum(both[n] != nothing[n] for n in limits) > 1:
            self._reached(action, both, look)
        for start in () if limits else self.known.begins(action):
            self._reached(action, start, look)

    def _best_fitted(
        self, base: Base, looks: Mapping[Action, Look], before: Mapping[Action, Candidate]
    ) -> dict[Action, Candidate]:
        """Fits of those that promise most; those that were fitted before stay, with what better starts give."""
        ranked: list[tuple[float, Action, list[Begin]]] = []
        for action, look in looks.items():
            if look.starts:
                own = sorted(look.starts, key=lambda begin: -begin.promise)
                ranked.append((own[0].promise, action, own[: self._tries(action)]))
        ranked.sort(key=lambda item: -item[0])
        chosen = [r for r in ranked[:SCREENED] if r[0] >= max(2.0, 0.02 * ranked[0][0])]
        known = {action.effect for _, action, _ in chosen}
        for item in ranked[SCREENED:]:  # one effect at many places shall not keep the others out
            if (
                len(chosen) < SCREENED + OTHERS
                and item[1].effect not in known
                and item[0] > PROMISE * ranked[0][0]
            ):
                chosen.append(item)
                known.add(item[1].effect)
        found = dict(before)
        for _, action, begins in chosen:
            fresh = [begin for begin in begins if begin.start not in looks[action].fitted]
            if not fresh:
                continue
            if found and self.budget.over:
                self.known.left_out(f"{action.effect} by a fit")
                continue
            looks[action].fitted += [begin.start for begin in fresh]
            nearer = [self._begun(base, action, begin) for begin in fresh]
            fits = [fit for at in nearer if (fit := self._fitted(base, action, at)) is not None]
            fits += [before[action]] if action in before else []
            if fits:
                found[action] = max(fits, key=lambda c: c.score)
        return found

    def _loses_step(self, action: Action) -> bool:
        """Whether what a parameter changes grows along the log: a free oscillation that gets out of step, a ball's bounces.

        Then two sizes of it differ in phase, and the likelihood has an optimum for each turn.
        """
        slope = self.known.slopes.get(str(action.port), {})
        count = max((s.size for s in slope.values()), default=0) // PARTS
        return any(
            float(np.abs(s[-count:]).mean()) > GROWS * float(np.abs(s[count : 3 * count]).mean())
            for s in slope.values()
        )

    @staticmethod
    def _other_optima(changes: Sequence[Array]) -> bool:
        """Whether a size above and one below change the readings otherwise than in opposite ways: bounces, or turns.

        A ball that has come to rest at the end of the log is out of step before, and what that changes does not grow.
        """
        if len(changes) < 2:
            return False
        above, below = changes[:2]
        sizes = float(np.linalg.norm(above)), float(np.linalg.norm(below))
        return min(sizes) > UNDONE * max(sizes) and -float(above @ below) < UNDONE * sizes[0] * sizes[1]

    def _kept_in_step(self, base: Candidate, action: Action) -> dict[str, float]:
        """A parameter's value followed from the first part of the log, where no size of it is out of step, to the whole."""
        (unknown,) = self.known.numbers(action)
        value = self.known.trusted[str(action.port)][0]
        start = {unknown.name: unknown.within(value + OFF_STEP * self.known.scales[str(action.port)])}
        for part in HORIZONS:
            with self.model.first(part) as counts, self.problem.first(counts):
                fit = self.problem.fit([unknown], {**base.fit.values, **start}, HORIZON_STEPS)
            if fit is not None:
                start = {unknown.name: fit.values[unknown.name]}
        return start

    def _tries(self, action: Action) -> int:
        """Starts from which a cause is fitted: one side of two may hold a search that begins on the other."""
        return 1 if action.effect == PARAMETER or len(EFFECTS[action.effect].parameters) == 1 else 3

    def _twice(self, action: Action, others: Sequence[Action]) -> bool:
        """The same effect at the same port already."""
        return any(a.effect == action.effect and a.port == action.port for a in others)

    def _fitted(self, base: Base, action: Action, begin: Mapping[str, float]) -> Candidate | None:
        """A set with a cause more, roughly: the slopes of the others are those that they have without it."""
        actions, numbers = (*base.candidate.actions, action), self.known.numbers(action)
        roughly = None
        if base.unknowns and not self.fits.by_log and (rows := self.problem.rows(begin)) is not None:
            here = Fit(dict(begin), np.zeros((0, 0)), tuple(numbers), rows, 0.0)
            roughly = np.concatenate([base.slopes, self.problem.slopes(here, DIFFERENCE)], axis=1)
        fit = self.fits.fit(actions, begin, roughly=roughly)
        if fit is None:
            return None
        candidate = Candidate(actions, fit, self.fits.price(actions))
        return self.fits.scored(candidate)
