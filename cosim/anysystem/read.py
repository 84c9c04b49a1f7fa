"""Logs of any system: which column is which connector, in the unit of the FMU's variable."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.anysystem.options import AnyOptions, options_of
from cosim.compare.mapping import load_mapping
from cosim.compare.prepare import first_value
from cosim.errors import DataError, UsageError
from cosim.logs import Log
from cosim.logs.choose import holds
from cosim.logs.load import load_log, open_source
from cosim.logs.mapping import Mapping as LogMapping
from cosim.logs.mapping import SignalColumn, TimeColumn
from cosim.logs.source import Label
from cosim.machines import in_package
from cosim.signals import SIGNALS, SYNTHETIC_COLUMN, conversion
from cosim.ssp.hints import did_you_mean
from cosim.ssp.quantities import UnitDefinition, contradiction, definition, of_reading
from cosim.ssp.stated import assumed_si, constants, full_name, variables, with_units
from cosim.ssp.system import Port, System, Value, Variable
from cosim.system.graph import connectors, port_called, port_of
from cosim.units import parse_quantity

Array = NDArray[np.float64]
OWN = "in the unit of the FMU"
LISTED = 12  # parameters that a message lists


@dataclass(frozen=True)
class Column:
    """A measured connector.

    Attributes:
        name: of the signal: what the log or the mapping calls it.
        connector: ``component.connector`` as `port_of` takes it.
        unit: in which people read it.
        factor, offset: shown = (value - offset) / factor, the value being in the unit of the FMU's variable.
    """

    name: str
    connector: str
    unit: str
    factor: float
    offset: float


@dataclass
class Recording:
    """One log as the diagnosis takes it.

    Attributes:
        source: the file.
        time: (n,) stamps [s].
        signals: connector -> (n,), in the unit of the FMU's variable.
        columns: connector -> what it was.
        warnings: what was done to the log.
        held: connectors whose values hold until the next sample, as the mapping says.
        missing: connector -> (n,) True where a value was missing and was filled; only connectors that have such places.
        gaps: (stamp before, stamp after) of pauses [s].
    """

    source: Path
    time: Array
    signals: dict[str, Array]
    columns: dict[str, Column]
    warnings: list[str] = field(default_factory=list)
    sha256: str = ""
    synthetic: bool = False
    held: frozenset[str] = frozenset()
    missing: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    gaps: tuple[tuple[float, float], ...] = ()


def named_columns(path: Path, system: System, units: dict[str, str]) -> tuple[LogMapping, list[str]]:
    """A mapping for a log whose columns are called ``component.connector``.

    Args:
        path: the log.
        system: the model.
        units: connectors whose FMU states no unit -> unit in which the first of several logs has them; those of this log
            are added.

    Returns:
        (mapping, headings that are no connector).

    Raises:
        DataError: there is no time column, no connector, or a connector without unit.
    """
    source = open_source(path)
    clock, others, found = None, [], {}
    for label in source.labels:
        if label.name.lower() in ("time", "t") and clock is None:
            clock = TimeColumn(column=label.text, unit=label.unit or "s")
            continue
        if label.name == SYNTHETIC_COLUMN:
            continue
        label = heading(label, system)
        try:
            port = port_called(system, label.name)
        except DataError:
            others.append(label.text)
            continue
        unit, own = _column_unit(path, label, _unit(system, port))
        # our own signals have units and ranges that another system's need not have
        name = own_name(label.name) if not port.component else label.name
        name = str(port) if port.component else name
        found[name] = SignalColumn(column=label.text, unit=unit, text=OWN if own else "")
        if own and label.unit is not None:
            found[name] = found[name].model_copy(update={"gain": _as_first(path, label, units, name)})
    if not found:
        raise DataError(
            f"{path}: no column is a connector of the system ({', '.join(connectors(system)[:20])}); found "
            f"{', '.join(others[:20]) or 'none'}: name them component.connector, or give a mapping ('cosim init' writes one)"
        )
    if clock is None:
        raise DataError(f"{path}: there is no time column: add 'time [s]', or name the column in a mapping")
    return LogMapping.model_construct(
        time=clock, signals=found, file=LogMapping.model_fields["file"].default, sha256={}, path=None, model=None,
        compare={}, diagnose={}, machine={}, name="", description="",
    ), others  # fmt: skip


def _as_first(path: Path, label: Label, units: dict[str, str], name: str) -> float:
    """Factor from a log's unit to that of the first log, where only the logs say in which unit a connector is.

    Raises:
        DataError: the two have different dimensions.
    """
    unit = label.unit or "1"
    first = units.setdefault(name, unit)
    if first == unit:
        return 1.0
    try:
        return conversion(unit, first)
    except UsageError:
        raise DataError(
            f"{path}: column '{label.text}' is in '{unit}', but in the first log in '{first}', and the FMU states no unit: "
            "write both in one unit"
        ) from None


def own_name(name: str) -> str:
    """The name of a signal of another system: one of ours would have our unit and the crane's range."""
    return f"system.{name}" if name in SIGNALS else name


