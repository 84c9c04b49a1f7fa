"""The graph of a system, cut at every measured signal into groups that can be judged by themselves.

A signal is what an output hands on, or what comes in from outside. Where it was measured, components behind it are driven
by the measurement and the component before it is judged by it; components joined by a signal that was not measured are
one group. Within a group components that form a loop are stepped together (a unit); units follow one another.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from cosim.errors import DataError
from cosim.ssp.effects import follows_motion, read_at
from cosim.ssp.hints import did_you_mean
from cosim.ssp.system import NUMERIC, Port, System, Wire


@dataclass(frozen=True)
class Unit:
    """Components that are stepped together.

    Attributes:
        components: one, or those of a loop that no measurement cuts.
    """

    components: tuple[str, ...]


@dataclass(frozen=True)
class Drive:
    """A measured signal that drives an input: input = factor * signal + offset."""

    signal: str
    port: Port
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class CutGroup:
    """What is judged by itself.

    Attributes:
        units: in an order in which sources come before targets.
        drives: measured signals that enter.
        inner: wires between its units that were not measured.
        judged: measured outputs that are Real, signal -> port; what is a whole number, or true or false, only drives.
        missing: inputs from outside that were not measured.
    """

    units: tuple[Unit, ...]
    drives: tuple[Drive, ...]
    inner: tuple[Wire, ...]
    judged: tuple[tuple[str, Port], ...]
    missing: tuple[str, ...]

    @property
    def components(self) -> tuple[str, ...]:
        """Names of its components."""
        return tuple(c for unit in self.units for c in unit.components)

    @property
    def name(self) -> str:
        """Its components in one word."""
        return "+".join(self.components)

    @property
    def source(self) -> bool:
        """True if nothing enters it."""
        return not self.drives and not self.missing


def port_of(system: System, name: str) -> Port:
    """Where what a column stands for is read: at the port called so, or beyond the effects of an extended model there.

    Raises:
        DataError: there is none, or it holds no number.
    """
    return read_at(system, port_called(system, name))


def port_called(system: System, name: str) -> Port:
    """The port that is called ``component.connector``, or like a connector of the system or of the only component.

    Inputs of the system give a port without component.

    Raises:
        DataError: there is none, or it holds no number.
    """
    if name in system.inputs:
        return Port("", name)
    if name in system.outputs:
        return system.outputs[name]
    component, dot, variable = name.partition(".")
    if (not dot or component not in system.components) and len(system.components) == 1:
        (component, only), variable = next(iter(system.components.items())), name
        if variable not in only.fmu.variables and dot:
            variable = name.partition(".")[2]
    known = connectors(system)
    if component not in system.components or variable not in system.components[component].fmu.variables:
        raise DataError(f"the system has no connector '{name}'{did_you_mean(name, known)}")
    port = Port(component, variable)
    found = system.variable(port)
    if found.kind not in NUMERIC or found.causality not in ("input", "output", "local"):
        raise DataError(
            f"'{name}' is a {found.kind} {found.causality}: only signals that are numbers can be measured"
        )
    return port


def connectors(system: System) -> list[str]:
    """Names of all inputs and outputs that are numbers, ``component.connector``, and of the system's own."""
    own = [
        f"{c.name}.{v.name}"
        for c in system.components.values()
        for v in c.fmu.variables.values()
        if v.kind in NUMERIC and v.causality in ("input", "output")
    ]
    return [*own, *system.inputs]


def feeders(system: System) -> dict[Port, tuple[Port, float, float]]:
    """What feeds each connected input: (source port, factor, offset); sources without component are system inputs."""
    found = {w.target: (w.source, w.factor, w.offset) for w in system.wires}
    for item in system.inputs.values():
        found |= {w.target: (Port("", item.name), w.factor, w.offset) for w in item.targets}
    return found


def measured_ports(
    system: System, names: Collection[str]
) -> tuple[dict[str, Port], dict[str, tuple[Port, float, float]]]:
    """What each measured name stands for.

    Returns:
        (name -> port of the source, name -> (input port, factor, offset) of readings taken behind a source that was
        measured itself).
    """
    fed = feeders(system)
    ports = {name: port_of(system, name) for name in names}
    sources: dict[str, Port] = {}
    behind: dict[str, tuple[Port, float, float]] = {}
    taken: set[Port] = set()
    outputs_first = sorted(ports, key=lambda n: ports[n] in fed)
    for name in outputs_first:
        port = ports[name]
        source, factor, offset = fed.get(port, (port, 1.0, 0.0))
        if source in taken or (source != port and (factor, offset) != (1.0, 0.0)):
            behind[name] = (port, factor, offset)
        else:
            sources[name] = source
        taken.add(source)
    return sources, behind


