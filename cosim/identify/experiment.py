"""Experiments as the source made them: stepped sines and slow ramps, as commands that the rig or the crane plays.

The source's grid is ``linspace(0.1, 50, 1000)`` rad/s: its first hundred for the slew drive, and for the valve those
hundred and then ``linspace(5, 70, 100)``, of which it used 195 without saying which; here the first 195 are played.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import UsageError
from cosim.files import whole, write_text

Array = NDArray[np.float64]

STEP = 1e-3  # s, the clock of the real-time target
SLEW_GRID = np.linspace(0.1, 50.0, 1000)[:100]  # rad/s
DCV_GRID = np.concatenate([SLEW_GRID, np.linspace(5.0, 70.0, 100)])[:195]
GRIDS: dict[str, tuple[Array, tuple[float, ...]]] = {
    "slew": (SLEW_GRID, (1.0, 0.75)),
    "dcv": (DCV_GRID, (1.0, 0.75, 0.35)),
}
# the source's second amplitude: the valve's largest swing is 1.30 times its gain (its impulse response, absolute, summed
# up), so above 0.84 a sine of some frequency meets the stops at 2.6 mm
SINE_AMPLITUDE = 0.75
REST = 3.0  # s of no command before, between and after the parts
RAMP_PERIOD = 40.0  # s for 0, +A, -A, 0
SPEED = 2.27  # deg/s of slew per unit command at low frequency (SYSTEM section 7)


@dataclass(frozen=True)
class Experiment:
    """A command to play.

    Attributes:
        name: what it is.
        command: (n,) [1], held over each millisecond.
        plan: what is in it, as plain data.
    """

    name: str
    command: Array
    plan: dict[str, object]

    @property
    def duration(self) -> float:
        """[s]."""
        return self.command.size * STEP

    @property
    def travel(self) -> float:
        """Slew that it asks for, peak to peak [deg], by the gain at low frequency."""
        return float(np.ptp(np.cumsum(self.command))) * STEP * SPEED


def stepped_sine(
    name: str, frequencies: Sequence[float] | Array, amplitudes: Sequence[float], square: bool = False
) -> Experiment:
    """One whole period of each frequency [rad/s], in turn, for each amplitude [1] in turn (4.10-4.12).

    With `square` each sine goes by its sign, as the source's square waves (figs 4.5, 4.12b, 5.7, 5.9b).

    Raises:
        UsageError: no frequency, or an amplitude or frequency out of range.
    """
    w = np.asarray(frequencies, dtype=np.float64)
    if not w.size or not (np.isfinite(w).all() and (w > 0.0).all() and (w <= 300.0).all()):
        raise UsageError(
            "a stepped sine needs frequencies above 0 and up to 300 rad/s: at 1 kHz more is no sine"
        )
    if not amplitudes or not all(0.0 < a <= 1.0 for a in amplitudes):
        raise UsageError("the amplitudes must lie within 0 .. 1 of full command")
    parts = [np.zeros(round(REST / STEP))]
    for amplitude in amplitudes:
        wave = amplitude * np.sign(_sines(w, 1.0)) if square else _sines(w, amplitude)
        parts += [wave, np.zeros(round(REST / STEP))]
    plan: dict[str, object] = {
        "frequencies": {"value": w.tolist(), "unit": "rad/s"},
        "amplitudes": list(amplitudes),
        "shape": "square" if square else "sine",
    }
    return Experiment(name, np.concatenate(parts), plan)


def _sines(w: Array, amplitude: float) -> Array:
    """The periods one after the other, each from zero on; time is not rounded to samples."""
    ends = np.cumsum(2.0 * np.pi / w)
    time = np.arange(int(np.ceil(ends[-1] / STEP))) * STEP
    index = np.searchsorted(ends, time, side="right")
    which = np.minimum(index, w.size - 1)
    start = np.where(which > 0, ends[which - 1], 0.0)
    value = amplitude * np.sin(w[which] * (time - start))
    return np.where(index < w.size, value, 0.0)


def ramp(amplitude: float = 1.0, periods: int = 2, period: float = RAMP_PERIOD) -> Experiment:
    """Slow ramps 0, +A, 0, -A, 0 through the dead zone; up and down, so that lag and width can be told apart.

    Raises:
        UsageError: amplitude, period or their number is out of range.
    """
    if not 0.0 < amplitude <= 1.0 or periods < 1 or not 1.0 <= period <= 3600.0:
        raise UsageError("a ramp needs an amplitude within 0 .. 1, one period or more, each of 1 s to 1 h")
    phase = np.mod(np.arange(round(periods * period / STEP)) * STEP / period + 0.25, 1.0)
    rest = np.zeros(round(REST / STEP))
    command = np.concatenate([rest, amplitude * (1.0 - 4.0 * np.abs(phase - 0.5)), rest])
    return Experiment(
        "ramp",
        command,
        {"amplitude": amplitude, "period": {"value": period, "unit": "s"}, "periods": periods},
    )


def write_experiment(experiment: Experiment, path: Path) -> Path:
    """Write the command as CSV (``time [s]``, ``u [1]``), and what is in it beside as ``<name>.plan.json``.

    Returns:
        The plan's path.

    Raises:
        UsageError: the file cannot be written.
    """
    from pandas import DataFrame

    plan = path.with_name(path.name + ".plan.json")
    content = {
        "experiment": experiment.name,
        "duration": {"value": experiment.duration, "unit": "s"},
    } | experiment.plan
    table = {"time [s]": np.round(np.arange(experiment.command.size) * STEP, 3), "u [1]": experiment.command}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # nine digits: a command rounded to 1e-9 is what the rig's own logs hold
        with whole(path) as part:
            DataFrame(table).round({"u [1]": 9}).to_csv(part, index=False, lineterminator="\n")
        write_text(plan, json.dumps(content, indent=2) + "\n")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None
    return plan
