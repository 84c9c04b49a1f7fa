"""One component's part of a step in plain Python: the calls that the compiled loop makes, with the same numbers."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master.instance import DoStep, Instance, SetGetReal
from cosim.master.plan import Plan

Array = NDArray[np.float64]


def operations(
    plan: Plan, instances: Sequence[Instance], values: Array, in_values: Array, h: float
) -> list[Callable[[float, float], tuple[int, int]]]:
    """For each component a function of a step's two times that sets its inputs, makes a step and reads its outputs.

    Returns:
        Functions that answer (call, status); call is 0 for fmi2SetReal, 1 for fmi2DoStep, 2 for fmi2GetReal.
    """
    return [_operation(plan, c, instance, values, in_values, h) for c, instance in enumerate(instances)]


def _operation(
    plan: Plan, c: int, instance: Instance, values: Array, in_values: Array, h: float
) -> Callable[[float, float], tuple[int, int]]:
    a, b, m, n = (int(i) for i in (*plan.in_start[c : c + 2], *plan.out_start[c : c + 2]))
    set_real, get_real, do_step = (
        SetGetReal(instance.set_real),
        SetGetReal(instance.get_real),
        DoStep(instance.do_step),
    )
    component, exact = instance.pointer, not instance.component.fmu.ours
    in_refs, out_refs = (
        int(plan.in_reference.ctypes.data) + 4 * a,
        int(plan.out_reference.ctypes.data) + 4 * m,
    )
    in_pointer, out_pointer = int(in_values.ctypes.data) + 8 * a, int(values.ctypes.data) + 8 * m
    wires: list[tuple[int, int, float, float]] = [
        (i, int(plan.in_source[i]), float(plan.in_factor[i]), float(plan.in_offset[i])) for i in range(a, b)
    ]
    # scalars of a memoryview are read and written faster than those of an array
    source: Any = memoryview(values.data)
    target: Any = memoryview(in_values.data)

    def operate(time: float, until: float) -> tuple[int, int]:
        new = False
        for i, j, factor, offset in wires:
            value = factor * source[j] + offset
            new |= value != target[i]
            target[i] = value
        if new:  # an input keeps its value until it is set again
            status = set_real(component, in_refs, b - a, in_pointer)
            if status > 1 or status < 0:
                return 0, status
        status = do_step(component, time, until - time if exact else h, 1)
        if status > 1 or status < 0:
            return 1, status
        if n > m:
            status = get_real(component, out_refs, n - m, out_pointer)
            if status > 1 or status < 0:
                return 2, status
        return 1, 0

    return operate
