"""What an effect gains on windows that were not used to estimate it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fit import Task, fit
from cosim.diagnosis.trials import Trial, anchored, confined, unknowns
from fmus.contract import Effect

REFUTED = -2.0  # log-likelihood on held-out windows below which an effect is refuted by them


def held_windows(count: int) -> NDArray[np.bool_]:
    """Which windows are held out: every third, so that they visit every regime of the log."""
    return np.arange(count) % 3 == 2


def window_numbers(task: Task) -> NDArray[np.int64]:
    """The window to which each of a task's whitened values belongs."""
    shapes = [rule.windows(task.measured[s]).shape for s, rule in task.rules.items()]
    return np.concatenate([np.repeat(np.arange(count), bins) for count, bins in shapes])


def part(task: Task, mask: NDArray[np.bool_]) -> Task:
    """The task on some windows only; doubt from upstream counts in each part by itself."""
    found = replace(task, mask=mask)
    found.set_rules(task.rules)
    return found


def held_out_gain(task: Task, chosen: Trial, effect: Effect, tolerance: float) -> float:
    """Log-likelihood that an effect gains on held-out windows, all parameters estimated on the others.

    The alternative has all trusted parameters within their trust: beyond it they would need a cause themselves.

    Args:
        task: data, model and noise of the group.
        chosen: the accepted set, fitted on all windows.
        effect: one of its effects.
        tolerance: trust in the nominal parameters.
    """
    rule = next(iter(task.rules.values()))
    held = held_windows(rule.windows(next(iter(task.measured.values()))).shape[0])
    if not held.any() or held.all():
        return float("nan")
    fitting, judged = part(task, ~held), part(task, held)
    wanted, _ = unknowns(task.model, chosen.effects, tolerance)
    others, _ = unknowns(task.model, [e for e in chosen.effects if e != effect], tolerance)
    scores = []
    for unknown in (wanted, confined(others)):
        unknown = anchored(unknown, chosen.fit.values)
        white = judged.white(judged.residuals(fit(fitting, unknown).values))
        scores.append(-0.5 * float(white @ white))
    return scores[0] - scores[1]


def refuted(task: Task, chosen: Trial, tolerance: float) -> list[Effect]:
    """The effects of a set that make it predict held-out windows worse, the worst first."""
    gains = [(held_out_gain(task, chosen, e, tolerance), e) for e in chosen.effects]
    return [e for gain, e in sorted(gains, key=lambda item: item[0]) if gain < REFUTED]
