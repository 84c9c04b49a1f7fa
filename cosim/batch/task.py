"""What a worker does: runs, one after the other, with instances kept from one run to the next.

These functions are found by name in this module (not pickled), so a worker loads an FMU once and not once a run.
"""

import hashlib
import os
import socket
import threading
import time as clock
from collections import OrderedDict
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from cosim.batch.job import File, Job, Outcome, Run, Signal
from cosim.errors import CosimError, DataError, ModelError, UsageError
from cosim.results import DisplayUnit, Result
from cosim.ssp.system import Value

Array = NDArray[np.float64]
MOST_KEPT = 3  # loaded models, or pairs of model and log, that a process keeps

_turn = threading.Lock()  # a Dask worker may have several threads; FMUs of one process take turns
_kept: "OrderedDict[Any, Loaded]" = OrderedDict()


class Loaded:
    """Something loaded for many runs, and what must be closed behind it."""

    def __init__(self) -> None:
        self.stack = ExitStack()
        self.tool: Any = None
        self.options: dict[str, Any] = {}
        self.stop = 0.0


def hello() -> str:
    """Version of the project where this runs: asked of a cluster's workers before any work."""
    from cosim.packages import project_version

    return project_version()


def execute(job: Job, runs: list[Run]) -> list[Outcome]:
    """Run them in this process; a run that fails says so in its outcome and stops no other."""
    with _turn:
        return [_one(job, run) for run in runs]


def _one(job: Job, run: Run) -> Outcome:
    outcome = Outcome(run.number, worker=f"{socket.gethostname()}:{os.getpid()}")
    begun = clock.perf_counter()
    try:
        {"simulate": _simulate, "compare": _compare, "diagnose": _diagnose}[job.task](job, run, outcome)
    except CosimError as error:
        outcome.status, outcome.reason = "failed", str(error)
    except Exception as error:  # a defect of ours or of a library shall not end the batch either
        outcome.status, outcome.reason = "failed", f"internal error: {type(error).__name__}: {error}"
        _forget()
    if outcome.status == "failed":
        outcome.scores, outcome.signals = {}, {}
    outcome.seconds = clock.perf_counter() - begun
    outcome.resident = psutil.Process().memory_info().rss
    return outcome


# Simulation


def _simulate(job: Job, run: Run, outcome: Outcome) -> None:
    model = job.models[run.model]
    loaded = _keep((model.file, job.input, job.engine), lambda kept: _load_system(job, run, kept))
    parameters: dict[str, Value] = {**model.fixed, **run.parameters}
    result: Result = loaded.tool.run(
        loaded.stop,
        model.step,
        parameters=parameters,
        record=model.record or None,
        **loaded.options,
    )
    outcome.notes = (*result.notes, *result.messages)
    for name, values in result.signals.items():
        unit = result.units.get(name, "")
        shown = result.display.get(name) or DisplayUnit(unit or "1")
        own = values * shown.factor + shown.offset
        numbers = (own.min(), own.max(), own[-1], np.sqrt(np.mean(np.square(own))))
        for label, number in zip(("min", "max", "final", "rms"), numbers, strict=True):
            outcome.scores[f"{name} {label} [{shown.name}]"] = float(number)
        display = shown.name, shown.factor, shown.offset
        outcome.signals[name] = Signal(resampled(result.time, values, job.output_step), unit or "1", display)


def _load_system(job: Job, run: Run, kept: Loaded) -> None:
    from cosim.ssp.read import read_system

    model = job.models[run.model]
    system = kept.stack.enter_context(read_system(_present(model.file)))
    # each is loaded where it is needed: of a short batch that is most of the time
    if job.engine == "compiled":
        from cosim.batch.twin import Twin

        kept.tool = Twin(system)
    else:
        from cosim.master import Runner

        kept.tool = Runner(system, many=True)
    kept.stack.callback(kept.tool.close)
    kept.options, kept.stop = {"start_time": model.start}, model.stop
    if job.input is not None:
        from cosim.request import read_inputs

        mapping = _present(job.mapping) if job.mapping else None
        driven = read_inputs(_present(job.input), mapping, system, model.step)
        kept.options = {"start_time": driven.start, "inputs": driven.inputs, "hold": driven.hold}


# Comparison


def _compare(job: Job, run: Run, outcome: Outcome) -> None:
    from cosim.compare import Comparison

    model, log = job.models[run.model], _log(job, run)
    loaded = _keep((model.file, log, job.engine), lambda kept: _load_comparator(job, run, kept))
    comparison: Comparison = loaded.tool.run({**model.fixed, **run.parameters})
    outcome.notes = tuple(comparison.notes)
    blocks = [(f"{block.name}: ", block.signals) for block in comparison.blocks]
    for prefix, signals in [("", comparison.signals), *blocks]:
        for name, found in signals.items():
            unit, scale = comparison.shown(name)
            score = found.score
            outcome.scores[f"{prefix}{name} rmse [{unit}]"] = score.rmse * scale
            outcome.scores[f"{prefix}{name} fit [%]"] = None if score.constant else score.fit_percent
            outcome.scores[f"{prefix}{name} largest error [{unit}]"] = score.max_error * scale
            outcome.scores[f"{prefix}{name} error to noise [1]"] = score.ratio
    time = comparison.time - comparison.time[0]
    for name, found in comparison.signals.items():
        shown, scale = comparison.shown(name)
        own = loaded.tool.bindings[name].unit
        outcome.signals[name] = Signal(
            resampled(time, found.simulated, job.output_step), own, (shown, scale, 0.0)
        )


