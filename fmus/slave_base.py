"""What every slave of ours has: messages instead of exceptions, tables, types that are not there, a clean end of the process.

Copied into the script of every FMU, before `fmus/slave.py`.
"""

import _ctypes
import atexit
import csv
import ctypes
import functools
import os
import sys
from typing import Any

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

# pythonfmu's loader drops one reference too many to this module's globals at each instantiation; this text runs once more each time too
ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))


class BaseSlave(Fmi2Slave):
    """A slave that never raises and has Reals and Integers only, all in one list of floats.

    Attributes:
        names, starts, lows, highs: of all variables, by value reference: inputs, outputs, parameters.
        integers: value references of Integer variables.
        n_inputs, n_outputs: how many of each; parameters follow.
        mode: phase of life: instantiated, initialising, running or terminated.
        failed: something was refused; every step from now on is discarded.
        values: of all variables.
    """

    names: tuple[str, ...] = ()
    starts: tuple[float, ...] = ()
    lows: tuple[float, ...] = ()
    highs: tuple[float, ...] = ()
    integers: tuple[int, ...] = ()
    n_inputs = 0
    n_outputs = 0

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.mode = "instantiated"
        self.failed = False
        self.model = type(self).__module__  # unique: it holds a digest of this text
        self.values = list(self.starts)
        self.settle_at_exit()

    # What went wrong: logged, remembered, never raised

    def refuse(self, message: str) -> None:
        """Log `message` as an error; from now on every step is discarded."""
        self.failed = True
        self.log(f"{self.instance_name}: {message}", Fmi2Status.error)

    def refuse_value(self, vr: int, value: float) -> None:
        """Log why a value was not taken."""
        if not 0 <= vr < len(self.names):
            self.refuse(f"there is no variable with value reference {vr}")
            return
        name = self.names[vr]
        if self.n_inputs <= vr < self.n_inputs + self.n_outputs:
            self.refuse(f"{name} is an output and cannot be set")
        elif vr >= self.n_inputs and self.mode in ("running", "terminated"):
            self.refuse(
                f"parameter {name} is fixed and cannot be set to {value!r} after initialisation; reset first"
            )
        else:
            limits = f"{self.lows[vr]!r} to {self.highs[vr]!r}"
            self.refuse(
                f"{name} = {value!r} is refused: it must be a number from {limits}; {self.values[vr]!r} is kept"
            )

    def read(self, refs: list[int]) -> list[float]:
        """Values by reference, with a message for one that does not exist."""
        known = range(len(self.values))
        for r in refs:
            if r not in known:
                self.refuse(f"there is no variable with value reference {r}")
        return [self.values[r] if r in known else float("nan") for r in refs]

    # Tables among the FMU's resources

    def column(self, resource: str) -> list[float]:
        """A column of a CSV file among the FMU's resources, named ``file:column``; it must not be changed.

        Raises:
            ValueError: it cannot be read.
        """
        file, _, number = resource.partition(":")
        path = os.path.join(self.resources, file)
        try:
            return self.read_column(path, int(number), os.stat(path).st_mtime_ns)
        except (OSError, ValueError, IndexError) as error:
            raise ValueError(f"{file} cannot be read: {error}") from None

    @staticmethod
    @functools.lru_cache(maxsize=8)  # a reset makes a new instance, which would read the file again
    def read_column(path: str, column: int, stamp: int) -> list[float]:
        """Numbers of a CSV file below its header; `stamp` changes when the file does."""
        with open(path, newline="", encoding="utf-8") as stream:
            found = [float(row[column]) for row in list(csv.reader(stream))[1:]]
        if not found:
            raise ValueError("it has no rows below its header")
        return found

    # The end of the process

    def settle_at_exit(self) -> None:
        """Have pythonfmu's library release its guard of the interpreter before the process ends, once for each library.

        On Linux version 0.7.0 destroys this static object at exit and then once more in a destructor of its own, on memory
        already freed, which now and then aborts the process after all is done. Released before, it is empty by then.
        """
        if os.name == "nt":
            return
        folder = os.path.join(os.path.dirname(self.resources), "binaries", "linux64")
        settled = globals().setdefault("settled_at_exit", set())
        if folder in settled or not os.path.isdir(folder):
            return
        settled.add(folder)
        for name in os.listdir(folder):
            path = os.path.join(folder, name)
            library = ctypes.CDLL(path)
            if hasattr(library, "finalizePythonInterpreter"):
                # its address alone: a library object is kilobytes, and this is kept until the process ends
                address = ctypes.cast(library.finalizePythonInterpreter, ctypes.c_void_p).value or 0
                if sys.orig_argv:
                    atexit.register(self.settle, address, os.stat(path).st_ino)
                else:
                    # the host is not Python: Python ends within the end of the first library, when others are gone already
                    ctypes.CDLL(None)["__cxa_atexit"](ctypes.c_void_p(address), None, None)
            if sys.orig_argv:
                _ctypes.dlclose(library._handle)  # the host alone decides how long it stays
            # else it must stay until the process ends

    @staticmethod
    def settle(address: int, inode: int) -> None:
        """Call a function of a library if the library is loaded still; its file and its path may be gone."""
        try:
            with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
                for span, _, _, _, number, *_ in map(str.split, maps):
                    first, last = (int(end, 16) for end in span.split("-"))
                    if int(number) == inode and first <= address < last:
                        ctypes.CFUNCTYPE(None)(address)()
                        return
        except OSError:
            pass  # no /proc: then it is as it was

    # Other types: Integers are whole numbers in the same list; there are no Booleans and Strings

    def is_integer(self, r: int) -> bool:
        """True for an Integer variable; otherwise the call is refused."""
        if r in self.integers:
            return True
        if 0 <= r < len(self.names):
            self.refuse(f"{self.names[r]} is a Real, not an Integer")
        else:
            self.refuse(f"there is no variable with value reference {r}")
        return False

    def get_integer(self, refs: list[int]) -> list[int]:
        """Integer variables; 0 for what is none, with a message."""
        return [int(v) if self.is_integer(r) else 0 for r, v in zip(refs, self.read(refs))]

    def set_integer(self, refs: list[int], values: list[int]) -> None:
        """Integer parameters, until initialisation is complete."""
        first = self.n_inputs + self.n_outputs
        early = self.mode in ("instantiated", "initialising")
        for r, v in zip(refs, values):
            if self.is_integer(r):
                if early and r >= first and self.lows[r] <= v <= self.highs[r]:
                    self.values[r] = float(v)
                else:
                    self.refuse_value(r, v)

    def get_boolean(self, refs: list[int]) -> list[bool]:
        """There are none."""
        self.refuse("there is no Boolean variable")
        return [False] * len(refs)

    def set_boolean(self, refs: list[int], values: list[bool]) -> None:
        """There are none."""
        self.refuse("there is no Boolean variable")

    def get_string(self, refs: list[int]) -> list[str]:
        """There are none."""
        self.refuse("there is no String variable")
        return [""] * len(refs)

    def set_string(self, refs: list[int], values: list[str]) -> None:
        """There are none."""
        self.refuse("there is no String variable")

    def to_xml(self, model_options: dict[str, str] | None = None) -> Any:
        """The model description, which the builder laid beside this script."""
        from xml.etree import ElementTree

        return ElementTree.parse(os.path.join(self.resources, "model_description.xml")).getroot()
