"""How often a sound log is called damaged: ``python benchmarks/sound_logs.py --count 400 --seed 1 [--json]``.

Each log is one of the rig with a random command of some kind (steps, steps and sines, a pseudo-random binary sequence, ramps
with resets, pulses, a stick, ...), with or without a fault of the machine, held at 1 kHz or slower, and read at a random
rate, evenly or not. No value is changed, so that each warning that a signal jumps away is false. ``--damage`` writes zeros,
bytes from elsewhere, other bytes or other bits into each log as well, by columns or by rows of float64, and counts what
nobody notices: damage that differs by more than three times the noise, in a log that loads without a word on jumps.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from scipy.stats import binomtest

from cosim.logs.jumps import jumps
from cosim.rig import make_log
from cosim.rig.excitation import command
from cosim.rig.write import as_log

Array = NDArray[np.float64]

FAULTS = (
    "",
    "mechanical.coulomb_friction:tau_c=200",
    "mechanical.backlash:gap=0.5 deg",
    "mechanical.end_stop",
    "dcv.stroke_limit",
    "dcv.hysteresis",
    "sensor.quantisation",
    "sensor.dropout",
    "sensor.saturation",
)
SMALL = {
    "u": 1e-3,
    "spool": 1.5e-5,
    "p_supply": 3e4,
    "p_a": 3e4,
    "p_b": 3e4,
    "slew": 5e-4,
}  # three times the noise
DAMAGED = 3  # times each log, with --damage


@dataclass(frozen=True)
class Sound:
    """One log: its kind of command, its stamps [s] and its signals, SI."""

    kind: str
    time: Array
    signals: dict[str, Array]


# Commands (n,) [1] of stamps (n,) [s] from zero


def levels(time: Array, rng: np.random.Generator) -> Array:
    """Random levels, each held for a random while."""
    low, high = sorted(rng.uniform(0.05, 2.5, 2))
    ends = np.cumsum(rng.uniform(low, high, int(time[-1] / low) + 2))
    return rng.uniform(-1.0, 1.0, ends.size)[np.searchsorted(ends, time, "right")]


def sine(time: Array, rng: np.random.Generator) -> Array:
    """A sine of 0.05 to 3 Hz."""
    return np.sin(2.0 * np.pi * rng.uniform(0.05, 3.0) * time + rng.uniform(0.0, 6.3))


def binary(time: Array, rng: np.random.Generator) -> Array:
    """A pseudo-random binary sequence."""
    length = rng.uniform(0.02, 0.5)
    return np.sign(rng.uniform(-1.0, 1.0, int(time[-1] / length) + 2))[(time / length).astype(int)]


def sections(time: Array, rng: np.random.Generator) -> Array:
    """Rest, steps, sines and ramps in turn."""
    u, begin = np.zeros_like(time), 0.0
    while begin < time[-1]:
        length = rng.uniform(0.5, 6.0)
        part = (time >= begin) & (time < begin + length)
        own = time[part] - begin
        way = (0.0 * own, 1.0 + 0.0 * own, np.sin(2.0 * np.pi * rng.uniform(0.1, 4.0) * own), own / length)
        u[part] = rng.uniform(-1.0, 1.0) * way[rng.integers(len(way))]
        begin += length
    return u


def pulses(time: Array, rng: np.random.Generator) -> Array:
    """Short pulses of three sizes, with pauses."""
    u, begin = np.zeros_like(time), 0.0
    while begin < time[-1]:
        begin += rng.uniform(0.2, 4.0)
        length = rng.choice([0.01, 0.05, 0.1, 0.3])
        u[(time >= begin) & (time < begin + length)] = rng.choice([-1.0, 1.0, 0.5])
        begin += length
    return u


def stick(time: Array, rng: np.random.Generator) -> Array:
    """A hand on a stick with a dead zone."""
    wander = np.cumsum(rng.normal(0.0, 1.0, time.size)) * np.sqrt(np.mean(np.diff(time)))
    u = np.tanh(np.convolve(wander, np.full(101, 1.0 / 101.0), "same"))
    return np.where(np.abs(u) < 0.2, 0.0, u)


def interrupted(time: Array, rng: np.random.Generator) -> Array:
    """A sine that stops for a while, once to three times."""
    u = sine(time, rng)
    for _ in range(rng.integers(1, 4)):
        begin = rng.uniform(0.0, time[-1])
        u[(time >= begin) & (time < begin + rng.uniform(0.05, 0.25 * time[-1]))] = rng.choice([0.0, 0.5])
    return u


def tapped(time: Array, rng: np.random.Generator) -> Array:
    """A stick that is tapped, once to five times."""
    u = stick(time, rng)
    for begin in rng.uniform(0.0, time[-1], rng.integers(1, 6)):
        u[(time >= begin) & (time < begin + rng.uniform(0.05, 0.3))] += 0.4
    return u


def of_rig(name: str, time: Array, rng: np.random.Generator) -> Array:
    """One of the rig's own."""
    return command(name, time, 1.0, int(rng.integers(1 << 20)))


