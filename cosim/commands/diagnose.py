"""``cosim diagnose``: names what the simulation gets wrong in a log, extends the model and measures the gain."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from cosim.console import stderr_console
from cosim.options import Language, Verbose

LONG = 120.0  # s after which it is said how to end what has no budget


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(diagnose)


def diagnose(
    log: Annotated[
        list[Path],
        typer.Argument(
            help="Measured data: CSV, .mat, Parquet and others; several logs of one machine are diagnosed together."
        ),
    ],
    external: Annotated[
        Path | None, typer.Option(help="Record of the external tracker, on its own clock.")
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="full_order, simplified, physical, a package (.ssp) or a wiring (.ssd) of our blocks, or any .ssp or .fmu "
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
            "[default: 10 min with --model FMUs, else as long as it takes]."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("diagnosis"),
    language: Language = "en",
    verbose: Verbose = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Name what the simulation gets wrong, extend the model, measure the gain on held-out data."""
    from cosim import api
    from cosim.console import emit_json
    from cosim.report.screen import driven_by, show

    with way_out(budget):
        found = api.diagnose(
            log,
            model,
            mapping=mapping,
            external=external,
            held_out=held_out or (),
            tolerance=tolerance,
            calibrate=calibrate,
            budget=budget,
            out=out,
            language=language,
            verbose=verbose,
        )
    if as_json:
        emit_json(found.to_dict())
    else:
        show(found.answer, out, verbose, driven_by(found.answer, log[0], mapping))


@contextmanager
def way_out(budget: str | None) -> Iterator[None]:
    """Says on stderr how to end a diagnosis with the best so far, once it has taken `LONG` s without a budget."""
    words = f"this takes more than {LONG:g} s: Ctrl-C ends it with the best so far; --budget 2min does so by itself"
    timer = threading.Timer(LONG, lambda: stderr_console().print(words, markup=False, soft_wrap=True))
    timer.daemon = True
    if budget is None:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
