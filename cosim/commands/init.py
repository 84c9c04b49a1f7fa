"""``cosim init``: writes a mapping for a model and a log of anybody's."""

from pathlib import Path
from typing import Annotated

import typer

from cosim import console


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(init)


def init(
    model: Annotated[Path, typer.Argument(help="Package or FMU (.ssp, .fmu).", metavar="MODEL")],
    log: Annotated[Path, typer.Argument(help="Measured data.", metavar="LOG")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Mapping file [default: LOG with .toml].", metavar="FILE"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a file that exists.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Write a mapping: columns matched to connectors by name and unit, what is left in comments."""
    from cosim.anysystem.start import mapping_text
    from cosim.errors import UsageError
    from cosim.files import write_text
    from cosim.ssp.read import read_system

    target = out or log.with_suffix(".toml")
    if target.exists() and not force:
        raise UsageError(f"{target} exists: name another file (--out), or write over it (--force)")
    with read_system(model) as system:
        text, told, left = mapping_text(system, model, log, target.parent)
    write_text(target, text)
    if as_json:
        console.emit_json({"mapping": str(target), "matched": told, "open": left})
        return
    for line in told:
        console.stdout_console().print(line, markup=False)
    for line in left:
        console.stdout_console().print(f"open: {line}", markup=False)
    console.stdout_console().print(f"written to {target}", markup=False)
