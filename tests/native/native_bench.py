"""Compiles single Python functions as the translator sees them, and calls them beside the originals."""

import ast
import ctypes
import inspect
import subprocess
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.native.build import FLAGS, compiler
from cosim.native.function import Function
from cosim.native.kinds import ARRAY, REAL, Kind, Struct

SOURCE = Path(__file__).resolve().parents[2] / "cosim" / "native" / "c"
RAISES = {
    ZeroDivisionError: "PY_DIVISION",
    OverflowError: "PY_RANGE",
    ValueError: "PY_DOMAIN",
    IndexError: "PY_INDEX",
}
FAULTS = ("PY_NO_FAULT", "PY_DIVISION", "PY_DOMAIN", "PY_RANGE", "PY_INDEX", "PY_CONVERSION", "PY_COMPLEX")


def translated(
    function: Callable[..., Any], kinds: Sequence[Kind], others: Sequence[Callable[..., Any]] = ()
) -> list[str]:
    """C texts: structs, then the function behind those it calls."""
    nodes = {
        f.__name__: ast.parse(textwrap.dedent(inspect.getsource(f))).body[0] for f in (function, *others)
    }
    structs: dict[tuple[Kind, ...], Struct] = {}
    done: dict[str, Function] = {}

    def tuples(of: tuple[Kind, ...]) -> Struct:
        name = f"{function.__name__}_tuple{len(structs)}"
        return structs.setdefault(
            of, Struct(name, "a tuple", tuple((f"e{k}", kind) for k, kind in enumerate(of)))
        )

    def find(name: str, of: tuple[Kind, ...]) -> Function:
        if name not in done:
            done[name] = Function(nodes[name], of, f"f_{name}", {}, tuples, find)
        return done[name]

    found = find(function.__name__, tuple(kinds))
    values = ", ".join(f"py_array a{k}" if kind is ARRAY else f"double a{k}" for k, kind in enumerate(kinds))
    fault = ["py_fault"] if found.fails else []
    call = f"{found.name}({', '.join([*(f'a{k}' for k in range(len(kinds))), *fault])})"
    outside = (
        f"double {function.__name__}({values}, int *py_fault) {{ (void)py_fault; return (double){call}; }}"
    )
    return [*(s.definition() for s in structs.values()), *(f.text() for f in done.values()), outside]


class Array(ctypes.Structure):
    """py_array."""

    _fields_ = (("at", ctypes.POINTER(ctypes.c_double)), ("length", ctypes.c_int64))


class Library:
    """Several functions compiled into one library."""

    def __init__(self, folder: Path, texts: Sequence[str], kinds: dict[str, Sequence[Kind]]) -> None:
        file = folder / "functions.c"
        file.write_text("\n\n".join(['#include "semantics.h"', *texts]) + "\n")
        flags = [f for f in FLAGS if not f.startswith("-fvisibility")] + [
            "-O1",
            "-Wall",
            "-Wextra",
            "-pedantic",
            "-Werror",
        ]
        command = [*compiler(), *flags, f"-I{SOURCE}", str(file), "-lm", "-o", str(folder / "functions.so")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        self.library = ctypes.CDLL(str(folder / "functions.so"))
        self.kinds = kinds

    def call(self, name: str, *values: Any) -> tuple[float, str]:
        """Result and fault of a function; a list among the values is changed in place as in Python."""
        function = getattr(self.library, name)
        function.restype = ctypes.c_double
        fault, given, kept = ctypes.c_int(0), [], []
        for value, kind in zip(values, self.kinds[name], strict=True):
            if kind is REAL:
                given.append(ctypes.c_double(value))
            else:
                numbers = np.array(value, dtype=float)
                kept.append((value, numbers))
                given.append(Array(numbers.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), len(numbers)))
        result = float(function(*given, ctypes.byref(fault)))
        for value, numbers in kept:
            value[:] = numbers.tolist()
        return result, FAULTS[fault.value]
