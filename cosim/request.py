"""What a user asks of a simulation, in texts and files: model, parameters, inputs, times."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.console import warn
from cosim.errors import DataError, ModelError, UsageError
from cosim.master.inputs import Series
from cosim.paths import ssp_folder
from cosim.results import DisplayUnit
from cosim.signals import LOG_SIGNALS
from cosim.ssp import System, read_ssv
from cosim.ssp.build import CLOSED, LOOPS, SYSTEMS, built_package
from cosim.ssp.fmu import parse_value
from cosim.ssp.hints import did_you_mean
from cosim.ssp.parameters import fitted
from cosim.ssp.read import resolve, settable_names
from cosim.ssp.system import Port, Value
from cosim.units import factor, parse_quantity

if TYPE_CHECKING:
    from cosim.logs import Log


def model_path(model: str, with_input: bool = False, log: Path | None = None) -> Path:
    """The file of a model.

    Args:
        model: a file, or the name of one of our systems; of a mapping with a table [machine] the package is made.
        with_input: the system is to be driven from outside, so take the open package.
        log: log of a machine, which tells what its file leaves open.

    Raises:
        UsageError: there is no such file or model.
        ModelError: a system of ours is not built, and cannot be.
    """
    path = Path(model)
    known = (*SYSTEMS, *CLOSED)
    if model not in known:
        if path.suffix.lower() in (".ssp", ".fmu"):
            return path
        if path.suffix.lower() == ".toml":
            from cosim.compare.model import build_wiring
            from cosim.logs import load_log
            from cosim.machines import made_for

            made = made_for(path, None if log is None else load_log(log, path))
            for note in made.table.notes:
                warn(note)
            wiring = made.ssd
            return build_wiring(wiring, wiring.parent)  # another log makes another machine of the same name
        raise UsageError(
            f"'{model}' is no model: give an .ssp, .fmu or .toml file, or one of {', '.join(known)}"
        )
    if with_input and model in LOOPS:
        raise UsageError(
            f"'{model}' has no input: its controller drives it; build it with --with-stimulus for another"
        )
    if with_input and model in CLOSED:
        raise UsageError(f"'{model}' has no input: build it with --with-stimulus for another command")
    return built_package(model, with_input)


def source_sets() -> dict[str, Path]:
    """The parameter sets that the source prints, by name (ssp/README.md)."""
    return {file.stem: file for file in sorted((ssp_folder() / "source").glob("*.ssv"))}


def set_file(given: Path) -> Path:
    """The file of a parameter set: itself, or one of the source's by its name, such as ``table_4_3_tf2``.

    Raises:
        UsageError: it has no suffix and is none of them.
    """
    if given.suffix or given.exists() or given.name != str(given):
        return given
    known = source_sets()
    if given.name not in known:
        raise UsageError(
            f"'{given}' is no parameter set: give an .ssv file, or one of the source's: {', '.join(known)}"
        )
    return known[given.name]


def lacking(name: str, system: System) -> str:
    """What to say where a system lacks the component of ``component.parameter``: those that it has."""
    component = name.rpartition(".")[0]
    if not component or component in system.components:
        return ""
    return f": the set is for another model, this one has {', '.join(system.components)}"


def parameters(system: System, files: list[Path], settings: list[str]) -> dict[str, Any]:
    """Start values from .ssv files, then from ``name=value unit`` texts, in the units of the FMUs.

    Raises:
        UsageError: a text is malformed, or its name or unit unknown.
        ModelError: a file is bad, or a value does not fit.
    """
    found: dict[str, Any] = {}
    for file in map(set_file, files):
        for value in read_ssv(file):
            ports = resolve(system, value.name)
            if not ports:
                near = did_you_mean(value.name, settable_names(system))
                raise ModelError(f"{file}: there is no '{value.name}'{near}{lacking(value.name, system)}")
            for port in ports:
                fmu = system.components[port.component].fmu
                found[str(port)] = fitted(value, fmu.variables[port.variable], fmu, str(file))
    for text in settings:
        name, equals, value_text = (part.strip() for part in text.partition("="))
        if not equals or not value_text:
            raise UsageError(f"--set '{text}' should read name=value, such as mechanical.J=900 kg.m2")
        ports = resolve(system, name)
        if not ports:
            raise UsageError(f"there is no '{name}' to set{did_you_mean(name, settable_names(system))}")
        found[name] = _setting(name, value_text, system.variable(ports[0]))
    return found


def _setting(name: str, text: str, variable: Any) -> Any:

    if variable.kind == "Real":
        try:
            return parse_quantity(text, variable.unit or "1")
        except UsageError as error:
            raise UsageError(f"--set {name}: {error}") from None
    try:
        return parse_value(variable.kind, text)
    except ValueError:
        raise UsageError(f"--set {name}: '{text}' is no {variable.kind}") from None


@dataclass(frozen=True)
class Played:
    """What drives a simulation.

    Attributes:
        inputs: series by input of the system, in the input's unit.
        start: first time [s].
        stop: last grid time within the data [s].
        starts: ``component.variable`` -> what the mapping says of parameters and of inputs that were not measured, and of
            initial values what their signals begin with.
        hold: inputs that keep each value until the next sample, as the mapping says; None where that is as usual.
        shown: input or output of the system -> how its mapping has it, where it is that of a machine.
    """

    inputs: Mapping[str, Series]
    start: float
    stop: float
    starts: Mapping[str, Value] = field(default_factory=dict)
    hold: tuple[str, ...] | None = None
    shown: Mapping[str, DisplayUnit] = field(default_factory=dict)


def read_inputs(file: Path, mapping: Path | None, system: System, step: float) -> Played:
    """Time series for the system's inputs from a log, or from any table with ``name [unit]`` columns.

    Raises:
        DataError: the file is bad.
        UsageError: it has none of the system's inputs.
    """
    from cosim.logs import load_log

    wanted = list(system.inputs)
    if not wanted:
        raise UsageError(
            f"'{system.name}' has no inputs, so --input drives nothing: take its open package (*_open.ssp)"
        )
    ours = all(part.fmu.ours for part in system.components.values())
    starts: dict[str, Value] = {}
    hold, seen = None, dict[str, DisplayUnit]()
    if not ours and (mapping is not None or _called_like_connectors(file, system)):
        time, columns, starts, hold = _mapped(file, mapping, system)
    elif mapping is not None or (ours and set(wanted) <= set(LOG_SIGNALS)):
        log = load_log(file, mapping)
        for warning in log.warnings:
            warn(warning)
        time, columns = log.time, {name: log[name] for name in wanted if name in log.signals}
        starts = _begun(log, mapping, system, list(columns))
        seen = _shown(log, mapping, system)
    else:
        time, columns = _table(file, system)
    if not columns:
        raise UsageError(f"{file} has none of the inputs of '{system.name}': {', '.join(wanted)}")
    first = float(time[0])
    steps = int((float(time[-1]) - first) / step + 1e-6)
    series = {name: (time, values) for name, values in columns.items()}
    return Played(series, first, first + steps * step, starts, hold, seen)


def _shown(log: "Log", mapping: Path | None, system: System) -> dict[str, DisplayUnit]:
    """Units of a machine's input and output as its mapping has them: its connectors have the blocks' (a torque in Pa)."""
    from cosim.compare.mapping import load_mapping

    plain, table = load_mapping(mapping) if mapping is not None else (None, None)
    if plain is None or table is None or not plain.machine:
        return {}
    ends = {*system.inputs, *system.outputs} & log.signals.keys() - table.signals.keys()
    return {n: DisplayUnit(log.display[n], factor(log.units[n], log.display[n])) for n in ends}


def _begun(log: "Log", mapping: Path | None, system: System, drives: list[str]) -> dict[str, Value]:
    """Initial values of a system of ours, as ``[compare.start]`` of the mapping says."""
    from cosim.compare.binding import bind, start_values
    from cosim.compare.mapping import load_mapping
    from cosim.compare.prepare import first_value
    from cosim.machines import in_package
    from cosim.ssp.stated import full_name

    plain, table = load_mapping(mapping) if mapping is not None else (None, None)
    if plain is None or table is None or not table.start:
        return {}
    table = table.model_copy(update={"signals": {**table.signals, **in_package(system, plain, table)}})
    bound = bind(system, log.units, table)
    stated = {full_name(system, parameter) for parameter in table.start}
    wanted = {p: n for p, n in start_values(system, table, bound).items() if p in stated and n in log}
    driving = [log[n] for n in drives]
    return {
        p: bound[n].gain * first_value(log[n], log.valid_mask(n), driving, log.step)[0]
        for p, n in wanted.items()
    }


def _called_like_connectors(file: Path, system: System) -> bool:
    """Whether columns are called like the connectors of components, as a diagnosis takes them, and not like the inputs."""
    from cosim.logs.load import open_source

    names = [label.name for label in open_source(file).labels]
    return not set(names) & set(system.inputs) and any(
        n.partition(".")[0] in system.components for n in names
    )


def _mapped(
    file: Path, mapping: Path | None, system: System
) -> tuple[Any, dict[str, Any], dict[str, Value], tuple[str, ...]]:
    """Of a system of others by the mapping that its diagnosis takes, or by columns called like its connectors.

    Returns:
        Time, inputs in their units, start values, and the inputs that are held.
    """
    import numpy as np

    from cosim.anysystem.read import begun, read
    from cosim.system.graph import port_of

    (log,), options, _ = read([file], system, mapping)
    for warning in log.warnings:
        warn(warning)
    found, hold = dict[str, Any](), list[str]()
    measured = {port_of(system, name): name for name in log.signals}
    for name, item in system.inputs.items():
        wires = [w for w in item.targets if w.target in measured]
        if (signal := measured.get(Port("", name))) is not None:
            found[name] = log.signals[signal]
        elif wires:  # the mapping names the component's end
            signal = measured[wires[0].target]
            found[name] = (log.signals[signal] - wires[0].offset) / wires[0].factor
        else:
            continue
        if signal in log.held:
            hold.append(name)
    h = float(np.median(np.diff(log.time)))
    starts = begun(options.start, log.signals, log.missing, list(found.values()), h)
    return log.time, found, {**options.given, **starts}, tuple(hold)


def _table(file: Path, system: System) -> tuple[Any, dict[str, Any]]:
    """Columns of a table that are inputs of the system, in their units."""
    from cosim.logs.load import open_source

    source = open_source(file)
    units = {"time": "s"} | {item.name: item.unit or "1" for item in system.inputs.values()}
    picked = {label.name: k for k, label in enumerate(source.labels) if label.name in units}
    if "time" not in picked:
        raise DataError(f"{file} has no column 'time [s]'")
    data = dict(zip(picked, source.read(list(picked.values())), strict=True))
    for name, k in picked.items():
        unit = source.labels[k].unit
        if unit is None:
            raise DataError(f"{file}: the column '{name}' has no unit: head it '{name} [{units[name]}]'")
        try:
            data[name] = data[name] * factor(unit, units[name])
        except UsageError as error:
            raise DataError(f"{file}: column '{name}': {error}") from None
    return data.pop("time"), data


def seconds(text: str, option: str) -> float:
    """A time [s] from an option such as ``--stop-time "200 ms"``.

    Raises:
        UsageError: it is no time; the message names the option.
    """
    try:
        return parse_quantity(text, "s")
    except UsageError as error:
        raise UsageError(f"{option}: {error}") from None
