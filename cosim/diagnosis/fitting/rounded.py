"""Residuals of readings in steps: what a model is off by beyond the step that each reading stands for.

A reading rounded to steps says between which two values the signal was, no more. Its error is no noise: it follows the
motion, and a motion hardly larger than a step is read too large or too small throughout, which passes for an inertia or a
friction. Within the step nothing is known, so nothing is held against a model there; all the news is in the instants at
which the reading changes.
"""

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.noise import Whitener

Array = NDArray[np.float64]

BEND = 0.1  # of a step: half the width over which the residual goes from nothing to its slope, so that it has one
NEWTON_ROUNDS = 6  # of Newton's method for the offset of a window


def beyond(residual: Array, step: float, rule: Whitener) -> Array:
    """(n,) what of measured minus predicted (n,) lies beyond the step of the readings, each window about its best offset.

    The offset stays in it, as in any other residual: from window to window it says where the axis goes.

    Args:
        residual: measured minus predicted.
        step: of the readings, in the same unit.
        rule: windows of the residual; without free offsets it is taken as it is.
    """
    off = placed(residual, step, rule)
    return outside(off, step)[0] + (residual - off)


def placed(residual: Array, step: float, rule: Whitener) -> Array:
    """(n,) measured minus predicted (n,), each window less the offset that leaves least beyond the step."""
    if not rule.demean:
        return residual
    rows = rule.layout.rows(residual)
    offset = rows.mean(axis=1)
    for _ in range(NEWTON_ROUNDS):
        off, slope = outside(rows - offset[:, None], step)
        offset = offset + off.sum(axis=1) / np.maximum(slope.sum(axis=1), 1.0)
    # what lies outside of all windows goes with the nearest one of its own log
    inside = [own[own >= 0] for own in np.split(rule.layout.numbers(residual.size), rule.cuts)]
    first = np.array([own[0] for own in inside])
    parts = np.split(np.arange(residual.size), rule.cuts)
    near = [
        np.clip((own - own[0] - rule.skip) // (rule.bins * rule.window), 0, used[-1] - used[0]) + begin
        for own, used, begin in zip(parts, inside, first, strict=True)
    ]
    return residual - offset[np.concatenate(near)]


def concentration(residual: Array, step: float, rule: Whitener) -> float:
    """By how much the noise of measured minus predicted (n,) is larger where it judges a model than on average, squared.

    Noise and news come together, in the instants at which the reading changes: against the noise of all instants a model
    would seem better known than it is (the sandwich of White, Econometrica 50(1), 1982).
    """
    off, slope = (rule.windows(row) for row in outside(placed(residual, step, rule), step))
    both = float(np.mean(off**2)) * float(np.mean(slope**2))
    return max(1.0, float(np.mean(off**2 * slope**2)) / both) if both > 0.0 else 1.0


def outside(values: Array, step: float) -> tuple[Array, Array]:
    """What of values (...) lies outside half a step to either side of zero, and its slope (...); bent, not broken."""
    bend = BEND * step
    over = np.abs(values) - (0.5 * step - bend)
    curved = np.clip(over, 0.0, 2.0 * bend)
    size = np.where(over < 2.0 * bend, curved**2 / (4.0 * bend), over - bend)
    return np.copysign(size, values), curved / (2.0 * bend)
