"""The subcommands of ``cosim identify`` that take numbers of the drive from logs."""

from pathlib import Path
from typing import Annotated

import typer

from cosim.commands.identify.prepare import AsJson
from cosim.options import Verbose

LogFile = Annotated[
    Path, typer.Argument(help="The log: .csv, .mat, .parquet, .mf4, .tdms or .xlsx.", metavar="LOG")
]
LogFiles = Annotated[
    list[Path], typer.Argument(help="One log or several, fitted together.", metavar="LOG...")
]
MappingFile = Annotated[
    Path | None, typer.Option(help="Mapping file (TOML) for a log with other names.", metavar="FILE")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="Number taken as known, such as 'compensator.d_plus=0'; repeatable."),
]
Filter = Annotated[
    str | None,
    typer.Option(
        "--filter", help="Low-pass on command and response alike (Butterworth, order 2), such as '50 Hz'."
    ),
]
From = Annotated[str | None, typer.Option("--from", help="Use the log from this time on, such as '10 s'.")]
To = Annotated[str | None, typer.Option("--to", help="Use the log up to this time.")]
Out = Annotated[
    Path | None, typer.Option("--out", "-o", help="Folder for .ssv, picture and JSON.", metavar="DIR")
]
Block = Annotated[
    str | None, typer.Option(help="dcv, continuity, mechanical or simplified [default: simplified].")
]
Input = Annotated[str | None, typer.Option("--input", help="Input signal, instead of a block.")]
Output = Annotated[str | None, typer.Option("--output", help="Output signal, instead of a block.")]
Linear = Annotated[
    bool,
    typer.Option("--linear", help="Take u as it is, without compensator and dead zone, as the source does."),
]


def identify_all(
    log: LogFile,
    mapping: MappingFile = None,
    settings: Settings = None,
    cutoff: Filter = None,
    start: From = None,
    stop: To = None,
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Dead zone, valve, pressure and mechanics from one log, and one .ssv for the model."""
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(numbers.everything(log, mapping, settings, cutoff, start, stop), out, as_json, verbose)


def dead_zone(
    log: LogFile,
    response: Annotated[
        str | None, typer.Option(help="spool, p_load or slew [default: the first of these in the log].")
    ] = None,
    mapping: MappingFile = None,
    settings: Settings = None,
    cutoff: Filter = None,
    start: From = None,
    stop: To = None,
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Break points and slopes of the valve's dead zone, best from a slow ramp.

    Where the compensator was off, as in the source's own experiment, say so: --set compensator.d_plus=0 --set
    compensator.d_minus=0.
    """
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(numbers.dead_zone(log, response, mapping, settings, cutoff, start, stop), out, as_json, verbose)


def transfer_function(
    logs: LogFiles,
    block: Block = None,
    source: Input = None,
    target: Output = None,
    order: Annotated[
        list[str] | None,
        typer.Option(
            help="Poles/zeros of a candidate, such as 3/1; repeatable [default: those of the block's table]."
        ),
    ] = None,
    integrators: Annotated[
        int | None, typer.Option(help="Poles at 0 among them [default: 1 to the slew angle, else 0].")
    ] = None,
    delay: Annotated[bool, typer.Option("--delay", help="With a transport delay.")] = False,
    linear: Linear = False,
    mapping: MappingFile = None,
    settings: Settings = None,
    cutoff: Filter = None,
    start: From = None,
    stop: To = None,
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Transfer functions fitted to logs: a table of candidates, and the one to use, by BIC and held-out fit."""
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(
        numbers.transfer_function(
            logs,
            block,
            source,
            target,
            order,
            integrators,
            delay,
            linear,
            mapping,
            settings,
            cutoff,
            start,
            stop,
        ),
        out,
        as_json,
        verbose,
    )


def frf(
    logs: LogFiles,
    block: Block = None,
    source: Input = None,
    target: Output = None,
    method: Annotated[str, typer.Option(help="stepped (sines, period by period) or welch.")] = "stepped",
    extremes: Annotated[
        bool, typer.Option("--extremes", help="Amplitude from the extremes, as (4.12) prints it.")
    ] = False,
    order: Annotated[str | None, typer.Option(help="Poles/zeros of the fit [default: the block's].")] = None,
    delay: Annotated[bool, typer.Option("--delay", help="Fit a transport delay too.")] = False,
    segment: Annotated[str | None, typer.Option(help="Segment of Welch's method, such as '8 s'.")] = None,
    low: Annotated[str | None, typer.Option(help="Lowest frequency, such as '0.5 rad/s' or '1 Hz'.")] = None,
    high: Annotated[str | None, typer.Option(help="Highest frequency.")] = None,
    smooth: Annotated[
        bool,
        typer.Option("--smooth", help="Savitzky-Golay filter over the points before the fit, as the source."),
    ] = False,
    smooth_order: Annotated[int, typer.Option(help="Its order.")] = 11,
    smooth_window: Annotated[int, typer.Option(help="Its window, in points.")] = 25,
    linear: Linear = False,
    mapping: MappingFile = None,
    settings: Settings = None,
    cutoff: Filter = None,
    start: From = None,
    stop: To = None,
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Frequency response with its uncertainty, from stepped sines or by Welch's method, and a fit to it."""
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(
        numbers.frf(
            logs,
            block,
            source,
            target,
            method,
            extremes,
            order,
            delay,
            segment,
            low,
            high,
            smooth,
            smooth_order,
            smooth_window,
            linear,
            mapping,
            settings,
            cutoff,
            start,
            stop,
        ),
        out,
        as_json,
        verbose,
    )


def mechanics(
    log: LogFile,
    mapping: MappingFile = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Number taken as known, such as 'mechanical.r=120 mm'; repeatable."),
    ] = None,
    highest: Annotated[
        str | None,
        typer.Option(
            help="Compare up to this frequency, such as '10 Hz' [default: as far as torque and motion cohere]."
        ),
    ] = None,
    start: From = None,
    stop: To = None,
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Inertia, viscous and dry friction and a constant load from load pressure (or torque) and angle (4.27).

    By inverse dynamics: nothing is simulated to fit, so an answer takes a second. Works on any machine whose mapping
    says which signals are the mechanics' load pressure and angle.
    """
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(numbers.mechanics(log, mapping, settings, highest, start, stop), out, as_json, verbose)


def drive(
    logs: LogFiles,
    mapping: MappingFile = None,
    command: Annotated[
        str | None, typer.Option(help="Signal that commands [default: the machine's input, or u].")
    ] = None,
    motion: Annotated[
        str | None,
        typer.Option(
            help="Angle, position, speed or flow that answers [default: the machine's output, or slew]."
        ),
    ] = None,
    start: From = None,
    stop: To = None,
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Static curve of a drive, speed against command: dead zone, slope and top speed of either side.

    From any log that moves; no experiment and no model is needed. With several logs of the machine the intervals come
    from how much they differ, and hold for the next one.
    """
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(numbers.drive(logs, mapping, command, motion, start, stop), out, as_json, verbose)


def observer(
    log: Annotated[
        Path | None, typer.Argument(help="Log to take the drive from [default: (4.15)].", metavar="LOG")
    ] = None,
    pole: Annotated[
        list[float] | None,
        typer.Option(help="Pole of the observer in 1/s; twice [default: -3 and -1.5 times the drive's]."),
    ] = None,
    mapping: MappingFile = None,
    settings: Settings = None,
    cutoff: Filter = None,
    start: From = None,
    stop: To = None,
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """State space, controllability, observability, root locus, and the observer's gain from its poles."""
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(numbers.observer(log, pole, mapping, settings, cutoff, start, stop), out, as_json, verbose)
