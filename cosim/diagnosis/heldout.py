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


def refuse(finding: Finding, held: Held, tolerance: float) -> list[Refused]:
    """The causes of a finding that do not help on held-out data.

    They are taken in one by one, the one that makes the error over the fitting log smallest first, and each must make the
    error on held-out data smaller. Of a cause that holds another (Stribeck friction holds Coulomb friction) the simpler one
    is tried first, and the fuller must be better than that.

    Args:
        finding: what was named in one group; `confirmed` is set if nothing is refused.
        held: the held-out data.
        tolerance: trust in the nominal parameters.
    """
    signal = next((s for s in finding.task.measured if s in held.record.signals), "")
    if not signal or finding.task.model.group.drive not in held.record.signals:
        return []

    def step(effects: tuple[Effect, ...], near: Fit) -> Step:
        fit_ = refitted(finding, effects, tolerance, near)
        fitted = float(np.sqrt(np.mean(fit_.residuals[signal] ** 2)))
        return Step(effects, fit_, fitted, errors(finding, fit_, held)[signal])

    waiting = [e for e in finding.chosen.effects if e.name not in SAMPLED]
    at = step((), finding.chosen.fit)
    refused: list[Refused] = []
    while waiting := [e for e in waiting if e.name not in {known.name for known in at.effects}]:
        trials = [(e, step((*at.effects, e), finding.chosen.fit)) for e in waiting]
        effect, with_it = min(trials, key=lambda item: item[1].fitted)
        waiting.remove(effect)
        for less in simpler(finding, effect):
            plain = step((*at.effects, less), finding.chosen.fit)
            if less not in at.effects and plain.held < at.held * (1.0 - WORTH):
                at = plain
        without = tuple(e for e in at.effects if e not in simpler(finding, effect))
        if with_it.held < at.held * (1.0 - WORTH):
            at = with_it if without == at.effects else step((*without, effect), with_it.fit)
        else:
            kept = tuple(e for e in finding.chosen.effects if e is not effect)
            behind = tried(finding.task, kept, tolerance, finding.chosen.fit) if kept else finding.null
            gain = finding.chosen.fit.log_likelihood - behind.fit.log_likelihood
            group = finding.task.model.group.name
            refused.append(Refused(effect, group, signal, gain, at.held, with_it.held))
    refused += pruned(finding, at, step, signal, tolerance)
    finding.confirmed = bool(at.effects) and not refused
    return refused


def pruned(
    finding: Finding,
    at: Step,
    step: Callable[[tuple[Effect, ...], Fit], Step],
    signal: str,
    tolerance: float,
) -> list[Refused]:
    """What the whole set can do without, or with something simpler in its place: early steps could not know what followed.

    Args:
        finding: what was named in one group.
        at: the set that was taken in.
        step: makes a set of effects, from a fit nearby.
        signal: what is judged.
        tolerance: trust in the nominal parameters.
    """
    refused: list[Refused] = []
    while at.effects:
        trials = []
        for effect in at.effects:
            rest = tuple(e for e in at.effects if e is not effect)
            less = [e for e in simpler(finding, effect) if e.name not in {r.name for r in rest}]
            trials += [(effect, step(other, at.fit)) for other in (rest, *((*rest, e) for e in less))]
        effect, fewer = min(trials, key=lambda item: item[1].held)
        if fewer.held * (1.0 - WORTH) > at.held:
            break
        both = [
            tried(finding.task, e, tolerance, finding.chosen.fit) if e else finding.null
            for e in (at.effects, fewer.effects)
        ]
        gain = both[0].fit.log_likelihood - both[1].fit.log_likelihood
        group = finding.task.model.group.name
        refused.append(Refused(effect, group, signal, gain, fewer.held, at.held))
        at = fewer
    return refused


def simpler(finding: Finding, effect: Effect) -> list[Effect]:
    """Candidates that change a part of what an effect changes: Coulomb friction for Stribeck friction."""
    return [
        e
        for e in finding.task.model.group.effects()
        if e.component == effect.component and set(e.free) < set(effect.free)
    ]