def heading(label: Label, system: System) -> Label:
    """The label of a column; one that is called like a connector with an index, ``f[0]``, has no unit there."""
    if label.unit is None or label.text == label.name:
        return label
    try:
        port_of(system, label.text)
    except DataError:
        return label
    return Label(label.text, label.text, None)


def _column_unit(path: Path, label: Label, unit: str) -> tuple[str, bool]:
    """Unit to read a column in, and whether its numbers are taken as they are.

    So they are where the variable has no unit, or one that only its FMU knows.
    """
    if label.unit is None:
        if unit:
            raise DataError(
                f"{path}: column '{label.text}' has no unit: write it into the header, such as '{label.name} [{unit}]'"
            )
        return "1", True
    if not unit:
        return "1", True
    if label.unit == unit and definition(unit, {}) is None:
        return "1", True
    return label.unit, False


def _unit(system: System, port: Port) -> str:
    if not port.component:
        return system.inputs[port.variable].unit
    return system.variable(port).unit


def _known(system: System, port: Port) -> Mapping[str, UnitDefinition]:
    if port.component:
        return system.components[port.component].fmu.units
    targets = system.inputs[port.variable].targets
    return system.components[targets[0].target.component].fmu.units if targets else {}


def read(
    given: Sequence[Path | Log], system: System, mapping: Path | None
) -> tuple[list[Recording], AnyOptions, list[str]]:
    """The logs, what the mapping says, and headings that were left alone.

    Args:
        given: files, or logs that were read with the mapping.
        system: the model.
        mapping: the mapping file, or None where columns are called like connectors.

    Raises:
        DataError: a log or the mapping is bad, or a column does not fit its connector.
    """
    options, others = AnyOptions(), list[str]()
    targets: dict[str, tuple[str, str | None]] = {}
    plain: LogMapping | None = None
    if mapping is not None:
        plain, table = load_mapping(mapping)
        options = with_full_names(system, options_of(plain.diagnose, mapping))
        lacking = with_units(system, table.units)
        stated = {**table.signals, **in_package(system, plain, table)}
        for name in plain.signals:
            target = stated.get(name)
            targets[name] = (target.variable if target else name, target.factor if target else None)
            try:
                port_of(system, targets[name][0])
            except DataError as error:
                lacking.append(f"signal '{name}': {error}")
        measured = {
            end
            for n in plain.signals
            if not lacking
            for end, _, _ in ends(system, port_of(system, targets[n][0]))
        }
        stated_values, wrong = constants(system, options.constant)
        options = with_constants(system, options, stated_values)
        lacking += wrong
        stated_starts = {full_name(system, n): s for n, s in {**options.start, **table.start}.items()}
        known = (
            {}
            if lacking
            else {str(port_of(system, connector)): connector for connector, _ in targets.values()}
        )

        def meant(signal: str) -> str:
            if signal in targets:
                return targets[signal][0]
            with suppress(DataError):  # said below
                return known.get(str(port_of(system, signal)), signal)
            return signal

        begins = {n: meant(s) for n, s in stated_starts.items()}
        options = options.model_copy(update={"start": begins})
        lacking += _bad_parameters(system, options, measured)
        lacking += _bad_starts(system, options, {connector for connector, _ in targets.values()})
        if lacking:
            raise DataError(f"{mapping}: " + "; ".join(lacking))
    foreign = None
    if plain is not None:
        foreign = plain.model_copy(update={"signals": {own_name(n): c for n, c in plain.signals.items()}})
        targets |= {own_name(n): target for n, target in targets.items()}
    logs = []
    units: dict[str, str] = {}
    lacks = lacking_columns(given, foreign)
    for item in given:
        chosen, path = plain, item if isinstance(item, Path) else item.source
        if chosen is None:
            chosen, others = named_columns(path, system, units)
        whole = isinstance(item, Log) and item.signals.keys() <= chosen.signals.keys() and plain is not None
        if not whole and foreign is not None:
            chosen = foreign
        without = lacks.get(path, [])
        select = [n for n in chosen.signals if n not in without] if without else None
        log = item if whole and isinstance(item, Log) else load_log(path, chosen, select=select)
        logs.append(_recording(log, chosen, targets, system, options))
        logs[-1].warnings += [
            f"there is no column {chosen.signals[n].column!r}: {n.removeprefix('system.')} is taken from the other logs"
            for n in without
        ]
    return logs, options, others


