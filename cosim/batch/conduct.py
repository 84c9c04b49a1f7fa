"""A batch from the plan to the files: list the runs, do what is not done, write table, cube and picture, sum up."""

import importlib.util
import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from cosim.batch.plan import Plan
from cosim.errors import MissingExtraError, UsageError
from cosim.units import parse_quantity

PACKAGES = ("dask", "distributed", "xarray", "zarr")
MEMORY = "1 GiB"  # of a worker, unless the user says otherwise
Tell = Callable[[str], None]


@dataclass
class Report:
    """What came of a batch.

    Attributes:
        frame: the table of runs.
        about: plain data for ``--json`` and for people.
        missed: a threshold was missed.
        none_done: every run failed.
    """

    frame: pd.DataFrame
    about: dict[str, Any] = field(default_factory=dict)
    missed: bool = False
    none_done: bool = False


def require_extra() -> None:
    """Refuse to begin without the optional dependencies.

    Raises:
        MissingExtraError: one of them is not installed.
    """
    if any(importlib.util.find_spec(name) is None for name in PACKAGES):
        raise MissingExtraError("cosim batch", "batch")


def conduct(
    plan: Plan,
    folder: Path,
    *,
    fresh: bool = False,
    retry_failed: bool = False,
    warn: Tell = lambda text: None,
) -> Report:
    """Do a batch, or what is left of it.

    Args:
        plan: what is asked for.
        folder: where results go.
        fresh: throw away the batch that lies there.
        retry_failed: do failed runs again.
        warn: told what the user should know.

    Raises:
        MissingExtraError: the extra is not installed.
        UsageError, DataError, ModelError: the request or its files are bad.
        SimulationError: there are no workers.
        KeyboardInterrupt: Ctrl-C; what is done stays done.
    """
    require_extra()
    from cosim.batch.cases import plan_batch
    from cosim.batch.store import Store
    from cosim.batch.summary import check_thresholds

    batch = plan_batch(plan, folder)
    check_thresholds(plan.threshold, _mapped_signals(plan))
    for note in batch.notes:
        warn(note)
    store = Store(folder)
    about = {"identity": batch.identity, "plan": plan.model_dump(), "runs": len(batch.runs), "job": batch.job}
    with store.alone():
        store.begin(about, _coordinates(batch), fresh)
        if store.spoilt:
            warn(
                f"{store.spoilt} runs are done again: their signals in {store.path('signals')} are damaged or gone"
            )
        if retry_failed:
            store.forget_failed()
        effort = _do(batch, store, warn)
        frame = store.finish(_columns(batch))
        report = _report(batch, store, frame, warn)
    report.about |= effort
    return report


def _do(batch: Any, store: Any, warn: Tell) -> dict[str, Any]:
    """Do what is not done yet; returns what it took."""
    from cosim.batch.drive import carry_out
    from cosim.console import progress

    known, total = len(store.rows), len(batch.runs)
    left = [run for run in batch.runs if run.number not in store.rows]
    effort: dict[str, Any] = {"runs_before": known, "runs_now": len(left), "seconds": 0.0}
    effort |= {"runs_per_second": None, "workers": 0, "workers_replaced": 0}
    if not left:
        return effort
    crew = _crew(batch.plan, len(left))
    text = f"{batch.job.task}, {total} runs" + (f", {known} done before" if known else "")
    with progress(text, len(left)) as bar:
        try:
            seconds = carry_out(batch.job, left, crew, store, bar)
        except KeyboardInterrupt:
            warn(f"{len(store.rows)} of {total} runs are done and kept: the same command goes on from there")
            raise
    if crew.tight:
        warn("a worker was replaced after its first run: a single one takes more than --worker-memory")
    effort |= {"seconds": seconds, "runs_per_second": len(left) / seconds}
    return effort | {"workers": crew.size, "workers_replaced": crew.retired}


def _mapped_signals(plan: Plan) -> list[str]:
    if not plan.mapping:
        return []
    from cosim.logs.mapping import load_mapping

    return list(load_mapping(Path(plan.mapping)).signals)


def _positive(option: str, text: str, unit: str) -> float:
    """A positive quantity that an option gives."""
    try:
        value = parse_quantity(text, unit)
    except UsageError as error:
        raise UsageError(f"{option}: {error}") from None
    if not value > 0.0:
        raise UsageError(f"{option}: {text} is not positive")
    return value


def _crew(plan: Plan, runs: int) -> Any:
    from cosim.batch.workers import Cluster, Processes

    if plan.scheduler:
        if plan.time_limit:
            raise UsageError("--time-limit ends processes of this machine: a cluster's workers are its own")
        return Cluster(plan.scheduler)
    memory = _positive("--worker-memory", plan.worker_memory or MEMORY, "byte")
    limit = _positive("--time-limit", plan.time_limit, "s") if plan.time_limit else math.inf
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return Processes(min(plan.workers or available, runs), memory, plan.runs_per_worker, limit)


