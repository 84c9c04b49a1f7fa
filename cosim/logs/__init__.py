"""Measured data: logs of the rig and records of the tracker, read from CSV, MAT, Parquet, MF4 and TDMS files.

`load_log` and `load_tracker` give SI signals on a strictly increasing time, or a `DataError` that names file, row and
column; what they had to repair is in `Log.warnings` and `Log.valid`. docs/logs.md has the rules.
"""

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
