"""Derivatives of inputs: with them, values at the START of each step are enough for second order."""

import ctypes
import math

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmu_bench import orders
from fmu_raw import ERROR, OK, Instance

from fmus import registry

# these are sampled: no order of accuracy in the step
DRIVEN = [n for n in registry.BLOCKS if n not in ("stimulus", "observer_extended", "reference", "controller")]
W, END = 9.0, 0.48


def set_derivatives(slave: Instance, references: list[int], order: list[int], values: list[float]) -> None:
    """fmi2SetRealInputDerivatives, which fmpy does not wrap."""
    n = len(references)
    function = slave.fmu.dll.fmi2SetRealInputDerivatives
    function.restype = ctypes.c_int
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_void_p]
    status = function(
        slave.fmu.component,
        (ctypes.c_uint * n)(*references),
        n,
        (ctypes.c_int * n)(*order),
        (ctypes.c_double * n)(*values),
    )
    if status > 1:
        raise FMICallException("fmi2SetRealInputDerivatives", status)


def at_the_end(folder, block: str, h: float, highest: int) -> np.ndarray:
    """Outputs at END under a sine at every input, given by value and derivatives at the start of each step."""
    slave = Instance(folder, block)
    sizes = [0.9 * v.nominal for v in registry.block(block).inputs.values()]
    references = [slave.vr[n] for n in slave.inputs]
    slave.initialise()
    for k in range(round(END / h)):
        t = k * h
        waves = [math.sin(W * t), W * math.cos(W * t), -W * W * math.sin(W * t), -(W**3) * math.cos(W * t)]
        slave.fmu.setReal(references, [a * waves[0] for a in sizes])
        for order in range(1, highest + 1):
            set_derivatives(slave, references, [order] * len(sizes), [a * waves[order] for a in sizes])
        assert slave.step(t, h) == OK
    found = np.array(slave.get(*slave.outputs))
    slave.close()
    return found / np.array([v.nominal for v in registry.block(block).outputs.values()])


@pytest.mark.parametrize("block", DRIVEN)
def test_second_order_with_derivatives_first_without(unpacked, block) -> None:
    reference = at_the_end(unpacked[block], block, 5e-5, 3)
    steps = (2e-3, 1e-3, 5e-4)

    def errors(highest: int) -> list[float]:
        return [
            float(np.max(np.abs(at_the_end(unpacked[block], block, h, highest) - reference))) for h in steps
        ]

    with_slopes, without = errors(1), errors(0)
    assert with_slopes[-1] < 1e-12 or orders(with_slopes)[-1] > 1.7, with_slopes
    assert orders(without)[-1] < 1.3, without
    assert with_slopes[-1] < 0.1 * without[-1]


def test_a_derivative_holds_for_one_step(unpacked) -> None:
    slave = Instance(unpacked["sensor"]).initialise()
    slave.set(theta=1.0)
    set_derivatives(slave, [0], [1], [2.0])
    assert slave.step(0.0, 0.25) == OK
    assert slave.get("slew") == [1.5]
    assert slave.get("theta") == [1.0], "the input itself stays what was set"
    assert slave.step(0.25, 0.25) == OK
    assert slave.get("slew") == [1.0]
    set_derivatives(slave, [0, 0, 0], [1, 2, 3], [2.0, 4.0, 12.0])
    assert slave.step(0.5, 0.5) == OK
    assert slave.get("slew") == [1.0 + 2.0 * 0.5 + 4.0 * 0.125 + 12.0 * 0.125 / 6.0]
    slave.close()


def test_a_held_input_takes_the_mean(unpacked) -> None:
    """simplified.command: a ramp from 0 to 2 h counts like a constant h."""
    ramp, flat = (Instance(unpacked["simplified"], n).initialise() for n in ("ramp", "flat"))
    set_derivatives(ramp, [ramp.vr["command"]], [1], [2.0])
    flat.set(command=0.01)
    assert ramp.step(0.0, 0.01) == flat.step(0.0, 0.01) == OK
    assert ramp.get("theta", "omega") == pytest.approx(flat.get("theta", "omega"), rel=1e-14)
    ramp.close()
    flat.close()


@pytest.mark.parametrize(
    ("reference", "order", "value", "text"),
    [
        (0, 0, 1.0, "derivative 0 of p_load is refused: orders from 1 to 3 are used"),
        (0, 4, 1.0, "derivative 4 of p_load is refused"),
        (0, 1, math.nan, "derivative 1 of p_load = nan is refused"),
        (1, 1, 1.0, "theta is no input"),
        (99, 1, 1.0, "no variable with value reference 99"),
    ],
)
def test_bad_derivatives_are_refused(unpacked, reference, order, value, text) -> None:
    slave = Instance(unpacked["mechanical"]).initialise()
    assert slave.status(set_derivatives, slave, [reference], [order], [value]) == ERROR
    assert text in slave.messages[0]
    assert slave.step(0.0) == ERROR
    slave.close()


def test_an_input_that_leaves_its_bounds_within_the_step_is_refused(unpacked) -> None:
    slave = Instance(unpacked["mechanical"]).initialise()
    slave.set(p_load=9e8)
    set_derivatives(slave, [slave.vr["p_load"]], [1], [1e12])
    assert slave.step(0.0, 1e-3) == ERROR
    assert (
        "p_load = 1900000000.0 is refused: it must be a number from -1000000000.0 to 1000000000.0"
        in slave.messages[0]
    )
    slave.close()
