"""The blocks and effects that exist, by name."""

import difflib
import importlib
import pkgutil
from functools import cache
from importlib.metadata import entry_points

from fmus import effects as effects_package
from fmus.contract import Block, Effect

BLOCKS = (
    "stimulus",
    "dead_zone",
    "dcv",
    "continuity",
    "continuity_physical",
    "mechanical",
    "simplified",
    "sensor",
    "observer",
    "reference",
    "controller",
)
FMU_OF_COMPONENT = {"compensator": "dead_zone"}  # components that run another block's FMU


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


def effects_on(component: str) -> tuple[Effect, ...]:
    """The effects that change the equations of `component`."""
    return tuple(e for e in effects().values() if e.component == component and (e.fills or e.memory))


def suggestion(name: str, known: "tuple[str, ...] | list[str]") -> str:
    """Text that offers the closest of the known names (those that differ in case alone first), or all of them."""
    close = [k for k in known if k.lower() == name.lower()] or difflib.get_close_matches(name, known, n=3)
    return f"did you mean {' or '.join(close)}?" if close else f"known are {', '.join(known)}"
