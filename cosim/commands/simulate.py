"""``cosim simulate``: run a system or FMU."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim import console

if TYPE_CHECKING:
    from cosim.master import Runner
    from cosim.master.inputs import Series
    from cosim.results import Result
    from cosim.ssp import System

DEFAULT_STOP, DEFAULT_STEP = 10.0, 1e-3  # [s], where neither option nor model says


def register(app: typer.Typer) -> None:
    """Adds the command ``simulate``."""
    app.command()(simulate)


def simulate(
    model: Annotated[str, typer.Argument(help="An .ssp or .fmu file, or simplified, full_order, physical.")],
    stop_time: Annotated[
        str | None, typer.Option(help="Such as '10 s' [default: end of the input, the model's own, or 10 s].")
    ] = None,
    step_size: Annotated[
        str | None, typer.Option(help="Such as '1 ms' [default: the model's own, or 1 ms].")
    ] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="Such as 'mechanical.J=900 kg.m2'; repeatable.")
    ] = None,
    parameter_set: Annotated[
        list[Path] | None,
        typer.Option(
            help="An .ssv with names such as mechanical.J; repeatable, before --set.", metavar="FILE"
        ),
    ] = None,
    played: Annotated[
        Path | None, typer.Option("--input", help="Log or CSV with the system's inputs.", metavar="FILE")
    ] = None,
    mapping: Annotated[
        Path | None,
        typer.Option(help="Mapping file (TOML) for an input log with other names.", metavar="FILE"),
    ] = None,
    record: Annotated[
        list[str] | None,
        typer.Option(help="Signal to keep, such as mechanical.theta; repeatable [default: all]."),
    ] = None,
    estimate_error: Annotated[
        bool, typer.Option("--estimate-error", help="Estimate the error of the step size, by two finer runs.")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write .csv, .parquet or .mat.")] = None,
    si: Annotated[bool, typer.Option("--si", help="Write SI units instead of those people read.")] = False,
    partial_step: Annotated[
        bool, typer.Option("--partial-step", help="Let the last step be shorter, to end at the stop time.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Simulate a system of FMUs: components in wiring order, each step with the values its sources just computed."""
    from cosim.errors import UsageError
    from cosim.master import Runner
    from cosim.results import check_suffix

    if out is not None:
        check_suffix(out)
    if mapping is not None and played is None:
        raise UsageError("--mapping says how to read a log, so it needs --input")
    with Runner(model_path(model, with_input=played is not None)) as runner:
        system = runner.system
        step = _quantity(step_size, "--step-size") if step_size else system.step_size or DEFAULT_STEP
        inputs, start, end = (
            read_inputs(played, mapping, system, step) if played else ({}, system.start_time or 0.0, None)
        )
        stop = _quantity(stop_time, "--stop-time") if stop_time else end or system.stop_time or DEFAULT_STOP
        options = {
            "parameters": parameters(system, parameter_set or [], settings or []),
            "inputs": inputs,
            "record": record or None,
            "start_time": start,
            "partial_step": partial_step,
        }
        result = _run(runner, stop, step, estimate_error, options)
    for note in [*result.notes, *result.messages]:
        console.warn(note)
    if out is not None:
        result.write(out, display=not si)
    _show(result, out, si, as_json)


def model_path(model: str, with_input: bool = False) -> Path:
    """The file of a model.

    Args:
        model: a file, or the name of one of our systems.
        with_input: the system is to be driven from outside, so take the open package.

    Raises:
        UsageError: there is no such file or model.
        ModelError: our systems are not built.
    """
    from cosim.errors import ModelError, UsageError
    from cosim.paths import build_folder
    from cosim.ssp.build import SYSTEMS

    path = Path(model)
    if model not in SYSTEMS:
        if path.suffix.lower() in (".ssp", ".fmu"):
            return path
        raise UsageError(f"'{model}' is no model: give an .ssp or .fmu file, or one of {', '.join(SYSTEMS)}")
    built = build_folder() / "ssp" / f"{model}{'_open' if with_input else ''}.ssp"
    if not built.is_file():
        raise ModelError(
            f"the model '{model}' is not built ('{built}' is missing): run `python build_fmus.py` first"
        )
    return built


