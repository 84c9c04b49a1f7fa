"""What an effect gains on windows that were not used to estimate it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.fit import Fit, Task
from cosim.diagnosis.fitting.noise import Whitener
from cosim.diagnosis.fitting.trials import Trial, without
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.thresholds import FOLDS
from cosim.inference.held_out import HeldOutGain, gain_between, left_out, steps_without
from cosim.inference.thresholds import HELD_EVERY
from fmus.contract import Effect

Array = NDArray[np.float64]


def held_windows(count: int) -> NDArray[np.bool_]:
    """Which windows are held out: every third, so that they visit every regime of the log."""
    return np.arange(count) % HELD_EVERY == HELD_EVERY - 1


def window_numbers(task: Task) -> NDArray[np.int64]:
    """The window to which each of a task's whitened values belongs."""
    shapes = [rule.windows(task.measured[s]).shape for s, rule in task.rules.items()]
    return np.concatenate([np.repeat(np.arange(count), bins) for count, bins in shapes])


def repetitions(task: Task, walked: bool = False) -> NDArray[np.int64]:
    """The part of the data to which each of a task's whitened values belongs, that is left out as one: a window, or a log.

    What a machine, its oil or what the model lacks change from log to log, the windows of one log have in common.

    Args:
        task: data of the group.
        walked: with the steps of the first signal's error from window to window behind (`freerun.Drifting`).
    """
    if not task.model.cuts:
        return window_numbers(task)
    return fold_numbers(task.rules, task.model.drive.size, walked)


def fold_of(rule: Whitener, count: int) -> NDArray[np.int64]:
    """(windows,) what each window of `count` samples is left out with: its log, or of one log a quarter of that."""
    log = rule.log_of(count)
    return log if rule.cuts else np.arange(log.size) * FOLDS // max(log.size, 1)


def fold_cuts(rule: Whitener, count: int) -> tuple[int, ...]:
    """First sample, of `count`, of each fold but the first."""
    if rule.cuts:
        return rule.cuts
    firsts, numbers = np.searchsorted(fold_of(rule, count), np.arange(1, FOLDS)), rule.layout.numbers(count)
    return tuple(int(np.argmax(numbers >= first)) for first in firsts)


def fold_numbers(
    rules: Mapping[str, Whitener], count: int, walked: bool = False, mask: NDArray[np.bool_] | None = None
) -> NDArray[np.int64]:
    """The fold (`fold_of`) to which each whitened value of signals of `count` samples belongs, from 0.

    Args:
        rules: signal -> whitening rule.
        count: samples of all logs.
        walked: as `repetitions`.
        mask: (windows,) windows that count, or None for all.
    """
    rows = []
    for rule in rules.values():
        fold = fold_of(rule, count)
        rows.append(np.repeat(fold if mask is None else fold[mask], rule.window))
    if walked:
        rule = next(iter(rules.values()))
        rows.append(fold_of(rule, count)[:-1][np.diff(rule.log_of(count)) == 0])
    return np.concatenate(rows)


def part(task: Task, mask: NDArray[np.bool_]) -> Task:
    """The task on some windows only; discrepancy from upstream counts in each part by itself."""
    found = replace(task, mask=mask)
    found.set_rules(task.rules)
    return found


def held_out_gain(task: Task, richer: Fit, poorer: Fit) -> HeldOutGain:
    """Log-likelihood that one fit gains over another on windows (of several logs: on logs) that had no share in it.

    What is trusted of the nominal values counts as well: a fit that bends them beyond that has its price.

    Args:
        task: data, model and noise of the group.
        richer: the fit with the effect.
        poorer: the fit without it.
    """
    block = repetitions(task)
    found = gain_between(left_out_rows(task, richer, block), left_out_rows(task, poorer, block), block)
    pulls = [0.5 * float(np.sum(rows_of(task, f)[block.size :] ** 2)) for f in (poorer, richer)]
    return replace(found, gain=found.gain + pulls[0] - pulls[1])


def rows_of(task: Task, found: Fit) -> Array:
    """Whitened residuals of a fit, then those of its priors."""
    return task.white(found.residuals) if found.rows is None else found.rows


def moving(found: Fit) -> tuple[list[str], Array]:
    """The estimates that the data move, and the slopes (rows, k) of whitened residuals and priors in them."""
    if found.slopes is None:
        return [], np.empty((0, 0))
    names = list(found.values)[: found.slopes.shape[1]]
    kept = [i for i, n in enumerate(names) if n not in found.at_bound and np.any(found.slopes[:, i])]
    return [names[i] for i in kept], found.slopes[:, kept]


def left_out_rows(task: Task, found: Fit, block: NDArray[np.int64]) -> Array:
    """Whitened residuals of each window with the estimate that the others give."""
    rows, (names, slopes) = rows_of(task, found), moving(found)
    return left_out(rows, slopes if names else np.empty((rows.size, 0)), block)


def left_out_steps(task: Task, found: Fit) -> tuple[list[str], Array]:
    """Estimates, and (windows, k) what leaving out each window changes of them, SI."""
    block = window_numbers(task)
    names, slopes = moving(found)
    if not names:
        return [], np.empty((int(block.max(initial=-1)) + 1, 0))
    scales = np.array([found.scales[n] for n in names])
    return names, steps_without(rows_of(task, found), slopes, block) * scales


def refuted(task: Task, chosen: Trial, null: Trial, tolerance: float) -> list[Effect]:
    """The effects of a set whose gain on held-out windows (logs) may be nothing, the worst first."""
    gains = [
        (held_out_gain(task, chosen.fit, without(task, chosen, e, null, tolerance).fit), e)
        for e in chosen.effects
        if e.name not in SAMPLED
    ]
    return [e for gain, e in sorted(gains, key=lambda item: item[0].ci95[0]) if not gain.sure]
