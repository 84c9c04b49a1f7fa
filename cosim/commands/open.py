"""``cosim open``: a local page on which a log is dropped, its columns are mapped and the diagnosis is watched."""

from pathlib import Path
from typing import Annotated

import typer

from cosim import console


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("open")(open_page)


def open_page(
    log: Annotated[
        list[Path] | None,
        typer.Argument(
            help="A log to begin with, or several of one machine; else they are dropped on the page."
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(help="full_order, simplified, an .ssp or .fmu, or a mapping or machine (.toml)."),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes a free one.")] = 0,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder of results, one in it for each diagnosis.")
    ] = Path("diagnoses"),
    held_out: Annotated[
        list[Path] | None,
        typer.Option(help="Another log of the same machine, once for each, on which the gain is judged."),
    ] = None,
    external: Annotated[
        Path | None, typer.Option(help="Record of the external tracker, on its own clock.")
    ] = None,
    language: Annotated[
        str | None,
        typer.Option(
            "--language", help="Of page and report: en, de [default: the browser's].", metavar="LANGUAGE"
        ),
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page in your browser.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object when it ends.")] = False,
) -> None:
    """Open a local page: drop a log, choose its columns, watch the diagnosis, explore its report.

    Only this machine reaches the page, and only with the address that is printed. Ctrl-C ends it; results stay.
    """
    from cosim.browser.run import run

    def show(url: str) -> None:
        screen = console.stderr_console() if as_json else console.stdout_console()
        screen.print(url, markup=False, soft_wrap=True)
        screen.print("Open this address; Ctrl-C, or the button on the page, ends it", markup=False)

    found = run(
        log or [], model, port, out, show, browser, language, held_out=held_out or [], external=external
    )
    if as_json:
        console.emit_json({"diagnoses": found})
        return
    for item in found:
        console.stdout_console().print(
            f"{item['verdict'].replace('_', ' ')}: {item['folder']}", markup=False, soft_wrap=True
        )
