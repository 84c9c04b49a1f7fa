"""Groups of blocks between measured signals, each driven by a measurement and judged by one; and their simulation.

Between two measured signals the blocks act as one: the compensator, the dead zone and the valve between command and spool;
the continuity between spool and pressure; mechanics and slew sensor between pressure and angle. Two blocks that feed back
are one group, whatever is measured between them. `cosim.diagnosis.model.cut` finds them in a model's wiring.
"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cosim.paths import ssp_folder
from fmus import registry
from fmus.contract import Effect, Free

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


Parts = tuple[
    tuple[str, float], ...
]  # a signal as a sum of factor * output (``component.output`` but of the last block)
SPEED = "omega"  # output of a block that is the rate of its angle


@dataclass(frozen=True)
class Group:
    """Blocks between two measured signals.

    Attributes:
        name: the block that is named when nothing closer is known.
        stages: (component, block) in the order of the signal flow.
        drive: the signal that drives the first; `held` if it is held over a step.
        observed: the signals that the group predicts.
        moves: it holds the mechanics, so what drives it is integrated, to a speed at least.
        upstream_slot: (component, block, equation) through which the drive passes first, where an effect of the
            block before acts on what this group feels but not on what is measured.
        excluded: effects that are no candidates: something else has settled them, or this machine cannot have them.
        trusted: ``component.parameter`` that is trusted to the tolerance only; all else is taken as exact.
        parts: observed signal -> what it is made of, where that is not the output of its name.
        starts: ``component.parameter`` -> the signal whose first value it takes.
        absolute: a constant error counts whatever is measured (see `level_counts`).
        drifting: of a speed it does not count: its zero wanders.
        place: what stands for its speed is a place: the drive holds the one it is told.
        asked: effects that are candidates on request only and were requested.
        scale: SI unit, or ``component.parameter`` -> how much smaller or larger than on the crane a typical change is, for
            the searches.
        loop: two components that feed back: they run in turns, and the second's effects show in what the first makes.
    """

    name: str
    stages: tuple[tuple[str, str], ...]
    drive: str
    observed: tuple[str, ...]
    held: bool = False
    moves: bool = False
    upstream_slot: tuple[str, str, str] | None = None
    excluded: tuple[str, ...] = ()
    trusted: tuple[str, ...] = ()
    parts: tuple[tuple[str, Parts], ...] = ()
    starts: tuple[tuple[str, str], ...] = ()
    absolute: bool = False
    drifting: bool = False
    place: bool = False
    asked: tuple[str, ...] = ()
    scale: tuple[tuple[str, float], ...] = ()
    loop: tuple[str, str] | None = None

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components, in order."""
        return tuple(component for component, _ in self.stages)

    @property
    def commanded(self) -> bool:
        """True if a command drives it."""
        return registry.block(self.stages[0][1]).commanded

    @property
    def kind(self) -> str:
        """Block whose linear part carries what is missing to the signal: the last one with dynamics."""
        moving = [block for _, block in self.stages if block in DYNAMIC]
        return moving[-1] if moving else self.stages[-1][1]

    @property
    def linear(self) -> tuple[str, ...]:
        """``component.parameter`` of the linear part that carries what is missing to the signal."""
        if self.loop is not None:
            return tuple(f"{c}.{p}" for c, own in zip(self.loop, LOOP, strict=True) for p in own)
        component = next(c for c, b in reversed(self.stages) if b == self.kind)
        return tuple(f"{component}.{parameter}" for parameter in DYNAMIC.get(self.kind, ()))

    @property
    def integrates(self) -> bool:
        """True if a place is measured: what the prediction errs by piles up, as it does not where only speeds are."""
        return self.moves and not all(self.is_speed(s) for s in self.observed)

    @property
    def level_counts(self) -> bool:
        """True if a constant error counts; elsewhere each window has an offset of its own."""
        return self.absolute or (self.moves and not self.integrates and not self.drifting)

    @property
    def drifts(self) -> bool:
        """True if a constant error of the drive moves the prediction away, and the place itself does not count."""
        return self.integrates and not self.absolute

    @property
    def reading(self) -> str | None:
        """The signal that a sensor of this group reads, if there is one."""
        return self.observed[0] if self.stages and self.stages[-1][1] == "sensor" else None

    def output_of(self, signal: str) -> str:
        """The output that a signal shows, ``p_load`` also where its ports are measured."""
        (output, _), *more = dict(self.parts).get(signal, ((signal, 1.0),))
        return "p_load" if more else output.rpartition(".")[2]

    @property
    def telling(self) -> tuple[str, ...]:
        """The signal by which the group is known, and, of two that feed back, the one between them."""
        first, *others = self.observed
        return (first, *(s for s in others if self.loop is not None and self.output_of(s) == "p_load"))

    def is_speed(self, signal: str) -> bool:
        """True if a signal is the speed, not the angle: a gyroscope or a tachometer."""
        (output, _), *more = dict(self.parts).get(signal, ((signal, 1.0),))
        return not more and output.rpartition(".")[2] == SPEED

    def shows(self, component: str, output: str) -> str:
        """The measured signal that shows an output of a component as it is; empty where none does."""
        parts = dict(self.parts)
        end, block = self.stages[-1]
        for signal in self.observed:
            made = parts.get(signal, ((signal, 1.0),))
            if made == ((f"{component}.{output}", 1.0),) or (component == end and made == ((output, 1.0),)):
                return signal
        # a sensor shows the angle that it is fed with
        fed = block == "sensor" and self.components[-2:-1] == (component,)
        return self.observed[0] if fed and output == "theta" else ""

    def effects(self) -> tuple[Effect, ...]:
        """The effects of the library that this group can show.

        An effect that acts on what the next group feels, and not on what is measured between, belongs to the next.
        """
        slot = self.upstream_slot
        lumped = sum(block in DYNAMIC for _, block in self.stages) > 1
        last = next((c for c, block in reversed(self.stages) if block in DYNAMIC), "")
        lost = self.behind_lost_motion()
        found: list[Effect] = []
        for effect in registry.effects().values():
            if effect.name in self.excluded or effect.name in _LEFT_OUT.get():
                continue
            asked = effect.name in self.asked
            if not asked and (effect.asked or (effect.alone and lumped)):
                continue
            if not asked and effect.ends and effect.component != last:
                continue
            # the angle that a model makes of a speed alone drifts by more than such a law's period
            if not asked and effect.repeats and not self.integrates:
                continue
            handed_on = set(effect.fills) == {"driving_pressure"}
            inside = effect.component in self.components[:-1] or not handed_on
            handed = slot and handed_on and effect.component == slot[0] and slot[2] in effect.fills
            if (handed or (effect.component in self.components and inside)) and effect.name not in lost:
                block = self.block_of(effect.component)
                here = registry.effect_on(effect.name, block)
                if here is not None:
                    here = scaled(effect.name, block, self.scale) if self.scale else here
                    found.append(
                        here.formed(here.form_of_place) if self.place and here.form_of_place else here
                    )
        return tuple(found)

    def behind_lost_motion(self) -> tuple[str, ...]:
        """Effects that are no candidates because with them the sensor sees another speed than the one that is fed back."""
        if self.loop is None:
            return ()
        own = (e for e in registry.effects().values() if e.component == self.loop[1])
        return tuple(
            e.name for e in own if "seen_velocity" in e.fills and (not e.asked or e.name in self.asked)
        )

    def block_of(self, component: str) -> str:
        """Block that a component of this group, or the one before, runs."""
        slot = self.upstream_slot
        return slot[1] if slot and slot[0] == component else dict(self.stages)[component]


