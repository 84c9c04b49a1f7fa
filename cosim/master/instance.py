"""One instance of an FMU: loaded once, reset or made anew between runs, its messages kept.

Calls go to the C functions of the FMU's library by address; fmpy loads the library and formats the messages.
"""

import atexit
import ctypes
import itertools
import os
import re
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from fmpy.fmi1 import FMICallException, printLogMessage
from fmpy.fmi2 import (
    defaultCallbacks,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy

from cosim.console import printable
from cosim.errors import ModelError, SimulationError
from cosim.interrupts import POSTPONING
from cosim.master import marks, modules
from cosim.master.dialect import CODES, FMI2, TYPES, dialect_of
from cosim.ssp.system import Component, Value, Variable

STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
WARNING, DISCARD, FATAL = 1, 2, 4
ENDED, EARLY = 100, 101
"""In place of a status: a step of FMI 3.0 that asks for the end of the simulation, or that came back before its end."""
MOST_MESSAGES = 200
MOST_BYTES = 1990  # of a message
POSTPONING.add(__file__)

SetGetReal = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p
)
SetGet3 = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_size_t
)
DoStep = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
DoStep3 = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_bool, *[ctypes.c_void_p] * 4
)


def status_name(status: int) -> str:
    """Name of a status; only 0 to 5 have one."""
    if status in (ENDED, EARLY):
        return "OK, but it asks to end the simulation" if status == ENDED else "OK, but before the step's end"
    return STATUS[status] if 0 <= status < len(STATUS) else f"{status}, which FMI does not know"


class Message(NamedTuple):
    """What an FMU logged: status 0 to 5 as in `STATUS`."""

    status: int
    category: str
    text: str


# fmpy's proxy that formats messages knows only the last logger it was given, so there is one for all instances; the FMU
# hands back the number of the instance as its environment
_listeners: dict[int, deque[Message]] = {}
_numbers = itertools.count(1)


# a library is loaded in its own folder, and threads share the working directory: one at a time, or another's folder stays
_loading = threading.Lock()


# pythonfmu 0.7.0 releases the same memory twice when the process ends, which now and then aborts it; its own release
# function, called in time, prevents that
_unsettled: dict[int, Callable[[], None]] = {}


def _remember(number: int, library: Any) -> None:
    if hasattr(library, "finalizePythonInterpreter"):
        release = library.finalizePythonInterpreter
        release.restype, release.argtypes = None, ()
        _unsettled[number] = release


@atexit.register
def _settle() -> None:
    """What Runners that nobody closed would have done."""
    for release in _unsettled.values():
        release()
    _unsettled.clear()


hear: Callable[[bytes, Message], None] | None = None
"""Told of each message as it comes, where the process may not live to hand it on later."""


def _listen(environment: int | None, name: bytes, status: int, category: bytes, text: bytes) -> None:
    messages = _listeners.get(environment or 0)
    if messages is None:
        if environment is None:  # an FMU that fmpy itself runs in this process
            printLogMessage(environment, name, status, category, text)
        return
    decoded = [_shown(part or b"") for part in (category, text)]
    messages.append(Message(status, *decoded))
    if hear is not None:
        hear(name, Message(status, *decoded))


def _shown(text: bytes) -> str:
    """What an FMU says, as it may be shown: no longer than anyone reads, and without what moves a terminal's cursor."""
    cut = text[:MOST_BYTES].decode("utf-8", "replace") + (" ..." if len(text) > MOST_BYTES else "")
    return printable(cut)


_logger = fmi2CallbackLoggerTYPE(_listen)


def _listener(number: int, name: str) -> Callable[[int | None, int, bytes, bytes], None]:
    """What an FMU of FMI 3.0 logs to: each instance has its own, and the text is no format."""

    def listen(environment: int | None, status: int, category: bytes, text: bytes) -> None:
        _listen(number, name.encode(), status, category, text)

    return listen


def _callbacks(number: int) -> fmi2CallbackFunctions:
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = _logger
    callbacks.allocateMemory = defaultCallbacks.allocateMemory
    callbacks.freeMemory = defaultCallbacks.freeMemory
    callbacks.componentEnvironment = number
    addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


def _remedy(said: str) -> str:
    """What to do about a library that the dynamic linker refuses; empty where that is not known."""
    if lacking := re.search(r"(\S+): cannot open shared object file", said):
        return f": it needs '{lacking[1]}', which is not installed here: install it, or export the FMU with what it needs"
    if newer := re.search(r"version `([^']+)' not found", said):
        return f": it needs {newer[1]}, of a newer system than this one: export it on an older one, or run it there"
    return ""


