"""The experiments of chapters 4 and 5, played on the virtual rig: logs, each made when it is first asked for.

The rig carries what the source suspects its crane of and its models lack: damping of the valve that grows in small motion
(fig. 5.6) and orifice flow (5.2.2, (4.22)). Everything else is the nominal crane.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.identify.experiment import DCV_GRID, SLEW_GRID, Experiment, ramp, stepped_sine
from cosim.identify.nominal import nominal
from cosim.logs import Log
from cosim.results import Result
from cosim.rig import RigRun, as_log, make_log

Array = NDArray[np.float64]

HIDDEN = ("dcv.amplitude_damping", "continuity.flow_pressure")  # at the rig's moderate sizes
AMPLITUDES = (1.0, 0.75, 0.35)  # of full command, as the source's
STEPS = (1.0, 0.75, 0.5, 0.35, 0.2, 0.1, 0.05)
LOWEST = {
    "slew": 0.2,
    "dcv": 0.4,
}  # rad/s of the short sweeps: the source's first 0.1 rad/s takes a minute alone
POINTS = 20  # of a short sweep, evenly on a log scale
UNCOMPENSATED = {"compensator.d_plus": 0.0, "compensator.d_minus": 0.0}
MISFIT = 1.5e-3  # m, of each coordinate of the markers by which one marker model was laid on the other
VALIDATION = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # rad/s, one period each, as a sine and as a square wave
STEP = 1e-3
DEG = np.pi / 180.0


class Campaign:
    """Logs of the rig, and the models on their commands.

    Args:
        hidden: effects of the rig, such as ``dcv.delay:tau_d=20 ms``.
        seed: of the noise.
        full: the source's whole grids of frequencies, some 40 minutes of log, instead of short ones.
    """

    def __init__(self, hidden: Sequence[str] = HIDDEN, seed: int = 1, full: bool = False) -> None:
        self.hidden, self.seed, self.full = tuple(hidden), seed, full
        self.known = nominal()
        self.run = cache(self._run)
        self.simulated = cache(self._simulated)

    def grid(self, kind: str) -> Array:
        """Frequencies of a sweep of the ``slew`` or of the valve (``dcv``) [rad/s]."""
        whole = {"slew": SLEW_GRID, "dcv": np.unique(DCV_GRID)}[kind]
        if self.full:
            return whole
        wanted = np.geomspace(LOWEST[kind], whole[-1], POINTS)
        return whole[np.unique(np.searchsorted(whole, wanted).clip(0, whole.size - 1))]

    def command(self, name: str) -> tuple[Array, dict[str, Any]]:
        """The command of an experiment, (n,) [1], and what the rig is told beside it."""
        kind, _, level = name.partition(" ")
        amplitude = float(level or 1.0)
        options: dict[str, Any] = {}
        made: Experiment
        if kind == "ramp":
            made = ramp(periods=1)
        elif kind == "ramp_uncompensated":
            made, options["settings"] = ramp(periods=1), UNCOMPENSATED
        elif kind in ("slew", "dcv"):
            made = stepped_sine(kind, self.grid(kind), (amplitude,))
        elif kind in ("sine", "square"):
            made = stepped_sine(kind, VALIDATION, (amplitude,), square=kind == "square")
        elif kind == "steps":
            return families(), options
        else:
            made = stepped_sine("tracker", (0.25, 0.5), (1.0,))
            options |= {"markers": True, "start": 2.0 * DEG, "settings": {"tracker.misfit": MISFIT}}
        return made.command, options

    def _run(self, name: str) -> RigRun:
        command, options = self.command(name)
        hidden = [*self.hidden, "tracker.clock"] if name == "tracker" else list(self.hidden)
        return make_log(command, hidden=hidden, seed=self.seed, **({"start": 0.0} | options))

    def log(self, name: str) -> Log:
        """The log of an experiment: ramp, ramp_uncompensated, steps, tracker; slew, dcv, sine, square and an amplitude."""
        return as_log(self.run(name))

    def _simulated(self, model: str, name: str) -> Result:
        from cosim.api import simulate

        return simulate(model, inputs=self.log(name))

    def signals(self, model: str, name: str) -> Mapping[str, Array]:
        """Signals of a model's FMUs on the command of an experiment alone, by the names of a log, (n,) SI."""
        run = self.simulated(model, name)
        found = {"slew": run["sensor.slew"] if "sensor.slew" in run else run["simplified.theta"]}
        if "dcv.spool" in run:
            found |= {"spool": run["dcv.spool"], "p_load": run["continuity.p_load"]}
        return found


def families() -> Array:
    """A step to each of `STEPS` and back, on either side, a second each: (n,) [1]."""
    second = round(1.0 / STEP)
    parts = [np.zeros(second)]
    for level in STEPS:
        parts += [np.full(second, level), np.zeros(second), np.full(second, -level), np.zeros(second)]
    return np.concatenate(parts)


def step_of(level: float) -> slice:
    """The samples of the step to a level, from its edge for 0.6 s."""
    second = round(1.0 / STEP)
    first = second * (1 + 4 * STEPS.index(level))
    return slice(first, first + round(0.6 / STEP))
