"""``cosim compare``: a model beside a log."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim import console
from cosim.errors import UsageError
from cosim.options import Verbose

if TYPE_CHECKING:
    from cosim.beside.extras import Extras
    from cosim.compare import CompareTable, Comparison
    from cosim.logs import Log, Mapping
    from cosim.ssp.system import System

DEFAULT_MODEL = "full_order"
MISSED = 1


# the options of the command, each a type of its own
ParameterSets = Annotated[
    list[Path] | None,
    typer.Option(help="An .ssv with names such as mechanical.J; repeatable.", metavar="FILE"),
]
Settings = Annotated[
    list[str] | None, typer.Option("--set", help="Such as 'mechanical.J=900 kg.m2'; repeatable.")
]
StepSize = Annotated[str | None, typer.Option(help="Such as '1 ms' [default: the log's own, uniform].")]
Thresholds = Annotated[
    list[str] | None,
    typer.Option(help="Largest RMSE of a signal, such as slew=0.5deg; exit code 1 if missed; repeatable."),
]
Calibrate = Annotated[bool, typer.Option("--calibrate", help="Fit free parameters to the log first.")]
Freed = Annotated[
    list[str] | None,
    typer.Option(help="A free parameter, such as mechanical.J or 'dcv.K=2:3 mm'; repeatable."),
]
Priors = Annotated[
    list[str] | None,
    typer.Option(help="What is known of one beforehand, such as 'dcv.K=2.4+-0.1 mm'; repeatable."),
]
FitTo = Annotated[
    list[str] | None, typer.Option(help="Fit to this signal [default: all measured]; repeatable.")
]
HeldOut = Annotated[
    str | None,
    typer.Option(help="Not fitted but scored: a part of the log's end or another log [default: 0.3]."),
]
Starts = Annotated[int | None, typer.Option(help="Starts of the search [default: 4].")]
WithObserver = Annotated[
    bool, typer.Option("--observer", help="Run the observer's FMU on the log's command and slew.")
]
External = Annotated[
    Path | None,
    typer.Option(help="Record of the external tracker, held against the slew sensor.", metavar="FILE"),
]


def register(app: typer.Typer) -> None:
    """Adds the command ``compare``."""
    app.command()(compare)


def compare(
    log: Annotated[Path, typer.Argument(help="The log: .csv, .mat, .parquet, .mf4 or .tdms.", metavar="LOG")],
    model: Annotated[
        str | None,
        typer.Option(
            help="simplified, full_order, physical or a file [default: the mapping's or full_order]."
        ),
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="Mapping file (TOML) for a log with other names.", metavar="FILE")
    ] = None,
    parameter_set: ParameterSets = None,
    settings: Settings = None,
    step_size: StepSize = None,
    threshold: Thresholds = None,
    calibrate: Calibrate = False,
    free: Freed = None,
    prior: Priors = None,
    fit_to: FitTo = None,
    held_out: HeldOut = None,
    starts: Starts = None,
    observer: WithObserver = False,
    external: External = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for pictures and series.", metavar="DIR")
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write the series as CSV instead of Parquet.")] = False,
    verbose: Verbose = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Simulate a model on a log's command and show what it gets wrong, per signal and per block.

    A block is driven by what was measured before it, so an error shows where it arises.
    """
    missed = compare_log(
        log,
        model=model,
        mapping=mapping,
        parameter_sets=parameter_set or [],
        settings=settings or [],
        step_size=step_size,
        thresholds=threshold or [],
        calibration=_calibration(calibrate, free, prior, fit_to, held_out, starts),
        observer=observer,
        external=external,
        out=out,
        csv=csv,
        verbose=verbose,
        as_json=as_json,
    )
    if missed:
        raise typer.Exit(MISSED)


def compare_log(
    file: Path,
    *,
    model: str | None = None,
    mapping: Path | None = None,
    parameter_sets: list[Path] | None = None,
    settings: list[str] | None = None,
    step_size: str | None = None,
    thresholds: list[str] | None = None,
    calibration: dict[str, Any] | None = None,
    observer: bool = False,
    external: Path | None = None,
    out: Path | None = None,
    csv: bool = False,
    verbose: bool = False,
    as_json: bool = False,
    emit: Callable[[Any], None] = console.emit_json,
) -> bool:
    """Do what the command does; `demo` uses it too, and puts the JSON object that `emit` gets into its own.

    `calibration` holds the attributes of `cosim.calibrate.command.Request`. Returns whether a threshold was missed.

    Raises:
        DataError, ModelError, UsageError, SimulationError: whatever is wrong with log, model, request or run.
    """
    from cosim.beside.extras import Extras
    from cosim.compare import Comparator, CompareTable, load_mapping
    from cosim.compare.limits import check_limits, read_limits
    from cosim.compare.present import as_data
    from cosim.logs import load_log

    names, table = load_mapping(mapping) if mapping is not None else (None, CompareTable())
    loaded = load_log(file, names)
    source, table = _source(model, mapping, names, table, loaded)
    with Comparator(loaded, source, table=table, step=_seconds(step_size)) as comparator:
        limits = read_limits(thresholds or [], comparator)
        given = _parameters(comparator.system, table, parameter_sets, settings)
        extras = Extras(comparator, given)
        if calibration is not None:
            given = extras.calibrate(calibration, table, names)
        _beside(extras, observer, external)
        with console.progress(f"comparing with {comparator.system.name}", 1.0):
            comparison = comparator.run(given)
        results = check_limits(comparison, limits)
        folder = Path("calibration") if calibration is not None and out is None else out
        written = {} if folder is None else write_files(comparison, folder, csv)
        written |= {} if folder is None else extras.write(comparison, folder)
    if as_json:
        emit(_answer(comparison, as_data(comparison, source), extras, results, written))
    else:
        _show(comparison, results, written, extras, verbose)
    return any(not result["passed"] for result in results)


