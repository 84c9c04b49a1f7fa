"""What is wrong in one group: causes are added while one more explains it better, then it is decided what is named."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from cosim.anysystem.actions import PARAMETER, Action
from cosim.anysystem.model import GroupModel
from cosim.anysystem.search.decisions import Decisions
from cosim.anysystem.search.finding import Candidate, Finding, Trust, parameter
from cosim.anysystem.search.fits import CLOSE, NAMED, PROMISE, Fits
from cosim.anysystem.search.known import Known, Stage
from cosim.anysystem.search.rivals import Rivals
from cosim.anysystem.search.screening import KEPT, Screening
from cosim.diagnosis.budget import Budget
from cosim.errors import OutOfTimeError

SEARCHING = 0.8  # of the time that is left: what was found is then decided upon, with its last estimate
FAR_BEHIND = (
    9.0  # times the squares that the best leaves, at most, of a set from which a second cause is looked for
)
ASKED = 3  # parameters that are taken as exact, where nothing else explains a log
MOST = 3  # causes in a group


class Search(Stage):
    """The search in one group.

    Attributes:
        known, fits, screening, decisions: each knows those before it alone.
        accepted: the best set of causes as far as it has come.
    """

    def __init__(
        self,
        model: GroupModel,
        trust: Trust,
        exclude: Sequence[str] = (),
        most: int = MOST,
        budget: Budget | None = None,
    ) -> None:
        """Run the group as it is.

        Args:
            model: the group.
            trust: what is known of the system's parameters.
            exclude: effects that are no candidates.
            most: causes looked for.
            budget: the time it may take; unlimited by default.

        Raises:
            SimulationError: it cannot be run at all.
        """
        super().__init__(Known(model, trust, exclude, budget))
        fits = self.fits = Fits(self.known)
        screening = self.screening = Screening(fits, most)
        self.decisions = Decisions(Rivals(screening))
        self.accepted = self.known.null

    def wrong(self) -> dict[str, str]:
        """Signals that are systematically wrong without any cause, with words."""
        residual = self.problem.residuals(self.known.null.fit.values)
        return self.known.wrong(self.known.told(residual, self.known.null), residual)

    def contradicts(self, finding: Finding) -> bool:
        """Whether these logs are explained worse with what was found in others."""
        here = self.problem.rows(self.known.null.fit.values)
        names = {u.name for a in finding.chosen.actions for u in finding.chosen.fit.unknowns}
        values = {n: v for n, v in finding.chosen.fit.values.items() if n in names}
        theirs = self.problem.rows({**self.known.null.fit.values, **values})
        if here is None or theirs is None:
            return here is not None
        return 0.5 * float(theirs @ theirs - here @ here) > CLOSE

    def likeliest_of(self, names: Sequence[str], values: Mapping[str, float]) -> list[str]:
        """Of some parameters those whose slopes promise something, beside nothing or about these values; the best first."""
        gains = [self.problem.freed(at) for at in (self.known.null.fit.values, values)]
        most = {n: max(g.get(f"{PARAMETER}|{n}", 0.0) for g in gains) for n in names}
        return sorted((n for n in names if most[n] > NAMED), key=lambda n: -most[n])[:ASKED]

    def instead(
        self, names: Sequence[str], actions: Sequence[Action], values: Mapping[str, float]
    ) -> Candidate | None:
        """The best explanation with one of some parameters in the place of a cause or of all, if it is nearly as good.

        Args:
            names: the parameters.
            actions: the causes, as another search found them.
            values: theirs, and all others.
        """
        chosen = Candidate(
            tuple(actions), replace(self.known.null.fit, values={**self.known.null.fit.values, **values}), 0.0
        )
        self.fits.settle(chosen)
        kept = dict.fromkeys([(), *(tuple(a for a in actions if a != out) for out in actions)])
        found: list[Candidate] = []
        for name in names:
            for rest in kept:
                if self.budget.over:
                    self.known.left_out(f"{name}, which is taken as exact")
                    break
                at = {**self.known.null.fit.values, **{n: values[n] for a in rest for n in self.known.off(a)}}
                begin = max(({**at, **own} for own in self.known.begins(parameter(name))), key=self.known.at)
                several = (*rest, parameter(name))
                if (fit := self.fits.fit(several, begin)) is not None:
                    found.append(self.fits.scored(Candidate(several, fit, self.fits.price(several))))
        best = max(found, key=lambda c: c.score, default=None)
        null = self.fits.scored(self.known.null).score
        least = null + max(NAMED, (1.0 - PROMISE) * (chosen.score - null))
        return best if best is not None and best.score >= least else None

    def run(self, begin: Candidate | None = None) -> Finding:
        """Causes, rivals, what stays; begun beside what explains most of the log, if that is known."""
        finding = Finding(
            self.model,
            self.problem,
            self.known.null,
            self.known.null,
            spreads=self.spreads,
            free=self.known.estimated,
        )
        residual = self.problem.residuals(self.known.null.fit.values)
        finding.before = self.known.told(residual, self.known.null)
        try:
            best, singles = self._searched(begin)
            fewer = self.fits.pruned(best)
            if self.fits.drifts(best, fewer):
                self.fits.steady = True
                fewer = self.fits.pruned(self.fits.refitted([best], [self.known.null])[0])
        except OutOfTimeError:  # in the middle of a run: what was accepted before stands
            fewer, singles = self.accepted, []
            self.known.left_out("what the search had begun")
        with self.model.runs.uncut():
            self.decisions.decide(finding, fewer, singles)
        return finding

    def _searched(self, begin: Candidate | None) -> tuple[Candidate, list[Candidate]]:
        """The causes that explain most, and those that were fitted one by one."""
        best, pool = self.known.null, [self.known.null]
        singles: list[Candidate] = []
        with self.budget.part(SEARCHING):
            if begin is not None:
                pool = self.fits.relearned([begin], [self.known.null])
                best, singles = pool[0], [c for c in pool if len(c.actions) == 1]
            for count in range(1 if begin is None else 2, self.screening.most + 1):
                if not self.fits.systematic(best, count):
                    break
                if self.budget.over:
                    self.known.left_out("any cause" if count == 1 else f"a cause number {count}")
                    break
                found: list[Candidate] = []
                least = pool[0].fit.log_likelihood
                for base in pool[:KEPT]:
                    if base.fit.log_likelihood >= FAR_BEHIND * least:
                        found += self.screening.stage(base)
                found = self.fits.unique(found)
                self.screening.tried += found
                if not found:
                    break
                if count == 1:
                    found = self.screening.with_numbers(found)
                found = self.fits.relearned(found, [best, *singles])
                if count == 1:
                    found = self.fits.by_score(
                        [self.fits.needed(c) if len(c.actions) > 1 else c for c in found]
                    )
                    if len(found[0].actions) == 1 and found[0].score > self.fits.scored(best).score + NAMED:
                        found = self.fits.scattered(found, best)
                    singles = [c for c in found if len(c.actions) == 1]
                richer = found[0]
                poorer = self.fits.scored(best)
                likelier = richer.score >= poorer.score + NAMED
                if not likelier and self.fits.drifts(richer, poorer):
                    self.fits.steady = True
                    found = self.fits.refitted(found, [best, *singles])
                elif likelier and count > 1 and not self.fits.steady and not self.fits.nearer(poorer, richer):
                    found = self._by_the_run(found, best, singles)
                richer, poorer = found[0], self.fits.scored(best)
                if richer.score < poorer.score + NAMED or (
                    count > 1 and not self.fits.nearer(poorer, richer)
                ):
                    break
                best, pool = richer, found
                self.accepted = best
        if self.fits.learned:  # a stage that failed has learned its own
            self.fits.settle(best)
            for other in singles:
                self.fits.scored(other)
        return best, singles

    def _by_the_run(
        self, found: list[Candidate], best: Candidate, singles: Sequence[Candidate]
    ) -> list[Candidate]:
        """Sets with one cause more by the least error of the run, where that brings one nearer; else as they were.

        What the model lacks besides is slow, as noise may be: by noise that was learned of it a set may be far likelier and
        come no nearer.
        """
        others = [best, *singles]
        self.fits.steady = True
        again = self.fits.refitted(found, others)
        self.fits.scored(best)
        if self.fits.nearer(best, again[0]):
            return again
        self.fits.steady = False
        self.fits.settle(found[0])
        for other in (*others, *found):
            self.fits.scored(other)
        return found
