"""``cosim reproduce``: the source's figures and tables of chapters 4 and 5, made anew beside its numbers."""

from pathlib import Path
from typing import Annotated

import typer

from cosim import console


def register(app: typer.Typer) -> None:
    """Adds the command ``reproduce``."""
    app.command()(reproduce)


def reproduce(
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for page and JSON [default: reproduce/ in the build folder].",
            metavar="DIR",
        ),
    ] = None,
    hide: Annotated[
        list[str] | None,
        typer.Option(
            help="Effect that the rig carries; repeatable; 'none' for the nominal crane "
            "[default: dcv.amplitude_damping and continuity.flow_pressure, the source's own findings]."
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="Figure or table by its number in the source, such as 'fig. 4.4' or 5.14; repeatable [default: all]."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the rig's noise.", min=0)] = 1,
    full: Annotated[
        bool, typer.Option("--full", help="The source's whole grids of frequencies: some 40 minutes of log.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Every figure and table of chapters 4 and 5 that needs no unpublished log, from synthetic logs, as one page."""
    from cosim.reproduce.run import reproduced

    found = reproduced(out, hide, only or (), seed, full)
    if as_json:
        console.emit_json(found.data | {"files": {name: str(path) for name, path in found.files.items()}})
        return
    output = console.stdout_console()
    output.print(
        "from synthetic logs: “measured” is the virtual rig, the source's logs are not published",
        markup=False,
        soft_wrap=True,
    )
    for item in found.items:
        output.print(f"{item.source}, {item.title}: {item.verdict}", markup=False, soft_wrap=True)
    for path in found.files.values():
        output.print(f"written: {path}", markup=False, soft_wrap=True)
