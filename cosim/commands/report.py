"""``cosim report``: makes the HTML report of a diagnosis again from its folder."""

from pathlib import Path
from typing import Annotated

import typer

from cosim.options import Language


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(report)


def report(
    folder: Annotated[
        Path, typer.Argument(help="Folder that `cosim diagnose` has written.", metavar="FOLDER")
    ],
    language: Language = "en",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Make report.html of a diagnosis: one file that needs no network."""
    from cosim.console import emit_json, stdout_console
    from cosim.report.page import write_report

    file = write_report(folder, language)
    if as_json:
        emit_json({"report": file, "bytes": file.stat().st_size})
    else:
        stdout_console().print(f"written: {file}", markup=False, soft_wrap=True)
