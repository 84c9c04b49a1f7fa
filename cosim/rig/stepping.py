"""The rig a millisecond at a time, for a crane in real time: the equations of `cosim.rig.integrate`, its sensors as they go.

crane = SteppedCrane(plant, noise, seed=1)
crane.step(0.3); crane.read()["slew"]
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.interrupts import uninterrupted
from cosim.rig.equations import Moment, State
from cosim.rig.integrate import (
    SUBSTEPS,
    _at_rest,
    _demand,
    _lag,
    _millisecond,
    _source_digest,
    friction_form,
)
from cosim.rig.jit import cached
from cosim.rig.noise import UNITS, Noise, stream
from cosim.rig.parameters import NOMINAL, STEP, Plant
from cosim.rig.sensing import reading
from cosim.signals import SIGNALS

BLOCK = 1000  # samples of noise drawn at a time
SENSORS = ("spool", "p_supply", "p_a", "p_b", "slew")


def _compile_step(digest: int) -> Callable[..., Any]:
    """The compiled millisecond, cached on disk; `digest` is part of its cache key, as for the march."""

    @cached
    def step(
        s: State, start: float, older: float, newer: float, part: float, substeps: int, held: Moment, p: Plant
    ) -> tuple[State, float]:
        return _millisecond(s, start, older, newer, part, substeps if digest >= 0 else 1, held, p)

    return step


_step = _compile_step(_source_digest())


class SteppedCrane:
    """The drive and its instruments; memory does not grow with time.

    Attributes:
        state: the drive's own, SI.
        seen: angle behind the backlash, rad.
        count: milliseconds done.
    """

    def __init__(
        self, plant: Plant, noise: Noise, seed: int = 1, friction: str = "sharp", substeps: int = SUBSTEPS
    ) -> None:
        """At rest, compiled and ready.

        Args:
            plant: the crane with what is hidden in it.
            noise: of the sensors; its colour cannot be ``pink``, which has no end of memory.
            seed: of noise and lost packets.
            friction: as `cosim.rig.Recipe` has it.
            substeps: integration steps in a millisecond.

        Raises:
            UsageError: the noise is pink, an effect of the tracker is hidden, or the crane is too fast for the substeps.
        """
        if noise.kind == "pink":
            raise UsageError("pink noise cannot be made sample by sample: take white or ar1")
        if plant.tracker != NOMINAL.tracker:
            raise UsageError("an effect of the tracker cannot be seen over the link, which has no tracker")
        self._plant, self._noise, self._substeps = plant, noise, substeps
        self._slide, self._sigma0, self._sigma1 = friction_form(plant, friction, substeps)
        self._whole, self._part = _lag(plant)
        self._demands = deque([0.0] * (self._whole + 2), maxlen=self._whole + 2)
        self._draws = {name: stream(seed, f"noise {name}") for name in SENSORS}
        self._lost = stream(seed, "dropout")
        self._old = dict.fromkeys(SENSORS, 0.0)
        self._blocks: dict[str, NDArray[np.float64]] = {}
        self._dragged, self.count = 0.0, 0
        self.state: State = _at_rest(plant)
        self.seen = self.state.theta
        self._slew: float | None = None
        before = self.state, self.seen
        self._advance(0.0)  # compiles
        (self.state, self.seen), self.count, self._dragged = before, 0, 0.0
        self._demands.extend([0.0] * (self._whole + 2))

    def step(self, u: float) -> None:
        """A millisecond with the command `u` [1], within -1 to 1."""
        self._advance(u)

    def read(self) -> dict[str, float]:
        """What the sensors show now, in a log's units; to be called once a millisecond, since noise is drawn."""
        k = self.count % BLOCK
        if k == 0 or not self._blocks:
            self._blocks = {name: self._coloured(name) for name in SENSORS}
        s, plant = self.state, self._plant
        true = {
            "spool": s.x,
            "p_supply": s.p_supply,
            "p_a": 0.5 * (s.p_sum + s.p_load),
            "p_b": 0.5 * (s.p_sum - s.p_load),
        }
        shown = {name: value + float(self._blocks[name][k]) for name, value in true.items()}
        shown["slew"] = self._sensed(float(self._blocks["slew"][k]), plant)
        return {name: value / _SCALE[name] for name, value in shown.items()}

    def _sensed(self, noise: float, plant: Plant) -> float:
        """The slew sensor's reading [rad], its noise given."""
        q = plant.sensor
        angle = self.state.sensed if q.tau_l > 0.0 else self.seen
        slew = float(reading(angle, self.count * STEP, plant)) + noise  # type: ignore[arg-type]
        if q.quantum > 0.0:
            slew = q.quantum * round(slew / q.quantum)
        if q.p_drop > 0.0 and self._lost.random() < q.p_drop and self._slew is not None:
            slew = self._slew
        self._slew = slew
        return slew

    def _advance(self, u: float) -> None:
        demand, self._dragged = _demand(u, self._dragged, self._plant)
        self._demands.append(demand)
        older, newer = self._demands[0], self._demands[1]
        held = Moment(0.0, self.seen, self._slide, self._sigma0, self._sigma1)
        with uninterrupted():
            self.state, self.seen = _step(
                self.state, self.count * STEP, older, newer, self._part, self._substeps, held, self._plant
            )
        self.count += 1

    def _coloured(self, name: str) -> NDArray[np.float64]:
        """The next `BLOCK` samples of noise (SI) of a sensor; `ar1` goes on where the last block ended."""
        size, white = self._noise.size(name), self._draws[name].standard_normal(BLOCK)
        if self._noise.kind != "ar1":
            return size * white
        pole = math.exp(-STEP / self._noise.correlation_time)
        gain, last = math.sqrt(1.0 - pole * pole), self._old[name]
        found = np.empty(BLOCK)
        for k in range(BLOCK):
            # the first sample already has the stationary size
            last = pole * last + gain * white[k] if self.count or k else white[k]
            found[k] = last
        self._old[name] = last
        return size * found


_SCALE = {name: SIGNALS[name].to_si for name in SENSORS}
assert all(SIGNALS[name].si == UNITS[name] for name in SENSORS)
