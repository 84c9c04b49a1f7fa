"""From what the user asks for to a list of runs: files found and named, parameters checked, values drawn.

Whatever can be wrong with the request is found here, before any run begins.
"""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from cosim.batch.files import find_logs, find_trackers, labelled, named_file
from cosim.batch.job import File, Job, Model, Run
from cosim.batch.parameters import Table, Varied, parameter_table
from cosim.batch.plan import Plan
from cosim.batch.sources import Estimates, read_estimates
from cosim.batch.twin import Twin
from cosim.console import to_jsonable
from cosim.errors import UsageError
from cosim.packages import project_version
from cosim.request import model_path, parameters, read_inputs, seconds
from cosim.ssp.build import SYSTEMS
from cosim.ssp.hints import did_you_mean
from cosim.ssp.read import read_system
from cosim.ssp.system import System

FORMAT = 1  # of the folder; a change of meaning makes older folders another batch
DEFAULT_MODEL = "full_order"
STOP, STEP, OUTPUT_STEP = 10.0, 1e-3, 1e-2  # s, where neither user nor model says
LARGE = 2e9  # bytes of signals of which the user is told


@dataclass
class Batch:
    """A batch, ready to be run.

    Attributes:
        plan: what was asked for.
        job, runs: what workers are told.
        varied: the parameters that differ between runs.
        random: the runs are draws, so quantiles mean something.
        notes: what the user should know.
    """

    plan: Plan
    job: Job
    runs: list[Run]
    varied: list[Varied] = field(default_factory=list)
    random: bool = False
    notes: list[str] = field(default_factory=list)

    @property
    def identity(self) -> str:
        """Digest of all that results depend on, versions of files and of the project included."""
        job = {key: value for key, value in asdict(self.job).items() if key != "folder"}
        text = json.dumps(to_jsonable([FORMAT, project_version(), _without_paths(job)]))
        digest = hashlib.sha256(text.encode())
        for run in self.runs:
            digest.update(repr((run.model, run.log, sorted(run.parameters.items()))).encode())
        return digest.hexdigest()


def _without_paths(value: Any) -> Any:
    """Plain data where a file is known by name and content, wherever it lies."""
    if isinstance(value, dict):
        known = value.keys() - {"path"} if value.get("sha256") else value.keys()
        return {key: _without_paths(value[key]) for key in sorted(known)}
    return [_without_paths(item) for item in value] if isinstance(value, (list, tuple)) else value


def plan_batch(plan: Plan, folder: Path) -> Batch:
    """Find everything that is needed, and list the runs.

    Args:
        plan: what is asked for.
        folder: where results go.

    Raises:
        UsageError, DataError, ModelError: whatever is wrong with the request or its files.
    """
    logs = find_logs(plan)
    task = plan.task or ("compare" if logs else "simulate")
    _check_task(plan, task, logs)
    estimates = read_estimates(Path(plan.from_file)) if plan.from_file else None
    table, models = Table([{}], []), []
    if task == "diagnose":
        models = _for_diagnosis(plan.model)
    else:
        default = estimates.model if estimates and estimates.model else _default(plan, task, logs)
        for label, path in _model_files(plan, task, plan.model or (default,)).items():
            with read_system(path) as system:
                if plan.engine == "compiled" and task == "simulate":
                    Twin(system).check()
                table = parameter_table(plan, estimates, system)
                models.append(_model(plan, task, system, named_file(label, path), estimates))
    files = [named_file(label, path) for label, path in labelled(logs).items()]
    mapping, played = (Path(name) if name else None for name in (plan.mapping, plan.input))
    job = Job(
        task=task,
        engine=plan.engine,
        models=tuple(models),
        logs=tuple(files),
        trackers=find_trackers(plan, files),
        mapping=named_file(mapping.stem, mapping) if mapping else None,
        input=named_file(played.stem, played) if played else None,
        log_step=seconds(plan.step_size, "--step-size") if plan.step_size and task == "compare" else None,
        output_step=_output_step(plan, models),
        tolerance=plan.tolerance,
        calibrate=plan.calibrate,
        folder=str((folder / "diagnoses").absolute()),
    )
    logs_or_none = range(len(files)) if files else (None,)
    cases = [(m, k, row) for k in logs_or_none for m in range(len(models)) for row in table.rows]
    runs = [Run(number, m, k, row) for number, (m, k, row) in enumerate(cases)]
    notes = [*table.notes, *_cost(job, len(runs))]
    return Batch(plan, job, runs, table.varied, table.random, notes)


# Models


