"""What an estimate says of the next log of the same machine: each log is one repetition.

The noise of one log says how well that log is described, not how the machine, its oil or what the model lacks change until
the next. So it is asked where each log draws the estimate from all, and what these values scatter beyond their own
uncertainty widens its interval: the random effects of a meta-analysis. A log draws by its score at the joint estimate over
its share of the information (the infinitesimal jackknife, a log as the unit: Jaeckel 1972; Liang and Zeger, Longitudinal
data analysis using generalized linear models, Biometrika 73(1), 1986). A fit to that log alone would say the same where the
log tells all parameters, and lose its way where only several logs tell them apart, such as a dead zone and a gain from one
step each. Two or three logs hardly tell that scatter. What is known beforehand is that a parameter of one machine hardly
changes by more than its own size, and may not change at all: a half-normal prior of half its size (Friede, Roever, Wandel
and Neuenschwander, Meta-analysis of two studies in the presence of heterogeneity, Biometrical Journal 59(4), 2017) beside a
share of none, over which the interval is averaged (Gronau et al., A Bayesian model-averaged meta-analysis, Comprehensive
Results in Social Psychology 2(1), 2017).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import erf

from cosim.inference.thresholds import BETWEEN_LOGS, SAME_IN_ALL, SAYS_NOTHING

Array = NDArray[np.float64]

SCATTERS = np.linspace(0.0, 4.0, 401)  # of that prior: where it is summed


@dataclass(frozen=True)
class Between:
    """One parameter in several logs, SI.

    Attributes:
        value: estimate from all logs together.
        values: (k,) where each log draws it.
        deviations: (k,) standard deviation of each by its own log; infinite where a log says nothing.
        within: variance of `value` by the logs' own uncertainty.
        share: variance of `value` over that from log to log.
        scatters, chances: (m,) standard deviations from log to log beyond the logs' own, and how likely each is.
    """

    value: float
    values: Array = field(repr=False)
    deviations: Array = field(repr=False)
    within: float
    share: float = 0.0
    scatters: Array = field(default_factory=lambda: np.zeros(1), repr=False)
    chances: Array = field(default_factory=lambda: np.ones(1), repr=False)

    @property
    def scatter(self) -> float:
        """Standard deviation from log to log."""
        return float(np.sqrt(self.chances @ self.scatters**2))

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval of the machine's value: the mean of all its logs."""
        return self.around(self.within + self.share * self.scatters**2)

    @property
    def next_ci95(self) -> tuple[float, float]:
        """95 % interval of what another log of the machine, as long as these, would give by itself."""
        known = self.deviations[np.isfinite(self.deviations)]
        own = float(np.median(known)) ** 2 if known.size else 0.0
        return self.around(self.within + own + (1.0 + self.share) * self.scatters**2)

    def around(self, variances: Array) -> tuple[float, float]:
        """95 % interval about the value, whose variance is one of these, as likely as their scatters."""
        spread = np.sqrt(2.0 * np.maximum(variances, 0.0))
        most = 5.0 * float(spread.max())
        if most <= 0.0:
            return self.value, self.value

        def missed(reach: float) -> float:
            inside = np.divide(reach, spread, out=np.full_like(spread, np.inf), where=spread > 0.0)
            return float(self.chances @ erf(inside)) - 0.95

        reach = float(brentq(missed, 0.0, most)) if missed(0.0) < 0.0 else 0.0
        return self.value - reach, self.value + reach


def combined(
    value: float,
    deviation: float,
    values: Array,
    deviations: Array,
    size: float,
    usual: float = BETWEEN_LOGS,
) -> Between:
    """One parameter over several logs.

    Args:
        value: estimate from all logs together.
        deviation: its standard deviation if they were one log.
        values: (k,) estimate from each log.
        deviations: (k,) standard deviation of each; zero or not finite where the log says nothing of it.
        size: of the parameter: how far it is from where it has no effect.
        usual: standard deviation of the half-normal prior over it.
    """
    known = np.isfinite(deviations) & (deviations > 0.0) & np.isfinite(values)
    told = np.where(known, deviations, np.inf)
    each, squares = values[known], deviations[known] ** 2
    if each.size < 2:
        return Between(value, values, told, deviation**2)
    prior = usual * max(size, float(np.sqrt(squares.min())))
    scatters = prior * SCATTERS
    variances = squares[:, None] + scatters**2
    weights = 1.0 / variances
    mean = (weights * each[:, None]).sum(axis=0) / weights.sum(axis=0)
    likely = -0.5 * (
        np.log(variances).sum(axis=0)
        + np.log(weights.sum(axis=0))
        + (weights * (each[:, None] - mean) ** 2).sum(axis=0)
    )
    before = np.exp(-0.5 * SCATTERS**2)
    before *= (1.0 - SAME_IN_ALL) / before.sum()
    before[0] += SAME_IN_ALL
    chances = before * np.exp(likely - likely.max())
    share = float(np.sum(squares**-2) / np.sum(1.0 / squares) ** 2)
    return Between(value, values, told, deviation**2, share, scatters, chances / chances.sum())


@dataclass(frozen=True)
class Drawn:
    """Where each of several logs draws the k estimates that all of them gave.

    Attributes:
        steps: (logs, k) what each adds to the estimate from all, in its unit.
        shares: (logs, k) its share of what is known of each, from 0 to 1.
    """

    steps: Array
    shares: Array


def drawn_by_logs(slopes: Array, rows: Array, log: NDArray[np.int64], scales: Array) -> Drawn | None:
    """The infinitesimal jackknife of a least-squares fit with a log as the unit; None for one log.

    Args:
        slopes: (n + p, k) of the whitened residuals, and those of priors behind them, in the estimates over their scales.
        rows: (n + p,) these residuals.
        log: (n,) number of the log to which each residual belongs, from 0; -1 for none.
        scales: (k,) of the estimates.
    """
    count = int(log.max(initial=-1)) + 1
    if count < 2:
        return None
    spread = np.linalg.pinv(slopes.T @ slopes, hermitian=True)
    steps, shares = np.zeros((count, scales.size)), np.zeros((count, scales.size))
    for one in range(count):
        mine = np.flatnonzero(log == one)
        own = slopes[mine]
        steps[one] = -(spread @ (own.T @ rows[mine])) * scales
        shares[one] = np.clip(np.diag(spread @ (own.T @ own)), 0.0, 1.0)
    return Drawn(steps, shares)


def between_logs(value: float, deviation: float, steps: Array, shares: Array, size: float) -> Between:
    """One parameter by where each log draws it, (logs,) `steps` and `shares` of `Drawn`; the rest as `combined`."""
    told = shares > SAYS_NOTHING
    weights = np.where(told, shares, 1.0)
    deviations = np.where(told, deviation / np.sqrt(weights), np.inf)
    return combined(value, deviation, value + steps / weights, deviations, size)
