"""What a data logger keeps of a run: an operator's command, sensors with their flaws, rows at its own rate, a CSV."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.second.machine import TICK

Array = NDArray[np.float64]
DEG = np.pi / 180.0
NOISE = {"spool": 0.005e-3, "p_supply": 0.1e5, "p_a": 0.1e5, "p_b": 0.1e5, "slew": 0.01 * DEG}
COLUMNS = {
    "spool": ("spool [mm]", 1e-3, 5),
    "p_supply": ("p_supply [bar]", 1e5, 4),
    "p_a": ("p_a [bar]", 1e5, 4),
    "p_b": ("p_b [bar]", 1e5, 4),
    "slew": ("slew [deg]", DEG, 6),
}
# the true signal and the sensor whose noise it is seen in
SEEN_BY = {"spool": "spool", "p_supply": "p_supply", "p_load": "p_a", "angle": "slew"}
COMMANDS = ("jog", "stairs", "sines", "chirps", "random")


@dataclass(frozen=True)
class Sensing:
    """Flaws of slew sensor and tracker, and of the logger.

    Attributes:
        gain, bias, drift: of the slew sensor [1, rad, rad/s].
        quantum: step of its reading [rad], rounded `down` or to the nearest.
        ecc, turns, phase: an eccentric encoder reads this much too much [rad], as often a turn, from this phase on [rad].
        stale: share of lost packets, in bursts of `burst` samples on average.
        noise: factor on the sensors' usual noise; `colour` its correlation time [s], 0 for white.
        rate: rows a second; the command changes at the rows only.
        columns: signals that are kept.
        offset, clock, seam, frames: the tracker's [s, 1, rad, 1/s]; frames 0 for no tracker.
    """

    gain: float = 1.0
    bias: float = 0.0
    drift: float = 0.0
    quantum: float = 0.0
    down: bool = False
    ecc: float = 0.0
    turns: float = 10.0
    phase: float = 0.0
    stale: float = 0.0
    burst: float = 1.0
    noise: float = 1.0
    colour: float = 0.0
    rate: int = 1000
    columns: tuple[str, ...] = tuple(COLUMNS)
    offset: float = 0.0
    clock: float = 1.0
    seam: float = 0.0
    frames: float = 0.0


def command(name: str, duration: float, amplitude: float, rate: int, rng: np.random.Generator) -> Array:
    """An operator's command (n,) [1] at 1 kHz that changes `rate` times a second at most and returns to where it began."""
    time = np.arange(round(duration / TICK) + 1) * TICK
    if name == "sines":
        w = np.exp(rng.uniform(np.log(0.4), np.log(15.0), 7))
        waves = np.sin(np.outer(time, w) + rng.uniform(0.0, 2.0 * np.pi, 7)) / np.sqrt(w)
        u = waves.sum(axis=1) * (0.3 + 0.7 * np.sin(np.pi * time / duration) ** 2)
    elif name == "chirps":
        rise = np.abs(((time / duration * 3.0) % 2.0) - 1.0)
        w = 0.5 * (24.0**rise)
        u = np.sin(np.cumsum(w) * TICK) * (0.6 + 0.4 * np.sin(0.9 * time))
    else:
        u = stepped(name, time, rng)
    u[(time < 0.3)] = 0.0
    # the drive integrates: what is asked for must cancel in the long run
    u -= np.where(u == 0.0, 0.0, u[u != 0.0].mean())
    u *= amplitude / np.max(np.abs(u))
    every = round(1.0 / (rate * TICK))
    return np.ascontiguousarray(np.repeat(u[::every], every)[: time.size])


def stepped(name: str, time: Array, rng: np.random.Generator) -> Array:
    """Levels with ramps between them (jog), stairs up and down, or levels that change at random instants."""
    at, travel = [0.0, 0.4], 0.0
    level = [0.0, 0.0]
    stair = 0
    while at[-1] < time[-1]:
        hold = (
            float(rng.uniform(0.3, 2.5))
            if name != "random"
            else float(np.clip(rng.exponential(0.6), 0.08, 3.0))
        )
        if name == "stairs":
            stair += 1
            new = float(np.sin(2.0 * np.pi * stair / 13.0) * rng.uniform(0.8, 1.0))
        else:
            new = float(rng.uniform(-1.0, 1.0)) if rng.random() > 0.2 else 0.0
            new = -abs(new) if travel > 2.0 else abs(new) if travel < -2.0 else new
        ramp = float(rng.uniform(0.05, 0.8)) if name == "jog" else TICK
        at += [at[-1] + ramp, at[-1] + ramp + hold]
        level += [new, new]
        travel += new * hold
    return np.interp(time, at, level)


