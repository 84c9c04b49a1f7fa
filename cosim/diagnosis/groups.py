"""How a model is cut at its measured signals into groups of blocks, each driven by a measurement and judged by one.

Between two measured signals the blocks act as one: the compensator, the dead zone and the valve between command and spool;
the continuity between spool and pressure; mechanics and slew sensor between pressure and angle.
"""

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import CompiledBlock, compiled_block
from fmus import registry
from fmus.contract import Effect

Array = NDArray[np.float64]

_LEFT_OUT: ContextVar[frozenset[str]] = ContextVar("left_out", default=frozenset())


@contextmanager
def left_out(*names: str) -> Iterator[None]:
    """Within this context no group considers the effects of these names: to see what is said of a cause nobody knows."""
    token = _LEFT_OUT.set(_LEFT_OUT.get() | frozenset(names))
    try:
        yield
    finally:
        _LEFT_OUT.reset(token)


@dataclass(frozen=True)
class Group:
    """Blocks between two measured signals.

    Attributes:
        name: the block that is named when nothing closer is known.
        stages: (component, block) in the order of the signal flow.
        drive: the signal that drives the first; `held` if it is held over a step.
        observed: the signals that the group predicts.
        integrates: the prediction drifts with any constant error of the drive, so only its shape within a window counts.
        upstream_slot: (component, block, equation) through which the drive passes first, where an effect of the
            block before acts on what this group feels but not on what is measured.
    """

    name: str
    stages: tuple[tuple[str, str], ...]
    drive: str
    observed: tuple[str, ...]
    held: bool = False
    integrates: bool = False
    upstream_slot: tuple[str, str, str] | None = None
    excluded: tuple[str, ...] = ()  # effects that something else has settled already

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components, in order."""
        return tuple(component for component, _ in self.stages)

    def effects(self) -> tuple[Effect, ...]:
        """The effects of the library that this group can show.

        An effect that acts on what the next group feels, and not on what is measured between, belongs to the next.
        """
        slot = self.upstream_slot
        found = []
        for effect in registry.effects().values():
            if effect.name in self.excluded or effect.name in _LEFT_OUT.get():
                continue
            handed_on = set(effect.fills) == {"driving_pressure"}
            inside = effect.component in self.components[:-1] or not handed_on
            handed = slot and handed_on and effect.component == slot[0] and slot[2] in effect.fills
            if handed or (effect.component in self.components and inside):
                found.append(effect)
        return tuple(found)


VALVE = Group(
    "dcv",
    (("compensator", "dead_zone"), ("dead_zone", "dead_zone"), ("dcv", "dcv")),
    "u",
    ("spool",),
    held=True,
)
CONTINUITY = Group("continuity", (("continuity", "continuity"),), "spool", ("p_load", "p_supply"))
MECHANICS = Group(
    "mechanical",
    (("mechanical", "mechanical"), ("sensor", "sensor")),
    "p_load",
    ("slew",),
    integrates=True,
    upstream_slot=("continuity", "continuity", "driving_pressure"),
)
SIMPLIFIED = Group(
    "simplified",
    (
        ("compensator", "dead_zone"),
        ("dead_zone", "dead_zone"),
        ("simplified", "simplified"),
        ("sensor", "sensor"),
    ),
    "u",
    ("slew",),
    held=True,
    integrates=True,
)

MODELS: dict[str, tuple[Group, ...]] = {
    "full_order": (VALVE, CONTINUITY, MECHANICS),
    "simplified": (SIMPLIFIED,),
}

# parameters trusted to the tolerance only (CONTRACT section 4); all else is taken as exact
TRUSTED = (
    "dcv.K",
    "dcv.w0",
    "dcv.zeta",
    "continuity.K_c",
    "continuity.T",
    "mechanical.J",
    "mechanical.b",
    "simplified.k",
    "simplified.a",
)

# what a component is set to where its block's declaration does not say it (ssp/nominal/*.ssv)
COMPONENT_VALUES = {"compensator.form": 3.0, "compensator.limit": 2.0}


def compiled_stage(component: str, block: str) -> CompiledBlock:
    """The compiled block of a component."""
    return compiled_block(block, component)


def merged(groups: tuple[Group, ...], signals: Collection[str]) -> tuple[Group, ...]:
    """Groups joined where the signal between them was not measured: they can only be judged as one."""
    found: list[Group] = []
    for group in groups:
        before = found[-1] if found else None
        if before is not None and before.observed[0] not in signals and before.observed[0] == group.drive:
            joined = replace(
                group,
                name=f"{before.name}+{group.name}",
                stages=before.stages + group.stages,
                drive=before.drive,
                held=before.held,
                upstream_slot=before.upstream_slot,
            )
            found[-1] = joined
        else:
            found.append(group)
    return tuple(found)


class GroupModel:
    """A group simulated over a log, again and again with other parameters.

    Args:
        group: the blocks.
        drive: (n,) the driving signal, SI, one value a step.
        h: step, s.
        fixed: ``component.parameter`` -> SI of everything that differs from nominal and is not estimated.
    """

    def __init__(self, group: Group, drive: Array, h: float, fixed: dict[str, float] | None = None) -> None:
        self.group = group
        self.drive = np.ascontiguousarray(drive, dtype=np.float64)
        self.h = h
        self.fixed = COMPONENT_VALUES | (fixed or {})
        self.stages = [(c, compiled_stage(c, b)) for c, b in group.stages]
        self.kept: dict[int, tuple[tuple[float, ...], Array]] = {}

    def nominal(self, name: str) -> float:
        """Value of ``component.parameter`` before anything is estimated."""
        if name in self.fixed:
            return self.fixed[name]
        component, _, parameter = name.partition(".")
        for found, block in self.stages:
            if found == component:
                return block.nominal[parameter]
        slot = self.group.upstream_slot
        if slot and slot[0] == component:
            return compiled_stage(slot[0], slot[1]).nominal[parameter]
        raise KeyError(name)

    def simulate(self, values: dict[str, float]) -> dict[str, Array]:
        """Predicted signals, (n,) each, SI, with ``component.parameter`` -> value replaced."""
        settings = self.fixed | values
        signal = self.fed(settings)
        changed = False
        outputs = np.empty((0, 0))
        for i, (component, block) in enumerate(self.stages):
            own = {n.partition(".")[2]: v for n, v in settings.items() if n.startswith(component + ".")}
            key = tuple(own.get(name, v) for name, v in block.nominal.items())
            if i == 0 and self.group.upstream_slot:
                prefix = self.group.upstream_slot[0] + "."
                key += tuple(sorted(v for n, v in settings.items() if n.startswith(prefix)))
            kept = self.kept.get(i)
            if kept is not None and kept[0] == key and not changed:
                outputs = kept[1]
            else:
                # a held drive acts from the start of a step, a continuous one is known at its end
                steps = signal[:-1] if i == 0 and self.group.held else signal[1:]
                outputs = block.run(steps[None, :], self.h, own, signal[:1])
                changed = True
                if i + 1 < len(self.stages):
                    self.kept[i] = (key, outputs)
            signal = outputs[0]
        return self.observed(outputs)

    def fed(self, settings: dict[str, float]) -> Array:
        """The drive as the first block feels it."""
        slot = self.group.upstream_slot
        if slot is None:
            return self.drive
        component, block, equation = slot
        own = {n.partition(".")[2]: v for n, v in settings.items() if n.startswith(component + ".")}
        compiled = compiled_stage(component, block)
        if all(own.get(name, v) == v for name, v in compiled.nominal.items()):
            return self.drive
        memory = compiled.module.Memory(*([0.0] * len(compiled.module.Memory._fields)))
        return np.asarray(
            getattr(compiled.module, f"over_{equation}")(self.drive, memory, compiled.parameters(own))
        )

    def observed(self, outputs: Array) -> dict[str, Array]:
        """Measured signals from the outputs of the last stage."""
        names = list(self.stages[-1][1].composed.outputs)
        row = dict(zip(names, outputs, strict=True))
        found = {}
        for signal in self.group.observed:
            if signal == "p_load":
                found[signal] = row["p_a"] - row["p_b"]  # what the ports show, not what the mechanics feel
            else:
                found[signal] = row[signal]
        return found


def names_of(effects: Iterable[Effect]) -> list[str]:
    """Names of effects, in order."""
    return [effect.name for effect in effects]
