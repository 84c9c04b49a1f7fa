"""One instance of an FMU: loaded once, reset or made anew between runs, its messages kept.

Calls go to the C functions of the FMU's library by address; fmpy loads the library and formats the messages.
"""

import atexit
import ctypes
import itertools
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from fmpy.fmi1 import FMICallException, printLogMessage
from fmpy.fmi2 import (
    FMU2Slave,
    defaultCallbacks,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy

from cosim.errors import ModelError, SimulationError
from cosim.master import marks, modules
from cosim.ssp.system import Component, Value, Variable

STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
WARNING, DISCARD, FATAL = 1, 2, 4
MOST_MESSAGES = 200

SetGetReal = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p
)
DoStep = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)


def status_name(status: int) -> str:
    """Name of a status; only 0 to 5 have one."""
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
    decoded = [(part or b"").decode("utf-8", "replace") for part in (category, text)]
    messages.append(Message(status, *decoded))
    if hear is not None:
        hear(name, Message(status, *decoded))


_logger = fmi2CallbackLoggerTYPE(_listen)


def _callbacks(number: int) -> fmi2CallbackFunctions:
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = _logger
    callbacks.allocateMemory = defaultCallbacks.allocateMemory
    callbacks.freeMemory = defaultCallbacks.freeMemory
    callbacks.componentEnvironment = number
    addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


class Instance:
    """An instantiated component.

    Attributes:
        name: of the component.
        messages: the last messages of the FMU, oldest first; cleared by `fresh`.
        renew: each run takes a new instance of the library loaded anew, as with fmpy. What others compiled does not always
            come back by fmi2Reset to where it began: FMUs of 20-sim keep their clock, and some free twice what they freed.
        pointer: address of the FMU's component, for the compiled loop.
        set_real, get_real, set_integer, get_integer, set_boolean, get_boolean, do_step: addresses of its C functions.
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
        self.renew = not fmu.ours and fmu.module is None
        self._state: ctypes.c_void_p | None = None
        modules.claim(fmu)
        self._load()
        self._number = next(_numbers)
        _listeners[self._number] = self.messages
        self._callbacks = _callbacks(self._number)  # must outlive the instance
        _remember(self._number, self._slave.dll)
        modules.entered(fmu)
        self._instantiate()

    def _load(self) -> None:
        fmu = self.component.fmu
        try:
            with _loading, self._marked(marks.LOAD):
                self._slave = FMU2Slave(
                    guid=fmu.guid,
                    unzipDirectory=str(fmu.folder),
                    modelIdentifier=fmu.identifier,
                    instanceName=self.name,
                )
        except Exception as error:  # fmpy raises bare exceptions
            raise ModelError(f"{fmu.source}: the library cannot be loaded: {error}") from None
        self._bind()

    def _bind(self) -> None:
        self.set_real = self._address("fmi2SetReal")
        self.get_real = self._address("fmi2GetReal")
        self.set_integer = self._address("fmi2SetInteger")
        self.get_integer = self._address("fmi2GetInteger")
        self.set_boolean = self._address("fmi2SetBoolean")
        self.get_boolean = self._address("fmi2GetBoolean")
        self.do_step = self._address("fmi2DoStep")

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
                    f"{self.component.fmu.source}: the library cannot be loaded again: {error}"
                ) from None
            finally:
                os.chdir(here)
        for name, old in slave._functions.items():
            new = getattr(slave.dll, name)
            new.argnames, new.argtypes, new.restype = old.argnames, old.argtypes, old.restype
            slave._functions[name] = new
        self._bind()

    def _address(self, name: str) -> int:
        return ctypes.cast(getattr(self._slave.dll, name), ctypes.c_void_p).value or 0

    def _instantiate(self) -> None:
        try:
            with self._marked(marks.function("fmi2Instantiate")):
                self._slave.instantiate(callbacks=self._callbacks, loggingOn=True)
        except Exception:  # fmpy raises a bare Exception for a null pointer
            raise SimulationError(self.report("could not be instantiated")) from None
        self.alive, self._used = True, False
        modules.keep(self.component.fmu)
        self.pointer = int(self._slave.component)
        self._state = None
        if self.component.fmu.restarts:
            state = ctypes.c_void_p()
            if 0 <= self._status("fmi2GetFMUstate", ctypes.byref(state)) <= WARNING:
                self._state = state

    def fresh(self) -> None:
        """Bring the instance to where it was after instantiation; one that broke or cannot be reset is made anew.

        Raises:
            SimulationError: the FMU refuses to be instantiated again.
        """
        if self.alive and self._used and self._state is not None:
            status = self._status("fmi2SetFMUstate", self._state)
            if 0 <= status <= WARNING:
                self.messages.clear()
                return
            self.failed(status)
            self._state = None
        if self.alive and self._used and not self.renew:
            status = self._status("fmi2Reset")
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
            self._status("fmi2FreeFMUstate", ctypes.byref(self._state))
            self._state = None
        self.alive = False
        with self._marked(marks.function("fmi2FreeInstance")):
            self._slave.fmi2FreeInstance(self._slave.component)

    def call(self, function: str, *arguments: Any) -> None:
        """Call a C function of the FMU with this component first.

        Raises:
            SimulationError: it answers with anything worse than a warning; the message holds what the FMU logged.
        """
        status = self._status(function, *arguments)
        if not 0 <= status <= WARNING:
            self.failed(status)
            raise SimulationError(self.report(f"failed in {function} (status {status_name(status)})"))

    def _status(self, function: str, *arguments: Any) -> int:
        """What a function of FMI answers; fmpy takes every number below 2 for success."""
        with self._marked(marks.function(function)):
            try:
                return int(getattr(self._slave, function)(self._slave.component, *arguments))
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
        if status >= FATAL or status < 0:
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
        function, array = _encoded(variable.kind, value)
        what = f"refuses {variable.name} = {value!r} {variable.unit}".rstrip()
        status = self._status(function, reference, 1, array)
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

    def terminate(self) -> None:
        """End a run; a failure here changes no result and is ignored."""
        if self.alive:
            self._status("fmi2Terminate")

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


def _encoded(kind: str, value: Value) -> tuple[str, Any]:
    """The C function that sets a variable of this kind, and the value as its array of one."""
    if kind == "Real":
        return "fmi2SetReal", (ctypes.c_double * 1)(float(value))
    if kind == "Boolean":
        return "fmi2SetBoolean", (ctypes.c_int * 1)(int(bool(value)))
    if kind == "String":
        return "fmi2SetString", (ctypes.c_char_p * 1)(str(value).encode("utf-8"))
    return "fmi2SetInteger", (ctypes.c_int * 1)(int(value))