# blocks with dynamics, and the parameters of their linear part
DYNAMIC: dict[str, tuple[str, ...]] = {
    "dcv": ("K", "w0", "zeta"),
    "continuity": ("K_c", "T"),
    "continuity_physical": ("w", "beta"),
    "mechanical": ("J", "b"),
    "simplified": ("k", "a"),
}
# of two that feed back: the parameters of their linear part
LOOP = (("C_d", "w", "rho", "beta", "V_L", "V_A", "V_B", "C_L", "p_s", "A", "r"), ("J", "b", "A", "r"))


@cache
def scaled(name: str, block: str, scale: tuple[tuple[str, float], ...]) -> Effect:
    """The effect as it is in a block; starts, typical size and floor of each parameter by its own factor or its unit's."""
    effect, factors = registry.effect_on(name, block), dict(scale)
    assert effect is not None

    def moved(effect: Effect, listed: Mapping[str, Free]) -> dict[str, Free]:
        found = {}
        for parameter, item in listed.items():
            variable = effect.parameters.get(parameter) or registry.parameter(effect.component, parameter)
            factor = factors.get(f"{effect.component}.{parameter}", factors.get(variable.unit, 1.0))
            starts = tuple(v * factor for v in item.starts)
            found[parameter] = replace(
                item, starts=starts, scale=item.scale * factor, floor=item.floor * factor
            )
        return found

    return replace(effect, free=moved(effect, effect.free), forms=moved(effect, effect.forms))


