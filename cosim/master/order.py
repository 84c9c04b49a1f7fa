"""In which order components are stepped, and which connections carry last step's value.

Gauss-Seidel: a component is stepped after the sources of its inputs. Where connections form a loop, one component of the
loop goes first and its inputs from within the loop carry the value of the step before. That component is the one with

1. the fewest loop connections into inputs that act directly on its outputs (ModelStructure of the FMU; an output without
   declared dependencies depends on every input): a delayed input that only drives a state costs an order of accuracy less;
2. then the fewest loop connections at all;
3. then the first in the file.

What remains of the loop is ordered the same way. So the choice depends on the file alone, never on chance.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from cosim.ssp.system import Fmu, Wire


@dataclass(frozen=True)
class Order:
    """Components in stepping order, and the wires that carry last step's value."""

    names: tuple[str, ...]
    delayed: tuple[Wire, ...]


def acts_directly(fmu: Fmu, name: str) -> bool:
    """Whether an output may depend on this input without a delay (FMI 2.0, section 2.2.8)."""
    outputs = [v.name for v in fmu.variables.values() if v.causality == "output"]
    return any(name in fmu.dependencies.get(output, {name}) for output in outputs)


def step_order(fmus: Mapping[str, Fmu], wires: Iterable[Wire]) -> Order:
    """Order the components by their wires.

    Args:
        fmus: the FMU of each component, in the order of the file.
        wires: the connections that hand over a value of the same step.
    """
    kept = list(wires)
    names = tuple(_ordered(list(fmus), kept, fmus))
    place = {name: k for k, name in enumerate(names)}
    delayed = tuple(w for w in kept if place[w.source.component] >= place[w.target.component])
    return Order(names, delayed)


def _ordered(names: Sequence[str], wires: Sequence[Wire], fmus: Mapping[str, Fmu]) -> list[str]:
    """Names in order; wires that end before they start are the delayed ones."""
    inner = [w for w in wires if w.source.component != w.target.component]
    remaining, ordered = list(names), []
    while remaining:
        waiting = {w.target.component for w in inner if w.source.component in remaining}
        ready = next((name for name in remaining if name not in waiting), None)
        if ready is None:
            ready = _loop_breaker(remaining, inner, fmus)
        ordered.append(ready)
        remaining.remove(ready)
    return ordered


def _loop_breaker(names: Sequence[str], wires: Sequence[Wire], fmus: Mapping[str, Fmu]) -> str:
    """The component that goes first, of those in a loop that waits for no other loop."""
    reach = {name: _upstream(name, names, wires) for name in names}
    source = [n for n in names if n in reach[n] and all(n in reach[m] for m in reach[n])]

    def cost(name: str) -> tuple[int, int, int]:
        into = [w for w in wires if w.target.component == name and w.source.component in reach[name]]
        direct = sum(acts_directly(fmus[name], w.target.variable) for w in into)
        return direct, len(into), names.index(name)

    loops = [reach[n] for n in source]
    # the first loop of the file; its members reach the same set
    return min((n for n in source if reach[n] == loops[0]), key=cost)


def _upstream(name: str, names: Sequence[str], wires: Sequence[Wire]) -> frozenset[str]:
    """Every component whose output reaches `name`, itself among them if it is in a loop."""
    found: set[str] = set()
    todo = [name]
    while todo:
        target = todo.pop()
        for wire in wires:
            source = wire.source.component
            if wire.target.component == target and source in names and source not in found:
                found.add(source)
                todo.append(source)
    return frozenset(found)
