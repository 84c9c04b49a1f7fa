"""The blocks of the drive as transfer functions, and their parameters from a fitted one."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.identify.estimate import Quantity
from cosim.identify.transfer_function import Structure, TransferFunction

Array = NDArray[np.float64]
Reading = Callable[[Array, Array, Mapping[str, float]], float]
"""A parameter (SI) from monic denominator (falling powers), numerator (rising powers) and nominal numbers."""


@dataclass(frozen=True)
class BlockForm:
    """A block of the drive.

    Attributes:
        source: signal that drives it.
        target: signal that it makes.
        structure: of its equation.
        table: equation and table of the source.
        readings: parameter -> (how it follows, unit).
        rows: structures of the table of candidates.
    """

    source: str
    target: str
    structure: Structure
    table: str
    readings: dict[str, tuple[Reading, str]]
    rows: tuple[Structure, ...]


def _area_arm(known: Mapping[str, float]) -> float:
    return known["mechanical.A"] * known["mechanical.r"]


BLOCKS: dict[str, BlockForm] = {
    "dcv": BlockForm(
        "u",
        "spool",
        Structure(2),
        "(4.16), Table 4.3",
        {
            "K": (lambda d, b, known: b[0] / d[-1], "m"),
            "w0": (lambda d, b, known: float(np.sqrt(d[-1])), "rad/s"),
            "zeta": (lambda d, b, known: d[-2] / (2.0 * float(np.sqrt(d[-1]))), "1"),
        },
        (Structure(1), Structure(2), Structure(2, 1), Structure(2, delay=True), Structure(3)),
    ),
    "continuity": BlockForm(
        "spool",
        "p_load",
        Structure(1),
        "(4.33), Table 4.4",
        {
            "K_c": (lambda d, b, known: b[0] / d[-1], "Pa/m"),
            "T": (lambda d, b, known: 1.0 / d[-1], "s"),
        },
        (Structure(1), Structure(1, delay=True), Structure(2), Structure(2, 1)),
    ),
    "mechanical": BlockForm(
        "p_load",
        "slew",
        Structure(2, 0, 1),
        "(4.28), (4.34)",
        {
            "J": (lambda d, b, known: _area_arm(known) / b[0], "kg.m2"),
            "b": (lambda d, b, known: _area_arm(known) * d[-2] / b[0], "N.m.s/rad"),
        },
        (Structure(1, 0, 1), Structure(2, 0, 1), Structure(2, 1, 1), Structure(3, 0, 1)),
    ),
    "simplified": BlockForm(
        "u",
        "slew",
        Structure(2, 0, 1),
        "(4.15), Table 4.2",
        {
            "k": (lambda d, b, known: b[0], "rad/s2"),
            "a": (lambda d, b, known: d[-2], "1/s"),
        },
        (Structure(2, 0, 1), Structure(3, 0, 1), Structure(3, 1, 1), Structure(5, 0, 1)),
    ),
}


def form(name: str) -> BlockForm:
    """The block `name`.

    Raises:
        UsageError: there is no such block.
    """
    if name not in BLOCKS:
        raise UsageError(f"'{name}' is no block with a transfer function: choose {', '.join(BLOCKS)}")
    return BLOCKS[name]


def parameters(name: str, found: TransferFunction, known: Mapping[str, float]) -> dict[str, Quantity]:
    """``block.parameter`` -> number (SI) with its interval; empty where the structure is not the block's own."""
    block = form(name)
    if (found.structure.poles, found.structure.zeros, found.structure.integrators) != (
        block.structure.poles,
        block.structure.zeros,
        block.structure.integrators,
    ):
        return {}
    structure = found.structure
    read = {}
    for parameter, (reading, unit) in block.readings.items():

        def value(theta: Array, b: Array, reading: Reading = reading) -> float:
            return float(reading(structure.denominator(theta), b, known))

        read[f"{name}.{parameter}"] = found.fit.derived(value, unit)
    if structure.delay and name == "dcv":
        read["dcv.tau_d"] = found.quantity("delay")
    return read
