"""``cosim demo``: builds what is missing, compares the nominal model with a synthetic log, and names what it gets wrong."""

from pathlib import Path
from typing import Annotated

import typer

from cosim import console
from cosim.options import Verbose

LOG = "synthetic_demo.csv"


def register(app: typer.Typer) -> None:
    """Adds the command ``demo``."""
    app.command()(demo)


def demo(
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for pictures and series [default: demo/ in the build folder].",
            metavar="DIR",
        ),
    ] = None,
    verbose: Verbose = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Build what is missing, compare the nominal model with a synthetic log in which something is hidden, and name it."""
    from cosim import api
    from cosim.api.building import build_missing
    from cosim.commands.compare import show as show_comparison
    from cosim.paths import build_folder, examples_folder
    from cosim.report.screen import show

    folder = build_folder()
    messages = console.stderr_console() if as_json else console.stdout_console()
    build_missing(folder)
    log = examples_folder() / LOG
    messages.print(
        f"{LOG} is synthetic: made by the virtual rig (cosim rig) with 100 N m of dry friction in the mechanics, which the "
        "nominal model does not have. The diagnosis is not told so.",
        markup=False,
        soft_wrap=True,
    )
    results = out or folder / "demo"
    compared = api.compare(log, out=results)
    if verbose and not as_json:
        show_comparison(compared, verbose)
    found = api.diagnose(log, "full_order", out=results, verbose=verbose)
    if as_json:
        console.emit_json({**compared.to_dict(), "diagnosis": found.to_dict()})
    else:
        show(found.answer, results, verbose)