def lacking_columns(given: Sequence[Path | Log], mapping: LogMapping | None) -> dict[Path, list[str]]:
    """Signals of a mapping whose columns a file lacks, where another has them: file -> names."""
    files = [item for item in given if isinstance(item, Path)]
    if mapping is None or len(given) < 2 or not files:
        return {}
    found = {}
    for path in files:
        source = open_source(path, mapping)
        found[path] = {n for n, column in mapping.signals.items() if not holds(source, column)}
    nowhere = set.intersection(*found.values()) if len(files) == len(given) else set()
    return {path: sorted(names - nowhere) for path, names in found.items() if names - nowhere}


def ends(system: System, port: Port) -> list[tuple[Port, float, float]]:
    """The connectors of components behind a port, with factor and offset: itself, or what an input of the system feeds."""
    if port.component:
        return [(port, 1.0, 0.0)]
    return [(w.target, w.factor, w.offset) for w in system.inputs[port.variable].targets]


def with_full_names(system: System, options: AnyOptions) -> AnyOptions:
    """Trusted and free parameters as ``component.parameter``."""
    return options.model_copy(
        update={
            "trusted": {full_name(system, n): v for n, v in options.trusted.items()},
            "free": tuple(full_name(system, n) for n in options.free),
        }
    )


def with_constants(system: System, options: AnyOptions, given: Mapping[str, Value]) -> AnyOptions:
    """Give the system what the mapping says of parameters and of inputs that were not measured, as a package would."""
    for name, value in given.items():
        component, _, variable = name.partition(".")
        part = system.components[component]
        system.components[component] = replace(part, starts={**part.starts, variable: value})
    return options.model_copy(update={"given": dict(given)})


def begun(
    start: Mapping[str, str],
    signals: Mapping[str, Array],
    missing: Mapping[str, NDArray[np.bool_]],
    drives: Sequence[Array],
    h: float,
) -> dict[str, float]:
    """Initial values in one log: what a signal of each begins with.

    Args:
        start: ``component.parameter`` -> signal.
        signals: what was read (n,).
        missing: signal -> (n,) True where it was not.
        drives: what moves them (n,).
        h: interval [s].
    """
    found = {}
    for name, signal in start.items():
        if signal in signals:
            reading = signals[signal]
            lost = missing.get(signal, np.zeros(reading.size, dtype=np.bool_))
            found[name] = first_value(reading, ~lost, list(drives), h)[0]
    return found


def _variable(system: System, name: str) -> Variable | None:
    """The variable ``component.variable``, if there is one."""
    component, _, variable = name.partition(".")
    part = system.components.get(component)
    return part.fmu.variables.get(variable) if part else None


def _parameters(system: System, name: str) -> str:
    """The parameters that may have been meant, else all, for a message."""
    known = [
        f"{c.name}.{n}"
        for c in system.components.values()
        for n, v in c.fmu.variables.items()
        if v.kind == "Real" and v.causality == "parameter"
    ]
    more = ", ..." if len(known) > LISTED else ""
    return did_you_mean(name, known) or (f": it has {', '.join(known[:LISTED])}{more}" if known else "")