def coloured(rng: np.random.Generator, count: int, colour: float, step: float = TICK) -> Array:
    """Unit noise (n,), exponentially correlated over `colour` [s]."""
    white = rng.standard_normal(count)
    if colour <= 0.0:
        return white
    pole = float(np.exp(-step / colour))
    return np.asarray(lfilter([np.sqrt(1.0 - pole * pole)], [1.0, -pole], white))


def eccentric(angle: Array, s: Sensing) -> Array:
    """What an eccentric encoder reads too much, (n,) [rad]."""
    return s.ecc * np.sin(s.turns * angle + s.phase)


def read_slew(angle: Array, s: Sensing, rng: np.random.Generator) -> Array:
    """What the slew sensor sends, (n,) [rad]."""
    time = np.arange(angle.size) * TICK
    slew = (
        s.gain * angle
        + s.bias
        + s.drift * time
        + eccentric(angle, s)
        + s.noise * NOISE["slew"] * coloured(rng, angle.size, s.colour)
    )
    if s.quantum > 0.0:
        slew = s.quantum * (np.floor(slew / s.quantum) if s.down else np.round(slew / s.quantum))
    return slew


def lost(count: int, s: Sensing, rng: np.random.Generator) -> NDArray[np.int64]:
    """The row whose reading each of `count` rows shows: rows whose packet was lost show an earlier one."""
    stale = np.zeros(count, dtype=bool)
    if s.stale > 0.0:
        start = rng.random(count) < s.stale / s.burst
        for k in np.flatnonzero(start):
            stale[k : k + rng.geometric(1.0 / s.burst)] = True
        stale[0] = False
    return np.maximum.accumulate(np.where(stale, 0, np.arange(count)))


def write(folder: Path, u: Array, true: dict[str, Array], s: Sensing, rng: np.random.Generator) -> list[str]:
    """Write ``log.csv`` and, with a tracker, ``tracker.csv``; the arguments that `cosim diagnose` needs for them."""
    folder.mkdir(parents=True, exist_ok=True)
    n = u.size
    ideal = {
        "spool": true["spool"],
        "p_supply": true["p_supply"],
        "p_a": 0.5 * (true["p_supply"] + true["p_load"]),
        "p_b": 0.5 * (true["p_supply"] - true["p_load"]),
    }
    every = round(1.0 / (s.rate * TICK))
    table = {"time [s]": np.round(np.arange(n)[::every] * TICK, 6), "u [1]": np.round(u[::every], 7)}
    for name, (column, unit, digits) in COLUMNS.items():
        # every sensor draws, kept or not: leaving one out changes nothing in the others
        values = read_slew(true["angle"], s, rng) if name == "slew" else (
            ideal[name] + s.noise * NOISE[name] * coloured(rng, n, s.colour)
        )  # fmt: skip
        rows = values[::every]
        if name == "slew":
            rows = rows[lost(rows.size, s, rng)]
        if name in s.columns:
            table[column] = np.round(rows / unit, digits)
    table["synthetic [1]"] = 1
    pd.DataFrame(table).to_csv(folder / "log.csv", index=False)
    if s.frames <= 0.0:
        return [str(folder / "log.csv")]
    time = np.arange(n) * TICK
    stamps = np.arange(0.0, (time[-1] - s.offset) / s.clock, 1.0 / s.frames)
    stamps = stamps[stamps * s.clock + s.offset >= 0.0]
    angle = np.interp(s.offset + s.clock * stamps, time, true["far"])
    angle = angle + np.where(angle < 12.0 * DEG, s.seam, 0.0) + s.noise * NOISE["slew"] * coloured(
        rng, stamps.size, s.colour, 1.0 / s.frames
    )  # fmt: skip
    tracked = {
        "time [s]": np.round(stamps, 6),
        "slew_external [deg]": np.round(angle / DEG, 6),
        "synthetic [1]": 1,
    }
    pd.DataFrame(tracked).to_csv(folder / "tracker.csv", index=False)
    return [str(folder / "log.csv"), "--external", str(folder / "tracker.csv")]
