"""A limit of the rate of a drive that holds a demanded place: where the search for it begins.

A linear model takes such a drive for a slow one. From its lag no slope leads to the limit: the demand in that model moves
slowly as well. So the search begins, too, with a drive that follows at once, and moves each way as fast as it was seen to.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.fit import Task
from cosim.inference.pieces import slope
from fmus.contract import Effect

Array = NDArray[np.float64]

HARDLY_LATE = 0.05  # times the inertia that the model is said to have
SEEN = 0.97  # quantile of the speeds of a direction: as fast as the drive moves for some time
CROSSED = 0.1  # of the time in which the fastest samples would cross the travel: over that a speed is seen


def paced(task: Task, effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """The limit in each direction as the place was seen to move, and a drive without lag; nothing for other effects.

    Args:
        task: data and model of a group.
        effect: what is sought.
        values: ``component.parameter`` -> SI of what is known.
    """
    model, group = task.model, task.model.group
    limits = [p for p, free in effect.free.items() if free.rate]
    place = next(iter(task.measured), "")
    inertia = next((f"{c}.J" for c, block in group.stages if block == "mechanical"), "")
    if not (group.place and limits and place and inertia):
        return {}
    fast = {n: model.nominal(n) for n in values if n in group.trusted}
    fast[inertia] = HARDLY_LATE * model.nominal(inertia)
    demand = float(np.max(np.abs(model.drive)))
    reach = float(np.max(np.abs(model.simulate(fast)[place])))
    if not (demand > 0.0 and reach > 0.0):
        return {}
    to_place = reach / (model.nominal(f"{effect.component}.K") * demand)
    there, back = seen_speeds(task.measured[place], model.h, model.cuts)
    if not (there > 0.0 and back > 0.0):
        return {}
    both = {effect.form_of_place: back / there} if effect.form_of_place in effect.free else {}
    return fast | {f"{effect.component}.{n}": v for n, v in {limits[0]: there / to_place, **both}.items()}


def seen_speeds(place: Array, h: float, cuts: tuple[int, ...]) -> tuple[float, float]:
    """How fast a place (n,) moves up and down for some time, per s, both as magnitudes; its pieces begin at the cuts."""
    quick = np.quantile(np.abs(slope(place, h, cuts)), SEEN)
    if not quick > 0.0:
        return 0.0, 0.0
    logs = np.split(place, list(cuts))
    far = max(1, round(CROSSED * max(float(np.ptp(log)) for log in logs) / (quick * h)))
    pieces = [log for log in logs if log.size > far]
    speed = np.concatenate([(p[far:] - p[:-far]) / (far * h) for p in pieces]) if pieces else np.zeros(1)
    return lasting(speed), lasting(-speed)


def lasting(speed: Array) -> float:
    """As fast as the positive ones of some speeds are for some time; 0 where there are none."""
    forwards = speed[speed > 0.0]
    return float(np.quantile(forwards, SEEN)) if forwards.size else 0.0
