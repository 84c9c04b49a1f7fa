"""The virtual rig: synthetic logs of the crane, from equations of its own.

Nothing here comes from `fmus`: a test on these logs is not the model tested on itself.

    from cosim.rig import Hidden, make_log
    run = make_log("mixed", 60.0, [Hidden("mechanical.coulomb_friction", {"tau_c": 300.0})], seed=1)
"""

from cosim.rig.hidden import Hidden
from cosim.rig.noise import Noise
from cosim.rig.parameters import EFFECTS, PARAMETERS
from cosim.rig.recipe import Recipe
from cosim.rig.run import RigRun, make, make_log
from cosim.rig.write import as_log, as_tracker, write, write_markers, write_tracker, write_truth

__all__ = [
    "EFFECTS",
    "PARAMETERS",
    "Hidden",
    "Noise",
    "Recipe",
    "RigRun",
    "as_log",
    "as_tracker",
    "make",
    "make_log",
    "write",
    "write_markers",
    "write_tracker",
    "write_truth",
]