def _load_comparator(job: Job, run: Run, kept: Loaded) -> None:
    from cosim.batch.twin import Twin
    from cosim.compare import Comparator, CompareTable, load_mapping
    from cosim.logs import load_log
    from cosim.machines import table_in_package

    names, table = (None, CompareTable())
    if job.mapping is not None:
        names, table = load_mapping(_present(job.mapping))
    log = load_log(_present(_log(job, run)), names)
    source = _present(job.models[run.model].file)
    table = table_in_package(source, names, table)
    comparator: Any = kept.stack.enter_context(Comparator(log, source, table=table, step=job.log_step))
    comparator.notes.extend(log.warnings)
    if job.engine == "compiled":
        comparator.runner.close()
        comparator.runner = Twin(comparator.runner.system)
    kept.tool = comparator


# Diagnosis


def _diagnose(job: Job, run: Run, outcome: Outcome) -> None:
    from cosim.diagnosis.model.choice import machine_of
    from cosim.diagnosis.pipeline.diagnose import diagnose
    from cosim.files import Scratch
    from cosim.lexicon import speaking
    from cosim.logs import load_log, load_mapping, load_tracker
    from cosim.report.deliver import delivered

    file = _log(job, run)
    mapping = _present(job.mapping) if job.mapping else None
    log = load_log(_present(file), mapping)
    tracker = load_tracker(_present(job.trackers[file.label])) if file.label in job.trackers else None
    model = job.models[run.model].file
    if model.sha256:
        _present(model)
    machine = machine_of(model.path or None, log, mapping)
    second = load_mapping(mapping) if mapping is not None else None
    held_out = (
        load_log(_present(file), second.of_held_out) if second is not None and second.held_out else None
    )
    folder = Path(job.folder, f"{file.label}_{model.label}" if len(job.models) > 1 else file.label)
    folder.mkdir(parents=True, exist_ok=True)
    with Scratch("extended_") as made, speaking(machine.lexicon):
        found = diagnose(
            log,
            tracker=tracker,
            model=machine,
            held_out=held_out,
            tolerance=job.tolerance,
            calibrate=job.calibrate,
            folder=Path(made),
        )
        answer = delivered(found, log, folder)
    outcome.notes = tuple(answer.warnings)
    outcome.scores |= {
        "verdict": answer.verdict,
        "causes": "; ".join(cause.effect for cause in answer.causes),
        "unexplained": "; ".join(rest.block for rest in answer.unexplained),
        "diagnosis": (folder / "diagnosis.json").as_posix(),
    }
    for cause in answer.causes:
        for label, parameter in cause.parameters.items():
            outcome.scores[f"{cause.effect} {label} [{parameter.unit}]"] = parameter.value
    for signal, gain in answer.gain.items():
        outcome.scores[f"{signal} rmse before [{gain.unit}]"] = gain.rmse_before
        outcome.scores[f"{signal} rmse after [{gain.unit}]"] = gain.rmse_after


# Helpers


def resampled(time: Array, values: Array, step: float) -> Array:
    """Values (m,) every `step` s from the first of `time` (n,) [s] on: samples themselves where the steps fit."""
    own = float(time[1] - time[0])
    ratio = step / own
    whole = round(ratio)
    if whole >= 1 and abs(ratio - whole) <= 1e-6 * whole:
        return np.ascontiguousarray(values[::whole])
    count = int((time[-1] - time[0]) / step + 1e-6) + 1
    return np.interp(time[0] + np.arange(count) * step, time, values)


def _log(job: Job, run: Run) -> File:
    if run.log is None:
        raise UsageError("the run has no log")
    return job.logs[run.log]


def _present(file: File) -> Path:
    """The file, if it is what the batch was planned with; on a cluster's worker it may not be.

    Raises:
        DataError: it is missing.
        ModelError: it is another one.
    """
    path = Path(file.path)
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise DataError(
            f"{path} cannot be read on {socket.gethostname()} ({error.strerror or error}): "
            "workers must see the same files under the same paths"
        ) from None
    if digest != file.sha256:
        raise ModelError(f"{path} on {socket.gethostname()} is not the file that the batch was planned with")
    return path


def _keep(key: Any, load: Any) -> Loaded:
    """What was loaded under `key`, or loads it now; the one used longest ago makes room."""
    if key in _kept:
        _kept.move_to_end(key)
        return _kept[key]
    while len(_kept) >= MOST_KEPT:
        _kept.popitem(last=False)[1].stack.close()
    kept = Loaded()
    try:
        load(kept)
    except BaseException:
        kept.stack.close()
        raise
    _kept[key] = kept
    return kept


def _forget() -> None:
    while _kept:
        _kept.popitem()[1].stack.close()
