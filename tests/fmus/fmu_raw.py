"""One FMU instance through fmpy's thin bindings: statuses as numbers, and what was logged."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fmpy import calloc, free, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)

STIMULUS = b"time,u\n0,0\n0.1,1\n0.35,-0.5\n0.6,0.25\n"
OK, DISCARD, ERROR, FATAL = 0, 2, 3, 4


class Instance:
    """An instance of an unpacked FMU.

    Attributes:
        messages: what it logged, in order.
        vr: value reference by variable name.
    """

    def __init__(self, folder: Path, name: str = "instance", logging: bool = True) -> None:
        self.description = read_model_description(str(folder), validate=False)
        self.vr = {v.name: v.valueReference for v in self.description.modelVariables}
        self.causality = {v.name: v.causality for v in self.description.modelVariables}
        self.type = {v.name: v.type for v in self.description.modelVariables}
        self.messages: list[str] = []
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(self.log)
        callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        self.fmu = FMU2Slave(
            guid=self.description.guid, unzipDirectory=str(folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier, instanceName=name,
        )  # fmt: skip
        self.fmu.instantiate(callbacks=callbacks, loggingOn=logging)

    def log(self, environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        self.messages.append(message.decode())

    def status(self, call: Callable[..., Any], *arguments: Any) -> int:
        """Status of a call: 0 if fmpy raised nothing."""
        try:
            call(*arguments)
        except FMICallException as error:
            return int(error.status)
        return OK

    def initialise(self, start_time: float = 0.0, **values: float) -> "Instance":
        """Set start values and go through initialisation."""
        self.fmu.setupExperiment(startTime=start_time)
        self.set(**values)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def set(self, **values: float) -> None:
        for name, value in values.items():
            setter = self.fmu.setInteger if self.type[name] == "Integer" else self.fmu.setReal
            setter([self.vr[name]], [int(value) if self.type[name] == "Integer" else value])

    def get(self, *names: str) -> list[float]:
        return self.fmu.getReal([self.vr[n] for n in names])

    @property
    def inputs(self) -> list[str]:
        return [n for n, c in self.causality.items() if c == "input"]

    @property
    def outputs(self) -> list[str]:
        return [n for n, c in self.causality.items() if c == "output"]

    def step(self, time: float, h: float = 1e-3) -> int:
        return self.status(self.fmu.doStep, time, h)

    def play(self, rows: Sequence[Sequence[float]], h: float = 1e-3, first: int = 0) -> list[list[float]]:
        """Outputs after each step; row k of inputs is set before the step from (first + k) h."""
        found = []
        for k, row in enumerate(rows):
            if self.inputs:
                self.fmu.setReal([self.vr[n] for n in self.inputs], list(row))
            self.fmu.doStep((first + k) * h, h)
            found.append(self.get(*self.outputs))
        return found

    def state_bytes(self) -> bytes:
        """The whole state, serialised."""
        state = self.fmu.getFMUstate()
        data = self.fmu.serializeFMUstate(state)
        self.fmu.freeFMUstate(state)
        return bytes(data)

    def restore_bytes(self, data: bytes) -> None:
        state = self.fmu.deSerializeFMUstate(data)
        self.fmu.setFMUstate(state)
        self.fmu.freeFMUstate(state)

    def close(self) -> None:
        self.fmu.freeInstance()
