"""The blocks and effects that exist, by name."""

import difflib
import importlib
import pkgutil
from dataclasses import replace
from functools import cache
from importlib.metadata import entry_points

from fmus import effects as effects_package
from fmus.contract import Block, Effect, Variable

BLOCKS = (
    "stimulus",
    "dead_zone",
    "dcv",
    "continuity",
    "continuity_physical",
    "mechanical",
    "simplified",
    "linear_drive",
    "linear_speed",
    "sensor",
    "observer",
    "observer_extended",
    "reference",
    "controller",
)
FMU_OF_COMPONENT = {"compensator": "dead_zone"}  # components that run another block's FMU
# blocks that run under another component's name
COMPONENT_OF = {"continuity_physical": "continuity", "observer_extended": "observer"}


def block(name: str) -> Block:
    """The block `name`.

    Raises:
        KeyError: no such block; the message gives the closest names.
    """
    if name not in BLOCKS:
        raise KeyError(f"no block '{name}'; {suggestion(name, BLOCKS)}")
    found = importlib.import_module(f"fmus.{name}").BLOCK
    assert isinstance(found, Block)
    return found


@cache
def effects() -> dict[str, Effect]:
    """All effects by name: the files of `fmus.effects` and those that installed packages offer as entry points ``cosim.effects``."""
    names = [info.name for info in pkgutil.iter_modules(effects_package.__path__)]
    found = [importlib.import_module(f"fmus.effects.{name}").EFFECT for name in names]
    found.extend(point.load() for point in entry_points(group="cosim.effects"))
    return {effect.name: effect for effect in sorted(found, key=lambda e: e.name)}


def blocks_of(component: str) -> tuple[str, ...]:
    """Blocks that may run under a component's name, the usual one first."""
    others = tuple(block for block, name in COMPONENT_OF.items() if name == component)
    return (FMU_OF_COMPONENT.get(component, component), *others)


def effect_on(name: str, block: str) -> Effect | None:
    """The effect `name` as it is in a block; None where it has no place in it."""
    effect = effects()[name]
    if effect.only:
        return effect if block == effect.only else None
    if block == FMU_OF_COMPONENT.get(effect.component, effect.component):
        return effect
    return _otherwise(name, block) if block in effect.on else None


@cache
def _otherwise(name: str, block: str) -> Effect:
    """An effect as it is in a block that is not the usual one of its component."""
    effect = effects()[name]
    return replace(effect, **effect.on[block])


def effects_on(component: str, block: str = "") -> tuple[Effect, ...]:
    """The effects that change the equations of `component`, in the form that they have in its block, or in `block`."""
    block = block or FMU_OF_COMPONENT.get(component, component)
    acting = COMPONENT_OF.get(component, component)
    found = [effect_on(e.name, block) for e in effects().values() if e.component == acting]
    return tuple(e for e in found if e is not None and (e.fills or e.memory))


def parameter(component: str, name: str) -> Variable:
    """Declaration of a parameter of the block, or one of the blocks, that a component runs.

    Raises:
        KeyError: none has it.
    """
    for block_name in blocks_of(component):
        found = block(block_name).parameters
        if name in found:
            return found[name]
    raise KeyError(f"'{component}' has no parameter '{name}'")


def suggestion(name: str, known: "tuple[str, ...] | list[str]") -> str:
    """Text that offers the closest of the known names (those that differ in case alone first), or all of them."""
    close = [k for k in known if k.lower() == name.lower()] or difflib.get_close_matches(name, known, n=3)
    return f"did you mean {' or '.join(close)}?" if close else f"known are {', '.join(known)}"