class Instance:
    """An instantiated component.

    Attributes:
        name: of the component.
        messages: the last messages of the FMU, oldest first; cleared by `fresh`.
        renew: each run takes a new instance of the library loaded anew, as with fmpy. What others compiled does not always
            come back by fmi2Reset to where it began: FMUs of 20-sim keep their clock, and some free twice what they freed.
        dialect: the version of FMI that it speaks.
        pointer: address of the FMU's component, for the compiled loop.
        setters, getters, do_step: addresses of its C functions; the first two by the code of the type, 0 where FMI has none.
    """

    def __init__(self, component: Component, number: int = 0) -> None:
        """Load the library and instantiate.

        Args:
            component: what to instantiate.
            number: of the component in its system, for `cosim.master.marks`.

        Raises:
            ModelError: the library cannot be loaded, or another module of the process would run in its place.
            SimulationError: the FMU refuses to be instantiated.
        """
        self.name, self.component, self.place = component.name, component, number
        self.messages: deque[Message] = deque(maxlen=MOST_MESSAGES)
        self.alive = self._used = False
        fmu = component.fmu
        self.dialect = dialect_of(fmu.version)
        self.renew = not fmu.ours and fmu.module is None
        self._state: ctypes.c_void_p | None = None
        modules.claim(fmu)
        self._load()
        self._number = next(_numbers)
        _listeners[self._number] = self.messages
        # must outlive the instance
        self._callbacks = _callbacks(self._number) if self.dialect is FMI2 else None
        _remember(self._number, self._slave.dll)
        modules.entered(fmu)
        self._instantiate()

    def _load(self) -> None:
        fmu = self.component.fmu
        try:
            with _loading, self._marked(marks.LOAD):
                self._slave = self.dialect.slave(
                    guid=fmu.guid,
                    unzipDirectory=str(fmu.folder),
                    modelIdentifier=fmu.identifier,
                    instanceName=self.name,
                )
        except FileNotFoundError:
            raise  # not the library's: the current folder is gone, to which fmpy would go back
        except Exception as error:  # fmpy raises bare exceptions
            raise ModelError(
                f"{fmu.source}: the library cannot be loaded: {error}{_remedy(str(error))}"
            ) from None
        self._bind()

    def _bind(self) -> None:
        types = self.dialect.types
        self.setters, self.getters = (
            [self._address(f"{way}{types[code]}") if code < len(types) else 0 for code in range(len(TYPES))]
            for way in ("Set", "Get")
        )
        self.do_step = self._address("DoStep")

    def _load_anew(self) -> None:
        """Free the library and load it again; fmpy's own constructor would inspect each of its functions once more."""
        slave, file = self._slave, self._slave.dll._name
        slave.freeLibrary()
        with _loading:
            here = Path.cwd()
            os.chdir(Path(file).parent)  # as fmpy does: some libraries look for others beside them
            try:
                with self._marked(marks.LOAD):
                    slave.dll = ctypes.cdll.LoadLibrary(file)
            except OSError as error:
                raise ModelError(
                    f"{self.component.fmu.source}: the library cannot be loaded again: {error}{_remedy(str(error))}"
                ) from None
            finally:
                os.chdir(here)
        for name, old in slave._functions.items():
            if (new := getattr(slave.dll, name, None)) is None:
                continue  # one that it does not have
            new.argnames, new.argtypes, new.restype = old.argnames, old.argtypes, old.restype
            slave._functions[name] = new
        self._bind()

    def _address(self, name: str) -> int:
        function = getattr(self._slave.dll, self.dialect.prefix + name)
        return ctypes.cast(function, ctypes.c_void_p).value or 0

    def _instantiate(self) -> None:
        try:
            if self.dialect is FMI2:
                with self._marked(marks.function("fmi2Instantiate")):
                    self._slave.instantiate(callbacks=self._callbacks, loggingOn=True)
            else:
                with self._marked(marks.function("fmi3InstantiateCoSimulation")):
                    self._slave.instantiate(logMessage=_listener(self._number, self.name), loggingOn=True)
        except Exception:  # fmpy raises a bare Exception for a null pointer
            raise SimulationError(self.report("could not be instantiated")) from None
        self.alive, self._used = True, False
        modules.keep(self.component.fmu)
        self.pointer = int(self._slave.component)
        self._state = None
        if self.component.fmu.restarts:
            state = ctypes.c_void_p()
            if 0 <= self._status(f"Get{self.dialect.state}", ctypes.byref(state)) <= WARNING:
                self._state = state

    def fresh(self) -> None:
        """Bring the instance to where it was after instantiation; one that broke or cannot be reset is made anew.

        Raises:
            SimulationError: the FMU refuses to be instantiated again.
        """
        if self.alive and self._used and self._state is not None:
            status = self._status(f"Set{self.dialect.state}", self._state)
            if 0 <= status <= WARNING:
                self.messages.clear()
                return
            self.failed(status)
            self._state = None
        if self.alive and self._used and not self.renew:
            status = self._status("Reset")
            self.failed(status)
            self.renew = not 0 <= status <= WARNING
        self.messages.clear()
        if self.alive and self._used and self.renew:
            self._free()
            if self.component.fmu.module is None:
                self._load_anew()
        if not self.alive:
            self._instantiate()
        self._used = True

    def _free(self) -> None:
        if self._state is not None:
            self._status(f"Free{self.dialect.state}", ctypes.byref(self._state))
            self._state = None
        self.alive = False
        name = f"{self.dialect.prefix}FreeInstance"
        with self._marked(marks.function(name)):
            getattr(self._slave, name)(self._slave.component)

    def begin(self, start: float, stop: float | None = None, tolerance: float | None = None) -> None:
        """Tell the experiment, times in s, before start values are set; `enter` begins the initialisation.

        Raises:
            SimulationError: as `call`.
        """
        accuracy = (tolerance is not None, 0.0 if tolerance is None else tolerance)
        self._experiment = (*accuracy, start, stop is not None, 0.0 if stop is None else stop)
        if self.dialect is FMI2:
            self.call("SetupExperiment", *self._experiment)

    def enter(self) -> None:
        """Enter initialisation mode.

        Raises:
            SimulationError: as `call`.
        """
        self.call("EnterInitializationMode", *(() if self.dialect is FMI2 else self._experiment))

    def call(self, function: str, *arguments: Any) -> None:
        """Call a C function of the FMU, named without the prefix of its version, with this component first.

        Raises:
            SimulationError: it answers with anything worse than a warning; the message holds what the FMU logged.
        """
        status = self._status(function, *arguments)
        if not 0 <= status <= WARNING:
            self.failed(status)
            full = self.dialect.prefix + function
            raise SimulationError(self.report(f"failed in {full} (status {status_name(status)})"))

    def transfer(self, way: str, code: int, references: int, count: int, values: int) -> None:
        """Set or get variables of one type.

        Args:
            way: Set or Get.
            code: of the type.
            references: address of the value references.
            count: how many there are.
            values: address of as many values.

        Raises:
            SimulationError: as `call`.
        """
        counts = (count,) if self.dialect.counts else ()
        pointers = (
            ctypes.cast(references, ctypes.POINTER(ctypes.c_uint)),
            count,
            ctypes.cast(values, ctypes.POINTER(self.dialect.ctypes[code])),
        )
        self.call(f"{way}{self.dialect.types[code]}", *pointers, *counts)

    def _status(self, function: str, *arguments: Any) -> int:
        """What a function of FMI answers; fmpy takes every number below 2 for success."""
        name = self.dialect.prefix + function
        with self._marked(marks.function(name)):
            try:
                return int(getattr(self._slave, name)(self._slave.component, *arguments))
            except FMICallException as error:
                return error.status

    @contextmanager
    def _marked(self, phase: int) -> Iterator[None]:
        marks.enter(phase, self.place)
        try:
            yield
        finally:
            marks.enter(marks.OURS, self.place)

    def failed(self, status: int) -> None:
        """Remember a bad status: after Fatal no function of the instance may be called again (FMI 2.0, 2.1.3)."""
        if (status >= FATAL and status not in (ENDED, EARLY)) or status < 0:
            self.alive = False

    def report(self, what: str) -> str:
        """A sentence about this component, with what it logged at a status worse than OK (else its last words)."""
        bad = [m.text for m in self.messages if m.status >= WARNING] or [m.text for m in self.messages][-3:]
        said = "; ".join(dict.fromkeys(text.strip() for text in bad))
        return f"component '{self.name}' {what}" + (f": {said}" if said else "; the FMU logged nothing")

    def refusals(self) -> list[str]:
        """What the FMU logged at status Discard or worse."""
        return [m.text.strip() for m in self.messages if m.status >= DISCARD]

    def set_value(self, variable: Variable, value: Value) -> None:
        """Give a variable a start value.

        Raises:
            SimulationError: the FMU refuses it, by its status or by an error in its log (pythonfmu has no other way).
        """
        known = len(self.refusals())
        reference = (ctypes.c_uint * 1)(variable.reference)
        function, array = self._encoded(variable, value)
        what = f"refuses {variable.name} = {value!r} {variable.unit}".rstrip()
        status = self._status(function, reference, 1, array, *((1,) if self.dialect.counts else ()))
        if not 0 <= status <= WARNING:
            self.failed(status)
            raise SimulationError(self.report(what))
        if len(self.refusals()) > known:
            raise SimulationError(self.report(what))
        if variable.kind != "String" and not variable.low <= float(value) <= variable.high:
            # most FMUs take anything: their description is then the only guard
            raise SimulationError(
                f"component '{self.name}' {what}: its description allows {variable.low:g} to {variable.high:g}"
            )

    def _encoded(self, variable: Variable, value: Value) -> tuple[str, Any]:
        """The C function that sets a variable, and the value as its array of one."""
        if variable.type == "String":
            return "SetString", (ctypes.c_char_p * 1)(str(value).encode("utf-8"))
        code = CODES[variable.type]
        number = {"Real": float, "Boolean": bool}.get(variable.kind, int)(value)
        return f"Set{self.dialect.types[code]}", (self.dialect.ctypes[code] * 1)(number)

    def terminate(self) -> None:
        """End a run that has begun; a failure here changes no result and is ignored."""
        if self.alive and self._used:
            self._status("Terminate")

    def close(self) -> None:
        """Free the instance and its library; one that broke is abandoned, since freeing it could crash."""
        if _listeners.pop(self._number, None) is None:
            return
        modules.left(self.component.fmu)
        settle = _unsettled.pop(self._number, None)
        if self.alive:
            self._free()
            if settle is not None:
                settle()
            self._slave.freeLibrary()
        elif settle is not None:
            settle()
