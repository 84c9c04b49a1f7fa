"""MATLAB files v4, v5, v7 and v7.3, through mat-io: plain matrices, vectors, structs, timeseries, tables.

Without mat-io, which has no wheel for Python 3.14 yet, scipy reads what it can: all but v7.3, timeseries and tables.

A file is flattened into columns named by their path: ``slew``, ``log.slew``, ``data(:,2)``. A matrix takes the names
of its columns from a list of texts beside it (``names``), units come from a list or struct beside them (``units``).
A signal of Simulink's structure with time is called by its label, else by the block that gave it, else by its variable.
The inputs and outputs of an ``iddata`` of the System Identification Toolbox go by their names (``id.u1``).
A trace that dSPACE's ControlDesk recorded (``X``, ``Y(3).Data``) goes by ``Path`` and ``Name``, as in its CSV export.
"""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import DataError, MissingExtraError
from cosim.logs.clocks import own_clocks, seconds_per
from cosim.logs.controldesk import trace_labels
from cosim.logs.hdf5 import check_heaps
from cosim.logs.mat5 import check_elements
from cosim.logs.simulink import CLOCKS, has_streams, read_streams
from cosim.logs.source import Array, Label, Source, parse_label, translated

_NAMES = ("names", "columns", "headers", "labels", "signals")
_UNITS = ("units", "unit")
_DEPTH = 6
_DATA_SET = "Simulink.SimulationData."
_IDDATA = "iddata"
_AS_V7 = "; or save it in MATLAB by save(..., '-v7')"
_AS_VECTORS = "; or save time and data as vectors in MATLAB"


@dataclass(frozen=True)
class _Entry:
    label: Label
    values: Any  # numeric ndarray (n,), as stored
    clock: Array | None = None


class MatSource(Source):
    """A .mat file.

    Raises:
        DataError: the file is damaged or holds no column of numbers.
        MissingExtraError: mat-io is not installed, and the file holds what only it reads.
    """

    row_word = "sample"

    def __init__(self, path: Path) -> None:
        notes: list[str] = []
        check_heaps(path)
        check_elements(path)
        with translated(path, "MAT", notes):
            constants: dict[str, float] = {}
            self._entries = _logged(path) or list(_flatten(_variables(path), "", constants, 0))
        if not self._entries:
            raise DataError(f"{path}: holds no column of numbers")
        stamps = own_clocks([(e.label, e.values) if e.clock is None else None for e in self._entries])
        self._entries = [replace(e, clock=stamps.get(k, e.clock)) for k, e in enumerate(self._entries)]
        super().__init__(path, [entry.label for entry in self._entries], constants)
        self.warnings += notes

    def read(self, indices: Sequence[int]) -> list[Array]:
        """See `Source.read`."""
        return [np.array(self._entries[k].values, dtype=np.float64) for k in indices]

    def clock(self, index: int) -> Array | None:
        """See `Source.clock`: of a timeseries, Simulink structure with time, recorded trace, vector with its own time."""
        return self._entries[index].clock


def _logged(path: Path) -> list[_Entry]:
    """The signals of a Simulink data set that was logged to a file; none in other files.

    Raises:
        DataError: as `cosim.logs.simulink.read_streams`.
        MissingExtraError: h5py, which comes with mat-io, is not installed.
    """
    try:
        if not has_streams(path):
            return []
    except ImportError:
        raise MissingExtraError(f"{path}: a MATLAB file of version 7.3", "mat", _AS_V7) from None
    return [_Entry(parse_label(s.name, s.unit), s.values, s.stamps) for s in read_streams(path)]


def _variables(path: Path) -> Mapping[str, Any]:
    """The variables of a file, by mat-io where it is installed, else by scipy.

    Raises:
        MissingExtraError: the file holds what scipy cannot read.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # mat-io 1.0 sets a pandas option that pandas 3 deprecates
            import matio
    except ImportError:
        matio = None
    if matio is not None:
        return dict(matio.load_from_mat(str(path)))
    from scipy.io import loadmat

    try:
        content = dict(loadmat(str(path)))
    except NotImplementedError:
        raise MissingExtraError(f"{path}: a MATLAB file of version 7.3", "mat", _AS_V7) from None
    if any(type(value).__name__ == "MatlabOpaque" for value in _values(content)):
        raise MissingExtraError(f"{path}: a timeseries or table in it", "mat", _AS_VECTORS)
    return content


def _values(value: Any, depth: int = 0) -> Iterator[Any]:
    """A value of scipy's reader and all within it."""
    yield value
    if depth > _DEPTH or type(value).__name__ == "MatlabOpaque":
        return
    if isinstance(value, Mapping):
        inner: list[Any] = list(value.values())
    elif isinstance(value, np.ndarray) and value.dtype.names is not None:
        inner = [item[name] for item in value.flat for name in value.dtype.names]
    else:
        inner = list(value.flat) if isinstance(value, np.ndarray) and value.dtype == object else []
    for item in inner:
        yield from _values(item, depth + 1)


