"""Where the search for an effect's parameters begins: a least-squares search from afar often ends beside the best fit."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.fit import Fit, Task, Unknown, fit, placed
from cosim.diagnosis.thresholds import STRAINED_START

Array = NDArray[np.float64]
Values = dict[str, float]
# whether it is without effect, square of the whitened residual and of the priors' pulls, parameters
Begun = tuple[bool, float, Values]
Seen = tuple[Values, Array]  # parameters, and the whitened residual (n,) with them


@dataclass(frozen=True)
class Size:
    """What sets the size of an effect that is sought.

    Attributes:
        name: ``component.parameter``; the effect grows nearly in proportion to it.
        off: its value where the effect is off, SI.
        phase: ``component.parameter`` of the phase, where the effect is a sine of this amplitude.
    """

    name: str
    off: float
    phase: str = ""


def fit_from_starts(
    task: Task,
    unknowns: list[Unknown],
    starts: Mapping[str, tuple[float, ...]],
    keep: int = 2,
    rounds: int = 12,
    size: Size | None = None,
    slopes: Array | None = None,
    quick: bool = False,
    besides: Mapping[str, float] | None = None,
) -> Fit:
    """Best of the fits that begin at the `keep` most promising combinations of the starts.

    Parameters with a prior that an earlier fit has strained far off it, or to the end of their range, begin there and, in
    further combinations, at their prior: what strained them may be what this fit is to find, and an inertia next to nothing
    has no slope that would lead back.

    Args:
        task: data, model and noise.
        unknowns: what to estimate.
        starts: parameter -> where it begins, SI; the others begin at their own start.
        keep: number of combinations that are fitted.
        rounds: iterations at most of each fit.
        size: what is sought begins, too, with the size that explains most.
        slopes: (rows, k) of the fit without the effect: what its own parameters can take up is not the effect's.
        quick: as `fit` takes it.
        besides: parameters, SI, with which one combination more begins.
    """
    strained = {
        u.name: u.prior[0]
        for u in unknowns
        if u.prior
        and (
            abs(u.start - u.prior[0]) > STRAINED_START * u.prior[1]
            or np.isclose(u.start, (u.low, u.high)).any()
        )
    }
    hidden = None if size is None or slopes is None else np.linalg.qr(slopes)[0]
    kinds: list[list[Begun]] = []
    for straight in ({}, strained) if strained else ({},):
        trials: list[Begun] = []
        kinds.append(trials)
        # where a limit is out of reach nothing changes with it: a search cannot begin there
        off = task.white(task.residuals({u.name: u.start for u in unknowns} | straight))

        def white(values: Values, off: Array = off, trials: list[Begun] = trials) -> Array:
            """Whitened residual at `values`, which become a trial."""
            found = task.white(task.residuals(values))
            pull = sum(((values[u.name] - u.prior[0]) / u.prior[1]) ** 2 for u in unknowns if u.prior)
            trials.append((np.array_equal(found, off), float(found @ found) + pull, values))
            return found

        seen = [(v | straight, white(v | straight)) for v in combined(unknowns, starts)]
        if besides:
            known = {u.name: u.start for u in unknowns} | straight | dict(besides)
            white(bounded(known, unknowns))
        if size is not None:
            for same in differing_in_phase(seen, size):
                white(bounded(sized(same, size, off, hidden), unknowns))
    # the best of either kind: what bends a parameter is worth nothing at its prior until its size is right to the last digit
    best = (sorted(trials, key=lambda trial: trial[:2])[: max(1, keep // len(kinds))] for trials in kinds)
    begun = [placed(unknowns, values) for *_, values in itertools.chain.from_iterable(best)]
    found = [fit(task, one, rounds=rounds, quick=quick) for one in begun]
    return max(found, key=lambda one: one.log_likelihood)


def combined(unknowns: list[Unknown], starts: Mapping[str, tuple[float, ...]]) -> Iterator[Values]:
    """All combinations of the starts."""
    listed = [tuple(dict.fromkeys(starts.get(u.name, (u.start,)))) for u in unknowns]
    for combination in itertools.product(*listed):
        yield {u.name: float(v) for u, v in zip(unknowns, combination, strict=True)}


def differing_in_phase(seen: list[Seen], size: Size) -> list[list[Seen]]:
    """Combinations with the largest size, those that differ in the phase alone together."""
    largest = max((values[size.name] for values, _ in seen), key=lambda value: abs(value - size.off))
    groups: dict[tuple[float, ...], list[Seen]] = {}
    for values, white in seen:
        if values[size.name] == largest:
            others = tuple(v for n, v in values.items() if n != size.phase)
            groups.setdefault(others, []).append((values, white))
    return list(groups.values())


def sized(same: list[Seen], size: Size, off: Array, hidden: Array | None) -> Values:
    """The size (and the phase) that explains most of what is left without the effect.

    Args:
        same: combinations that differ in the phase alone: one, or two a quarter of a turn apart.
        size: what sets the size.
        off: (n,) whitened residual without the effect.
        hidden: (n or more, k) orthonormal: what the other parameters can take up; None for nothing.
    """
    columns = np.stack([white - off for _, white in same], axis=1)
    if hidden is not None:
        own = hidden[: off.size]  # below them stand the priors' rows
        columns = columns - own @ (own.T @ columns)
    share = np.linalg.lstsq(columns, -off, rcond=None)[0]
    values = dict(same[0][0])
    grown = values[size.name] - size.off
    values[size.name] = size.off + grown * float(np.hypot(*share) if share.size == 2 else share[0])
    if share.size == 2:
        values[size.phase] += float(np.arctan2(share[1], share[0]))
    return values


def bounded(values: Values, unknowns: list[Unknown]) -> Values:
    """Values within the bounds."""
    return {u.name: float(np.clip(values[u.name], u.low, u.high)) for u in unknowns}
