"""Causes taken out again: impossible, refuted, or more than the log can tell."""

from cosim.diagnosis.fitting.bounds import impossible
from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.trials import Trial, of_usual_size, polished, tried_all, without
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.residuals.cross_validation import refuted
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import INDISTINGUISHABLE, USUAL_SIZE
from fmus.contract import Effect


def confirmed(task: Task, chosen: Trial, null: Trial, tolerance: float) -> Trial:
    """The chosen set without what no possible value explains and what held-out windows refute, the worst first."""
    while chosen.effects and (
        out := impossible(chosen, task.model) or refuted(task, chosen, null, tolerance)
    ):
        chosen = without(task, chosen, out[0], null, tolerance)
    return chosen


def prune(finding: Finding, record: Record, tolerance: float) -> Finding:
    """The finding without what is more than the log can tell."""
    finding = moderated(finding, record, tolerance)
    # what is left of a set, or has taken its place, must hold in other windows as well
    held = confirmed(finding.task, finding.chosen, finding.null, tolerance)
    return finding if held is finding.chosen else finding.accept(held, record)


def moderated(finding: Finding, record: Record, tolerance: float) -> Finding:
    """An effect of a usual size in the place of one beyond all sizes, if the log cannot tell the two apart.

    A drive that hardly moves may be held by friction or be watched by a sensor that reads a thirtieth of the angle.
    """
    chosen, model = finding.chosen, finding.task.model
    if len(chosen.effects) != 1 or size_of(chosen, model) <= USUAL_SIZE:
        return finding
    # a law of another form may do what its simplest one is far from: friction that lets the drive creep
    forms: list[tuple[Effect, ...]] = [
        (e.formed(p),) for t in finding.single for e in t.effects if not e.is_formed for p in e.forms
    ]
    # a drive that only creeps tells the ratio of two parameters of such a law: any size does, a usual one too
    formed = [
        of_usual_size(finding.task, t.effects, tolerance, USUAL_SIZE) if size_of(t, model) > USUAL_SIZE else t
        for t in tried_all(finding.task, forms, tolerance)
    ]
    as_good = [
        t
        for t in (*finding.single, *formed)
        if t.score > chosen.score - INDISTINGUISHABLE
        and size_of(t, model) <= USUAL_SIZE * (1.0 + 1e-9)
        and not impossible(t, model)
    ]
    if not as_good:
        return finding
    best = max(as_good, key=lambda t: t.score)
    return finding.accept(polished(finding.task, best, tolerance), record)


def size_of(trial: Trial, model: GroupModel) -> float:
    """Change of a single effect's key parameter in typical sizes."""
    (effect,) = trial.effects
    if effect.key not in effect.free:
        return 0.0
    name = f"{effect.component}.{effect.key}"
    return abs(trial.fit.values[name] - model.nominal(name)) / effect.free[effect.key].scale
