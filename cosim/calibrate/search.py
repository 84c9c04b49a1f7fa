"""The search: several starts with the noise each signal shows by itself, then the best again with the noise learned."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import qmc

from cosim.calibrate.outcome import Start
from cosim.calibrate.problem import Problem
from cosim.errors import SimulationError, UsageError
from cosim.inference.noise import Noise, quietest
from cosim.inference.spectrum import bands, learn
from cosim.interrupts import often_uninterrupted

Array = NDArray[np.float64]
SCREENED = 4  # points looked at for each start that is drawn
ROUGH, FINE = 12, 40  # iterations at most
ROUNDS = 5  # of learning the noise and fitting again
SETTLED = 0.02  # standard deviations by which a round may still move a parameter
SAME = 0.1  # relative difference of costs of starts that ended in the same place


@dataclass
class Found:
    """Where the search ended.

    Attributes:
        z: unknowns in units of their sizes.
        noise: of each signal.
        residuals: (m,) of each signal, SI.
        jacobian: (rows, p) of the whitened residuals, priors last.
        row: (rows,) whitened residuals.
        starts: how each start ended.
        settled: the last round moved nothing any more.
    """

    z: Array
    noise: dict[str, Noise]
    residuals: dict[str, Array]
    jacobian: Array
    row: Array
    starts: list[Start]
    settled: bool


def descend(problem: Problem, z: Array, noise: Mapping[str, Noise], rounds: int) -> tuple[Array, float]:
    """Least squares from z within the bounds; returns where it ended and half the sum of squares there."""
    low = np.array([u.low / u.size for u in problem.unknowns])
    high = np.array([u.high / u.size for u in problem.unknowns])

    def cost(x: Array) -> Array:
        return problem.white(problem.residuals(x), noise, x)

    def slopes(x: Array) -> Array:
        return problem.white_slopes(problem.slopes(x), noise)

    found = least_squares(
        cost,
        np.clip(z, low, high),
        slopes,
        bounds=(low, high),
        x_scale="jac",
        max_nfev=rounds,
        xtol=1e-8,
        ftol=1e-10,
    )
    return snapped(np.asarray(found.x), low, high), float(found.cost)


def snapped(z: Array, low: Array, high: Array) -> Array:
    """Values on a bound that the interior search only approaches."""
    near = 1e-6 * np.maximum(1.0, np.abs(z))
    return np.where(z - low < near, low, np.where(high - z < near, high, z))


def first_point(problem: Problem) -> Array:
    """The model's own values, in units of the sizes."""
    return np.array([u.start / u.size for u in problem.unknowns])


def drawn(problem: Problem, count: int, noise: Mapping[str, Noise], seed: int) -> list[Array]:
    """The `count` best of a quasi-random sample over the reach of the free parameters."""
    if count <= 0:
        return []
    sampler = qmc.Sobol(len(problem.free), seed=seed)
    points = sampler.random(int(2 ** np.ceil(np.log2(SCREENED * count))))
    rated = []
    for point in points:
        z = first_point(problem)
        for i, (f, part) in enumerate(zip(problem.free, point, strict=True)):
            z[i] = _between(*f.reach, float(part)) / f.size
        row = problem.white(problem.residuals(z), noise, z)
        rated.append((float(row @ row), z))
    rated.sort(key=lambda pair: pair[0])
    return [z for _, z in rated[:count]]


def _between(low: float, high: float, part: float) -> float:
    """A point between two bounds: by ratio where they are of one sign and far apart."""
    if low > 0.0 and high / low > 4.0:
        return float(low * (high / low) ** part)
    if high < 0.0 and low / high > 4.0:
        return float(high * (low / high) ** part)
    return low + part * (high - low)


@often_uninterrupted()
def search(problem: Problem, *, starts: int, seed: int, coloured: bool) -> Found:
    """Fit from several starts, learn the noise from what is left, and fit again until nothing moves.

    Raises:
        UsageError: the model refuses its own start values.
        SimulationError: it refuses values beside those that fit best.
    """
    noise: dict[str, Noise] = problem.first_noise
    check_start(problem)
    points = [first_point(problem), *drawn(problem, starts - 1, noise, seed)]
    ends = [descend(problem, z, noise, ROUGH if len(points) > 1 else FINE) for z in points]
    best = min(range(len(ends)), key=lambda i: ends[i][1])
    z, lowest = ends[best]
    if len(points) > 1:
        z, lowest = descend(problem, z, noise, FINE)
    listed = [
        Start(
            {f.name: float(p[i] * f.size) for i, f in enumerate(problem.free)},
            cost,
            cost <= (1.0 + SAME) * lowest,
        )
        for p, (_, cost) in zip(points, ends, strict=True)
    ]
    listed.sort(key=lambda start: start.cost)
    return refined(problem, z, listed, coloured)


def check_start(problem: Problem) -> None:
    """See whether the model runs at all.

    Raises:
        UsageError: it refuses its own start values.
    """
    try:
        problem.simulate(problem.values(first_point(problem)))
    except SimulationError as error:
        raise UsageError(f"the model cannot run with its start values: {error}") from None


def refined(problem: Problem, z: Array, starts: list[Start], coloured: bool) -> Found:
    """Learn the noise and fit again from z until nothing moves; with white noise, fit once.

    Raises:
        SimulationError: the model refuses values beside those that fit best.
    """
    noise = problem.first_noise
    if not coloured:
        z, _ = descend(problem, z, noise, FINE)
        return finished(problem, z, noise, starts, True)
    settled = False
    for _ in range(ROUNDS):
        noise = learned(problem, z)
        moved, _ = descend(problem, z, noise, FINE)
        step = problem.white_slopes(problem.slopes(moved), noise) @ (moved - z)
        z = moved
        # the move in units of its own standard deviation
        settled = float(step @ step) <= SETTLED**2 * max(len(problem.unknowns), 1)
        if settled:
            break
    return finished(problem, z, noise, starts, settled)


def finished(
    problem: Problem, z: Array, noise: dict[str, Noise], starts: list[Start], settled: bool
) -> Found:
    """Everything at the point where the search ended.

    Raises:
        SimulationError: the model refuses it.
    """
    residuals = at_best(problem, z)
    slopes = problem.slopes(z)
    jacobian, row = problem.white_slopes(slopes, noise), problem.white(residuals, noise, z)
    return Found(z, noise, residuals, jacobian, row, starts, settled)


def at_best(problem: Problem, z: Array) -> dict[str, Array]:
    """Residuals where the search ended.

    Raises:
        SimulationError: the model refuses it.
    """
    residuals = problem.residuals(z)
    if residuals is None:
        raise SimulationError("the model refuses the values that fit best: give closer bounds")
    return residuals


def learned(problem: Problem, z: Array) -> dict[str, Noise]:
    """Noise of each signal from its residual at z; the residual runs straight through missing samples.

    Raises:
        SimulationError: the model refuses z.
    """
    residuals, slopes = at_best(problem, z), problem.slopes(z)
    found = {}
    for name, places in problem.places.items():
        whole = np.arange(places[0], places[-1] + 1)
        even = [np.interp(whole, places, row) for row in (residuals[name], *slopes[name])]
        found[name] = bands(even[0], np.stack(even[1:]), quietest(problem.comparator.log[name]))
    prior = np.zeros((len(problem.unknowns),) * 2)
    for i, (_, deviation) in problem.priors:
        prior[i, i] = (problem.unknowns[i].size / deviation) ** 2
    return learn(found, prior)
