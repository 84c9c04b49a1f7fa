"""``cosim batch``: many runs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim import console
from cosim.options import Verbose

if TYPE_CHECKING:
    from cosim.batch.conduct import Report

MISSED = 1
SHOWN = 12  # lines of a table on the terminal

Logs = Annotated[list[str] | None, typer.Argument(help="Logs, folders of logs, or patterns.", metavar="LOG")]
PlanFile = Annotated[
    Path | None, typer.Option(help="The batch as a TOML file; options change it.", metavar="FILE")
]
Models = Annotated[
    list[str] | None, typer.Option(help="Name or file of a model; repeatable [default: full_order].")
]
Diagnose = Annotated[bool, typer.Option("--diagnose", help="Diagnose every log, instead of comparing.")]
Sweep = Annotated[
    list[str] | None,
    typer.Option(help="Such as 'mechanical.J=700:900:5 kg.m2' or '...=700,800 kg.m2'; repeatable."),
]
Vary = Annotated[
    list[str] | None,
    typer.Option(
        help="Draw: '...=764 +- 40 kg.m2' or '...=764 [730, 800] kg.m2' (95 %), '...=700:900 kg.m2' (uniform)."
    ),
]
From = Annotated[
    Path | None,
    typer.Option(
        "--from", help="diagnosis.json, calibration.json or .ssv: vary its 95 % intervals.", metavar="FILE"
    ),
]
DesignOption = Annotated[
    str | None,
    typer.Option(help="grid, zip, latin_hypercube, sobol or random [default: grid; draws: random]."),
]
Samples = Annotated[int | None, typer.Option(help="How many draws [default: 200].")]
Seed = Annotated[int | None, typer.Option(help="Of the draws [default: 1].")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="For every run, such as 'mechanical.J=900 kg.m2'; repeatable."),
]
ParameterSets = Annotated[
    list[Path] | None, typer.Option(help="An .ssv for every run; repeatable.", metavar="FILE")
]
Played = Annotated[
    Path | None, typer.Option("--input", help="Log or CSV that drives the models.", metavar="FILE")
]
MappingFile = Annotated[Path | None, typer.Option(help="Mapping file (TOML) of the logs.", metavar="FILE")]
External = Annotated[
    str | None, typer.Option(help="A tracker's file is named as its log, with this behind, such as _tracker.")
]
Record = Annotated[list[str] | None, typer.Option(help="Signal to keep; repeatable [default: all].")]
StopTime = Annotated[str | None, typer.Option(help="Such as '10 s' [default: the model's own].")]
StepSize = Annotated[str | None, typer.Option(help="Such as '1 ms' [default: the model's or the log's own].")]
OutputStep = Annotated[str | None, typer.Option(help="Interval at which signals are kept [default: 10 ms].")]
EngineOption = Annotated[
    str | None,
    typer.Option(help="fmu, or compiled: models of our blocks, the same numbers, faster [default: fmu]."),
]
Tolerance = Annotated[float | None, typer.Option(help="Of a diagnosis [default: 0.01].")]
Calibrate = Annotated[bool, typer.Option("--calibrate", help="Of a diagnosis.")]
Threshold = Annotated[
    list[str] | None,
    typer.Option(help="Largest RMSE against a log, such as slew=0.5deg; exit code 1 if missed."),
]
MostFailed = Annotated[int | None, typer.Option(help="How many runs may fail; exit code 1 if more do.")]
Workers = Annotated[int | None, typer.Option(help="Processes [default: one a core].")]
RunsPerWorker = Annotated[int | None, typer.Option(help="Replace a process after so many runs.")]
WorkerMemory = Annotated[
    str | None, typer.Option(help="Replace a process before it is larger [default: 1 GiB].")
]
TimeLimit = Annotated[
    str | None, typer.Option(help="A run that takes longer is ended and counts as failed, such as '5 min'.")
]
Scheduler = Annotated[str | None, typer.Option(help="Dask cluster to use, such as tcp://host:8786.")]
Out = Annotated[
    Path, typer.Option("--out", "-o", help="Folder; a batch that lies there goes on.", metavar="DIR")
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Throw away the batch in the folder.")]
RetryFailed = Annotated[bool, typer.Option("--retry-failed", help="Do failed runs again.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def register(app: typer.Typer) -> None:
    """Adds the command ``batch``."""
    app.command()(batch)


def batch(
    logs: Logs = None,
    plan: PlanFile = None,
    model: Models = None,
    diagnose: Diagnose = False,
    sweep: Sweep = None,
    vary: Vary = None,
    from_file: From = None,
    design: DesignOption = None,
    samples: Samples = None,
    seed: Seed = None,
    settings: Settings = None,
    parameter_set: ParameterSets = None,
    played: Played = None,
    mapping: MappingFile = None,
    external: External = None,
    record: Record = None,
    stop_time: StopTime = None,
    step_size: StepSize = None,
    output_step: OutputStep = None,
    engine: EngineOption = None,
    tolerance: Tolerance = None,
    calibrate: Calibrate = False,
    threshold: Threshold = None,
    most_failed: MostFailed = None,
    workers: Workers = None,
    time_limit: TimeLimit = None,
    runs_per_worker: RunsPerWorker = None,
    worker_memory: WorkerMemory = None,
    scheduler: Scheduler = None,
    out: Out = Path("batch"),
    fresh: Fresh = False,
    retry_failed: RetryFailed = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Run many simulations, comparisons or diagnoses; interrupted, the same command goes on where it stopped.

    Parameters are swept or drawn; with logs, every run is compared with every log, or every log is diagnosed.
    """
    options = {
        key: value
        for key, value in locals().items()
        if key not in ("plan", "out", "fresh", "retry_failed", "verbose", "as_json")
    }
    run_batch(plan, options, out, fresh, retry_failed, as_json, verbose)


