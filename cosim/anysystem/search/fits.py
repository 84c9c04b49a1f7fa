"""Sets of causes fitted to a group, and scored: what each leaves, at what price, and with which noise it is judged."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import PARAMETER, Action, each, of_all
from cosim.anysystem.search.finding import Candidate
from cosim.anysystem.search.known import Known, Stage
from cosim.inference.problem import DIFFERENCE, EVALUATIONS, FINE, Fit
from cosim.inference.unknowns import Unknown

Array = NDArray[np.float64]

NAMED = 10.0  # log-likelihood beyond the price of the parameters: the best of some hundred candidates on clean data
CLOSE = 6.0  # log-likelihood within which two hypotheses cannot be told apart (DIAGNOSIS.md, 7)
ABOVE = 1.2  # times a reading's white noise: a fit that leaves more of it may not be the best of its kind
WORTH = 0.85  # RMS of a signal with one cause more, at most, where a further cause is looked for
SCREENED = 7  # candidates fitted at each stage
SURELY_AGAIN = 4  # of them with the noise that the best leaves
OTHERS = 3  # more of them, of effects that are not among these, where they promise
PROMISE = 0.1  # of what the best does
AROUND = tuple(np.geomspace(0.02, 1.0, 7))  # of a scale: how far from an estimate a better one is looked for
AGAIN = 3  # times at most
SCANNED = 9  # values of a limit over its range
DRIFTS = 1.25  # times the error of a run (RMS): least squares leave hardly less than the likelihood where noise is noise


class Fits(Stage):
    """Sets of causes and their fits.

    Attributes:
        learned: the noise is that which a set of causes has left.
        steady: what stays wrong passes for no noise.
        by_log: numbers of the logs of which each has sizes of its own.
    """

    def __init__(self, known: Known) -> None:
        """Nothing is fitted yet."""
        super().__init__(known)
        self.learned = False
        self.steady = False
        self.by_log: tuple[int, ...] = ()

    def free(self, actions: Sequence[Action]) -> list[Unknown]:
        """What is fitted of causes: their numbers, or those of each log."""
        numbers = [u for a in actions for u in self.known.numbers(a)]
        if not self.by_log:
            return numbers
        return [replace(u, name=each(u.name, log)) for u in numbers for log in self.by_log]

    def fit(
        self,
        actions: Sequence[Action],
        begin: Mapping[str, float],
        evaluations: int = EVALUATIONS,
        difference: float = DIFFERENCE,
        roughly: Array | None = None,
    ) -> Fit | None:
        """A fit of causes; where each log has sizes of its own their numbers are the means of these."""
        free = self.free(actions)
        own = {u.name: begin.get(u.name, begin[of_all(u.name)]) for u in free}
        fit = self.problem.fit(free, {**begin, **own}, evaluations, difference, roughly=roughly)
        if fit is not None and roughly is None:
            fit = self.known.followed(fit, free)
        return None if fit is None else self._meant(fit, actions)

    def _meant(self, fit: Fit, actions: Sequence[Action]) -> Fit:
        """A fit in the numbers of all logs."""
        if not self.by_log or not fit.unknowns:
            return fit
        numbers = [u for a in actions for u in self.known.numbers(a)]
        logs = len(self.by_log)
        mean = np.kron(np.eye(len(numbers)), np.full((1, logs), 1.0 / logs))
        means = mean @ np.array([fit.values[u.name] for u in fit.unknowns])
        values = fit.values | {u.name: float(m) for u, m in zip(numbers, means, strict=True)}
        return replace(fit, values=values, covariance=mean @ fit.covariance @ mean.T, unknowns=tuple(numbers))

    def values_without(self, candidate: Candidate, actions: Sequence[Action]) -> dict[str, float]:
        """A candidate's values without the numbers of some causes."""
        lost = {u.name for a in actions for u in self.known.numbers(a)}
        return {n: v for n, v in candidate.fit.values.items() if of_all(n) not in lost}

    @staticmethod
    def shifted(values: Mapping[str, float], name: str, value: float) -> dict[str, float]:
        """Values with another one of a number, and as much more or less in each log that has its own."""
        step = value - values[name]
        return {n: v + step if of_all(n) == name else v for n, v in values.items()}

    def scattered(self, found: list[Candidate], null: Candidate) -> list[Candidate]:
        """The candidates with sizes of each log's own, where these explain more than their price: a limit that changes.

        What is wrong in some logs alone is no size: a log that shows none of it, and contradicts what the others have, is
        left to be judged apart.
        """
        logs = [s.number for s in self.model.segments if s.fitted.any()]
        if len(logs) < 2 or self.budget.over:
            return found
        best = found[0]
        self.by_log = tuple(logs)
        fit = self.fit(best.actions, best.fit.values, 8)
        own = None if fit is None else self.scored(Candidate(best.actions, fit, self.price(best.actions)))
        if own is None or own.score < best.score + NAMED or self._absent(own):
            self.by_log = ()
            return found
        again = [own, *(Candidate(c.actions, c.fit, self.price(c.actions)) for c in found[1:])]
        return self.relearned(again, [null])

    def _absent(self, candidate: Candidate) -> bool:
        """Whether a log is nearer to having nothing of a cause than to the mean of all."""
        for action in candidate.actions:
            for log in self.by_log:
                own = candidate.fit.values
                none, mean = (
                    self.known.at(own | {each(n, log): v for n, v in values.items()})
                    for values in (
                        self.known.off(action),
                        {u.name: own[u.name] for u in self.known.numbers(action)},
                    )
                )
                if none > mean + CLOSE:
                    return True
        return False

    def settle(self, best: Candidate) -> None:
        """Nuisances and noise as the best set leaves them."""
        self.known.share(best.fit.values)
        residual = self.problem.residuals(best.fit.values)
        wrong = self.known.wrong(self.known.told(residual, best), residual) if self.steady else ()
        self.problem.learn(residual, [place for signal in wrong for place in self.model.places(signal)])
        self.scored(best)

    def scored(self, candidate: Candidate) -> Candidate:
        """The candidate's score under the noise as it is known now."""
        rows = self.problem.rows(candidate.fit.values)
        if rows is None:
            candidate.score = -np.inf
        else:
            likelihood = self.problem.log_likelihood(rows, candidate.fit.values, ())
            candidate.fit = replace(candidate.fit, rows=rows, log_likelihood=likelihood)
            candidate.price = self.price(candidate.actions)
            candidate.score = likelihood - candidate.price
        return candidate

    def rms(self, fit: Fit) -> list[float]:
        """RMS of what a fit leaves of each judged signal."""
        residual = self.problem.residuals(fit.values)
        return [
            float(np.sqrt(np.mean(self.model.whole(residual, s) ** 2))) for s, _ in self.model.group.judged
        ]

    def nearer(self, poorer: Candidate, richer: Candidate) -> bool:
        """Whether a set with one cause more comes so much nearer to a signal that a further one is worth looking for."""
        rows = self.rms(poorer.fit), self.rms(richer.fit)
        return min(b / max(a, 1e-300) for a, b in zip(*rows, strict=True)) <= WORTH

    def systematic(self, candidate: Candidate, count: int) -> bool:
        """Whether there may be anything (more) to find."""
        if count == 1:
            return True
        residual = self.problem.residuals(candidate.fit.values)
        left = self.known.told(residual, candidate)
        return bool(self.known.wrong(left, residual)) or self._above_noise(candidate.fit)

    def leaves(self, signal: str, candidate: Candidate) -> float:
        """RMS of what a candidate leaves of a signal, over the noise of its reading."""
        sizes = dict(zip([s for s, _ in self.model.group.judged], self.rms(candidate.fit), strict=True))
        return sizes[signal] / max(self.known.white(signal), 1e-300)

    def _above_noise(self, fit: Fit) -> bool:
        """Whether a fit leaves more of a signal than its reading's noise."""
        sizes = zip(self.model.group.judged, self.rms(fit), strict=True)
        return any(size > ABOVE * self.known.white(signal) for (signal, _), size in sizes)

    def needed(self, several: Candidate) -> Candidate:
        """Of several parameters those that count, by the fit's slopes; fitted again."""
        trusted = self.known.nothing(several.actions)
        price = self.price(several.actions[:1])
        spare = self.problem.spare(several.fit, trusted, NAMED + price)[: len(several.actions) - 1]
        while spare and not self.budget.over:
            names = [name for name, _ in spare]
            lost = [a for a in several.actions if f"{PARAMETER}|{a.port}" in names]
            actions = tuple(a for a in several.actions if a not in lost)
            stay = self.values_without(several, lost)
            fit = self.fit(actions, {n: spare[-1][1].get(n, v) for n, v in stay.items()}, 8)
            if fit is not None:
                fewer = self.scored(Candidate(actions, fit, self.price(actions)))
                if fewer.score > several.score - NAMED:
                    return self.needed(fewer) if len(actions) > 1 else fewer
            spare = spare[: len(spare) // 2]  # slopes do not reach so far
        # what is compared with it has numbers enough to make up for a fit that ended early
        fine = self.fit(several.actions, several.fit.values, 8, DIFFERENCE * FINE)
        if fine is None or fine.log_likelihood < several.fit.log_likelihood:
            return several
        return self.scored(replace(several, fit=fine))

    def both_sides(self, candidate: Candidate) -> Candidate:
        """A cause of two limits, each looked for over its whole range: from beyond the signal no slope leads back."""
        action = candidate.actions[-1]
        numbers = self.known.numbers(action)
        if len(numbers) != 2 or self.budget.over:
            return candidate
        best, values = candidate.score, dict(candidate.fit.values)
        for unknown in numbers:
            for part in np.linspace(0.02, 0.98, SCANNED):
                moved = self.shifted(
                    values, unknown.name, unknown.low + float(part) * (unknown.high - unknown.low)
                )
                score = self.known.at(moved) - candidate.price
                if score > best:
                    best, values = score, moved
        if best <= candidate.score:
            return candidate
        fit = self.fit(candidate.actions, values)
        again = None if fit is None else self.scored(Candidate(candidate.actions, fit, candidate.price))
        return again if again is not None and again.score > candidate.score else candidate

    def elsewhere(self, candidate: Candidate) -> Candidate:
        """The candidate, or a better estimate of the same causes away from it, where it leaves more than noise.

        What switches within a component (a valve that a level opens, a contact) makes the likelihood jump with a number:
        slopes then end at the next step of it.
        """
        every = self.free(candidate.actions)
        for _ in range(AGAIN):
            if self.budget.over or not self._above_noise(candidate.fit):
                break
            best, values = candidate.score, candidate.fit.values
            for unknown in every:
                for part in (*AROUND, *(-p for p in AROUND)):
                    at = unknown.within(candidate.fit.values[unknown.name] + part * unknown.scale)
                    moved = candidate.fit.values | {unknown.name: at}
                    score = self.known.at(moved) - candidate.price
                    if score > best:
                        best, values = score, moved
            if best < candidate.score + 1.0:
                break
            fit = self.fit(candidate.actions, values)
            again = None if fit is None else self.scored(Candidate(candidate.actions, fit, candidate.price))
            if again is None or again.score <= candidate.score:
                break
            candidate = again
        return candidate

    def price(self, actions: Sequence[Action]) -> float:
        """Log-likelihood that the numbers of causes must gain (BIC)."""
        return 0.5 * float(np.log(self.problem.independent)) * len(self.free(actions))

    @staticmethod
    def by_score(found: Sequence[Candidate]) -> list[Candidate]:
        """The best first."""
        return sorted(found, key=lambda c: -c.score)

    def unique(self, found: list[Candidate]) -> list[Candidate]:
        """The best of each set of causes, the best first."""
        seen: dict[frozenset[Action], Candidate] = {}
        for candidate in self.by_score(found):
            seen.setdefault(frozenset(candidate.actions), candidate)
        return list(seen.values())

    def relearned(self, found: list[Candidate], others: Sequence[Candidate]) -> list[Candidate]:
        """The candidates fitted again with the noise that the best of them leaves; twice, since the best may change."""
        again = self.refitted(found, others)
        if self.drifts(self.by_score(found)[0], self.by_score(again)[0]):
            self.steady = True
            again = self.refitted(found, others)
        for other in others:
            self.scored(other)
        return again

    def refitted(self, given: Sequence[Candidate], others: Sequence[Candidate]) -> list[Candidate]:
        """The candidates with the noise that the best of them leaves."""
        found = [replace(candidate) for candidate in given]
        for _ in range(2):
            best = max(found, key=lambda c: c.score)
            self.settle(best)
            self.learned = True
            again = []
            near = best.score - PROMISE * (best.score - self.scored(others[0]).score)
            for rank, candidate in enumerate(self.by_score(found)):
                # one that explains nearly as much may be the same: it is judged at its best, as the best is
                if rank < SURELY_AGAIN or (rank < SCREENED + OTHERS and self.scored(candidate).score > near):
                    fit = self.fit(candidate.actions, candidate.fit.values, 8)
                    candidate = Candidate(candidate.actions, fit or candidate.fit, candidate.price)
                again.append(self.scored(candidate))
            found = self.by_score(again)
            if found[0].actions == best.actions:
                break
        return found

    def drifts(self, best: Candidate, now: Candidate) -> bool:
        """Whether what explains best comes far less near to the log by noise that was learned: then it is none.

        What the model lacks besides is slow, as noise may be, and fits that believe so let the run drift.
        """
        if self.steady or not best.actions:
            return False
        rows = self.rms(best.fit), self.rms(now.fit)
        return any(after > DRIFTS * before for before, after in zip(*rows, strict=True))

    def pruned(self, best: Candidate) -> Candidate:
        """Without causes that the others make up for."""
        while len(best.actions) > 1:
            if self.budget.over:
                self.known.left_out("whether fewer causes do")
                break
            poorer = []
            for k in range(len(best.actions)):
                actions = best.actions[:k] + best.actions[k + 1 :]
                fit = self.fit(actions, self.values_without(best, (best.actions[k],)))
                if fit is not None:
                    poorer.append(self.scored(Candidate(actions, fit, self.price(actions))))
            if not poorer:
                break
            top = max(poorer, key=lambda c: c.score)
            if top.score < best.score - NAMED:
                break
            best = top
        return best
