"""The engine "compiled": a package of our blocks, run as compiled arrays in place of its FMUs.

A chain without feedback can be run block after block over the whole time axis; a block runs again only if its own
parameters or what feeds it changed. The numbers agree with those of the FMUs to 1e-9 of each signal's range
(tests/batch/test_batch_twin.py).
"""

import csv
import dataclasses
import time as clock
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import CompiledBlock, compiled_block
from cosim.errors import ModelError, SimulationError, UsageError
from cosim.master.inputs import Sampler, Series, checked_value, time_grid
from cosim.master.plan import Plan, make_plan
from cosim.master.runner import Sink, usually_held
from cosim.results import DisplayUnit, Result
from cosim.ssp.hints import did_you_mean
from cosim.ssp.read import resolve, settable_names
from cosim.ssp.system import Component, Port, System, Value
from fmus import registry

Array = NDArray[np.float64]
STIMULUS = "stimulus"
GRACE = 1e-9  # s by which a sample may lie behind the time at which it holds, as in fmus/stimulus.py
REMEDY = "take --engine fmu"


class Stimulus:
    """The block that plays a table: its samples over a whole time axis."""

    outputs = ("u",)

    def __init__(self, folder: Path) -> None:
        """Read the table of an unpacked FMU."""
        with (folder / "resources" / "stimulus.csv").open(newline="", encoding="utf-8") as stream:
            rows = [(float(row[0]), float(row[1])) for row in list(csv.reader(stream))[1:]]
        self.times, self.values = np.array(rows).T

    def run(self, time: Array, values: Mapping[str, float]) -> Array:
        """The command (1, n + 1) at `time` (n + 1,) [s]."""
        row = np.maximum(np.searchsorted(self.times, time + GRACE, side="right") - 1, 0)
        found = self.values[row]
        if values["hold"] == 0.0:
            behind = np.minimum(row + 1, self.times.size - 1)
            span = self.times[behind] - self.times[row]
            inside = (span > 0.0) & (time > self.times[row])
            part = np.where(inside, (time - self.times[row]) / np.where(span > 0.0, span, 1.0), 0.0)
            found = found + part * (self.values[behind] - found)
        return np.asarray(values["gain"] * found)[None, :]


@dataclass
class _Kept:
    """What a component was last run with, and what it made of it."""

    values: dict[str, float]
    fed: list[tuple[Array, bool]]
    grid: tuple[float, float, int]
    outputs: Array


