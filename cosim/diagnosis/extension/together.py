"""All blocks fitted together: what they say of a cause that its own block can hardly tell from another.

The slew integrates the pressure, so a block behind may know more of a block before it than that block's own signal does:
whether a leak turns turbulent, or whether it is a leak at all or a smaller flow gain.
"""

from collections.abc import Callable

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.trials import charged
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import INDISTINGUISHABLE, NAMING_GAIN
from cosim.diagnosis.verdict.verdict import Cause, names_of
from fmus.contract import Effect

# effects and where the search begins -> the fit
Fitted = Callable[[tuple[Effect, ...], dict[str, float]], Fit]


def weighed(diagnosis: Diagnosis, groups: tuple[Group, ...], fitted: Fitted, near: dict[str, float]) -> Fit:
    """The fit of all blocks together, with the causes that it asks for in the blocks that others follow.

    Args:
        diagnosis: its causes take another form, or the place of one another, where that is sure; those that are sure to be
            worse are no longer declared indistinguishable.
        groups: the groups of the model, in order.
        fitted: fits the whole chain.
        near: where the search begins.
    """
    listed = [c for c in diagnosis.causes if c.group in diagnosis.findings]
    best = fitted(tuple(c.effect for c in listed), near)
    # over all windows at one offset, readings in steps make the likelihood jagged: it says little of small differences
    if any(finding.task.steps for finding in diagnosis.findings.values()):
        return best
    for cause in listed:
        if cause.group != groups[-1].name:
            best = against_rivals(diagnosis.findings[cause.group], listed, cause, fitted, best)
            best = in_best_form(listed, cause, fitted, best)
    return best


def in_best_form(listed: list[Cause], cause: Cause, fitted: Fitted, best: Fit) -> Fit:
    """The best fit with any form of a cause's law; the cause has that form afterwards."""
    plain = cause.effect
    for parameter, free in plain.forms.items() if not plain.is_formed else ():
        formed = plain.formed(parameter)
        begin = best.values | {f"{formed.component}.{parameter}": free.starts[0]}
        other = fitted(tuple(formed if c is cause else c.effect for c in listed), begin)
        if other.log_likelihood - charged(1, other) > best.log_likelihood + NAMING_GAIN:
            best = other
            rename(cause, formed, best)
    return best


def against_rivals(finding: Finding, listed: list[Cause], cause: Cause, fitted: Fitted, best: Fit) -> Fit:
    """The best fit with a cause or one declared indistinguishable in its place; the cause is that one afterwards."""
    kept = {e for e in finding.chosen.effects if e != cause.effect}
    for trial in list(finding.rivals.get(cause.effect.name, ())):
        new = [e for e in trial.effects if e not in finding.chosen.effects]
        # one effect in the place of a whole set is another matter, and so is what another exchange has made of a set
        if len(new) != 1 or new[0].name not in cause.indistinguishable or set(trial.effects) != {*kept, *new}:
            continue
        (rival,) = new
        effects = tuple(rival if c is cause else c.effect for c in listed)
        other = fitted(effects, best.values | trial.fit.values)
        more = trial.price - finding.chosen.price
        ahead = other.log_likelihood - best.log_likelihood - charged(more, other)
        # nearly as good is no reason to change: what spans the same numbers would take turns
        if ahead <= INDISTINGUISHABLE:
            placed_behind(cause, rival, -ahead)
            continue
        old, best = cause.effect, other
        finding.rivals[rival.name] = [finding.chosen, *finding.rivals[old.name]]
        finding.chosen = trial
        rename(cause, rival, best)
        placed_behind(cause, old, ahead)
    return best


def placed_behind(cause: Cause, rival: Effect, behind: float) -> None:
    """Put an effect among the rivals of a cause, so far behind it in log-likelihood."""
    others = {cause.effect.name, rival.name}
    cause.rivals = sorted(
        [(rival, behind), *(r for r in cause.rivals if r[0].name not in others)], key=lambda r: r[1]
    )
    kept = [n for n in cause.indistinguishable if n not in others]
    cause.indistinguishable = [rival.name, *kept] if behind < INDISTINGUISHABLE else kept


def rename(cause: Cause, effect: Effect, found: Fit) -> None:
    """Give a cause another effect, or another form of it, with the estimates of a fit."""
    cause.effect = effect
    cause.parameters = {p: (found.values[n], found.deviations[n]) for p, n in names_of(effect).items()}
