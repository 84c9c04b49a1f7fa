"""The wiring cut at measured signals: which blocks stand between which measurements."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from cosim.compare.binding import Binding
from cosim.ssp.system import Port, System


@dataclass(frozen=True)
class Upstream:
    """What makes a signal.

    Attributes:
        components: between the signal and the nearest measured signals before it, in the order of the system.
        driven_by: those measured signals.
        missing: inputs of the model on the way that the log does not hold, and without which nothing can be simulated.
        assumed: inputs on the way that the log does not hold, either: FMUs of others keep the start value that they give.
    """

    components: tuple[str, ...]
    driven_by: tuple[str, ...]
    missing: tuple[str, ...]
    assumed: tuple[Port, ...] = ()


@dataclass(frozen=True)
class Group:
    """Blocks that are judged together.

    Attributes:
        components: their names, in the order of the system.
        driven_by: measured signals that drive them.
        signals: measured signals by which they are judged.
    """

    components: tuple[str, ...]
    driven_by: tuple[str, ...]
    signals: tuple[str, ...]

    @property
    def name(self) -> str:
        """The components, joined by `` + ``."""
        return " + ".join(self.components)


@dataclass(frozen=True)
class NotJudged:
    """A block that the log says nothing about.

    Attributes:
        components: the blocks.
        missing: signals that would be needed (any one where several observe the same).
        why: one sentence.
    """

    components: tuple[str, ...]
    missing: tuple[str, ...]
    why: str


def upstream(
    system: System, binding: Binding, bindings: Mapping[str, Binding], cut: Iterable[str]
) -> Upstream:
    """Follow the wires back from a signal.

    Args:
        system: the model.
        binding: of the signal.
        bindings: of all signals that the system has.
        cut: measured signals at which to stop.
    """
    stops = {wire.target: name for name in cut for wire in bindings[name].wires}
    silent = {w.target: n for n, b in bindings.items() if b.command and n not in cut for w in b.wires}
    silent |= {
        w.target: n for n, item in system.inputs.items() for w in item.targets if w.target not in stops
    }
    todo = [port.component for port, _ in binding.parts]
    seen: set[str] = set()
    driven: set[str] = set()
    missing: set[str] = set()
    while todo:
        component = todo.pop()
        if component in seen:
            continue
        seen.add(component)
        driven |= {name for port, name in stops.items() if port.component == component}
        missing |= {name for port, name in silent.items() if port.component == component}
        todo += [
            w.source.component
            for w in system.wires
            if w.target.component == component and w.target not in stops and w.target not in silent
        ]
    lacking = {name: [p for p, n in silent.items() if n == name and p.component in seen] for name in missing}
    # what nothing drives is not simulated from start values alone
    assumed = {n for n, ports in lacking.items() if driven and all(_given(system, p) for p in ports)}
    return Upstream(
        tuple(name for name in system.components if name in seen),
        tuple(name for name in bindings if name in driven),
        tuple(sorted(missing - assumed)),
        tuple(port for name in sorted(assumed) for port in lacking[name]),
    )


def _given(system: System, port: Port) -> bool:
    """Whether an input has a value without being measured, as a diagnosis of any system takes it."""
    part = system.components[port.component]
    known = port.variable in part.starts or part.fmu.variables[port.variable].start is not None
    return known and not (part.fmu.ours or part.fmu.house)


def groups(
    system: System, bindings: Mapping[str, Binding], measured: Iterable[str], cut: Iterable[str]
) -> tuple[list[Group], list[NotJudged]]:
    """Cut the model at its measured signals.

    Args:
        system: the model.
        bindings: of all signals that the system has.
        measured: those that the log holds.
        cut: those of them at which the model is cut.

    Returns:
        The groups that can be judged, and the blocks that cannot.
    """
    names, stops = set(measured), set(cut)
    found: dict[tuple[str, ...], list[str]] = {}
    ways: dict[tuple[str, ...], Upstream] = {}
    blocked: dict[tuple[str, ...], Upstream] = {}
    for name, binding in bindings.items():
        if binding.command:
            continue
        way = upstream(system, binding, bindings, stops)
        if name in names and not way.missing:
            found.setdefault(way.components, []).append(name)
            ways[way.components] = way
        elif name in names:
            blocked[way.components] = way
    order = list(system.components)
    judged = [
        Group(c, ways[c].driven_by, tuple(s))
        for c, s in sorted(found.items(), key=lambda i: order.index(i[0][-1]))
    ]
    return judged, _not_judged(system, bindings, names, judged, blocked)


def _not_judged(
    system: System,
    bindings: Mapping[str, Binding],
    measured: set[str],
    judged: list[Group],
    blocked: Mapping[tuple[str, ...], Upstream],
) -> list[NotJudged]:
    done = {component for group in judged for component in group.components}
    done |= {b.port.component for b in bindings.values() if b.command and b.port}  # replaced by the log
    result = []
    for components, way in blocked.items():
        missing = " and ".join(f"'{name}'" for name in way.missing)
        result.append(NotJudged(components, way.missing, f"their input {missing} is not in the log"))
        done |= set(components)
    rest: dict[tuple[str, ...], list[str]] = {}
    for component in system.components:
        if component not in done:
            needed = [
                name
                for name, b in bindings.items()
                if not b.command
                and name not in measured
                and component in upstream(system, b, bindings, measured).components
            ]
            rest.setdefault(tuple(needed), []).append(component)
    for signals, members in rest.items():
        text = " or ".join(f"'{name}'" for name in signals)
        why = f"the log has no {text}" if signals else "no signal of a log shows what it does"
        result.append(NotJudged(tuple(members), signals, why))
    return result


def separating(
    system: System, bindings: Mapping[str, Binding], measured: Iterable[str], group: Group
) -> dict[str, tuple[Port, Port]]:
    """Signals that the log lacks and that would split a group: name -> (output before, input behind)."""
    names = set(measured)
    return {
        name: (wire.source, wire.target)
        for name, binding in bindings.items()
        if name not in names
        for wire in binding.wires
        if {wire.source.component, wire.target.component} <= set(group.components)
    }