def _source(
    model: str | None, mapping: Path | None, names: "Mapping | None", table: "CompareTable", log: "Log"
) -> tuple[Path, "CompareTable"]:
    """The file to simulate, and what the signals stand for in it: a machine in one file is made first."""
    from cosim.compare import open_model

    if mapping is not None and names is not None and names.machine and model is None:
        from cosim.machines import made_for

        made = made_for(mapping, log)
        return open_model(str(made.ssd)), made.table
    return open_model(*_reference(model, names, table)), table


def _beside(extras: "Extras", observer: bool, external: Path | None) -> None:
    """Observer and tracker beside the log, where asked for."""
    if observer:
        extras.observe()
    if external is not None:
        extras.track(external)


def _parameters(
    system: "System", table: "CompareTable", sets: list[Path] | None, settings: list[str] | None
) -> dict[str, Any]:
    """Start values from the mapping's .ssv files, the command line's, and its single settings, the later ones stronger."""
    from cosim.request import parameters

    return parameters(system, [*table.parameter_files, *(sets or [])], settings or [])


def _seconds(text: str | None) -> float | None:
    """A step as the user wrote it, in s."""
    from cosim.units import parse_quantity

    return parse_quantity(text, "s") if text else None


def _answer(
    comparison: "Comparison",
    data: dict[str, Any],
    extras: "Extras",
    results: list[Any],
    written: dict[str, Path],
) -> dict[str, Any]:
    """The JSON object; the comparison's notes go to stderr."""
    for note in comparison.notes:
        console.warn(note)
    return {**data, **extras.as_data(comparison), "thresholds": results, "files": written}


def write_files(comparison: "Comparison", folder: Path, csv: bool) -> dict[str, Path]:
    """Write pictures and series; returns name -> file.

    Raises:
        UsageError: the folder cannot be written to.
    """
    from cosim.compare.picture import write_pictures
    from cosim.compare.present import write_series
    from cosim.errors import UsageError

    try:
        folder.mkdir(parents=True, exist_ok=True)
        written = write_pictures(comparison, folder)
        written["series"] = write_series(comparison, folder / f"series.{'csv' if csv else 'parquet'}")
    except OSError as error:
        raise UsageError(
            f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
        ) from None
    return written


def _calibration(
    wanted: bool,
    free: list[str] | None,
    prior: list[str] | None,
    fit_to: list[str] | None,
    held_out: str | None,
    starts: int | None,
) -> dict[str, Any] | None:
    """The options of a calibration, or None where none is wanted.

    Raises:
        UsageError: there are options, but no calibration.
    """
    asked = {"free": free, "prior": prior, "fit_to": fit_to, "held_out": held_out, "starts": starts}
    given = {name: value for name, value in asked.items() if value is not None}
    if given and not wanted:
        names = ", ".join("--" + name.replace("_", "-") for name in given)
        raise UsageError(f"{names} belongs to a calibration: add --calibrate")
    return given if wanted else None


def _reference(
    model: str | None, mapping: "Mapping | None", table: "CompareTable"
) -> tuple[str, Path | None]:
    """The model's name or file, and the folder where a file that the mapping names may lie."""
    if model is not None:
        return model, None
    if mapping is not None and mapping.model is not None:
        return mapping.model, table.folder if mapping.path is None else mapping.path.parent
    return DEFAULT_MODEL, None


def _show(
    comparison: "Comparison",
    results: list[dict[str, Any]],
    written: dict[str, Path],
    extras: "Extras",
    verbose: bool,
) -> None:
    """Print the answer; with `verbose` the tables before it."""
    from cosim.compare.present import answer, explanations, tables

    output = console.stdout_console()

    def say(text: str) -> None:
        output.print(text, markup=False, soft_wrap=True)

    log = comparison.log
    kind = "synthetic log" if log.synthetic else "log"
    span = comparison.time[-1] - comparison.time[0]
    say(
        f"{log.source} ({kind}, {span:.6g} s at {comparison.step:.6g} s) and model {comparison.model}, simulated"
    )
    for note in comparison.notes:
        console.warn(note)
    if verbose:
        for table in tables(comparison):
            if table.rows:
                output.print(table)
        for text in explanations(comparison):
            say(text)
    else:
        for text in answer(comparison):
            say(text)
    extras.show(comparison, verbose)
    for result in results:
        state, name, unit = "kept" if result["passed"] else "MISSED", result["signal"], result["unit"]
        say(
            f"threshold {state}: RMSE of {name} {result['rmse']:.4g} {unit}, limit {result['limit']:.4g} {unit}"
        )
    for file in written.values():
        say(f"written: {file}")
    if not verbose:
        say(f"Next: cosim diagnose {log.source} names the cause; --verbose shows each signal and block")
