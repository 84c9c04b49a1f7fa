"""Noise of a measured drive, propagated into the signals of the group that it drives.

Where the block before the mechanics is not understood, the measured pressure drives them, and its noise is integrated into
a random walk of the angle. Free functions take most of that for something systematic, and what they leave to learn the
noise from is too little; correlated noise of the pressure makes a walk steeper than any kind of noise that is learned.
But all of it is known from the pressure, and is put in beforehand.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.fitting.noise import CORRELATION_TIMES, QUICK_KINDS, Whitener, centred, kinds, of_means

Array = NDArray[np.float64]

REPEATS = 4  # draws, of which the size is taken
SEED = 2019


def propagated(task: Task, rule: Whitener) -> dict[str, Array]:
    """Signal -> (window, window) covariance that the noise of the measured drive, by its `rule`, leaves in a window's bins.

    The shape is that of an integral; the size is that of the model's answers to drawn noise.
    """
    model, rng = task.model, np.random.default_rng(SEED)
    quiet = model.simulate({})
    sizes = dict.fromkeys(task.rules, 0.0)
    for _ in range(REPEATS):
        drive = model.drive + drawn(rule, model.drive.size, rng) * sample_sizes(rule, model.drive.size)
        noisy = GroupModel(model.group, drive, model.h, model.fixed, model.grid).simulate({})
        for signal, own in task.rules.items():
            sizes[signal] += float(np.mean(centred(own, noisy[signal] - quiet[signal]) ** 2)) / REPEATS
    return {s: sizes[s] * walk(rule, own.window) for s, own in task.rules.items()}


def walk(rule: Whitener, window: int) -> Array:
    """(window, window) covariance of the integral of quick noise by a rule; without its mean it has unit mean square."""
    noise = np.tensordot(np.array(rule.sizes[:QUICK_KINDS]), kinds(window)[:QUICK_KINDS], axes=1)
    summed = np.cumsum(np.cumsum(noise, axis=0), axis=1)
    square = (np.trace(summed) - summed.sum() / window) / window
    return np.asarray(summed / max(float(square), 1e-300))


def sample_sizes(rule: Whitener, count: int) -> Array:
    """(count,) or () size of the noise of each sample over that of all: logs may differ."""
    edges = np.diff([0, *rule.cuts, count])
    return np.repeat(rule.scales, edges) if rule.scales else np.ones(())


def drawn(rule: Whitener, count: int, rng: np.random.Generator) -> Array:
    """Noise (count,) by a rule, sample by sample; of the slowest kinds, which may be a model's error as well, nothing."""
    noise = rng.normal(size=count) * np.sqrt(rule.sizes[0] * rule.bins)
    for tau, size in zip(CORRELATION_TIMES[: QUICK_KINDS - 1], rule.sizes[1:QUICK_KINDS], strict=True):
        pole = np.exp(-1.0 / (tau * rule.bins))
        sample = np.sqrt(size / of_means(tau))
        steps = rng.normal(size=count) * sample * np.sqrt(1.0 - pole * pole)
        noise += lfilter([1.0], [1.0, -pole], steps, zi=[pole * sample * rng.normal()])[0]
    return np.asarray(noise)
