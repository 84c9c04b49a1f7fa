"""How much a simulation with FMUs of others may take."""

import math
import os
from dataclasses import dataclass
from typing import Self

from cosim.errors import UsageError

STALL = 60.0  # s; a step of a slow FMU takes seconds
MEMORY = 4096.0  # MiB
RUN = 120.0  # s; where hundreds of runs are needed
LEAST_MEMORY = 16.0  # MiB; less is a mistake in the unit


@dataclass(frozen=True)
class Limits:
    """Limits of the child process in which FMUs of others run.

    Attributes:
        stall: longest time that one call of an FMU may take [s].
        memory: what the FMUs may add to the memory of the process [MiB].
        run: longest time that one of hundreds of runs may take, such as those of a diagnosis [s].
    """

    stall: float = STALL
    memory: float = MEMORY
    run: float = RUN

    def __post_init__(self) -> None:
        if not self.stall > 0.0:
            raise UsageError(f"a stall limit of {self.stall} s is none: give a positive time")
        if not self.run > 0.0:
            raise UsageError(f"COSIM_RUN={self.run} s is no limit: give a positive time")
        if not self.memory >= LEAST_MEMORY:
            raise UsageError(
                f"a memory limit of {self.memory} MiB is too small: {LEAST_MEMORY:g} MiB at least"
            )

    @classmethod
    def usual(cls) -> Self:
        """The defaults, or COSIM_STALL [s], COSIM_MEMORY [MiB] and COSIM_RUN [s].

        Raises:
            UsageError: one of them is no number, or too small.
        """
        return cls(
            _from_environment("COSIM_STALL", STALL),
            _from_environment("COSIM_MEMORY", MEMORY),
            _from_environment("COSIM_RUN", RUN),
        )


def _from_environment(name: str, usual: float) -> float:
    text = os.environ.get(name)
    try:
        value = float(text) if text else usual
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise UsageError(f"{name}={text} is no number")
    return value
