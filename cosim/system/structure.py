"""What a set of measured connectors can tell apart, from the graph alone: before any number is looked at.

Each group between two cuts gives one residual for each of its measured outputs. What is wrong at a place shows in the groups
that feel it: its signature. An effect on what a component receives, or hands on, shows in one group; one of a reading in
the group that it judges and in those that it drives. Places of one signature are told apart by the shape of what they leave
only, if at all (Krysander and Frisk, structural analysis).
"""

from collections.abc import Collection
from dataclasses import dataclass

from cosim.ssp.system import System
from cosim.system.graph import cut, measured_ports

MOST = 5  # sensors that are proposed


@dataclass(frozen=True)
class Structure:
    """The answer for one set of measured connectors.

    Attributes:
        classes: (groups that feel them, places and parameters), the largest first; no group: they cannot be judged.
        advice: further connectors that would help, with what they would do.
    """

    classes: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]
    advice: tuple[str, ...]


def signatures(
    system: System, names: Collection[str], parameters: Collection[str] = ()
) -> dict[str, tuple[str, ...]]:
    """Place, ``at component.connector (where)`` or ``parameter component.parameter`` -> groups in which it shows."""
    groups = cut(system, names)
    judged = {g.name for g in groups if g.judged}
    of = {c: g.name for g in groups for c in g.components}
    sources, _ = measured_ports(system, names)
    found: dict[str, tuple[str, ...]] = {}

    def add(place: str, *felt: str) -> None:
        found[place] = tuple(dict.fromkeys(f for f in felt if f in judged))

    for component in system.components.values():
        for variable in component.fmu.variables.values():
            if variable.kind == "Real" and variable.causality in ("input", "output"):
                add(f"at {component.name}.{variable.name} ({variable.causality})", of[component.name])
    for name, port in sources.items():
        users = [g.name for g in groups if any(d.signal == name for d in g.drives)]
        own = [of[port.component]] if port.component and system.variable(port).causality != "input" else []
        add(f"at {port if port.component else name} (sensor)", *own, *users)
    for name in parameters:
        add(f"parameter {name}", of[name.partition(".")[0]])
    return found


def structure(system: System, names: Collection[str], parameters: Collection[str] = ()) -> Structure:
    """Classes of places that the graph alone cannot separate, and connectors that would separate more of them."""
    now = signatures(system, names, parameters)
    classes: dict[tuple[str, ...], list[str]] = {}
    for place, felt in now.items():
        classes.setdefault(felt, []).append(place)
    sources, _ = measured_ports(system, names)
    known = set(sources.values())
    gains = []
    for component in system.components.values():
        for variable in component.fmu.variables.values():
            name = f"{component.name}.{variable.name}"
            if variable.kind != "Real" or variable.causality != "output":
                continue
            if any(port == (component.name, variable.name) for port in known):
                continue
            more = signatures(system, [*names, name], parameters)
            groups = len({f for f in more.values() if f})
            dark = sum(not f for f in now.values()) - sum(not f for p, f in more.items() if p in now)
            if groups > len({f for f in now.values() if f}) or dark > 0:
                gains.append((dark, groups, name))
    gains.sort(key=lambda item: (-item[0], -item[1]))
    base = len({f for f in now.values() if f})
    advice = []
    for dark, groups, name in gains[:MOST]:
        what = (
            [f"raise the classes of places that can be told apart from {base} to {groups}"]
            if groups > base
            else []
        )
        what += [f"make {dark} more of the places visible"] if dark > 0 else []
        advice.append(f"measuring {name} would {' and '.join(what)}")
    ordered = sorted(classes.items(), key=lambda item: -len(item[1]))
    return Structure(tuple((felt, tuple(places)) for felt, places in ordered), tuple(advice))
