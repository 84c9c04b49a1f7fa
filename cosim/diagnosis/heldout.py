"""Causes tried on data that took no part in naming them: another log of the machine, or the rest of this one.

A cause that the fitting log asks for but that does not make the prediction of the held-out data better is refused: it
has described that one log and not the machine.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.chain import fixed_values
from cosim.diagnosis.data import Record
from cosim.diagnosis.fit import Fit
from cosim.diagnosis.groups import GroupModel
from cosim.diagnosis.naming import Finding, leftovers, local_tests, rivals, tried
from cosim.diagnosis.samples import SAMPLED
from fmus.contract import Effect

Array = NDArray[np.float64]

WORTH = 0.01  # of the error on held-out data that a cause must take away


@dataclass(frozen=True)
class Held:
    """Held-out data.

    Attributes:
        record: the log, from its start.
        first: sample from which errors count.
        name: of the log.
        sha256: of its file.
    """

    record: Record
    first: int
    name: str = ""
    sha256: str = ""


@dataclass(frozen=True)
class Refused:
    """A cause that held-out data do not bear out.

    Attributes:
        effect: the effect.
        group: where it was named.
        signal: what was compared.
        gain: log-likelihood that it gains in the fitting log.
        without, with_it: RMSE on held-out data, SI.
    """

    effect: Effect
    group: str
    signal: str
    gain: float
    without: float
    with_it: float


def errors(finding: Finding, fit: Fit, held: Held) -> dict[str, float]:
    """RMSE of the group's signals on held-out data, driven by its measured drive, with a fit's values, SI."""
    model, record = finding.task.model, held.record
    if model.group.drive not in record.signals:
        return {}
    starts = {n for n, _ in model.group.starts}
    fixed = {n: v for n, v in model.fixed.items() if n not in starts} | fixed_values(record, model.group)
    own = GroupModel(model.group, record.signals[model.group.drive], record.h, fixed, record.grid)
    simulated = own.simulate({n: v for n, v in fit.values.items() if n not in starts})
    found = {}
    for signal in finding.task.measured:
        if signal in record.signals:
            error = (record.signals[signal] - simulated[signal])[held.first :]
            found[signal] = float(np.sqrt(np.mean(error**2)))
    return found


def confirm(finding: Finding, record: Record, held: Held, tolerance: float) -> list[Refused]:
    """Take out of a finding, one by one, the causes that do not help on held-out data; the least helpful first.

    Args:
        finding: what was named in one group; changed in place.
        record: the log that was fitted.
        held: the held-out data.
        tolerance: trust in the nominal parameters.

    Returns:
        What was taken out.
    """
    refused: list[Refused] = []
    while named := [e for e in finding.chosen.effects if e.name not in SAMPLED]:
        with_all = errors(finding, finding.chosen.fit, held)
        if not with_all:
            break
        signal = next(iter(with_all))
        trials = []
        for effect in named:
            rest = tuple(e for e in finding.chosen.effects if e is not effect)
            trial = tried(finding.task, rest, tolerance, finding.chosen.fit) if rest else finding.null
            trials.append((errors(finding, trial.fit, held)[signal], effect, trial))
        without, effect, trial = min(trials, key=lambda item: item[0])
        if without * (1.0 - WORTH) > with_all[signal]:
            break
        gain = finding.chosen.fit.log_likelihood - trial.fit.log_likelihood
        refused.append(
            Refused(effect, finding.task.model.group.name, signal, gain, without, with_all[signal])
        )
        finding.chosen = trial
    if refused:
        candidates = tuple(e for e in finding.task.model.group.effects() if e.name not in SAMPLED)
        finding.after = leftovers(finding.task, record, finding.chosen.fit)
        finding.rivals = rivals(finding.task, finding, candidates, tolerance)
        finding.events = {s: local_tests(finding.task, s, finding.chosen.fit) for s in finding.task.measured}
    return refused
