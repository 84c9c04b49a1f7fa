"""Exports a system for tools that cannot read an SSP: a MATLAB script for Simulink, a Modelica package.

Neither tool is at hand where this is developed; docs/export.md says what was run and what was only looked up.
"""

from cosim.export.model import ExportedModel, prepare
from cosim.export.modelica import write_modelica
from cosim.export.simulink import write_simulink

__all__ = ["ExportedModel", "prepare", "write_modelica", "write_simulink"]
