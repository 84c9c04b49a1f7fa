"""How several logs of one system cut it: each by the signals that it has, all for one set of causes.

A log that lacks a signal within the system still judges what lies around it, as one. Components that any log joins are
therefore judged together, by each log as it cuts them: a cause is held against every log in which its component stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from cosim.anysystem.read import Recording
from cosim.ssp.system import System
from cosim.system.graph import CutGroup, cut, together, upstream_first

Cost = tuple[int, int]


@dataclass
class Cuts:
    """A system as several logs cut it.

    Attributes:
        names: connectors that any of the logs has, by which the system is cut; of those held out alone none counts.
        parts: the groups of a log that has them all.
        groups: the same, together where a log joins them.
        own: group -> number of a log -> the group as this log cuts it, of the components that it judges.
    """

    names: list[str]
    parts: tuple[CutGroup, ...]
    groups: tuple[CutGroup, ...]
    own: dict[str, dict[int, CutGroup]] = field(default_factory=dict)

    def part_of(self, signal: str) -> str:
        """The smallest group that a signal judges."""
        return next((p.name for p in self.parts if any(s == signal for s, _ in p.judged)), "")


def cut_by_logs(system: System, logs: Sequence[Recording], held: int = 0) -> Cuts:
    """Cut a system by what each of several logs has measured; the last `held` of them are held out.

    A log takes part where none of the others knows more of what enters a component, and where it cuts every loop that
    another cuts: effects within such a loop could not be looked for.
    """
    fitted = len(logs) - held
    names = sorted(frozenset[str]().union(*(log.signals for log in logs[:fitted])))
    parts = cut(system, names)
    theirs = [[g for g in cut(system, [n for n in names if n in log.signals]) if g.judged] for log in logs]
    costs = [[cost(g, parts) for g in own] for own in theirs]
    least: dict[str, Cost] = {}
    for own, dear in zip(theirs[:fitted], costs, strict=False):
        for group, price in zip(own, dear, strict=True):
            for component in group.components:
                least[component] = min(price, least.get(component, price))
    taken = [
        [
            g
            for g, price in zip(own, dear, strict=True)
            if any(price <= least[c] for c in g.components if c in least)
        ]
        for own, dear in zip(theirs, costs, strict=True)
    ]
    joined = [set(p.components) for p in parts]
    for group in (g for own in taken for g in own):
        near = [j for j in joined if j & set(group.components)]
        joined = [j for j in joined if j not in near] + [set[str]().union(*near)]
    groups = []
    for members in joined:
        inside = [p for p in parts if members >= set(p.components)]
        groups.append(inside[0] if len(inside) == 1 else together(inside))
    found = Cuts(names, parts, tuple(upstream_first(sorted(groups, key=lambda g: parts_before(g, parts)))))
    for group in found.groups:
        found.own[group.name] = {
            k: mine[0] if len(mine) == 1 else together(mine)
            for k, own in enumerate(taken)
            if (mine := [g for g in own if set(g.components) <= set(group.components)])
        }
    return found


def parts_before(group: CutGroup, parts: Sequence[CutGroup]) -> int:
    """Place of a group in the order of the parts."""
    return next(k for k, p in enumerate(parts) if p.components[0] in group.components)


def cost(group: CutGroup, parts: Sequence[CutGroup]) -> Cost:
    """What a log's group knows less than others: inputs that they measured, components in loops that they cut."""
    known = {d.port for d in group.drives} | {w.target for w in group.inner}
    inside = set(group.components)
    near = [p for p in parts if inside & set(p.components)]
    unknown = sum(d.port not in known for p in near for d in p.drives)
    units = {u for p in near for u in p.units}
    return unknown, sum(len(u.components) for u in group.units if u not in units)


def lacking(
    cuts: Cuts, log: Recording, number: int
) -> tuple[dict[str, list[str]], list[tuple[list[str], list[str]]]]:
    """What a log lacks.

    Returns:
        (group of `parts` in which it takes no part -> signals, [(groups that it judges as one, signals)]).
    """
    apart: dict[str, list[str]] = {}
    joined: list[tuple[list[str], list[str]]] = []
    for group in cuts.groups:
        if not any(own.judged for own in cuts.own[group.name].values()):
            continue
        own = cuts.own[group.name].get(number)
        inside = [p for p in cuts.parts if set(p.components) <= set(group.components)]
        mine = [p for p in inside if own and set(p.components) <= set(own.components)]
        for part in inside:
            if part in mine or not part.judged:
                continue
            lost = [n for n in signals_of(part) if n not in log.signals]
            apart[part.name] = lost or [n for n in signals_of(group) if n not in log.signals]
        if own is None:
            continue
        through = [w for w in own.inner if all(w not in p.inner for p in mine)]
        ends = {port.component for w in through for port in (w.source, w.target)}
        lost = [s for p in mine for s, port in p.judged if any(w.source == port for w in through)]
        if lost:
            joined.append(([p.name for p in mine if ends & set(p.components)], lost))
    return apart, joined


def signals_of(group: CutGroup) -> list[str]:
    """What drives a group and judges it."""
    return list(dict.fromkeys([*(d.signal for d in group.drives), *(s for s, _ in group.judged)]))
