"""All blocks fitted together: what they say of a cause that its own block can hardly tell from another.

The slew integrates the pressure, so a block behind may know more of a block before it than that block's own signal does:
whether a leak turns turbulent, or whether it is a leak at all or a smaller flow gain.
"""

from collections.abc import Callable
from dataclasses import replace

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.trials import Trial, charged, tried
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import INDISTINGUISHABLE, NAMING_GAIN
from cosim.diagnosis.verdict.verdict import Cause, cause_of, names_of, rests
from fmus.contract import Effect

# effects and where the search begins -> the fit
Fitted = Callable[[tuple[Effect, ...], dict[str, float]], Fit]


def weighed(
    diagnosis: Diagnosis,
    groups: tuple[Group, ...],
    fitted: Fitted,
    near: dict[str, float],
    tolerance: float,
) -> Fit:
    """The fit of all blocks together, with the causes that it asks for in the blocks that others follow.

    Args:
        diagnosis: its causes take another form, or the place of one another, where that is sure; those that are sure to be
            worse are no longer declared indistinguishable.
        groups: the groups of the model, in order.
        fitted: fits the whole chain.
        near: where the search begins.
        tolerance: trust in the nominal parameters.
    """
    places = [
        k
        for k, cause in enumerate(diagnosis.causes)
        if cause.group in diagnosis.findings and cause.effect.name not in SAMPLED
    ]
    best = fitted(tuple(diagnosis.causes[k].effect for k in places), near)
    # over all windows at one offset, readings in steps make the likelihood jagged: it says little of small differences
    if any(finding.task.steps for finding in diagnosis.findings.values()):
        return best
    for k in places:
        if diagnosis.causes[k].group == groups[-1].name:
            continue

        def instead(effect: Effect, begin: dict[str, float], at: int = k) -> Fit:
            return fitted(tuple(effect if i == at else diagnosis.causes[i].effect for i in places), begin)

        best = against_rivals(diagnosis, k, instead, best, tolerance)
        best = in_best_form(diagnosis, k, instead, best, tolerance)
    return best


# an effect in the place of a cause and where the search begins -> the fit
Instead = Callable[[Effect, dict[str, float]], Fit]


def in_best_form(diagnosis: Diagnosis, at: int, instead: Instead, best: Fit, tolerance: float) -> Fit:
    """The best fit with any form of a cause's law; the cause has that form afterwards. Arguments as `against_rivals`."""
    plain = diagnosis.causes[at].effect
    for parameter, free in plain.forms.items() if not plain.is_formed else ():
        formed = plain.formed(parameter)
        begin = best.values | {f"{formed.component}.{parameter}": free.starts[0]}
        other = instead(formed, begin)
        if other.log_likelihood - charged(1, other) > best.log_likelihood + NAMING_GAIN:
            best, before = other, diagnosis.causes[at]
            finding = diagnosis.findings[before.group]
            effects = tuple(formed if e == plain else e for e in finding.chosen.effects)
            trial = tried(finding.task, effects, tolerance, finding.chosen.fit)
            renew(diagnosis, at, finding.accept(trial, diagnosis.record), formed, best, tolerance)
            # of the effect, whatever its form, all blocks have told what can stand in its place
            diagnosis.causes[at] = replace(
                diagnosis.causes[at], rivals=before.rivals, indistinguishable=before.indistinguishable
            )
    return best


def against_rivals(diagnosis: Diagnosis, at: int, instead: Instead, best: Fit, tolerance: float) -> Fit:
    """The best fit with a cause or one declared indistinguishable in its place; the cause is that one afterwards.

    Args:
        diagnosis: its cause, finding and rests are renewed.
        at: place of the cause.
        instead: fits the whole chain with an effect in its place.
        best: the fit with the cause.
        tolerance: trust in the nominal parameters.
    """
    cause = diagnosis.causes[at]
    finding = diagnosis.findings[cause.group]
    kept = {e for e in finding.chosen.effects if e != cause.effect}
    declared = set(cause.indistinguishable)
    for trial in finding.rivals.get(cause.effect.name, ()):
        finding = diagnosis.findings[cause.group]
        new = [e for e in trial.effects if e not in finding.chosen.effects]
        # one effect in the place of a whole set is another matter, and so is what another exchange has made of a set
        if len(new) != 1 or new[0].name not in cause.indistinguishable or set(trial.effects) != {*kept, *new}:
            continue
        (rival,) = new
        other = instead(rival, best.values | trial.fit.values)
        more = trial.price - finding.chosen.price
        ahead = other.log_likelihood - best.log_likelihood - charged(more, other)
        # nearly as good is no reason to change: what spans the same numbers would take turns
        if ahead <= INDISTINGUISHABLE:
            cause = placed_behind(cause, rival, -ahead)
            continue
        old, best = cause.effect, other
        renew(diagnosis, at, exchanged(finding, trial, old, rival, diagnosis), rival, best, tolerance)
        # what all blocks have told from the old one stays told
        left = declared - set(cause.indistinguishable)
        cause = placed_behind(diagnosis.causes[at], old, ahead)
        cause = replace(cause, indistinguishable=[n for n in cause.indistinguishable if n not in left])
    diagnosis.causes[at] = cause
    return best


def renew(
    diagnosis: Diagnosis, at: int, finding: Finding, effect: Effect, found: Fit, tolerance: float
) -> None:
    """Put an effect of a finding in the place of a cause.

    Gain, held-out figures and rivals are its own, and so is what it leaves; the estimates are those of all blocks together.
    """
    name = diagnosis.causes[at].group
    diagnosis.findings[name] = finding
    own = {p: (found.values[n], found.deviations[n]) for p, n in names_of(effect).items()}
    diagnosis.causes[at] = replace(cause_of(finding, effect, tolerance), effect=effect, parameters=own)
    diagnosis.rests = [r for r in diagnosis.rests if r.block != name] + rests(finding, tolerance)


def exchanged(finding: Finding, trial: Trial, old: Effect, rival: Effect, diagnosis: Diagnosis) -> Finding:
    """A finding with a rival of one of its effects in that one's place, which becomes its rival."""
    others = [finding.chosen, *(t for t in finding.rivals[old.name] if t is not trial)]
    return replace(finding.accept(trial, diagnosis.record), rivals={**finding.rivals, rival.name: others})


def placed_behind(cause: Cause, rival: Effect, behind: float) -> Cause:
    """A cause with an effect among its rivals, so far behind it in log-likelihood."""
    others = {cause.effect.name, rival.name}
    listed = [(rival, behind), *(r for r in cause.rivals if r[0].name not in others)]
    kept = [n for n in cause.indistinguishable if n not in others]
    return replace(
        cause,
        rivals=sorted(listed, key=lambda r: r[1]),
        indistinguishable=[rival.name, *kept] if behind < INDISTINGUISHABLE else kept,
    )
