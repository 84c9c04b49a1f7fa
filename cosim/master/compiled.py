"""The loop, compiled: numba calls the FMUs' C functions by address. Holds Python's lock, which pythonfmu's FMUs need."""

from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from cosim.master.marks import STEP, STEPPED
from cosim.master.plan import Array, Flags, Index, Whole

_SET_GET = types.int32(types.int64, types.int64, types.int64, types.int64, types.int64)
_STEP = types.int32(types.int64, types.int64, types.float64, types.float64)


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


call_real: Any = intrinsic(_call_real)
call_step: Any = intrinsic(_call_step)


class Tables(NamedTuple):
    """Everything the loop reads and writes; `cosim.master.plan.Plan` and `cosim.master.engine.Engine` say what it means.

    Attributes:
        exact: for each component, whether a step is what lies between two communication points to the last bit.
        components, setters, getters, steppers: address of each FMU's component and of its C functions, shape (c,).
        whole_setters, whole_getters: those for Integer and Boolean, shape (2, c).
        in_whole, out_whole: room for whole numbers, in the order of the inputs and outputs.
        in_references, out_references, in_pointer, out_pointer: addresses of the arrays of value references, of
            `in_values` and of `values`; the arrays must outlive the call.
        in_whole_pointer, out_whole_pointer: those of `in_whole` and `out_whole`.
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
    components: Index
    setters: Index
    getters: Index
    whole_setters: Index
    whole_getters: Index
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
    in_whole: Whole
    out_whole: Whole
    snapshots: Index
    n_outputs: int
    in_references: int
    out_references: int
    in_pointer: int
    out_pointer: int
    in_whole_pointer: int
    out_whole_pointer: int
    marks: Index


@numba.njit(cache=True)
def whole(value: float, kind: int) -> int:
    """A number as an Integer (kind 1), or as a Boolean (2): true from a half on."""
    if kind == 2:
        return 1 if abs(value) >= 0.5 else 0
    return int(np.floor(value + 0.5))


@numba.njit(cache=True)
def advance(first: int, last: int, h: float, t: Tables) -> tuple[int, int, int, int]:
    """Make the steps `first` to `last` with step size h [s].

    Returns:
        (step reached, component, call, status): component is -1 when all went well or ``stop[0]`` was set; call is an
        index of `cosim.master.engine.CALLS`.
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
            a, b = t.in_start[c], t.in_start[c + 1]
            new = False
            for i in range(a, b):
                value = t.in_factor[i] * t.values[t.in_source[i]] + t.in_offset[i]
                new |= value != t.in_values[i]
                t.in_values[i] = value
            if new:  # an input keeps its value until it is set again
                m = t.in_reals[c]
                if m > a:
                    status = call_real(
                        t.setters[c], t.components[c], t.in_references + 4 * a, m - a, t.in_pointer + 8 * a
                    )
                    if status > 1 or status < 0:
                        return k, c, 0, status
                for i in range(m, b):
                    kind = t.in_kind[i]
                    t.in_whole[i] = whole(t.in_values[i], kind)
                    status = call_real(
                        t.whole_setters[kind - 1, c],
                        t.components[c],
                        t.in_references + 4 * i,
                        1,
                        t.in_whole_pointer + 4 * i,
                    )
                    if status > 1 or status < 0:
                        return k, c, 2 + kind, status
            size = t.time[k + 1] - t.time[k] if t.exact[c] else h
            status = call_step(t.steppers[c], t.components[c], t.time[k], size)
            if status > 1 or status < 0:
                return k, c, 1, status
            a, b = t.out_start[c], t.out_start[c + 1]
            m = t.out_reals[c]
            if m > a:
                status = call_real(
                    t.getters[c], t.components[c], t.out_references + 4 * a, m - a, t.out_pointer + 8 * a
                )
                if status > 1 or status < 0:
                    return k, c, 2, status
            for i in range(m, b):
                kind = t.out_kind[i]
                status = call_real(
                    t.whole_getters[kind - 1, c],
                    t.components[c],
                    t.out_references + 4 * i,
                    1,
                    t.out_whole_pointer + 4 * i,
                )
                if status > 1 or status < 0:
                    return k, c, 4 + kind, status
                t.values[i] = float(t.out_whole[i])
        for r in range(len(t.recorded)):
            t.rows[k + 1, r] = t.values[t.recorded[r]]
    return last, -1, 0, 0
