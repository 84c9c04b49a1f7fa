"""Units that a mapping states for variables of which the FMU states none, as FMUs of plain pythonfmu never do."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from cosim.errors import UsageError
from cosim.ssp.hints import did_you_mean
from cosim.ssp.system import Port, System, Variable
from cosim.units import base_factor, parse_unit

KEY = "compare.units"
_IN_BRACKETS = re.compile(r"[\[(]([^\[\]()]+)[\])]\s*\.?\s*$")


def with_units(system: System, units: Mapping[str, str]) -> list[str]:
    """Give the system's variables the units that a mapping states for them, in place; twice is as once.

    Wires hand on the same numbers as before.

    Args:
        system: the model as read.
        units: ``component.variable``, a connector of the system, or a variable of the only component -> unit.

    Returns:
        what is wrong with them, in sentences.
    """
    wrong = []
    for name, unit in units.items():
        ports = _ports(system, name)
        if not ports:
            known = [f"{c.name}.{v}" for c in system.components.values() for v in c.fmu.variables]
            wrong.append(
                f"{KEY} '{name}': the system has no variable of this name{did_you_mean(name, [*system.inputs, *known])}"
            )
            continue
        try:
            parse_unit(unit)
        except UsageError as error:
            wrong.append(f"{KEY} '{name}': {error}")
            continue
        other = next((v.unit for v in map(system.variable, ports) if v.unit not in ("", unit)), None)
        if other is not None:
            wrong.append(f"{KEY} '{name}': the FMU itself states '{other}': leave it out")
            continue
        for port in ports:
            _state(system, port, unit)
    return wrong


def _ports(system: System, name: str) -> list[Port]:
    if name in system.inputs:
        return [wire.target for wire in system.inputs[name].targets]
    if name in system.outputs:
        return [system.outputs[name]]
    component, _, variable = name.partition(".")
    if component in system.components and variable in system.components[component].fmu.variables:
        return [Port(component, variable)]
    only = next(iter(system.components.values())) if len(system.components) == 1 else None
    return [Port(only.name, name)] if only is not None and name in only.fmu.variables else []


def _state(system: System, port: Port, unit: str) -> None:
    part = system.components[port.component]
    variable = replace(part.fmu.variables[port.variable], unit=unit)
    fmu = replace(part.fmu, variables={**part.fmu.variables, port.variable: variable})
    system.components[port.component] = replace(part, fmu=fmu)
    for name, item in system.inputs.items():
        if not item.unit and any(wire.target == port and wire.factor == 1.0 for wire in item.targets):
            system.inputs[name] = replace(item, unit=unit)


def unit_in_words(variable: Variable) -> str:
    """The unit that a description ends with, such as ``pilot pressure [bar]``; empty where it names none."""
    match = _IN_BRACKETS.search(variable.description)
    if match is None:
        return ""
    try:
        parse_unit(match.group(1))
    except UsageError:
        return ""
    return match.group(1).strip()


def in_si(unit: str) -> bool:
    """Whether numbers of this unit are SI numbers; what is no plain unit is not."""
    try:
        return base_factor(unit) == 1.0
    except UsageError:
        return False


def assumed_si(shown: Iterable[tuple[str, str]]) -> str:
    """What to say where an FMU states no unit and a log's numbers are brought to SI; empty where none are.

    Args:
        shown: (connector, unit of the log) of those without a unit.
    """
    others = [item for item in shown if not in_si(item[1])]
    if not others:
        return ""
    names = ", ".join(f"{name} ({unit} in the log)" for name, unit in others)
    lines = ", ".join(f'"{name}" = "{unit}"' for name, unit in others)
    return (
        f"the FMU states no unit of {names}: taken to count in SI; if it counts in others, "
        f"say so in the mapping, under [compare.units]: {lines}"
    )
