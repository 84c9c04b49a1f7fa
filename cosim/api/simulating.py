"""A simulation as it is asked for."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim import console
from cosim.compare.model import open_model
from cosim.errors import UsageError
from cosim.logs import Log
from cosim.master import Limits, Runner
from cosim.request import model_path, parameters, read_inputs
from cosim.results import Result
from cosim.ssp.archive import scratch_folder
from cosim.ssp.build import SYSTEMS
from cosim.ssp.system import System

DEFAULT_STOP, DEFAULT_STEP = 10.0, 1e-3  # [s], where neither request nor model says


@dataclass(frozen=True)
class Asked:
    """What is asked for; the attributes are those of `cosim.api.simulate`."""

    model: str
    stop: float | None
    step: float | None
    settings: list[str]
    parameter_sets: list[Path]
    inputs: Path | Log | None
    mapping: Path | None
    record: list[str] | None
    estimate_error: bool
    partial_step: bool
    native: bool
    limits: Limits | None


def run(asked: Asked) -> Result:
    """Simulate.

    Raises:
        UsageError, ModelError, DataError, SimulationError: as `cosim.api.simulate`.
    """
    if asked.mapping is not None and asked.inputs is None:
        raise UsageError("--mapping says how to read a log, so it needs --input")
    of_machine = Path(asked.model) if asked.model.lower().endswith(".toml") else None
    played = asked.inputs if isinstance(asked.inputs, Path) else None
    log = played if asked.mapping in (None, of_machine) else None
    mapping = asked.mapping or (of_machine if played is not None else None)
    if isinstance(asked.inputs, Log) and asked.model in SYSTEMS:
        file = open_model(asked.model)
    else:
        file = model_path(asked.model, asked.inputs is not None, log)
    with (
        native_or_not(file, asked.native) as path,
        Runner(path, limits=asked.limits or Limits.usual()) as runner,
    ):
        system = runner.system
        step = asked.step or system.step_size or DEFAULT_STEP
        options: dict[str, Any] = {
            "parameters": parameters(system, asked.parameter_sets, asked.settings),
            "record": asked.record,
            "start_time": system.start_time or 0.0,
            "partial_step": asked.partial_step,
        }
        stop = system.stop_time or DEFAULT_STOP
        if isinstance(asked.inputs, Log):
            options["inputs"], options["start_time"], stop = of_log(asked.inputs, system, step)
        elif played is not None:
            options["inputs"], options["start_time"], stop = read_inputs(played, mapping, system, step)
        stop = stop if asked.stop is None else asked.stop
        with console.progress(f"simulating {system.name}", stop - options["start_time"]) as bar:
            simulate = runner.coupling_error if asked.estimate_error else runner.run
            return simulate(stop, step, progress=bar, **options)


def of_log(log: Log, system: System, step: float) -> tuple[dict[str, Any], float, float]:
    """The inputs that a log holds, first and last time.

    Raises:
        UsageError: it holds none.
    """
    found = {name: (log.time, log[name]) for name in system.inputs if name in log}
    if not found:
        raise UsageError(
            f"{log.source} has none of the inputs of '{system.name}': {', '.join(system.inputs)}"
        )
    first = float(log.time[0])
    return found, first, first + int((float(log.time[-1]) - first) / step + 1e-6) * step


@contextmanager
def native_or_not(path: Path, native: bool) -> Iterator[Path]:
    """The model file itself, or a copy of it with native FMUs, which is deleted afterwards."""
    if not native:
        yield path
        return
    from cosim.native.package import swapped

    folder, _ = scratch_folder()
    with folder:
        yield swapped(path, Path(folder.name, path.name))
