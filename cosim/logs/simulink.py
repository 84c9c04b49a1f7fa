"""A Simulink data set in a MATLAB file of version 7.3, as "Log Dataset data to file" and ``save`` write it.

The samples lie one after the other in ``#sigstream#/<number>/#data#``; a structure in ``#refs#`` says of each signal its
name, its class of numbers, which stream it is (``DataR2``) and when it was sampled: at equal steps (``CompressedTime``:
start, step, count) or at stamps in a stream of their own (``TimeR2``). A data set that lies in memory: `cosim.logs.mat`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import DataError
from cosim.logs.source import Array

STREAMS = "#sigstream#"
CLASSES = {"double": "f8", "single": "f4", "logical": "u1", "boolean": "u1"} | {
    f"{sign}int{bits}": f"{sign or 'i'}{bits // 8}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
CLOCKS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6, "minutes": 60.0, "hours": 3600.0}


@dataclass(frozen=True)
class Stream:
    """One logged signal, or one element of it.

    Attributes:
        name: of the signal, or of the block from which it comes.
        unit: as Simulink knows it, or empty.
        values: (n,).
        stamps: (n,), s.
    """

    name: str
    unit: str
    values: Array
    stamps: Array


def has_streams(path: Path) -> bool:
    """Whether a file holds logged signals of Simulink."""
    with path.open("rb") as file:
        if b"\x89HDF\r\n\x1a\n" not in file.read(1024):
            return False
    import h5py

    with h5py.File(path, "r") as opened:
        return STREAMS in opened


def read_streams(path: Path) -> list[Stream]:
    """The logged signals, in the order of their ports.

    Raises:
        DataError: a signal does not say where its samples lie, or they are not all there.
    """
    import h5py

    with h5py.File(path, "r") as opened:
        found = [
            stream
            for number, signal in enumerate(_signals(opened), 1)
            for stream in _leaves(opened, signal["Values"], _name(opened, signal) or f"signal{number}", path)
        ]
    if not found:
        raise DataError(
            f"{path}: it holds a Simulink data set of a form that only MATLAB can read: there, "
            "writetimetable(extractTimetable(NAME), 'log.csv') writes its signals as a log (NAME: the "
            "variable, often 'out.logsout' or 'data')"
        )
    return found


def _signals(opened: Any) -> list[Any]:
    """The structures that describe signals: in the order of the data set where it is told, else by name."""
    known = {
        name: group
        for name, group in opened.get("#refs#", {}).items()
        if hasattr(group, "keys") and hasattr(group.get("Values"), "keys")
    }
    listed: dict[str, Any] = {}
    for group in opened.get("#refs#", {}).values():
        elements = group.get("Elements") if hasattr(group, "keys") else None
        if elements is None or elements.dtype != object:
            continue
        for reference in elements[()].ravel():
            name = opened[reference].name.rsplit("/", 1)[-1]
            if name in known:
                listed[name] = known[name]
    return list((listed | known).values())


def _leaves(opened: Any, values: Any, name: str, path: Path) -> Iterator[Stream]:
    """The signals in a structure of values; a bus has one in each of its fields."""
    if "DataR2" not in values:
        for field, inner in values.items():
            if hasattr(inner, "keys"):
                yield from _leaves(opened, inner, f"{name}.{field}", path)
        return
    about = values.get("SignalAttributes", {})
    kind = _text(about.get("ResolvedClassName")) or _text(about.get("ClassName")) or "double"
    width = int(np.prod(_numbers(about.get("Dimension")), initial=1.0))
    if kind not in CLASSES or _numbers(about.get("Complexity")).any():
        return  # an enumeration, a fixed-point or a complex number: no reading of a machine
    data = _stream(opened, _numbers(values["DataR2"]), CLASSES[kind], name, path)
    regular, own = _numbers(values.get("CompressedTime")), _numbers(values.get("TimeR2"))
    if own.size:
        stamps = _stream(opened, own, "f8", name, path)
    elif regular.size == 3 and regular[2] * width == data.size:  # a damaged count would fill the memory
        stamps = regular[0] + regular[1] * np.arange(int(regular[2]))
    else:
        raise DataError(f"{path}: signal '{name}' has {data.size} values, but not as many time stamps")
    if width < 1 or data.size != width * stamps.size:
        raise DataError(f"{path}: signal '{name}' has {data.size} values at {stamps.size} time stamps")
    clock = _text(_value(values.get("TimeUnits"))) or "seconds"
    if clock not in CLOCKS:
        raise DataError(f"{path}: signal '{name}' has its time in '{clock}': save it in seconds")
    unit = _text(_value(values.get("DataUnits")))
    for k, column in enumerate(data.reshape(stamps.size, width).T, 1):
        yield Stream(name if width == 1 else f"{name}({k})", unit, column, stamps * CLOCKS[clock])


def _stream(opened: Any, index: Array, kind: str, name: str, path: Path) -> Array:
    """The samples of the stream with a number."""
    place = f"{STREAMS}/{int(index[0])}/#data#" if index.size == 1 else ""
    if not place or place not in opened:
        raise DataError(f"{path}: signal '{name}' does not say where its samples lie")
    data = opened[place][()].astype(np.uint8).tobytes()
    size = np.dtype(kind).itemsize
    return np.frombuffer(data[: len(data) // size * size], f"<{kind}").astype(np.float64)


def _name(opened: Any, signal: Any) -> str:
    """What the signal is called, or else the block that it leaves."""
    named = _text(signal.get("Name")) or _text(signal.get("PropagatedName"))
    blocks = signal.get("BlockPath")
    if named or blocks is None or blocks.dtype != object or not blocks.size:
        return named
    return _text(opened[blocks[()].ravel()[-1]]).rsplit("/", 1)[-1]


def _value(unit: Any) -> Any:
    """The text in a structure of class and value."""
    return unit.get("Value") if hasattr(unit, "keys") else unit


def _numbers(item: Any) -> Array:
    """A numeric data set as (n,); empty for an empty one, or anything else."""
    if item is None or not hasattr(item, "dtype") or item.dtype.kind not in "fiub":
        return np.empty(0)
    if item.attrs.get("MATLAB_empty", 0):
        return np.empty(0)
    return np.asarray(item[()], dtype=np.float64).ravel()


def _text(item: Any) -> str:
    """A text as MATLAB keeps it: a number of 16 bits for each letter."""
    if item is None or not hasattr(item, "dtype") or item.dtype.kind not in "u":
        return ""
    if item.attrs.get("MATLAB_empty", 0):
        return ""
    return np.asarray(item[()], dtype="<u2").ravel().tobytes().decode("utf-16-le", "replace").strip()
