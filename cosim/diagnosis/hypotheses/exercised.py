"""What a log never exercised: effects that it would not surely have shown even at a moderate size."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.fit import jacobian
from cosim.diagnosis.fitting.trials import declared, trusted
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import NAMING_GAIN, ONE_SIDED_95
from fmus.contract import Effect

Array = NDArray[np.float64]


def moderate(
    effect: Effect, nominal: Callable[[str], float], base: Mapping[str, float]
) -> dict[str, float] | None:
    """Values with an effect of moderate size in them; None where its off value is the only one known.

    Args:
        effect: the effect.
        nominal: off value of a ``component.parameter``, SI.
        base: ``component.parameter`` -> SI of all else.
    """
    moved = dict(base)
    for parameter, free in effect.free.items():
        name = f"{effect.component}.{parameter}"
        variable, off = declared(effect, parameter), nominal(name)
        value = (
            (min if off > 0 else max)(free.starts, key=abs)
            if free.limits
            else off + (free.scale if variable.high > off else -free.scale)
        )
        moved[name] = float(np.clip(value, variable.low, variable.high))
    same = all(moved[n] == nominal(n) for n in (f"{effect.component}.{p}" for p in effect.free))
    return None if same else moved


def exercised(finding: Finding, tolerance: float) -> dict[str, float]:
    """Effect -> log-likelihood that a moderate size would have gained in this log, nominal parameters free to hide it."""
    task, null = finding.task, finding.null
    base = null.fit.values
    own = trusted(task.model, tolerance)
    scale = {u.name: u.scale for u in own}

    def white(values: dict[str, float]) -> Array:
        return task.white(task.residuals(values))

    centre = white(base)
    hide = np.zeros((centre.size, 0))
    if own:
        names = list(base)
        z = np.array([base[n] / scale[n] for n in names])
        wide = np.full(z.size, 1e9)
        hide = jacobian(
            lambda v: white({n: x * scale[n] for n, x in zip(names, v.tolist(), strict=True)}), z, -wide, wide
        )
    found = {}
    for effect in task.model.group.effects():
        if effect.name in SAMPLED:  # every log shows those
            continue
        moved = moderate(effect, task.model.nominal, base)
        if moved is None:
            continue  # where such a stop would be nobody knows
        change = white(moved) - centre
        # the trusted parameters can take up part of it, at the price of their priors
        rows = np.concatenate([hide, np.eye(hide.shape[1])])
        target = np.concatenate([change, np.zeros(hide.shape[1])])
        if hide.shape[1]:
            solution, *_ = np.linalg.lstsq(rows, target, rcond=None)
            target = target - rows @ solution
        found[effect.name] = 0.5 * float(target @ target)
    return found


def never_exercised(finding: Finding, tolerance: float) -> list[str]:
    """Effects of a moderate size that such a log would not show one time in twenty, or more often.

    What a true effect gains scatters with the noise along it: by the root of twice what it gains on average.
    """
    named = set(finding.chosen.names)
    sure = {
        e.name: NAMING_GAIN + 0.5 * len(e.free) * float(np.log(finding.null.fit.count))
        for e in finding.task.model.group.effects()
    }
    least = {
        n: gain - ONE_SIDED_95 * float(np.sqrt(2.0 * gain))
        for n, gain in exercised(finding, tolerance).items()
    }
    return [n for n, gain in least.items() if n not in named and gain < sure[n]]
