"""``cosim build``: all FMUs and packages."""

import time
from pathlib import Path
from typing import Annotated

import typer

from cosim import console


def register(app: typer.Typer) -> None:
    """Adds the command ``build``."""
    app.command()(build)


def build(
    out: Annotated[
        Path | None,
        typer.Option(help="Folder to build into [default: COSIM_BUILD, or build/ in the checkout]."),
    ] = None,
    with_stimulus: Annotated[
        Path | None, typer.Option(help="A log whose command u the closed packages play.", metavar="FILE")
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="Mapping file (TOML) for a log whose columns have other names.")
    ] = None,
    native: Annotated[
        bool,
        typer.Option(
            "--native", help="Build FMUs that need no Python, into the folder native; needs a C compiler."
        ),
    ] = False,
    fmi: Annotated[
        str,
        typer.Option(
            help="Version of FMI, 2.0 or 3.0; 3.0 needs --native and goes into the folder native_fmi3."
        ),
    ] = "2.0",
    platforms: Annotated[
        list[str] | None,
        typer.Option(
            "--platform",
            help="With --native: another platform whose binary each FMU gets too: win64, linux64, aarch64-linux, darwin64 "
            "or all; needs its C compiler or the extra cross; repeatable.",
            metavar="NAME",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Build the FMU of each block and the packages of the systems, closed and open.

    A closed package plays a command of 20 s (two periods of a sine, then steps) unless --with-stimulus names a log. With
    --native the same equations are translated to C, and each system is built as one FMU too.
    """
    from cosim.api import building
    from cosim.paths import build_folder

    began = time.perf_counter()
    folder = (out or build_folder()).absolute()
    messages = console.stderr_console() if as_json else console.stdout_console()

    def report(file: Path) -> None:
        size = file.stat().st_size / 1024
        messages.print(f"  {file.relative_to(folder)}  {size:.0f} KiB", markup=False, soft_wrap=True)

    files = building.build(
        folder, with_stimulus, mapping, native=native, fmi=fmi, platforms=platforms or (), told=report
    )
    seconds = time.perf_counter() - began
    number = sum(map(len, files.values()))
    messages.print(f"built {number} files in {seconds:.1f} s: {folder}", markup=False, soft_wrap=True)
    if as_json:
        console.emit_json({"folder": folder, "seconds": seconds, **files})
