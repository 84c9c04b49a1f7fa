"""One component's part of a step in plain Python: the calls that the compiled loop makes, with the same numbers."""

from collections.abc import Callable, Sequence
from math import floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master.instance import DoStep, Instance, SetGetReal
from cosim.master.plan import Plan, Whole

Array = NDArray[np.float64]


def whole(value: float, kind: int) -> int:
    """A number as an Integer (kind 1), or as a Boolean (2): true from a half on."""
    if kind == 2:
        return 1 if abs(value) >= 0.5 else 0
    return floor(value + 0.5)


def operations(
    plan: Plan,
    instances: Sequence[Instance],
    values: Array,
    in_values: Array,
    rooms: tuple[Whole, Whole],
    h: float,
) -> list[Callable[[float, float], tuple[int, int]]]:
    """For each component a function of a step's two times that sets its inputs, makes a step and reads its outputs.

    Returns:
        Functions that answer (call, status); call is an index of `cosim.master.engine.CALLS`.
    """
    return [
        _operation(plan, c, instance, values, in_values, rooms, h) for c, instance in enumerate(instances)
    ]


def _operation(
    plan: Plan,
    c: int,
    instance: Instance,
    values: Array,
    in_values: Array,
    rooms: tuple[Whole, Whole],
    h: float,
) -> Callable[[float, float], tuple[int, int]]:
    a, b, m, n = (int(i) for i in (*plan.in_start[c : c + 2], *plan.out_start[c : c + 2]))
    set_real, get_real, do_step = (
        SetGetReal(instance.set_real),
        SetGetReal(instance.get_real),
        DoStep(instance.do_step),
    )
    reals, out_reals = int(plan.in_reals[c]), int(plan.out_reals[c])
    setters = {1: SetGetReal(instance.set_integer), 2: SetGetReal(instance.set_boolean)}
    getters = {1: SetGetReal(instance.get_integer), 2: SetGetReal(instance.get_boolean)}
    in_whole, out_whole = rooms
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
            status = set_real(component, in_refs, reals - a, in_pointer) if reals > a else 0
            if status > 1 or status < 0:
                return 0, status
            for i in range(reals, b):
                kind = int(plan.in_kind[i])
                in_whole[i] = whole(target[i], kind)
                room = int(in_whole.ctypes.data) + 4 * i
                status = setters[kind](component, in_refs + 4 * (i - a), 1, room)
                if status > 1 or status < 0:
                    return 2 + kind, status
        status = do_step(component, time, until - time if exact else h, 1)
        if status > 1 or status < 0:
            return 1, status
        if out_reals > m:
            status = get_real(component, out_refs, out_reals - m, out_pointer)
            if status > 1 or status < 0:
                return 2, status
        for i in range(out_reals, n):
            kind = int(plan.out_kind[i])
            status = getters[kind](component, out_refs + 4 * (i - m), 1, int(out_whole.ctypes.data) + 4 * i)
            if status > 1 or status < 0:
                return 4 + kind, status
            source[i] = float(out_whole[i])
        return 1, 0

    return operate
