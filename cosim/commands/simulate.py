"""``cosim simulate``: run a system or FMU."""

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim import console

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cosim.master import Limits
    from cosim.results import Result

ROUNDING = 1e-12  # of a signal's range, below which a number is a rest of rounding

Model = Annotated[
    str, typer.Argument(help="An .ssp or .fmu file, a machine (.toml), or simplified, full_order, physical.")
]
StopTime = Annotated[
    str | None, typer.Option(help="Such as '10 s' [default: end of the input, the model's own, or 10 s].")
]
StepSize = Annotated[str | None, typer.Option(help="Such as '1 ms' [default: the model's own, or 1 ms].")]
StartTime = Annotated[
    str | None, typer.Option(help="Such as '2 s' [default: start of the input, the model's own, or 0].")
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="For the FMUs' own step-size control, such as 1e-6 [default: that of their default experiments].",
        min=1e-15,
        max=1.0,
    ),
]
Settings = Annotated[
    list[str] | None, typer.Option("--set", help="Such as 'mechanical.J=900 kg.m2'; repeatable.")
]
ParameterSets = Annotated[
    list[Path] | None,
    typer.Option(help="An .ssv with names such as mechanical.J; repeatable, before --set.", metavar="FILE"),
]
Played = Annotated[
    Path | None, typer.Option("--input", help="Log or CSV with the system's inputs.", metavar="FILE")
]
MappingFile = Annotated[
    Path | None, typer.Option(help="Mapping file (TOML) for an input log with other names.", metavar="FILE")
]
Record = Annotated[
    list[str] | None,
    typer.Option(help="Signal to keep, such as mechanical.theta; repeatable [default: all]."),
]
Estimate = Annotated[
    bool, typer.Option("--estimate-error", help="Estimate the error of the step size, by two finer runs.")
]
Out = Annotated[Path | None, typer.Option("--out", "-o", help="Write .csv, .parquet or .mat.")]
Si = Annotated[bool, typer.Option("--si", help="Write SI units instead of those people read.")]
PartialStep = Annotated[
    bool, typer.Option("--partial-step", help="Let the last step be shorter, to end at the stop time.")
]
Native = Annotated[
    bool, typer.Option("--native", help="Run C twins of our FMUs, many times as fast; needs a C compiler.")
]
Stall = Annotated[
    str | None,
    typer.Option(
        help="Longest time for one call of an FMU that is not ours, such as '5 min' [default: COSIM_STALL or 60 s]."
    ),
]
Memory = Annotated[
    str | None,
    typer.Option(
        help="Memory for FMUs that are not ours, such as '8 GiB' [default: COSIM_MEMORY in MiB, or 4 GiB]."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def register(app: typer.Typer) -> None:
    """Adds the command ``simulate``."""
    app.command()(simulate)


def simulate(
    model: Model,
    stop_time: StopTime = None,
    step_size: StepSize = None,
    settings: Settings = None,
    parameter_set: ParameterSets = None,
    played: Played = None,
    mapping: MappingFile = None,
    record: Record = None,
    estimate_error: Estimate = False,
    out: Out = None,
    si: Si = False,
    partial_step: PartialStep = False,
    native: Native = False,
    start_time: StartTime = None,
    tolerance: Tolerance = None,
    stall: Stall = None,
    memory: Memory = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a system of FMUs: components in wiring order, each step with the values its sources just computed."""
    from cosim import api
    from cosim.request import seconds
    from cosim.results import check_suffix

    if out is not None:
        check_suffix(out, [Path(model), *([played] if played is not None else [])])
    with _leaving(out, si, as_json):
        result = api.simulate(
            model,
            None if stop_time is None else seconds(stop_time, "--stop-time"),
            None if step_size is None else seconds(step_size, "--step-size"),
            parameters=settings,
            parameter_sets=parameter_set or [],
            inputs=played,
            mapping=mapping,
            record=record,
            estimate_error=estimate_error,
            partial_step=partial_step,
            native=native,
            limits=_limits(stall, memory),
            start_time=None if start_time is None else seconds(start_time, "--start-time"),
            tolerance=tolerance,
        )
    for note in [*result.notes, *result.messages]:
        console.warn(note)
    if out is not None:
        result.write(out, display=not si)
    _show(result, out, si, as_json)


def _limits(stall: str | None, memory: str | None) -> "Limits":
    """Limits of FMUs that are not ours.

    Raises:
        UsageError: one is no time or no size, or makes no sense.
    """
    import re
    from dataclasses import replace

    from cosim.errors import UsageError
    from cosim.master import Limits
    from cosim.request import seconds

    limits = Limits.usual()
    if stall is not None:
        limits = replace(limits, stall=seconds(stall, "--stall"))
    if memory is not None:
        found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([MG])i?B\s*", memory)
        if found is None:
            raise UsageError(f"--memory '{memory}' is no size: write it like '500 MiB' or '8 GiB'")
        limits = replace(limits, memory=float(found[1]) * (1024.0 if found[2] == "G" else 1.0))
    return limits


@contextmanager
def _leaving(out: Path | None, si: bool, as_json: bool) -> "Iterator[None]":
    """Write what a simulation reached that fails, under a name that no complete result has."""
    from cosim.errors import SimulationError

    try:
        yield
    except SimulationError as error:
        partial, written = error.partial, None
        if partial is None:
            raise
        if out is not None:
            written = partial.write(out.with_name(f"{out.stem}.partial{out.suffix}"), display=not si)
            console.warn(f"incomplete, up to t = {partial.time[-1]:.9g} s, written: {written}")
        if as_json:
            facts = {
                "complete": False,
                "start_time": partial.time[0],
                "stop_time": partial.time[-1],
                "steps": len(partial.time) - 1,
                "path": written,
            }
            console.emit_json({"error": str(error), "exit_code": error.exit_code, "partial": facts})
        raise


def _show(result: "Result", out: Path | None, si: bool, as_json: bool) -> None:
    from cosim.api.simulating import swing, tracking

    about = result.about(si)
    follows = tracking(result)
    swings, reason = swing(result)
    if as_json:
        told = {} if follows is None else {"tracking": follows, "swing": swings}
        console.emit_json({**about, **told, "path": out})
        return
    output = console.stdout_console()
    rows = [{"signal": name, **_without_rests(row)} for name, row in about["signals"].items()]
    output.print(
        result.lines()[0], markup=False, soft_wrap=True
    )  # a title would be as narrow as a short table
    if rows:
        output.print(console.table("", list(rows[0]), [list(row.values()) for row in rows]))
    else:
        output.print("No output to show: name variables with --record.", markup=False)
    if follows is not None:
        output.print(
            f"tracking: error {follows['rmse']:.3g} deg rms, {follows['largest']:.3g} deg at most,"
            f" {follows['lag']:.3g} s late",
            soft_wrap=True,
        )
    if swings is not None:
        output.print(
            f"swings by itself while the reference stands: by {swings['angle']:.3g} deg, every {swings['period']:.3g} s,"
            f" with commands up to {100.0 * swings['command']:.3g} %; {reason}",
            markup=False,
            soft_wrap=True,
        )
    if out is not None:
        output.print(f"written: {out}", markup=False, soft_wrap=True)
    else:
        output.print(
            "Next: the same with --out run.csv writes the signals over time", markup=False, soft_wrap=True
        )


def _without_rests(row: dict[str, Any]) -> dict[str, Any]:
    """A signal's numbers for a table: 0 where one is no more than what rounding leaves of the signal's range."""
    numbers = {key: value for key, value in row.items() if isinstance(value, float)}
    rest = ROUNDING * max(map(abs, numbers.values()), default=0.0)
    return row | {key: 0.0 for key, value in numbers.items() if abs(value) < rest}
