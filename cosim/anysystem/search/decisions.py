"""Which of the causes found are named: held-out windows, size, adequacy of what is left, and what else would do as well."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import LEAST_DELAY, PARAMETER, Action, each, of_all
from cosim.anysystem.missing import allowed, missing, outdone
from cosim.anysystem.search.finding import (
    Candidate,
    Finding,
    errors,
    extended,
    moments,
    renumbered,
)
from cosim.anysystem.search.fits import CLOSE, NAMED
from cosim.anysystem.search.known import LEAST, SURE, Stage
from cosim.anysystem.search.rivals import Rivals
from cosim.errors import SimulationError
from cosim.inference.between import Between, between_logs, combined, drawn_by_logs
from cosim.inference.freeform import Explained
from cosim.inference.held_out import HeldOutGain, ratio_ci95, squares_by_block
from cosim.inference.problem import ABOUT, DIFFERENCE, FINE, Fit

Array = NDArray[np.float64]
Judged = dict[Action, tuple[Candidate, HeldOutGain]]

BETTER = 0.15  # a set of causes is named if it leaves no more than this part of what was systematic,
LEAVES = 0.5  # or this of the windows held out, where they are other numbers of the law, or nothing tells what they leave
CONSTANT = 0.95  # part of a reading's spread that an explanation leaves where it explains nothing
SCATTERS = "differs from log to log so much that another may have none of it"
HOLDS_NONE = "its interval holds what the model has"
SETTLING = 6  # evaluations in which what is no cause is settled beside the causes
ALMOST = 0.99  # of SURE: a trusted parameter is at its limit


def _between_programs(name: str, fit: Fit, agreed: Fit) -> float:
    """Variance of an estimate by what two programs make of one model, which `agreed` has in its covariance and `fit` not."""
    return max(agreed.deviation(name) ** 2 - fit.deviation(name) ** 2, 0.0)


class Decisions(Stage):
    """What is named of a set of causes.

    Attributes:
        on_all: the estimates are of the whole log.
    """

    def __init__(self, rivals: Rivals) -> None:
        """Nothing is decided yet."""
        super().__init__(rivals.known)
        self.rivals, self.screening, self.fits = rivals, rivals.screening, rivals.fits
        self.on_all = False

    def _held_own(self, best: Candidate) -> dict[str, float]:
        """Values of the best with which what stays wrong is asked: a log held out may have sizes of its own as well."""
        logs = [s.number for s in self.model.segments if not s.fitted.any()]
        values = dict(best.fit.values)
        if not self.fits.by_log or not best.actions or not logs or self.budget.over:
            return values
        free = [
            replace(u, name=each(u.name, log))
            for a in best.actions
            for u in self.known.numbers(a)
            for log in logs
        ]
        values |= {u.name: values[of_all(u.name)] for u in free}
        with self.problem.whole():
            fit = self.problem.fit(free, values, 8)
        return values if fit is None else fit.values

    def _between(self, best: Candidate) -> dict[str, Between]:
        """Each number of the causes by where each of the fitted logs draws it: how a machine changes until the next."""
        if len(self.model.segments) < 2 or not best.actions:
            return {}
        if self.budget.over:
            self.known.left_out("what each log says of the estimates")
            return {}
        if self.fits.by_log:
            return self._between_own(best)
        names, nuisances = self.problem.names, [u.name for u in self.problem.nuisances_shared]
        logs = [np.full(self.problem.measured[n].size, int(n.rpartition("#")[2])) for n in names]
        # what is believed of a nuisance of one log counts as that log's
        own = [int(n.rpartition("#")[2]) if "#" in n else -1 for n in nuisances]
        numbers = np.concatenate([*logs, np.array(own, dtype=np.int64)])
        fit = best.fit
        with self.problem.whole() if self.on_all else nullcontext():
            self.fits.scored(best)
            fit = best.fit
            numbers = np.where(self.problem.mask, numbers, -1)
            slopes = self.problem.slopes(fit)
        drawn = drawn_by_logs(slopes, fit.rows, numbers, np.array([u.scale for u in fit.unknowns]))
        if drawn is None:
            return {}
        nothing = self.known.nothing(best.actions)
        return {
            u.name: between_logs(
                fit.values[u.name],
                fit.deviation(u.name),
                drawn.steps[:, i],
                drawn.shares[:, i],
                self._size(fit.values[u.name], nothing[u.name]),
            )
            for i, u in enumerate(fit.unknowns)
        }

    @staticmethod
    def _size(value: float, nothing: float) -> float:
        """How large a number is; a limit out of reach says nothing of one that is met."""
        return min(abs(value - nothing), abs(value))

    def _between_own(self, best: Candidate) -> dict[str, Between]:
        """The same where each log has sizes of its own, which are fitted."""
        free = self.fits.free(best.actions)
        with self.problem.whole() if self.on_all else nullcontext():
            fit = self.problem.fit(free, best.fit.values, 8, DIFFERENCE * FINE)
        if fit is None:
            return {}
        nothing = self.known.nothing(best.actions)
        found = {}
        for number in (u for a in best.actions for u in self.known.numbers(a)):
            names = [each(number.name, log) for log in self.fits.by_log]
            values = np.array([fit.values[n] for n in names])
            # a limit that a log does not meet has no slope there
            deviations = np.array([fit.deviation(n) for n in names])
            told = deviations > 0.0
            own, squares = values[told], deviations[told] ** 2
            if own.size < 2:
                value, deviation = best.fit.values[number.name], best.fit.deviation(number.name)
                all_ = (float(own[0]), float(squares[0])) if own.size else (value, deviation**2)
                found[number.name] = Between(all_[0], values, np.where(told, deviations, np.inf), all_[1])
                continue
            size = self._size(float(own.mean()), nothing[number.name])
            over = combined(float(own.mean()), 0.0, values, deviations, size)
            weights = 1.0 / (squares + over.scatter**2)
            weights /= weights.sum()
            found[number.name] = replace(
                over,
                value=float(weights @ own),
                within=float(weights**2 @ squares),
                share=float(weights @ weights),
            )
        return found

    def _holds_none(self, action: Action, fit: Fit) -> bool:
        """Whether the 95 % interval of each size of a cause holds that at which there is none of it."""
        known = {u.name for u in fit.unknowns}
        apart = [
            abs(fit.values[name] - nothing) > 1.96 * fit.deviation(name)
            for name, nothing in self.known.off(action).items()
            if name in known
        ]
        return bool(apart) and not any(apart)

    def _none_between(self, action: Action, between: Mapping[str, Between]) -> bool:
        """Whether several logs, taken as repetitions, do not tell any size of a cause from none."""
        ends = {n: (between[n].ci95, off) for n, off in self.known.off(action).items() if n in between}
        return bool(ends) and all(low <= off <= high for (low, high), off in ends.values())

    def decide(self, finding: Finding, best: Candidate, singles: list[Candidate]) -> None:
        """Say in a finding which of a set of causes are named and what stays; `singles` were fitted one by one."""
        problem = self.problem
        null = self.fits.scored(self.known.null)
        kept: list[Action] = []
        unsure: list[Action] = []
        # parameters that are no causes, being as they are trusted to be, but not nominal
        trusted: list[Action] = []
        if best.actions and not self.budget.over:
            found = best
            best = self.fits.elsewhere(best)
            fine = self.fits.fit(best.actions, best.fit.values, 10, DIFFERENCE * FINE)
            if fine is not None and fine.log_likelihood >= best.fit.log_likelihood - 1.0:
                best = self.fits.scored(Candidate(best.actions, fine, best.price))
            if self.fits.drifts(found, best):
                best = self.fits.scored(found)
            best = self.rivals.at_outputs(best, singles)
        best, judged = self._held_out(best, null)
        between = self._between(best)
        agreed = self._as_well_as_programs_agree(best).fit
        # beside others, too, of something that the library lacks a drift or an offset often is a part
        wrong = dict[str, str]()
        if len(judged) > 1 and not self._other_log():  # what another log bears out is no part of that
            residual = problem.residuals(best.fit.values)
            wrong = self.known.wrong(self.known.told(residual, best), residual)
        for action, (poorer, gain) in judged.items():
            rows = self.fits.rms(poorer.fit), self.fits.rms(best.fit)
            # without it trusted numbers may have to be where nobody believes them
            bent = problem.pull(poorer.fit.rows) - problem.pull(best.fit.rows)
            matters = bent > NAMED or any(
                np.sqrt(max(a**2 - b**2, 0.0)) > self.known.matters(s)
                for (s, _), a, b in zip(self.model.group.judged, *rows, strict=True)
            )
            finding.held[action] = gain
            finding.gains[action] = best.fit.log_likelihood - poorer.fit.log_likelihood
            if not gain.sure:
                finding.refused.append(
                    (
                        action,
                        f"gains {gain.gain:.1f} in log-likelihood on the windows held out, "
                        f"95 % interval {gain.ci95[0]:.1f} to {gain.ci95[1]:.1f}",
                    )
                )
            elif action.effect == PARAMETER and self._small(action, best.fit):
                trusted.append(action)
            elif action.effect == PARAMETER and self._as_programs_differ(action, best.fit, agreed):
                finding.refused.append(
                    (action, "is no further from what is trusted than two programs with one model differ")
                )
            elif (
                action.effect != PARAMETER
                and (part := self._left(best.fit, wrong, True, poorer.fit)) > LEAVES
            ):
                finding.refused.append(
                    (action, f"leaves {100 * part:.0f} % of what is systematic without it")
                )
            elif not matters or self._small(action, best.fit):
                finding.refused.append((action, "is too small to matter"))
            elif self._none_between(action, between):
                finding.refused.append((action, SCATTERS))
                unsure.append(action)
            elif self._holds_none(action, agreed):
                finding.refused.append((action, HOLDS_NONE))
                unsure.append(action)
            else:
                kept.append(action)
        sizes = best.fit.values
        while tuple(kept) != best.actions:
            lost = [a for a in best.actions if a not in kept and a not in trusted]
            fit = self.fits.fit(tuple(kept), self.fits.values_without(best, lost))
            best = self.fits.scored(Candidate(tuple(kept), fit or null.fit, self.fits.price(kept)))
            # what told one of them from none may be gone with the others
            between = self._between(best)
            agreed = self._as_well_as_programs_agree(best).fit
            gone = [a for a in kept if self._none_between(a, between)]
            holding = [a for a in kept if a not in gone and self._holds_none(a, agreed)]
            finding.refused += [(a, SCATTERS) for a in gone] + [(a, HOLDS_NONE) for a in holding]
            gone += holding
            unsure += gone
            kept = [a for a in kept if a not in gone]
        finding.fitted = best
        finding.settled = self._settled(best, [a for a in unsure if a.effect == PARAMETER], sizes)
        if self.budget.over and best.actions:
            self.known.left_out("the last estimate, by the whole log")
        elif best.actions and len(self.model.segments) == len(
            {id(s) for s in self.model.segments if s.fitted.any()}
        ):
            best = self._on_all(best)
        finding.nearest = best
        residual = problem.residuals(self._held_own(best))
        left = self.known.told(residual, best)
        wrong = self.known.wrong(left, residual)
        if best.actions and wrong:
            ratio, why = self._left(best.fit, wrong), ""
            if any(self._silences(action, best.fit) for action in best.actions):
                why = "may be zero: the log then shows nothing of what the model hands on there"
            elif self._as_a_constant(errors(finding, extended(finding, best)), wrong):
                why = "explains no more of the log than a constant reading would"
            elif ratio > BETTER and not self._borne_out(best, finding.fitted.fit, wrong, left):
                why = (
                    f"leaves {100 * ratio:.0f} % of what is systematic"
                    if ratio < 1.0
                    else "leaves no less of what is systematic"
                )
            if why:
                finding.refused += [(action, why) for action in best.actions]
                best = null
                residual = problem.residuals(null.fit.values)
                left = self.known.told(residual, null)
                wrong = self.known.wrong(left, residual) or wrong
        if not best.actions:
            finding.settled = {}
            finding.bent = self._at_limits(best)
            # of what the log cannot tell apart a parameter: they are what is trusted too much
            near = [c.actions[0] for c in singles if c.score > singles[0].score - CLOSE]
            finding.instead = next((a for a in near if a.effect == PARAMETER), near[0] if near else None)
        # programs differ alike in all logs: that says nothing of what changes from one to the next
        finding.between = self._between(best)
        if self.fits.by_log:  # of a limit that some logs do not meet the others tell
            meant = {n: b.value for n, b in finding.between.items()}
            best = replace(best, fit=replace(best.fit, values=best.fit.values | meant))
        plain = best.fit
        best = self._as_well_as_programs_agree(best)
        finding.between = {
            n: replace(b, within=b.within + best.fit.deviation(n) ** 2 - plain.deviation(n) ** 2)
            for n, b in finding.between.items()
        }
        finding.chosen, finding.told = best, left
        if not best.actions or finding.fitted is None:
            finding.fitted = best
        for action, shown in self.known.read.items():
            part = float(np.mean(~problem.mask))
            finding.read[action], finding.gains[action] = shown, shown.gain
            finding.held[action] = HeldOutGain(part * shown.gain, 0.0)
            finding.alike[action], finding.rivals[action] = [], []
        finding.unexplained = wrong
        finding.floors = {s: self._floor(s, best) for s, _ in self.model.group.judged}
        self.rivals.rivals(finding, best, singles, null)
        finding.never = self.rivals.never(best)

    def _settled(
        self, best: Candidate, unsure: Sequence[Action], sizes: Mapping[str, float]
    ) -> dict[str, tuple[float, float]]:
        """Parameters that are no causes where the model's own run is best, trusted ones within their tolerance.

        Of those that held-out data ask for, but whose size is not sure, trust says nothing; `sizes` are where they begin.
        """
        values = best.fit.values
        others = [n for n in self.known.trusted if f"{PARAMETER}|{n}" not in values]
        if not best.actions:
            return {}
        # parameters are beside the causes where the causes were fitted with them
        beside = {n: (values[f"{PARAMETER}|{n}"], d) for n, (_, d) in self.known.estimated.items()}
        own = {n: self.known.follower(n) for n in others}
        followed = {n: u for n, u in own.items() if ABOUT + u.name in values}
        beside |= {n: (u.centre + values[ABOUT + u.name] * u.prior, u.prior) for n, u in followed.items()}
        if not (others or self.known.wide) or self.budget.over:
            return beside
        unknowns = list(self.known.wide)
        at = self.problem.nuisances(best.fit.values)
        start = {u.name: u.within(best.fit.values[u.name] + at.get(f"free:{u.name}", 0.0)) for u in unknowns}
        for action in unsure:
            others.remove(str(action.port))
            unknowns += self.known.numbers(action)
            start |= {u.name: sizes[u.name] for u in self.known.numbers(action)}
        for name in others:
            unknown = own[name]
            unknowns.append(unknown)
            start[unknown.name] = unknown.within(unknown.centre + unknown.prior * at.get(unknown.name, 0.0))
        with self.problem.sharing(moments(self.problem)):
            centres = {u.name: u.centre for u in unknowns if u.prior < np.inf}
            begins = (best.fit.values | start, best.fit.values | start | centres)
            fits = [self.problem.fit(unknowns, begin, SETTLING) for begin in begins]
            plain = self.known.at(best.fit.values)
        fit = max((f for f in fits if f is not None), key=lambda f: f.log_likelihood, default=None)
        if fit is None or (fit.log_likelihood < plain + 1.0 and not followed):
            return beside
        if self.fits.drifts(best, Candidate(best.actions, fit, best.price)):
            return beside
        return {u.name.partition("|")[2]: (fit.values[u.name], fit.deviation(u.name)) for u in unknowns}

    def _held_out(self, best: Candidate, null: Candidate) -> tuple[Candidate, Judged]:
        """The causes, and for each what explains the log without it and what it gains over that on held-out data.

        Where another log is held out what stays wrong may be held for slow noise, which hears nothing of how far a whole
        run is off. So a cause that is not sure by it is asked again with what stays wrong as no noise, and one that is not
        sure by the run, which few windows decide where it drifts, with what stays wrong as noise.
        """
        judged = self._judged(best, null)
        sure = all(gain.sure for _, gain in judged.values())
        if sure or not self._other_log() or self.budget.over:
            return best, judged
        self.fits.steady = not self.fits.steady
        self.fits.settle(best)
        fit = self.fits.fit(best.actions, best.fit.values, 10)
        again = self.fits.scored(Candidate(best.actions, fit or best.fit, best.price))
        anew = self._judged(again, null)
        if any(gain.sure and not judged[a][1].sure for a, (_, gain) in anew.items() if a in judged):
            surest = {a: max(own, judged.get(a, own), key=lambda j: j[1].ci95[0]) for a, own in anew.items()}
            return again, {a: (self.fits.scored(poorer), gain) for a, (poorer, gain) in surest.items()}
        self.fits.steady = not self.fits.steady
        self.fits.settle(best)  # the rows of all with the nuisances that are now
        return best, {a: (self.fits.scored(poorer), gain) for a, (poorer, gain) in judged.items()}

    def _judged(self, best: Candidate, null: Candidate) -> Judged:
        found = {}
        for action in best.actions:
            if (poorer := self._without(best, action, null)) is not None:
                rows = self.fits.scored(poorer).fit.rows
                found[action] = poorer, self.problem.held_out(best.fit.rows, rows)
        return found

    def _other_log(self) -> bool:
        """Whether a log of its own is held out."""
        return any(not segment.fitted.any() for segment in self.model.segments)

    def _left(
        self, fit: Fit, wrong: Collection[str], held: bool = False, without: Fit | None = None
    ) -> float:
        """Part of what is systematic in a wrong signal that a fit leaves, at most: of all, or of what is held out.

        Of what another leaves that is `without` something, else of what the model does.
        """
        found = 0.0
        null, residual = (self.problem.residuals(f.values) for f in (without or self.known.null.fit, fit))
        for signal in wrong:
            floor = self.known.white(signal) ** 2
            before, after = (float(np.mean(self._part(r, signal, held) ** 2)) for r in (null, residual))
            found = max(found, float(np.sqrt(max(after - floor, 0.0) / max(before - floor, 1e-300))))
        return found

    def _part(self, series: Mapping[str, Array], signal: str, held: bool) -> Array:
        """A signal's series of all logs behind one another; all of them, or what is held out."""
        fitted = self.problem.fitted
        whole = np.concatenate([series[n] for n in self.model.places(signal)])
        out = np.concatenate([~fitted[n] | (not held) for n in self.model.places(signal)])
        return np.asarray(whole[out & self.model.known(signal)])

    def _borne_out(
        self, best: Candidate, fitted: Fit, wrong: Collection[str], left: Mapping[str, Explained]
    ) -> bool:
        """Whether what is held out bears causes out that leave much: a real log always leaves something.

        Another log does where its error surely falls. Windows of the same log do where no more than half is left, by other
        numbers of the law or by what leaves something that nothing tells.
        """
        if self._other_log():
            return self._surely_less(fitted, wrong)
        if self._left(fitted, wrong, held=True) > LEAVES:
            return False
        return renumbered(best.actions) or self._nothing_tells(best, wrong, left)

    def _surely_less(self, fit: Fit, wrong: Collection[str]) -> bool:
        """Whether the error of each wrong signal surely falls in what is held out, by its windows."""
        null, residual = (self.problem.residuals(f.values) for f in (self.known.null.fit, fit))
        windows = {n: own.astype(np.float64) for n, own in self.problem.window.items()}
        for signal in wrong:
            number = self._part(windows, signal, True)
            before, after = (squares_by_block(self._part(r, signal, True), number) for r in (null, residual))
            if not before.size or ratio_ci95(after, before)[1] >= 1.0:
                return False
        return True

    def _nothing_tells(self, best: Candidate, wrong: Collection[str], left: Mapping[str, Explained]) -> bool:
        """Whether neither inputs nor a function added at a port tell what causes leave, nor more in their place.

        Of something that the library lacks an offset or a limit often is a part: then they do.
        """
        if any(self.known.share_told(signal, left[signal]) for signal in wrong) or self.budget.over:
            return False
        values, null = best.fit.values, self.known.null.fit.values
        if missing(self.model, self.problem, values, self.spreads, allowed(self.model.runs)) is not None:
            return False
        return not outdone(self.model, self.problem, values, null, self.spreads, allowed(self.model.runs))

    def _at_limits(self, candidate: Candidate) -> tuple[str, ...]:
        """Trusted parameters that an explanation puts at the limit of what is trusted."""
        at = self.problem.nuisances(candidate.fit.values)
        prefix = f"{PARAMETER}|"
        for name, (value, deviation) in self.known.trusted.items():
            if (own := candidate.fit.values.get(prefix + name)) is not None:
                at[prefix + name] = (own - value) / (deviation * self.known.scales[name])
        return tuple(
            n.removeprefix(prefix) for n, v in at.items() if n.startswith(prefix) and abs(v) > ALMOST * SURE
        )

    def _on_all(self, best: Candidate) -> Candidate:
        """The last estimate, of the whole log: what only a window held out shows counts as well."""
        with self.problem.whole():
            self.fits.scored(best)
            starts = [self.fits.both_sides(best)] if len(best.actions) == 1 else [best]
            fits = [self.fits.fit(c.actions, c.fit.values, 10, DIFFERENCE * FINE) for c in starts]
        fit = next((f for f in fits if f is not None), None)
        self.on_all = fit is not None
        return best if fit is None else self.fits.scored(Candidate(best.actions, fit, best.price))

    def _as_well_as_programs_agree(self, best: Candidate) -> Candidate:
        """The estimate with what the machine and a program that integrates its model differ by in its deviations.

        Noise averages out over a long log, this does not: no number is known better than what changes the readings so much.
        """
        fit = best.fit
        if not fit.unknowns or self.budget.over:
            return best
        here = self.model(fit.values)
        variances = []
        for unknown in fit.unknowns:
            step = DIFFERENCE * unknown.scale
            if fit.values[unknown.name] + step > unknown.high:
                step = -step
            try:
                moved = self.model(
                    self.fits.shifted(fit.values, unknown.name, fit.values[unknown.name] + step)
                )
            except SimulationError:
                variances.append(0.0)
                continue
            slopes = []
            for signal, _ in self.model.group.judged:
                change = self.model.whole(moved, signal) - self.model.whole(here, signal)
                floor = max(LEAST * self.spreads[signal], self.model.coarse.get(signal, 0.0))
                slopes.append(float(np.sqrt(np.mean(change**2))) / abs(step) / floor)
            variances.append(max(slopes) ** -2 if max(slopes) > 0.0 else 0.0)
        return replace(best, fit=replace(fit, covariance=fit.covariance + np.diag(variances)))

    def _without(self, best: Candidate, action: Action, null: Candidate) -> Candidate | None:
        actions = tuple(a for a in best.actions if a != action)
        if not actions:
            return null
        fit = self.fits.fit(actions, self.fits.values_without(best, (action,)))
        return None if fit is None else Candidate(actions, fit, self.fits.price(actions))

    def _small(self, action: Action, fit: Fit) -> bool:
        """Too small to be told from the way a log is sampled, or within three deviations of what is trusted."""
        if action.effect in ("port.delay", "port.lag"):
            (unknown,) = self.known.numbers(action)
            return fit.values[unknown.name] < LEAST_DELAY * self.model.segments[0].h
        if action.effect == PARAMETER:
            name = str(action.port)
            value, deviation = self.known.trusted[name]
            return abs(fit.values[f"{PARAMETER}|{name}"] - value) <= 3.0 * deviation * self.known.scales[name]
        return False

    def _as_programs_differ(self, action: Action, fit: Fit, agreed: Fit) -> bool:
        """Whether a parameter is off by no more than trust, and what two programs make of one model, allow together."""
        name = f"{PARAMETER}|{action.port}"
        value, deviation = self.known.trusted[str(action.port)]
        allowed = np.sqrt(
            (deviation * self.known.scales[str(action.port)]) ** 2 + _between_programs(name, fit, agreed)
        )
        return bool(abs(fit.values[name] - value) <= SURE * allowed)

    def _silences(self, action: Action, fit: Fit) -> bool:
        """Whether a gain may be zero, beside something that stays wrong: the model then is one that explains nothing."""
        names = [
            n for n in self.known.off(action) if n.endswith("|gain") and n in {u.name for u in fit.unknowns}
        ]
        return any(abs(fit.values[n]) <= 1.96 * fit.deviation(n) for n in names)

    def _as_a_constant(self, residual: Mapping[str, Array], wrong: Collection[str]) -> bool:
        """Whether each signal that stays wrong is as far from the model's own run as from its own mean.

        A model that is far off, such as one in another unit, comes nearer by whatever silences it.
        """
        return all(
            np.sqrt(np.mean(self._part(residual, s, False) ** 2))
            > CONSTANT * np.std(self._part(self.problem.measured, s, False))
            for s in wrong
        )

    def _floor(self, signal: str, best: Candidate) -> float:
        """Noise of a reading: what is left by the best, where that is noise; else that of the reading itself."""
        residual = self.problem.residuals(best.fit.values)
        own = self.model.whole(residual, signal)
        return (
            float(np.std(own))
            if signal not in self.known.wrong(self.known.told(residual, best), residual)
            else min(self.model.segments[k].noise(signal) for k in self.model.judging(signal))
        )
