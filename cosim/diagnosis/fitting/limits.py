"""Limits of a signal or of its rate: where to look for them, and whether the log ever came near them."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from cosim.compare.metrics import noise_floor
from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.thresholds import GIVES_WAY, PASSED_BY_CHANCE, UNSEEN_LIMIT
from cosim.inference.pieces import Cuts
from fmus.contract import Effect, Free

Array = NDArray[np.float64]

MET = (1.0, 0.99)  # of the extreme of what was measured: there or just below it a limit that was met lies
ANGLES = ("theta", "slew")  # outputs whose zero is arbitrary
PREDICTED = (0.99, 0.95)  # the same of what the model predicts without the limit


class Passed(NamedTuple):
    """A limit that readings pass.

    Attributes:
        signal: what was measured.
        limit, reading: where the fit has it, and the farthest reading, SI; of a rate limit, rates.
        rate: it limits the signal's rate.
        name: ``component.parameter`` of it.
    """

    signal: str
    limit: float
    reading: float
    rate: bool
    name: str = ""


def reached(
    task: Task, effects: Iterable[Effect], values: Mapping[str, float] | None
) -> dict[str, tuple[float, ...]]:
    """``component.parameter`` of a limit -> the extreme of what it limits (a signal, its rate), and a little less, SI.

    A signal that was not measured is the one that the model predicts within the group, if it is to be trusted.

    Args:
        task: data, model and noise.
        effects: the effects.
        values: ``component.parameter`` -> SI as far as known; None where not even its order of magnitude is.
    """
    found: dict[str, tuple[float, ...]] = {}
    for effect in effects:
        for parameter, free in effect.free.items():
            rows = limited(task, effect, free, values)
            if rows is not None:
                extreme = float(rows.max() if free.starts[0] > 0.0 else rows.min())
                shares = MET if measured_by(task, effect, free) else PREDICTED
                # an angle's zero is nowhere in particular: less is less of its range
                reach = extreme
                if free.limits in ANGLES:
                    reach = float(np.copysign(0.5 * np.ptp(rows), free.starts[0]))
                found[f"{effect.component}.{parameter}"] = tuple(extreme - (1.0 - s) * reach for s in shares)
    return found


def measured_by(task: Task, effect: Effect, free: Free) -> str:
    """The measured signal that shows what a parameter limits; empty where none does."""
    signal = task.model.group.shows(effect.component, free.limits) if free.limits else ""
    return signal if signal in task.measured else ""


def passed(
    task: Task, effect: Effect, found: Fit, readings: Mapping[str, Array], cuts: Cuts = ()
) -> list[Passed]:
    """Limits that readings pass, those of the fitted data or of others: there is none where the fit has it.

    A stop gives way by a small part of the travel, and logs end at places a little apart (`GIVES_WAY`); noise carries a
    reading beyond it by chance (`PASSED_BY_CHANCE`).

    Args:
        task: the fitted data.
        effect: the effect.
        found: a fit with it.
        readings: name -> (n,) of the other data, SI.
        cuts: first sample of each log but the first of them.
    """
    beyond: list[Passed] = []
    for parameter, free in effect.free.items():
        signal, name = measured_by(task, effect, free), f"{effect.component}.{parameter}"
        if signal not in readings or name not in found.values:
            continue
        own, rule = limited(task, effect, free, found.values), task.rules[signal]
        other, interval = replace(rule, skip=0, cuts=cuts).windows(readings[signal]), rule.bins * task.model.h
        if free.rate:
            other = np.abs(np.diff(other, axis=1)) / interval
        if own is None or not other.size:
            continue
        side, limit = np.copysign(1.0, free.starts[0]), found.values[name]
        fitted, farthest = float(np.max(side * own)), float(np.max(side * other))
        given_way = max(0.0, fitted - side * limit)
        past = max(given_way, farthest - side * limit - given_way) - GIVES_WAY * float(np.ptp(own))
        if past <= 0.0:  # so are most: the noise need not be known
            continue
        noise = noise_floor(readings[signal], task.model.h, cuts) * (
            np.sqrt(2.0) / interval if free.rate else 1.0
        )
        if past > noise * norm.isf(PASSED_BY_CHANCE / other.size):
            beyond.append(Passed(signal, float(limit), float(side * max(fitted, farthest)), free.rate, name))
    return beyond


def passed_in_fit(task: Task, effects: Iterable[Effect], found: Fit) -> dict[str, float]:
    """``component.parameter`` of limits that the fitted readings themselves pass -> their nominal value, SI."""
    return {
        beyond.name: task.model.nominal(beyond.name)
        for effect in effects
        for beyond in passed(task, effect, found, task.measured, task.model.cuts)
    }


def unmet(task: Task, effect: Effect, found: Fit) -> bool:
    """True if the model ends at limits of an effect that no reading comes near: what holds a machine shows where it does.

    Only a prediction that goes too far meets such a limit.

    Args:
        task: the fitted data.
        effect: the effect.
        found: a fit with it.
    """
    near: list[bool] = []
    for parameter, free in effect.free.items():
        name = f"{effect.component}.{parameter}"
        if free.rate or name not in found.values or not measured_by(task, effect, free):
            continue
        if found.values[name] == task.model.nominal(name):
            continue
        own = limited(task, effect, free, found.values)
        if own is not None:
            side = np.copysign(1.0, free.starts[0])
            short = side * found.values[name] - float(np.max(side * own))
            near.append(bool(short <= GIVES_WAY * float(np.ptp(own))))
    return bool(near) and not any(near)


def limited(task: Task, effect: Effect, free: Free, values: Mapping[str, float] | None) -> Array | None:
    """(rows, samples) what a parameter limits: a signal or the size of its rate, SI; None where it limits nothing known."""
    cuts: tuple[int, ...] = ()
    if signal := measured_by(task, effect, free):
        rule = task.rules[signal]
        rows, interval = rule.windows(task.measured[signal]), rule.bins * task.model.h
    elif free.limits and values is not None:
        inside = task.model.inside(effect.component, free.limits, unlimited(task, effect, values))
        if inside is None:
            return None
        rows, interval, cuts = inside[None, :], task.model.step, task.model.step_cuts
    else:
        return None
    if not free.rate:
        return rows
    steps = np.abs(np.diff(rows, axis=1)) / interval
    # from one log to the next nothing moves
    return np.delete(steps, [k - 1 for k in cuts], axis=1) if cuts else steps


def unlimited(task: Task, effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """The values with the limits of an effect at their nominal ones, SI."""
    return dict(values) | {
        n: task.model.nominal(n) for p in effect.free if (n := f"{effect.component}.{p}") in values
    }


def idle(found: Fit, name: str) -> bool:
    """True if a parameter changes nothing of what a fit predicts."""
    names = list(found.values)
    if found.slopes is None or name not in names[: found.slopes.shape[1]]:
        return False
    return not found.slopes[: found.count, names.index(name)].any()


def out_of_reach(task: Task, effects: Iterable[Effect], found: Fit, trusted: bool = True) -> Fit:
    """The fit with limits that the signal does not meet at their nominal value: the data say nothing of them.

    A limit that ended just where the signal has its extreme is one of them: beyond it everything explains as much, so
    its interval goes from that extreme over the nominal value; `trusted` is as the values of `reached`.
    """
    if found.slopes is None:
        return found
    nominal: dict[str, float] = {}
    pulls = -found.log_likelihood - 0.5 * float(np.sum(task.white(found.residuals) ** 2))
    for effect in effects:
        for name in (f"{effect.component}.{p}" for p, free in effect.free.items() if free.limits):
            if name not in found.values:
                continue
            away = {name: task.model.nominal(name)}
            white = task.white(task.residuals(found.values | nominal | away))
            if -0.5 * float(white @ white) - pulls > found.log_likelihood - UNSEEN_LIMIT:
                nominal |= away
    extremes = reached(task, effects, found.values if trusted else None) if nominal else {}
    spread = {n: abs(v - extremes[n][0]) / 1.96 for n, v in nominal.items() if n in extremes}
    return replace(found, values=found.values | nominal, deviations=found.deviations | spread)
