"""One component's part of a step in plain Python: the calls that the compiled loop makes, with the same numbers."""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master.dialect import FMI2, Slots, put, taken
from cosim.master.instance import EARLY, ENDED, DoStep, DoStep3, Instance, SetGet3, SetGetReal
from cosim.master.plan import Plan

Array = NDArray[np.float64]


def operations(
    plan: Plan,
    instances: Sequence[Instance],
    values: Array,
    in_values: Array,
    slots: tuple[Slots, Slots],
    h: float,
) -> list[Callable[[float, float], tuple[int, int]]]:
    """For each component a function of a step's two times that sets its inputs, makes a step and reads its outputs.

    Returns:
        Functions that answer (call, status); call is a number as `cosim.master.engine` has them.
    """
    return [
        _operation(plan, c, instance, values, in_values, slots, h) for c, instance in enumerate(instances)
    ]


def _operation(
    plan: Plan,
    c: int,
    instance: Instance,
    values: Array,
    in_values: Array,
    slots: tuple[Slots, Slots],
    h: float,
) -> Callable[[float, float], tuple[int, int]]:
    a, b, m, n = (int(i) for i in (*plan.in_start[c : c + 2], *plan.out_start[c : c + 2]))
    setters, getters = (
        [_transfer(instance, address) for address in addresses]
        for addresses in (instance.setters, instance.getters)
    )
    do_step = _step(instance)
    reals, out_reals = int(plan.in_reals[c]), int(plan.out_reals[c])
    in_slots, out_slots = slots
    in_place, out_place = int(in_slots.ctypes.data), int(out_slots.ctypes.data)
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
            status = setters[0](component, in_refs, reals - a, in_pointer) if reals > a else 0
            if status > 1 or status < 0:
                return 1, status
            for i in range(reals, b):
                code = int(plan.in_kind[i])
                put(in_slots, i, target[i], code)
                status = setters[code](component, in_refs + 4 * (i - a), 1, in_place + 8 * i)
                if status > 1 or status < 0:
                    return 1 + 2 * code, status
        status = do_step(component, time, until - time if exact else h)
        if status > 1 or status < 0:
            return 0, status
        if out_reals > m:
            status = getters[0](component, out_refs, out_reals - m, out_pointer)
            if status > 1 or status < 0:
                return 2, status
        for i in range(out_reals, n):
            code = int(plan.out_kind[i])
            status = getters[code](component, out_refs + 4 * (i - m), 1, out_place + 8 * i)
            if status > 1 or status < 0:
                return 2 + 2 * code, status
            source[i] = taken(out_slots, i, code)
        return 0, 0

    return operate


def _transfer(instance: Instance, address: int) -> Callable[[int, int, int, int], int]:
    """A function that sets or gets a list of values; FMI 3.0 wants their number too."""
    if instance.dialect is FMI2:
        return SetGetReal(address)
    function = SetGet3(address)

    def transfer(component: int, references: int, count: int, values: int) -> int:
        status: int = function(component, references, count, values, count)
        return status

    return transfer


def _step(instance: Instance) -> Callable[[int, float, float], int]:
    """A function that makes a step, with noSetFMUStatePriorToCurrentPoint = true."""
    if instance.dialect is FMI2:
        plain = DoStep(instance.do_step)
        return lambda component, time, size: plain(component, time, size, 1)
    function = DoStep3(instance.do_step)
    event, ended, early, last = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool(), ctypes.c_double()
    answers = [ctypes.byref(one) for one in (event, ended, early, last)]

    def step(component: int, time: float, size: float) -> int:
        ended.value = early.value = False
        status: int = function(component, time, size, True, *answers)
        if status in (0, 1):
            return ENDED if ended.value else EARLY if early.value else status
        return status

    return step