def _flatten(
    content: Mapping[str, Any], path: str, constants: dict[str, float], depth: int, clock: Array | None = None
) -> Iterator[_Entry]:
    """The columns in a mapping of names to MATLAB values; single numbers go to `constants`."""
    if traces := _recorded(content):
        yield from traces
        return
    names = next((found for key in _NAMES if (found := _texts(content.get(key)))), [])
    units = next((content[key] for key in _UNITS if key in content), None)
    if clock is None and "signals" in content and "time" in content:  # Simulink's structure with time
        clock = _vector(content["time"])
    for key, value in content.items():
        if key.startswith("__") or depth > _DEPTH:
            continue
        if getattr(value, "classname", "") == _IDDATA and getattr(value, "size", 0) == 1:
            yield from _iddata(_fields(value)[0], f"{path}{key}")
        elif hasattr(value, "properties") and hasattr(value, "classname"):
            yield from _object(value, f"{path}{key}", constants, depth)
        elif hasattr(value, "columns") and hasattr(value, "attrs"):  # table, as a pandas.DataFrame
            frame = {str(name): value[name].to_numpy() for name in value.columns}
            yield from _flatten(frame, f"{path}{key}.", constants, depth + 1)
        elif isinstance(value, np.ndarray):
            yield from _array(value, key, path, names, units, constants, depth, clock)


def _array(
    value: np.ndarray[Any, Any],
    key: str,
    path: str,
    names: list[str],
    units: Any,
    constants: dict[str, float],
    depth: int,
    clock: Array | None,
) -> Iterator[_Entry]:
    if value.dtype.names is not None:
        yield from _structs(value, key, path, constants, depth, clock)
    elif (
        value.dtype == object
        and value.size
        and all(isinstance(item, np.ndarray) and item.dtype.names for item in value.flat)
    ):  # a cell of structs
        for number, item in enumerate(value.flat, 1):
            yield from _structs(
                item, f"{key}{{{number}}}" if value.size > 1 else key, path, constants, depth, clock
            )
    elif value.dtype.kind in "fiub":
        yield from _numbers(value, key, path, names, units, constants, clock)


def _structs(
    value: np.ndarray[Any, Any],
    key: str,
    path: str,
    constants: dict[str, float],
    depth: int,
    clock: Array | None,
) -> Iterator[_Entry]:
    for number, item in enumerate(value.flat, 1):
        name = f"{path}{key}({number})" if value.size > 1 else f"{path}{key}"
        fields = {str(field): item[field] for field in value.dtype.names or ()}
        values = fields.get("values")
        if clock is not None and isinstance(values, np.ndarray) and values.dtype.kind in "fiub":
            yield from _signal(fields, values, name, path, clock)
        else:
            yield from _flatten(fields, f"{name}.", constants, depth + 1, clock)


def _signal(
    fields: Mapping[str, Any], values: np.ndarray[Any, Any], name: str, path: str, clock: Array
) -> Iterator[_Entry]:
    """A signal of Simulink's structure with time, ``simout.signals(2)``; a vector has a column for each element."""
    label = "".join(_texts(fields.get("label"))[:1])
    block = "".join(_texts(fields.get("blockName"))[:1]).replace("\n", " ").rpartition("/")[2]
    own = parse_label(label or f"{name}.values", path=f"{name}." if label else "")
    if not label:
        variable = path.rstrip(".").rpartition(".")[2]
        number = name[name.rindex("(") :] if name.endswith(")") else ""
        own = replace(own, alias=block or f"{variable}{number}")
    columns = by_time(values, clock.size)
    for k, column in enumerate(columns, 1):
        yield _Entry(own if len(columns) == 1 else element(own, k), column, clock)


def _recorded(content: Mapping[str, Any]) -> list[_Entry]:
    """The traces that ControlDesk recorded: axes ``X(1)``, ... and traces ``Y(1)``, ... with the number of their axis."""
    if not {"X", "Y"} <= content.keys():
        return []
    axes, traces = (_fields(content[key]) for key in "XY")
    if not (axes and traces) or not all("Data" in item for item in (*axes, *traces)):
        return []
    if not all("Name" in item for item in traces):
        return []
    stamps = [_vector(axis["Data"]) * seconds_per(_said(axis, "Unit")) for axis in axes]
    paths, names = ([_said(item, key) for item in traces] for key in ("Path", "Name"))
    labels = trace_labels(paths, names, [_said(item, "Unit") for item in traces])
    found = []
    for label, item in zip(labels, traces, strict=True):
        values, number = _vector(item["Data"]), _vector(item.get("XIndex"))
        axis = int(number[0]) - 1 if number.size else 0
        if not 0 <= axis < len(stamps) or stamps[axis].size != values.size:
            raise DataError(
                f"trace '{label.text}' has {values.size} values and no axis of as many time stamps"
            )
        found.append(_Entry(label, values, stamps[axis]))
    return found


