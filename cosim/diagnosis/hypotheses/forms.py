"""Other forms of a law: which are worth a fit, which are needless, and rivals in forms of their own."""

from collections.abc import Iterable

from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.trials import Trial, tried, tried_all
from cosim.diagnosis.hypotheses.screening import pointed
from cosim.diagnosis.thresholds import NAMING_GAIN
from fmus.contract import Effect


def forms(task: Task, base: Trial, single: Iterable[Trial]) -> list[tuple[Effect, ...]]:
    """Sets in which a law has another form: of an effect of the set, or alone of another that explains half as much.

    Args:
        task: data, model and noise.
        base: the fitted set.
        single: every single effect, fitted; each form must promise more than its plain law by a score test.
    """
    single = list(single)
    enough = 0.5 * (base.fit.log_likelihood + min(t.fit.log_likelihood for t in single))
    whole = [t for t in single if t.effects[0] not in base.effects and t.fit.log_likelihood > enough]
    found: list[tuple[Effect, ...]] = []
    for trial in (base, *whole):
        for effect in (e for e in trial.effects if not e.is_formed):
            others = tuple(e for e in trial.effects if e != effect)
            for parameter, free in effect.forms.items():
                if pointed(task, trial, {f"{effect.component}.{parameter}": free.starts}) > NAMING_GAIN:
                    found.append((*others, effect.formed(parameter)))
    return found


def in_plain_form(task: Task, chosen: Trial, tolerance: float) -> Trial:
    """The chosen set without the forms that a cause named since has made needless."""
    for effect in chosen.effects:
        if effect.is_formed and len(chosen.effects) > 1:
            plain = tuple(e.plain if e == effect else e for e in chosen.effects)
            trial = tried(task, plain, tolerance, chosen.fit)
            chosen = trial if trial.score > chosen.score - NAMING_GAIN else chosen
    return chosen


def in_same_form(task: Task, chosen: Trial, single: list[Trial], tolerance: float) -> list[Trial]:
    """Single effects on equal terms with the chosen set, where that explains more. Best first.

    Each takes the form that a chosen effect has; beside the one chosen effect, if that has another form, any of its own.
    """
    taken = {p for e in chosen.effects for p in e.free if p in e.forms}
    sets: list[tuple[Effect, ...]] = [
        (e.formed(p),) for t in single for e in t.effects for p in taken if p in e.forms
    ]
    if taken and len(chosen.effects) == 1:
        sets += forms(task, chosen, single)
    formed = {t.effects[0]: t for t in reversed(tried_all(task, sets, tolerance, chosen.fit, single))}
    found = [max(t, formed.get(t.effects[0], t), key=lambda one: one.score) for t in single]
    return sorted(found, key=lambda t: -t.score)
