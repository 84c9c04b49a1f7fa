"""Causes that would explain the log only with a parameter beyond what it can physically be: another law, then.

A gear ripple with three periods a turn is no gear ripple, yet over a short range of angles it is shaped as gravity is.
"""

import math
from collections.abc import Mapping

import numpy as np

from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.trials import Trial, declared
from cosim.diagnosis.thresholds import PRESSED_GAIN, RANGE_EDGE
from fmus.contract import Effect


def impossible(trial: Trial, model: GroupModel) -> list[Effect]:
    """The effects of a fitted set that the data press against a bound of one of their parameters."""
    return [e for e in trial.effects if beyond(trial, e, model) > PRESSED_GAIN]


def beyond(trial: Trial, effect: Effect, model: GroupModel) -> float:
    """Log-likelihood to be gained beyond the bounds of an effect's parameters, by a straight line from the fit.

    A bound that is the off value does not count: there the effect ends.
    """
    found, names = trial.fit, list(trial.fit.values)
    most = 0.0
    if found.slopes is None or found.rows is None:
        return most
    for parameter in effect.free:
        name = f"{effect.component}.{parameter}"
        if name not in found.at_bound or names.index(name) >= found.slopes.shape[1]:
            continue
        value = found.values[name]
        lows, highs = edges(effect, parameter, model)
        lows += least(effect, parameter, found.values)
        bound = min((*lows, *highs), key=lambda edge: abs(edge - value))
        if bound == model.nominal(name):
            continue
        at = names.index(name)
        others = np.linalg.qr(np.delete(found.slopes, at, axis=1))[0]
        own = found.slopes[:, at] - others @ (others.T @ found.slopes[:, at])
        pull, size = -float(own @ found.rows), float(own @ own)
        outward = pull > 0.0 if bound in highs else pull < 0.0
        if outward and size > 0.0:
            most = max(most, 0.5 * pull**2 / size)
    return most


def least(effect: Effect, parameter: str, values: Mapping[str, float]) -> list[float]:
    """What a size must at least be beside those that cannot be more than so many times it, SI."""
    shares = {
        p: free.within[1] for p, free in effect.free.items() if free.within and free.within[0] == parameter
    }
    return [values[f"{effect.component}.{p}"] / ratio for p, ratio in shares.items()]


def edges(effect: Effect, parameter: str, model: GroupModel) -> tuple[list[float], list[float]]:
    """Where an estimate may have ended, low and high, SI: its declaration, its physical range, the trust in it."""
    variable, name = declared(effect, parameter), f"{effect.component}.{parameter}"
    found = [(variable.low, variable.high)]
    if parameter in effect.ranges:
        found.append(effect.ranges[parameter].edges(model.nominal(name)))
    if name in model.group.trusted:
        found += [model.trust(name, tolerance)[1:] for tolerance in (1.0, np.inf)]
    lows, highs = zip(*found, strict=True)
    return list(lows), list(highs)


def absurd(
    effect: Effect,
    values: Mapping[str, float],
    nominal: Mapping[str, float],
    torque: float = math.nan,
    travel: float = math.nan,
) -> bool:
    """True if a parameter lies beyond its physical range, or at an edge of it that is not its off value.

    So is a size at the end of its declaration: the search was stopped there, and where it would have ended nobody knows. And
    one that is as many times another as it can be at most: friction that all but ends in motion is a dead band.

    Args:
        effect: the effect.
        values: its parameters -> estimate, SI.
        nominal: the same -> value before anything was estimated, SI.
        torque: greatest torque of the drive, N m; NaN where it is not known: nothing is held against it then.
        travel: of the spool at full command, m; likewise.
    """
    for parameter, allowed in effect.ranges.items():
        if parameter not in values or parameter not in nominal:
            continue
        value, off = values[parameter], nominal[parameter]
        low, high = allowed.edges(off, torque, travel)
        near = RANGE_EDGE * (high - low)
        if value < low - near or value > high + near:
            return True
        if (value < low + near and off != low) or (value > high - near and off != high):
            return True
    if effect.key in effect.free and effect.key in values:
        variable, size = declared(effect, effect.key), values[effect.key]
        near = RANGE_EDGE * effect.free[effect.key].scale
        # nothing at all is an end by nature
        ends = {variable.low, variable.high} - {0.0, nominal.get(effect.key)}
        if any(abs(size - end) < near for end in ends):
            return True
    shares = {p: free.within for p, free in effect.free.items() if free.within is not None and p in values}
    return any(
        other in values and 0.0 < (1.0 - RANGE_EDGE) * ratio * values[other] < values[p]
        for p, (other, ratio) in shares.items()
    )


def cannot_be(effect: Effect, sizes: Mapping[str, float], model: GroupModel, torque: float) -> bool:
    """True if a fit gives an effect a size that is `absurd` beside what the group's model has before anything was estimated.

    Args:
        effect: the effect.
        sizes: its parameters -> estimate, SI.
        model: the group over the log.
        torque: its `greatest_torque`.
    """
    nominal = {parameter: model.nominal(f"{effect.component}.{parameter}") for parameter in sizes}
    travel = model.nominal("dcv.K") if "dcv" in model.group.components else math.nan
    return absurd(effect, sizes, nominal, torque, travel)


def greatest_torque(model: GroupModel, values: Mapping[str, float]) -> float:
    """The greatest torque with which a log drives a group's mechanics, N m; NaN where the group has none.

    Args:
        model: the group over the log.
        values: ``component.parameter`` -> SI that differs from what the model has.
    """
    stages = [component for component, _ in model.stages]
    if "mechanical" not in stages:
        return math.nan
    at = stages.index("mechanical")
    pressure = model.drive if at == 0 else model.inside(stages[at - 1], "p_load", dict(values))
    if pressure is None:
        return math.nan
    lever = [values.get(n, model.nominal(n)) for n in ("mechanical.A", "mechanical.r")]
    return float(np.max(np.abs(pressure))) * lever[0] * lever[1]
