"""What a log determines: intervals, directions it does not see, correlations, and whether the noise model holds.

All numbers of this file are in units of the unknowns' sizes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from cosim.calibrate.outcome import Undetermined
from cosim.correlation import correlations

Array = NDArray[np.float64]
BLIND = 0.5  # a change of half a parameter's size within one standard deviation is not seen
MEMBER = 0.2  # share of the largest change from which a parameter counts as part of a direction
UNSEEN = 100.0  # sizes; so uncertain is a parameter on which nothing depends
CORRELATED = 0.95
BLOCKS = 20  # parts of the fitted log by which the intervals are checked
CHANCE = 1e-3  # probability below which a larger spread between parts is no chance


def described(direction: Array, deviation: float, names: Sequence[str], at: Array) -> Undetermined:
    """A direction that is not seen, in words.

    Args:
        direction: (p,) in sizes.
        deviation: standard deviation of a step along it.
        names: of the unknowns.
        at: (p,) their values in sizes: the changes are in parts of the value, or of the size where that is more.
    """
    direction = direction / np.maximum(np.abs(at), 1.0)
    largest = float(np.abs(direction).max())
    direction = direction / direction[np.argmax(np.abs(direction))]
    deviation = deviation * largest
    changes = {n: float(d) for n, d in zip(names, direction, strict=True) if abs(d) >= MEMBER}
    if len(changes) > 1:
        moves = ", ".join(f"{n} {d:+.3g} %" for n, d in changes.items())
        only = ", ".join(changes)
        why = f"this log shows {only} only together: changing {moves} alters nothing in it that stands out"
    elif deviation > UNSEEN:
        why = f"nothing in this log depends on {next(iter(changes))}"
    else:
        why = f"this log leaves {next(iter(changes))} uncertain by {100.0 * deviation:.3g} %"
    return Undetermined(changes, deviation, why)


def covariance(jacobian: Array, active: Sequence[int]) -> Array:
    """(p, p) covariance of the unknowns `active`, NaN elsewhere."""
    p = jacobian.shape[1]
    result = np.full((p, p), np.nan)
    if len(active):
        part = jacobian[:, list(active)]
        scale = np.sqrt(np.maximum(np.sum(part**2, axis=0), 1e-300))
        inverse = np.linalg.pinv((part / scale).T @ (part / scale), rcond=1e-14, hermitian=True)
        result[np.ix_(active, active)] = inverse / np.outer(scale, scale)
    return result


def correlated(spread: Array, names: Sequence[str]) -> list[tuple[str, str, float]]:
    """Pairs whose estimates move together beyond `CORRELATED`."""
    every = correlations(names, spread)
    return [(*pair, value) for pair, value in every.items() if abs(value) > CORRELATED]


@dataclass(frozen=True)
class Check:
    """Whether the parts of the log agree with one another as the noise model says.

    Attributes:
        ratio: (p,) variance that the parts show over that of the model.
        limit: (p,) ratio beyond which it is no chance.
    """

    ratio: Array
    limit: Array

    @property
    def inflation(self) -> Array:
        """(p,) factor on the standard deviations: 1 where the noise model holds."""
        return np.where(self.ratio > self.limit, np.sqrt(self.ratio), 1.0)


def check(jacobian: Array, row: Array, lengths: Sequence[int], spread: Array, active: Sequence[int]) -> Check:
    """Compare the covariance with that of the scores of `BLOCKS` parts of the log (sandwich estimate).

    Args:
        jacobian: (rows, p) whitened slopes.
        row: (rows,) whitened residuals.
        lengths: rows of each signal in order; what follows are priors.
        spread: (p, p) covariance.
        active: numbers of the unknowns that count.
    """
    p = jacobian.shape[1]
    scores = np.zeros((BLOCKS, len(active)))
    expected = np.zeros((BLOCKS, len(active)))
    inner = spread[np.ix_(active, active)]
    at = 0
    for length in lengths:
        moved = jacobian[at : at + length][:, list(active)] @ inner
        for k, part in enumerate(np.array_split(np.arange(length), BLOCKS)):
            scores[k] += moved[part].T @ row[at : at + length][part]
            expected[k] += np.sum(moved[part] ** 2, axis=0)
        at += length
    ratio, limit = np.ones(p), np.full(p, np.inf)
    total = np.maximum(expected.sum(axis=0), 1e-300)
    ratio[list(active)] = np.sum(scores**2, axis=0) / total
    # few parts may carry all the news: then fewer count
    freedom = np.maximum(total**2 / np.maximum(np.sum(expected**2, axis=0), 1e-300), 1.0)
    limit[list(active)] = chi2.ppf(1.0 - CHANCE, freedom) / freedom
    return Check(ratio, limit)