class Twin:
    """A system of our blocks, run without its FMUs; used as a `cosim.master.Runner` is.

    Attributes:
        system: what is simulated; the caller closes it.
    """

    def __init__(self, system: System) -> None:
        """Find the compiled twin of every component.

        Raises:
            ModelError: a component is none of our blocks, or its FMU has other equations than this version.
        """
        self.system = system
        self._blocks = {name: _twin(component) for name, component in system.components.items()}
        self._plans: dict[object, Plan] = {}
        self._kept: dict[str, _Kept] = {}
        self._driven: Array | None = None

    def check(self) -> None:
        """See that the system as it is wired can be run.

        Raises:
            ModelError: it has a loop.
        """
        self._plan((), (), None)

    def close(self) -> None:
        """Forget what was kept."""
        self._kept.clear()

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
        progress: Callable[[float], None] | None = None,
        sink: Sink | None = None,
    ) -> Result:
        """Simulate once; arguments, result and errors as those of `cosim.master.Runner.run`.

        Raises:
            UsageError: as there, and where the last step would be shorter, which no array can have.
            ModelError: the system has a loop.
            SimulationError: a value is out of its bounds, or a result no finite number.
        """
        grid, whole, notes = time_grid(start_time, stop_time, step_size, partial_step)
        if whole != len(grid) - 1:
            raise UsageError(f"the compiled engine has no shorter last step: {REMEDY}")
        given = dict(inputs or {})
        hold = usually_held(self.system) if hold is None else hold
        plan = self._plan(tuple(given), tuple(sorted(hold)), None if record is None else tuple(record))
        settings = self._settings(parameters or {})
        begun = clock.perf_counter()
        rows = self._rows(plan, grid, step_size, self._sampled(given, grid, plan.held), settings)
        elapsed = clock.perf_counter() - begun
        result = self._result(plan, grid, rows, settings)
        result = dataclasses.replace(
            result, step_size=step_size, wall_time=elapsed, notes=[*result.notes, *notes]
        )
        if sink is not None:
            sink(0, result.signals)
            result = dataclasses.replace(result, signals={})
        if progress is not None:
            progress(stop_time - start_time)
        return result

    # Helpers

    def _plan(self, inputs: tuple[str, ...], hold: tuple[str, ...], record: tuple[str, ...] | None) -> Plan:
        key = inputs, hold, record
        if key not in self._plans:
            plan = make_plan(self.system, inputs, hold, record)
            loops = [*plan.order.delayed, *plan.initial.delayed]
            if loops:
                raise ModelError(
                    f"'{self.system.name}' has a loop closed by {loops[0]}, which the compiled engine cannot run: {REMEDY}"
                )
            self._plans[key] = plan
        return self._plans[key]

    def _sampled(self, given: dict[str, Series], grid: Array, held: Sequence[bool]) -> Array:
        """Inputs at the communication points (inputs, n + 1); the very array of the last run where nothing changed."""
        new = np.ascontiguousarray(Sampler(given, grid, held).points(0, len(grid) - 1).T)
        if self._driven is None or not np.array_equal(self._driven, new):
            self._driven = new
        return self._driven

    def _settings(self, parameters: Mapping[str, Value]) -> dict[Port, Value]:
        settings: dict[Port, Value] = {}
        for name, value in parameters.items():
            ports = resolve(self.system, name)
            if not ports:
                raise UsageError(
                    f"there is no '{name}' to set{did_you_mean(name, settable_names(self.system))}"
                )
            for port in ports:
                settings[port] = checked_value(name, value, self.system.variable(port))
        return settings

    def _rows(
        self, plan: Plan, grid: Array, h: float, driven: Array, settings: Mapping[Port, Value]
    ) -> list[Array]:
        """Every number of the plan's vector ``values`` over time, (n + 1,) each; copies are those of their sources."""
        rows: list[Array] = [np.empty(0)] * plan.n_outputs
        rows += [driven[k] for k in range(plan.n_series)]
        for c, name in enumerate(plan.order.names):
            fed: dict[int, tuple[Array, bool]] = {}
            for i in range(plan.in_start[c], plan.in_start[c + 1]):
                index = int(plan.in_source[i])
                series = index - plan.n_outputs
                early = series >= plan.n_series or (series >= 0 and plan.held[series])
                values = rows[int(plan.in_initial[i])]
                factor, offset = float(plan.in_factor[i]), float(plan.in_offset[i])
                if (factor, offset) != (1.0, 0.0):
                    values = factor * values + offset
                fed[int(plan.in_reference[i])] = values, early
            outputs = self._component(name, fed, settings, grid, h)
            for j in range(plan.out_start[c], plan.out_start[c + 1]):
                rows[j] = outputs[int(plan.out_reference[j])]
        return rows

    def _component(
        self,
        name: str,
        fed: Mapping[int, tuple[Array, bool]],
        settings: Mapping[Port, Value],
        grid: Array,
        h: float,
    ) -> dict[int, Array]:
        """Real outputs of one component by value reference, (n + 1,) each."""
        component, block = self.system.components[name], self._blocks[name]
        variables = {v.name: v for v in component.fmu.variables.values() if v.kind != "String"}
        starts = {n: v.start for n, v in variables.items() if v.causality in ("parameter", "input")}
        own = {p.variable: v for p, v in settings.items() if p.component == name}
        values = {n: float(v) for n, v in {**starts, **component.starts, **own}.items() if v is not None}
        for n, value in values.items():
            low, high = variables[n].low, variables[n].high
            if not low <= value <= high:
                raise SimulationError(
                    f"component '{name}' refuses {n} = {value!r} {variables[n].unit}: "
                    f"its description allows {low:g} to {high:g}"
                )
        inputs = [v for v in variables.values() if v.causality == "input"]
        ordered = [fed.get(v.reference, (np.full(grid.size, values[v.name]), False)) for v in inputs]
        for variable, (series, _) in zip(inputs, ordered, strict=True):
            if series.min() < variable.low or series.max() > variable.high:
                raise SimulationError(
                    f"component '{name}' refuses its input {variable.name}: it goes from {series.min():g} to "
                    f"{series.max():g} {variable.unit}, the description allows {variable.low:g} to {variable.high:g}"
                )
        outputs = self._run(name, block, values, ordered, grid, h)
        names = block.outputs if isinstance(block, Stimulus) else tuple(block.composed.outputs)
        return {variables[n].reference: outputs[k] for k, n in enumerate(names)}

    def _run(
        self,
        name: str,
        block: "CompiledBlock | Stimulus",
        values: dict[str, float],
        fed: list[tuple[Array, bool]],
        grid: Array,
        h: float,
    ) -> Array:
        kept, axis = self._kept.get(name), (float(grid[0]), h, grid.size)
        if kept and kept.values == values and kept.grid == axis:
            same = zip(kept.fed, fed, strict=True)
            if all(old is new and late == early for (old, late), (new, early) in same):
                return kept.outputs
        if isinstance(block, Stimulus):
            outputs = block.run(grid, values)
        else:
            rows = [series[:-1] if early else series[1:] for series, early in fed]
            first = np.array([series[0] for series, _ in fed])
            inputs = np.array(rows) if rows else np.empty((0, grid.size - 1))
            outputs = block.run(inputs, h, {n: values[n] for n in block.nominal}, first)
        self._kept[name] = _Kept(values, fed, axis, outputs)
        return outputs

    def _result(self, plan: Plan, grid: Array, rows: list[Array], settings: Mapping[Port, Value]) -> Result:
        signals, units, display = {}, {}, {}
        for item in plan.recorded:
            values = rows[item.index if item.index >= 0 else plan.n_outputs + item.series]
            if (item.factor, item.offset) != (1.0, 0.0):
                values = item.factor * values + item.offset
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise SimulationError(
                    f"'{item.name}' is not a finite number from t = {grid[bad[0]]:.9g} s on"
                )
            signals[item.name] = values
            if item.unit_of.component:
                variable = self.system.variable(item.unit_of)
                units[item.name] = variable.unit
                if variable.display_unit:
                    shown = variable.display_unit, variable.display_factor, variable.display_offset
                    display[item.name] = DisplayUnit(*shown)
        return Result(
            model=self.system.name,
            time=grid,
            signals=signals,
            units=units,
            display=display,
            aliases={name: str(port) for name, port in self.system.outputs.items()},
            notes=[*self.system.notes, *plan.notes],
            parameters={str(p): v for p, v in settings.items()},
        )


def _twin(component: Component) -> CompiledBlock | Stimulus:
    """The compiled twin of a component, whose FMU must hold the very equations that are compiled.

    Raises:
        ModelError: there is none.
    """
    fmu = component.fmu
    if fmu.identifier not in registry.BLOCKS or fmu.module is None:
        raise ModelError(
            f"component '{component.name}' is none of our blocks (or one in machine code) and has no compiled twin: {REMEDY}"
        )
    script = (fmu.folder / "resources" / f"{fmu.module[0]}.py").read_text(encoding="utf-8")
    sharing = [name for name, block in registry.FMU_OF_COMPONENT.items() if block == fmu.identifier]
    for acting_on in (fmu.identifier, *sharing):
        twin = compiled_block(fmu.identifier, acting_on)
        if script.startswith(twin.composed.source):
            return Stimulus(fmu.folder) if fmu.identifier == STIMULUS else twin
    raise ModelError(
        f"component '{component.name}': its FMU holds other equations than this version's: build it again "
        f"(cosim build), or {REMEDY}"
    )