def _fields(value: Any) -> list[dict[str, Any]]:
    """The structs of an array of them; none for anything else."""
    if not isinstance(value, np.ndarray) or value.dtype.names is None:
        return []
    return [{str(name): item[name] for name in value.dtype.names} for item in value.flat]


def _said(fields: Mapping[str, Any], key: str) -> str:
    """A text of a struct, without the marks that older files set around the parts of a path."""
    return "".join(_texts(fields.get(key))[:1]).replace('"', "").strip("\0 ")


def by_time(values: np.ndarray[Any, Any], samples: int) -> list[np.ndarray[Any, Any]]:
    """The elements of what was logged, each over time: time goes along the axis with as many places as there are samples."""
    axis = next((k for k, size in enumerate(values.shape) if size == samples), None)
    if axis is None:
        return [values.ravel()]
    return list(np.moveaxis(values, axis, 0).reshape(samples, -1).T)


def element(label: Label, number: int) -> Label:
    """The label of one element of a vector, counted from 1 as MATLAB does."""
    mark = f"({number})"
    alias = None if label.alias is None else label.alias + mark
    return replace(label, text=label.text + mark, name=label.name + mark, alias=alias)


def _numbers(
    value: np.ndarray[Any, Any],
    key: str,
    path: str,
    names: list[str],
    units: Any,
    constants: dict[str, float],
    clock: Array | None,
) -> Iterator[_Entry]:
    if value.size == 1:
        constants[path + key] = float(value.flat[0])
        return
    if value.ndim > 2 or value.shape.count(1):
        value = value.squeeze()
    if value.ndim == 1 and value.size:
        yield _Entry(parse_label(key, _unit_of(units, key, -1), path), value, clock)
    elif value.ndim == 2 and value.size:
        if len(names) not in (0, value.shape[1]) and len(names) == value.shape[0]:
            value = value.T
        named = len(names) == value.shape[1]
        # Simulink's "To File" and others log a sample as a column; a log has more samples than signals
        lying = not named and value.shape[0] < value.shape[1]
        for k, column in enumerate(value if lying else value.T):
            heading = names[k] if named else f"{key}({k + 1},:)" if lying else f"{key}(:,{k + 1})"
            yield _Entry(parse_label(heading, _unit_of(units, heading, k), path), column, clock)


def _object(value: Any, path: str, constants: dict[str, float], depth: int) -> Iterator[_Entry]:
    """A timeseries, or those in a Simulink data set; other objects are passed over."""
    if value.classname == "timeseries":
        yield from _timeseries(value, path)
    elif str(value.classname).startswith(_DATA_SET):
        seen: dict[str, int] = {}
        for name, series in _members(value.properties, "", 0):
            seen[name] = number = seen.get(name, 0) + 1
            own = f"{name}{number if number > 1 else ''}" if name else f"signal{number}"
            yield from _timeseries(series, f"{path}.{own}")


def _iddata(fields: Mapping[str, Any], path: str) -> Iterator[_Entry]:
    """Inputs and outputs of measured data of the System Identification Toolbox, each experiment with its own clock."""
    unit = "".join(_texts(fields.get("TimeUnit"))[:1]) or "seconds"
    steps, starts, instants = (_cells(fields.get(key)) for key in ("Ts", "Tstart", "SamplingInstants"))
    for side in ("Input", "Output"):
        names, units = (_texts(fields.get(f"{side}{key}")) for key in ("Name", "Unit"))
        experiments = _cells(fields.get(f"{side}Data"))
        for k, values in enumerate(experiments):
            stamps, step, start = (_vector(dict(enumerate(of)).get(k)) for of in (instants, steps, starts))
            if values.ndim != 2 or values.dtype.kind not in "fiub":
                continue
            if not stamps.size and step.size:
                stamps = (start[0] if start.size else step[0]) + step[0] * np.arange(len(values))
            if stamps.size != len(values) or unit not in CLOCKS:
                raise DataError(
                    f"iddata '{path}' has no sampling interval in seconds (Ts): give it one and save it again"
                )
            folder = f"{path}{{{k + 1}}}." if len(experiments) > 1 else f"{path}."
            for column, data in enumerate(values.T):
                name = names[column] if len(names) == values.shape[1] else f"{side[0].lower()}{column + 1}"
                measured = units[column] if len(units) == values.shape[1] else None
                yield _Entry(parse_label(name, measured, folder), data, stamps * CLOCKS[unit])