def run_batch(
    plan: Path | None,
    options: dict[str, Any],
    out: Path,
    fresh: bool,
    retry_failed: bool,
    as_json: bool,
    verbose: bool = False,
) -> None:
    """Do what the command does, with the options by the names of its arguments.

    Raises:
        CosimError: whatever is wrong; typer.Exit with 1 where a threshold is missed.
    """
    from cosim import api
    from cosim.batch.conduct import require_extra
    from cosim.errors import SimulationError

    require_extra()
    report = api.batch(asked(plan, options), out, fresh=fresh, retry_failed=retry_failed).report
    if as_json:
        console.emit_json(report.about)
    else:
        _show(report, verbose)
    if report.none_done:
        first = report.about["failures"][0]
        raise SimulationError(f"no run was done; run {first['run']}: {first['reason']}")
    if report.missed:
        raise typer.Exit(MISSED)


def asked(plan: Path | None, options: dict[str, Any]) -> Any:
    """The plan that file and options make together.

    Raises:
        DataError: the file is bad.
        UsageError: an option is.
    """
    from cosim.batch.plan import Plan, load_plan, with_options
    from cosim.batch.values import split_setting

    given = dict(options)
    examples = {
        "sweep": "mechanical.J=700:900:5 kg.m2",
        "vary": "mechanical.J=764 +- 40 kg.m2",
        "settings": "mechanical.J=900 kg.m2",
        "threshold": "slew=0.5deg",
    }
    for key, example in examples.items():
        texts = given.pop(key) or []
        option = "--set" if key == "settings" else f"--{key}"
        pairs = [split_setting(text, option, example) for text in texts]
        given["set" if key == "settings" else key] = dict(pairs)
    given["input"] = given.pop("played")
    if given.pop("diagnose"):
        given["task"] = "diagnose"
    given["calibrate"] = given["calibrate"] or None
    for key in ("input", "mapping", "from_file"):
        given[key] = str(given[key]) if given[key] is not None else None
    given["parameter_set"] = tuple(str(path) for path in given["parameter_set"] or ())
    for key in ("logs", "model", "record"):
        given[key] = tuple(given[key] or ())
    return with_options(load_plan(plan) if plan is not None else Plan(), given)


def _show(report: "Report", verbose: bool) -> None:
    from cosim.batch.screen import lines

    if verbose:
        about = report.about
        if "diagnoses" in about:
            rows = [
                [r["log"], r.get("verdict") or r["status"], r.get("causes") or ""] for r in about["diagnoses"]
            ]
            console.stdout_console().print(console.table("Diagnoses", ["log", "verdict", "causes"], rows))
        else:
            _show_scores(about)
    for text in lines(report):
        console.stdout_console().print(text, markup=False, soft_wrap=True)


def _show_scores(about: dict[str, Any]) -> None:
    from cosim.batch.screen import strongest, telling

    output, scores = console.stdout_console(), about["scores"]
    names = telling(about)
    rows = [[n, scores[n]["min"], scores[n]["q50"], scores[n]["max"]] for n in names[:SHOWN]]
    more = (
        f" ({len(scores) - len(rows)} more in {about['files']['runs'].name})"
        if len(scores) > len(rows)
        else ""
    )
    output.print(console.table(f"Scores over all runs{more}", ["score", "min", "median", "max"], rows))
    rows = [[name, parameter, rank] for name, parameter, rank in strongest(about, names)[:SHOWN]]
    if rows:
        output.print(
            console.table("Strongest rank correlations", ["score", "parameter", "rank correlation"], rows)
        )
