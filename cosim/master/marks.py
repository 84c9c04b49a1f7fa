"""Where a simulation stands, in a few numbers: a process that dies in an FMU cannot say, one that watches it can read them.

The loop and the instances write them before each call of an FMU. In a child that is watched they lie in a file that the
parent maps too.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

STEP, STEPPED, PHASE, CALLED, BEAT = range(5)
"""Step of the piece, component in stepping order, what goes on, component in the system's order, calls so far."""
COUNT = 8

OURS, LOOP, LOAD = range(3)
"""Phases: our own code, the loop, the loading of a library; from CALLS on a function of FMI."""
CALLS = 3
_LIFE = ("EnterInitializationMode", "ExitInitializationMode", "Reset", "Terminate", "FreeInstance")
_TYPES = (
    "Float64", "Int32", "Boolean", "Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64", "String",
)  # fmt: skip
FUNCTIONS = (
    *(f"fmi2{n}" for n in ("Instantiate", "SetupExperiment", *_LIFE)),
    *(
        f"fmi2{way}{n}"
        for way in ("Get", "Set")
        for n in ("Real", "Integer", "Boolean", "String", "FMUstate")
    ),
    "fmi2FreeFMUstate",
    *(f"fmi3{n}" for n in ("InstantiateCoSimulation", *_LIFE)),
    *(f"fmi3{way}{n}" for way in ("Get", "Set") for n in (*_TYPES, "FMUState")),
    "fmi3FreeFMUState",
)

table: NDArray[np.int64] = np.zeros(COUNT, dtype=np.int64)
"""The marks of this process."""


def share(file: Path) -> None:
    """Lay the marks of this process into a file that exists."""
    global table
    table = np.asarray(np.memmap(file, dtype=np.int64, mode="r+", shape=(COUNT,)))


def enter(phase: int, component: int) -> None:
    """An FMU is called from here on; OURS ends it."""
    table[CALLED] = component
    table[BEAT] += 1
    table[PHASE] = phase


def function(name: str) -> int:
    """The phase of an FMI function."""
    return CALLS + FUNCTIONS.index(name)


def words(phase: int) -> str:
    """What a phase is, for a message; empty for our own code."""
    if phase < LOAD or phase >= CALLS + len(FUNCTIONS):
        return ""
    return "while its library was loaded" if phase == LOAD else f"in {FUNCTIONS[phase - CALLS]}"
