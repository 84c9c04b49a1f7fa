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
            help="With --native: another platform whose binary each FMU gets too, win64 or aarch64-linux; needs its C "
            "compiler; repeatable.",
            metavar="NAME",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Build the FMU of each block and the packages of the systems, closed and open.

    A closed package plays a command of 20 s (two periods of a sine, then steps) unless --with-stimulus names a log. With
    --native the same equations are translated to C, and each system is built as one FMU too.
    """
    from cosim.errors import UsageError
    from cosim.paths import build_folder
    from cosim.ssp.build import build_everything

    if fmi not in ("2.0", "3.0"):
        raise UsageError(f"--fmi {fmi}: FMUs of FMI 2.0 and 3.0 can be built")
    if fmi == "3.0" and not native:
        raise UsageError("--fmi 3.0 needs --native: the FMUs that run in Python are of FMI 2.0")
    if platforms and not native:
        raise UsageError(
            "--platform needs --native: the FMUs that run in Python hold the binaries of pythonfmu"
        )
    began = time.perf_counter()
    folder = (out or build_folder()).absolute()
    stimulus = stimulus_of(with_stimulus, mapping)
    messages = console.stderr_console() if as_json else console.stdout_console()

    def report(file: Path) -> None:
        size = file.stat().st_size / 1024
        messages.print(f"  {file.relative_to(folder)}  {size:.0f} KiB", markup=False, soft_wrap=True)

    if native:
        from cosim.native.everything import build_everything_native

        files = build_everything_native(folder, stimulus, report, fmi, platforms or ())
    else:
        files = build_everything(folder, stimulus, report)
    seconds = time.perf_counter() - began
    number = sum(map(len, files.values()))
    messages.print(f"built {number} files in {seconds:.1f} s: {folder}", markup=False, soft_wrap=True)
    if as_json:
        console.emit_json({"folder": folder, "seconds": seconds, **files})


def stimulus_of(log: Path | None, mapping: Path | None) -> bytes:
    """The CSV to play: the command of a log, from its first sample on, or the default one.

    Raises:
        DataError: the log is bad, or has no command or no time.
        UsageError: a mapping without a log.
    """
    from cosim.errors import DataError, UsageError
    from cosim.ssp.stimulus import default_command, stimulus_csv

    if log is None:
        if mapping is not None:
            raise UsageError("--mapping says how to read a log, so it needs --with-stimulus")
        return stimulus_csv(*default_command())
    from cosim.logs import load_log

    loaded = load_log(log, mapping)
    for warning in loaded.warnings:
        console.warn(warning)
    if loaded.time_unit != "s":
        raise DataError(f"'{log}' has no time, so its command cannot be played: add a column 'time [s]'")
    return stimulus_csv(loaded.time - loaded.time[0], loaded["u"])
