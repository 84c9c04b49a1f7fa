"""Causes tried on data that took no part in naming them: another log of the machine, or the rest of this one.

A cause that the fitting log asks for but that does not make the prediction of the held-out data better is refused: it
has described that one log and not the machine.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.chain import fixed_values
from cosim.diagnosis.data import Record
from cosim.diagnosis.fit import Fit, Task, Unknown, fit
from cosim.diagnosis.group_model import GroupModel
from cosim.diagnosis.naming import Finding, tried, unknowns
from cosim.diagnosis.noise import Whitener
from cosim.diagnosis.samples import SAMPLED
from fmus.contract import Effect

Array = NDArray[np.float64]

WORTH = 0.01  # of the error on held-out data that a cause must take away
CLUSTERS = 12  # parts of the log that count as independent repetitions in intervals


@dataclass(frozen=True)
class Held:
    """Held-out data.

    Attributes:
        record: the log, from its start.
        first: sample from which errors count.
        name: of the log.
        sha256: of its file.
    """

    record: Record
    first: int
    name: str = ""
    sha256: str = ""


@dataclass(frozen=True)
class Refused:
    """A cause that held-out data do not bear out.

    Attributes:
        effect: the effect.
        group: where it was named.
        signal: what was compared.
        gain: log-likelihood that it gains in the fitting log.
        without, with_it: RMSE on held-out data, SI.
    """

    effect: Effect
    group: str
    signal: str
    gain: float
    without: float
    with_it: float


def whole(task: Task, size: Mapping[str, float]) -> Task:
    """The task of fitting the error over the whole log as it is, drift included: what a free run is judged by.

    Args:
        task: the task of naming, in windows with offsets of their own.
        size: signal -> size of the error, SI.
    """
    rules = {
        s: Whitener(r.bins, r.window, False, (size[s] ** 2,) + (0.0,) * len(r.sizes[1:]), r.skip)
        for s, r in task.rules.items()
    }
    return Task(task.model, task.measured, rules)


def refitted(finding: Finding, effects: tuple[Effect, ...], tolerance: float, near: Fit) -> Fit:
    """Trusted parameters and effects fitted to the error over the whole log.

    What is left of a real machine's log is mostly what the model lacks and not noise, so windows of the log stand for
    independent repetitions in the intervals (sandwich estimator; Huber 1967, White 1982).
    """
    size = {s: max(float(np.std(r)), 1e-300) for s, r in near.residuals.items()}
    task = whole(finding.task, size)
    wanted, starts = unknowns(task.model, effects, tolerance)
    placed = []
    for item in wanted:
        start = near.values.get(item.name, starts.get(item.name, (item.start,))[0])
        placed.append(Unknown(item.name, start, item.scale, item.low, item.high, item.prior))
    found = fit(task, placed, rounds=20)
    if not wanted or found.slopes is None or found.rows is None:
        return found
    scales = np.array([u.scale for u in wanted])
    count = sum(rule.windows(task.measured[s]).size for s, rule in task.rules.items())
    scores = found.slopes[:count] * found.rows[:count, None]
    parts = np.stack([part.sum(axis=0) for part in np.array_split(scores, CLUSTERS)])
    bread = np.linalg.pinv(found.slopes.T @ found.slopes)
    meat = parts.T @ parts * CLUSTERS / (CLUSTERS - 1.0)
    covariance = bread @ meat @ bread * np.outer(scales, scales)
    names = [u.name for u in wanted]
    deviations = dict(zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), strict=True))
    return replace(found, covariance=covariance, deviations=deviations)


def errors(finding: Finding, fit: Fit, held: Held) -> dict[str, float]:
    """RMSE of the group's signals on held-out data, driven by its measured drive, with a fit's values, SI."""
    model, record = finding.task.model, held.record
    if model.group.drive not in record.signals:
        return {}
    starts = {n for n, _ in model.group.starts}
    fixed = {n: v for n, v in model.fixed.items() if n not in starts} | fixed_values(record, model.group)
    own = GroupModel(model.group, record.signals[model.group.drive], record.h, fixed, record.grid)
    simulated = own.simulate({n: v for n, v in fit.values.items() if n not in starts})
    found = {}
    for signal in finding.task.measured:
        if signal in record.signals:
            error = (record.signals[signal] - simulated[signal])[held.first :]
            found[signal] = float(np.sqrt(np.mean(error**2)))
    return found


@dataclass(frozen=True)
class Step:
    """A set of causes fitted to the whole fitting log: its error there, and on held-out data, SI."""

    effects: tuple[Effect, ...]
    fit: Fit
    fitted: float
    held: float


def refuse(finding: Finding, held: Held, tolerance: float) -> tuple[list[Refused], tuple[Effect, ...]]:
    """The causes of a finding that do not help on held-out data, and what is kept of it.

    A cause is kept if without it the error on held-out data is larger. Because some help together only (friction and a
    limit of the stroke bend the same curve at its two ends), causes are taken in one by one from none and left out one
    by one from all, and the better end counts. Of a cause that holds another (Stribeck friction holds Coulomb friction)
    the fuller must be better than the simpler.

    Args:
        finding: what was named in one group; `confirmed` is set if nothing is refused.
        held: the held-out data.
        tolerance: trust in the nominal parameters.
    """
    signal = next((s for s in finding.task.measured if s in held.record.signals), "")
    waiting = tuple(e for e in finding.chosen.effects if e.name not in SAMPLED)
    if not waiting or not signal or finding.task.model.group.drive not in held.record.signals:
        return [], finding.chosen.effects
    done: dict[frozenset[str], Step] = {}

    def step(effects: tuple[Effect, ...]) -> Step:
        key = frozenset(e.name for e in effects)
        if key not in done:
            fit_ = refitted(finding, effects, tolerance, finding.chosen.fit)
            fitted = float(np.sqrt(np.mean(fit_.residuals[signal] ** 2)))
            done[key] = Step(effects, fit_, fitted, errors(finding, fit_, held)[signal])
        return done[key]

    at = min((balanced(finding, step(e), waiting, step) for e in ((), waiting)), key=lambda s: s.held)
    kept = {e.name for e in at.effects}
    refused = []
    for effect in (e for e in waiting if e.name not in kept):
        others = tuple(e for e in finding.chosen.effects if e is not effect)
        behind = tried(finding.task, others, tolerance, finding.chosen.fit) if others else finding.null
        gain = finding.chosen.fit.log_likelihood - behind.fit.log_likelihood
        with_it = step(widened(finding, at.effects, effect))
        refused.append(Refused(effect, finding.task.model.group.name, signal, gain, at.held, with_it.held))
    finding.confirmed = bool(at.effects) and not refused
    return refused, at.effects


def balanced(
    finding: Finding, at: Step, waiting: tuple[Effect, ...], step: Callable[[tuple[Effect, ...]], Step]
) -> Step:
    """The set from which nothing can be left out, and into which nothing more can be taken, that held-out data bear out.

    Args:
        finding: what was named in one group.
        at: where to begin.
        waiting: the effects named.
        step: fits a set of effects.
    """
    for _ in waiting:
        before = at
        while more := [step(widened(finding, at.effects, e)) for e in waiting if e not in at.effects]:
            # the one that describes the fitting log best, of those that held-out data bear out
            better = [s for s in more if s.held < at.held * (1.0 - WORTH)]
            if not better:
                break
            at = min(better, key=lambda s: s.fitted)
        while at.effects:  # left out, or something simpler in its place
            fewer = min((step(e) for e in narrowed(finding, at.effects)), key=lambda s: s.held)
            if fewer.held * (1.0 - WORTH) > at.held:
                break
            at = fewer
        if {e.name for e in at.effects} == {e.name for e in before.effects}:
            break
    return at


def narrowed(finding: Finding, effects: tuple[Effect, ...]) -> list[tuple[Effect, ...]]:
    """The sets with one effect less, or with a simpler one in its place."""
    found = []
    for effect in effects:
        rest = tuple(e for e in effects if e is not effect)
        less = [e for e in simpler(finding, effect) if e.name not in {r.name for r in rest}]
        found += [rest, *((*rest, e) for e in less)]
    return found


def widened(finding: Finding, effects: tuple[Effect, ...], effect: Effect) -> tuple[Effect, ...]:
    """The set with one effect more, in place of those that it holds."""
    inside = {e.name for e in simpler(finding, effect)}
    return (*(e for e in effects if e.name not in inside), effect)


def simpler(finding: Finding, effect: Effect) -> list[Effect]:
    """Candidates that change a part of what an effect changes: Coulomb friction for Stribeck friction."""
    return [
        e
        for e in finding.task.model.group.effects()
        if e.component == effect.component and set(e.free) < set(effect.free)
    ]
