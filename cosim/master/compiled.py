"""The loop, compiled: numba calls the FMUs' C functions by address. Holds Python's lock, which pythonfmu's FMUs need."""

from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from cosim.master.dialect import BOOLEAN, HIGHS, IN_SLOTS, LOWS, SINGLE
from cosim.master.instance import EARLY, ENDED
from cosim.master.marks import STEP, STEPPED
from cosim.master.plan import Array, Flags, Index

_SET_GET = types.int32(types.int64, types.int64, types.int64, types.int64, types.int64)
_STEP = types.int32(types.int64, types.int64, types.float64, types.float64)
_STEP3 = types.int32(types.int64, types.int64, types.float64, types.float64, types.int64)
_LOWS, _HIGHS = np.array(LOWS), np.array(HIGHS)
_SPARE = np.array([64 - 8 * np.dtype(name).itemsize for name in IN_SLOTS], dtype=np.int64)  # bits of a slot
_SIGNED = np.array([np.dtype(name).kind == "i" for name in IN_SLOTS], dtype=np.bool_)


def _call_real(
    typing_context: Any, function: Any, component: Any, references: Any, count: Any, values: Any
) -> Any:
    """fmi2SetReal or fmi2GetReal at an address; every pointer is an int64 (FMI 2.0, section 2.1.7)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, size = ir.IntType(8).as_pointer(), ir.IntType(64)
        kind = ir.FunctionType(ir.IntType(32), [pointer, pointer, size, pointer])
        target, component, references, count, values = arguments
        callee = builder.inttoptr(target, kind.as_pointer())
        pointers = [builder.inttoptr(a, pointer) for a in (component, references, values)]
        return builder.call(callee, [pointers[0], pointers[1], count, pointers[2]])

    return _SET_GET, generate


def _call_real3(
    typing_context: Any, function: Any, component: Any, references: Any, count: Any, values: Any
) -> Any:
    """A function of FMI 3.0 that sets or gets values, which is told their number too (FMI 3.0, section 2.2.6)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, size = ir.IntType(8).as_pointer(), ir.IntType(64)
        kind = ir.FunctionType(ir.IntType(32), [pointer, pointer, size, pointer, size])
        target, component, references, count, values = arguments
        callee = builder.inttoptr(target, kind.as_pointer())
        pointers = [builder.inttoptr(a, pointer) for a in (component, references, values)]
        return builder.call(callee, [pointers[0], pointers[1], count, pointers[2], count])

    return _SET_GET, generate


def _call_step(typing_context: Any, function: Any, component: Any, time: Any, step: Any) -> Any:
    """fmi2DoStep at an address, with noSetFMUStatePriorToCurrentPoint = true (FMI 2.0, section 4.2.2)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, real, integer = ir.IntType(8).as_pointer(), ir.DoubleType(), ir.IntType(32)
        kind = ir.FunctionType(integer, [pointer, real, real, integer])
        target, component, time, step = arguments
        callee = builder.inttoptr(target, kind.as_pointer())
        return builder.call(
            callee, [builder.inttoptr(component, pointer), time, step, ir.Constant(integer, 1)]
        )

    return _STEP, generate


def _call_step3(
    typing_context: Any, function: Any, component: Any, time: Any, step: Any, answers: Any
) -> Any:
    """fmi3DoStep at an address; its four answers are laid eight bytes apart (FMI 3.0, section 4.2.1.2)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, real, integer = ir.IntType(8).as_pointer(), ir.DoubleType(), ir.IntType(32)
        kind = ir.FunctionType(integer, [pointer, real, real, integer, *[pointer] * 4])
        target, component, time, step, answers = arguments
        callee = builder.inttoptr(target, kind.as_pointer())
        places = [builder.add(answers, ir.Constant(ir.IntType(64), 8 * k)) for k in range(4)]
        pointers = [builder.inttoptr(a, pointer) for a in (component, *places)]
        return builder.call(callee, [pointers[0], time, step, ir.Constant(integer, 1), *pointers[1:]])

    return _STEP3, generate


call_real: Any = intrinsic(_call_real)
call_real3: Any = intrinsic(_call_real3)
call_step: Any = intrinsic(_call_step)
call_step3: Any = intrinsic(_call_step3)


Singles = NDArray[np.float32]


class Tables(NamedTuple):
    """Everything the loop reads and writes; `cosim.master.plan.Plan` and `cosim.master.engine.Engine` say what it means.

    Attributes:
        exact: for each component, whether a step is what lies between two communication points to the last bit.
        third: for each component, whether it is one of FMI 3.0.
        answers, answers_pointer: what a step of FMI 3.0 says beside its status, shape (4,), and where.
        rows: recorded values, a signal in one piece of memory, shape (n_recorded, n + 1): with one signal, too, the same
            kind of array to numba, so that the loop is compiled once.
        components, steppers: address of each FMU's component and of its function for a step, shape (c,).
        setters, getters: addresses of its functions by the code of the type, shape (codes, c).
        in_slots, out_slots: room for what is not Real (`cosim.master.dialect`), in the order of the inputs and outputs.
        in_singles, out_singles: the same memory as numbers of single precision, two to a slot.
        in_references, out_references, in_pointer, out_pointer: addresses of the arrays of value references, of
            `in_values` and of `values`; the arrays must outlive the call.
        in_slots_pointer, out_slots_pointer: those of the slots.
        marks: see `cosim.master.marks`.
    """

    time: Array
    stop: Index
    table: Array
    values: Array
    in_values: Array
    rows: Array
    recorded: Index
    exact: Flags
    third: Flags
    answers: Index
    components: Index
    setters: Index
    getters: Index
    steppers: Index
    in_start: Index
    in_reals: Index
    in_kind: Index
    in_source: Index
    in_factor: Array
    in_offset: Array
    out_start: Index
    out_reals: Index
    out_kind: Index
    in_slots: Index
    out_slots: Index
    in_singles: Singles
    out_singles: Singles
    snapshots: Index
    n_outputs: int
    in_references: int
    out_references: int
    in_pointer: int
    out_pointer: int
    in_slots_pointer: int
    out_slots_pointer: int
    answers_pointer: int
    marks: Index


