"""What an estimate says of the next log of the same machine: each log is one repetition.

The noise of one log says how well that log is described, not how the machine, its oil or what the model lacks change until
the next. So each parameter is estimated in each log by itself, and what these estimates scatter beyond their own
uncertainty widens the interval of the estimate from all: the random effects of a meta-analysis, the scatter estimated as
Paule and Mandel do (J. Res. NBS 87(5), 1982), at the median of their statistic, so that of few logs it is as often too
large as too small (Viechtbauer 2021). It is itself hardly known, so Student's quantile is taken at the freedom that the
two parts have together (Satterthwaite, Biometrics Bulletin 2(6), 1946): of logs that agree it is the normal one, of logs
that do not that of K - 1.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import chi2
from scipy.stats import t as student

from cosim.diagnosis.data import Record
from cosim.diagnosis.fit import Fit, Task
from cosim.diagnosis.grid import of_piece
from cosim.diagnosis.group_model import GroupModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Between:
    """One parameter in several logs, SI.

    Attributes:
        value: estimate from all logs together.
        values: (k,) estimate from each log.
        deviations: (k,) standard deviation of each by its own log; infinite where a log says nothing.
        scatter: standard deviation from log to log beyond these.
        within, between: variance of `value` by the logs' own uncertainty, and by the scatter.
    """

    value: float
    values: Array = field(repr=False)
    deviations: Array = field(repr=False)
    scatter: float
    within: float
    between: float

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval of the machine's value: the mean of all its logs."""
        return self.around(self.within, self.between)

    @property
    def next_ci95(self) -> tuple[float, float]:
        """95 % interval of what another log of the machine, as long as these, would give by itself."""
        known = self.deviations[np.isfinite(self.deviations)]
        own = float(np.median(known)) ** 2 if known.size else 0.0
        return self.around(self.within + own, self.between + self.scatter**2)

    def around(self, sure: float, guessed: float) -> tuple[float, float]:
        """95 % interval about the value with a variance that is known and one that the scatter of these logs tells."""
        total, count = sure + guessed, int(np.isfinite(self.deviations).sum())
        if total <= 0.0:
            return self.value, self.value
        freedom = np.inf if guessed <= 0.0 else max(count - 1, 1) * (total / guessed) ** 2
        reach = float(student.ppf(0.975, freedom)) * float(np.sqrt(total))
        return self.value - reach, self.value + reach


def combined(value: float, deviation: float, values: Array, deviations: Array) -> Between:
    """One parameter over several logs.

    Args:
        value: estimate from all logs together.
        deviation: its standard deviation if they were one log.
        values: (k,) estimate from each log.
        deviations: (k,) standard deviation of each; zero or not finite where the log says nothing of it.
    """
    known = np.isfinite(deviations) & (deviations > 0.0) & np.isfinite(values)
    told = np.where(known, deviations, np.inf)
    off, squares = values[known] - value, deviations[known] ** 2
    if off.size < 2:
        return Between(value, values, told, 0.0, deviation**2, 0.0)

    def excess(scatter: float) -> float:
        return float(np.sum(off**2 / (squares + scatter))) - float(chi2.median(off.size - 1))

    most = 10.0 * float(np.sum(off**2))  # beyond any root: the median is more than a tenth of the freedom
    scatter = float(brentq(excess, 0.0, most)) if excess(0.0) > 0.0 else 0.0
    weights = 1.0 / squares
    share = float(np.sum(weights**2) / np.sum(weights) ** 2)
    return Between(value, values, told, float(np.sqrt(scatter)), deviation**2, scatter * share)


def task_of(task: Task, log: int) -> Task:
    """The task of one of the logs by itself, with the noise that was learned from all."""
    cuts, model = task.model.cuts, task.model.parts[log]
    own = GroupModel(model.group, model.drive, model.h, of_piece(task.model.fixed, log), model.grid)
    found = replace(
        task,
        model=own,
        measured={s: np.split(v, cuts)[log] for s, v in task.measured.items()},
        doubt={s: np.split(rows, cuts, axis=1)[log] for s, rows in task.doubt.items()},
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
) -> dict[str, Between]:
    """Each estimated parameter over the logs of a record; nothing for one log.

    Args:
        record: the logs.
        values: ``component.parameter`` -> estimate from all logs together, SI.
        deviations: standard deviation of those that were estimated.
        fitted: log -> (estimate, standard deviation) of each from that log alone.
    """
    if not record.cuts:
        return {}
    each = [fitted(i) for i in range(len(record.pieces))]
    found = {}
    for name in (n for n in values if n in deviations and all(n in own for own in each)):
        rows = np.array([own[name] for own in each])
        found[name] = combined(values[name], deviations[name], rows[:, 0], rows[:, 1])
    return found


def estimates(fit: Fit) -> dict[str, tuple[float, float]]:
    """(estimate, standard deviation) of each parameter of a fit; one that ended on a bound says nothing."""
    return {
        n: (v, fit.deviations.get(n, 0.0) if n not in fit.at_bound else np.inf) for n, v in fit.values.items()
    }
