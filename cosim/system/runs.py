"""Runs the units of a system over series: what enters on a uniform grid, what leaves on the same grid.

Each unit has FMU instances of its own, made once and reset between runs; those of others live in a watched process
(`cosim.master`), and begin each run by the state that they had at first where they have one to set and it was seen to give
the same, else anew. A run that was made before is not made again, nor one that superposition tells (`superposition`).
"""

import hashlib
import math
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from cosim.errors import OutOfTimeError, SimulationError
from cosim.master import Limits, Runner
from cosim.results import Result
from cosim.ssp.system import Component, Fmu, Port, System, Value, Wire
from cosim.system.graph import Unit
from cosim.system.superposition import Superposition

Array = NDArray[np.float64]
Series = Mapping[Port, Array]
KEPT = 64  # runs whose outputs are remembered
LOADED = 2  # processes that start at a time
MOST_SUBSTEPS = 20  # of one interval of the log
SLOWER = 20.0  # times the model's own run: a candidate that takes longer makes an FMU crawl
LEAST_TIME = 10.0  # s; below it a run is no matter, and the clock of a busy machine tells little
TIGHTER = 0.01  # times the tolerance that an FMU is usually given
PART = 1.5  # an interval up to this many times the FMU's own step is made in one


class Runs:
    """All units of a system; a context manager.

    Attributes:
        took: time that the last run of each unit took [s].
        count: runs of units that were made.
        steps: communication steps that they took.
        runners: made so far.
        stop: told of a Ctrl-C in a run; True if what runs will end by itself soon.
        left: tells how long a run may take, s; one that takes longer is cut off, and none begins where nothing is left.
    """

    def __init__(self, system: System, limits: Limits | None = None, apart: bool | None = None) -> None:
        """Nothing is loaded before it is run.

        Args:
            system: what is cut into units; it must outlive this.
            limits: of the processes in which FMUs of others run.
            apart: whether units run in processes of their own; by default those with an FMU that is not ours.
        """
        self.system, self.limits, self.apart = system, limits or Limits.usual(), apart
        self.usual: dict[tuple[str, ...], float] = {}  # time that a step of each unit took at first [s]
        self.took: dict[tuple[str, ...], float] = {}
        self.count = self.steps = 0
        self.stop: Callable[[], bool] = lambda: False
        self.left: Callable[[], float] = lambda: math.inf
        self.runners: dict[tuple[str, ...], Runner] = {}
        self._proved: set[tuple[str, ...]] = set()  # units whose restarts were tried
        self._renewed: set[tuple[str, ...]] = set()  # those whose restarts did not give the same
        self._kept: OrderedDict[bytes, dict[Port, Array]] = OrderedDict()
        self._linear: dict[tuple[str, ...], Superposition] = {}
        self._exact = False
        self._finer = 1  # parts of each communication step
        self._beside: list[System] = []  # where components of our own come from

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def spared(self) -> int:
        """Runs that superposition spared."""
        return sum(item.used for item in self._linear.values())

    def close(self) -> None:
        """Free all FMUs."""
        for runner in self.runners.values():
            runner.close()
        self.runners.clear()
        for own in self._beside:
            own.close()
        self._beside.clear()

    def add(self, own: System, name: str, wires: Sequence[Wire]) -> None:
        """Put a component of our own beside those of the system: units that hold it are run with these wires.

        Args:
            own: its FMU, as it was read; closed with this.
            name: of the component in units.
            wires: between it and components of the system.
        """
        self._beside.append(own)
        (component,) = own.components.values()
        # it takes whatever step the others take
        fmu = replace(component.fmu, step_size=None)
        self.system = replace(
            self.system,
            components={**self.system.components, name: Component(name, fmu, component.starts)},
            wires=(*self.system.wires, *wires),
        )

    def load(self, units: Sequence[Unit]) -> None:
        """Load the FMUs of some units side by side: each process of its own takes seconds to start.

        Raises:
            ModelError, SimulationError: one cannot be loaded.
        """
        with ThreadPoolExecutor(LOADED) as pool:
            list(pool.map(self._runner, units))

    def forget(self) -> None:
        """Make every run anew from here on."""
        self._kept.clear()

    @contextmanager
    def uncut(self) -> Iterator[None]:
        """Within this no run is cut off for the time that is left: what was found is decided upon."""
        before, self.left = self.left, lambda: math.inf
        try:
            yield
        finally:
            self.left = before

    @contextmanager
    def exact(self) -> Iterator[None]:
        """Within this nothing is superposed: every run that was not kept is made."""
        before, self._exact = self._exact, True
        try:
            yield
        finally:
            self._exact = before

    def _declared(self, unit: Unit) -> list[float]:
        """Steps [s] that the FMUs of a unit declare as their own."""
        return [s for c in unit.components if (s := self.system.components[c].fmu.step_size)]

    def substeps(self, unit: Unit, h: float) -> int:
        """Communication steps in one interval of the log [s]: FMUs that declare a step are not asked for longer ones."""
        least = min(self._declared(unit), default=h)
        if h <= PART * least:
            return 1
        return min(int(np.ceil(h / least - 1e-6)), MOST_SUBSTEPS)

    def run(
        self,
        unit: Unit,
        start: float,
        h: float,
        inputs: Series,
        outputs: tuple[Port, ...],
        parameters: Mapping[str, Value],
    ) -> dict[Port, Array]:
        """Outputs of a unit at the n points of the grid.

        Args:
            unit: what is run.
            start: first point [s].
            h: interval of the grid [s].
            inputs: port -> values (n,); where there are none, `outputs` of no input need a length: give at least one, or
                use `free_run`.
            outputs: ports to record.
            parameters: ``component.parameter`` -> value.

        Raises:
            SimulationError: a component failed; the message holds its own words.
        """
        count = next(iter(inputs.values())).size
        return self._run(unit, start, h, count, inputs, outputs, parameters)

    def free_run(
        self,
        unit: Unit,
        start: float,
        h: float,
        count: int,
        outputs: tuple[Port, ...],
        parameters: Mapping[str, Value],
    ) -> dict[Port, Array]:
        """As `run`, for a unit that nothing drives, at `count` points."""
        return self._run(unit, start, h, count, {}, outputs, parameters)

    @contextmanager
    def finer(self) -> Iterator[None]:
        """Within this steps are made in two and solvers are asked for a finer tolerance; the inputs over each step stay.

        What then changes is the error of the FMUs' own solvers.
        """
        self._finer = 2
        kept, self.runners = self.runners, {}
        self.forget()
        try:
            with self.exact():
                yield
        finally:
            self._finer = 1
            fine, self.runners = self.runners, kept
            for runner in fine.values():
                runner.close()
            self.forget()

    def can_halve(self, unit: Unit, h: float) -> bool:
        """Whether half a communication step is no shorter than the step that an FMU declares as its own."""
        return all(2 * self.substeps(unit, h) * s <= h * (1.0 + 1e-6) for s in self._declared(unit))

    def _fine(self, port: Port, values: Array, parts: int) -> Array:
        """An input (n,) at the ends of all steps where each of `parts` in an interval is made in two."""
        at = np.arange((values.size - 1) * parts + 1) / parts
        steps = np.interp(at, np.arange(values.size), values)
        if self.system.variable(port).variability == "discrete":  # a step takes the value at its start
            return np.repeat(steps, 2)[:-1]
        return np.repeat(steps, 2)[1:]

    def _run(
        self,
        unit: Unit,
        start: float,
        h: float,
        count: int,
        inputs: Series,
        outputs: tuple[Port, ...],
        parameters: Mapping[str, Value],
    ) -> dict[Port, Array]:
        own = {n: v for n, v in parameters.items() if n.partition(".")[0] in unit.components}
        key = self._key(unit, start, h, count, inputs, outputs, own)
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        moving = [p for p in inputs if self._moves(p)]
        made = partial(self._made, unit, start, h, count, outputs, own)
        if self._exact or not moving:
            found = made(inputs)
        else:
            still = self._key(
                unit, start, h, count, {p: inputs[p] for p in inputs if p not in moving}, outputs, own
            )
            found = self._linear.setdefault(unit.components, Superposition()).outputs(
                still, inputs, moving, made
            )
        self._kept[key] = found
        if len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return found

    def _moves(self, port: Port) -> bool:
        """Whether an input is a continuous quantity."""
        variable = self.system.variable(port)
        return variable.kind == "Real" and variable.variability != "discrete"

    def _made(
        self,
        unit: Unit,
        start: float,
        h: float,
        count: int,
        outputs: tuple[Port, ...],
        own: Mapping[str, Value],
        inputs: Series,
    ) -> dict[Port, Array]:
        """Make a run."""
        parts = self.substeps(unit, h)
        stop = start + (count - 1) * h
        stamps = start + np.arange(count) * h
        stamps[-1] = stop
        runner = self._runner(unit)
        if self._finer > 1:
            inputs = {p: self._fine(p, v, parts) for p, v in inputs.items()}
            parts *= 2
            stamps = start + np.arange((count - 1) * parts + 1) * (h / parts)
            stamps[-1] = stop
        self.count += 1
        self.steps += (count - 1) * parts
        once = partial(
            runner.run,
            stop,
            h / parts,
            start_time=start,
            parameters=own,
            inputs={str(port): (stamps, values) for port, values in inputs.items()},
            hold=(),
            record=[str(port) for port in outputs],
        )
        result = self._in_time(unit, once, (count - 1) * parts)
        self._prove(unit, once, result)
        return {port: np.ascontiguousarray(result.signals[str(port)][::parts]) for port in outputs}

    def _in_time(self, unit: Unit, once: Callable[..., Result], steps: int) -> Result:
        """One run, ended where it takes far longer than the unit did at first, or longer than any diagnosis can wait.

        Raises:
            SimulationError: it did, or failed.
            OutOfTimeError: nothing is left of the time for runs.
        """
        most, known = self.limits.run, self.usual.get(unit.components)
        if known is not None:
            most = min(most, max(SLOWER * known * steps, LEAST_TIME))
        left = self.left()
        if left <= 0.0:
            raise OutOfTimeError("the time for runs was over")
        begun = time.monotonic()
        try:
            result = once(within=min(most, left))
        except KeyboardInterrupt:  # our own FMUs hear it within their loop
            if not self.stop():
                raise
            result = once()
        except SimulationError as error:
            if self.left() <= 0.0:
                raise OutOfTimeError(str(error)) from None
            if known is not None or time.monotonic() - begun < most:
                raise
            raise SimulationError(
                f"{error}; a diagnosis needs hundreds of runs of the log's length. What drives it may be wrong (columns, "
                "units, signs in the mapping); else take a shorter log, or allow more by COSIM_RUN (seconds)"
            ) from None
        self.took[unit.components] = time.monotonic() - begun
        self.usual.setdefault(unit.components, self.took[unit.components] / steps)
        return result

    def _prove(self, unit: Unit, once: Callable[..., Result], first: Result) -> None:
        """See whether a unit that restarts by its state gives what a new instance gave; if not it is made anew each time."""
        if (
            self._finer > 1
            or unit.components in self._proved
            or not any(self._restarts(unit, self.system.components[c].fmu) for c in unit.components)
        ):
            return
        self._proved.add(unit.components)
        self.count += 1
        try:
            again = once(within=max(self.left(), 0.0))
            same = all(np.array_equal(again.signals[n], v, equal_nan=True) for n, v in first.signals.items())
        except SimulationError:
            if self.left() <= 0.0:
                self._proved.discard(unit.components)
                return
            same = False
        except KeyboardInterrupt:
            if not self.stop():
                raise
            same = False
        if not same:
            self._renewed.add(unit.components)
            self.runners.pop(unit.components).close()

    def _restarts(self, unit: Unit, fmu: Fmu) -> bool:
        """Whether an FMU of others is to restart by its state, which spares the loading of its library."""
        return (
            fmu.keeps_state and not fmu.ours and fmu.module is None and unit.components not in self._renewed
        )

    def _tolerance(self, fmu: Fmu) -> float | None:
        if fmu.tolerance is None or self._finer == 1:
            return fmu.tolerance
        return TIGHTER * fmu.tolerance

    def _runner(self, unit: Unit) -> Runner:
        if unit.components not in self.runners:
            inside = set(unit.components)
            part = replace(
                self.system,
                components={
                    n: replace(
                        c,
                        fmu=replace(
                            c.fmu, restarts=self._restarts(unit, c.fmu), tolerance=self._tolerance(c.fmu)
                        ),
                    )
                    for n, c in self.system.components.items()
                    if n in inside
                },
                wires=tuple(
                    w
                    for w in self.system.wires
                    if w.source.component in inside and w.target.component in inside
                ),
                inputs={},
                outputs={},
                parameters={},
                notes=[],
                folder=None,
            )
            self.runners[unit.components] = Runner(part, apart=self.apart, limits=self.limits, many=True)
        return self.runners[unit.components]

    def _key(
        self,
        unit: Unit,
        start: float,
        h: float,
        count: int,
        inputs: Series,
        outputs: tuple[Port, ...],
        parameters: Mapping[str, Value],
    ) -> bytes:
        asked = unit, start, h, count, outputs, sorted(parameters.items()), self._finer
        digest = hashlib.blake2b(repr(asked).encode())
        for port, values in inputs.items():
            digest.update(str(port).encode())
            digest.update(np.ascontiguousarray(values).tobytes())
        return digest.digest()
