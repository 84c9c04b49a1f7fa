"""Which parameter of a model is the initial value of a measured output, and whether the log begins elsewhere."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cosim.anysystem.letters import letters_of
from cosim.anysystem.meant import APART, FITS, Akin
from cosim.anysystem.read import value_of
from cosim.compare.metrics import white_noise
from cosim.errors import UsageError
from cosim.logs.overview import Column
from cosim.signals import conversion
from cosim.ssp.stated import unit_in_words, without_unit
from cosim.ssp.system import System, Variable
from cosim.system.graph import port_of

INITIAL = re.compile(r"initial|init\b|\bstart|beginn?ing|\bbegins?\b|anfang")
IN_NAME = re.compile(
    r"^(init|initial|start|begin)_?(?=[A-Za-z])|_?(0|init|initial|start|begin)$", re.IGNORECASE
)
FIRST = 5  # samples that are averaged for what a log begins with, if it stands there
LETTER = 0.9  # how well a parameter fits whose name is the letter of such a quantity, or that a value is initial, alone
OFF = 5.0  # standard deviations of the noise, beyond which a log begins elsewhere than the model
SEEN = 2e-3  # of a reading's range: what begins nearer than that begins where the model does


@dataclass(frozen=True)
class Beginning:
    """Where a log begins with a measured output.

    Attributes:
        connector: the output.
        parameter: ``component.parameter`` that is its initial value, or empty where none looks like one.
        named: whether its name says so (``x_0`` of ``x``); otherwise its description does.
        reading: first reading, in the column's unit.
        model: what the model begins with, in that unit; None where that cannot be told.
        off: whether the log begins elsewhere than the model, as far as that can be told.
    """

    connector: str
    parameter: str
    named: bool
    reading: float
    model: float | None
    off: bool


def beginnings(
    system: System,
    shown: Mapping[str, Column],
    units: Mapping[str, str],
    words: Callable[[str], list[str]],
    akin: Akin,
) -> list[Beginning]:
    """Where a log begins with each measured output, and the parameter that would let the model begin there.

    Args:
        system: the model as read.
        shown: connector of a component's output -> its column.
        units: connector -> unit of the model's numbers, empty where nobody says.
        words: takes a name apart.
        akin: how well two words fit, from 0 to 1.
    """
    found = []
    counted = {c: units[c] or column.unit or "" for c, column in shown.items()}
    of = initial_values(system, counted, words, akin)
    for connector, column in shown.items():
        if not column.finite.size:
            continue
        first, noise = column.finite[:FIRST], white_noise(column.finite)
        # what moves from the first sample on begins there
        reading = float(first[0] if np.ptp(first) > OFF * noise else first.mean())
        parameter, named = of.get(connector, ("", False))
        port = port_of(system, connector)
        own = value_of(system, parameter) if parameter else system.variable(port).start
        # an output that is computed at the start has no value in the description
        model = (
            _converted(float(own), units[connector], column.unit) if isinstance(own, (int, float)) else None
        )
        least = max(OFF * noise, SEEN * float(np.ptp(column.finite)))
        off = model is None or abs(reading - model) > least
        found.append(Beginning(connector, parameter, named, reading, model, off))
    return found


def initial_values(
    system: System, connectors: Mapping[str, str], words: Callable[[str], list[str]], akin: Akin
) -> dict[str, tuple[str, bool]]:
    """Output -> the parameter of its component that looks like its initial value, and whether its name says so.

    Where two fit about as well none is taken; one parameter goes with one output.

    Args:
        system: the model as read.
        connectors: output -> unit of its readings, empty where nobody says.
        words: takes a name apart.
        akin: how well two words fit, from 0 to 1.
    """
    fits: dict[tuple[str, str], float] = {}
    beside = [port_of(system, c).component for c in connectors]
    for connector, unit in connectors.items():
        port = port_of(system, connector)
        component = system.components[port.component]
        output = component.fmu.variables[port.variable]
        alone = beside.count(port.component) == 1
        for v in component.fmu.variables.values():
            if v.kind == "Real" and v.causality == "parameter" and v.can_be_set:
                by_letter = LETTER * lettered(v.name, unit, alone)
                fits[connector, f"{component.name}.{v.name}"] = max(fit(v, output, words, akin), by_letter)
    found: dict[str, tuple[str, bool]] = {}
    for (connector, parameter), best in fits.items():
        others = [f for (c, p), f in fits.items() if (c == connector) != (p == parameter)]
        if best >= FITS and best >= max(others, default=0.0) + APART:
            found[connector] = parameter, best > 1.0
    return found


def fit(parameter: Variable, output: Variable, words: Callable[[str], list[str]], akin: Akin) -> float:
    """How well a parameter fits as an output's initial value: 1.2 by its name, to 1 by its description, 0 for none."""
    stem = IN_NAME.sub("", parameter.name)
    told = without_unit(parameter.description)
    by_name, by_words = stem != parameter.name and bool(stem), bool(INITIAL.search(told.lower()))
    one, other = (v.unit or unit_in_words(v) for v in (parameter, output))
    if not (by_name or by_words) or (one and other and _converted(1.0, one, other) is None):
        return 0.0
    if by_name and stem.lower() == output.name.lower():
        return 1.2
    own = [
        w
        for w in words(told)
        if not INITIAL.search(w) and w not in ("of", "the", "at", "value", "der", "die", "des")
    ]
    wanted = words(f"{output.name} {without_unit(output.description)}")
    if not own or not wanted:
        return 0.0
    return sum(max(akin(w, x) for x in wanted) for w in own) / len(own)


def lettered(name: str, unit: str, alone: bool) -> bool:
    """Whether a parameter is called as initial values are: by the letter of the quantity (`T_0`), or plainly (`start`).

    Args:
        name: of the parameter.
        unit: of the output's readings.
        alone: it is the only output of its component that was measured.
    """
    stem = IN_NAME.sub("", name)
    return alone and stem != name and (not stem or stem in letters_of(unit))


def _converted(value: float, unit: str, target: str | None) -> float | None:
    """A number in another unit; as it is where one is not known, None where they are of different dimensions."""
    if not unit or not target or unit == target:
        return value
    try:
        return value * conversion(unit, target)
    except UsageError:
        return None
