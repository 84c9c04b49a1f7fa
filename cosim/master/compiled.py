"""The loop, compiled: numba calls the FMUs' C functions by address. Holds Python's lock, which pythonfmu's FMUs need."""

from typing import Any, NamedTuple

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from cosim.master.marks import STEP, STEPPED
from cosim.master.plan import Array, Flags, Index

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
        in_references, out_references, in_pointer, out_pointer: addresses of the arrays of value references, of
            `in_values` and of `values`; the arrays must outlive the call.
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
    steppers: Index
    in_start: Index
    in_source: Index
    in_factor: Array
    in_offset: Array
    out_start: Index
    snapshots: Index
    n_outputs: int
    in_references: int
    out_references: int
    in_pointer: int
    out_pointer: int
    marks: Index


@numba.njit(cache=True)
def advance(first: int, last: int, h: float, t: Tables) -> tuple[int, int, int, int]:
    """Make the steps `first` to `last` with step size h [s].

    Returns:
        (step reached, component, call, status): component is -1 when all went well or ``stop[0]`` was set; call is 0 for
        fmi2SetReal, 1 for fmi2DoStep, 2 for fmi2GetReal.
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
                status = call_real(
                    t.setters[c], t.components[c], t.in_references + 4 * a, b - a, t.in_pointer + 8 * a
                )
                if status > 1 or status < 0:
                    return k, c, 0, status
            size = t.time[k + 1] - t.time[k] if t.exact[c] else h
            status = call_step(t.steppers[c], t.components[c], t.time[k], size)
            if status > 1 or status < 0:
                return k, c, 1, status
            a, b = t.out_start[c], t.out_start[c + 1]
            if b > a:
                status = call_real(
                    t.getters[c], t.components[c], t.out_references + 4 * a, b - a, t.out_pointer + 8 * a
                )
                if status > 1 or status < 0:
                    return k, c, 2, status
        for r in range(len(t.recorded)):
            t.rows[k + 1, r] = t.values[t.recorded[r]]
    return last, -1, 0, 0
