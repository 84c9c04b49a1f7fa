"""Effects seen in the raw samples and not in the shape of a residual: rounding to steps, and stale samples.

A model with its own pseudo-random lost packets can never meet those of the log, and a rounded model is jagged: least
squares is blind to both. They leave exact signatures instead: readings on a grid, or that repeat to the last digit.
A stale sample tells nothing new of the machine, and its lateness would pass for inertia: fits leave it out.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from cosim.diagnosis.thresholds import (
    CHANCE_ON_GRID,
    COARSE,
    COLOURED_REPEATS,
    GENTLE_START,
    LEVELS,
    MANY_REPEATS,
    MOVING,
    NATURAL_REPEATS,
    OFF_GRID,
    ON_GRID,
    RESTING_RUN,
    STEPS_A_SAMPLE,
    SURE_REPEATS,
)
from cosim.inference.held_out import HeldOutGain
from cosim.inference.pieces import Cuts
from cosim.inference.thresholds import COMPUTED, OWN_NOISE

Array = NDArray[np.float64]

SAMPLED = ("sensor.quantisation", "sensor.dropout")


@dataclass(frozen=True)
class Signature:
    """An effect found in the samples.

    Attributes:
        effect: its name.
        parameter: its parameter, with `value` and standard deviation, SI.
        gain: log-likelihood of the signature against chance.
        held_out: the same in the third of the log that shows least of it but one.
    """

    effect: str
    parameter: str
    value: float
    deviation: float
    gain: float
    held_out: float = 0.0

    @property
    def held_out_gain(self) -> HeldOutGain:
        """`held_out` with its deviation: of a log-likelihood ratio the variance is twice its mean, as of a shift."""
        return HeldOutGain(self.held_out, float(np.sqrt(2.0 * max(self.held_out, 0.0))))


def grid_step(values: Array) -> float:
    """Step of the grid on which readings (n,) lie, in their unit; 0 if they lie on none that is coarser than rounding."""
    distinct, step = np.unique(values), finest(values)
    if step == 0.0:
        return 0.0
    for _ in range(3):  # the step is known to the spread of all readings once each has its number
        numbers = np.round((values - distinct[0]) / step)
        weight = float(numbers @ numbers)
        if weight == 0.0:
            return 0.0
        step = float(numbers @ (values - distinct[0])) / weight
    off = np.abs((values - distinct[0]) / step - np.round((values - distinct[0]) / step))
    return step if float(np.mean(off < OFF_GRID)) > ON_GRID else 0.0


def finest(values: Array) -> float:
    """Smallest difference that readings (n,) show between each other, in their unit; 0 if hardly any two are the same.

    Of a grid it is the step, also where the file was printed with so few digits that the step is not the same everywhere.
    """
    distinct = np.unique(values)
    if distinct.size < 3 or distinct.size > values.size / 2:
        return 0.0
    gaps = np.diff(distinct)
    # readings that differ by conversion of units alone are one reading
    gaps = gaps[gaps > 1e-9 * max(float(np.ptp(values)), 1e-300)]
    return float(np.median(gaps[gaps < 1.5 * gaps.min()])) if gaps.size > 1 else 0.0


def sharpness(values: Array) -> float:
    """Size of what readings (n,) change by from sample to sample without a motion, in their unit."""
    return float(np.std(np.diff(values, 2)) / np.sqrt(6.0)) if values.size > 3 else 0.0


def coarse_step(values: Array) -> float:
    """Step of the grid on which readings (n,) lie, in their unit; 0 if they change by more from sample to sample."""
    step = grid_step(values)
    return step if step > COARSE * sharpness(values) else 0.0


def coarse_steps(signals: Mapping[str, Array], cuts: Cuts = ()) -> dict[str, float]:
    """Signal -> that step, of the signals whose readings (n,) lie on such a grid, in their unit.

    Of several logs behind one another each has a grid of its own: logs are zeroed each by itself.
    """
    each = {name: [coarse_step(part) for part in np.split(values, cuts)] for name, values in signals.items()}
    return {name: min(filter(None, steps)) for name, steps in each.items() if any(steps)}


def stale_share(values: Array, rate: Array) -> tuple[float, float, float]:
    """Share of stale samples, its standard deviation, and the share that chance alone repeats.

    Args:
        values: (n,) readings.
        rate: (n,) smoothed rate of them.
    """
    moving = (np.abs(rate) > MOVING * max(float(np.abs(rate).max()), 1e-300))[2:]
    moving &= ~(resting(values) | rounded(values))[2:]
    same = (values[2:] == values[1:-1])[moving]
    chance = ((values[2:] == values[:-2]) & (values[2:] != values[1:-1]))[moving]
    n = max(int(moving.sum()), 1)
    # what equals the last but one and not the last is coincidence: neither was held
    natural = float(chance.mean()) if chance.size else 0.0
    found = float(same.mean()) if same.size else 0.0
    share = max(0.0, (found - natural) / max(1.0 - natural, 1e-9))
    return share, float(np.sqrt(max(found * (1.0 - found), 1.0 / n) / n)), natural


def cells(values: NDArray[np.float64], low: float, size: float) -> NDArray[np.int64]:
    """(n,) the cell of level and direction, of 3 `LEVELS`, that each sample of a command (n,) visits.

    Args:
        values: of a part of the log.
        low: least value of the whole, in the command's unit.
        size: range of the whole.
    """
    level = np.clip((values - low) / size * LEVELS, 0, LEVELS - 1).astype(np.int64)
    return 3 * level + np.sign(np.diff(values, prepend=values[:1])).astype(np.int64) + 1


def resting(values: Array) -> NDArray[np.bool_]:
    """(n,) True where readings (n,) without noise repeat because the drive stands.

    After stale samples the reading jumps by all that was missed, after a rest it starts as gently as it goes on.
    """
    found = np.zeros(values.size, dtype=bool)
    fresh = values[np.concatenate([[True], values[1:] != values[:-1]])]
    if noisy(fresh):  # no reading is repeated to the last digit twenty times
        return found
    same = np.concatenate([[False], values[1:] == values[:-1], [False]])
    edges = np.flatnonzero(same[1:] != same[:-1])
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first < RESTING_RUN:
            continue
        after = np.abs(np.diff(values[last : last + 3]))
        if after.size < 2 or after[0] <= GENTLE_START * after[1]:
            found[first : last + 1] = True
    return found


def rounded(values: Array) -> NDArray[np.bool_]:
    """(n,) True where readings (n,) may repeat because they come in steps and move by less than two a sample.

    A lost packet repeats a reading however fast the motion is; one in steps stays until the next.
    """
    if values.size < RESTING_RUN:
        return np.zeros(values.size, dtype=bool)
    motion = np.abs(uniform_filter1d(np.gradient(values), RESTING_RUN, mode="nearest"))
    return motion < STEPS_A_SAMPLE * finest(values)


def noisy(values: Array) -> bool:
    """True if readings (n,) have noise of their own, by what is usual among them: jumps after stale samples are rare."""
    if values.size < 5:
        return False
    moved, own = (float(np.median(np.abs(np.diff(values, order)))) for order in (1, 4))
    return own / np.sqrt(70.0) > OWN_NOISE * COMPUTED * moved


def signatures(values: Array, rate: Array, noise: float) -> list[Signature]:
    """The effects whose signatures the slew readings (n,) [rad] bear.

    Args:
        values: readings as logged.
        rate: (n,) smoothed rate, rad/s.
        noise: size of the noise of one reading, as far as it is known, rad.
    """
    step = coarse_step(values)
    if step > COARSE * noise:
        # each reading on the grid by chance: the width of the test, 1 in 50
        gain = values.size * float(np.log(CHANCE_ON_GRID))
        return [Signature("sensor.quantisation", "quantum", step, step / values.size, gain)]
    share, spread, natural = stale_share(values, rate)
    if lost(share, spread, natural):
        gain = values.size * share * float(np.log(share / max(natural, 1.0 / values.size)))
        return [Signature("sensor.dropout", "p_drop", share, spread, gain)]
    return []


def lost(share: float, spread: float, natural: float) -> bool:
    """True if repeats, as `stale_share` counts them, are more than chance, coloured noise or rounding makes."""
    # readings in coarse steps repeat by themselves: lost packets among them cannot be seen
    return natural < NATURAL_REPEATS and share > max(
        MANY_REPEATS, SURE_REPEATS * spread, COLOURED_REPEATS * natural
    )


def bridged(values: Array, lost: NDArray[np.bool_], time: Array | None = None, of: int = 1) -> Array:
    """Values (n,) with those of lost samples on straight lines between the others, over time (n,) or evenly.

    The lines run between means `of` so many others: a gap shall not repeat the noise of the two at its ends.
    """
    at = np.arange(values.size, dtype=np.float64) if time is None else time
    found = values.copy()
    if lost.all():  # nothing stands on either side
        return found
    found[lost] = np.interp(at[lost], at[~lost], uniform_filter1d(values[~lost], of, mode="nearest"))
    return found


def stale(values: Array, rate: Array) -> NDArray[np.bool_]:
    """(n,) True where readings (n,) are stale, with their smoothed rate (n,); nowhere if no packets were lost."""
    if values.size < 4 or coarse_step(values) or not lost(*stale_share(values, rate)):
        return np.zeros(values.size, dtype=bool)
    return np.concatenate([[False], values[1:] == values[:-1]]) & ~(resting(values) | rounded(values))
