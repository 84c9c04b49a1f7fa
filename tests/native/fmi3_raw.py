"""One instance of an FMU of FMI 3.0 through fmpy's thin bindings: statuses as numbers, and what was logged."""

import re
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from fmpy import read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Model, FMU3Slave

HEADER = (files("fmpy") / "c-code" / "fmi3Functions.h").read_text()
FUNCTIONS = re.findall(r"^FMI3_Export \w+ +(fmi3\w+);", HEADER, re.M)


class Instance3:
    """An instance of an unpacked FMU; as `fmu_raw.Instance`, or for model exchange.

    Attributes:
        messages: what it logged, in order.
        vr: value reference by variable name.
    """

    def __init__(self, folder: Path, name: str = "instance", exchange: bool = False) -> None:
        self.description = read_model_description(str(folder))
        self.vr = {v.name: v.valueReference for v in self.description.modelVariables}
        self.causality = {v.name: v.causality for v in self.description.modelVariables}
        self.type = {v.name: v.type for v in self.description.modelVariables}
        self.messages: list[str] = []
        kind = FMU3Model if exchange else FMU3Slave
        part = self.description.modelExchange if exchange else self.description.coSimulation
        self.fmu = kind(
            guid=self.description.guid, unzipDirectory=str(folder), modelIdentifier=part.modelIdentifier, instanceName=name,
        )  # fmt: skip
        self.fmu.instantiate(logMessage=self.log)

    def log(self, environment: Any, status: int, category: bytes, message: bytes) -> None:
        self.messages.append(message.decode())

    def status(self, call: Callable[..., Any], *arguments: Any) -> int:
        """Status of a call: 0 if fmpy raised nothing."""
        try:
            call(*arguments)
        except FMICallException as error:
            return int(error.status)
        return 0

    def initialise(self, start_time: float = 0.0, **values: float) -> "Instance3":
        """Set start values and go through initialisation."""
        self.set(**values)
        self.fmu.enterInitializationMode(startTime=start_time)
        self.fmu.exitInitializationMode()
        return self

    def set(self, **values: float) -> None:
        for name, value in values.items():
            if self.type[name] == "Int32":
                self.fmu.setInt32([self.vr[name]], [int(value)])
            else:
                self.fmu.setFloat64([self.vr[name]], [value])

    def get(self, *names: str) -> list[float]:
        return self.fmu.getFloat64([self.vr[n] for n in names])

    @property
    def inputs(self) -> list[str]:
        return [n for n, c in self.causality.items() if c == "input"]

    @property
    def outputs(self) -> list[str]:
        return [n for n, c in self.causality.items() if c == "output"]

    def play(self, rows: Sequence[Sequence[float]], h: float = 1e-3, first: int = 0) -> list[list[float]]:
        """Outputs after each step; row k of inputs is set before the step from (first + k) h."""
        found = []
        for k, row in enumerate(rows):
            if self.inputs:
                self.fmu.setFloat64([self.vr[n] for n in self.inputs], list(row))
            self.fmu.doStep((first + k) * h, h)
            found.append(self.get(*self.outputs))
        return found

    def state_bytes(self) -> bytes:
        """The whole state, serialised."""
        state = self.fmu.getFMUState()
        data = self.fmu.serializeFMUState(state)
        self.fmu.freeFMUState(state)
        return bytes(data)

    def restore_bytes(self, data: bytes) -> None:
        state = self.fmu.deserializeFMUState(data)
        self.fmu.setFMUState(state)
        self.fmu.freeFMUState(state)
