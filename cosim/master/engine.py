"""Runs a plan over instances: initialisation, then the loop, compiled or interpreted with bitwise equal results."""

import signal
import threading
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from types import FrameType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.errors import SimulationError
from cosim.interrupts import HANDLED
from cosim.master import marks
from cosim.master.dialect import FMI2, put, taken
from cosim.master.inputs import Sampler
from cosim.master.instance import DISCARD, Instance, status_name
from cosim.master.interpreted import operations
from cosim.master.plan import Plan

Array = NDArray[np.float64]
Room = Callable[[tuple[int, int]], Array]
"""Makes an array of a shape, in memory that somebody else may read."""
EngineName = Literal["compiled", "python"]
STEP, SET, GET = range(3)
"""What an FMU was asked for in a step: the step, or from SET on, by SET + 2 code and GET + 2 code, numbers of a type."""
CHUNK = 1000  # steps between looks at the progress bar: about a tenth of a second
PIECE = 100_000  # steps whose inputs and recorded values are in memory at a time
MOST_SWEEPS = 200


def pieces(whole: int, points: int) -> list[tuple[int, int]]:
    """First and last point of each piece of `whole` steps, and of the shorter last one where there are more points."""
    edges = [*range(0, whole, PIECE), whole, points - 1]
    return [(start, stop) for start, stop in pairwise(edges) if stop > start]


def call_name(instance: Instance, call: int) -> str:
    """The function of FMI that a number of the loop stands for."""
    dialect = instance.dialect
    if call == STEP:
        return f"{dialect.prefix}DoStep"
    code, way = divmod(call - SET, 2)
    return f"{dialect.prefix}{'Get' if way else 'Set'}{dialect.types[code]}"


