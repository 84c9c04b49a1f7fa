"""Commands for the virtual rig: pure functions of time, within -1 .. 1 and of zero mean: the slew angle comes back.

Every function takes `time` (n,) [s] rising from 0, an `amplitude` [1] and a `seed`, and returns u (n,) [1], the command
held over the millisecond that starts at each time.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import DataError, UsageError
from cosim.rig.hidden import closest
from cosim.rig.noise import stream

Array = NDArray[np.float64]

SOURCE_FREQUENCIES = np.linspace(0.1, 50.0, 1000)  # rad/s, SYSTEM section 8
MIXED_SECTIONS = ("steps", "triangle", "sweep", "multisine", "small_steps")
_REST = 0.5  # s of zero command that closes a section


def sweep_frequencies(duration: float) -> Array:
    """The most frequencies [rad/s] of the source's grid, spaced evenly on a log scale, whose periods fit in `duration` [s].

    The lowest period takes at most a quarter of the time.

    Raises:
        UsageError: not even one short period fits.
    """
    low = max(SOURCE_FREQUENCIES[0], 2 * math.pi / (0.25 * duration)) if duration > 0 else math.inf
    if low > SOURCE_FREQUENCIES[-1]:
        raise UsageError(f"a stepped sine sweep needs more than {duration:g} s: ask for a longer duration")
    best = SOURCE_FREQUENCIES[low <= SOURCE_FREQUENCIES][:1]
    for count in range(2, 200):
        wanted = np.geomspace(low, SOURCE_FREQUENCIES[-1], count)
        index = np.unique(np.searchsorted(SOURCE_FREQUENCIES, wanted).clip(0, SOURCE_FREQUENCIES.size - 1))
        if np.sum(2 * math.pi / SOURCE_FREQUENCIES[index]) > duration:
            break
        best = SOURCE_FREQUENCIES[index]
    return best


def sweep(
    time: Array, amplitude: float = 1.0, seed: int = 1, frequencies: Sequence[float] | None = None
) -> Array:
    """The source's stepped sine: one whole period of each frequency [rad/s] in turn, then zero (SYSTEM section 8)."""
    chosen = sweep_frequencies(_length(time)) if frequencies is None else np.asarray(frequencies, dtype=float)
    ends = np.cumsum(2 * math.pi / chosen)
    index = np.searchsorted(ends, time, side="right")
    inside = index < chosen.size
    which = np.where(inside, index, 0)
    start = np.where(which > 0, ends[which - 1], 0.0)
    return np.where(inside, amplitude * np.sin(chosen[which] * (time - start)), 0.0)


def square(
    time: Array, amplitude: float = 1.0, seed: int = 1, frequencies: Sequence[float] | None = None
) -> Array:
    """The source's square waves (figs 4.5, 5.7, 5.9b): as `sweep`, each sine by its sign; half a period +A, half -A."""
    return amplitude * np.sign(sweep(time, 1.0, seed, frequencies))


def _held(time: Array, levels: Callable[[np.random.Generator], float], hold: tuple[float, float], name: str,
          seed: int) -> Array:  # fmt: skip
    """Pairs +a, 0, -a, 0 (or mirrored) of random level and hold [s]; only whole pairs, so that the mean is zero."""
    rng = stream(seed, name)
    end = _length(time)
    u = np.zeros_like(time)
    start = 0.2
    while True:
        level = levels(rng) * (1.0 if rng.random() < 0.5 else -1.0)
        length = round(rng.uniform(*hold), 3)
        pause = round(rng.uniform(0.3, 0.3 + 0.5 * hold[0]), 3)
        if start + 2 * (length + pause) > end:
            return u
        second = start + length + pause
        u[(time >= start) & (time < start + length)] = level
        u[(time >= second) & (time < second + length)] = -level
        start = second + length + pause


def steps(time: Array, amplitude: float = 1.0, seed: int = 1) -> Array:
    """Steps of 20 to 100 % of the amplitude, held 0.6 to 1.6 s, in pairs of both signs with a pause after each."""
    return _held(time, lambda rng: amplitude * rng.uniform(0.2, 1.0), (0.6, 1.6), "steps", seed)


def small_steps(time: Array, amplitude: float = 1.0, seed: int = 1) -> Array:
    """Steps of 4 to 20 % of the amplitude, held 0.5 to 1.5 s, in pairs of both signs with a pause after each."""
    return _held(time, lambda rng: amplitude * rng.uniform(0.04, 0.2), (0.5, 1.5), "small_steps", seed)


def triangle(time: Array, amplitude: float = 1.0, seed: int = 1) -> Array:
    """Slow ramps 0, +A, 0, -A, 0: whole periods of about 20 s, as many as fit."""
    length = _length(time)
    period = length / max(1, round(length / 20.0))
    phase = np.mod(time / period + 0.25, 1.0)
    return amplitude * (1.0 - 4.0 * np.abs(phase - 0.5))


