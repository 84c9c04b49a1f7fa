"""The command that a closed package plays: a CSV with the columns ``time [s]`` and ``u [1]``."""

import csv
import io
import math

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError

Array = NDArray[np.float64]

RATE = 1000.0  # Hz, the rate of the rig's log (SYSTEM section 2)
STEPS = ((14.0, 0.0), (15.0, 0.5), (16.5, 0.0), (17.0, -0.5), (18.5, 0.25), (19.0, -0.75), (20.0, 0.0))


def default_command(duration: float = 20.0) -> tuple[Array, Array]:
    """The command played unless another is given: two periods of a half-amplitude sine of 1 rad/s, then steps.

    Behind 20 s it starts again.

    Args:
        duration: s, at least one sample.

    Returns:
        Times in s and the command, each of length ``round(duration * 1000) + 1``.
    """
    times = np.arange(round(duration * RATE) + 1) / RATE
    phase = times % STEPS[-1][0]
    levels = np.array([level for _, level in STEPS])
    row = np.searchsorted([start for start, _ in STEPS], phase, side="right") - 1
    stepped = np.where(row >= 0, levels[row], 0.0)
    return times, np.where(phase < 4.0 * math.pi, 0.5 * np.sin(phase), stepped)


def default_stimulus() -> bytes:
    """The CSV of the command played unless another is given."""
    return stimulus_csv(*default_command())


def stimulus_csv(times: Array, command: Array) -> bytes:
    """A command as the CSV that a stimulus FMU plays; every number reads back as the same double.

    Args:
        times: s, increasing, shape (n,).
        command: shape (n,).

    Raises:
        DataError: the shapes differ, a number is not finite, or time does not increase.
    """
    if times.shape != command.shape or times.ndim != 1 or not times.size:
        raise DataError(f"a stimulus needs as many times as commands: got {times.shape} and {command.shape}")
    rows = "".join(f"{t!r},{u!r}\n" for t, u in zip(map(float, times), map(float, command), strict=True))
    data = f"time [s],u [1]\n{rows}".encode()
    stop_time(data)
    return data


def stop_time(data: bytes, name: str = "stimulus") -> float:
    """Time of the last sample of a stimulus, s, after a check of the whole.

    Raises:
        DataError: a row is not two finite numbers, or time does not increase; the message names the row.
    """
    last = -math.inf
    rows = csv.reader(io.StringIO(data.decode("utf-8")))
    next(rows, None)
    for number, row in enumerate(rows, 2):
        try:
            time, value = (float(cell) for cell in row)
        except ValueError:
            raise DataError(f"{name}, row {number}: expected a time and a command, found {row}") from None
        if not (math.isfinite(time) and math.isfinite(value)):
            raise DataError(f"{name}, row {number}: time and command must be finite, found {row}")
        if time <= last:
            raise DataError(f"{name}, row {number}: time must increase, but {time:g} s follows {last:g} s")
        last = time
    if not math.isfinite(last):
        raise DataError(f"{name}: there is no sample behind the header row")
    return last
