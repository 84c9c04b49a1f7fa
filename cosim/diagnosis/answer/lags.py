"""A pressure that rises and falls with lags of their own, as that of a vessel that a pump fills and a leak empties.

No block has two lags, so nothing is named: but the two are what a person reads off such a log first.

    T dp/dt + p = p_end,    T that of rising where p_end > p, else that of falling
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.thresholds import AS_WELL, TWO_LAGS
from cosim.diagnosis.verdict.verdict import Rest, what_stands
from cosim.inference.pieces import slope
from cosim.lexicon import current

Array = NDArray[np.float64]

LAG_SAMPLES = 3000  # at most, that are fitted
LAG_SPAN = 1e3  # how many times longer or shorter than the lag for both a lag may be


def two_lags(diagnosis: Diagnosis, rest: Rest) -> str:
    """The lags with which a pressure rises and falls, where a missing opening depends on how fast it changes; else empty."""
    finding, record = diagnosis.findings.get(rest.block), diagnosis.record
    if finding is None or not rest.what.startswith(f"a missing opening that depends on {rest.signal}_rate "):
        return ""
    model, fit = finding.task.model, what_stands(finding).fit
    T = fit.values.get(model.group.linear[1], model.nominal(model.group.linear[1]))
    reading = finding.task.measured[rest.signal]
    predicted = reading - fit.residuals[rest.signal]
    end = predicted + T * slope(predicted, record.time, record.cuts)
    one, errs = fitted(record, reading, end, T, ways=1)
    (up, down), errs_less = fitted(record, reading, end, one[0], ways=2)
    if max(up, down) < TWO_LAGS * min(up, down) or errs < AS_WELL * errs_less:
        return ""
    unit, scale = current().signal(rest.signal)
    return (
        f"{rest.signal} rises with a lag of {up:.2g} s and falls with one of {down:.2g} s, as what is filled and emptied by "
        f"different ways does: one lag for both leaves {errs * scale:.2g} {unit}, two would leave {errs_less * scale:.2g}"
    )


def fitted(record: Record, reading: Array, end: Array, near: float, ways: int) -> tuple[list[float], float]:
    """Lags that describe a reading best, s, and the RMSE of its free run with them.

    Args:
        record: its time and cuts.
        reading: (n,) of the pressure.
        end: (n,) where it would end, up to a scale and an offset, which are fitted as well.
        near: where the search for the lags begins, s.
        ways: 1 for one lag, 2 for one of each direction.
    """
    apart = math.ceil(reading.size / LAG_SAMPLES)
    size, level = max(float(np.ptp(reading)), 1e-300), float(np.mean(reading))
    pieces = [
        (t[::apart], (y[::apart] - level) / size, (e[::apart] - level) / size)
        for t, y, e in zip(*(np.split(row, record.cuts) for row in (record.time, reading, end)), strict=True)
    ]

    def lags(x: Array) -> list[float]:
        return [near * math.exp(v) for v in x[2:]]

    def errors(x: Array) -> Array:
        up, *other = lags(x)
        down = other[0] if other else up
        return np.concatenate([run(t, y[0], x[0] * e + x[1], up, down) - y for t, y, e in pieces])

    reach = math.log(LAG_SPAN)
    bounds = ([0.0, -np.inf, *[-reach] * ways], [np.inf, np.inf, *[reach] * ways])
    best = least_squares(errors, [1.0, 0.0, *[0.0] * ways], bounds=bounds)
    return lags(best.x), size * float(np.sqrt(np.mean(best.fun**2)))


def run(time: Array, begin: float, end: Array, up: float, down: float) -> Array:
    """(n,) reading that goes towards `end` (n,), held over each interval, with these lags."""
    found = [begin]
    for step, to in zip(np.diff(time).tolist(), end.tolist(), strict=False):
        at = found[-1]
        found.append(to + (at - to) * math.exp(-step / (up if to > at else down)))
    return np.array(found)