def ramps(time: Array, rng: np.random.Generator) -> Array:
    """Ramps that begin anew."""
    return np.mod(time / rng.uniform(0.3, 5.0), 1.0) * rng.choice([1.0, 2.0]) - rng.choice([0.0, 1.0])


def staircase(time: Array, rng: np.random.Generator) -> Array:
    """Up and down in equal steps."""
    place = (time / rng.uniform(0.3, 3.0)).astype(int)
    return 1.0 - np.abs(2.0 * place / (place.max() + 1) - 1.0)


def square(time: Array, rng: np.random.Generator) -> Array:
    """A square wave with noise, as a recorder reads an analogue command."""
    return np.where(sine(time, rng) < 0.0, -1.0, 1.0) + rng.normal(0.0, rng.choice([1e-3, 1e-2]), time.size)


KINDS = {
    "steps": lambda t, g: of_rig("steps", t, g),
    "mixed": lambda t, g: of_rig("mixed", t, g),
    "levels": levels,
    "steps and a sine": lambda t, g: 0.6 * levels(t, g) + g.uniform(0.02, 0.5) * sine(t, g),
    "steps and a multisine": lambda t, g: 0.6 * levels(t, g) + g.uniform(0.05, 0.4) * of_rig("multisine", t, g),
    "steps and a chirp": lambda t, g: 0.6 * levels(t, g) + g.uniform(0.05, 0.4) * of_rig("chirp", t, g),
    "binary": binary,
    "binary and a sine": lambda t, g: 0.7 * binary(t, g) + g.uniform(0.02, 0.3) * sine(t, g),
    "ramps": ramps,
    "sections": sections,
    "pulses": pulses,
    "pulses and a slow sine": lambda t, g: pulses(t, g) + 0.02 * np.sin(t),
    "in steps of its own": lambda t, g: 0.05 * np.round((0.6 * levels(t, g) + 0.4 * sine(t, g)) / 0.05),
    "stick": stick,
    "tapped": tapped,
    "staircase": staircase,
    "interrupted": interrupted,
    "square with noise": square,
    "dithered": lambda t, g: 0.7 * levels(t, g) + 0.05 * np.sign(np.sin(2.0 * np.pi * g.uniform(20.0, 60.0) * t)),
    "limited": lambda t, g: np.clip(levels(t, g) + 1.6 * sine(t, g), -0.5, 0.5),
}  # fmt: skip


