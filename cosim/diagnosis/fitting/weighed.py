"""A torque that depends on the angle, weighed along the angle that was measured: where the search for it begins.

A joint that its weight brings back stays where it is held. Without the weight its model turns on and on, and what a weight
would change in that run says nothing of the machine. Along the measured motion the torque that is missing is linear in size
and in sine and cosine of the phase.

    missing = A r PL - J alpha - b omega   (4.27)
"""

from types import SimpleNamespace

import numpy as np

from cosim.diagnosis.fitting.fit import Task
from cosim.diagnosis.record.record import low_pass
from cosim.diagnosis.record.torque import cutoff_for
from cosim.inference.pieces import slope
from fmus.contract import Effect

WEIGHED_AT_MOST = 0.2  # of the sampling rate


def weighed(task: Task, effect: Effect, values: dict[str, float]) -> dict[str, float]:
    """Size and phase of an effect whose torque is a sine of the angle; nothing where motion or torque do not tell it.

    Args:
        task: data and model of a group.
        effect: what is sought.
        values: ``component.parameter`` -> SI of what is known.
    """
    model, phases = task.model, [n for n, free in effect.free.items() if free.phase]
    place = next((s for s in task.measured if not model.group.is_speed(s)), None)
    law = effect.fills.get("load_torque")
    if place is None or law is None or len(phases) != 1 or len(effect.free) != 2:
        return {}
    (component, first), size, phase = model.group.stages[0], effect.key, phases[0]
    if first != "mechanical" or component != effect.component:
        return {}
    h, cuts = model.h, model.cuts
    cutoff = min(cutoff_for(task.measured[place].size * h), WEIGHED_AT_MOST / h)
    theta = low_pass(task.measured[place], h, cutoff, cuts)
    omega = slope(theta, h, cuts)

    def number(name: str) -> float:
        key = f"{component}.{name}"
        return values.get(key, model.nominal(key))

    torque = number("A") * number("r") * low_pass(model.drive, h, cutoff, cuts)
    missing = torque - number("J") * slope(omega, h, cuts) - number("b") * omega
    columns = []
    for at in effect.free[phase].starts:
        unit = SimpleNamespace(**{n: v.start for n, v in effect.parameters.items()} | {size: 1.0, phase: at})
        columns.append([law(None, angle, None, None, None, unit, None) for angle in theta.tolist()])
    share = np.linalg.lstsq(np.array(columns).T, missing, rcond=None)[0]
    if share.size != 2 or not np.isfinite(share).all():
        return {}
    turned = effect.free[phase].starts[0] + float(np.arctan2(share[1], share[0]))
    return {f"{component}.{size}": float(np.hypot(*share)), f"{component}.{phase}": turned}