def multisine(
    time: Array, amplitude: float = 1.0, seed: int = 1, band: tuple[float, float] = (0.6, 20.0)
) -> Array:
    """Sum of all harmonics of the duration inside `band` [rad/s], equal in the angle (1/w is not applied), random phases.

    The peak is the amplitude; the mean over the duration is zero.

    Raises:
        UsageError: no harmonic lies in the band.
    """
    length = _length(time)
    base = 2 * math.pi / length
    orders = np.arange(max(1, math.ceil(band[0] / base)), math.floor(band[1] / base) + 1)
    if orders.size == 0:
        raise UsageError(
            f"no harmonic of {length:g} s lies in {band[0]:g} .. {band[1]:g} rad/s: widen the band"
        )
    if orders.size > 60:  # a sparse comb keeps each line well above the noise
        orders = np.unique(np.round(np.geomspace(orders[0], orders[-1], 60)).astype(int))
    phases = stream(seed, "multisine").uniform(0.0, 2 * math.pi, orders.size)
    u = np.zeros_like(time)
    for order, phase in zip(orders, phases, strict=True):
        u += np.sin(order * base * time + phase)
    return amplitude * u / np.max(np.abs(u))


def chirp(
    time: Array, amplitude: float = 1.0, seed: int = 1, band: tuple[float, float] = (0.3, 50.0)
) -> Array:
    """Sine whose frequency rises exponentially through `band` [rad/s]."""
    ratio = math.log(band[1] / band[0])
    length = _length(time)
    return amplitude * np.sin(band[0] * length / ratio * (np.exp(ratio * time / length) - 1.0))


def mixed(time: Array, amplitude: float = 1.0, seed: int = 1) -> Array:
    """MIXED_SECTIONS one after the other, in equal shares of the time, with half a second of rest before and after each."""
    u = np.zeros_like(time)
    share = (_length(time) - _REST) / len(MIXED_SECTIONS)
    if share < 4.0:
        raise UsageError(
            "the mixed excitation needs at least 21 s: ask for a longer duration or one of its sections"
        )
    for i, name in enumerate(MIXED_SECTIONS):
        start = _REST + i * share
        part = (time >= start) & (time < start + share - _REST)
        u[part] = EXCITATIONS[name](time[part] - time[part][0], amplitude, seed)
    return u


def _length(time: Array) -> float:
    """Time [s] that the samples cover, the last one's hold included."""
    return float(time[-1] - time[0] + (time[1] - time[0])) if time.size > 1 else 0.0


EXCITATIONS: dict[str, Callable[[Array, float, int], Array]] = {
    "mixed": mixed,
    "sweep": sweep,
    "square": square,
    "steps": steps,
    "small_steps": small_steps,
    "triangle": triangle,
    "multisine": multisine,
    "chirp": chirp,
}


def read_command(path: Path) -> tuple[Array, Array]:
    """Times [s] and commands [1] of a CSV with the columns ``time [s]`` and ``u [1]``.

    Raises:
        DataError: the file cannot be read, a column is missing, or a row is not usable; the message names the row.
    """
    import pandas as pd

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read as CSV: {error}") from None
    for column in ("time [s]", "u [1]"):
        if column not in table.columns:
            raise DataError(f"{path}: no column '{column}'; it has: {', '.join(map(str, table.columns))}")
    time = pd.to_numeric(table["time [s]"], errors="coerce").to_numpy(dtype=float)
    u = pd.to_numeric(table["u [1]"], errors="coerce").to_numpy(dtype=float)
    if time.size == 0:
        raise DataError(f"{path}: no rows")
    bad = np.flatnonzero(~np.isfinite(time) | ~np.isfinite(u))
    if bad.size:
        raise DataError(f"{path}: row {bad[0] + 2}: time or u is not a number")
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        raise DataError(f"{path}: row {back[0] + 3}: column 'time [s]' does not rise")
    big = np.flatnonzero(np.abs(u) > 1.0)
    if big.size:
        raise DataError(f"{path}: row {big[0] + 2}: column 'u [1]' is {u[big[0]]:g}, outside -1 .. 1")
    return time - time[0], u


def command(name: str, time: Array, amplitude: float = 1.0, seed: int = 1, path: Path | None = None) -> Array:
    """The command u (n,) of the excitation `name` (or ``file``, played from `path`) at `time` (n,) [s].

    Raises:
        UsageError: the name is unknown, or the amplitude is outside 0 .. 1.
        DataError: the file is bad.
    """
    if not 0.0 <= amplitude <= 1.0:
        raise UsageError(f"amplitude {amplitude:g} is outside 0 .. 1")
    if name == "file":
        if path is None:
            raise UsageError("the excitation 'file' needs the file to play: --input FILE.csv")
        stamps, values = read_command(path)
        # half a microsecond: a stamp printed with few digits still belongs to its own millisecond
        index = np.searchsorted(stamps, time + 5e-7, side="right") - 1
        return amplitude * values[index]
    if name not in EXCITATIONS:
        raise UsageError(f"unknown excitation '{name}': {closest(name, [*EXCITATIONS, 'file'])}")
    # a product of factors within 1 may still round to just above
    return np.clip(EXCITATIONS[name](time, amplitude, seed), -amplitude, amplitude)
