"""Calibration: a model's free parameters fitted to a log, with intervals that hold for coloured noise.

    with Comparator(load_log("log.csv"), Path("full_order_open.ssp")) as comparator:
        found = calibrate(comparator, read_free(comparator.system, ["mechanical.J", "dcv.K=2:3 mm"]))
        print(found.parameters[0].value, found.parameters[0].ci95)

docs/calibrate.md explains how it works and how well.
"""

from cosim.calibrate.free import Free, read_free
from cosim.calibrate.outcome import Calibration, Parameter
from cosim.calibrate.pipeline import calibrate
from cosim.calls import make_callable

__all__ = ["Calibration", "Free", "Parameter", "calibrate", "read_free"]

make_callable(__name__)
