"""SSP 1.0 packages: read, check and write.

`read_ssp` gives a `System`, which `cosim.master.Runner` simulates; `check_ssp` lists everything that is wrong with a file.
"""

from cosim.ssp.check import Problem, check_fmu, check_ssp, check_ssv
from cosim.ssp.parameters import ParameterValue, read_ssv
from cosim.ssp.read import read_fmu, read_ssp, read_system
from cosim.ssp.system import Component, Fmu, Port, System, SystemInput, Variable, Wire

__all__ = [
    "Component",
    "Fmu",
    "ParameterValue",
    "Port",
    "Problem",
    "System",
    "SystemInput",
    "Variable",
    "Wire",
    "check_fmu",
    "check_ssp",
    "check_ssv",
    "read_fmu",
    "read_ssp",
    "read_ssv",
    "read_system",
]
