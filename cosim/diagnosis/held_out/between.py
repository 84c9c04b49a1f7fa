"""What an estimate says of the next log of the same machine: each log is one repetition.

The noise of one log says how well that log is described, not how the machine, its oil or what the model lacks change until
the next. So each parameter is estimated in each log by itself, and what these estimates scatter beyond their own
uncertainty widens the interval of the estimate from all: the random effects of a meta-analysis. Two or three logs hardly
tell that scatter. What is known beforehand is that a parameter of one machine hardly changes by more than its own size,
and may not change at all: a half-normal prior of half its size (Friede, Roever, Wandel and Neuenschwander, Meta-analysis of
two studies in the presence of heterogeneity, Biometrical Journal 59(4), 2017) beside a share of none, over which the
interval is averaged (Gronau et al., A Bayesian model-averaged meta-analysis, Comprehensive Results in Social Psychology
2(1), 2017).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import erf

from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.record.grid import of_piece
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.thresholds import BETWEEN_LOGS, SAME_IN_ALL

Array = NDArray[np.float64]

SCATTERS = np.linspace(0.0, 4.0, 401)  # of that prior: where it is summed


@dataclass(frozen=True)
class Between:
    """One parameter in several logs, SI.

    Attributes:
        value: estimate from all logs together.
        values: (k,) estimate from each log.
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


def combined(value: float, deviation: float, values: Array, deviations: Array, size: float) -> Between:
    """One parameter over several logs.

    Args:
        value: estimate from all logs together.
        deviation: its standard deviation if they were one log.
        values: (k,) estimate from each log.
        deviations: (k,) standard deviation of each; zero or not finite where the log says nothing of it.
        size: of the parameter: how far it is from where it has no effect.
    """
    known = np.isfinite(deviations) & (deviations > 0.0) & np.isfinite(values)
    told = np.where(known, deviations, np.inf)
    each, squares = values[known], deviations[known] ** 2
    if each.size < 2:
        return Between(value, values, told, deviation**2)
    prior = BETWEEN_LOGS * max(size, float(np.sqrt(squares.min())))
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


def task_of(task: Task, log: int) -> Task:
    """The task of one of the logs by itself, with the noise that was learned from all."""
    cuts, model = task.model.cuts, task.model.parts[log]
    own = GroupModel(model.group, model.drive, model.h, of_piece(task.model.fixed, log), model.grid)
    found = replace(
        task,
        model=own,
        measured={s: np.split(v, cuts)[log] for s, v in task.measured.items()},
        discrepancy={s: np.split(rows, cuts, axis=1)[log] for s, rows in task.discrepancy.items()},
        lost={s: np.split(v, cuts)[log] for s, v in task.lost.items()},
        mask=None,
    )
    found.set_rules({s: rule.of_log(log) for s, rule in task.rules.items()})
    return found


def fit_of(fit: Fit, cuts: tuple[int, ...], log: int) -> Fit:
    """A fit to all logs as far as it concerns one of them: where a fit to that one begins."""
    return replace(
        fit,
        residuals={s: np.split(r, cuts)[log] for s, r in fit.residuals.items()},
        predicted={s: np.split(r, cuts)[log] for s, r in fit.predicted.items()},
        slopes=None,
        rows=None,
    )


def over_logs(
    record: Record,
    values: Mapping[str, float],
    deviations: Mapping[str, float],
    fitted: Callable[[int], Mapping[str, tuple[float, float]]],
    off: Callable[[str], float],
) -> dict[str, Between]:
    """Each estimated parameter over the logs of a record; nothing for one log.

    Args:
        record: the logs.
        values: ``component.parameter`` -> estimate from all logs together, SI.
        deviations: standard deviation of those that were estimated.
        fitted: log -> (estimate, standard deviation) of each from that log alone.
        off: ``component.parameter`` -> where it has no effect, SI.
    """
    if not record.cuts:
        return {}
    each = [fitted(i) for i in range(len(record.pieces))]
    found = {}
    for name in (n for n in values if n in deviations and all(n in own for own in each)):
        rows = np.array([own[name] for own in each])
        size = min(
            abs(values[name] - off(name)), abs(values[name])
        )  # a limit out of reach says nothing of one that is met
        found[name] = combined(values[name], deviations[name], rows[:, 0], rows[:, 1], size)
    return found


def estimates(fit: Fit) -> dict[str, tuple[float, float]]:
    """(estimate, standard deviation) of each parameter of a fit; one that ended on a bound says nothing."""
    return {
        n: (v, fit.deviations.get(n, 0.0) if n not in fit.at_bound else np.inf) for n, v in fit.values.items()
    }
