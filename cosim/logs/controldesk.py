"""What dSPACE ControlDesk exports: the header block of a CSV file, and how a trace is called there and in a MAT file.

    descriptions,General,User,...
    ...
    trace_size,2991
    trace_names,,In1,In1,Boom_up_duty
    trace_units,,,,
    path,,Model Root/Joint_Angles/Arm_ang,Model Root/Joint_Angles/Boom_ang,Model Root/Commands
    ...
    trace_values,0,-33.99,27.56,0
    ,0.01,-33.98,27.57,0

The first column holds the names of the lines, the second is the time [s]. A trace is known by `path` and name together:
a Simulink port has the same name (``In1``) in every block.
"""

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from cosim.logs.source import Label

FIRST, VALUES = "descriptions", "trace_values"
_LONGEST = 1000


@dataclass(frozen=True)
class Header:
    """What the block says.

    Attributes:
        lines: lines before the first row of values.
        labels: one for each column, that of the lines' names among them.
        size: number of rows announced, None where it is not said.
    """

    lines: int
    labels: tuple[Label, ...]
    size: int | None


def read_header(head: str, separator: str) -> Header | None:
    """The header block at the top of a text that begins with `FIRST`, or None where it is not whole.

    Args:
        head: the first lines of the file.
        separator: column separator.
    """
    fields: dict[str, list[str]] = {}
    for number, line in enumerate(head.lstrip().splitlines()[:_LONGEST]):
        try:
            key, *cells = next(csv.reader([line], delimiter=separator)) or [""]
        except csv.Error:
            return None
        if key == VALUES:
            return _header(fields, number, 1 + len(cells))
        fields.setdefault(key, cells)
    return None


def _header(fields: dict[str, list[str]], lines: int, width: int) -> Header | None:
    if "trace_names" not in fields:
        return None
    names, units, paths = (
        [*fields.get(key, []), *[""] * width][: width - 1] for key in ("trace_names", "trace_units", "path")
    )
    first = [Label(FIRST, FIRST, None), Label("time", "time", units[0].strip() or "s")]
    labels = [*first, *trace_labels(paths[1:], names[1:], units[1:])]
    size = "".join(fields.get("trace_size", [])[:1]).strip()
    return Header(lines, tuple(labels), int(size) if size.isdecimal() else None)


def trace_labels(paths: Sequence[str], names: Sequence[str], units: Sequence[str]) -> list[Label]:
    """The labels of traces: ``path/name``, and every end of it that no other trace has."""
    traces = list(zip(paths, names, units, strict=True))
    ends = Counter(end for path, name, _ in traces for end in _ends(path, name))
    labels = []
    for path, name, unit in traces:
        full = f"{path}/{name}" if path else name
        others = tuple(end for end in _ends(path, name) if ends[end] == 1)
        short = min(others, key=len, default=None)
        labels.append(Label(full, full, unit.strip() or None, short, others))
    return labels


def _ends(path: str, name: str) -> set[str]:
    """Every end of ``path/name`` and of ``path``, from whole part on."""
    parts = path.split("/") if path else []
    return {"/".join(whole[k:]) for whole in (parts, [*parts, name]) for k in range(len(whole))}
