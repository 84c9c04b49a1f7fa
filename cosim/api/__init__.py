"""The Python interface: nine functions, which the command line calls as well. Import them from `cosim`.

Files may be named by text or path, numbers given as they are (SI, or the FMU's unit) or with a unit (``"900 kg.m2"``). A
`progress` function is told what is going on and the share that is done. Ctrl-C goes on as a KeyboardInterrupt; what was
done until then lies in the folder of results, and of a diagnosis in the exception's attribute ``result`` as well.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.api.results import (
    BatchResult,
    ComparisonResult,
    DiagnosisResult,
    IdentificationResult,
    Outcome,
    Scratch,
)
from cosim.console import Heard, heard_by

if TYPE_CHECKING:
    from cosim.gate.found import GateResult
    from cosim.logs import Log, Tracker
    from cosim.master import Limits
    from cosim.results import Result
    from cosim.ssp.system import System

__all__ = [
    "BatchResult",
    "ComparisonResult",
    "DiagnosisResult",
    "IdentificationResult",
    "Outcome",
    "batch",
    "beside",
    "calibrate",
    "check",
    "compare",
    "diagnose",
    "identify",
    "make_log",
    "read_log",
    "read_system",
    "simulate",
]

File = str | Path
Number = float | str
"""A number in SI (of a parameter: in the FMU's unit), or a text with a unit such as ``"10 ms"``."""


def read_log(path: File, mapping: File | None = None, *, signals: Sequence[str] | None = None) -> "Log":
    """Read measured data: CSV (also compressed), .mat, Parquet, MDF4, TDMS or Excel.

    Args:
        path: the file.
        mapping: mapping file, for columns of other names; ``cosim init LOG`` writes one.
        signals: read only these.

    Returns:
        Signals in SI by name (``log["slew"]``) over ``log.time``; what was repaired is in ``log.warnings``.

    Raises:
        DataError: the file or mapping is bad; the message names file, row and column.
        MissingExtraError: its type needs an optional dependency.
    """
    from cosim.logs import load_log

    return load_log(path, mapping, select=signals)


def read_system(model: File) -> "System":
    """Read a system.

    Args:
        model: a package (.ssp), an FMU, a wiring of our blocks (.ssd), or full_order, simplified, physical.

    Returns:
        Components, wires and parameters. Close it, or use it in a ``with`` block: its FMUs are unpacked meanwhile.

    Raises:
        ModelError, UsageError: there is no such model, or it is bad.
    """
    from cosim.compare.model import open_model
    from cosim.ssp.read import read_system as read

    return read(open_model(str(model)))


def make_log(
    excitation: str = "mixed",
    duration: Number = 60.0,
    hide: Sequence[str] = (),
    *,
    seed: int = 1,
    **options: Any,
) -> "Log":
    """Make a synthetic log of the crane by the virtual rig, with anything hidden in it.

    Args:
        excitation: mixed, sweep, steps, small_steps, triangle, multisine or chirp.
        duration: [s].
        hide: effects, such as ``"mechanical.coulomb_friction:tau_c=300 N.m"``.
        seed: the same seed gives the same log.
        options: further attributes of `cosim.rig.Recipe`.

    Raises:
        UsageError: a name, number or combination that makes no sense.
    """
    from cosim.rig import as_log
    from cosim.rig import make_log as make

    return as_log(make(excitation, _seconds(duration), hide, seed=seed, **options))


def simulate(
    model: File,
    stop_time: Number | None = None,
    step_size: Number | None = None,
    *,
    parameters: Mapping[str, Number] | Sequence[str] | None = None,
    parameter_sets: Sequence[File] = (),
    inputs: "File | Log | None" = None,
    mapping: File | None = None,
    record: Sequence[str] | None = None,
    estimate_error: bool = False,
    partial_step: bool = False,
    native: bool = False,
    limits: "Limits | None" = None,
    start_time: Number | None = None,
    tolerance: float | None = None,
    progress: Heard | None = None,
) -> "Result":
    """Simulate a system of FMUs.

    Args:
        model: an .ssp, .fmu or machine (.toml), or simplified, full_order, physical.
        stop_time: [s]; by default the end of the inputs, the model's own, or 10 s.
        step_size: [s]; by default the model's own, or 1 ms.
        parameters: such as ``{"mechanical.J": "900 kg.m2"}``.
        parameter_sets: .ssv files, weaker than `parameters`.
        inputs: log, or table file with the system's inputs.
        mapping: mapping file of an input log.
        record: signals to keep; by default all.
        estimate_error: estimate the error of the step size by two finer runs.
        partial_step: let the last step be shorter, to end at the stop time.
        native: run C twins of our FMUs.
        limits: of time and memory, for FMUs that are not ours.
        start_time: [s]; by default that of the inputs, the model's own, or 0.
        tolerance: for the FMUs' own step-size control; by default that of their default experiments.
        progress: told what is going on, and the share that is done.

    Raises:
        ModelError, DataError, UsageError: model, inputs or request are bad.
        SimulationError: it failed; ``partial`` of the exception is the result up to there.
    """
    from cosim.api.simulating import Asked, run

    with heard_by(progress):
        return run(
            Asked(
                model=str(model),
                stop=None if stop_time is None else _seconds(stop_time),
                step=None if step_size is None else _seconds(step_size),
                settings=_settings(parameters),
                parameter_sets=[Path(p) for p in parameter_sets],
                inputs=Path(inputs) if isinstance(inputs, str) else inputs,
                mapping=None if mapping is None else Path(mapping),
                record=list(record) if record else None,
                estimate_error=estimate_error,
                partial_step=partial_step,
                native=native,
                limits=limits,
                start=None if start_time is None else _seconds(start_time),
                tolerance=tolerance,
            )
        )


def beside(log: "File | Log", *, progress: Heard | None = None, **options: Any) -> ComparisonResult:
    """What `compare` and `calibrate` do, with the options of `cosim.beside.run.beside`; for the command line."""
    from cosim.beside.run import beside as work

    with heard_by(progress) as warnings:
        found = work(Path(log) if isinstance(log, str) else log, **options)
    return ComparisonResult(found, (*found.comparison.log.warnings, *found.comparison.notes, *warnings))


def compare(
    log: "File | Log",
    model: File | None = None,
    *,
    mapping: File | None = None,
    parameters: Mapping[str, Number] | Sequence[str] | None = None,
    parameter_sets: Sequence[File] = (),
    step_size: str | None = None,
    thresholds: Mapping[str, Number] | None = None,
    out: File | None = None,
    progress: Heard | None = None,
) -> ComparisonResult:
    """Simulate a model on a log's command: the error of each signal, and of each block driven by what was measured.

    Args:
        log: a file, or a log already read.
        model: name or file; by default the mapping's, or full_order.
        mapping: mapping file of the log.
        parameters: such as ``{"mechanical.J": "900 kg.m2"}``.
        parameter_sets: .ssv files, weaker than `parameters`.
        step_size: such as ``"1 ms"``; by default the log's.
        thresholds: largest RMSE of a signal, such as ``{"slew": "0.5 deg"}``; `ComparisonResult.passed` says if all held.
        out: folder for pictures and series.
        progress: told what is going on, and the share that is done.

    Raises:
        DataError, ModelError, UsageError, SimulationError: whatever is wrong with log, model, request or run.
    """
    return beside(
        log,
        model=None if model is None else str(model),
        mapping=None if mapping is None else Path(mapping),
        settings=_settings(parameters),
        parameter_sets=[Path(p) for p in parameter_sets],
        step_size=step_size,
        thresholds=_settings(thresholds),
        out=None if out is None else Path(out),
        progress=progress,
    )


def calibrate(
    log: "File | Log",
    free: Sequence[str] = (),
    model: File | None = None,
    *,
    mapping: File | None = None,
    prior: Sequence[str] = (),
    fit_to: Sequence[str] = (),
    held_out: float | File | None = None,
    starts: int | None = None,
    parameters: Mapping[str, Number] | Sequence[str] | None = None,
    out: File | None = None,
    progress: Heard | None = None,
) -> ComparisonResult:
    """Fit a model's free parameters to a log, and compare with what was found.

    Args:
        log: a file, or a log already read.
        free: parameters, such as ``"mechanical.J"`` or ``"dcv.K=2:3 mm"``.
        model: name or file; by default the mapping's, or full_order.
        mapping: mapping file of the log.
        prior: what is known beforehand, such as ``"dcv.K=2.4+-0.1 mm"``.
        fit_to: signals; by default all measured ones.
        held_out: part of the log's end that is not fitted but scored (0.3 by default), or another log.
        starts: of the search.
        parameters: start values that differ from the model's own.
        out: folder for files.
        progress: told what is going on, and the share that is done.

    Returns:
        `ComparisonResult.calibration` holds the parameters with their intervals.

    Raises:
        DataError, ModelError, UsageError, SimulationError: whatever is wrong with log, model, request or run.
    """
    asked = {
        "free": list(free) or None,
        "prior": list(prior) or None,
        "fit_to": list(fit_to) or None,
        "held_out": None if held_out is None else str(held_out),
        "starts": starts,
    }
    return beside(
        log,
        model=None if model is None else str(model),
        mapping=None if mapping is None else Path(mapping),
        settings=_settings(parameters),
        calibration={name: value for name, value in asked.items() if value is not None},
        out=None if out is None else Path(out),
        progress=progress,
    )


def diagnose(
    log: "File | Log | Sequence[File | Log]",
    model: File | None = None,
    *,
    mapping: File | None = None,
    external: "File | Tracker | None" = None,
    held_out: "File | Log | Sequence[File | Log]" = (),
    tolerance: float = 0.01,
    calibrate: bool = False,
    budget: Number | None = None,
    out: File | None = None,
    language: str = "en",
    verbose: bool = False,
    progress: Heard | None = None,
) -> DiagnosisResult:
    """Name what the simulation gets wrong in a log, extend the model, and measure the gain on held-out data.

    Args:
        log: a file or a log already read, or several of one machine.
        model: full_order, simplified, physical, a package or wiring of our blocks, or any .ssp or .fmu; by default the
            mapping's.
        mapping: mapping file of the logs.
        external: record of the external tracker.
        held_out: other logs of the machine, on which gains are measured; by default a part of the log.
        tolerance: trust in the nominal parameters: one standard deviation, relative.
        calibrate: fit the nominal parameters freely: only missing structure is a cause.
        budget: [s] it may take; beside FMUs of others 600 by default, else as long as it takes.
        out: folder for results; by default a temporary one that lives as long as the result.
        language: of the report, en or de.
        verbose: on the command line, say beforehand what these signals can tell apart.
        progress: told what is going on, and the share that is done.

    Raises:
        DataError, ModelError, UsageError, SimulationError: whatever is wrong with log, model, request or run.
        KeyboardInterrupt: Ctrl-C; its attribute ``result`` is the `DiagnosisResult` until then.
    """
    from cosim.api.diagnosing import Asked, run
    from cosim.diagnosis.budget import parse_budget
    from cosim.report.language import reported_in

    keep = Scratch() if out is None else None
    folder = keep.path if keep is not None else Path(str(out))
    asked = Asked(
        logs=_several(log),
        model=None if model is None else str(model),
        mapping=None if mapping is None else Path(mapping),
        external=Path(external) if isinstance(external, str) else external,
        held_out=_several(held_out),
        tolerance=tolerance,
        calibrate=calibrate,
        budget=math.inf if budget is None else parse_budget(str(budget)),
        folder=folder,
        verbose=verbose,
    )
    with heard_by(progress) as warnings, reported_in(language):
        try:
            answer = run(asked)
        except KeyboardInterrupt as stop:
            left = asked.left()
            if left is not None:
                stop.result = DiagnosisResult(left, folder, tuple(warnings), keep)  # type: ignore[attr-defined]
            raise
    return DiagnosisResult(answer, folder, tuple(dict.fromkeys([*answer.warnings, *warnings])), keep)


def check(
    file: File,
    model: File | None = None,
    *,
    add: Sequence[File] = (),
    mapping: File | None = None,
    update: bool = False,
    margin: str | None = None,
    cause: bool | None = None,
    budget: str | None = None,
    junit: File | None = None,
    progress: Heard | None = None,
) -> "GateResult":
    """Hold a model against the reference logs and limits of a file; what `cosim check` does.

    Args:
        file: reference logs and limits (TOML).
        model: in place of the models that the file names; with `add` the model that it will name.
        add: logs to add; their limits are measured and written.
        mapping: mapping file of the logs that are added.
        update: measure all limits anew and write them.
        margin: of limits over the errors found, such as ``"10 %"``.
        cause: True: diagnose each log; False: none; None: those whose limits are missed.
        budget: time of each diagnosis, such as ``"60s"``.
        junit: file of JUnit XML to write.
        progress: told what is going on, and the share that is done.

    Raises:
        UsageError, DataError: the request or the file of limits makes no sense.
        ModelError, SimulationError: limits are to be set, and a model is bad or failed.
    """
    from cosim.gate.run import check as work

    with heard_by(progress):
        return work(
            Path(file),
            compare,
            diagnose,
            model=None if model is None else str(model),
            add=[Path(path) for path in add],
            mapping=None if mapping is None else Path(mapping),
            update=update,
            margin=margin,
            cause=cause,
            budget=budget,
            junit=None if junit is None else Path(junit),
        )


def identify(
    log: "File | Log",
    what: str = "all",
    *,
    block: str | None = None,
    between: tuple[str, str] | None = None,
    mapping: File | None = None,
    parameters: Mapping[str, Number] | Sequence[str] | None = None,
    progress: Heard | None = None,
) -> IdentificationResult:
    """Take numbers of the drive from a log, each with its interval; nothing is simulated.

    Args:
        log: a file, or a log already read.
        what: all (dead zone, valve, pressure, mechanics), dead_zone, mechanics, drive (speed against command), frf
            (frequency response by Welch's method) or transfer_function.
        block: of the last two, dcv, continuity, mechanical or simplified (the whole drive, the default).
        between: instead of a block, the names of the signals from which and to which they go.
        mapping: mapping file of the log.
        parameters: numbers taken as known.
        progress: told what is going on, and the share that is done.

    Raises:
        DataError, UsageError: the log or the request is bad.
    """
    from cosim.api.identifying import run

    with heard_by(progress) as warnings:
        loaded = read_log(log, mapping) if isinstance(log, (str, Path)) else log
        answer = run(
            what, loaded, None if mapping is None else Path(mapping), _settings(parameters), block, between
        )
    return IdentificationResult(answer, (*loaded.warnings, *answer.notes, *warnings))


def batch(
    plan: "File | Any",
    out: File = "batch",
    *,
    fresh: bool = False,
    retry_failed: bool = False,
    progress: Heard | None = None,
) -> BatchResult:
    """Run many simulations, comparisons or diagnoses; a batch that was interrupted goes on when called again.

    Args:
        plan: a plan file (TOML), or a `cosim.batch.plan.Plan`.
        out: folder; a batch that lies there goes on.
        fresh: throw away the batch in the folder.
        retry_failed: do failed runs again.
        progress: told what is going on, and the share that is done.

    Raises:
        MissingExtraError: the extra `batch` is not installed.
        DataError, ModelError, UsageError, SimulationError: the request, its files or the workers.
        KeyboardInterrupt: Ctrl-C; what is done stays done.
    """
    from cosim.batch.conduct import conduct, require_extra
    from cosim.console import warn

    require_extra()
    from cosim.batch.plan import load_plan

    with heard_by(progress) as warnings:
        asked = load_plan(Path(plan)) if isinstance(plan, (str, Path)) else plan
        report = conduct(asked, Path(out), fresh=fresh, retry_failed=retry_failed, warn=warn)
    return BatchResult(report, tuple(warnings))


def _seconds(value: Number) -> float:
    from cosim.units import parse_quantity

    return parse_quantity(value, "s") if isinstance(value, str) else float(value)


def _settings(values: Mapping[str, Number] | Sequence[str] | None) -> list[str]:
    """``name=value`` texts."""
    if values is None:
        return []
    if isinstance(values, Mapping):
        return [
            f"{name}={value if isinstance(value, str) else repr(value)}" for name, value in values.items()
        ]
    return list(values)


def _several(log: "File | Log | Sequence[File | Log]") -> "list[Path | Log]":
    """One or several logs as a list."""
    from cosim.logs import Log

    given = [log] if isinstance(log, (str, Path, Log)) else list(log)
    return [Path(item) if isinstance(item, str) else item for item in given]
