"""Which variables of a system the signals of a log stand for."""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.compare.mapping import CompareTable
from cosim.errors import DataError, UsageError
from cosim.signals import SIGNALS, conversion
from cosim.ssp.effects import read_at
from cosim.ssp.hints import did_you_mean
from cosim.ssp.stated import full_name
from cosim.ssp.system import Port, System, Wire
from cosim.units import parse_quantity, parse_unit

Array = NDArray[np.float64]
HANDED_ON = 1e-6  # relative difference up to which a block hands on what its sensors show
# our names (docs/design.md); a system without such a component simply has no such signal
DEFAULTS = {
    "u": "stimulus.u",
    "spool": "dcv.spool",
    "p_load": "continuity.p_load",
    "p_a": "continuity.p_a",
    "p_b": "continuity.p_b",
    "p_supply": "continuity.p_supply",
    "slew": "sensor.slew",
    "slew_estimate": "observer.slew_estimate",
    "slew_rate_estimate": "observer.slew_rate_estimate",
}
START_PARAMETER, START_SIGNAL = "theta_0", "slew"
ANGLE = "theta"  # output of the block that starts there, and input of the sensor that reads it
SPEED = "omega_0"
# what else of a start shows in a log that begins in motion: the velocity as a slope, the others as they are read
BEGINS = {SPEED: START_SIGNAL, "spool_0": "spool", "p_load_0": "p_load"}
# parameters trusted to the tolerance only; all else is taken as exact
TRUSTED = (
    "dcv.K",
    "dcv.w0",
    "dcv.zeta",
    "continuity.K_c",
    "continuity.T",
    "continuity.w",
    "continuity.beta",
    "mechanical.J",
    "mechanical.b",
    "simplified.k",
    "simplified.a",
)
# what is measured of a signal that is not measured itself (4.21)
DERIVED = {"p_load": (("p_a", 1.0), ("p_b", -1.0))}


@dataclass(frozen=True)
class Binding:
    """A signal and what it stands for.

    Attributes:
        signal: its name in the log.
        unit: its unit in the log (SI).
        port: the component's output that it measures; None for an input of the system.
        parts: the measured value as a sum of factor * variable, where it differs from `port`.
        wires: the connections that hand the signal on.
        gain: the variable per signal.
        command: nothing in the model makes this signal, so the log must.
    """

    signal: str
    unit: str
    port: Port | None
    parts: tuple[tuple[Port, float], ...]
    wires: tuple[Wire, ...]
    gain: float
    command: bool


def bind(system: System, units: dict[str, str], table: CompareTable) -> dict[str, Binding]:
    """The binding of every signal that the system has, in the log or not.

    Args:
        system: the model.
        units: SI unit of each signal of the log.
        table: what the mapping file says.

    Raises:
        UsageError: the table names a variable that does not exist, or a unit does not fit.
        DataError: it names a signal that the log does not hold.
    """
    found: dict[str, Binding] = {}
    for name, target in table.signals.items():
        if name not in units:
            raise DataError(
                f"compare.signals names '{name}', which the log does not hold{did_you_mean(name, units)}"
            )
        found[name] = _bound(system, name, units[name], target.variable, target.factor)
    # a signal called like a connector, as in a mapping of `cosim init MODEL LOG`, is that one
    for name in units:
        if "." in name and name not in found and _exists(system, name):
            found[name] = _bound(system, name, units[name], name, None)
    taken = {b.port for b in found.values() if b.port} | {w.target for b in found.values() for w in b.wires}
    names = [*system.inputs, *system.outputs, *(n for n in DEFAULTS if _exists(system, DEFAULTS[n]))]
    for name in (n for n in dict.fromkeys(names) if n not in table.aside):
        unit = units.get(name) or (SIGNALS[name].si if name in SIGNALS else None)
        if name in found or (unit is None and name not in system.inputs):
            continue
        connector = name in system.inputs or name in system.outputs
        bound = _bound(system, name, unit, name if connector else DEFAULTS[name], None)
        if bound.port not in taken and not any(w.target in taken for w in bound.wires):
            found[name] = bound
    for name, parts in DERIVED.items():
        if name in found and all(part in found for part, _ in parts):
            ports = tuple((found[part].port, factor) for part, factor in parts)
            sum_of = tuple((port, factor) for port, factor in ports if port is not None)
            found[name] = replace(found[name], parts=sum_of)
    order = [*DEFAULTS, *found]  # along the signal flow
    return {name: found[name] for name in dict.fromkeys(order) if name in found}


def start_values(system: System, table: CompareTable, bindings: dict[str, Binding]) -> dict[str, str]:
    """``component.parameter`` -> signal whose first value it takes: an angle starts where its signal does.

    Raises:
        UsageError: the table names an unknown parameter or signal.
    """
    stated = {full_name(system, parameter): signal for parameter, signal in table.start.items()}
    for parameter, signal in stated.items():
        component, _, name = parameter.partition(".")
        if component not in system.components or name not in system.components[component].fmu.variables:
            raise UsageError(f"compare.start names '{parameter}', which '{system.name}' does not have")
        if signal not in bindings:
            raise UsageError(f"compare.start names the signal '{signal}'{did_you_mean(signal, bindings)}")
    turning = [c for c, component in system.components.items() if START_PARAMETER in component.fmu.variables]
    wires = [(w.source, w.target) for w in system.wires]
    found = angle_signals(turning, wires, {n: b.port for n, b in bindings.items()}, table.signals)
    return found | stated


