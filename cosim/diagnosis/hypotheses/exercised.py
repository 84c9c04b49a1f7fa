"""What a log never exercised: effects that it could not have shown even at a moderate size; all where nothing moves."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.extension.packages import ChainModel
from cosim.diagnosis.fitting.fit import jacobian
from cosim.diagnosis.fitting.trials import declared, trusted
from cosim.diagnosis.model.machine import Machine
from cosim.diagnosis.record.grid import plain_name
from cosim.diagnosis.record.record import Record, fixed_values
from cosim.diagnosis.record.signatures import SAMPLED
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import NAMING_GAIN, STILL
from cosim.diagnosis.verdict.verdict import Rest
from cosim.signals import SIGNALS
from fmus.contract import Effect

Array = NDArray[np.float64]


def on_the_command(record: Record, machine: Machine, from_rest: bool = False) -> dict[str, Array]:
    """(n,) SI of each signal of the nominal model on a record's command alone, from rest or as the log begins."""
    start = {n: v for g in machine.groups for n, v in fixed_values(record, g).items()}
    if from_rest:
        places = {n for g in machine.groups for n, _ in g.starts}
        start = {n: v if plain_name(n) in places else 0.0 for n, v in start.items()}
    own = {n: v for n, v in machine.base.items() if n not in start}
    return ChainModel(machine.groups, record, start).simulate(own)


def nothing_moves(record: Record, machine: Machine) -> bool:
    """True if the command asks for no motion and none is measured, so that one state of the machine is all that is known.

    What the readings do then is their noise, and where they are is one number each: no effect can be told from another, nor
    from the zero of a sensor. False where the range of a signal is not known, as that of any system but the crane.
    """
    asked = on_the_command(record, machine, from_rest=True)
    if any(name not in SIGNALS for name in asked):
        return False
    for name, predicted in asked.items():
        most = STILL * (SIGNALS[name].high - SIGNALS[name].low)
        if np.ptp(predicted) > most:
            return False
        if name in record.signals and np.ptp(record.smooth(name)) > most:
            return False
    return True


def off_at_rest(finding: Finding, record: Record, machine: Machine) -> list[Rest]:
    """How far a signal of a machine at rest stays from where the model does; an angle is where the machine was left."""
    found = []
    asked = on_the_command(record, machine, from_rest=True)
    group = finding.task.model.group
    for signal in finding.before if not group.integrates else ():
        off = float(np.mean(record.signals[signal] - asked[signal]))
        if abs(off) > STILL * (SIGNALS[signal].high - SIGNALS[signal].low):
            words = (
                f"{signal} stays off by a constant while nothing moves: at rest a shift of the machine and one of the "
                "sensor's zero look alike"
            )
            left = replace(finding.before[signal], rms=abs(off))
            found.append(Rest(group.name, signal, left, words))
    return found


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
    """Effects that this log could not have shown even at a moderate size."""
    named = set(finding.chosen.names)
    sure = {
        e.name: NAMING_GAIN + 0.5 * len(e.free) * float(np.log(finding.null.fit.count))
        for e in finding.task.model.group.effects()
    }
    return [n for n, gain in exercised(finding, tolerance).items() if n not in named and gain < sure[n]]