class OurModels(Mapping[str, tuple[Group, ...]]):
    """The models that come with the package, cut at every signal that a log of the rig may hold."""

    def __getitem__(self, name: str) -> tuple[Group, ...]:
        """Groups of a model.

        Raises:
            KeyError: no such model.
        """
        if name not in NAMES:
            raise KeyError(name)
        return our_groups(name)

    def __iter__(self) -> Iterator[str]:
        """Names of the models."""
        return iter(NAMES)

    def __len__(self) -> int:
        """Number of models."""
        return len(NAMES)


@cache
def our_groups(name: str) -> tuple[Group, ...]:
    """Groups of one of our models, from its wiring file."""
    from cosim.diagnosis.model.cut import bound, cut, start_values
    from cosim.diagnosis.model.wiring import wiring_of_file

    wiring = wiring_of_file(ssp_folder() / f"{name}.ssd")
    signals = bound(wiring)
    return cut(wiring, signals, start_values(wiring, None, signals))


NAMES = ("full_order", "simplified", "physical")
MODELS: Mapping[str, tuple[Group, ...]] = OurModels()

# what a component is set to where its block's declaration does not say it (ssp/nominal/*.ssv)
COMPONENT_VALUES = {"compensator.form": 3.0, "compensator.limit": 2.0}


def merged(groups: tuple[Group, ...], signals: Collection[str]) -> tuple[Group, ...]:
    """Groups joined where the signal between them was not measured: they can only be judged as one.

    Of several signals of one group those that were measured stay, and the blocks up to the last that one of them shows.
    """
    found: list[Group] = []
    drives = {g.drive for g in groups}
    for group in (g if g.observed[0] in drives else narrowed(g, signals) for g in groups):
        before = found[-1] if found else None
        if before is not None and before.observed[0] not in signals and before.observed[0] == group.drive:
            joined = replace(
                group,
                name=f"{before.name}+{group.name}",
                stages=before.stages + group.stages,
                drive=before.drive,
                held=before.held,
                upstream_slot=before.upstream_slot,
                trusted=before.trusted + group.trusted,
                starts=before.starts + group.starts,
                absolute=group.absolute or (before.absolute and not group.moves),
                loop=group.loop or before.loop,
            )
            found[-1] = joined
        else:
            found.append(group)
    return tuple(found)


def narrowed(group: Group, signals: Collection[str]) -> Group:
    """The group where its first signal was not measured but another one was."""
    seen = tuple(s for s in group.observed if s in signals)
    if not seen or group.observed[0] in signals:
        return group
    parts = dict(group.parts)
    shown = [output.rpartition(".")[0] for s in seen for output, _ in parts.get(s, ((s, 1.0),))]
    last = max(
        group.components.index(c) if c else len(group.stages) - 1 for c in (*shown, *(group.loop or ()))
    )
    end = group.components[last]
    made = {
        s: tuple((output.removeprefix(f"{end}."), factor) for output, factor in parts[s])
        for s in seen
        if s in parts
    }
    kept = set(group.components[: last + 1])
    return replace(
        group,
        stages=group.stages[: last + 1],
        observed=seen,
        trusted=tuple(n for n in group.trusted if n.partition(".")[0] in kept),
        parts=tuple(made.items()),
        starts=tuple((n, s) for n, s in group.starts if n.partition(".")[0] in kept),
    )