def _bad_parameters(system: System, options: AnyOptions, measured: Collection[Port]) -> list[str]:
    found = [
        f"constant '{n}': it is measured: leave it out"
        for n in options.constant
        if any(port in measured for port in variables(system, n))
    ]
    for name in (*options.trusted, *options.free):
        component, _, parameter = name.partition(".")
        variable = _variable(system, name)
        if variable is None:
            found.append(f"parameter '{name}': the system has none of this name{_parameters(system, name)}")
        elif variable.causality == "input" and Port(component, parameter) in measured:
            found.append(f"parameter '{name}': an input that is measured is no parameter")
        elif variable.kind != "Real" or not variable.can_be_set:
            found.append(f"parameter '{name}': a {variable.kind} {variable.causality} cannot be estimated")
        elif not isinstance(value_of(system, name), float):
            found.append(f"parameter '{name}': it has no start value")
    return found


def _bad_starts(system: System, options: AnyOptions, measured: Collection[str]) -> list[str]:
    found = []
    for name, signal in options.start.items():
        variable = _variable(system, name)
        if variable is None or variable.kind != "Real" or variable.causality == "input":
            found.append(f"compare.start '{name}': the system has no real parameter of this name")
        elif not variable.can_be_set:
            found.append(f"compare.start '{name}': the FMU does not let it be set")
        elif name in options.trusted or name in options.free:
            found.append(f"compare.start '{name}': it is trusted or free as well: leave it out there")
        elif signal not in measured:
            found.append(f"compare.start '{name}': '{signal}' is not measured")
    return found


def value_of(system: System, name: str) -> float | None:
    """Value of ``component.parameter`` as the system sets it."""
    component, _, parameter = name.partition(".")
    part = system.components[component]
    value = part.starts.get(parameter, part.fmu.variables[parameter].start)
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None


def _recording(
    log: Log,
    mapping: LogMapping,
    targets: Mapping[str, tuple[str, str | None]],
    system: System,
    options: AnyOptions,
) -> Recording:
    time, second = log.time, 1.0
    if log.time_unit != "s":
        if options.sample is None:
            raise DataError(
                f"{log.source}: the log counts samples: say in the mapping what one counts as, such as "
                '[diagnose] sample = "10 ms"'
            )
        second = options.sample
        time = time * second
    found = Recording(log.source, time, {}, {}, list(log.warnings), log.sha256, log.synthetic)
    found.gaps = tuple((gap.start * second, gap.stop * second) for gap in log.gaps)
    without: list[tuple[str, str]] = []
    for name, values in log.signals.items():
        connector, stated = targets.get(name, (name.removeprefix("system."), None))
        port = port_of(system, connector)
        unit, shown = _unit(system, port), log.display[name]
        column = mapping.signals[name]
        own = column.text == OWN
        if not (own or unit or stated):
            without.append((connector, shown))
        factor, offset = (1.0, 0.0) if own else _conversion(log, name, log.units[name], port, system, stated)
        # an FMU that states no unit takes SI; people read it in the log's unit
        scale = 1.0 if column.text == OWN else conversion(shown, log.units[name])
        if not own and (odd := contradiction(unit, _known(system, port))):
            told = (
                "the log's numbers are taken as they are"
                if shown == unit
                else "the FMU's definition is taken"
            )
            found.warnings.append(f"{port}: {odd}: {told}; have the FMU corrected")
        text = unit if own and unit else shown
        found.signals[connector] = factor * values + offset
        found.columns[connector] = Column(name, connector, text or "1", factor * scale, offset)
        if name in log.held:
            found.held |= {connector}
        if name in log.valid:
            found.missing[connector] = ~log.valid[name]
    if told := assumed_si(without):
        found.warnings.append(told)
    return found


def _conversion(
    log: Log, name: str, si: str, port: Port, system: System, stated: str | None
) -> tuple[float, float]:
    """Factor and offset from a log's SI value to the FMU's number.

    Raises:
        DataError: the dimensions differ.
    """
    unit = _unit(system, port)
    if stated is not None:
        # of a unit that only its FMU knows the number is taken
        known = definition(unit or "1", {}) is not None
        ratio = f"({unit or '1'})/({si})" if known else "1"
        try:
            return parse_quantity(stated if known else stated.split()[0], ratio), 0.0
        except UsageError as error:
            raise DataError(f"compare.signals.{name}.factor: {error}") from None
    label = log.display[name]
    found = of_reading(label, si, unit, _known(system, port))
    if found is None:
        raise DataError(
            f"{log.source}: '{name}' is in '{label}', but {port if port.component else port.variable} in '{unit}': "
            "correct the heading or the mapping"
        )
    return found
