"""Identifications as they are asked for by `cosim identify`: files, and numbers with units as texts.

Each function is the command of its name, so its arguments carry what the command's help says of them; all but the log are
given by name. What several of them ask for stands once, in `Part`, `Known` and `Between`.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict, Unpack

import typer

from cosim.options import spelled_out

if TYPE_CHECKING:
    from cosim.identify.answer import Answer
    from cosim.identify.other_machine import Other
    from cosim.identify.run import Channel
    from cosim.logs import Log

LogFile = Annotated[
    Path, typer.Argument(help="The log: .csv, .mat, .parquet, .mf4, .tdms or .xlsx.", metavar="LOG")
]
LogFiles = Annotated[
    list[Path], typer.Argument(help="One log or several, fitted together.", metavar="LOG...")
]


class Part(TypedDict, total=False):
    """How a log is read, and the part of it that is used."""

    mapping: Annotated[
        Path | None, typer.Option(help="Mapping file (TOML) for a log with other names.", metavar="FILE")
    ]
    start: Annotated[
        str | None, typer.Option("--from", help="Use the log from this time on, such as '10 s'.")
    ]
    stop: Annotated[str | None, typer.Option("--to", help="Use the log up to this time.")]


class Known(Part, total=False):
    """What is known beside the log."""

    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Number taken as known, such as 'compensator.d_plus=0'; repeatable."),
    ]
    cutoff: Annotated[
        str | None,
        typer.Option(
            "--filter",
            help="Low-pass on command and response alike (Butterworth, order 2), such as '50 Hz'.",
        ),
    ]


class Between(Known, total=False):
    """From which signal to which."""

    block: Annotated[
        str | None, typer.Option(help="dcv, continuity, mechanical or simplified [default: simplified].")
    ]
    source: Annotated[str | None, typer.Option("--input", help="Input signal, instead of a block.")]
    target: Annotated[str | None, typer.Option("--output", help="Output signal, instead of a block.")]
    linear: Annotated[
        bool,
        typer.Option(
            "--linear", help="Take u as it is, without compensator and dead zone, as the source does."
        ),
    ]


def _read(log: Path, of: Part) -> "Log":
    from cosim.identify.texts import load

    return load(log, of.get("mapping"), of.get("start"), of.get("stop"))


def _all(logs: Iterable[Path], of: Part) -> list["Log"]:
    return [_read(log, of) for log in logs]


def _taken(of: Known, other: "Other | None" = None) -> tuple[dict[str, float], float | None]:
    """The numbers taken as known, and the low-pass [Hz]."""
    from cosim.identify.other_machine import known_beside
    from cosim.identify.texts import quantity

    return known_beside(of.get("settings") or [], other), quantity(of.get("cutoff"), "Hz", "--filter")


def _other(of: Part, logs: list["Log"]) -> "Other | None":
    """The machine of the logs, where it is not the crane."""
    from cosim.api.other import other_of

    return other_of(of.get("mapping"), logs)


def _channel(of: Between, logs: list["Log"], other: "Other | None") -> "Channel":
    from cosim.identify.run import channel, channel_of

    _, cutoff = _taken(of)
    named = of.get("block"), of.get("source"), of.get("target")
    if other is not None and named == (None, None, None):
        return channel_of(other, logs[0], of.get("linear", False), cutoff)
    return channel(*named, of.get("linear", False), cutoff)


@spelled_out
def everything(log: LogFile, **of: Unpack[Known]) -> "Answer":
    """Dead zone, valve, pressure and mechanics from one log, and one .ssv for the model."""
    from cosim.identify.run_design import all_answer

    loaded = _read(log, of)
    other = _other(of, [loaded])
    return all_answer(loaded, *_taken(of, other), other)


@spelled_out
def dead_zone(
    logs: LogFiles,
    *,
    response: Annotated[
        str | None,
        typer.Option(help="spool, p_load or slew, or a machine's motion [default: the first in the log]."),
    ] = None,
    **of: Unpack[Known],
) -> "Answer":
    """Break points and slopes of the valve's dead zone, best from a slow ramp.

    Where the compensator was off, as in the source's own experiment, say so: --set compensator.d_plus=0 --set
    compensator.d_minus=0. Of a machine that a mapping describes: the commands at which it does not move.
    """
    from cosim.api.identifying import dead_zone_of

    _, cutoff = _taken(of)
    return dead_zone_of(_all(logs, of), of.get("mapping"), of.get("settings") or [], response, cutoff)


@spelled_out
def transfer_function(
    logs: LogFiles,
    *,
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
    **of: Unpack[Between],
) -> "Answer":
    """Transfer functions fitted to logs: a table of candidates, and the one to use, by BIC and held-out fit."""
    from cosim.identify.run import transfer_function_answer
    from cosim.identify.texts import structure

    loaded = _all(logs, of)
    other = _other(of, loaded)
    chosen = _channel(of, loaded, other)
    at_zero = chosen.integrators if integrators is None else integrators
    structures = [structure(text, at_zero, delay) for text in order or []]
    known, _ = _taken(of, other)
    return transfer_function_answer(loaded, chosen, structures, known, other)


@spelled_out
def frf(
    logs: LogFiles,
    *,
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
    **of: Unpack[Between],
) -> "Answer":
    """Frequency response with its uncertainty, from stepped sines or by Welch's method, and a fit to it."""
    from cosim.identify.run_frf import FrfRequest, frf_answer
    from cosim.identify.texts import angular, quantity, structure

    loaded = _all(logs, of)
    other = _other(of, loaded)
    chosen = _channel(of, loaded, other)
    wanted = FrfRequest(
        method=method,
        amplitude="extremes" if extremes else "least squares",
        structure=None if order is None else structure(order, chosen.integrators, delay),
        segment=quantity(segment, "s", "--segment"),
        low=0.0 if low is None else angular(low, "--low"),
        high=float("inf") if high is None else angular(high, "--high"),
        smooth=(smooth_order, smooth_window) if smooth else None,
    )
    known, _ = _taken(of, other)
    return frf_answer(loaded, chosen, known, wanted, other)


