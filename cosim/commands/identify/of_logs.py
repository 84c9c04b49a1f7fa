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
    from cosim.identify.answer import finish
    from cosim.identify.nominal import nominal
    from cosim.identify.run_design import all_answer
    from cosim.identify.texts import load, quantity

    known = nominal(settings or [])
    answer = all_answer(load(log, mapping, start, stop), known, quantity(cutoff, "Hz", "--filter"))
    finish(answer, out, as_json, verbose)


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
    from cosim.errors import UsageError
    from cosim.identify.answer import finish
    from cosim.identify.dead_zone import RESPONSES
    from cosim.identify.nominal import nominal
    from cosim.identify.run import dead_zone_answer
    from cosim.identify.texts import load, quantity

    if response is not None and response not in RESPONSES:
        raise UsageError(f"--response '{response}': choose {', '.join(RESPONSES)}")
    known = nominal(settings or [])
    loaded = load(log, mapping, start, stop)
    finish(
        dead_zone_answer(loaded, known, response, quantity(cutoff, "Hz", "--filter")), out, as_json, verbose
    )


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
    from cosim.identify.answer import finish
    from cosim.identify.nominal import nominal
    from cosim.identify.run import channel, transfer_function_answer
    from cosim.identify.texts import load, quantity, structure

    chosen = channel(block, source, target, linear, quantity(cutoff, "Hz", "--filter"))
    at_zero = chosen.integrators if integrators is None else integrators
    structures = [structure(text, at_zero, delay) for text in order or []]
    known = nominal(settings or [])
    loaded = [load(log, mapping, start, stop) for log in logs]
    finish(transfer_function_answer(loaded, chosen, structures, known), out, as_json, verbose)


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
    from cosim.identify.answer import finish
    from cosim.identify.nominal import nominal
    from cosim.identify.run import channel
    from cosim.identify.run_frf import FrfRequest, frf_answer
    from cosim.identify.texts import angular, load, quantity, structure

    chosen = channel(block, source, target, linear, quantity(cutoff, "Hz", "--filter"))
    wanted = FrfRequest(
        method=method,
        amplitude="extremes" if extremes else "least squares",
        structure=None if order is None else structure(order, chosen.integrators, delay),
        segment=quantity(segment, "s", "--segment"),
        low=0.0 if low is None else angular(low, "--low"),
        high=float("inf") if high is None else angular(high, "--high"),
        smooth=(smooth_order, smooth_window) if smooth else None,
    )
    known = nominal(settings or [])
    loaded = [load(log, mapping, start, stop) for log in logs]
    finish(frf_answer(loaded, chosen, known, wanted), out, as_json, verbose)


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
    from cosim.diagnosis.model.choice import machine_of
    from cosim.identify.answer import finish
    from cosim.identify.run_mechanics import mechanics_answer
    from cosim.identify.texts import load, quantity

    loaded = load(log, mapping, start, stop)
    machine = machine_of(None, loaded, mapping)
    finish(
        mechanics_answer(loaded, machine, settings or [], quantity(highest, "Hz", "--highest")),
        out,
        as_json,
        verbose,
    )


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
    from cosim.identify.answer import finish
    from cosim.identify.run_drive import drive_answer
    from cosim.identify.texts import load
    from cosim.logs import load_mapping

    plain = load_mapping(mapping) if mapping is not None else None
    loaded = [load(log, mapping, start, stop) for log in logs]
    finish(drive_answer(loaded, plain, command, motion), out, as_json, verbose)


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
    from cosim.identify.answer import finish
    from cosim.identify.nominal import nominal
    from cosim.identify.run_design import observer_answer
    from cosim.identify.texts import load, quantity

    known = nominal(settings or [])
    loaded = None if log is None else load(log, mapping, start, stop)
    finish(
        observer_answer(loaded, known, pole or [], quantity(cutoff, "Hz", "--filter")), out, as_json, verbose
    )
