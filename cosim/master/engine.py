"""Runs a plan over instances: initialisation, then the loop, compiled or interpreted with bitwise equal results."""

import ctypes
import signal
import threading
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from types import FrameType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.errors import SimulationError
from cosim.master import marks
from cosim.master.inputs import Sampler
from cosim.master.instance import Instance, status_name
from cosim.master.interpreted import operations, whole
from cosim.master.plan import Plan, References, Whole

Array = NDArray[np.float64]
Room = Callable[[tuple[int, int]], Array]
"""Makes an array of a shape, in memory that somebody else may read."""
EngineName = Literal["compiled", "python"]
CALLS = (
    "fmi2SetReal", "fmi2DoStep", "fmi2GetReal", "fmi2SetInteger", "fmi2SetBoolean", "fmi2GetInteger", "fmi2GetBoolean",
)  # fmt: skip
CHUNK = 1000  # steps between looks at the progress bar: about a tenth of a second
PIECE = 100_000  # steps whose inputs and recorded values are in memory at a time
MOST_SWEEPS = 200


def pieces(whole: int, points: int) -> list[tuple[int, int]]:
    """First and last point of each piece of `whole` steps, and of the shorter last one where there are more points."""
    edges = [*range(0, whole, PIECE), whole, points - 1]
    return [(start, stop) for start, stop in pairwise(edges) if stop > start]


def _one(references: References, room: Whole, i: int) -> tuple[Any, int, Any]:
    """One value reference, a count of one, and where the value is: what a call of FMI for a single number takes."""
    return (
        references[i : i + 1].ctypes.data_as(ctypes.POINTER(ctypes.c_uint)),
        1,
        room[i : i + 1].ctypes.data_as(ctypes.POINTER(ctypes.c_int)),
    )


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
        self.in_whole = np.zeros(len(plan.in_source), dtype=np.int32)
        self.out_whole = np.zeros(plan.n_outputs, dtype=np.int32)
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
            self.instances[c].call("fmi2ExitInitializationMode")
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
        part = slice(plan.in_start[c], plan.in_start[c + 1])
        if part.stop == part.start:
            return
        self.in_values[part] = (
            plan.in_factor[part] * self.values[plan.in_initial[part]] + plan.in_offset[part]
        )
        reals = int(plan.in_reals[c])
        if reals > part.start:
            references = plan.in_reference[part].ctypes.data_as(ctypes.POINTER(ctypes.c_uint))
            new = self.in_values[part].ctypes.data_as(ctypes.POINTER(ctypes.c_double))
            self.instances[c].call("fmi2SetReal", references, reals - part.start, new)
        for i in range(reals, part.stop):
            kind = int(plan.in_kind[i])
            self.in_whole[i] = whole(self.in_values[i], kind)
            self.instances[c].call(CALLS[2 + kind], *_one(plan.in_reference, self.in_whole, i))

    def _get_outputs(self, c: int) -> None:
        plan = self.plan
        part = slice(plan.out_start[c], plan.out_start[c + 1])
        reals = int(plan.out_reals[c])
        if reals > part.start:
            references = plan.out_reference[part].ctypes.data_as(ctypes.POINTER(ctypes.c_uint))
            target = self.values[part].ctypes.data_as(ctypes.POINTER(ctypes.c_double))
            self.instances[c].call("fmi2GetReal", references, reals - part.start, target)
        for i in range(reals, part.stop):
            self.instances[c].call(
                CALLS[4 + int(plan.out_kind[i])], *_one(plan.out_reference, self.out_whole, i)
            )
            self.values[i] = float(self.out_whole[i])

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
        raise SimulationError(
            instance.report(f"failed in {CALLS[call]} at t = {self.time[k]:.9g} s (status {label})")
        )

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """Ctrl-C only sets a flag: raised inside an FMU it would break the FMU instead of ending the run."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def ask_to_stop(_number: int, _frame: FrameType | None) -> None:
            self.stop[0] = 1

        previous = signal.signal(signal.SIGINT, ask_to_stop)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, previous if previous is not None else signal.default_int_handler)

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
        components, setters, getters, steppers = (
            np.array([getattr(instance, name) for instance in self.instances], dtype=np.int64)
            for name in ("pointer", "set_real", "get_real", "do_step")
        )
        tables = Tables(
            time=self.time,
            stop=self.stop,
            table=self.table,
            values=self.values,
            in_values=self.in_values,
            rows=self.rows,
            recorded=self.recorded,
            exact=np.array([not i.component.fmu.ours for i in self.instances], dtype=np.bool_),
            components=components,
            setters=setters,
            getters=getters,
            steppers=steppers,
            whole_setters=np.array(
                [[i.set_integer, i.set_boolean] for i in self.instances], dtype=np.int64
            ).T.copy(),
            whole_getters=np.array(
                [[i.get_integer, i.get_boolean] for i in self.instances], dtype=np.int64
            ).T.copy(),
            in_start=p.in_start,
            in_reals=p.in_reals,
            in_kind=p.in_kind,
            out_reals=p.out_reals,
            out_kind=p.out_kind,
            in_whole=self.in_whole,
            out_whole=self.out_whole,
            in_whole_pointer=int(self.in_whole.ctypes.data),
            out_whole_pointer=int(self.out_whole.ctypes.data),
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
        pick = operations(p, self.instances, self.values, self.in_values, (self.in_whole, self.out_whole), h)
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
