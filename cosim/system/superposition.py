"""Outputs of a unit that is linear and does not change with time: superposed, not run.

What such a unit does is known from one run and its answer to a short pulse at each input: any other input is the first one
and a sum of shifted pulses (convolution). Nobody knows beforehand whether an FMU is linear, so it is tried: outputs are
superposed only after several real runs gave the same, only within what these runs have reached, and now and then one is run
all the same. A unit that once differs is run from then on.
"""

from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from cosim.errors import SimulationError
from cosim.ssp.system import Port

Array = NDArray[np.float64]
Series = Mapping[Port, Array]
Run = Callable[[Series], dict[Port, Array]]
SAME = 1e-7  # of an output's range: two runs of one program, added up otherwise, differ by less
PROVED = 4  # runs that a superposition must have foretold before one is believed
AGAIN = 40  # superposed runs of which one is made all the same
BEYOND = 0.02  # of the range reached by real runs: an output or input further out is run
WORTH = 2  # times the runs that the answers take: so many must have been made with the same parameters first
MOST_INPUTS = 6  # of a unit: each takes two runs
MOST_ANSWERS = 8  # logs and sets of parameters for which pulses are kept


@dataclass
class Reached:
    """The range of each series over real runs."""

    low: dict[Port, float] = field(default_factory=dict)
    high: dict[Port, float] = field(default_factory=dict)

    def take(self, series: Series) -> None:
        """Widen the ranges by these series (n,)."""
        for port, values in series.items():
            self.low[port] = min(self.low.get(port, np.inf), float(values.min()))
            self.high[port] = max(self.high.get(port, -np.inf), float(values.max()))

    def hold(self, series: Series) -> bool:
        """Whether series lie within."""
        for port, values in series.items():
            if port not in self.low:
                return False
            margin = BEYOND * (self.high[port] - self.low[port])
            if values.min() < self.low[port] - margin or values.max() > self.high[port] + margin:
                return False
        return True


@dataclass
class Answers:
    """One run of a unit, and what a pulse at each input adds to its outputs.

    Attributes:
        inputs, outputs: of the run, port -> (n,).
        pulses: input -> output -> (n,) answer to one unit at the second sample, over that unit; it is shifted.
        first: the same for the first sample, from which a unit begins.
    """

    inputs: dict[Port, Array]
    outputs: dict[Port, Array]
    pulses: dict[Port, dict[Port, Array]] = field(default_factory=dict)
    first: dict[Port, dict[Port, Array]] = field(default_factory=dict)

    @classmethod
    def of(cls, inputs: Series, outputs: Series, run: Run, moving: Sequence[Port]) -> "Answers":
        """Measure the pulses of some inputs, two runs for each."""
        found = cls(dict(inputs), dict(outputs))
        for port in moving:
            size = max(float(np.ptp(inputs[port])), 1e-3 * float(np.abs(inputs[port]).max()), 1e-9)
            for place, kept in ((0, found.first), (1, found.pulses)):
                series = inputs[port].copy()
                series[place] += size
                answer = run({**inputs, port: series})
                kept[port] = {o: (answer[o] - outputs[o]) / size for o in outputs}
            for answers in found.pulses[port].values():
                answers[:-1] = answers[1:].copy()  # begins with the sample at which the pulse is
        return found

    def outputs_of(self, inputs: Series) -> dict[Port, Array] | None:
        """Outputs for other inputs; None where one moves that has no pulse."""
        found = {o: y.copy() for o, y in self.outputs.items()}
        for port, series in inputs.items():
            change = series - self.inputs[port]
            if not change.any():
                continue
            if port not in self.pulses:
                return None
            length = next_fast_len(2 * change.size, real=True)
            spectrum = rfft(change[1:], length)
            for output, y in found.items():
                y += change[0] * self.first[port][output]
                y[1:] += irfft(spectrum * rfft(self.pulses[port][output][:-1], length), length)[: y.size - 1]
        return found


class Superposition:
    """What is known of one unit.

    Attributes:
        linear: whether it may be.
        used: runs that were spared.
    """

    def __init__(self) -> None:
        self.linear = True
        self.used = self._right = self._since = 0
        self._answers: OrderedDict[bytes, Answers] = OrderedDict()
        self._seen: Counter[bytes] = Counter()
        self._reached = Reached()

    def outputs(self, key: bytes, inputs: Series, moving: Sequence[Port], run: Run) -> dict[Port, Array]:
        """Outputs of the unit, superposed where that is known to be right, else run.

        Args:
            key: of everything but the inputs that move: parameters, times, which outputs.
            inputs: port -> (n,).
            moving: those of a continuous quantity, to which pulses can be given.
            run: makes a run.

        Raises:
            SimulationError: a run failed.
        """
        if not self.linear or not 0 < len(moving) <= MOST_INPUTS:
            return run(inputs)
        answers = self._answers.get(key)
        guess = answers.outputs_of(inputs) if answers else None
        if guess is not None and self._believed(inputs, guess):
            self.used += 1
            self._since += 1
            return guess
        found = run(inputs)
        self._since = 0
        if answers is None:
            self._seen[key] += 1
            if self._seen[key] > WORTH * 2 * len(moving):
                self._measure(key, inputs, found, moving, run)
        elif guess is not None:
            self._compare(inputs, guess, found)
        return found

    def _believed(self, inputs: Series, guess: Series) -> bool:
        return self._right >= PROVED and self._since < AGAIN and self._reached.hold({**inputs, **guess})

    def _compare(self, inputs: Series, guess: Series, found: Series) -> None:
        """Hold a superposition against the run that it foretells."""
        if all(_same(guess[output], y) for output, y in found.items()):
            self._right += 1
            self._reached.take({**inputs, **found})
        else:
            self.linear = False
            self._answers.clear()

    def _measure(self, key: bytes, inputs: Series, found: Series, moving: Sequence[Port], run: Run) -> None:
        try:
            self._answers[key] = Answers.of(inputs, found, run, moving)
        except SimulationError:  # no pulse for this one
            self.linear = False
            return
        self._reached.take({**inputs, **found})
        if len(self._answers) > MOST_ANSWERS:
            self._answers.popitem(last=False)


def _same(guess: Array, found: Array) -> bool:
    if not np.isfinite(found).all():
        return False
    return float(np.abs(found - guess).max()) <= SAME * max(float(np.ptp(found)), float(np.abs(found).max()))
