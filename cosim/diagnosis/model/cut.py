"""A model's wiring cut at its measured signals into the groups that are judged one by one.

Works on any system of our blocks that is one chain: from a wiring file (.ssd) or a package (.ssp). Which variable a signal
stands for is known for our own names and otherwise said by the table ``[compare.signals]`` of a mapping.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from cosim.compare.binding import (
    DEFAULTS,
    DERIVED,
    START_PARAMETER,
    TRUSTED,
    angle_signals,
    gain_between,
)
from cosim.compare.mapping import CompareTable
from cosim.diagnosis.model.groups import DYNAMIC, SPEED, Group, Parts
from cosim.diagnosis.model.wiring import Wiring
from cosim.errors import DataError, ModelError, UsageError
from cosim.signals import SIGNALS
from cosim.ssp.hints import did_you_mean
from cosim.ssp.system import Port
from cosim.ssp.write import STIMULUS
from fmus import registry

HANDED_ON = "driving_pressure"  # slot of a block through which goes what the next one feels


@dataclass(frozen=True)
class Bound:
    """What a signal stands for.

    Attributes:
        source: the output that it measures; None for a command, which nothing in the model makes.
        targets: component inputs that it feeds.
        parts: what its sensors show, as (output, factor).
        gain: the variable per signal, SI.
    """

    source: Port | None
    targets: tuple[Port, ...]
    parts: tuple[tuple[Port, float], ...]
    gain: float


def bound(
    wiring: Wiring, table: CompareTable | None = None, units: Mapping[str, str] | None = None
) -> dict[str, Bound]:
    """What every signal stands for that the system has, measured or not.

    Args:
        wiring: the system.
        table: what the mapping file says.
        units: SI unit of each signal of the log.

    Raises:
        DataError: the table names a signal that the log does not hold.
        UsageError: it names a variable that does not exist, or a unit does not fit.
    """
    known = units or {}
    found: dict[str, Bound] = {}
    for name, target in (table.signals if table else {}).items():
        if name not in known:
            raise DataError(
                f"compare.signals names '{name}', which the log does not hold{did_you_mean(name, known)}"
            )
        found[name] = bound_to(wiring, name, known[name], target.variable, target.factor)
    taken = {t for b in found.values() for t in b.targets} | {b.source for b in found.values() if b.source}
    for name in dict.fromkeys([*wiring.inputs, *wiring.outputs, *DEFAULTS]):
        text = name if name in wiring.inputs or name in wiring.outputs else DEFAULTS[name]
        component, _, variable = text.partition(".")
        connector = text in wiring.inputs or text in wiring.outputs
        if name in found or not (connector or wiring.has(Port(component, variable))):
            continue
        unit = known.get(name) or (SIGNALS[name].si if name in SIGNALS else None)
        item = bound_to(wiring, name, unit, text, None)
        if item.source not in taken and not taken & set(item.targets):
            found[name] = item
    for name, parts in DERIVED.items():
        if name in found and all(part in found for part, _ in parts):
            ports = tuple((found[part].source, factor) for part, factor in parts)
            sum_of = tuple((port, factor) for port, factor in ports if port is not None)
            item = found[name]
            found[name] = Bound(item.source, item.targets, sum_of, item.gain)
    return found


def bound_to(wiring: Wiring, signal: str, unit: str | None, text: str, factor: str | None) -> Bound:
    """What a signal stands for, given a connector or ``component.variable``."""
    if text in wiring.inputs:
        targets = wiring.inputs[text]
        declared = wiring.unit(targets[0])
        return Bound(None, targets, (), gain_between(signal, unit or declared, declared, factor))
    port = wiring.outputs.get(text) or Port(*text.partition(".")[::2])
    if not wiring.has(port):
        variables = [
            f"{c}.{v}"
            for c, b in wiring.blocks.items()
            for v in (registry.block(b).inputs | registry.block(b).outputs)
        ]
        hint = did_you_mean(text, [*wiring.inputs, *wiring.outputs, *variables])
        raise UsageError(f"'{wiring.name}' has no '{text}' for the signal '{signal}'{hint}")
    declared = wiring.unit(port)
    gain = gain_between(signal, unit or declared, declared, factor)
    if port.variable in registry.block(wiring.blocks[port.component]).inputs:
        source = wiring.wires.get(port)
        if source is None:
            fed = next((targets for targets in wiring.inputs.values() if port in targets), (port,))
            return Bound(None, fed, (), gain)
        port = source
    targets = tuple(t for t, s in wiring.wires.items() if s == port)
    if wiring.blocks[port.component] == STIMULUS:
        return Bound(None, targets, (), gain)
    return Bound(port, targets, ((port, 1.0),), gain)


def start_values(wiring: Wiring, table: CompareTable | None, signals: Mapping[str, Bound]) -> dict[str, str]:
    """``component.parameter`` -> the signal whose first value it takes: an angle starts where its signal does.

    Raises:
        UsageError: the table names an unknown parameter or signal.
    """
    turning = [c for c, b in wiring.blocks.items() if START_PARAMETER in registry.block(b).parameters]
    wires = [(source, target) for target, source in wiring.wires.items()]
    mapped = table.signals if table else ()
    found = angle_signals(turning, wires, {n: b.source for n, b in signals.items()}, mapped)
    for name, signal in (table.start if table else {}).items():
        component, _, parameter = name.partition(".")
        if (
            component not in wiring.blocks
            or parameter not in registry.block(wiring.blocks[component]).parameters
        ):
            raise UsageError(f"compare.start names '{name}', which '{wiring.name}' does not have")
        if signal not in signals:
            raise UsageError(f"compare.start names the signal '{signal}'{did_you_mean(signal, signals)}")
        found[name] = signal
    return found


def cut(
    wiring: Wiring,
    signals: Mapping[str, Bound],
    starts: Mapping[str, str] | None = None,
    trusted: tuple[str, ...] = TRUSTED,
) -> tuple[Group, ...]:
    """The groups of a system, cut at every signal that could be measured, in the order of the flow.

    Args:
        wiring: the system.
        signals: what its signals stand for.
        starts: ``component.parameter`` -> signal whose first value it takes.
        trusted: parameters that are trusted to the tolerance only.

    Raises:
        ModelError: it is no chain, or nothing drives it.
    """
    chains = {}
    within = {port for pair in wiring.loops().values() for port in pair.ports}
    for name, item in signals.items():
        for target in item.targets:
            if target not in within:
                chains[name, target] = chain(wiring, signals, target)
    found: list[Group] = []
    drives = [name for name, item in signals.items() if item.source is None]
    while drives:
        drive = drives.pop(0)
        for target in signals[drive].targets:
            if target in within:
                continue
            stages, observed = chains[drive, target]
            if not observed or not any(block in DYNAMIC for _, block in stages):
                continue  # such as the observer: nothing of the drive itself shows in it
            before = next((g for g in found if drive in g.observed), None)
            found.append(group_of(wiring, signals, stages, drive, observed, before, starts or {}, trusted))
            drives += [s for s in observed if set(signals[s].targets) - within]
    if not found:
        raise ModelError(
            f"{wiring.name}: no signal drives a block whose output is a signal; a mapping's table [compare.signals] says "
            "which variable each signal stands for"
        )
    return tuple(found)


def chain(
    wiring: Wiring, signals: Mapping[str, Bound], target: Port
) -> tuple[list[tuple[str, str]], list[str]]:
    """The components from an input to the next signals, and these.

    A signal that feeds nothing, such as a speed beside the angle, does not end the chain: what is behind is judged, too.
    Nor does one between two components that feed back.
    """
    loops = wiring.loops()
    within = {port for pair in loops.values() for port in pair.ports}
    stages: list[tuple[str, str]] = []
    seen: list[str] = []
    while True:
        component = target.component
        block = wiring.blocks[component]
        closing = loops[component].back if component in loops else None
        outside = [t for targets in wiring.inputs.values() for t in targets]
        fed = [p for p in (*wiring.wires, *outside) if p.component == component and p != closing]
        if len(fed) > 1 or (component, block) in stages:
            if block in DYNAMIC:
                raise ModelError(
                    f"{wiring.name}: its components {', '.join(wiring.blocks)} are not those of a model that can be "
                    f"diagnosed: '{component}' is fed by {' and '.join(map(str, fed))}, and only a chain can be cut"
                )
            return stages, seen
        waiting = [n for n, way in registry.block(block).reads.items() if way == "start"]
        if waiting and component not in loops:
            raise ModelError(
                f"{wiring.name}: '{component}.{waiting[0]}' is not fed by what '{component}' drives: wire the speed "
                "of the mechanics to it, or take the block 'continuity'"
            )
        stages.append((component, block))
        shown = [s for s, item in signals.items() if item.source and item.source.component == component]
        if shown:
            # ports that are parts of another signal are no signals of their own here
            parts = {p for s in shown for p, _ in signals[s].parts if len(signals[s].parts) > 1}
            seen += [s for s in shown if signals[s].source not in parts]
        behind = [t for t, s in wiring.wires.items() if s.component == component]
        if component in loops:
            target = loops[component].forth
            continue
        behind = [t for t in behind if t not in within]
        if not behind or any(set(signals[s].targets) - within for s in seen):
            return stages, seen
        if len({t.component for t in behind}) > 1:
            if seen:
                return stages, seen
            raise ModelError(
                f"{wiring.name}: behind '{component}' the signal goes to {' and '.join(t.component for t in behind)}; "
                "only a chain of blocks can be cut"
            )
        target = behind[0]


def group_of(
    wiring: Wiring,
    signals: Mapping[str, Bound],
    stages: list[tuple[str, str]],
    drive: str,
    observed: list[str],
    before: Group | None,
    starts: Mapping[str, str],
    trusted: tuple[str, ...],
) -> Group:
    """One group of a cut."""
    inside = {component for component, _ in stages}
    own = tuple(n for n in trusted if has_parameter(dict(stages), n))
    named = [c for c, b in stages if b in DYNAMIC]
    loop = next(((c, p.forth.component) for c, p in wiring.loops().items() if c in inside), None)
    moves = any(block in ("mechanical", "simplified") for _, block in stages)
    if loop is not None and loop[1] != named[-1]:
        raise ModelError(
            f"{wiring.name}: behind the loop of {' and '.join(loop)} '{named[-1]}' follows with nothing measured between"
        )
    # what drives the next group first, then what is furthest down the flow, a speed behind its angle
    order = {component: -i for i, (component, _) in enumerate(stages)}
    within = {port for pair in wiring.loops().values() for port in pair.ports}
    observed = sorted(
        observed, key=lambda s: (not set(signals[s].targets) - within, *place(signals[s].source, order))
    )
    slot = None
    if before is not None:
        component, block = before.stages[-1]
        if HANDED_ON in registry.block(block).slots:
            slot = (component, block, HANDED_ON)
    parts: dict[str, Parts] = {}
    for signal in observed:
        made = tuple(
            (port.variable if port.component == stages[-1][0] else str(port), factor)
            for port, factor in signals[signal].parts
        )
        if made != ((signal, 1.0),):
            parts[signal] = made
    return Group(
        named[-1] if loop is None else "+".join(loop),
        tuple(stages),
        drive,
        tuple(observed),
        held=registry.block(stages[0][1]).commanded,
        moves=moves,
        upstream_slot=slot,
        trusted=own,
        parts=tuple(parts.items()),
        starts=tuple((n, s) for n, s in starts.items() if n.partition(".")[0] in inside and s in observed),
        # only a shift of the valve's neutral shows as a constant, but not where what follows integrates it
        absolute="dcv" in named and not moves,
        loop=loop,
    )


def has_parameter(stages: Mapping[str, str], name: str) -> bool:
    """True if ``component.parameter`` is one of a block among these, component -> block, or of an effect on it."""
    component, _, parameter = name.partition(".")
    if component not in stages:
        return False
    block = registry.block(stages[component])
    return parameter in block.parameters or any(
        parameter in e.parameters for e in registry.effects_on(component, block.name)
    )


def place(source: Port | None, order: Mapping[str, int]) -> tuple[int, bool]:
    """Where a signal stands among those of a group."""
    return (0, False) if source is None else (order[source.component], source.variable == SPEED)