class Engine:
    """One simulation: a plan, its instances and its numbers.

    Time, inputs and recorded values of the loop are those of a piece of at most PIECE steps, so that hours cost no more
    memory than minutes; ``n`` counts the steps of a piece.

    Attributes:
        values: all numbers of a step (see `Plan`), shape (n_values,).
        time: communication points of the piece [s], shape (n + 1,).
        table: what the system's inputs hand over in each step, shape (n, n_series).
        rows: recorded values, row k at time k, shape (n + 1, n_recorded).
        recorded: their places in `values`, shape (n_recorded,), increasing.
        reached: steps of the piece that were made.
        wall_time: duration of the loop so far [s].
    """

    def __init__(
        self,
        plan: Plan,
        instances: Sequence[Instance],
        grid: Array,
        sampler: Sampler,
        room: Room = np.empty,
    ) -> None:
        """Allocate what the loop needs throughout.

        Args:
            plan: the tables.
            instances: in stepping order.
            grid: all communication points [s].
            sampler: the system's inputs at these points.
            room: gives the memory of `rows`.
        """
        self.plan, self.instances, self.grid, self.sampler = plan, instances, grid, sampler
        self.room, self.reached = room, 0
        self.values = np.zeros(plan.n_values)
        self.in_values = np.zeros(len(plan.in_source))
        self.in_slots = np.zeros(len(plan.in_source), dtype=np.int64)
        self.out_slots = np.zeros(plan.n_outputs, dtype=np.int64)
        self.answers = np.zeros(4, dtype=np.int64)  # what a step of FMI 3.0 says beside its status
        self.recorded = plan.places()
        self.stop = np.zeros(1, dtype=np.int64)
        self.wall_time = 0.0
        self._scale = np.zeros(plan.n_values)  # largest value met of each number, while loops are iterated

    def _open(self, first: int, last: int) -> Array:
        """Make room for the steps `first` to `last`; returns the inputs at their points (n + 1, n_series)."""
        points = self.sampler.points(first, last)
        marks.table[marks.STEP] = 0
        self.time = self.grid[first : last + 1]
        self.table = np.ascontiguousarray(self.sampler.steps(points))
        # a signal is one piece of memory: the result needs no transposed copy
        self.rows = self.room((len(self.recorded), last - first + 1)).T
        self.rows[0] = self.values[self.recorded]
        return points

    # Initialisation: everything is of the same instant

    def initialise(self, first_inputs: Array) -> None:
        """Propagate start values in initialisation mode, to a fixed point where there are loops, and leave the mode.

        Args:
            first_inputs: values of the system's inputs at the start, shape (n_series,).

        Raises:
            SimulationError: a component fails, or a loop has no fixed point that repeated substitution finds.
        """
        plan = self.plan
        self.values[plan.n_outputs : plan.n_outputs + plan.n_series] = first_inputs
        places = [plan.order.names.index(name) for name in plan.initial.names]
        for _ in range(MOST_SWEEPS):
            before = self.values.copy()
            for c in places:
                self._exchange(c)
            if not plan.initial.delayed or self._settled(before):
                break
        else:
            moved = self._unsettled(before)
            raise SimulationError(
                f"the loop closed by {', '.join(map(str, plan.initial.delayed))} finds no common start values in "
                f"{MOST_SWEEPS} sweeps (still moving: {moved}): break it with a component that has a state"
            )
        for c in places:
            self._set_inputs(c)
            self.instances[c].call("ExitInitializationMode")
            self._get_outputs(c)

    def _exchange(self, c: int) -> None:
        self._set_inputs(c)
        self._get_outputs(c)

    def _settled(self, before: Array) -> bool:
        self._scale = np.maximum(self._scale, np.abs(self.values))
        return bool(np.all(np.abs(self.values - before) <= 1e-13 * self._scale))

    def _unsettled(self, before: Array) -> str:
        change = np.abs(self.values - before)[: self.plan.n_outputs]
        c = int(np.searchsorted(self.plan.out_start, int(np.nanargmax(change)), side="right")) - 1
        return f"an output of '{self.plan.order.names[c]}'"

    def _set_inputs(self, c: int) -> None:
        plan = self.plan
        part = slice(int(plan.in_start[c]), int(plan.in_start[c + 1]))
        if part.stop == part.start:
            return
        self.in_values[part] = (
            plan.in_factor[part] * self.values[plan.in_initial[part]] + plan.in_offset[part]
        )
        reals, references = int(plan.in_reals[c]), int(plan.in_reference.ctypes.data)
        if reals > part.start:
            values = int(self.in_values.ctypes.data) + 8 * part.start
            self.instances[c].transfer("Set", 0, references + 4 * part.start, reals - part.start, values)
        for i in range(reals, part.stop):
            code = int(plan.in_kind[i])
            put(self.in_slots, i, float(self.in_values[i]), code)
            self.instances[c].transfer(
                "Set", code, references + 4 * i, 1, int(self.in_slots.ctypes.data) + 8 * i
            )

    def _get_outputs(self, c: int) -> None:
        plan = self.plan
        part = slice(int(plan.out_start[c]), int(plan.out_start[c + 1]))
        reals, references = int(plan.out_reals[c]), int(plan.out_reference.ctypes.data)
        if reals > part.start:
            values = int(self.values.ctypes.data) + 8 * part.start
            self.instances[c].transfer("Get", 0, references + 4 * part.start, reals - part.start, values)
        for i in range(reals, part.stop):
            code, place = int(plan.out_kind[i]), int(self.out_slots.ctypes.data) + 8 * i
            self.instances[c].transfer("Get", code, references + 4 * i, 1, place)
            self.values[i] = taken(self.out_slots, i, code)

    # The loop

    def run(
        self, whole: int, h: float, engine: EngineName, progress: Callable[[float], None] | None
    ) -> Iterator[tuple[int, Array, Array]]:
        """Make `whole` steps with step size h [s], and a shorter last one where the grid has it, piece by piece.

        FMUs of others get as step size what lies between the two communication points to the last bit (t[i+1] = t[i] + h[i],
        FMI 2.0, 4.2.1): some count their own steps up to that sum, and one bit more is a step too many.

        Yields:
            (index of the first point, the inputs (m, n_series), recorded values (m, n_recorded)); the pieces follow each
            other without gap or overlap, and belong to the caller. Before an error comes what was reached of its piece.

        Raises:
            SimulationError: a component answered with Discard, Error or Fatal.
            KeyboardInterrupt: Ctrl-C, after the step in progress.
        """
        for start, stop in pieces(whole, len(self.grid)):
            points = self._open(start, stop)
            size = h if stop <= whole else float(self.grid[-1] - self.grid[-2])
            new = 1 if start else 0  # a piece's first point is the last of the one before
            try:
                self._advance(stop - start, size, engine, progress)
            except SimulationError:
                end = self.reached + 1
                yield start + new, points[new:end], self.rows[new:end]
                raise
            yield start + new, points[new:], self.rows[new:]

    def _advance(
        self, count: int, h: float, engine: EngineName, progress: Callable[[float], None] | None
    ) -> None:
        """Make the steps of the piece that is open."""
        step = self._compiled(h) if engine == "compiled" else self._interpreted(h)
        step(0, 0)  # loads the compiled code, which shall not count as time of the loop
        begun = clock.perf_counter()
        with self._interruptible(), self._marked():
            k = 0
            while k < count:
                k, c, call, status = step(k, min(k + CHUNK, count))
                self.reached = k
                if c >= 0:
                    self._fail(k, c, call, status)
                if self.stop[0]:
                    raise KeyboardInterrupt
                if progress is not None:
                    progress(float(self.time[k] - self.grid[0]))
        self.wall_time += clock.perf_counter() - begun

    def _fail(self, k: int, c: int, call: int, status: int) -> None:
        instance = self.instances[c]
        instance.failed(status)
        label = status_name(status)
        said = instance.report(
            f"failed in {call_name(instance, call)} at t = {self.time[k]:.9g} s (status {label})"
        )
        if status == DISCARD and instance.component.fmu.module is not None and not instance.messages:
            said += (
                ": so a Python FMU answers whose do_step does not end with 'return True', or that takes no steps of "
                f"{self.grid[1] - self.grid[0]:.9g} s"
            )
        raise SimulationError(said)

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """Ctrl-C, and SIGTERM where it is one, only set a flag: raised inside an FMU they would break it."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def ask_to_stop(_number: int, _frame: FrameType | None) -> None:
            self.stop[0] = 1

        # what is ignored (nohup) or ends the process stays so
        before = {s: signal.signal(s, ask_to_stop) for s in HANDLED if callable(signal.getsignal(s))}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    @contextmanager
    def _marked(self) -> Iterator[None]:
        marks.enter(marks.LOOP, 0)
        try:
            yield
        finally:
            marks.enter(marks.OURS, 0)

    def _compiled(self, h: float) -> Callable[[int, int], tuple[int, int, int, int]]:
        from cosim.master.compiled import Tables, advance

        p = self.plan
        components, steppers = (
            np.array([getattr(instance, name) for instance in self.instances], dtype=np.int64)
            for name in ("pointer", "do_step")
        )
        tables = Tables(
            time=self.time,
            stop=self.stop,
            table=self.table,
            values=self.values,
            in_values=self.in_values,
            rows=self.rows.T,
            recorded=self.recorded,
            exact=np.array([not i.component.fmu.ours for i in self.instances], dtype=np.bool_),
            third=np.array([i.dialect is not FMI2 for i in self.instances], dtype=np.bool_),
            answers=self.answers,
            answers_pointer=int(self.answers.ctypes.data),
            components=components,
            setters=np.array([i.setters for i in self.instances], dtype=np.int64).T.copy(),
            getters=np.array([i.getters for i in self.instances], dtype=np.int64).T.copy(),
            steppers=steppers,
            in_start=p.in_start,
            in_reals=p.in_reals,
            in_kind=p.in_kind,
            out_reals=p.out_reals,
            out_kind=p.out_kind,
            in_slots=self.in_slots,
            out_slots=self.out_slots,
            in_singles=self.in_slots.view(np.float32),
            out_singles=self.out_slots.view(np.float32),
            in_slots_pointer=int(self.in_slots.ctypes.data),
            out_slots_pointer=int(self.out_slots.ctypes.data),
            in_source=p.in_source,
            in_factor=p.in_factor,
            in_offset=p.in_offset,
            out_start=p.out_start,
            snapshots=p.snapshots,
            n_outputs=p.n_outputs,
            in_references=int(p.in_reference.ctypes.data),
            out_references=int(p.out_reference.ctypes.data),
            in_pointer=int(self.in_values.ctypes.data),
            out_pointer=int(self.values.ctypes.data),
            marks=marks.table,
        )

        def step(first: int, last: int) -> tuple[int, int, int, int]:
            return advance(first, last, h, tables)

        return step

    def _interpreted(self, h: float) -> Callable[[int, int], tuple[int, int, int, int]]:
        """The same loop in Python, for machines without numba's compiler; the same calls with the same numbers."""
        p = self.plan
        slots = (self.in_slots, self.out_slots)
        pick = operations(p, self.instances, self.values, self.in_values, slots, h)
        n_series = p.n_series
        copies = list(enumerate(map(int, p.snapshots)))
        values, base = self.values, p.n_outputs

        def step(first: int, last: int) -> tuple[int, int, int, int]:
            for k in range(first, last):
                if self.stop[0]:
                    return k, -1, 0, 0
                marks.table[marks.STEP] = k
                values[base : base + n_series] = self.table[k]
                for d, source in copies:
                    values[base + n_series + d] = values[source]
                time, until = float(self.time[k]), float(self.time[k + 1])
                for c, operate in enumerate(pick):
                    marks.table[marks.STEPPED] = c
                    call, status = operate(time, until)
                    if status > 1 or status < 0:
                        return k, c, call, status
                self.rows[k + 1] = values[self.recorded]
            return last, -1, 0, 0

        return step
