"""A sine has two spellings, half a turn apart, and phases differ by turns: told is the positive one, within half a turn."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cosim.diagnosis.fitting.trials import Trial
from fmus.contract import Effect


def usual(effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
    """Parameters of an effect with a positive amplitude and a phase from -pi to pi; the effect is the same.

    Args:
        effect: any effect; one without a phase stays as it is.
        values: its parameters, SI.
    """
    found = dict(values)
    for phase, free in effect.free.items():
        if free.phase:
            turned = math.pi if found[effect.key] < 0.0 else 0.0
            found[effect.key] = abs(found[effect.key])
            found[phase] = math.remainder(found[phase] + turned, 2.0 * math.pi)
    return found


def usually_spelled(trial: Trial) -> Trial:
    """A fitted set with every sine in its usual spelling, covariance and slopes included."""
    names, values = list(trial.fit.values), dict(trial.fit.values)
    signs = np.ones(len(names))
    for effect in trial.effects:
        own = {parameter: f"{effect.component}.{parameter}" for parameter in effect.free}
        told = usual(effect, {parameter: values[name] for parameter, name in own.items()})
        for parameter, name in own.items():
            if parameter == effect.key and told[parameter] != values[name]:
                signs[names.index(name)] = -1.0
            values[name] = told[parameter]
    width = trial.fit.covariance.shape[0]
    covariance = trial.fit.covariance * np.outer(signs[:width], signs[:width])
    slopes = trial.fit.slopes
    if slopes is not None:
        slopes = slopes * signs[: slopes.shape[1]]
    return Trial(
        trial.effects, replace(trial.fit, values=values, covariance=covariance, slopes=slopes), trial.price
    )
