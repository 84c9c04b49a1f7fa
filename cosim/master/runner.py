"""The master: loads a system once and simulates it as often as asked."""

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cosim.errors import SimulationError, UsageError
from cosim.master.apart import Apart
from cosim.master.convergence import estimate
from cosim.master.engine import EngineName
from cosim.master.host import Host, Task
from cosim.master.inputs import Sampler, Series, checked_value, time_grid
from cosim.master.limits import Limits
from cosim.master.plan import Plan, make_plan
from cosim.results import DisplayUnit, Result
from cosim.ssp.hints import did_you_mean
from cosim.ssp.read import read_system, resolve, settable_names
from cosim.ssp.system import Port, System, Value

Array = NDArray[np.float64]
Sink = Callable[[int, Mapping[str, Array]], None]
"""Takes (index of the first value, signal -> values (m,)), piece after piece."""
HELD = ("u",)  # the valve command of our models is held over each step, whatever its FMU declares


def usually_held(system: System) -> tuple[str, ...]:
    """Inputs that are held by default: the valve command `u`, but not what an FMU of others calls so."""
    return tuple(
        n
        for n in HELD
        if n not in system.inputs
        or all(system.components[w.target.component].fmu.house for w in system.inputs[n].targets)
    )


class Runner:
    """Simulates a system by a Gauss-Seidel master; a context manager, reused for many runs.

        with Runner(Path("full_order.ssp")) as runner:
            result = runner.run(10.0, 1e-3, parameters={"mechanical.J": 800.0})

    Each step, every component gets its inputs, makes its step and hands on its outputs, sources before targets. A
    connection hands over the value at the END of the step; one from an output of variability ``discrete`` that at its
    START. Loops are broken as `cosim.master.order` says; Result.notes names the connection.

    FMUs that this installation built run in this process. A system with any other runs in a child process, which an FMU
    may end, hang or fill without harm to this one (`cosim.master.apart`); the numbers are the same.

    Attributes:
        system: what is simulated.
        apart: it runs in a child process.
    """

    def __init__(
        self,
        source: Path | str | System,
        *,
        parameter_set: str | None = None,
        apart: bool | None = None,
        limits: Limits | None = None,
        many: bool = False,
    ) -> None:
        """Read the system, if a path is given, and instantiate its FMUs.

        Args:
            source: an .ssp or .fmu file, or a System (which the caller closes).
            parameter_set: name of the only ParameterSet to apply.
            apart: whether to run in a child process; by default where an FMU is not ours (`cosim.trust`).
            limits: of the child; by default `Limits.usual`.
            many: runs are to come that only the tool asks for: what FMUs of others print is shown of the first alone.

        Raises:
            ModelError: the file is bad.
            SimulationError: an FMU cannot be instantiated.
            UsageError: COSIM_STALL or COSIM_MEMORY is no limit.
        """
        limits = limits or Limits.usual()
        self._owns = not isinstance(source, System)
        self.system = source if isinstance(source, System) else read_system(Path(source), parameter_set)
        self._plans: dict[Any, Plan] = {}
        self._host: Host | Apart | None = None
        if apart is None:
            apart = not all(component.fmu.ours for component in self.system.components.values())
        self.apart = apart
        try:
            self._host = Apart(self.system, limits, many) if apart else Host(self.system)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Free the FMUs, and delete what was unpacked for this Runner; safe to call twice."""
        host, self._host = self._host, None
        if host is not None:
            host.close()
        if self._owns:
            self.system.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def run(
        self,
        stop_time: float,
        step_size: float,
        *,
        parameters: Mapping[str, Value] | None = None,
        inputs: Mapping[str, Series] | None = None,
        hold: Collection[str] | None = None,
        record: Sequence[str] | None = None,
        start_time: float = 0.0,
        partial_step: bool = False,
        tolerance: float | None = None,
        engine: EngineName = "compiled",
        progress: Callable[[float], None] | None = None,
        sink: Sink | None = None,
        within: float = math.inf,
    ) -> Result:
        """Simulate once, from the start values.

        Args:
            stop_time: [s].
            step_size: communication step [s].
            parameters: start values by name, in the FMU's (SI) unit: ``component.variable``, or a connector of the system.
            inputs: ``(times, values)`` or constants for inputs; held ones act from a step's start, others at its end.
            hold: inputs held even if their FMU does not declare them discrete; by default the valve command of our models.
            record: signals to record; None for all outputs that are numbers, and driven inputs.
            start_time: [s].
            partial_step: let the last step be shorter where the stop time is no multiple of the step size.
            tolerance: for the FMUs' own step-size control; by default that of their default experiments.
            engine: "compiled", or "python" (slower, bitwise the same numbers).
            progress: called every 1000 steps with the simulated time since the start [s].
            within: longest time that it may take where FMUs of others run [s].
            sink: gets the signals piece by piece while they arise, for runs too long to be kept; the result has none then.

        Raises:
            UsageError: an unknown name, or an impossible time, step or series.
            SimulationError: an FMU refused a value or failed; the message holds its own words, `partial` what was reached.
        """
        if self._host is None:
            raise UsageError("this Runner is closed: make a new one")
        grid, whole, notes = time_grid(start_time, stop_time, step_size, partial_step)
        settings = self._settings(parameters or {})
        hold = usually_held(self.system) if hold is None else hold
        plan = self._plan(tuple(inputs or {}), tuple(sorted(hold)), None if record is None else tuple(record))
        sampler = Sampler(dict(inputs or {}), grid, plan.held)
        task = Task(
            plan, grid, sampler, settings, whole, step_size, engine, tolerance=tolerance, within=within
        )
        kept = {} if sink is not None else {item.name: np.empty(len(grid)) for item in plan.recorded}
        reached = 0
        try:
            with closing(self._host.run(task, progress)) as found:
                for first, points, rows in found:
                    good, broken = _finite(task, rows)
                    if good:
                        (sink or partial(_keep, kept))(first, _named(task, points[:good], rows[:good]))
                    reached = first + good
                    if broken is not None:
                        raise SimulationError(
                            f"{broken} is not a finite number from t = {grid[reached]:.9g} s on"
                        )
        except SimulationError as error:
            if reached and sink is None:
                error.partial = self._result(task, {n: v[:reached] for n, v in kept.items()}, notes, reached)
                error.partial = dataclasses.replace(error.partial, complete=False)
                error.partial.notes.append(f"incomplete, up to t = {grid[reached - 1]:.9g} s: {error}")
            raise
        return self._result(task, kept, notes, len(grid))

    def coupling_error(self, stop_time: float, step_size: float, **options: Any) -> Result:
        """Simulate with step_size, half and a quarter of it, and estimate the error that the step size causes.

        Args:
            stop_time: [s].
            step_size: the largest of the three steps [s].
            **options: further arguments of `run`.

        Returns:
            The result with `step_size`, its ``errors`` filled for every recorded signal (Richardson's extrapolation with
            the observed order, `cosim.master.convergence`).

        Raises:
            UsageError, SimulationError: as `run`.
        """
        progress, span = options.pop("progress", None), stop_time - options.get("start_time", 0.0)
        runs = []
        for part in (1, 2, 4):

            def advance(now: float, part: int = part) -> None:
                # the runs cost 1, 2 and 4 sevenths of the whole
                progress(((part - 1) * span + part * now) / 7.0)

            shown: dict[str, Any] = {"progress": advance} if progress is not None else {}
            runs.append(self.run(stop_time, step_size / part, **options, **shown))
        result = runs[0]
        errors = {
            name: estimate(result.signals[name], runs[1].signals[name][::2], runs[2].signals[name][::4])
            for name in result.signals
        }
        return dataclasses.replace(result, errors=errors)

    # Helpers

    def _plan(self, inputs: tuple[str, ...], hold: tuple[str, ...], record: tuple[str, ...] | None) -> Plan:
        key = inputs, hold, record
        if key not in self._plans:
            self._plans[key] = make_plan(self.system, inputs, hold, record)
        return self._plans[key]

    def _settings(self, parameters: Mapping[str, Value]) -> dict[Port, Value]:
        """The variables behind the names, each checked for type and right to be set."""
        settings: dict[Port, Value] = {}
        for name, value in parameters.items():
            ports = resolve(self.system, name)
            if not ports:
                raise UsageError(
                    f"there is no '{name}' to set{did_you_mean(name, settable_names(self.system))}"
                )
            for port in ports:
                variable = self.system.variable(port)
                if not variable.can_be_set:
                    raise UsageError(
                        f"'{name}' is a {variable.variability} {variable.causality} and cannot be set"
                    )
                settings[port] = checked_value(name, value, variable)
        return settings

    def _result(self, task: Task, signals: dict[str, Array], notes: list[str], points: int) -> Result:
        plan, host = task.plan, self._host
        assert host is not None
        units, display = {}, {}
        oddities = dict.fromkeys(text for c in self.system.components.values() for text in c.fmu.oddities)
        for item in plan.recorded:
            if item.unit_of.component:
                variable = self.system.variable(item.unit_of)
                units[item.name] = variable.unit
                if variable.display_unit:
                    display[item.name] = DisplayUnit(
                        variable.display_unit, variable.display_factor, variable.display_offset
                    )
        return Result(
            model=self.system.name,
            time=task.grid[:points],
            signals=signals,
            units=units,
            display=display,
            aliases={name: str(port) for name, port in self.system.outputs.items()},
            notes=[*self.system.notes, *oddities, *plan.notes, *notes],
            messages=list(host.messages),
            step_size=task.step_size,
            parameters={str(port): value for port, value in task.settings.items()},
            wall_time=host.wall_time,
        )


def _keep(kept: dict[str, Array], first: int, piece: Mapping[str, Array]) -> None:
    for name, values in piece.items():
        kept[name][first : first + len(values)] = values


def _finite(task: Task, rows: Array) -> tuple[int, str | None]:
    """Rows (m, n_recorded) before the first NaN or infinity, and whose it is, or None.

    NaN passes through every FMU without a word; here it ends.
    """
    good, found = len(rows), None
    places = task.plan.places()
    for item in task.plan.recorded:
        if item.index < 0:
            continue
        bad = np.flatnonzero(~np.isfinite(rows[:good, int(np.searchsorted(places, item.index))]))
        if bad.size:
            good, found = int(bad[0]), item
    if found is None:
        return good, None
    return good, f"component '{found.unit_of.component}': '{found.name}'"


def _named(task: Task, points: Array, rows: Array) -> dict[str, Array]:
    """The recorded signals of a piece (m,), from the inputs (m, n_series) and values (m, n_recorded)."""
    signals = {}
    places = task.plan.places()
    for item in task.plan.recorded:
        source = (
            points[:, item.series] if item.index < 0 else rows[:, int(np.searchsorted(places, item.index))]
        )
        plain = (item.factor, item.offset) == (1.0, 0.0)
        signals[item.name] = source if plain else item.factor * source + item.offset
    return signals
