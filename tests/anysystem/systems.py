"""A valve that drives a plant, both FMUs of strangers, and logs of it with something hidden."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.systems.truth import Hidden, read, simulate

KINDS = {"valve": "lag", "plant": "second"}
VALUES = {"valve": {"K": 2.0, "T": 0.1}, "plant": {"K": 0.7, "W": 5.0, "ZETA": 0.4}}
WIRES = [("command", "valve.u"), ("valve.y", "plant.u")]
H, COUNT = 0.01, 1500


def command(rng: np.random.Generator, count: int = COUNT) -> np.ndarray:
    """Steps and three sines."""
    t = H * np.arange(count)
    steps = np.repeat(rng.uniform(-1.0, 1.0, count // 100 + 1), 100)[:count]
    return steps + sum(
        rng.uniform(0.1, 0.3) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.2, 0.7, 1.6)
    )


def log(
    path: Path,
    hidden: Sequence[Hidden],
    seed: int,
    columns: Sequence[str] = ("command", "valve.y", "plant.y"),
    values=VALUES,
    every: int = 1,
) -> Path:
    """A log of the system with these columns, ``component.connector [1]``, of this many steps each."""
    rng = np.random.default_rng(seed)
    drive = command(rng)
    if every > 1:  # what a slow logger sees of a command is what it takes between its samples
        slow = np.arange(0, COUNT, every)
        drive = np.interp(np.arange(COUNT), slow, drive[slow])
    true = simulate(KINDS, values, WIRES, {"command": drive}, H, hidden)
    signals = {n: s[::every] for n, s in read(true, hidden, H, 0.01, rng).items()}
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time [s]", *(f"{n} [1]" for n in columns)])
        writer.writerows(zip(H * np.arange(0, COUNT, every), *(signals[n] for n in columns), strict=True))
    return path