@spelled_out
def mechanics(
    log: LogFile,
    *,
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
    **of: Unpack[Part],
) -> "Answer":
    """Inertia, viscous and dry friction and a constant load from load pressure (or torque) and angle (4.27).

    By inverse dynamics: nothing is simulated to fit, so an answer takes a second. Works on any machine whose mapping
    says which signals are the mechanics' load pressure and angle.
    """
    from cosim.diagnosis.model.choice import machine_of
    from cosim.identify.run_mechanics import mechanics_answer
    from cosim.identify.texts import quantity

    loaded = _read(log, of)
    machine = machine_of(None, loaded, of.get("mapping"))
    return mechanics_answer(loaded, machine, settings or [], quantity(highest, "Hz", "--highest"))


@spelled_out
def drive(
    logs: LogFiles,
    *,
    command: Annotated[
        str | None, typer.Option(help="Signal that commands [default: the machine's input, or u].")
    ] = None,
    motion: Annotated[
        str | None,
        typer.Option(
            help="Angle, position, speed or flow that answers [default: the machine's output, or slew]."
        ),
    ] = None,
    **of: Unpack[Part],
) -> "Answer":
    """Static curve of a drive, speed against command: dead zone, slope and top speed of either side.

    From any log that moves; no experiment and no model is needed. With several logs of the machine the intervals come
    from how much they differ, and hold for the next one.
    """
    from cosim.identify.run_drive import drive_answer
    from cosim.logs import load_mapping

    mapping = of.get("mapping")
    plain = load_mapping(mapping) if mapping is not None else None
    return drive_answer(_all(logs, of), plain, command, motion)


