"""How FMI 2.0 and FMI 3.0 say the same things: names of functions, types of values, arguments of a step.

Each type of number has a code, by which tables of functions are ordered. A number that is not Float64 (Real) is handed over
in a slot of eight bytes, whose first ones are the number as the FMU's processor has it: all that run here are little-endian.
"""

import ctypes
from dataclasses import dataclass
from math import floor
from types import SimpleNamespace
from typing import Any

import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from numpy.typing import NDArray

Slots = NDArray[np.int64]
TYPES = (
    "Float64", "Int32", "Boolean", "Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64",
)  # fmt: skip
"""By code; FMI 2.0 has the first three, as Real, Integer and Boolean."""
CODES = {name: code for code, name in enumerate(TYPES)} | {"Real": 0, "Integer": 1}
BOOLEAN, SINGLE = 2, 3
# a Boolean has one byte in FMI 3.0 and four in 2.0: the others of its slot stay zero
IN_SLOTS = ("f8", "i4", "i4", "f4", "i1", "u1", "i2", "u2", "u4", "i8", "u8")
# what a slot takes of whole numbers; of 64 bit what a double can say, and a slot of the compiled loop can hold
LOWS = (0.0, -(2.0**31), 0.0, 0.0, -128.0, 0.0, -(2.0**15), 0.0, 0.0, -(2.0**63), 0.0)
HIGHS = (
    0.0, 2.0**31 - 1, 1.0, 0.0, 127.0, 255.0, 2.0**15 - 1, 2.0**16 - 1, 2.0**32 - 1, 2.0**63 - 1024, 2.0**63 - 1024,
)  # fmt: skip


class _Whole:
    """A library for fmpy, which wants every function that FMI has: those that are missing are there in name only."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library

    def __getattr__(self, name: str) -> Any:
        return getattr(self._library, name, SimpleNamespace())


class _Lenient:
    """An FMU that may lack what it is not for, as exports of 2024 do; `cosim.ssp.binary` has what is called."""

    dll: Any

    def _loadFunctions(self) -> None:
        library = self.dll
        self.dll = _Whole(library)
        try:
            super()._loadFunctions()  # type: ignore[misc]  # of fmpy's class, which comes after this one
        finally:
            self.dll = library


class FMU2Lenient(_Lenient, FMU2Slave):
    """Of FMI 2.0; fmpy tells the version by the beginning of the name."""


class FMU3Lenient(_Lenient, FMU3Slave):
    """Of FMI 3.0."""


@dataclass(frozen=True)
class Dialect:
    """A version of FMI.

    Attributes:
        version: of the standard.
        prefix: of its functions.
        state: what it calls an FMU's state in their names.
        types: its names of the types, by code.
        ctypes: a value of each type, by code.
        counts: functions are told how many values they get too, after the values.
        slave: fmpy's class for it.
    """

    version: str
    prefix: str
    state: str
    types: tuple[str, ...]
    ctypes: tuple[Any, ...]
    counts: bool
    slave: type


_INTEGER, _TRUTH = ctypes.c_int, ctypes.c_bool
FMI2 = Dialect(
    "2.0", "fmi2", "FMUstate", ("Real", "Integer", "Boolean"), (ctypes.c_double, _INTEGER, _INTEGER), False, FMU2Lenient
)  # fmt: skip
FMI3 = Dialect(
    "3.0",
    "fmi3",
    "FMUState",
    TYPES,
    (ctypes.c_double, ctypes.c_int32, _TRUTH, ctypes.c_float, ctypes.c_int8, ctypes.c_uint8, ctypes.c_int16,
     ctypes.c_uint16, ctypes.c_uint32, ctypes.c_int64, ctypes.c_uint64),
    True,
    FMU3Lenient,
)  # fmt: skip


def dialect_of(version: str) -> Dialect:
    """The dialect of an FMU by its fmiVersion."""
    return FMI3 if version.startswith("3.") else FMI2


def put(slots: Slots, i: int, value: float, code: int) -> None:
    """Lay a number into a slot: whole numbers rounded and within their type, a Boolean true from a half on."""
    if code == BOOLEAN:
        slots[i] = 1 if abs(value) >= 0.5 else 0
    elif code == SINGLE:
        slots[i : i + 1].view(IN_SLOTS[code])[0] = value
    else:
        whole = int(min(max(floor(value + 0.5), LOWS[code]), HIGHS[code]))
        slots[i : i + 1].view(IN_SLOTS[code])[0] = whole


def taken(slots: Slots, i: int, code: int) -> float:
    """The number that an FMU laid into a slot."""
    return float(slots[i : i + 1].view(IN_SLOTS[code])[0])
