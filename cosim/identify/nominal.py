"""The numbers that an identification takes as known: the nominal ones of ssp/nominal, or the user's own."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.paths import ssp_folder
from cosim.ssp.write import read_values
from cosim.units import parse_quantity
from fmus import registry
from fmus.build import composed_block
from fmus.contract import Variable

Array = NDArray[np.float64]

COMPONENTS = ("compensator", "dead_zone", "dcv", "continuity", "mechanical", "simplified", "observer")


def declared(name: str) -> Variable:
    """Declaration of ``component.parameter``.

    Raises:
        UsageError: there is no such component or parameter.
    """
    component, _, parameter = name.partition(".")
    if component not in COMPONENTS:
        raise UsageError(f"'{name}': {registry.suggestion(component, COMPONENTS)}")
    found = composed_block(registry.FMU_OF_COMPONENT.get(component, component)).parameters
    if parameter not in found:
        for other in registry.blocks_of(component)[1:]:
            if parameter in registry.block(other).parameters:
                return registry.block(other).parameters[parameter]
        raise UsageError(
            f"'{name}': {component} has no '{parameter}'; {registry.suggestion(parameter, list(found))}"
        )
    return found[parameter]


def nominal(settings: Iterable[str] = (), own: Mapping[str, float] | None = None) -> dict[str, float]:
    """``component.parameter`` -> SI, from ssp/nominal, those of `own` and of `settings` (``dcv.K=2.4 mm``) replaced.

    Raises:
        UsageError: a setting is malformed or unknown.
        ModelError: the nominal files are missing.
    """
    found = {
        f"{component}.{name}": value
        for component in COMPONENTS
        for name, value in read_values(ssp_folder() / "nominal" / f"{component}.ssv").items()
    }
    found |= own or {}
    for text in settings:
        name, equals, quantity = (part.strip() for part in text.partition("="))
        if not equals or not quantity:
            raise UsageError(f"--set '{text}' should read name=value, such as compensator.d_plus=0")
        found[name] = parse_quantity(quantity, declared(name).unit)
    return found


def compensated(u: Array, known: dict[str, float]) -> Array:
    """The command (n,) behind the inverse dead zone in the controller (4.9)."""
    jump = np.where(u > 0.0, known["compensator.d_plus"], known["compensator.d_minus"])
    return np.asarray(u + jump * np.tanh(known["compensator.S"] * u))


def valve_demand(u: Array, known: dict[str, float]) -> Array:
    """The demand (n,) of a command (n,): behind compensator (4.9), the valve's dead zone (2.2) and its limit."""
    x = compensated(u, known)
    right = known["dead_zone.m_r"] * np.maximum(x - known["dead_zone.b_r"], 0.0)
    left = known["dead_zone.m_l"] * np.minimum(x - known["dead_zone.b_l"], 0.0)
    limit = known["dead_zone.limit"]
    return np.clip(right + left, -limit, limit)
