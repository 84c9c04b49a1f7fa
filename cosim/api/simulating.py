"""A simulation as it is asked for."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim import console
from cosim.compare.model import open_model
from cosim.errors import UsageError
from cosim.logs import Log
from cosim.master import Limits, Runner
from cosim.request import model_path, parameters, read_inputs
from cosim.results import DisplayUnit, Result
from cosim.ssp.archive import scratch_folder
from cosim.ssp.build import SYSTEMS
from cosim.ssp.quantities import of_reading
from cosim.ssp.system import System

DEFAULT_STOP, DEFAULT_STEP = 10.0, 1e-3  # [s], where neither request nor model says
MOST_STEPS, FEW_STEPS = (
    1e6,
    1000,
)  # of an FMU's own span: more than the first of 1 ms, and the second are made instead


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
    start: float | None = None
    tolerance: float | None = None


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
        start = system.start_time or 0.0
        stop = DEFAULT_STOP if system.stop_time is None else system.stop_time
        step = asked.step or system.step_size or _usual_step(system, start, stop)
        shown: Mapping[str, DisplayUnit] = {}
        options: dict[str, Any] = {
            "parameters": parameters(system, asked.parameter_sets, asked.settings),
            "record": asked.record,
            "start_time": start,
            "partial_step": asked.partial_step,
            "tolerance": asked.tolerance,
        }
        if isinstance(asked.inputs, Log):
            options["inputs"], options["start_time"], stop = of_log(asked.inputs, system, step)
        elif played is not None:
            driven = read_inputs(played, mapping, system, step)
            options["inputs"], options["start_time"], stop = driven.inputs, driven.start, driven.stop
            options["hold"], shown = driven.hold, driven.shown
            options["parameters"] = {**driven.starts, **options["parameters"]}
        stop = stop if asked.stop is None else asked.stop
        if asked.start is not None:
            options["start_time"] = asked.start
        own = _own_experiment(asked, system)
        if {"start", "stop"} <= own.keys() and asked.step is None and not asked.estimate_error:
            options["partial_step"] = True  # an FMU's own step need not divide its own span
        with console.progress(f"simulating {system.name}", stop - options["start_time"]) as bar:
            simulate = runner.coupling_error if asked.estimate_error else runner.run
            result = simulate(stop, step, progress=bar, **options)
        result.display.update({result.aliases.get(name, name): unit for name, unit in shown.items()})
        if own:
            told = ", ".join(f"{name} {value:.6g}{unit}" for name, (value, unit) in own.items())
            result.notes.append(f"by the FMU's own default experiment: {told}")
        return result


def tracking(result: Result) -> dict[str, float] | None:
    """How a position loop follows its reference, as `cosim.closed_loop.tracking`; None for any other model."""
    if "reference.reference" not in result.signals:
        return None
    from cosim.closed_loop import tracking as of_loop  # brings control, which takes half a second

    return of_loop(result)


def swing(result: Result) -> tuple[dict[str, float] | None, str]:
    """The swing that a position loop keeps up (`cosim.closed_loop.swing`), and what makes it; None and no words for none."""
    if "reference.reference" not in result.signals:
        return None, ""
    from cosim.closed_loop import swing as of_loop
    from cosim.closed_loop import why

    found = of_loop(result)
    return found, "" if found is None else why(found)


def _usual_step(system: System, start: float, stop: float) -> float:
    """Step [s] where neither request nor model says: 1 ms, or a thousandth of an FMU's own span that this does not suit."""
    steps = (stop - start) / DEFAULT_STEP
    if system.stop_time is None or not steps > 0.0:
        return DEFAULT_STEP
    suits = steps <= MOST_STEPS and abs(steps - round(steps)) <= 1e-6 and round(steps) >= 1
    return DEFAULT_STEP if suits else (stop - start) / FEW_STEPS


def _own_experiment(asked: Asked, system: System) -> dict[str, tuple[float, str]]:
    """What is taken from the default experiment of an FMU that is simulated alone: name -> (value, its unit)."""
    if len(system.components) != 1 or system.path.suffix.lower() != ".fmu":
        return {}
    (component,) = system.components.values()
    fmu, driven = component.fmu, asked.inputs is not None
    own = {
        "start": (fmu.start_time, " s", driven or asked.start is not None),
        "stop": (fmu.stop_time, " s", driven or asked.stop is not None),
        "step": (fmu.step_size, " s", asked.step is not None),
        "tolerance": (fmu.tolerance, "", asked.tolerance is not None),
    }
    return {
        name: (value, unit) for name, (value, unit, given) in own.items() if value is not None and not given
    }


def of_log(log: Log, system: System, step: float) -> tuple[dict[str, Any], float, float]:
    """The inputs that a log holds, first and last time.

    Raises:
        UsageError: it holds none.
    """
    found = {name: (log.time, _in_its_unit(log, name, system)) for name in system.inputs if name in log}
    if not found:
        raise UsageError(
            f"{log.source} has none of the inputs of '{system.name}': {', '.join(system.inputs)}"
        )
    first = float(log.time[0])
    return found, first, first + int((float(log.time[-1]) - first) / step + 1e-6) * step


def _in_its_unit(log: Log, name: str, system: System) -> NDArray[np.float64]:
    """A signal of a log in the unit of the system's input of its name.

    Raises:
        UsageError: the dimensions differ.
    """
    item = system.inputs[name]
    known = system.components[item.targets[0].target.component].fmu.units if item.targets else {}
    scale = of_reading(log.display[name], log.units[name], item.unit, known)
    if scale is None:
        raise UsageError(
            f"{log.source}: '{name}' is in '{log.display[name]}', but the system's in '{item.unit}'"
        )
    factor, offset = scale
    return np.asarray(factor * log[name] + offset)


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
