"""A log in which nothing moves: one state of the machine is all that is known, and no effect can be told from another."""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.fitting.whole import ChainModel
from cosim.diagnosis.model.groups import MODELS
from cosim.diagnosis.model.machine import Machine
from cosim.diagnosis.record.grid import plain_name
from cosim.diagnosis.record.record import Record, fixed_values
from cosim.diagnosis.residuals.finding import Finding
from cosim.diagnosis.thresholds import STILL
from cosim.diagnosis.verdict.verdict import Rest
from cosim.signals import SIGNALS

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
    from the zero of a sensor. False where the range of a signal is not known, as that of any system but the crane: an angle
    of another machine may be called as the crane's is, and yet turn by hundredths of a degree. Of such a machine nothing
    moves where no command was given and no reading does more than its own noise.
    """
    if machine.name not in MODELS:
        return not np.any(record.signals[machine.drive]) and all(
            map(partial(only_noise, record), record.signals)
        )
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


def only_noise(record: Record, name: str) -> bool:
    """True if a signal without its noise moves no more than the noise does."""
    smooth = record.smooth(name)
    return bool(np.ptp(smooth) <= np.ptp(record.signals[name] - smooth))


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
