"""What a mapping states of variables: units where the FMU states none, as plain pythonfmu never does, and values."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from cosim.errors import UsageError
from cosim.ssp.effects import with_unit
from cosim.ssp.hints import did_you_mean
from cosim.ssp.read import resolve, settable_names
from cosim.ssp.system import Port, System, Value, Variable
from cosim.units import base_factor, parse_unit

KEY = "compare.units"
WHOLE = 1e-9  # of a number: a wire's factor may round it
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
        ports = variables(system, name)
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


def constants(system: System, stated: Mapping[str, float]) -> tuple[dict[str, Value], list[str]]:
    """What a mapping says of inputs that were not measured, and of parameters, as each FMU takes it.

    Numbers that a diagnosis has put into an extended model stay: they are found on top of what the mapping says.

    Args:
        system: the model as read.
        stated: ``component.variable``, a connector of the system, or a variable of the only component -> value.

    Returns:
        ``component.variable`` -> value of the variable's type; and what is wrong with them, in sentences.
    """
    found: dict[str, Value] = {}
    wrong = []
    for name, value in stated.items():
        ports = variables(system, name)
        if not ports:
            near = did_you_mean(name, settable_names(system))
            wrong.append(f"constant '{name}': the system has no connector '{name}', nor a parameter{near}")
        for port in ports:
            variable = system.variable(port)
            wires = (
                [w for w in system.inputs[name].targets if w.target == port] if name in system.inputs else []
            )
            number = wires[0].factor * value + wires[0].offset if wires else value
            fits = as_kind(number, variable)
            if variable.causality not in ("input", "parameter"):
                wrong.append(
                    f"constant '{name}': it is no input and no parameter, but a {variable.causality}"
                )
            elif not variable.can_be_set:
                wrong.append(f"constant '{name}': the FMU does not let it be set")
            elif fits is None:
                kind = "true or false (1 or 0)" if variable.kind == "Boolean" else "a whole number"
                kind = (
                    kind if variable.kind in ("Boolean", "Integer", "Enumeration") else f"a {variable.kind}"
                )
                wrong.append(f"constant '{name}' = {number:g}: {port} takes {kind}")
            elif str(port) not in system.found:
                found[str(port)] = fits
    return found, wrong


def as_kind(number: float, variable: Variable) -> Value | None:
    """A number as a variable takes it; None where it cannot."""
    if variable.kind == "Real":
        return float(number) if math.isfinite(number) else None
    whole = round(number)
    if abs(number - whole) > WHOLE * max(abs(number), 1.0):
        return None
    if variable.kind == "Boolean":
        return bool(whole) if whole in (0, 1) else None
    return whole if variable.kind in ("Integer", "Enumeration") else None


def variables(system: System, name: str) -> list[Port]:
    """What a mapping means: ``component.variable``, a connector of the system, or a variable of the only component."""
    if found := resolve(system, name):
        return list(found)
    if name in system.outputs:
        return [system.outputs[name]]
    if len(system.components) != 1:
        return []
    (only,) = system.components.values()  # whatever a log calls it
    return [Port(only.name, n) for n in (name, name.partition(".")[2]) if n in only.fmu.variables][:1]


def full_name(system: System, name: str) -> str:
    """``component.parameter`` of a parameter: beside a single FMU its own name is enough. What is unknown stays as it is."""
    component, _, variable = name.partition(".")
    if component in system.components and variable in system.components[component].fmu.variables:
        return name
    ports = variables(system, name)
    return str(ports[0]) if len(ports) == 1 else name


def _state(system: System, port: Port, unit: str) -> None:
    part = system.components[port.component]
    variable = replace(part.fmu.variables[port.variable], unit=unit)
    fmu = replace(part.fmu, variables={**part.fmu.variables, port.variable: variable})
    system.components[port.component] = replace(part, fmu=fmu)
    with_unit(system, port)
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


def without_unit(description: str) -> str:
    """A description without what it has in brackets at its end."""
    return _IN_BRACKETS.sub("", description)


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
