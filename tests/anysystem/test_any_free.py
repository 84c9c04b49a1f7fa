"""Free and trusted parameters follow every cause: also where a cause moves them farther than slopes reach."""

from types import SimpleNamespace

import numpy as np
import pytest

from cosim.anysystem.actions import PARAMETER, Action
from cosim.anysystem.search.fits import Fits
from cosim.anysystem.search.known import Known
from cosim.diagnosis.budget import Budget
from cosim.inference.problem import ABOUT, Problem
from cosim.inference.unknowns import Unknown
from cosim.ssp.system import Port

TIME = np.arange(200) * 0.02
TAU, DELAY, TAU_WITHOUT = 0.3, 0.2, 0.45  # as it is, and the time constant that stands in for the delay
NOISE = 0.002


def answer(tau, delay):
    """A step through a first-order lag, late."""
    late = np.clip(TIME - delay, 0.0, None)
    return {"dryer.temp#0": 1.0 - np.exp(-late / tau)}


def judged(model, measured):
    """A problem of one log."""
    noisy = {n: v + NOISE * np.random.default_rng(0).normal(size=TIME.size) for n, v in measured.items()}
    every = {n: np.ones(TIME.size, dtype=bool) for n in measured}
    windows = {n: np.arange(TIME.size) // 20 for n in measured}
    return Problem(noisy, every, windows, model, dict.fromkeys(measured, NOISE))


def known_of(problem, wide, trusted, numbers):
    """What is known of a group of one component."""
    known = Known.__new__(Known)
    known.problem, known.budget, known.spreads = problem, Budget(), {}
    known.wide, known.trusted, known.scales = wide, trusted, {n: v for n, (v, _) in trusted.items()}
    variable = SimpleNamespace(low=-np.inf, high=np.inf)
    known.model = SimpleNamespace(system=SimpleNamespace(variable=lambda port: variable))
    known.numbers = lambda action: numbers[action] if action in numbers else Known.numbers(known, action)
    return known


def test_a_time_constant_that_stood_in_for_a_delay_gives_it_back():
    """A hair dryer's delay was refused: its free lag stayed beside it as it had been without it, or ran by its slope."""
    delay, tau = Action("port.delay", Port("dryer", "temp"), "output"), f"{PARAMETER}|dryer.tau"
    number = Unknown(delay.key("delay"), 0.0, 2.0, 0.1)

    def model(values):
        return answer(values[tau], values.get(number.name, 0.0))

    problem = judged(model, answer(TAU, DELAY))
    begin, step = {tau: TAU_WITHOUT}, 0.01
    slope = {n: (model({tau: TAU_WITHOUT + step})[n] - v) / step for n, v in model(begin).items()}
    problem.share(
        [Unknown(f"free:{tau}", -np.inf, np.inf, 1.0, 1e3)], {n: s.reshape(1, -1) for n, s in slope.items()}
    )
    known = known_of(problem, [Unknown(tau, 0.01, 10.0, 0.2 * TAU_WITHOUT)], {}, {delay: [number]})
    fit = Fits(known).fit([delay], begin | {number.name: 0.1})
    assert fit.values[number.name] == pytest.approx(DELAY, abs=0.01)
    assert fit.values[tau] == pytest.approx(TAU, abs=0.01)


@pytest.mark.parametrize("capacity", [1.15, 1.5])
def test_a_trusted_parameter_is_moved_where_its_slope_ends_and_pays_for_the_whole_way(capacity):
    """A heated block of another capacity had a gain of 0.7: by its slope a capacity trusted to 20 % was no model."""
    size, key = 0.2, f"{PARAMETER}|block.capacity"

    def heated(capacity):
        return {"block.temp#0": 1.0 - np.exp(-TIME / (TAU * capacity))}

    def model(values):
        moved = values.get(ABOUT + key, 0.0) * size
        return heated(values.get(key, 1.0 + moved))

    problem = judged(model, heated(capacity))
    slope = (heated(1.0 + size)["block.temp#0"] - heated(1.0)["block.temp#0"]).reshape(1, -1)
    problem.share([Unknown(key, -3.0, 3.0, 1.0, 1.0)], {"block.temp#0": slope})
    known = known_of(problem, [], {"block.capacity": (1.0, size)}, {})
    by_slope = problem.fit((), {})
    fit = known.followed(by_slope, ())
    far = capacity > 1.2
    assert (ABOUT + key in fit.values) is far
    assert np.std(problem.residuals(fit.values)["block.temp#0"]) == pytest.approx(NOISE, rel=0.2)
    assert problem.nuisances(fit.values)[key] == pytest.approx((capacity - 1.0) / size, abs=0.1)
    assert fit.rows[-1] == pytest.approx((capacity - 1.0) / size, abs=0.1)
    if far:
        assert fit.log_likelihood > by_slope.log_likelihood + 100.0
    # as a cause it is a number of its own: nothing follows, whatever was moved before
    own = problem.rows(fit.values | {key: capacity})
    assert own[-1] == 0.0
