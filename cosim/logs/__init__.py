"""Measured data: logs of the rig and records of the tracker, read from CSV, MAT, Parquet, MF4 and TDMS files.

`load_log` and `load_tracker` give SI signals on a strictly increasing time, or a `DataError` that names file, row and
column; what they had to repair is in `Log.warnings` and `Log.valid`. docs/logs.md has the rules.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cosim.logs.load import load_log, load_tracker
    from cosim.logs.log import Gap, Log, Tracker, listed
    from cosim.logs.mapping import Mapping, load_mapping
    from cosim.logs.write import write_log

__all__ = [
    "Gap",
    "Log",
    "Mapping",
    "Tracker",
    "listed",
    "load_log",
    "load_mapping",
    "load_tracker",
    "write_log",
]
_PLACES = {"load": ("load_log", "load_tracker"), "log": ("Gap", "Log", "Tracker", "listed"),
           "mapping": ("Mapping", "load_mapping"), "write": ("write_log",)}  # fmt: skip


def __getattr__(name: str) -> Any:
    """What is asked for, from its module: a command that wants a part of it does not load the readers of all formats."""
    for place, names in _PLACES.items():
        if name in names:
            return getattr(importlib.import_module(f"cosim.logs.{place}"), name)
    raise AttributeError(f"module 'cosim.logs' has no attribute '{name}'")
