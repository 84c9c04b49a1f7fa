"""What workers are told: plain data that any process can read; it holds names of files, not their content."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.ssp.system import Value

Array = NDArray[np.float64]
Task = Literal["simulate", "compare", "diagnose"]
EngineName = Literal["fmu", "compiled"]
Status = Literal["done", "failed"]


@dataclass(frozen=True)
class File:
    """A file as it was when the batch was planned.

    Attributes:
        label: what it is called in results, unique among its kind.
        path: absolute.
        sha256: of its content.
    """

    label: str
    path: str
    sha256: str


@dataclass(frozen=True)
class Model:
    """A model and how it is simulated without a log.

    Attributes:
        file: the package or FMU; of a diagnosis, the name of a model may stand in place of a path.
        fixed: parameter -> value of every run, in the FMU's unit.
        start, stop, step: [s]; of no use where there is a log.
        record: signals to keep; empty for all.
    """

    file: File
    fixed: dict[str, Value] = field(default_factory=dict)
    start: float = 0.0
    stop: float = 0.0
    step: float = 0.0
    record: tuple[str, ...] = ()


@dataclass(frozen=True)
class Job:
    """Everything that all runs have in common.

    Attributes:
        task, engine: as in `cosim.batch.plan.Plan`.
        models, logs: what the runs point to.
        trackers: log's label -> tracker's file.
        mapping: mapping file.
        input: log or CSV that drives the models.
        log_step: step size for logs [s], or None for their own.
        output_step: interval of kept signals [s].
        tolerance, calibrate: of a diagnosis.
        folder: where a diagnosis writes; one folder a log inside.
    """

    task: Task
    engine: EngineName
    models: tuple[Model, ...]
    logs: tuple[File, ...] = ()
    trackers: dict[str, File] = field(default_factory=dict)
    mapping: File | None = None
    input: File | None = None
    log_step: float | None = None
    output_step: float = 0.01
    tolerance: float = 0.01
    calibrate: bool = False
    folder: str = ""


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        number: from 0.
        model: index into `Job.models`.
        log: index into `Job.logs`, or None.
        parameters: what differs between runs, in the FMU's unit.
    """

    number: int
    model: int = 0
    log: int | None = None
    parameters: dict[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Signal:
    """A signal kept of a run, every `Job.output_step` from the start on.

    Attributes:
        values: (m,) in `unit`.
        unit: SI.
        display: (unit people read, factor, offset): shown = factor * value + offset.
    """

    values: Array
    unit: str
    display: tuple[str, float, float]


@dataclass
class Outcome:
    """What came of a run.

    Attributes:
        number: of the run.
        status: whether it was done.
        reason: why it failed; empty if it did not.
        seconds: its duration.
        scores: name with unit -> number or text.
        signals: name -> signal.
        notes: what the user should know.
        worker: ``host:process`` that ran it.
        resident: memory of that process afterwards, bytes.
    """

    number: int
    status: Status = "done"
    reason: str = ""
    seconds: float = 0.0
    scores: dict[str, float | str | None] = field(default_factory=dict)
    signals: dict[str, Signal] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    worker: str = ""
    resident: int = 0