def _default(plan: Plan, task: str, logs: Sequence[Path]) -> str:
    """The model where none is asked for: the mapping's, or that of its machine as the logs tell it, else ours."""
    if plan.mapping is not None and task == "compare":
        from cosim.compare import load_mapping

        mapping = load_mapping(Path(plan.mapping))[0]
        if mapping.model is not None:
            file = Path(plan.mapping).parent / mapping.model
            return str(file) if file.is_file() else mapping.model
        if mapping.machine and not plan.model:
            from cosim.compare.model import build_wiring
            from cosim.logs import load_log
            from cosim.machines import made_for

            wiring = made_for(Path(plan.mapping), [load_log(log, mapping) for log in logs]).ssd
            return str(build_wiring(wiring, wiring.parent))
    return DEFAULT_MODEL


def _model_files(plan: Plan, task: str, names: Sequence[str]) -> dict[str, Path]:
    """Files of models, ours under the names they are known by."""
    files: dict[Path, str] = {}
    for name in names:
        if task == "compare":
            from cosim.compare import open_model

            files[open_model(name)] = name
        else:
            files[model_path(name, with_input=plan.input is not None)] = name
    found = labelled(list(files))
    return {files[path] if files[path] in SYSTEMS else label: path for label, path in found.items()}


def _for_diagnosis(names: Sequence[str]) -> list[Model]:
    found = [
        Model(File(name, name, "")) if name in SYSTEMS else Model(named_file(Path(name).stem, Path(name)))
        for name in names
    ]
    return found or [Model(File("default", "", ""))]  # the log's mapping may name one


# What fits together


def _check_task(plan: Plan, task: str, logs: Sequence[Path]) -> None:
    if task != "simulate" and not logs:
        raise UsageError(f"to {task} needs logs: name files, folders or patterns")
    if task == "simulate" and logs:
        raise UsageError("task 'simulate' takes no logs; one that drives an open model is given as --input")
    parametric = plan.sweep or plan.vary or plan.from_file
    if task == "diagnose" and (parametric or plan.set or plan.parameter_set or plan.engine != "fmu"):
        raise UsageError(
            "a diagnosis finds the parameters itself: no --sweep, --vary, --from, --set or --engine"
        )
    if task == "simulate" and not parametric and len(plan.model) < 2:
        raise UsageError(
            "there is one run only: name parameters (--sweep, --vary, --from), logs or several models"
        )
    if plan.threshold and task != "compare":
        raise UsageError("--threshold is about the error against a log, so it needs logs to compare with")
    if plan.input and task != "simulate":
        raise UsageError("--input drives simulations; logs that are compared drive the model themselves")
    if plan.mapping and not (logs or plan.input):
        raise UsageError("--mapping says how to read logs, so it needs logs or --input")
    if task != "simulate" and (plan.stop_time or plan.record):
        raise UsageError(
            "--stop-time and --record go with simulations; logs say how long, and what is compared"
        )


def _model(plan: Plan, task: str, system: System, file: File, estimates: Estimates | None) -> Model:
    """A model with its fixed parameters and times."""
    texts = [f"{e.name}={e.value!r} {e.unit}" for e in estimates.known] if estimates else []
    texts += [f"{name}={_text(value)}" for name, value in plan.set.items()]
    fixed = parameters(system, [Path(p) for p in plan.parameter_set], texts)
    if task == "compare":
        return Model(file, fixed)
    step = seconds(plan.step_size, "--step-size") if plan.step_size else system.step_size or STEP
    start, stop = system.start_time or 0.0, system.stop_time or STOP
    if plan.input:
        mapping = Path(plan.mapping) if plan.mapping else None
        driven = read_inputs(Path(plan.input), mapping, system, step)
        start, stop, fixed = driven.start, driven.stop, {**driven.starts, **fixed}
    stop = seconds(plan.stop_time, "--stop-time") if plan.stop_time else stop
    known = [f"{c.name}.{v}" for c in system.components.values() for v in c.fmu.variables]
    for name in plan.record:
        if name not in known and name not in system.outputs and name not in system.inputs:
            raise UsageError(f"there is no variable '{name}' to record{did_you_mean(name, known)}")
    return Model(file, fixed, start, stop, step, plan.record)


def _text(value: str | float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _output_step(plan: Plan, models: Sequence[Model]) -> float:
    longest = max((model.step for model in models), default=0.0)
    if plan.output_step is None:
        return max(OUTPUT_STEP, longest)
    step = seconds(plan.output_step, "--output-step")
    if not (math.isfinite(step) and step > 0.0):
        raise UsageError(f"--output-step {plan.output_step}: it must be positive")
    return step


def _cost(job: Job, runs: int) -> list[str]:
    """A warning where the signals of simulations take much space."""
    points = max(((m.stop - m.start) / job.output_step for m in job.models), default=0.0)
    size = 8.0 * runs * points * max((len(m.record) or 12 for m in job.models), default=0)
    if size <= LARGE:
        return []
    return [
        f"the signals take about {size / 1e9:.0f} GB before compression: keep fewer by --record or --output-step"
    ]
