"""``cosim diagnose``: names what the simulation gets wrong in a log, extends the model and measures the gain."""

import math
from pathlib import Path
from typing import Annotated

import typer

from cosim.options import Verbose


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(diagnose)


def diagnose(
    log: Annotated[
        list[Path],
        typer.Argument(
            help="Measured data: CSV, .mat or Parquet; several logs of one machine are diagnosed together."
        ),
    ],
    external: Annotated[
        Path | None, typer.Option(help="Record of the external tracker, on its own clock.")
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="full_order, simplified, a package (.ssp) or a wiring (.ssd) of our blocks, or any .ssp or .fmu "
            "[default: the mapping's or full_order]."
        ),
    ] = None,
    mapping: Annotated[Path | None, typer.Option(help="TOML that names the columns.")] = None,
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            help="Another log of the same machine, once for each: gains are measured on it [default: a part of LOG]."
        ),
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="Trust in the nominal parameters: one standard deviation, relative.")
    ] = 0.01,
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate", help="Fit the nominal parameters freely: only missing structure is a cause."
        ),
    ] = False,
    budget: Annotated[
        str | None,
        typer.Option(
            help="Time it may take, such as 60s: searches end with the best so far, and what was not tried is said "
            "[default: as long as it takes]."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("diagnosis"),
    verbose: Verbose = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Name what the simulation gets wrong, extend the model, measure the gain on held-out data."""
    from cosim.anysystem.command import any_system, diagnose_any
    from cosim.console import emit_json, warn
    from cosim.diagnosis.budget import parse_budget
    from cosim.errors import UsageError
    from cosim.logs import load_log, load_tracker
    from cosim.report.deliver import diagnose_into
    from cosim.report.screen import show

    seconds = parse_budget(budget) if budget is not None else math.inf
    foreign = any_system(model, mapping, log[0])
    if foreign is not None:
        if external is not None:
            raise UsageError(
                "--external goes with our crane; give the tracker's signal as a column of the log"
            )
        result = diagnose_any(out, log, foreign, mapping, held_out or (), tolerance, calibrate)
        if as_json:
            emit_json(result.model_dump())
        else:
            show(result, out, verbose)
        return
    loaded = [load_log(file, mapping) for file in log]
    tracker = load_tracker(external) if external is not None else None
    others = [load_log(file, mapping) for file in held_out or ()]
    for file, read in zip([*log, *(held_out or ())], [*loaded, *others], strict=True):
        for warning in read.warnings:
            warn(f"{file}: {warning}" if file is not log[0] or len(log) > 1 else warning)
    result = diagnose_into(
        out, loaded, tracker, model, tolerance, calibrate, mapping, others or None, seconds, verbose
    )
    if as_json:
        emit_json(result.model_dump())
    else:
        show(result, out, verbose)