def cut(system: System, names: Collection[str]) -> tuple[CutGroup, ...]:
    """The groups between the measured signals, upstream first where there is an upstream.

    Args:
        system: the system.
        names: what was measured, as `port_of` takes it.

    Raises:
        DataError: a name is no connector.
    """
    sources, behind = measured_ports(system, names)
    by_port = {port: name for name, port in sources.items()}
    read_at = {port: name for name, (port, _, _) in behind.items()}
    fed = feeders(system)
    inner = [
        w
        for w in system.wires
        if follows_motion(system, w.target) or (w.source not in by_port and w.target not in read_at)
    ]
    groups = []
    for members in _joined(list(system.components), inner):
        own = [w for w in inner if w.source.component in members]
        drives, missing = [], []
        for target in fed:
            if target.component not in members:
                continue
            source, factor, offset = fed[target]
            if follows_motion(system, target):
                continue
            if target in read_at:
                drives.append(Drive(read_at[target], target))
            elif source in by_port:
                drives.append(Drive(by_port[source], target, factor, offset))
            elif not source.component:
                missing.append(source.variable)
        # an input that nothing feeds can be measured too
        drives += [
            Drive(name, port)
            for port, name in by_port.items()
            if port.component in members and _is_input(system, port)
        ]
        judged = [
            (name, port)
            for name, port in sources.items()
            if port.component in members
            and not _is_input(system, port)
            and system.variable(port).kind == "Real"
        ]
        units = _units(members, own)
        groups.append(
            CutGroup(units, tuple(drives), tuple(own), tuple(judged), tuple(dict.fromkeys(missing)))
        )
    return tuple(upstream_first(groups))


def together(groups: Iterable[CutGroup]) -> CutGroup:
    """Groups judged as one: several of a cut, or the same components in several cuts."""
    all_ = list(groups)
    units = list(dict.fromkeys(u for g in all_ for u in g.units))
    largest = [u for u in units if not any(set(u.components) < set(other.components) for other in units)]
    return CutGroup(
        tuple(largest),
        tuple(dict.fromkeys(d for g in all_ for d in g.drives)),
        tuple(dict.fromkeys(w for g in all_ for w in g.inner)),
        tuple(dict.fromkeys(j for g in all_ for j in g.judged)),
        tuple(dict.fromkeys(m for g in all_ for m in g.missing)),
    )


def _is_input(system: System, port: Port) -> bool:
    return bool(port.component) and system.variable(port).causality == "input"


def _joined(names: list[str], wires: Iterable[Wire]) -> list[list[str]]:
    """Sets of components joined by wires, in the order of the file."""
    label = {name: k for k, name in enumerate(names)}
    for wire in wires:
        one, other = label[wire.source.component], label[wire.target.component]
        label = {n: min(one, other) if k in (one, other) else k for n, k in label.items()}
    return [[n for n in names if label[n] == k] for k in sorted(set(label.values()))]


def _units(members: list[str], wires: list[Wire]) -> tuple[Unit, ...]:
    """Loops of the members, and the others one by one, sources before targets (Tarjan 1972)."""
    ahead: dict[str, list[str]] = {m: [] for m in members}
    for wire in wires:
        ahead[wire.source.component].append(wire.target.component)
    order: list[Unit] = []
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []

    def visit(name: str) -> None:
        number[name] = low[name] = len(number)
        stack.append(name)
        for target in ahead[name]:
            if target not in number:
                visit(target)
                low[name] = min(low[name], low[target])
            elif target in stack:
                low[name] = min(low[name], number[target])
        if low[name] == number[name]:
            at = stack.index(name)
            order.append(Unit(tuple(m for m in members if m in stack[at:])))
            del stack[at:]

    for member in members:
        if member not in number:
            visit(member)
    return tuple(reversed(order))


def upstream_first(groups: Iterable[CutGroup]) -> list[CutGroup]:
    """Groups whose drives come from groups before them, as far as loops allow."""
    left, ordered = list(groups), []
    while left:
        waiting = {s for g in left for s, _ in g.judged}
        free = [g for g in left if not any(d.signal in waiting - {s for s, _ in g.judged} for d in g.drives)]
        chosen = free[0] if free else left[0]
        ordered.append(chosen)
        left.remove(chosen)
    return ordered
