"""``cosim machine``: the wiring, the values and the package of a machine that one file describes."""

from pathlib import Path
from typing import Annotated

import typer

from cosim import console


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(machine)


def machine(
    mapping: Annotated[
        Path, typer.Argument(help="Mapping file (TOML) with a table 'machine'.", metavar="FILE")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for .ssd, .ssv and .ssp.", metavar="DIR")],
    log: Annotated[
        Path | None,
        typer.Option(help="Log of the machine: tells what the file leaves open ('?').", metavar="LOG"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Write the model of a machine for other tools: wiring, values and package, made from its chain of blocks.

    The commands that take a log make it by themselves (--mapping FILE).
    """
    from cosim.api import building

    made = building.machine_model(mapping, out, log)
    if as_json:
        console.emit_json(made)
        return
    rows = [
        [*name.split(".", 1), f"{found['value']:.4g}", found["unit"], found["source"]]
        for name, found in made["parameters"].items()
    ]
    output, title = console.stdout_console(), f"{mapping.name}: {' -> '.join(made['chain'])}"
    output.print(console.table(title, ["block", "parameter", "value", "unit", ""], rows))
    for file in made["files"]:
        output.print(f"written: {file}", markup=False, soft_wrap=True)
