"""What would do as well as a named cause, or may be there unseen: other causes, other places, what was never exercised."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.actions import PARAMETER, Action
from cosim.anysystem.search.finding import Candidate, Finding
from cosim.anysystem.search.fits import CLOSE, NAMED
from cosim.anysystem.search.known import SIZE, Stage
from cosim.anysystem.search.screening import Screening
from cosim.errors import SimulationError
from cosim.inference.problem import DIFFERENCE, FINE, Fit
from cosim.inference.unknowns import Unknown
from cosim.system.effects import EFFECTS

Array = NDArray[np.float64]

REPLACED = 10  # causes that are tried in the place of a named one
ALONG = 0.9  # of the square of a slope that lies along another's: what may do the same is fitted in its place
FAINT = 20.0  # times NAMED, under the white noise alone: what a moderate size does is no more, and is looked at again


class Rivals(Stage):
    """Other causes in the place of those that are named.

    Attributes:
        moved: causes at an output that are as good at an input.
    """

    def __init__(self, screening: Screening) -> None:
        """Nothing is compared yet."""
        super().__init__(screening.known)
        self.screening, self.fits = screening, screening.fits
        self.moved: dict[Action, Action] = {}

    def at_outputs(self, best: Candidate, singles: Sequence[Candidate]) -> Candidate:
        """Causes elsewhere, and parameters, moved to a judged output where that is as good: its reading can be asked."""
        judged = {port for _, port in self.model.group.judged}
        for action in best.actions:
            if action.where == "sensor" or (action.where == "output" and action.port in judged):
                continue
            if self._among_numbers(action, best):
                continue
            for other, start in self._output_twins(action, best, singles):
                if other in best.actions:
                    continue
                actions = tuple(other if a == action else a for a in best.actions)
                fit = self.fits.fit(actions, self.fits.values_without(best, (action,)) | start, 8)
                moved = (
                    None
                    if fit is None
                    else self.fits.scored(Candidate(actions, fit, self.fits.price(actions)))
                )
                if moved is not None and moved.score > best.score - 1.0:
                    self.moved[other] = action
                    best = moved
                    break
        return best

    @staticmethod
    def _among_numbers(action: Action, best: Candidate) -> bool:
        """Whether a parameter is one of several of its component: numbers that are wrong together stay numbers."""
        own = [a for a in best.actions if a.effect == PARAMETER and a.port.component == action.port.component]
        return action.effect == PARAMETER and len(own) > 1

    def _output_twins(
        self, action: Action, best: Candidate, singles: Sequence[Candidate]
    ) -> list[tuple[Action, dict[str, float]]]:
        """Effects at judged outputs that may be the same as a cause elsewhere, with where their fit begins."""
        ports = [port for _, port in self.model.group.judged]
        values = best.fit.values
        if action.effect != PARAMETER:
            same = EFFECTS[action.effect].parameters
            if EFFECTS[action.effect].looped:
                return []
            return [
                (other, {other.key(p): values[action.key(p)] for p in same})
                for port in ports
                if (other := Action(action.effect, port, "output")).effect
                not in ("port.offset", *self.known.exclude)
            ]
        found = {
            single.actions[0]: {
                u.name: single.fit.values[u.name] for u in self.known.numbers(single.actions[0])
            }
            for single in singles
            if single.actions[0].where == "output" and single.actions[0].port in ports
        }
        value = self.known.trusted[str(action.port)][0]
        for port in ports:
            gain = Action("port.gain", port, "output")
            if port.component == action.port.component and value and "port.gain" not in self.known.exclude:
                found.setdefault(gain, {gain.key("gain"): values[f"{PARAMETER}|{action.port}"] / value})
        return list(found.items())

    def rivals(
        self, finding: Finding, best: Candidate, singles: Sequence[Candidate], null: Candidate
    ) -> None:
        """Other causes in the place of each named one."""
        for action in best.actions:
            if self.budget.over and len(best.actions) > 1:
                self.known.left_out("other causes in the place of one of several")
                continue
            others: list[tuple[Action, float]] = []
            alike: list[Action] = []
            fits: dict[Action, Fit] = {}
            rest = tuple(a for a in best.actions if a != action)
            begins = self._in_place_of(rest, singles)
            if self._among_numbers(action, best):
                begins = self._exchanged(action, best)
            elsewhere = self._other_place(action, best)
            for rival, values in (elsewhere | begins).items():
                single = next((s for s in singles if s.actions == (rival,)), None)
                if (
                    rival == action
                    or rival in rest
                    or (not rest and single is None and rival not in elsewhere)
                ):
                    continue
                if rest or single is None:
                    begin = self.fits.values_without(best, (action,)) | values
                    fit = self.fits.fit((*rest, rival), begin, 8)
                    if fit is None:
                        continue
                    with_rival = self.fits.scored(
                        Candidate((*rest, rival), fit, self.fits.price((*rest, rival)))
                    )
                else:
                    assert single is not None
                    with_rival = self.fits.scored(single)
                    near = self.fits.scored(best).score - with_rival.score
                    if CLOSE <= near < NAMED + single.price:  # estimated as finely as the best
                        fine = self.fits.fit(single.actions, single.fit.values, 8, DIFFERENCE * FINE)
                        with_rival = self.fits.scored(replace(single, fit=fine)) if fine else with_rival
                score, fits[rival] = with_rival.score, with_rival.fit
                behind = self.fits.scored(best).score - score
                others.append((rival, behind))
                if behind < CLOSE or self._same(best.fit, fits[rival]):
                    alike.append(rival)
            same = self.moved.get(action)
            if same is not None and same not in alike:
                alike.insert(0, same)
                others = [(same, 0.0), *(o for o in others if o[0] != same)]
            finding.rivals[action] = sorted(others, key=lambda item: item[1])
            finding.alike[action] = alike
            # the same effect elsewhere often is the same for every run
            for twin in sorted(fits, key=lambda a: (a.effect == action.effect, dict(others)[a])):
                if twin in alike:
                    finding.twins.setdefault(action, []).append((twin, fits[twin].values))
                    finding.twin_unknowns[action, twin] = fits[twin].unknowns

    def _other_place(self, action: Action, best: Candidate) -> dict[Action, dict[str, float]]:
        """A cause of a reading as one of the quantity, or the other way round, where what it drives tells."""
        judged = {port: signal for signal, port in self.model.group.judged}
        if (
            judged.get(action.port) not in self.model.own
            or action.where not in ("output", "sensor")
            or EFFECTS[action.effect].reading
        ):
            return {}
        other = Action(action.effect, action.port, "sensor" if action.where == "output" else "output")
        return {
            other: {other.key(p): best.fit.values[action.key(p)] for p in EFFECTS[action.effect].parameters}
        }

    def _in_place_of(
        self, rest: tuple[Action, ...], singles: Sequence[Candidate]
    ) -> dict[Action, dict[str, float]]:
        """Causes that were fitted beside the others of a set, or alone, with their numbers; the best first."""
        beside = {self.moved.get(a, a) for a in rest} | set(rest)
        found: dict[Action, dict[str, float]] = {}
        sets = [c for c in self.screening.tried if rest and len(c.actions) == len(rest) + 1]
        for candidate in [*self.fits.by_score(sets), *singles]:
            others = [a for a in candidate.actions if a not in beside]
            if len(others) == 1 and others[0] not in found:
                numbers = self.known.numbers(others[0])
                found[others[0]] = {u.name: candidate.fit.values[u.name] for u in numbers}
        return dict(list(found.items())[:REPLACED])

    def _exchanged(self, action: Action, best: Candidate) -> dict[Action, dict[str, float]]:
        """What may do the same as one of several numbers, by its slope beside those of the others; where a fit begins.

        These are other trusted parameters, and gains where the component is wired.
        """
        known = {u.name: u for u in best.fit.unknowns}
        key = f"{PARAMETER}|{action.port}"

        def slope(unknown: Unknown, at: float) -> Array:
            """Of the whitened series over the unknown's scale."""
            here = {**best.fit.values, unknown.name: at}
            moved = here | {unknown.name: at + DIFFERENCE * unknown.scale}
            return self.problem.changed(here, moved) / DIFFERENCE

        beside = [u for n, u in known.items() if n != key]
        try:
            others = np.stack([slope(u, best.fit.values[u.name]) for u in beside], axis=1)
            whole = slope(known[key], best.fit.values[key])
        except SimulationError:
            return {}
        base, _ = np.linalg.qr(others)
        own = whole - base @ (base.T @ whole)
        step = (best.fit.values[key] - self.known.trusted[str(action.port)][0]) / known[key].scale
        found: list[tuple[float, Action, dict[str, float]]] = []
        for other in self.known.candidates():
            if other in best.actions or other.effect not in (PARAMETER, "port.gain"):
                continue
            if other.effect != PARAMETER and other.port.component != action.port.component:
                continue
            (nothing,) = self.known.off(other).values()
            (unknown,) = self.known.numbers(other)
            try:
                slopes = slope(unknown, nothing)
            except SimulationError:
                continue
            theirs = slopes - base @ (base.T @ slopes)
            size, along = float(theirs @ theirs), float(theirs @ own)
            alike = along**2 / max(size * float(own @ own), 1e-300)
            if alike > ALONG:
                far = step * along / size
                follow = np.linalg.lstsq(others, step * whole - far * slopes, rcond=None)[0]
                begin = {
                    u.name: u.within(best.fit.values[u.name] + u.scale * float(f))
                    for u, f in zip(beside, follow, strict=True)
                }
                begin[unknown.name] = unknown.within(nothing + unknown.scale * far)
                found.append((alike, other, begin))
        found.sort(key=lambda item: -item[0])
        return {other: begin for _, other, begin in found[:REPLACED]}

    def _same(self, one: Fit, other: Fit) -> bool:
        """Whether two fits predict the same but for what matters to nobody.

        A delay before a component or behind it, say: the two differ by how series are read between samples, and long logs
        tell even that.
        """
        left, theirs = self.problem.residuals(one.values), self.problem.residuals(other.values)
        return all(
            float(np.sqrt(np.mean((left[name] - theirs[name]) ** 2)))
            < SIZE * self.spreads[name.partition("#")[0]]
            for name in self.problem.names
        )

    def never(self, best: Candidate) -> dict[Action, dict[str, float]]:
        """Causes of which a moderate size would be within the noise: nobody knows whether they are there.

        The screening has seen what each would do at the noise that was known then; only what was faint is looked at again.
        """
        found: dict[Action, dict[str, float]] = {}
        here = best.fit.rows
        for action in self.known.candidates():
            if (
                (size := self.screening.sizes.get(action)) is None
                or size > FAINT * NAMED
                or any(a.port == action.port and a.effect == action.effect for a in best.actions)
            ):
                continue
            if self.budget.over:
                self.known.left_out("what the log never exercised")
                break
            moved = self.known.moderate(action)
            rows = self.problem.rows({**best.fit.values, **moved})
            if rows is None:
                continue
            change = (here - rows)[self.problem.mask]
            least = NAMED + self.fits.price((action,))
            if 0.5 * float(change @ change) < least and self._unseen(best, moved, least):
                found[action] = moved
        return found

    def _unseen(self, best: Candidate, moved: Mapping[str, float], least: float) -> bool:
        """Whether values change the readings by less than the noise while every other number stays.

        What a free number takes up whole, as one that is not known does with a gain before it, is no want of the log:
        another log shows it no better.
        """
        plain, other = self.problem.model(best.fit.values), self.problem.model({**best.fit.values, **moved})
        rows = self.problem.whitened({n: plain[n] - other[n] for n in self.problem.names})[0]
        change = rows[self.problem.mask[: rows.size]]
        return 0.5 * float(change @ change) < least
