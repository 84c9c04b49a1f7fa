"""A batch as the user asks for it: a TOML file, the words of the command line, or both (the command line wins).

    model = "full_order"
    stop_time = "10 s"
    samples = 200
    [vary]
    "mechanical.J" = "763.9 +- 40 kg.m2"

docs/batch.md explains every key.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    field_validator,
)

from cosim.batch.job import EngineName, Task
from cosim.errors import DataError, UsageError
from cosim.ssp.build import SYSTEMS
from cosim.ssp.hints import did_you_mean

Design = Literal["grid", "zip", "latin_hypercube", "sobol", "random"]
Word = Annotated[str, Field(min_length=1)]
Words = tuple[Word, ...]
Scalar = str | int | float | bool

FILE_KEYS = ("mapping", "input", "from_file")  # keys that name one file
FILE_LISTS = ("logs", "parameter_set")  # keys that name several


class Plan(BaseModel):
    """What is to be run.

    Attributes:
        task: simulate; compare with logs (the default where there are logs); or diagnose logs.
        model: names or files of the models.
        logs: files, folders or patterns such as ``logs/*.csv``.
        external: what the name of a tracker's file has behind that of its log, such as ``_tracker``.
        mapping: mapping file (TOML) of the logs or of the input.
        input: log or CSV that drives an open model.
        parameter_set: .ssv files, applied to every run.
        set: parameter -> value of every run.
        sweep: parameter -> values to go through (`cosim.batch.values`).
        vary: parameter -> distribution to draw from (`cosim.batch.values`).
        from_file: diagnosis.json, calibration.json or .ssv whose 95 % intervals are varied; ``from`` in a file.
        design: how the values of several parameters are combined.
        samples: how many draws.
        seed: of the draws.
        stop_time, step_size: of each simulation, with unit.
        output_step: interval at which signals are kept, with unit.
        record: signals to keep.
        engine: "fmu", or "compiled" for models of our blocks.
        tolerance, calibrate: as in ``cosim diagnose``.
        threshold: signal -> largest RMSE, as in ``cosim compare``.
        most_failed: how many runs may fail.
        time_limit: longest a single run may take, with unit.
        workers, runs_per_worker, worker_memory, scheduler: where it runs; no result depends on them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    task: Task | None = None
    model: Words = ()
    logs: Words = ()
    external: Word | None = None
    mapping: Word | None = None
    input: Word | None = None
    parameter_set: Words = ()
    set: dict[Word, Scalar] = {}
    sweep: dict[Word, str | list[Scalar]] = {}
    vary: dict[Word, str] = {}
    from_file: Annotated[str | None, Field(alias="from")] = None
    design: Design | None = None
    samples: PositiveInt | None = None
    seed: Annotated[int, Field(ge=0)] = 1
    stop_time: Word | None = None
    step_size: Word | None = None
    output_step: Word | None = None
    record: Words = ()
    engine: EngineName = "fmu"
    tolerance: Annotated[PositiveFloat, Field(allow_inf_nan=False)] = 0.01
    calibrate: bool = False
    threshold: dict[Word, str] = {}
    most_failed: Annotated[int, Field(ge=0)] | None = None
    time_limit: Word | None = None
    workers: PositiveInt | None = None
    runs_per_worker: PositiveInt | None = None
    worker_memory: Word | None = None
    scheduler: Word | None = None

    @field_validator("model", "logs", "record", "parameter_set", mode="before")
    @classmethod
    def _one_or_many(cls, value: object) -> object:
        return (value,) if isinstance(value, str) else value


def load_plan(path: Path) -> Plan:
    """Reads a plan file; files in it are relative to its folder.

    Raises:
        DataError: it is missing, is no TOML, or a key or value in it is wrong; the message names file and key.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from None
    except ValueError as error:  # TOML and UTF-8 faults
        raise DataError(f"{path} is no TOML file: {error}") from None
    try:
        plan = Plan.model_validate(content)
    except ValidationError as error:
        raise DataError(f"{path}: {_sentences(error)}") from None
    folder = path.resolve().parent
    moved: dict[str, Any] = {"model": tuple(m if m in SYSTEMS else str(folder / m) for m in plan.model)}
    moved |= {key: tuple(str(folder / name) for name in getattr(plan, key)) for key in FILE_LISTS}
    moved |= {key: str(folder / getattr(plan, key)) for key in FILE_KEYS if getattr(plan, key) is not None}
    return plan.model_copy(update=moved)


def with_options(plan: Plan, options: Mapping[str, Any]) -> Plan:
    """A plan changed by the command line: what is given replaces the plan's, tables are added to.

    Args:
        plan: from a file, or ``Plan()``.
        options: field -> value; None and empty ones are left out.

    Raises:
        UsageError: a value is not allowed; the message names the option.
    """
    given = {key: value for key, value in options.items() if value not in (None, (), [], {})}
    merged = {
        key: {**getattr(plan, key), **value} if isinstance(value, dict) else value
        for key, value in given.items()
    }
    try:
        return Plan.model_validate({**plan.model_dump(), **merged})
    except ValidationError as error:
        raise UsageError(_sentences(error, "--")) from None


def _sentences(error: ValidationError, prefix: str = "") -> str:
    """Every fault with the path of its key; of the branches of a union only the last is told."""
    found: dict[str, str] = {}
    for item in error.errors():
        # pydantic adds the branch of a union it tried; a key holds no blank, bracket or type name of its own
        where = [str(part) for part in item["loc"] if str(part) not in ("str", "int", "float", "bool")]
        key = ".".join(part for part in where if not part.startswith("list["))
        hint = ""
        if item["type"] == "extra_forbidden":
            known = [field.alias or name for name, field in Plan.model_fields.items()]
            hint = did_you_mean(key, known) or f"; known: {', '.join(known)}"
        shown = prefix + key.replace("_", "-") if prefix else f"'{key}'"
        found[key] = f"{shown}: {item['msg'].removeprefix('Value error, ')}{hint}"
    return "; ".join(found.values())