def parameters(system: "System", files: list[Path], settings: list[str]) -> dict[str, Any]:
    """Start values from .ssv files, then from ``name=value unit`` texts, in the units of the FMUs.

    Raises:
        UsageError: a text is malformed, or its name or unit unknown.
        ModelError: a file is bad, or a value does not fit.
    """
    from cosim.errors import ModelError, UsageError
    from cosim.ssp import read_ssv
    from cosim.ssp.hints import did_you_mean
    from cosim.ssp.parameters import fitted
    from cosim.ssp.read import resolve, settable_names

    found: dict[str, Any] = {}
    for file in files:
        for value in read_ssv(file):
            ports = resolve(system, value.name)
            if not ports:
                raise ModelError(
                    f"{file}: there is no '{value.name}'{did_you_mean(value.name, settable_names(system))}"
                )
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
    from cosim.errors import UsageError
    from cosim.ssp.fmu import parse_value
    from cosim.units import parse_quantity

    if variable.kind == "Real":
        try:
            return parse_quantity(text, variable.unit or "1")
        except UsageError as error:
            raise UsageError(f"--set {name}: {error}") from None
    try:
        return parse_value(variable.kind, text)
    except ValueError:
        raise UsageError(f"--set {name}: '{text}' is no {variable.kind}") from None


def read_inputs(
    file: Path, mapping: Path | None, system: "System", step: float
) -> "tuple[Mapping[str, Series], float, float]":
    """Time series for the system's inputs from a log, or from any table with ``name [unit]`` columns.

    Returns:
        (series by input in the input's unit, first time [s], last grid time within the data [s]).

    Raises:
        DataError: the file is bad.
        UsageError: it has none of the system's inputs.
    """
    from cosim.errors import UsageError
    from cosim.logs import load_log
    from cosim.signals import LOG_SIGNALS

    wanted = list(system.inputs)
    if not wanted:
        raise UsageError(
            f"'{system.name}' has no inputs, so --input drives nothing: take its open package (*_open.ssp)"
        )
    if mapping is not None or set(wanted) <= set(LOG_SIGNALS):
        log = load_log(file, mapping)
        for warning in log.warnings:
            console.warn(warning)
        time, columns = log.time, {name: log[name] for name in wanted if name in log.signals}
    else:
        time, columns = _table(file, system)
    if not columns:
        raise UsageError(f"{file} has none of the inputs of '{system.name}': {', '.join(wanted)}")
    first = float(time[0])
    steps = int((float(time[-1]) - first) / step + 1e-6)
    return {name: (time, values) for name, values in columns.items()}, first, first + steps * step


def _table(file: Path, system: "System") -> tuple[Any, dict[str, Any]]:
    """Columns of a table that are inputs of the system, in their units."""
    from cosim.errors import DataError, UsageError
    from cosim.logs.load import open_source
    from cosim.units import factor

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


def _run(runner: "Runner", stop: float, step: float, estimate: bool, options: dict[str, Any]) -> "Result":
    with console.progress(f"simulating {runner.system.name}", stop - options["start_time"]) as bar:
        simulate = runner.coupling_error if estimate else runner.run
        return simulate(stop, step, progress=bar, **options)


def _quantity(text: str, option: str) -> float:
    from cosim.errors import UsageError
    from cosim.units import parse_quantity

    try:
        return parse_quantity(text, "s")
    except UsageError as error:
        raise UsageError(f"{option}: {error}") from None


def _show(result: "Result", out: Path | None, si: bool, as_json: bool) -> None:
    rows = []
    for name, values in result.signals.items():
        shown = None if si else result.display.get(name)
        factor, offset = (shown.factor, shown.offset) if shown else (1.0, 0.0)
        unit = shown.name if shown else result.units.get(name, "") or "1"
        low, high, last = (float(v) * factor + offset for v in (values.min(), values.max(), values[-1]))
        row: dict[str, Any] = {"signal": name, "unit": unit, "min": low, "max": high, "final": last}
        if result.errors is not None:
            error = result.errors[name]
            row |= {"error": error.largest * abs(factor), "order": error.order}
        rows.append(row)
    if as_json:
        console.emit_json(
            {
                "model": result.model,
                "label": result.label,
                "start_time": result.time[0],
                "stop_time": result.time[-1],
                "step_size": result.step_size,
                "steps": len(result.time) - 1,
                "wall_time": result.wall_time,
                "parameters": result.parameters,
                "signals": {row.pop("signal"): row for row in rows},
                "notes": result.notes,
                "messages": result.messages,
                "path": out,
            }
        )
        return
    output = console.stdout_console()
    span = float(result.time[-1] - result.time[0])
    speed = f"{span / result.wall_time:.3g} times real time"
    title = f"{result.model}, simulated: {span:g} s in {len(result.time) - 1} steps, {speed}"
    output.print(
        console.table(title, list(rows[0]) if rows else ["signal"], [list(row.values()) for row in rows])
    )
    if out is not None:
        output.print(f"written: {out}", markup=False, soft_wrap=True)
