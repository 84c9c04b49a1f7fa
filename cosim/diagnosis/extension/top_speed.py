"""Speeds in which a model ends at lasting commands: what can be read off the machine.

Where nothing was measured between the command and the motion, and the numbers between them are fitted, a limit of the
spool and the gain behind it are one number: the log tells their product, the speed, and next to nothing of either.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.held_out.over_logs import over_logs
from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.record.grid import of_piece
from cosim.inference.between import Between
from fmus.contract import Effect, Free

Array = NDArray[np.float64]

STEPS_AT_FIRST = 2048  # steps of the first run; doubled until the speed has settled
STEPS_AT_MOST = 1 << 19
STEADY_TO = 1e-6
MOVED_BY = 1e-2  # of an estimate, by which it is moved for a slope


def top_speeds(
    model: GroupModel, effects: tuple[Effect, ...], found: Fit, repetitions: NDArray[np.int64] | None
) -> dict[str, Between]:
    """``component.parameter`` of each limit that was met -> the speed there, SI, as the sensor of the motion shows it.

    Args:
        model: the group, from the command to the motion.
        effects: the causes.
        found: their estimates.
        repetitions: (n,) number of the log or part to which each of its whitened values belongs; None where there are none.

    Returns:
        Nothing of a limit beyond which the speed does not stay, as of an axis that its weight or a spring brings back.
    """
    group = model.group
    if not (group.commanded and group.moves) or found.slopes is None:
        return {}
    names = list(found.values)[: found.covariance.shape[0]]
    if group.place:
        return rates_of_place(model, effects, found, names, repetitions)
    told = {}
    values = endless(group, effects, found.values)
    for name, free in limits_of(effects).items():
        if name not in names or name not in values:
            continue
        command = float(model.drive.max() if min(free.starts) > 0.0 else model.drive.min())
        speed = settled(model, command, values)
        slopes = None if speed is None else slopes_of(partial(settled, model, command), values, names, speed)
        if speed is None or slopes is None or slopes[names.index(name)] == 0.0:
            continue
        told[name] = between(in_place(found, name, speed, slopes), name, repetitions)
    return told


def rates_of_place(
    model: GroupModel,
    effects: tuple[Effect, ...],
    found: Fit,
    names: list[str],
    repetitions: NDArray[np.int64] | None,
) -> dict[str, Between]:
    """``component.parameter`` of each limit of the rate at which a drive lets its demanded place change -> that rate, SI.

    The demand within a drive that closes its own loop has no unit that anyone knows: the place where a lasting demand ends,
    over that demand, makes of its rate one of the place that is held. Where the other direction has a rate of its own, given
    as their ratio, that is told as well, by the name of the ratio.
    """
    told, gain = {}, "dcv.K"
    widest = float(max(model.drive.min(), model.drive.max(), key=abs))
    if widest == 0.0 or "dcv" not in model.group.components:
        return {}
    rates = [(e, f"{e.component}.{p}") for e in effects for p, free in e.free.items() if free.rate]
    for effect, limit in rates:
        ratio = f"{effect.component}.{effect.form_of_place}"

        def rate(values: dict[str, float], limit: str = limit, ratio: str = ratio) -> float | None:
            still = settled(model, widest, {n: v for n, v in values.items() if n not in (limit, ratio)})
            demand = values.get(gain, model.nominal(gain)) * widest
            return None if still is None else values[limit] * still / demand

        def back(values: dict[str, float], limit: str = limit, ratio: str = ratio) -> float | None:
            there = rate(values, limit, ratio)
            return None if there is None else -there * values[ratio]

        for name, of in ((limit, rate), (ratio, back)):
            if name not in names or limit not in names:
                continue
            values = endless(model.group, effects, found.values)
            values |= {n: found.values[n] for n in (limit, ratio) if n in found.values}
            speed = of(values)
            slopes = slopes_of(of, values, names, speed) if speed else None
            if speed is not None and slopes is not None and slopes[names.index(name)] != 0.0:
                told[name] = between(in_place(found, name, speed, slopes), name, repetitions)
    return told


def endless(group: Group, effects: tuple[Effect, ...], values: Mapping[str, float]) -> dict[str, float]:
    """Values without the ends of the travel, and of what a sensor reads: no speed lasts there."""
    blocks = [block for _, block in group.stages]
    before = group.components[: blocks.index(group.kind)]
    limits = limits_of(effects)
    return {n: v for n, v in values.items() if n not in limits or n.partition(".")[0] in before}


def static_speeds(
    model: GroupModel, effects: tuple[Effect, ...], values: Mapping[str, float], commands: Iterable[float]
) -> list[float] | None:
    """Speed in which each of several lasting commands ends, SI; None where one does not stay.

    Args:
        model: the group, from the command to the motion.
        effects: those that the values hold.
        values: ``component.parameter`` -> value.
        commands: in the unit of the model's drive; the widest first, which tells soonest that no speed stays.
    """
    lasting, found = endless(model.group, effects, values), list[float]()
    for command in commands:
        speed = settled(model, command, lasting, max(map(abs, found), default=0.0))
        if speed is None:
            return None
        found.append(speed)
    return found if any(found) else None  # held by its weight or a spring


def limits_of(effects: tuple[Effect, ...]) -> dict[str, Free]:
    """``component.parameter`` -> its declaration, of all that limit a signal and not its rate."""
    return {
        f"{e.component}.{p}": free
        for e in effects
        for p, free in e.free.items()
        if free.limits and not free.rate
    }


def settled(
    model: GroupModel, command: float, values: Mapping[str, float], most: float = 0.0
) -> float | None:
    """Speed in which a constant command ends, SI, to a share of itself or of `most`; None where it does not."""
    signal, count, fixed = model.group.observed[0], STEPS_AT_FIRST, of_piece(model.fixed, 0)
    while count <= STEPS_AT_MOST:
        run = GroupModel(model.group, np.full(count, command), model.step, fixed)
        series = run.simulate(of_piece(dict(values), 0))[signal]
        moved = series if model.group.is_speed(signal) else np.diff(series) / model.step
        quarters = [float(part.mean()) for part in np.array_split(moved, 4)[2:]]
        if abs(quarters[1] - quarters[0]) <= STEADY_TO * max(abs(quarters[1]), most):
            return quarters[1]
        count *= 2
    return None


def slopes_of(
    told: Callable[[dict[str, float]], float | None],
    values: dict[str, float],
    names: list[str],
    speed: float,
) -> Array | None:
    """(k,) slopes of the `speed` that values tell in the estimates `names`; None where with another it does not settle."""
    slopes = np.zeros(len(names))
    for i, name in enumerate(names):
        if name not in values or values[name] == 0.0:
            continue
        moved = told(values | {name: values[name] * (1.0 + MOVED_BY)})
        if moved is None or moved * speed <= 0.0:
            return None
        # by ratios: a speed is a product of gains and limits, whose errors all but cancel where only that is known
        slopes[i] = speed / values[name] * np.log(moved / speed) / np.log1p(MOVED_BY)
    return slopes


def in_place(found: Fit, name: str, speed: float, slopes: Array) -> Fit:
    """The same estimates with the speed in the place of the limit `name`, linear about them."""
    assert found.slopes is not None
    names = list(found.values)[: slopes.size]
    at, scales = names.index(name), np.array([found.scales[n] for n in names])
    own = found.slopes[:, at] / scales[at] / slopes[at]
    others = found.slopes - np.outer(own, slopes * scales)
    others[:, at] = own * abs(speed)
    change = np.eye(slopes.size)
    change[at] = slopes
    covariance = change @ found.covariance @ change.T
    return replace(
        found,
        values=found.values | {name: speed},
        deviations=found.deviations | {name: float(np.sqrt(max(covariance[at, at], 0.0)))},
        covariance=covariance,
        slopes=others,
        scales=found.scales | {name: abs(speed)},
        at_bound=tuple(n for n in found.at_bound if n != name),
    )


def between(found: Fit, name: str, repetitions: NDArray[np.int64] | None) -> Between:
    """An estimate over the logs, or by its own deviation where there is one only."""
    each = {} if repetitions is None else over_logs(found, repetitions, lambda _: 0.0)
    alone = Between(found.values[name], np.empty(0), np.empty(0), found.deviations[name] ** 2)
    return each.get(name, alone)
