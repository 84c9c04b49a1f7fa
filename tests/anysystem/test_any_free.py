"""Free parameters are fitted with every cause: also where a cause moves them farther than slopes reach."""

from types import SimpleNamespace

import numpy as np
import pytest

from cosim.anysystem.actions import PARAMETER, Action
from cosim.anysystem.search.fits import Fits
from cosim.diagnosis.budget import Budget
from cosim.inference.problem import Problem
from cosim.inference.unknowns import Unknown
from cosim.ssp.system import Port

TIME = np.arange(200) * 0.02
TAU, DELAY, TAU_WITHOUT = 0.3, 0.2, 0.45  # as it is, and the time constant that stands in for the delay


def answer(tau, delay):
    """A step through a first-order lag, late."""
    late = np.clip(TIME - delay, 0.0, None)
    return {"dryer.temp#0": 1.0 - np.exp(-late / tau)}


def test_a_time_constant_that_stood_in_for_a_delay_gives_it_back():
    """A hair dryer's delay was refused: its free lag stayed beside it as it had been without it, or ran by its slope."""
    delay, tau = Action("port.delay", Port("dryer", "temp"), "output"), f"{PARAMETER}|dryer.tau"
    number = Unknown(delay.key("delay"), 0.0, 2.0, 0.1)
    noise = 0.002 * np.random.default_rng(0).normal(size=TIME.size)
    measured = {n: v + noise for n, v in answer(TAU, DELAY).items()}
    every = {n: np.ones(TIME.size, dtype=bool) for n in measured}

    def model(values):
        return answer(values[tau], values.get(number.name, 0.0))

    problem = Problem(
        measured,
        every,
        {n: np.arange(TIME.size) // 20 for n in measured},
        model,
        dict.fromkeys(measured, 0.002),
    )
    begin, step = {tau: TAU_WITHOUT}, 0.01
    slope = {n: (model({tau: TAU_WITHOUT + step})[n] - v) / step for n, v in model(begin).items()}
    problem.share(
        [Unknown(f"free:{tau}", -np.inf, np.inf, 1.0, 1e3)], {n: s.reshape(1, -1) for n, s in slope.items()}
    )
    known = SimpleNamespace(
        problem=problem,
        model=None,
        budget=Budget(),
        spreads={},
        wide=[Unknown(tau, 0.01, 10.0, 0.2 * TAU_WITHOUT)],
        numbers=lambda action: [number],
        at=lambda values: problem.log_likelihood(problem.rows(values), values, ()),
    )
    fit = Fits(known).fit([delay], begin | {number.name: 0.1})
    assert fit.values[number.name] == pytest.approx(DELAY, abs=0.01)
    assert fit.values[tau] == pytest.approx(TAU, abs=0.01)