@spelled_out
def observer(
    log: Annotated[
        Path | None, typer.Argument(help="Log to take the drive from [default: (4.15)].", metavar="LOG")
    ] = None,
    *,
    pole: Annotated[
        list[float] | None,
        typer.Option(help="Pole of the observer in 1/s; twice [default: -3 and -1.5 times the drive's]."),
    ] = None,
    **of: Unpack[Known],
) -> "Answer":
    """State space, controllability, observability, root locus, and the observer's gain from its poles."""
    from cosim.identify.run_design import observer_answer

    loaded = None if log is None else _read(log, of)
    other = None if loaded is None else _other(of, [loaded])
    known, cutoff = _taken(of, other)
    return observer_answer(loaded, known, pole or [], cutoff, other)


def scaling(
    log: Annotated[
        Path | None, typer.Argument(help="Log in volts, to write a mapping for.", metavar="LOG")
    ] = None,
    *,
    point: Annotated[
        list[str] | None,
        typer.Option(help="Measured point, such as 'spool=3.248 V:2.6 mm'; two or more a signal."),
    ] = None,
    column: Annotated[
        list[str] | None, typer.Option(help="Column of a signal, such as spool='Ch 3'; repeatable.")
    ] = None,
    disc_radius: Annotated[
        str | None, typer.Option(help="Of the slew sensor's disc, such as '200 mm'.")
    ] = None,
    time: Annotated[str, typer.Option(help="Column of the time, in seconds.")] = "time",
) -> "Answer":
    """Volts to millimetres, bar and degrees (Tables 3.5 and 3.6, (3.2)): a mapping file for a log recorded in volts."""
    from cosim.identify.run_design import scaling_answer
    from cosim.identify.texts import quantity

    radius = quantity(disc_radius, "m", "--disc-radius")
    return scaling_answer(log, point or [], column or [], radius, time)


def linearisation(
    *,
    start_a: Annotated[str, typer.Option(help="Voltage at which the spool starts towards A.")] = "0.15 V",
    start_b: Annotated[str, typer.Option(help="The same towards B.")] = "-0.24 V",
    point: Annotated[
        list[str] | None,
        typer.Option(
            help="Measured point, such as '6.0 V:3.0275 mm'; one or more a side "
            "[default: Table 3.5, 6.0 V:3.0275 mm and -6.0 V:-2.6880 mm]."
        ),
    ] = None,
    full: Annotated[
        str, typer.Option(help="Voltage of full command, and the travel it is to give on either side.")
    ] = "3 V:2.6 mm",
) -> "Answer":
    """The valve's voltage for a command so that the spool's travel is linear and the same on both sides (3.5.5)."""
    from cosim.identify.linearisation import linearisation_answer

    return linearisation_answer((start_a, start_b), point or [], full)


def kalman(
    *,
    disturbance: Annotated[
        str, typer.Option(help="Standard deviation of the torque that the model lacks; 0: none.")
    ] = "100 N.m",
    disturbance_time: Annotated[str, typer.Option(help="Its correlation time.")] = "1 s",
    sensor_error: Annotated[
        str, typer.Option(help="Standard deviation of the slew sensor's slow error; needs --tracker-noise.")
    ] = "0 deg",
    sensor_error_time: Annotated[str, typer.Option(help="Its correlation time.")] = "10 s",
    slew_noise: Annotated[str, typer.Option(help="Of a sample of the slew sensor.")] = "0.01 deg",
    pressure_noise: Annotated[
        str, typer.Option(help="Of a sample of the load pressure; 0: it comes from the model.")
    ] = "0.1414 bar",
    tracker_noise: Annotated[str, typer.Option(help="Of a reading of the tracker; 0: none.")] = "0 deg",
    tracker_step: Annotated[str, typer.Option(help="Between two readings of the tracker.")] = "12.5 ms",
    step_size: Annotated[str, typer.Option(help="Between two samples.")] = "1 ms",
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="Such as 'mechanical.J=900 kg.m2'; repeatable.")
    ] = None,
) -> "Answer":
    """Gains of the extended observer: the stationary Kalman filter of slew, velocity, disturbance and sensor error."""
    from cosim.identify.kalman import Noises
    from cosim.identify.nominal import nominal
    from cosim.identify.run_kalman import kalman_answer
    from cosim.units import parse_quantity

    noises = Noises(
        slew=parse_quantity(slew_noise, "rad"),
        p_load=parse_quantity(pressure_noise, "Pa"),
        disturbance=parse_quantity(disturbance, "N.m"),
        T_tau=parse_quantity(disturbance_time, "s"),
        sensor_error=parse_quantity(sensor_error, "rad"),
        T_beta=parse_quantity(sensor_error_time, "s"),
        tracker=parse_quantity(tracker_noise, "rad"),
        tracker_step=parse_quantity(tracker_step, "s"),
        step=parse_quantity(step_size, "s"),
    )
    return kalman_answer(nominal(settings or []), noises)


