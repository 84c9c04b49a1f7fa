"""Handing on what was found upstream: a group is driven by what the blocks before it are known to deliver.

A measured pressure carries noise that the mechanics integrate into a drift. Where the blocks before a group are
understood, their simulated output drives it instead, and what is not known exactly of them (the covariance of their
estimates) counts as noise in the group behind.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.noise import plain
from cosim.diagnosis.fitting.trials import Trial, tried
from cosim.diagnosis.model.groups import Group
from cosim.diagnosis.record.grid import window_span
from cosim.diagnosis.record.record import Record, fixed_values
from cosim.diagnosis.record.signatures import coarse_steps
from cosim.diagnosis.thresholds import (
    BIN,
    FEWEST_WINDOWS,
    SKEW,
    SKEW_INTERVAL,
    UNSETTLED,
    UNSETTLED_SHARE,
)
from fmus.contract import Effect

Array = NDArray[np.float64]
SUPPLY = "p_supply"  # output of the hydraulics


@dataclass
class Known:
    """A group that is understood.

    Attributes:
        model: its model.
        fit: what was estimated.
        named: its causes.
        price: free parameters of its causes beyond those of the nominal model.
        others: every single effect as it was tried, or what can hardly be told from its causes.
        lacking: (n,) what its laws lack, as far as that is known, in its first signal, SI; None for nothing.
        discrepancies: (n,) changes of that signal one standard deviation along each discrepancy of its laws.
    """

    model: GroupModel
    fit: Fit
    named: tuple[Effect, ...] = ()
    price: int = 0
    others: list[Trial] = field(default_factory=list)
    lacking: Array | None = None
    discrepancies: list[Array] = field(default_factory=list)


def directions(fit: Fit) -> list[dict[str, float]]:
    """Values of the estimates one standard deviation along each principal direction of their uncertainty."""
    spread = np.diag(fit.covariance) > 0.0  # of a stop that is never met the data say nothing
    # signatures in the samples have no covariance
    names = [n for n, live in zip(fit.values, spread, strict=False) if live]
    if not names:
        return []
    covariance = fit.covariance[np.ix_(spread, spread)]
    sizes = np.sqrt(np.diag(covariance))
    # rounding alone may leave more than one
    values, vectors = np.linalg.eigh(np.clip(covariance / np.outer(sizes, sizes), -1.0, 1.0))
    moves = (vectors * np.sqrt(np.maximum(values, 0.0))).T * sizes
    return [{n: fit.values[n] + m for n, m in zip(names, move.tolist(), strict=True)} for move in moves]


def in_any_form(task: Task, chosen: Trial, tolerance: float) -> Fit:
    """Estimates of a chosen set with the form of a law free that has several: what the log leaves open of it is discrepancy.

    That a leak turns turbulent may hide in the pressure's noise, and yet push the column by what its simplest law lacks.
    """
    for effect in chosen.effects:
        for parameter in effect.forms if not effect.is_formed else ():
            others = tuple(e for e in chosen.effects if e != effect)
            chosen = max(
                chosen,
                tried(task, (*others, effect.formed(parameter)), tolerance, chosen.fit),
                key=lambda t: t.fit.log_likelihood,
            )
    return chosen.fit


def delivered(known: list[Known], record: Record) -> tuple[Array, list[Array]]:
    """Drive of the next group from the groups before it, in order; and the drive one deviation along each discrepancy."""

    def run(values: list[dict[str, float]], at: int = 0, change: Array | None = None) -> Array:
        signal = record.signals[known[0].model.group.drive]
        for i, (item, estimate) in enumerate(zip(known, values, strict=True)):
            model = GroupModel(item.model.group, signal, record.h, item.model.fixed, record.grid)
            signal = model.simulate(estimate)[item.model.group.observed[0]]
            for more in (item.lacking, change if i == at else None):
                signal = signal if more is None else signal + more
        return signal

    best = [item.fit.values for item in known]
    moved = []
    for i, item in enumerate(known):
        moved += [run([*best[:i], values, *best[i + 1 :]]) for values in directions(item.fit)]
        moved += [run(best, i, change) for change in item.discrepancies]
    return run(best), moved


def observed_of(group: Group, record: Record) -> tuple[dict[str, Array], dict[str, NDArray[np.bool_]]]:
    """The measured signals of a group, signal -> (n,) SI, and which samples of each are no readings: missing or stale."""
    measured = {s: record.signals[s] for s in group.observed if s in record.signals}
    missing = {s: record.filled[s] for s in measured if s in record.filled}
    if group.reading not in measured or all(e.name != "sensor.dropout" for e in group.effects()):
        return measured, missing
    lost = record.lost(group.reading)
    if not lost.any():
        return measured, missing
    fresh = record.fresh(group.reading)
    lost = lost | missing.get(group.reading, False)
    return measured | {group.reading: fresh}, missing | {group.reading: lost}


def window_of(lengths: list[int], bins: int, h: float) -> int:
    """Bins in a window of about `window_span` with which whole windows leave out least of logs of these many samples.

    Each log has a window: one that is longer than a log would leave it out, and nothing would be known of its noise.
    """
    # of one short log the windows are shorter: some must be left out to tell chance from more
    least = FEWEST_WINDOWS if len(lengths) == 1 else 1
    # whole windows fill that log
    choices = [max(1, own // (bins * max(least, round(own * h / window_span(h))))) for own in lengths]
    fitting = [window for window in choices if bins * window <= min(lengths)] or [1]
    return min(fitting, key=lambda window: sum(own % (bins * window) for own in lengths))


def task_for(group: Group, record: Record, known: list[Known]) -> Task:
    """The task of one group, driven by what `known` groups deliver, or by its measured drive if there are none."""
    fixed = fixed_values(record, group)
    drive, moved = delivered(known, record) if known else (record.signals[group.drive], [])
    model = GroupModel(group, drive, record.h, fixed, record.grid)
    observed = [s for s in group.observed if s in record.signals]
    bins = max(1, round(BIN / record.h))
    shortest = min(piece.time.size for piece in record.pieces)
    skip = min(round(UNSETTLED / record.h), int(UNSETTLED_SHARE * shortest))
    window = window_of([piece.time.size - skip for piece in record.pieces], bins, record.h)
    # only a shift of the valve's neutral shows as a constant; elsewhere one is no news and may be slow noise
    # and the supply of orifices, whose pressure without flow sets what they pass
    absolute = {
        s: group.level_counts or (group.loop is not None and group.output_of(s) == SUPPLY) for s in observed
    }
    rules = {s: plain(bins, window, not absolute[s], skip, record.cuts) for s in observed}
    measured, lost = observed_of(group, record)
    task = Task(model, measured, rules, steps=coarse_steps(measured, record.cuts), lost=lost)
    # signals of one log are in step to a part of a sample only: converters take turns, a simulator advances block by block;
    # the first row is the timing's place
    task.late = SKEW * min(record.h, SKEW_INTERVAL) * float(np.sqrt(len(known) + 1))
    base = model.simulate({})
    others = [GroupModel(group, signal, record.h, fixed, record.grid).simulate({}) for signal in moved]
    task.discrepancy = {s: np.stack([base[s], *(o[s] - base[s] for o in others)]) for s in observed}
    task.retime({s: base[s] for s in observed}, record.time)
    return task
