"""From the end of the search to parameters with intervals, and to words where there is none."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.calibrate.determined import check, covariance
from cosim.calibrate.free import Free
from cosim.calibrate.outcome import Parameter
from cosim.calibrate.problem import Problem, Unknown
from cosim.calibrate.search import Found

Array = NDArray[np.float64]
NORMAL = 1.959964  # 95 % of a normal distribution lie within so many standard deviations
AT_BOUND = 1e-9  # relative
BY_PRIOR = 0.9  # of the prior's standard deviation: the log has added nothing to speak of


def at_bound(unknown: Unknown, z: float) -> str | None:
    """Which bound an estimate (in sizes) lies on, "lower" or "upper"; None where on neither."""
    value = z * unknown.size
    near = AT_BOUND * max(abs(value), unknown.size)
    if value - unknown.low <= near:
        return "lower"
    return "upper" if unknown.high - value <= near else None


def estimates(
    problem: Problem, found: Found, unseen: Mapping[str, float]
) -> tuple[list[Parameter], Array, list[str]]:
    """Parameters in the order in which they were named, their covariance (FMU's units, NaN where there is none), notes.

    Args:
        problem: what was fitted.
        found: where the search ended.
        unseen: parameters that the log does not determine, with their deviation in sizes.
    """
    unknowns = problem.unknowns
    active = [i for i, u in enumerate(unknowns) if at_bound(u, found.z[i]) is None]
    spread = covariance(found.jacobian, active)
    lengths = [problem.places[n].size for n in problem.signals]
    checked = check(found.jacobian, found.row, lengths, spread, active)
    factor = np.outer(checked.inflation, checked.inflation)
    sizes = np.array([u.size for u in unknowns])
    spread = spread * factor * np.outer(sizes, sizes)
    place = {u.name: i for i, u in enumerate(unknowns)}
    parameters = [_parameter(f, problem, found, spread, place, unseen) for f in problem.free]
    told = [p.name for p in parameters if p.deviation is not None]
    wider = [n for n in told if checked.inflation[place[n]] > 1.0]
    notes = []
    if wider:
        most = max(checked.inflation[place[n]] for n in wider)
        notes.append(
            f"parts of the log disagree about {', '.join(wider)} by more than its noise: their intervals were widened, "
            f"up to {most:.2g} times"
        )
    full = np.full((len(parameters),) * 2, np.nan)
    rows = [i for i, p in enumerate(parameters) if p.deviation is not None]
    inner = [place[parameters[i].name] for i in rows]
    full[np.ix_(rows, rows)] = spread[np.ix_(inner, inner)]
    return parameters, full, notes


def _parameter(
    f: Free,
    problem: Problem,
    found: Found,
    spread: Array,
    place: Mapping[str, int],
    unseen: Mapping[str, float],
) -> Parameter:
    value, deviation, bound = f.start, None, None
    if f.name in place:
        i = place[f.name]
        value = float(found.z[i] * f.size)
        bound = at_bound(problem.unknowns[i], found.z[i])
        value = f.low if bound == "lower" else f.high if bound == "upper" else value
        if bound is None and f.name not in unseen:
            deviation = float(np.sqrt(spread[i, i]))
    interval = None
    if deviation is not None:
        reach = NORMAL * deviation
        interval = (max(value - reach, f.low), min(value + reach, f.high))
    remark = ""
    if f.name in problem.fixed:
        remark = "not determined by this log: kept at its start"
    elif f.name in unseen:
        remark = "not determined by this log: holds only with the values that were kept"
    elif bound is not None:
        remark = f"at its {bound} bound: the log would take it further"
    elif f.prior is not None and deviation is not None and deviation > BY_PRIOR * f.prior[1]:
        remark = "from its prior: the log adds little"
    return Parameter(
        f.name,
        f.unit,
        f.start,
        f.low,
        f.high,
        f.prior,
        value,
        deviation,
        interval,
        f.name not in unseen,
        bound,
        remark,
        f.display,
    )