def markers(
    record: Annotated[
        Path,
        typer.Argument(help="Record of marker positions: time, NAME_x, NAME_y, NAME_z.", metavar="RECORD"),
    ],
    *,
    models: Annotated[
        Path, typer.Option(help="Two marker models, .toml or .json; the first counts below 12 deg.")
    ],
    residual: Annotated[str, typer.Option(help="Largest residual of a pose.")] = "1 mm",
    nearest: Annotated[str, typer.Option(help="Shortest distance from the tracker.")] = "0 m",
    farthest: Annotated[str | None, typer.Option(help="Longest distance [default: any].")] = None,
    camera: Annotated[
        str, typer.Option(help="The tracker's place in the frame of the positions, in m: 'x,y,z'.")
    ] = "0,0,0",
) -> "Answer":
    """The slew angle from the tracker's marker positions (3.5.4), as a tracker's record, and the seam of the two models."""
    from cosim.errors import UsageError
    from cosim.identify.markers import markers_answer
    from cosim.markers import Limits
    from cosim.units import parse_quantity

    try:
        x, y, z = (float(part) for part in camera.split(","))
    except ValueError:
        raise UsageError(f"--camera '{camera}' should read x,y,z in m, such as '5,0,1.5'") from None
    far = float("inf") if farthest is None else parse_quantity(farthest, "m")
    limits = Limits(parse_quantity(residual, "m"), parse_quantity(nearest, "m"), far, (x, y, z))
    return markers_answer(record, models, limits)


def experiment(
    name: Annotated[str, typer.Argument(help="slew, dcv, ramp or sine.")],
    *,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="CSV to write: the command u, one value a millisecond.")
    ],
    amplitude: Annotated[
        list[float] | None,
        typer.Option(help="Of full command; repeatable [default: the source's; sine: 0.75]."),
    ] = None,
    low: Annotated[str | None, typer.Option(help="sine: lowest frequency, such as '0.5 rad/s'.")] = None,
    high: Annotated[str | None, typer.Option(help="sine: highest frequency.")] = None,
    count: Annotated[int, typer.Option(help="sine: number of frequencies.")] = 40,
    periods: Annotated[int, typer.Option(help="ramp: number of periods.")] = 2,
    square: Annotated[bool, typer.Option("--square", help="Square waves in place of sines.")] = False,
) -> dict[str, Any]:
    """Write the command of an experiment, for the crane or for `cosim rig --excitation file`."""
    from cosim.errors import UsageError
    from cosim.identify.experiment import write_experiment
    from cosim.identify.run_design import experiment_of
    from cosim.identify.texts import angular

    if out.suffix.lower() != ".csv":
        raise UsageError(f"{out}: a command is written as .csv")
    band = None if low is None or high is None else (angular(low, "--low"), angular(high, "--high"), count)
    made = experiment_of(name, amplitude or [], band, periods, square)
    plan = write_experiment(made, out)
    return {"identify": "experiment", "experiment": name, "duration": {"value": made.duration, "unit": "s"},
            "travel": {"value": made.travel, "unit": "deg"}, "files": {"csv": str(out), "plan": str(plan)}}  # fmt: skip
