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
    from cosim.commands.demo import build_missing
    from cosim.errors import UsageError
    from cosim.paths import build_folder
    from cosim.reproduce.campaign import HIDDEN, Campaign
    from cosim.reproduce.page import as_data, made, makers, need_extra, write
    from cosim.rig import Hidden

    need_extra()
    if hide and "none" in hide and len(hide) > 1:
        raise UsageError("--hide none stands alone: with it the rig carries nothing")
    hidden = HIDDEN if not hide else () if hide == ["none"] else tuple(hide)
    for text in hidden:
        Hidden.parse(text)  # a misspelt name is said before the work begins
    campaign, wanted = Campaign(hidden, seed, full), only or []
    count = len(makers(campaign, wanted))
    build_missing(build_folder())
    with console.progress("figures and tables", count) as advance:
        items = list(made(campaign, wanted, lambda done, _: advance(done)))
    files = write(campaign, items, out or build_folder() / "reproduce")
    if as_json:
        console.emit_json(
            as_data(campaign, items) | {"files": {name: str(path) for name, path in files.items()}}
        )
        return
    output = console.stdout_console()
    output.print(
        "from synthetic logs: “measured” is the virtual rig, the source's logs are not published",
        markup=False,
    )
    for item in items:
        output.print(f"{item.source}, {item.title}: {item.verdict}", markup=False, soft_wrap=True)
    for path in files.values():
        output.print(f"written: {path}", markup=False, soft_wrap=True)
