"""Causes that would explain the log only with a parameter beyond what it can physically be: another law, then.

A gear ripple with three periods a turn is no gear ripple, yet over a short range of angles it is shaped as gravity is.
"""

import numpy as np

from cosim.diagnosis.group_model import GroupModel
from cosim.diagnosis.trials import Trial, declared
from fmus.contract import Effect

PRESSED = (
    0.5 * 3.84
)  # log-likelihood beyond a bound that chance gives one estimate in forty, if the truth lay on it


def impossible(trial: Trial, model: GroupModel) -> list[Effect]:
    """The effects of a fitted set that the data press against a bound of one of their parameters."""
    return [e for e in trial.effects if beyond(trial, e, model) > PRESSED]


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
        variable, value = declared(effect, parameter), found.values[name]
        bound = min((variable.low, variable.high), key=lambda edge: abs(edge - value))
        if bound == model.nominal(name):
            continue
        at = names.index(name)
        others = np.linalg.qr(np.delete(found.slopes, at, axis=1))[0]
        own = found.slopes[:, at] - others @ (others.T @ found.slopes[:, at])
        pull, size = -float(own @ found.rows), float(own @ own)
        outward = pull > 0.0 if bound == variable.high else pull < 0.0
        if outward and size > 0.0:
            most = max(most, 0.5 * pull**2 / size)
    return most
