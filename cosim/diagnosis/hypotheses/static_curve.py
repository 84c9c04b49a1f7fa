"""Dead zone, end of the opening and ends of the travel, sought together: they bend one curve, each where the others let it.

Taken one by one each has another size: without the dead zone the gain is wrong, with a wrong gain the machine does not reach
its end when the log does, and the error of a free run has a local minimum for each. So where the place of a machine counts
they are sought at once, together with the parameters of which little is known, in all of the box in which they can lie
(differential evolution; Storn and Price, Journal of Global Optimization 11, 1997), and fitted from there.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from cosim.diagnosis.budget import current
from cosim.diagnosis.fitting.fit import Fit, Task, Unknown
from cosim.diagnosis.fitting.limits import measured_by, reached
from cosim.diagnosis.fitting.noise import broad
from cosim.diagnosis.fitting.trials import Trial, starting, tried
from fmus.contract import Effect

Array = NDArray[np.float64]

MEMBERS = 6  # of a generation, for each unknown
GENERATIONS = 30  # at most
WIDER = 5.0  # times as far from nominal as the search for an effect alone begins
ROUGHLY = 30.0  # factor to either side of a parameter of which hardly the order of magnitude is known
BETTER_KNOWN = 3.0  # standard deviations to either side of any other
LEAST_OPENING = 0.03  # of the widest that the model reaches, below which an end of it is not sought


@dataclass(frozen=True)
class Edge:
    """Where an unknown can lie: from `low` to `high`, SI; by its logarithm if `by_ratio`, both are of one sign then."""

    name: str
    low: float
    high: float
    by_ratio: bool = False

    def at(self, share: float) -> float:
        """The value at a share of the way from low to high, SI."""
        if self.by_ratio:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + share * (self.high - self.low))


def together(task: Task, null: Trial, candidates: Sequence[Effect], tolerance: float) -> Trial | None:
    """The effects that bend the static curve, fitted together from the best place of the box in which they can lie.

    None where there are fewer than two of them (one alone is found from its own starts), or where each window has an offset
    of its own: there no end of the travel lets the errors of a free run pile up.

    Args:
        task: data, model and noise; its noise is that of what the best place leaves, afterwards.
        null: the nominal model, fitted.
        candidates: the effects.
        tolerance: trust in the nominal parameters.
    """
    bending = tuple(e for e in candidates if e.bends)
    if len(bending) < 2 or any(rule.demean for rule in task.rules.values()) or current().over:
        return None
    wanted, starts = starting(task, bending, tolerance, null.fit)
    box = list(boxed(task, null.fit, bending, wanted, starts))
    rest = {u.name: null.fit.values.get(u.name, u.start) for u in wanted}
    priors = {u.name: u.prior for u in wanted if u.prior}

    def values(shares: Array) -> dict[str, float]:
        return rest | {edge.name: edge.at(share) for edge, share in zip(box, shares.tolist(), strict=True)}

    def cost(shares: Array) -> float:
        at = values(shares)
        white = task.white(task.residuals(at))
        return float(white @ white) + sum(((at[n] - m) / spread) ** 2 for n, (m, spread) in priors.items())

    found = differential_evolution(
        cost,
        [(0.0, 1.0)] * len(box),
        popsize=MEMBERS,
        maxiter=GENERATIONS,
        rng=1,  # the same log gives the same answer
        polish=False,
        init="sobol",
        callback=lambda intermediate_result: current().over,
    )
    best = values(found.x)
    begin = replace(null.fit, values=best, slopes=None, residuals=task.residuals(best))
    # under the noise of the nominal model's errors a limit that matters less would seem out of reach
    task.set_rules({s: broad(rule, begin.residuals[s]) for s, rule in task.rules.items()})
    return tried(task, bending, tolerance, begin)


def boxed(
    task: Task,
    found: Fit,
    effects: Sequence[Effect],
    wanted: Sequence[Unknown],
    starts: Mapping[str, Sequence[float]],
) -> Iterator[Edge]:
    """Where the unknowns can lie: of those of an effect the ones of directions in which the log drives the machine.

    Args:
        task: data and model.
        found: a fit of the nominal model.
        effects: the effects.
        wanted: the unknowns.
        starts: ``component.parameter`` of an effect -> where searches for it begin, SI.
    """
    driven = {side for side in (-1.0, 1.0) if np.any(side * task.model.drive > 0.0)}
    extremes = reached(task, effects, found.values)
    of = {f"{e.component}.{p}": (e, free) for e in effects for p, free in e.free.items()}
    for u in wanted:
        if u.name not in of:
            assert u.prior is not None
            mean, spread = u.prior
            ends = (
                (mean / ROUGHLY, mean * ROUGHLY)
                if u.ratio
                else (mean - BETTER_KNOWN * spread, mean + BETTER_KNOWN * spread)
            )
            yield Edge(u.name, max(ends[0], u.low), min(ends[1], u.high), u.ratio)
            continue
        effect, free = of[u.name]
        side = float(np.sign(free.starts[0]))
        if side not in driven or (free.limits and u.name not in extremes):
            continue
        if not free.limits:
            nominal = task.model.nominal(u.name)
            away = WIDER * max(abs(s - nominal) for s in starts[u.name])
            yield Edge(u.name, max(nominal - away, u.low), min(nominal + away, u.high))
        elif measured_by(task, effect, free):
            extreme, inside = extremes[u.name]
            yield Edge(u.name, extreme + WIDER * (inside - extreme), extreme)
        elif side * (extreme := extremes[u.name][0]) > 0.0:  # what the model never opens has no end
            yield Edge(u.name, LEAST_OPENING * extreme, extreme, True)
