"""``cosim compare``: a model beside a log."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim import console
from cosim.errors import UsageError
from cosim.options import Verbose

if TYPE_CHECKING:
    from cosim.api import ComparisonResult

MISSED = 1


# the options of the command, each a type of its own
ParameterSets = Annotated[
    list[Path] | None,
    typer.Option(help="An .ssv with names such as mechanical.J; repeatable.", metavar="FILE"),
]
Settings = Annotated[
    list[str] | None, typer.Option("--set", help="Such as 'mechanical.J=900 kg.m2'; repeatable.")
]
StepSize = Annotated[str | None, typer.Option(help="Such as '1 ms' [default: the log's own, uniform].")]
Thresholds = Annotated[
    list[str] | None,
    typer.Option(help="Largest RMSE of a signal, such as slew=0.5deg; exit code 1 if missed; repeatable."),
]
Calibrate = Annotated[bool, typer.Option("--calibrate", help="Fit free parameters to the log first.")]
Freed = Annotated[
    list[str] | None,
    typer.Option(help="A free parameter, such as mechanical.J or 'dcv.K=2:3 mm'; repeatable."),
]
Priors = Annotated[
    list[str] | None,
    typer.Option(help="What is known of one beforehand, such as 'dcv.K=2.4+-0.1 mm'; repeatable."),
]
FitTo = Annotated[
    list[str] | None, typer.Option(help="Fit to this signal [default: all measured]; repeatable.")
]
HeldOut = Annotated[
    str | None,
    typer.Option(help="Not fitted but scored: a part of the log's end or another log [default: 0.3]."),
]
Starts = Annotated[int | None, typer.Option(help="Starts of the search [default: 4].")]
WithObserver = Annotated[
    bool, typer.Option("--observer", help="Run the observer's FMU on the log's command and slew.")
]
External = Annotated[
    Path | None,
    typer.Option(help="Record of the external tracker, held against the slew sensor.", metavar="FILE"),
]


def register(app: typer.Typer) -> None:
    """Adds the command ``compare``."""
    app.command()(compare)


def compare(
    log: Annotated[
        Path, typer.Argument(help="The log: .csv, .mat, .parquet, .mf4, .tdms or .xlsx.", metavar="LOG")
    ],
    model: Annotated[
        str | None,
        typer.Option(
            help="simplified, full_order, physical or a file [default: the mapping's or full_order]."
        ),
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="Mapping file (TOML) for a log with other names.", metavar="FILE")
    ] = None,
    parameter_set: ParameterSets = None,
    settings: Settings = None,
    step_size: StepSize = None,
    threshold: Thresholds = None,
    calibrate: Calibrate = False,
    free: Freed = None,
    prior: Priors = None,
    fit_to: FitTo = None,
    held_out: HeldOut = None,
    starts: Starts = None,
    observer: WithObserver = False,
    external: External = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for pictures and series.", metavar="DIR")
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write the series as CSV instead of Parquet.")] = False,
    verbose: Verbose = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
) -> None:
    """Simulate a model on a log's command and show what it gets wrong, per signal and per block.

    A block is driven by what was measured before it, so an error shows where it arises.
    """
    calibration = _calibration(calibrate, free, prior, fit_to, held_out, starts)
    from cosim import api

    found = api.beside(
        log,
        model=model,
        mapping=mapping,
        parameter_sets=parameter_set or [],
        settings=settings or [],
        step_size=step_size,
        thresholds=threshold or [],
        calibration=calibration,
        observer=observer,
        external=external,
        out=Path("calibration") if calibration is not None and out is None else out,
        csv=csv,
    )
    for note in found.comparison.notes:
        console.warn(note)
    if as_json:
        console.emit_json(found.to_dict())
    else:
        given = {"external": external, "mapping": mapping, "model": model}
        show(
            found,
            verbose,
            "".join(
                f" --{name} {console.typed(value)}" for name, value in given.items() if value is not None
            ),
        )
    if not found.passed:
        raise typer.Exit(MISSED)


def _calibration(
    wanted: bool,
    free: list[str] | None,
    prior: list[str] | None,
    fit_to: list[str] | None,
    held_out: str | None,
    starts: int | None,
) -> dict[str, Any] | None:
    """The options of a calibration, or None where none is wanted.

    Raises:
        UsageError: there are options, but no calibration.
    """
    asked = {"free": free, "prior": prior, "fit_to": fit_to, "held_out": held_out, "starts": starts}
    given = {name: value for name, value in asked.items() if value is not None}
    if given and not wanted:
        names = ", ".join("--" + name.replace("_", "-") for name in given)
        raise UsageError(f"{names} belongs to a calibration: add --calibrate")
    return given if wanted else None


def show(found: "ComparisonResult", verbose: bool, options: str = "") -> None:
    """Print the answer; with `verbose` the tables before it; `options` are those that a diagnosis needs too."""
    from cosim.compare.present import above_noise, explanations, tables

    output, comparison = console.stdout_console(), found.comparison

    def say(text: str) -> None:
        output.print(text, markup=False, soft_wrap=True)

    if verbose:
        say(found.beside.headline())
        for table in tables(comparison):
            if table.rows:
                output.print(table)
        for text in explanations(comparison):
            say(text)
        found.beside.extras.show(comparison)
        for text in found.beside.threshold_lines():
            say(text)
    else:
        for text in found.lines():
            say(text)
        found.beside.extras.show_further()
    for file in found.beside.written.values():
        say(f"written: {file}")
    if not verbose and not comparison.signals:
        named = console.typed(comparison.log.source)
        say(f"Next: cosim info {named} shows which of its columns could be the signals that are missing")
    elif not verbose:
        named = f"cosim diagnose {console.typed(comparison.log.source)}{options}"
        use = "names the cause" if above_noise(comparison) else "says what else this log could have shown"
        say(f"Next: {named} {use}; --verbose shows each signal and block")