def angle_signals(
    turning: Iterable[str],
    wires: Collection[tuple[Port, Port]],
    shown: Mapping[str, Port | None],
    mapped: Iterable[str],
) -> dict[str, str]:
    """``component.theta_0`` -> the signal that measures its angle, at the component or behind its sensor.

    Args:
        turning: components that have such a start.
        wires: (source, target) of every connection.
        shown: signal -> the output that it measures.
        mapped: signals that the mapping binds: these are in the log, ours may be names the system could have.
    """
    listed = [n for n in dict.fromkeys((*mapped, START_SIGNAL, *shown)) if n in shown]
    found = {}
    for component in turning:
        angle = Port(component, ANGLE)
        ports = {
            angle,
            *(Port(target.component, START_SIGNAL) for source, target in wires if source == angle),
        }
        own = next((n for n in listed if shown[n] in ports), START_SIGNAL)
        if own in shown:
            found[f"{component}.{START_PARAMETER}"] = own
    return found


def _exists(system: System, text: str) -> bool:
    component, _, variable = text.partition(".")
    return component in system.components and variable in system.components[component].fmu.variables


def _bound(system: System, signal: str, unit: str | None, text: str, factor: str | None) -> Binding:
    """A signal's binding to a connector or ``component.variable``."""
    if text in system.inputs:
        item = system.inputs[text]
        gain = gain_between(signal, unit or item.unit, item.unit, factor)
        return Binding(signal, unit or item.unit, None, (), item.targets, gain, True)
    if text not in system.outputs and not _exists(system, text) and signal in system.outputs:
        text = signal  # an extended package with a linear model in the place of the blocks that are named
    if text not in system.outputs and not _exists(system, text):
        known = [f"{c.name}.{name}" for c in system.components.values() for name in c.fmu.variables]
        hint = did_you_mean(text, [*system.inputs, *system.outputs, *known])
        raise UsageError(f"'{system.name}' has no '{text}' for the signal '{signal}'{hint}")
    component, _, variable = text.partition(".")
    port = system.outputs[text] if text in system.outputs else read_at(system, Port(component, variable))
    declared = system.variable(port)
    if text not in system.outputs:
        # an effect that an extended model has behind a connector hands on its numbers, whatever unit they are in
        declared = replace(declared, unit=system.variable(Port(component, variable)).unit)
    gain = gain_between(signal, unit or declared.unit, declared.unit, factor)
    if declared.causality == "input":
        return _into(system, signal, unit or declared.unit, port, gain)
    if declared.causality != "output" or declared.kind != "Real":
        raise UsageError(
            f"'{port}' is a {declared.causality} of type {declared.kind}: '{signal}' needs a Real output or input"
        )
    wires = tuple(w for w in system.wires if w.source == port)
    variables = system.components[port.component].fmu.variables.values()
    source = not any(v.causality == "input" for v in variables)
    return Binding(signal, unit or declared.unit, port, ((port, 1.0),), wires, gain, source)


def _into(system: System, signal: str, unit: str, port: Port, gain: float) -> Binding:
    """A signal measured at a component's input: at the output behind it, or a command where nothing makes it."""
    wire = next((w for w in system.wires if w.target == port), None)
    if wire is None:
        return Binding(signal, unit, None, (), (Wire(Port("", signal), port),), gain, True)
    if wire.offset:
        raise UsageError(
            f"'{signal}': {wire} has an offset, so name the output {wire.source} instead of {port}"
        )
    wires = tuple(w for w in system.wires if w.source == wire.source)
    return Binding(signal, unit, wire.source, ((wire.source, 1.0),), wires, gain / wire.factor, False)


def gain_between(signal: str, unit: str, target: str, factor: str | None) -> float:
    """The variable's number per number of the signal."""
    if factor is not None:
        ratio = f"({target or '1'})/({unit or '1'})"
        try:
            gain = parse_quantity(factor, ratio)
        except UsageError as error:
            raise UsageError(f"compare.signals.{signal}: factor: {error}") from None
        if gain == 0.0:
            raise UsageError(f"compare.signals.{signal}: a factor of 0 leaves nothing of the signal")
        return gain
    if not target or target == (unit or "1"):  # an FMU that states no unit takes SI
        return 1.0
    parse_unit(unit)
    try:
        return conversion(unit, target or "1")
    except UsageError as error:
        raise UsageError(
            f"signal '{signal}' [{unit}] does not fit the model's [{target or '1'}]: {error}; "
            "in a mapping, compare.signals can give a factor"
        ) from None


def measured_value(binding: Binding, recorded: Callable[[Port], Array]) -> Array:
    """What the sensors show of a signal, in its unit, from the components' outputs."""
    total = sum(factor * recorded(port) for port, factor in binding.parts)
    return np.asarray(total) / binding.gain


def cut_signals(
    measured: Iterable[str],
    bindings: Mapping[str, Binding],
    whole: Callable[[Port], Array],
    possible: list[str],
    notes: list[str],
) -> tuple[str, ...]:
    """The signals to cut at: not where a block hands on something else than its sensors show."""
    kept = []
    for name in measured:
        binding = bindings[name]
        if name in possible and binding.port is not None:
            handed = whole(binding.port) / binding.gain
            shown = measured_value(binding, whole)
            if np.max(np.abs(handed - shown)) > HANDED_ON * max(float(np.max(np.abs(shown))), 1e-300):
                notes.append(
                    f"{binding.port} hands on something else than the sensors of '{name}' show: the blocks behind it "
                    "are judged together with it"
                )
                continue
        kept.append(name)
    return tuple(kept)
