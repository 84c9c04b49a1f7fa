"""The subcommands of ``cosim identify`` that need no log: scaling, linearisation, kalman, experiment."""

from pathlib import Path
from typing import Annotated

import typer

from cosim.options import Verbose

Out = Annotated[
    Path | None, typer.Option("--out", "-o", help="Folder for mapping, picture and JSON.", metavar="DIR")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def scaling(
    log: Annotated[
        Path | None, typer.Argument(help="Log in volts, to write a mapping for.", metavar="LOG")
    ] = None,
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
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Volts to millimetres, bar and degrees (Tables 3.5 and 3.6, (3.2)): a mapping file for a log recorded in volts."""
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(numbers.scaling(log, point, column, disc_radius, time), out, as_json, verbose)


def linearisation(
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
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """The valve's voltage for a command so that the spool's travel is linear and the same on both sides (3.5.5)."""
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(numbers.linearisation(start_a, start_b, point, full), out, as_json, verbose)


def kalman(
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
    out: Out = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Gains of the extended observer: the stationary Kalman filter of slew, velocity, disturbance and sensor error."""
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(
        numbers.kalman(
            disturbance,
            disturbance_time,
            sensor_error,
            sensor_error_time,
            slew_noise,
            pressure_noise,
            tracker_noise,
            tracker_step,
            step_size,
            settings,
        ),
        out,
        as_json,
        verbose,
    )


def markers(
    record: Annotated[
        Path,
        typer.Argument(help="Record of marker positions: time, NAME_x, NAME_y, NAME_z.", metavar="RECORD"),
    ],
    models: Annotated[
        Path, typer.Option(help="Two marker models, .toml or .json; the first counts below 12 deg.")
    ],
    residual: Annotated[str, typer.Option(help="Largest residual of a pose.")] = "1 mm",
    nearest: Annotated[str, typer.Option(help="Shortest distance from the tracker.")] = "0 m",
    farthest: Annotated[str | None, typer.Option(help="Longest distance [default: any].")] = None,
    camera: Annotated[
        str, typer.Option(help="The tracker's place in the frame of the positions, in m: 'x,y,z'.")
    ] = "0,0,0",
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """The slew angle from the tracker's marker positions (3.5.4), as a tracker's record, and the seam of the two models."""
    from cosim.api import numbers
    from cosim.identify.answer import finish

    finish(numbers.markers(record, models, residual, nearest, farthest, camera), out, as_json)


def experiment(
    name: Annotated[str, typer.Argument(help="slew, dcv, ramp or sine.")],
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
    as_json: AsJson = False,
) -> None:
    """Write the command of an experiment, for the crane or for `cosim rig --excitation file`."""
    from cosim import console
    from cosim.api import numbers

    found = numbers.experiment(name, out, amplitude, low, high, count, periods, square)
    if as_json:
        console.emit_json(found)
        return
    output = console.stdout_console()
    travel, length = found["travel"]["value"], found["duration"]["value"]
    for text in (
        f"{name}: {length:.6g} s, about {travel:.3g} deg of slew peak to peak at the nominal gain",
        *(f"written: {file}" for file in found["files"].values()),
    ):
        output.print(text, markup=False, soft_wrap=True)