def sound(count: int, seed: int) -> Iterator[Sound]:
    """So many logs, kind by kind."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        kind = list(KINDS)[k % len(KINDS)]
        duration = int(rng.uniform(21_000, 45_000)) / 1000.0
        time = np.arange(round(1000 * duration)) / 1000.0
        u = np.clip(rng.uniform(0.2, 1.0) * KINDS[kind](time, rng), -1.0, 1.0)
        held = int(rng.choice([1, 1, 1, 5, 10, 20, 50]))
        u = np.repeat(u[::held], held)[: time.size]
        log = as_log(make_log(u, duration, [h for h in (str(rng.choice(FAULTS)),) if h], seed=k))
        reads = rng.choice(["each", "evenly", "evenly", "not evenly"])
        stamps = log.time
        if reads != "each":
            rate = float(np.exp(rng.uniform(np.log(8.0), np.log(1000.0))))
            uneven = 0.4 * rng.uniform(-1.0, 1.0, int(duration * rate)) * (reads == "not evenly")
            stamps = np.cumsum((1.0 + uneven) / rate)
            stamps = stamps[stamps < log.time[-1]]
        at = np.searchsorted(log.time, stamps, "right") - 1
        yield Sound(kind, stamps, {name: values[at] for name, values in log.signals.items()})


def told(log: Sound, signals: dict[str, Array]) -> set[str]:
    """Signals of which it is said that they jump away."""
    found = set()
    for name, values in signals.items():
        others = [other for n, other in signals.items() if n != name]
        if jumps(log.time, values, name == "u", others)[0].size:
            found.add(name)
    return found


def damaged(log: Sound, rng: np.random.Generator) -> dict[str, Array]:
    """The signals with some of their bytes written over, by columns or by rows; those of the command every other time."""
    whole = np.array(list(log.signals.values()))
    by_rows = rng.random() < 0.4
    content = np.ascontiguousarray(whole.T if by_rows else whole).copy()
    data = content.view(np.uint8).reshape(-1)
    at = int(rng.integers(data.size))
    if rng.random() < 0.5 and not by_rows:
        at = list(log.signals).index("u") * whole.shape[1] * 8 + at % (whole.shape[1] * 8)
    length, kind = int(rng.integers(1, 513)), rng.choice(["zero", "over", "bytes", "bits"])
    if kind == "zero":
        data[at : at + length] = 0
    elif kind == "over":
        source = int(rng.integers(data.size - length))
        source = source if rng.random() < 0.5 else source // 8 * 8 + at % 8
        part = data[source : source + length].copy()[: data.size - at]
        data[at : at + part.size] = part
    else:
        for place in (at + rng.integers(0, 64, int(rng.integers(1, 5)))) % data.size:
            data[place] = rng.integers(256) if kind == "bytes" else data[place] ^ (1 << int(rng.integers(8)))
    rows = content.T if by_rows else content
    return dict(zip(log.signals, map(np.ascontiguousarray, rows), strict=True))


def unnoticed(log: Sound, rng: np.random.Generator) -> bool | None:
    """Whether damage is; None where it is small, or a number is none, which is told otherwise."""
    signals = damaged(log, rng)
    if not all(np.isfinite(values).all() for values in signals.values()):
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        off = [float(np.abs(values - log.signals[name]).max()) for name, values in signals.items()]
    if all(one <= SMALL[name] for one, name in zip(off, signals, strict=True)):
        return None
    return not told(log, signals)


def main() -> int:
    """Count and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--damage", action="store_true")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    rng = np.random.default_rng([asked.seed, 1])
    false: Counter[str] = Counter()
    damage: Counter[bool | None] = Counter()
    for log in sound(asked.count, asked.seed):
        names = told(log, log.signals)
        false[log.kind] += bool(names)
        if names and not asked.json:
            print(f"{log.kind}: {', '.join(sorted(names))}", file=sys.stderr, flush=True)
        damage.update(unnoticed(log, rng) for _ in range(DAMAGED * asked.damage))
    rows: dict[str, Any] = {"called damaged": (false.total(), asked.count)}
    if asked.damage:
        rows["damage unnoticed"] = (damage[True], damage[True] + damage[False])
    if asked.json:
        print(json.dumps(rows))
        return 0
    for what, (hits, of) in rows.items():
        low, high = binomtest(hits, of).proportion_ci(0.95, "wilson")
        print(f"{what}: {hits} of {of} ({low:.1%} .. {high:.1%})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
