"""Whether what a group shows began in a block before it.

A cause that is small where it acts (an asymmetry of the flow, a supply that falls in a way of its own) may be seen only
where it is integrated. What explains the log clearly better from there, and leaves nothing to explain in the group, is the
cause.
"""

from collections.abc import Callable
from dataclasses import replace

from cosim.diagnosis.fitting.chain import Known
from cosim.diagnosis.fitting.trials import candidates_of, polished
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.hypotheses.naming import rivals
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import INDISTINGUISHABLE, NAMING_GAIN, ORIGINS_TRIED
from cosim.diagnosis.verdict.upstream import Origin, origins, upstream_rivals
from cosim.diagnosis.verdict.verdict import adequate, causes, rests
from fmus.contract import Effect


def traced(
    found: Diagnosis,
    finding: Finding,
    known: list[Known],
    again: Callable[[list[Known]], Finding],
    tolerance: float,
) -> tuple[list[Known], Finding]:
    """The blocks before a group and what was found in it, with a cause taken upstream where it belongs there.

    Args:
        found: record, findings and causes of the blocks before; a cause that belongs there is added to them.
        finding: what was found in the group.
        known: the blocks before it, in order.
        again: looks for causes in the group anew, driven by these blocks.
        tolerance: trust in the nominal parameters.
    """
    if not finding.chosen.effects and adequate(finding):
        return known, finding
    listed = origins(finding, known, found.record)
    finding = replace(finding, upstream=upstream_rivals(finding, listed, known))
    if found.held is not None:
        return known, finding
    clearly = INDISTINGUISHABLE if finding.chosen.effects else NAMING_GAIN
    for origin in [o for o in listed if o.behind < -clearly][:ORIGINS_TRIED]:
        trial = origin.trial
        item = Known(known[origin.at].model, trial.fit, trial.effects, trial.price)
        moved = [*known[: origin.at], item, *known[origin.at + 1 :]]
        other = again(moved)
        if other.chosen.effects or not adequate(other):
            continue
        close = [o.trial for o in listed if o is not origin and o.behind < origin.behind + INDISTINGUISHABLE]
        indistinguishable = list(
            dict.fromkeys(e.name for t in close for e in t.effects if e not in trial.effects)
        )
        if taken(found, finding, item, origin, indistinguishable, tolerance):
            return moved, other
    return known, finding


def taken(
    found: Diagnosis,
    shown: Finding,
    item: Known,
    origin: Origin,
    indistinguishable: list[str],
    tolerance: float,
) -> bool:
    """Name an origin in its own block, with what was named where it showed among its rivals; False if it leaves too much.

    Args:
        found: findings, causes and rests, renewed for that block.
        shown: what was found where it showed.
        item: the block with it.
        origin: the explanation.
        indistinguishable: effects of the blocks before that explain as much.
        tolerance: trust in the nominal parameters.
    """
    name = item.model.group.name
    before = found.findings[name]
    finding = before.accept(polished(before.task, origin.trial, tolerance), found.record)
    finding = replace(finding, rivals=rivals(finding.task, finding, candidates_of(finding.task), tolerance))
    named = causes(finding, tolerance)
    if all(c.effect in before.chosen.effects for c in named):
        return False
    # its own signal hardly shows it, nor tells it from others: what it explains is what the group behind shows
    more = shown.chosen.score - shown.null.score - origin.behind
    named = [
        c
        if c.effect in before.chosen.effects
        else replace(
            c,
            rivals=[*rivals_where_shown(shown, origin), *c.rivals],
            gain=c.gain + more,
            indistinguishable=indistinguishable,
        )
        for c in named
    ]
    found.findings[name] = finding
    found.causes = [c for c in found.causes if c.group != name] + named
    found.rests = [r for r in found.rests if r.block != name] + rests(finding, tolerance)
    return True


def rivals_where_shown(shown: Finding, origin: Origin) -> list[tuple[Effect, float]]:
    """What was named where an origin showed, or the best that was tried there, and how far it lies behind the origin."""
    if shown.chosen.effects:
        return [(e, -origin.behind) for e in shown.chosen.effects]
    best = shown.chosen.score - origin.behind
    return [(t.effects[0], best - t.score) for t in shown.single[:3]]
