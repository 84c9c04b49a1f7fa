"""Hypotheses held against one another on the same data: unknowns of a model, fitted, priced, tried on windows left out.

Nothing here knows of machines: a model is any function of named values to named series. docs/inference.md shows it at work.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.errors import SimulationError
from cosim.inference.held_out import HeldOutGain
from cosim.inference.problem import Fit, Model, Problem
from cosim.inference.thresholds import FITTED_WINDOWS, HELD_EVERY
from cosim.inference.unknowns import Unknown

Array = NDArray[np.float64]

LEARNINGS = 2  # times that the noise is learned anew from the best hypothesis, and all are fitted again


@dataclass(frozen=True)
class Hypothesis:
    """Which numbers of a model are unknown, where the search for them begins, and what the others are.

    Attributes:
        name: for people.
        unknowns: what is estimated; none for the model as it is.
        values: name -> value that the model is given, those of the unknowns where the search begins.
    """

    name: str
    unknowns: tuple[Unknown, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Judgement:
    """A hypothesis with what the data say of it; figures of different hypotheses are of the same noise.

    Attributes:
        hypothesis: the hypothesis.
        fit: its best values, with their covariance.
        score: log-likelihood of the fitted windows less BIC's price of its unknowns (Schwarz 1978).
        gain: log-likelihood that it gains on windows held out over the first hypothesis given; of that itself none.
    """

    hypothesis: Hypothesis
    fit: Fit
    score: float
    gain: HeldOutGain

    def ci95(self, name: str) -> tuple[float, float]:
        """95 % interval of an estimate."""
        reach = 1.96 * self.fit.deviation(name)
        return self.fit.values[name] - reach, self.fit.values[name] + reach


def problem_of(measured: Mapping[str, Array], model: Model, resolution: Mapping[str, float]) -> Problem:
    """Series against a model, cut into windows of which every third is held out, so that all regimes are in both parts.

    Args:
        measured: name -> (n,) evenly sampled.
        model: named values -> series of the same names; one that cannot be run raises `SimulationError`.
        resolution: name -> smallest noise that a series is taken to have, in its unit, such as a step of its converter.

    Raises:
        ValueError: a series is shorter than its windows.
    """
    short = [n for n, values in measured.items() if values.size < 2 * FITTED_WINDOWS]
    if short:
        raise ValueError(
            f"{short[0]} has {measured[short[0]].size} samples: give {2 * FITTED_WINDOWS} or more, two for each window"
        )
    window = {n: (np.arange(v.size) * FITTED_WINDOWS // v.size).astype(np.int64) for n, v in measured.items()}
    fitted = {n: w % HELD_EVERY != HELD_EVERY - 1 for n, w in window.items()}
    return Problem(measured, fitted, window, model, resolution)


def judged(problem: Problem, hypotheses: Sequence[Hypothesis]) -> tuple[Judgement, ...]:
    """What the data say of each hypothesis, best score first.

    The noise is learned from what the best hypothesis leaves, white and correlated parts, and all are fitted under it: one
    likelihood for all. What one hypothesis gains over the first is measured on windows that neither was fitted to.

    Args:
        problem: data and model, such as `problem_of` makes; its noise is learned.
        hypotheses: the first is the one that the others must beat, such as the model as it is.

    Raises:
        SimulationError: the model cannot be run where a search begins.
    """
    start = [dict(h.values) for h in hypotheses]
    found = _all(problem, hypotheses, start)
    for _ in range(LEARNINGS):
        best = max(found, key=lambda one: one.score)
        problem.learn(problem.residuals(best.fit.values))
        found = _all(problem, hypotheses, [one.fit.values for one in found])
    return tuple(sorted(found, key=lambda one: -one.score))


def _all(
    problem: Problem, hypotheses: Sequence[Hypothesis], start: Sequence[Mapping[str, float]]
) -> list[Judgement]:
    fits = [_fitted(problem, h, values) for h, values in zip(hypotheses, start, strict=True)]
    first = fits[0].rows
    return [
        Judgement(h, fit, _score(problem, fit), problem.held_out(fit.rows, first))
        for h, fit in zip(hypotheses, fits, strict=True)
    ]


def _fitted(problem: Problem, hypothesis: Hypothesis, start: Mapping[str, float]) -> Fit:
    found = problem.fit(hypothesis.unknowns, start)
    if found is None:
        said = problem.failures[-1] if problem.failures else "its series are not finite"
        raise SimulationError(f"the model of '{hypothesis.name}' cannot be run at {dict(start)}: {said}")
    return found


def _score(problem: Problem, fit: Fit) -> float:
    count = int(problem.mask.sum())
    return fit.log_likelihood - 0.5 * len(fit.unknowns) * float(np.log(count))
