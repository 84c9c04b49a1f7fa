"""``cosim check``: a model held against reference logs and the limits kept in a file, for CI."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(check)


def check(
    file: Annotated[
        Path, typer.Argument(help="Reference logs and their limits (TOML).", metavar="FILE")
    ] = Path("cosim-check.toml"),
    model: Annotated[
        str | None, typer.Option(help="Check this model in place of those that FILE names.")
    ] = None,
    add: Annotated[
        list[Path] | None,
        typer.Option(
            help="Add a reference log: its limits are measured and written; repeatable.", metavar="LOG"
        ),
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="Mapping file of the logs that are added.", metavar="MAPPING")
    ] = None,
    update: Annotated[
        bool, typer.Option("--update", help="Measure every limit anew and write them into FILE.")
    ] = False,
    margin: Annotated[
        str | None,
        typer.Option(help="Of limits above the errors found, with --add or --update [default: 10 %]."),
    ] = None,
    cause: Annotated[
        bool | None,
        typer.Option(
            "--cause/--no-cause", help="Diagnose each log, or none [default: those whose limits are missed]."
        ),
    ] = None,
    budget: Annotated[str | None, typer.Option(help="Time of each diagnosis, such as 60s.")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write the result as JUnit XML.", metavar="XML")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Hold a model against reference logs: is an error above its limit, which block became worse, and why.

    Exit code 1 where a limit is missed.
    """
    from cosim import api, console

    found = api.check(
        file,
        model,
        add=add or (),
        mapping=mapping,
        update=update,
        margin=margin,
        cause=cause,
        budget=budget,
        junit=junit,
    )
    if as_json:
        console.emit_json(found.to_dict())
    else:
        for line in found.lines():
            console.stdout_console().print(line, markup=False, soft_wrap=True)
    raise typer.Exit(found.exit_code)