def _cells(value: Any) -> list[np.ndarray[Any, Any]]:
    """The matrices of a cell, or the one that stands in place of a cell."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        return [item for item in value.flat if isinstance(item, np.ndarray)]
    return [value] if isinstance(value, np.ndarray) else []


def _members(value: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Each timeseries within a Simulink data set, under the name of the signal that holds it, or else its own."""
    if depth > 2 * _DEPTH:
        return
    classname = str(getattr(value, "classname", ""))
    fields = getattr(value, "properties", value)
    if classname == "timeseries":
        yield name or "".join(_texts(_first(fields, "Name"))[:1]), value
    elif isinstance(fields, Mapping):
        inside = "".join(_texts(fields.get("Name"))[:1]) if "Values" in fields else ""
        for inner in fields.values():
            yield from _members(inner, inside or name, depth + 1)
    elif isinstance(fields, np.ndarray) and fields.dtype.names:
        for item in fields.flat:
            yield from _members({key: item[key] for key in fields.dtype.names}, name, depth + 1)
    elif isinstance(fields, np.ndarray) and fields.dtype == object:
        for inner in fields.flat:
            yield from _members(inner, name, depth + 1)


def _timeseries(value: Any, path: str) -> Iterator[_Entry]:
    """Data and stamps of a timeseries under the names with which MATLAB saves them, one column for each of its signals."""
    fields = value.properties if isinstance(value.properties, Mapping) else {}
    values = _first(fields, "Data_", "Data")
    if not np.size(values):  # as a block "To File" streams it
        values = _first(_properties(_first(fields, "Storage_")), "Data")
    data = values if isinstance(values, np.ndarray) and values.dtype.kind in "fiub" else np.empty(0)
    stamps = _vector(_first(fields, "Time_", "Time"))
    about = _properties(_first(fields, "TimeInfo"))
    if not stamps.size:
        stamps = _vector(_first(about, "Time_", "Time"))
    if not data.size and not stamps.size:
        return  # nothing was recorded
    if stamps.size != data.size and (stamps.size < 2 or stamps.size not in data.shape):
        # equidistant: only start, increment and perhaps length are stored
        start, step = (_vector(_first(about, name, name.rstrip("_"))) for name in ("Start_", "Increment_"))
        if not (start.size and step.size):
            raise DataError(f"timeseries '{path}' has {data.size} values and {stamps.size} time stamps")
        length = _vector(_first(about, "Length"))
        samples = data.shape[-1] if data.ndim > 2 else data.size if 1 in data.shape else len(data)
        stamps = start[0] + step[0] * np.arange(int(length[0]) if length.size else samples)
        if stamps.size != data.size and stamps.size not in data.shape:
            raise DataError(f"timeseries '{path}' has {data.size} values and {stamps.size} time stamps")
    unit = "".join(_texts(_first(about, "Units"))[:1]) or "seconds"
    if unit not in CLOCKS:
        raise DataError(f"timeseries '{path}' has its time in '{unit}': save it in seconds")
    measured = "".join(_texts(_first(_properties(_first(fields, "DataInfo")), "Units"))[:1])
    folder, _, leaf = path.rpartition(".")
    own = parse_label(leaf, measured, f"{folder}." if folder else "")
    columns = by_time(data, stamps.size)
    for k, column in enumerate(columns, 1):
        yield _Entry(own if len(columns) == 1 else element(own, k), column, stamps * CLOCKS[unit])


def _first(fields: Mapping[str, Any], *names: str) -> Any:
    return next((fields[name] for name in names if name in fields), None)


def _properties(value: Any) -> Mapping[str, Any]:
    while isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
        value = value.flat[0]
    if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
        return {name: value.flat[0][name] for name in value.dtype.names}
    found = getattr(value, "properties", value)
    return found if isinstance(found, Mapping) else {}


def _vector(value: Any) -> Array:
    """A numeric value as float64 (n,); empty for anything else."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        return np.empty(0)
    return np.asarray(value, dtype=np.float64).ravel()


def _texts(value: Any) -> list[str]:
    """A cell or a character matrix of texts as a list; empty for anything else."""
    if isinstance(value, str):
        return [value.strip()]
    if not isinstance(value, np.ndarray):
        return []
    if value.dtype.kind == "U":
        return [str(item).strip() for item in value.flat]
    if value.dtype == object:
        parts = [_texts(item) for item in value.flat]
        return [part[0] for part in parts] if parts and all(len(part) == 1 for part in parts) else []
    return []


def _unit_of(units: Any, name: str, position: int) -> str | None:
    """The unit of a column from a struct of units by name, or from a list in the columns' order."""
    by_name = _properties(units)
    if name in by_name:
        return "".join(_texts(by_name[name])[:1])
    listed = _texts(units)
    return listed[position] if 0 <= position < len(listed) else None
