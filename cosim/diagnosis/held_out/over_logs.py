"""Each estimate of a fit to several logs over these logs: see `cosim.inference.between`."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.record.record import is_start
from cosim.diagnosis.residuals.cross_validation import moving
from cosim.inference.between import Between, between_logs, drawn_by_logs


def over_logs(fit: Fit, log: NDArray[np.int64], off: Callable[[str], float]) -> dict[str, Between]:
    """Each estimated parameter over the logs of a fit; nothing for one log.

    Args:
        fit: to all logs.
        log: (n,) number of the log to which each of its whitened values belongs, from 0; starts of the logs are no
            parameters of the machine and are left out.
        off: ``component.parameter`` -> where it has no effect, SI.
    """
    names, slopes = moving(fit)
    if not names or fit.rows is None:
        return {}
    scales = np.array([fit.scales[n] for n in names])
    drawn = drawn_by_logs(slopes, fit.rows, log, scales)
    found = {}
    for i, name in enumerate(names):
        if is_start(name) or name not in fit.deviations or drawn is None:
            continue
        value, deviation = fit.values[name], fit.deviations[name]
        # a limit out of reach says nothing of one that is met
        size = min(abs(value - off(name)), abs(value))
        found[name] = between_logs(value, deviation, drawn.steps[:, i], drawn.shares[:, i], size)
    return found
