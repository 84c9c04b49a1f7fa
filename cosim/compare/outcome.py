"""What a comparison finds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import Score
from cosim.compare.wiring import NotJudged
from cosim.logs.log import Log
from cosim.signals import SIGNALS, conversion

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class SignalOutcome:
    """A measured signal beside the simulated one, in the signal's SI unit.

    Of a log of hours, arrays are made when they are asked for, and not kept.

    Attributes:
        signal: its name.
        score: the error in numbers.
        log: as compared, on a uniform step.
        source: a part of the samples -> simulated values there.
    """

    signal: str
    score: Score
    log: Log = field(repr=False)
    source: Callable[[slice], Array] = field(repr=False)

    @property
    def simulated(self) -> Array:
        """(n,) at `Comparison.time`."""
        return self.source(slice(None))

    @property
    def measured(self) -> Array:
        """(n,) at `Comparison.time`."""
        return self.log[self.signal]

    @property
    def valid(self) -> Mask:
        """(n,) False where the measurement was filled in."""
        return self.log.valid_mask(self.signal)

    @property
    def error(self) -> Array:
        """Measured minus simulated (n,), less the offset that the score removes."""
        return self.measured - self.simulated - (self.score.offset or 0.0)


@dataclass(frozen=True)
class BlockOutcome:
    """Blocks between measured signals, driven by the measurement.

    Attributes:
        name: the components, joined by `` + ``.
        components: their names.
        driven_by: the measured signals that drive them.
        signals: what they make of it.
    """

    name: str
    components: tuple[str, ...]
    driven_by: tuple[str, ...]
    signals: dict[str, SignalOutcome]


@dataclass(frozen=True)
class Comparison:
    """Model against log.

    Attributes:
        log: as compared, on a uniform step.
        model: name of the system.
        step: [s].
        time: (n,) [s], as in the log.
        command: signals that drive the model in `signals`.
        signals: the model driven by the command alone; empty where a command is missing.
        blocks: each driven by what was measured.
        not_judged: blocks that the log says nothing about.
        parameters: what was set, start values included (SI).
        notes: what the reader should know.
    """

    log: Log = field(repr=False)
    model: str
    step: float
    time: Array = field(repr=False)
    command: tuple[str, ...]
    signals: dict[str, SignalOutcome]
    blocks: list[BlockOutcome]
    not_judged: list[NotJudged]
    parameters: Mapping[str, object]
    notes: list[str]

    @property
    def worst(self) -> tuple[BlockOutcome, SignalOutcome] | None:
        """The block with the largest error in units of its noise, and the signal that shows it; None without noise."""
        pairs = [(block, found) for block in self.blocks for found in block.signals.values()]
        rated = [(p[1].score.ratio, i) for i, p in enumerate(pairs) if p[1].score.ratio is not None]
        return pairs[max(rated)[1]] if rated else None

    def shown(self, signal: str) -> tuple[str, float]:
        """(unit people read, factor to it from SI) of a signal."""
        unit = self.log.display.get(signal) or SIGNALS[signal].unit
        return unit, 1.0 / conversion(unit, self.log.units.get(signal) or SIGNALS[signal].si)
