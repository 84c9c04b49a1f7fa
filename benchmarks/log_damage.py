"""Damaged logs, reader by reader: each must load equal, warn, or be refused by name; never crash, never differ in silence.

    python -m benchmarks.log_damage [--readers csv,tdms] [--count 1000] [--seed 1] [--json]

A small synthetic log is written in each format at run time, damaged at random (bytes changed, bits flipped, a part zeroed,
cut, taken out, repeated or overwritten by another part) and loaded again. What comes of it:

equal     the same numbers to the last bit, perhaps with a warning
warned    other numbers, and a warning that the whole file does not give
refused   a `CosimError` that names the file
small     other numbers in silence, none off by more than three times its signal's noise (u: 0.003; time: a tenth of a step)
shorter   a text cut exactly at the end of a line: what is left is a whole log, which no reader can tell
silent    other numbers in silence
crash     anything else: another exception, a message past the program's own on stderr, more than 20 s
"""

import argparse
import json
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.damage_corpus import READERS, SMALL, UNITS
from cosim.errors import CosimError
from cosim.logs import Log, load_log, load_mapping

OUTCOMES = ("equal", "warned", "refused", "small", "shorter", "silent", "crash")
LONGEST_READ = 20  # s
Array = NDArray[np.float64]


# Damage

SIGNS = b',;\n\r"\t.-+eE0 \0'


def damaged(content: bytes, random: np.random.Generator) -> bytes:
    """The content with one kind of damage."""
    data = bytearray(content)
    size = len(data)
    kind = random.choice(["byte", "bit", "sign", "zero", "cut", "out", "again", "over"])
    at = int(random.integers(size))
    length = int(random.integers(1, 513))
    other = int(random.integers(size))
    if kind in ("byte", "bit", "sign"):
        for place in random.integers(size, size=int(random.integers(1, 5))):
            if kind == "byte":
                data[place] = int(random.integers(256))
            elif kind == "bit":
                data[place] ^= 1 << int(random.integers(8))
            else:
                data[place] = SIGNS[int(random.integers(len(SIGNS)))]
    elif kind == "zero":
        data[at : at + length] = bytes(len(data[at : at + length]))
    elif kind == "cut":
        del data[at:]
    elif kind == "out":
        del data[at : at + length]
    elif kind == "again":
        data[at:at] = data[other : other + length]
    else:
        data[at : at + length] = data[other : other + length][: len(data[at : at + length])]
    return bytes(data)


# What comes of it


@dataclass(frozen=True)
class Whole:
    """A sound file, what it gives, and how to load it."""

    path: Path
    content: bytes
    mapping: Any
    log: Log


@dataclass(frozen=True)
class Trial:
    """One damaged file.

    Attributes:
        outcome: one of OUTCOMES.
        detail: the first message, or what differs.
    """

    outcome: str
    detail: str


def whole(reader: str, folder: Path) -> Whole:
    """Writes the sound file of a reader."""
    suffix, write = READERS[reader]
    path = write(folder / f"{reader}{suffix}".replace("7.3", "73"))
    table = path.with_suffix(".toml")
    mapping = load_mapping(table) if reader == "controldesk" else None
    return Whole(path, path.read_bytes(), mapping, load_log(path, mapping))


def judge(sound: Whole, content: bytes, folder: Path) -> Trial:
    """Loads damaged content and says what came of it."""
    path = folder / f"damaged{''.join(sound.path.suffixes)}"
    path.write_bytes(content)
    try:
        with _watched() as stray:
            log = load_log(path, sound.mapping)
    except CosimError as error:
        text = str(error)
        return Trial("refused" if str(path) in text and not stray else "crash", stray[0] if stray else text)
    except (_TooLongError, Exception) as error:
        return Trial("crash", f"{type(error).__name__}: {error}")
    if stray:
        return Trial("crash", stray[0])
    different = _difference(sound.log, log)
    if not different:
        return Trial("equal", "")
    new = [text for text in log.warnings if text not in sound.log.warnings]
    if new:
        return Trial("warned", new[0])
    if path.suffix == ".csv" and sound.content.startswith(content) and content.endswith(b"\n"):
        return Trial("shorter", f"{len(content)} of {len(sound.content)} bytes")
    small = all(size <= limit for size, limit in different.values())
    return Trial("small" if small else "silent", f"{ {n: size for n, (size, _) in different.items()} }")


def _difference(one: Log, other: Log) -> dict[str, tuple[float, float]]:
    """Signal -> largest difference and what counts as small; infinite where length, names or marks differ."""
    if len(one) != len(other) or set(one.signals) != set(other.signals) or one.synthetic != other.synthetic:
        return {"shape": (float("inf"), 0.0)}
    found = {}
    pairs: Mapping[str, tuple[Array, Array]] = {
        "time": (one.time, other.time),
        **{name: (one[name], other[name]) for name in one.signals},
    }
    for name, (a, b) in pairs.items():
        if not np.array_equal(a, b):
            found[name] = (float(np.abs(a - b).max()), SMALL[name] * _si(one, name))
    return found


def _si(log: Log, name: str) -> float:
    from cosim.signals import conversion

    return 1.0 if name == "time" else conversion(UNITS[name], log.units[name])


class _TooLongError(BaseException):
    pass


@contextmanager
def _watched() -> Iterator[list[str]]:
    """What is raised where nobody can catch it, and an end after LONGEST_READ seconds."""
    stray: list[str] = []
    before = sys.unraisablehook

    def late(*_: Any) -> None:
        raise _TooLongError

    sys.unraisablehook = lambda event: stray.append(f"Exception ignored: {event.exc_value!r}")
    handler = signal.signal(signal.SIGALRM, late)
    signal.alarm(LONGEST_READ)
    try:
        yield stray
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, handler)
        sys.unraisablehook = before


def trials(reader: str, count: int, seed: int = 1) -> Iterator[Trial]:
    """What comes of `count` damaged files of a reader."""
    random = np.random.default_rng([seed, sorted(READERS).index(reader)])
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        sound = whole(reader, folder)
        for _ in range(count):
            content = damaged(sound.content, random)
            while content == sound.content:
                content = damaged(sound.content, random)
            yield judge(sound, content, folder)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--readers", default=",".join(READERS))
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", default="", help="outcomes whose details are printed")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    table = {}
    if not chosen.json:
        print(f"{'reader':14}" + "".join(f"{outcome:>9}" for outcome in OUTCOMES), flush=True)
    for reader in chosen.readers.split(","):
        found = list(trials(reader, chosen.count, chosen.seed))
        counts = Counter(trial.outcome for trial in found)
        table[reader] = {outcome: counts[outcome] for outcome in OUTCOMES}
        if not chosen.json:
            print(f"{reader:14}" + "".join(f"{counts[outcome]:9}" for outcome in OUTCOMES), flush=True)
        for trial in found:
            if trial.outcome in chosen.show.split(","):
                print(f"    {trial.outcome}: {trial.detail[:230]}")
    if chosen.json:
        print(json.dumps(table))


if __name__ == "__main__":
    main()