def _columns(batch: Any) -> dict[str, list[Any]]:
    """What is known of every run beforehand, by heading; parameters in the units people read."""
    from cosim.batch.summary import heading

    job, runs = batch.job, batch.runs
    columns: dict[str, list[Any]] = {
        "run": [run.number for run in runs],
        "model": [job.models[run.model].file.label for run in runs],
        "log": [None if run.log is None else job.logs[run.log].label for run in runs],
    }
    for parameter in batch.varied:
        _, factor, offset = parameter.display
        values = [run.parameters[parameter.name] for run in runs]
        if parameter.numeric and (factor, offset) != (1.0, 0.0):
            values = [factor * value + offset for value in values]
        columns[heading(parameter)] = values
    return columns


def _coordinates(batch: Any) -> Any:
    from cosim.batch.coordinates import Coordinates

    job, runs = batch.job, batch.runs
    columns: dict[str, tuple[list[Any], str]] = {
        "run": ([run.number for run in runs], ""),
        "model": ([job.models[run.model].file.label for run in runs], ""),
        "log": (["" if run.log is None else job.logs[run.log].label for run in runs], ""),
    }
    for parameter in batch.varied:
        columns[parameter.name] = ([run.parameters[parameter.name] for run in runs], parameter.unit)
    first = job.models[0].start if job.task == "simulate" else 0.0
    meaning = "time" if job.task == "simulate" else "time since the first sample of the log"
    return Coordinates(columns, job.output_step, first, meaning)


def _report(batch: Any, store: Any, frame: pd.DataFrame, warn: Tell) -> Report:
    from cosim.batch.summary import failures, quantiles, score_columns, sensitivity, thresholds

    columns, failed = score_columns(frame, batch.varied), failures(frame)
    limits = thresholds(frame, batch.plan.threshold) if len(failed) < len(frame) else []
    too_many = batch.plan.most_failed is not None and len(failed) > batch.plan.most_failed
    if failed:
        first = failed[0]
        warn(f"{len(failed)} of {len(frame)} runs failed; the first, run {first['run']}: {first['reason']}")
    picture = _picture(batch, store, frame)
    files = {"runs": store.path("runs"), "journal": store.path("journal")}
    if batch.job.task != "diagnose":
        files["signals"] = store.path("signals")
    if picture is not None:
        files["picture"] = picture
    notes = sorted({note for row in store.rows.values() for note in row["notes"]})
    about: dict[str, Any] = {
        "task": batch.job.task,
        "engine": batch.job.engine,
        "models": [model.file.label for model in batch.job.models],
        "logs": [log.label for log in batch.job.logs],
        "log_files": [log.path for log in batch.job.logs],
        "mapping": batch.job.mapping.path if batch.job.mapping else None,
        "parameters": [{"name": p.name, "unit": p.display[0]} for p in batch.varied],
        "seed": batch.plan.seed if batch.random else None,
        "runs": len(frame),
        "done": int((frame["status"] == "done").sum()),
        "failed": len(failed),
        "failures": failed[:100],
        "scores": quantiles(frame, columns),
        "sensitivity": sensitivity(frame, batch.varied, columns),
        "thresholds": limits,
        "notes": notes[:100],
        "files": files,
    }
    if batch.job.task == "simulate":
        about["label"] = "simulated"
    if batch.job.task == "diagnose":
        about["diagnoses"] = _diagnoses(frame)
    missed = too_many or any(not limit["passed"] for limit in limits)
    return Report(frame, about, missed, none_done=len(failed) == len(frame))


def _diagnoses(frame: pd.DataFrame) -> list[dict[str, Any]]:
    wanted = [c for c in ("verdict", "causes", "unexplained", "diagnosis") if c in frame.columns]
    picked = frame[["log", "model", "status", *wanted]]
    return [
        {str(k): (None if pd.isna(v) else v) for k, v in row.items()} for row in picked.to_dict("records")
    ]


def _picture(batch: Any, store: Any, frame: pd.DataFrame) -> Path | None:
    from cosim.batch.picture import measured_signals, write_picture

    job, measured, cube = batch.job, None, None
    fan = batch.random and len(job.models) == 1 and len(job.logs) < 2
    if fan and job.logs:
        from cosim.logs import load_log

        mapping = job.mapping.path if job.mapping else None
        measured = measured_signals(load_log(job.logs[0].path, mapping))
    if fan:
        import xarray as xr

        cube = xr.open_zarr(store.path("signals"), chunks=None)
    path: Path | None = write_picture(store.path("picture"), job.task, frame, batch.varied, cube, measured)
    return path
