"""Damaged logs, reader by reader: each must load equal, warn, or be refused by name; never crash, never differ in silence.

    python benchmarks/log_damage.py [--readers csv,tdms] [--count 1000] [--seed 1] [--json]

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
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import CosimError
from cosim.logs import Log, load_log, load_mapping, write_log

OUTCOMES = ("equal", "warned", "refused", "small", "shorter", "silent", "crash")
ROWS = 900
STEP = 0.001  # s
LONGEST = 20  # s
NOISE = {"u": 0.0, "spool": 0.005, "p_a": 0.1, "p_b": 0.1, "slew": 0.01}
SMALL = {**{name: 3 * noise for name, noise in NOISE.items()}, "u": 0.003, "time": 0.1 * STEP}
UNITS = {"time": "s", "u": "1", "spool": "mm", "p_a": "bar", "p_b": "bar", "slew": "deg"}

Array = NDArray[np.float64]


def columns() -> dict[str, Array]:
    """A short log in log units: a command in steps, and smooth motion with the rig's noise."""
    random = np.random.default_rng(11)
    time = np.arange(ROWS) * STEP
    u = 0.6 * np.sign(np.sin(9 * time))
    values = {
        "time": time,
        "u": u,
        "spool": 1.8 * np.sin(9 * time - 0.5),
        "p_a": 85 + 20 * np.sin(9 * time - 0.9),
        "p_b": 85 - 20 * np.sin(9 * time - 0.9),
        "slew": 12 + 8 * np.cos(9 * time - 1.2),
    }
    return {
        name: np.round(x + NOISE.get(name, 0.0) * random.standard_normal(ROWS), 6)
        for name, x in values.items()
    }


# One file in each format

Writer = Callable[[Path], Path]


def _headed() -> dict[str, Array]:
    return {f"{name} [{UNITS[name]}]": values for name, values in columns().items()}


def _text(path: Path, separator: str = ",", decimal: str = ".") -> Path:
    """With a remark that no reader looks at."""
    found = _headed()
    lines = [separator.join([*found, "remark"])]
    for k in range(ROWS):
        cells = [f"{values[k]:.9g}".replace(".", decimal) for values in found.values()]
        lines.append(separator.join([*cells, '"by hand"' if k % 90 == 7 else ""]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _controldesk(path: Path) -> Path:
    found = columns()
    names = list(found)[1:]
    head = [
        "descriptions,General,User,x",
        f"trace_size,{ROWS}",
        ",".join(["trace_names", "", *("In1" for _ in names)]),
        ",".join(["trace_units", "", *("" for _ in names)]),
        ",".join(["path", "", *(f"Root/{name}" for name in names)]),
    ]
    rows = [",".join(f"{values[k]:.9g}" for values in found.values()) for k in range(ROWS)]
    path.write_text("\n".join(head) + "\ntrace_values," + "\n,".join(rows) + "\n\n", encoding="utf-8")
    signals = "".join(f"[signals.{n}]\ncolumn = '{n}'\nunit = '{UNITS[n]}'\n" for n in names)
    path.with_suffix(".toml").write_text(f"[time]\ncolumn = 'time'\n{signals}")
    return path


def _ours(path: Path) -> Path:
    return write_log(load_log(_text(path.with_name("plain.csv"))), path)


def _parquet(path: Path) -> Path:
    """As another program writes it: without checksums."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(_headed()), path)
    return path


def _mat(version: str) -> Writer:
    def write(path: Path) -> Path:
        from scipy.io import savemat

        found = columns()
        data = np.column_stack(list(found.values()))
        if version == "4":
            savemat(path, {"data": data, "names": np.array(list(_headed()))}, format="4")
            return path
        content: dict[str, Any] = {**found, "units": UNITS}
        if version == "5":
            savemat(path, content, oned_as="column")
            return path
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # mat-io sets a pandas option that pandas 3 deprecates
            import matio

            matio.save_to_mat(str(path), content, version=version)
        return path

    return write


def _mdf(path: Path, compression: int = 0) -> Path:
    from asammdf import MDF, Signal

    found = columns()
    with MDF(version="4.10") as file:
        file.append(
            [
                Signal(samples=values, timestamps=found["time"], name=name, unit=UNITS[name])
                for name, values in found.items()
                if name != "time"
            ]
        )
        file.save(path, overwrite=True, compression=compression)  # type: ignore[arg-type]
    return path


def _tdms(path: Path) -> Path:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("rig", name, values, properties={"unit_string": UNITS[name]})
                for name, values in columns().items()
            ]
        )
    return path


READERS: dict[str, tuple[str, Writer]] = {
    "csv": (".csv", _text),
    "csv_comma": (".csv", lambda path: _text(path, ";", ",")),
    "controldesk": (".csv", _controldesk),
    "parquet_ours": (".parquet", _ours),
    "parquet": (".parquet", _parquet),
    "mat_ours": (".mat", _ours),
    "mat_v4": (".mat", _mat("4")),
    "mat_v5": (".mat", _mat("5")),
    "mat_v7.3": (".mat", _mat("v7.3")),
    "mf4": (".mf4", _mdf),
    "mf4_zip": (".mf4", lambda path: _mdf(path, 2)),
    "tdms": (".tdms", _tdms),
}


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
    path = folder / f"damaged{sound.path.suffix}"
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
    """What is raised where nobody can catch it, and an end after LONGEST seconds."""
    stray: list[str] = []
    before = sys.unraisablehook

    def late(*_: Any) -> None:
        raise _TooLongError

    sys.unraisablehook = lambda event: stray.append(f"Exception ignored: {event.exc_value!r}")
    handler = signal.signal(signal.SIGALRM, late)
    signal.alarm(LONGEST)
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
