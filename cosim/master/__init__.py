"""The master: simulates a system of FMUs by Gauss-Seidel over raw FMI calls, compiled or interpreted."""

from cosim.master.convergence import estimate
from cosim.master.inputs import time_grid
from cosim.master.limits import Limits
from cosim.master.order import Order, step_order
from cosim.master.runner import Runner

__all__ = ["Limits", "Order", "Runner", "estimate", "step_order", "time_grid"]