@numba.njit(cache=True)
def put(slots: Index, singles: Singles, i: int, value: float, code: int) -> None:
    """As `cosim.master.dialect.put`."""
    if code == BOOLEAN:
        slots[i] = 1 if abs(value) >= 0.5 else 0
    elif code == SINGLE:
        singles[2 * i] = value
    else:
        slots[i] = int(min(max(np.floor(value + 0.5), _LOWS[code]), _HIGHS[code]))


@numba.njit(cache=True)
def taken(slots: Index, singles: Singles, i: int, code: int) -> float:
    """As `cosim.master.dialect.taken`."""
    if code == SINGLE:
        return float(singles[2 * i])
    spare = _SPARE[code]
    if _SIGNED[code]:
        return float((slots[i] << spare) >> spare)
    if spare:
        return float(slots[i] & ((1 << (64 - spare)) - 1))
    return float(np.uint64(slots[i]))


@numba.njit(cache=True)
def transfer(third: bool, function: int, component: int, references: int, count: int, values: int) -> int:
    """Set or get `count` values."""
    if third:
        return int(call_real3(function, component, references, count, values))
    return int(call_real(function, component, references, count, values))


@numba.njit(cache=True)
def advance(first: int, last: int, h: float, t: Tables) -> tuple[int, int, int, int]:
    """Make the steps `first` to `last` with step size h [s].

    Returns:
        (step reached, component, call, status): component is -1 when all went well or ``stop[0]`` was set; call is a number
        as `cosim.master.engine` has them.
    """
    n_series = t.table.shape[1]
    for k in range(first, last):
        if t.stop[0]:
            return k, -1, 0, 0
        t.marks[STEP] = k
        for j in range(n_series):
            t.values[t.n_outputs + j] = t.table[k, j]
        for d in range(len(t.snapshots)):
            t.values[t.n_outputs + n_series + d] = t.values[t.snapshots[d]]
        for c in range(len(t.components)):
            t.marks[STEPPED] = c
            third, component = t.third[c], t.components[c]
            a, b = t.in_start[c], t.in_start[c + 1]
            new = False
            for i in range(a, b):
                value = t.in_factor[i] * t.values[t.in_source[i]] + t.in_offset[i]
                new |= value != t.in_values[i]
                t.in_values[i] = value
            if new:  # an input keeps its value until it is set again
                m = t.in_reals[c]
                if m > a:
                    status = transfer(
                        third, t.setters[0, c], component, t.in_references + 4 * a, m - a, t.in_pointer + 8 * a
                    )  # fmt: skip
                    if status > 1 or status < 0:
                        return k, c, 1, status
                for i in range(m, b):
                    code = t.in_kind[i]
                    put(t.in_slots, t.in_singles, i, t.in_values[i], code)
                    place = t.in_slots_pointer + 8 * i
                    status = transfer(third, t.setters[code, c], component, t.in_references + 4 * i, 1, place)
                    if status > 1 or status < 0:
                        return k, c, 1 + 2 * code, status
            size = t.time[k + 1] - t.time[k] if t.exact[c] else h
            if third:
                t.answers[1] = t.answers[2] = 0
                status = call_step3(t.steppers[c], component, t.time[k], size, t.answers_pointer)
                if 0 <= status <= 1 and t.answers[1] & 255:
                    status = ENDED
                elif 0 <= status <= 1 and t.answers[2] & 255:
                    status = EARLY
            else:
                status = call_step(t.steppers[c], component, t.time[k], size)
            if status > 1 or status < 0:
                return k, c, 0, status
            a, b = t.out_start[c], t.out_start[c + 1]
            m = t.out_reals[c]
            if m > a:
                status = transfer(
                    third, t.getters[0, c], component, t.out_references + 4 * a, m - a, t.out_pointer + 8 * a
                )  # fmt: skip
                if status > 1 or status < 0:
                    return k, c, 2, status
            for i in range(m, b):
                code = t.out_kind[i]
                place = t.out_slots_pointer + 8 * i
                status = transfer(third, t.getters[code, c], component, t.out_references + 4 * i, 1, place)
                if status > 1 or status < 0:
                    return k, c, 2 + 2 * code, status
                t.values[i] = taken(t.out_slots, t.out_singles, i, code)
        for r in range(len(t.recorded)):
            t.rows[r, k + 1] = t.values[t.recorded[r]]
    return last, -1, 0, 0


def load() -> None:
    """Load the loop from numba's cache, or compile it, before it is needed."""
    kinds = {Array: np.float64, Index: np.int64, Flags: np.bool_, Singles: np.float32, int: int}
    shapes = dict.fromkeys(("table", "rows", "setters", "getters"), (0, 0))
    tables: dict[str, Any] = {
        name: 0 if kind is int else np.zeros(shapes.get(name, (0,)), dtype=kinds[kind])
        for name, kind in Tables.__annotations__.items()
    }
    advance(0, 0, 0.0, Tables(**tables))
