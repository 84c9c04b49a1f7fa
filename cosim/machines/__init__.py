"""A machine in one file: the table ``[machine]`` of a mapping, and the wiring and values that are made from it.

This package knows files, blocks and logs; diagnosis, comparison and simulation are its clients.
"""

from cosim.machines.make import Made, in_package, made_for, table_in_package, write_machine
from cosim.machines.table import MachineTable, machine_table

__all__ = [
    "MachineTable",
    "Made",
    "in_package",
    "machine_table",
    "made_for",
    "table_in_package",
    "write_machine",
]
