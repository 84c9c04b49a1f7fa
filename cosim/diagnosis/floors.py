"""The size of the sensors' noise, sample by sample: what the error of a simulation that is right comes down to."""

import numpy as np

from cosim.compare.metrics import noise_floor
from cosim.diagnosis.finding import Finding
from cosim.diagnosis.verdict import adequate, rounding


def floor_of(finding: Finding, signal: str) -> float:
    """Standard deviation of a signal's noise per sample, white or not, rounding included, SI.

    Where nothing is left unexplained it is that of the noise learned: between the samples of a bin, and of the bins. Where
    something is left, which might pass for correlated noise, it is what shows where the signal is quietest.
    """
    task = finding.task
    rule = task.rules[signal]
    if not adequate(finding):
        return noise_floor(task.measured[signal], task.model.h)
    parts = [own[rule.skip :] for own in np.split(finding.chosen.fit.residuals[signal], rule.cuts)]
    rows = np.concatenate([own[: own.size // rule.bins * rule.bins].reshape(-1, rule.bins) for own in parts])
    between = np.mean((rows - rows.mean(axis=1, keepdims=True)) ** 2)
    step = max(rounding(finding, signal), task.steps.get(signal, 0.0))
    return float(np.sqrt(rule.rms**2 + between + step**2 / 12.0))
