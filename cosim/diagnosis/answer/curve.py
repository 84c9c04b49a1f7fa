"""The static curve of the drive beside a diagnosis: what a person reads off the log, in the machine's own terms.

Not a part of the naming: `cosim.identify.drive_curve` knows nothing of blocks, effects or models.
"""

from collections.abc import Sequence

import numpy as np

from cosim.diagnosis.answer.schema import DriveCurve
from cosim.diagnosis.extension.top_speed import static_speeds
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.model.groups import Group
from cosim.errors import DataError
from cosim.identify.drive_curve import OF_ITS_OWN, drive_curve
from cosim.identify.drive_fit import Run
from cosim.identify.run_drive import Told, curve_data, run_of, told_of, way
from cosim.logs import Log, listed

COMMANDS = 60  # at which the models' curves are drawn, from one end of what was driven to the other


def integrating(found: Diagnosis) -> Group | None:
    """The group that goes from the command to an angle or a position in one, if there is one."""
    for group in found.groups:
        if group.moves and group.drive == found.machine.drive and group.commanded:
            return group
    return None


def curve_of(found: Diagnosis, log: Log | Sequence[Log]) -> DriveCurve | None:
    """The static curve from the logs, and from the held-out logs of the same machine where there is one.

    Args:
        found: the diagnosis.
        log: the log or logs as they were read, the whole of them.

    Returns:
        None where no group goes from the command to a motion, or it is a demanded place, or the log does
        not tell, or the curve leaves nearly all of how the speed varies.
    """
    group = integrating(found)
    logs = listed(log)
    if group is None or group.place or group.observed[0] not in logs[0]:
        return None
    drive, motion = group.drive, group.observed[0]
    try:
        told = told_of(logs[0], found.machine.mapping, drive, motion)
        runs = [run_of(one, told) for one in logs]
    except DataError:
        return None
    more = []
    if found.held is not None and found.held.logs and found.held.record.has(drive, motion):
        signals = found.machine.signals
        for name, record in zip(found.held.logs, found.held.record.pieces, strict=True):
            rows = {n: record.signals[n] / signals[n].gain for n in (drive, motion)}
            moved = way(record.time, rows[motion]) if group.is_speed(motion) else rows[motion]
            more.append(Run(name, record.time, rows[drive], moved))
    for used in ([*runs, *more], runs):
        try:
            found_curve = drive_curve(used)
            if found_curve.left > OF_ITS_OWN:
                return None
            shown = DriveCurve.model_validate(curve_data(found_curve, told))
            shown.simulated = simulated(found, group, told, found_curve.knots[[0, -1]].tolist())
            return shown
        except DataError:
            continue
    return None


def simulated(
    found: Diagnosis, group: Group, told: Told, ends: Sequence[float]
) -> list[tuple[float, float, float | None]]:
    """Command, and the speeds in which the model and the extended model end there, in the units people read.

    Args:
        found: the diagnosis.
        group: from the command to the motion.
        told: those units.
        ends: the least and the largest command that the log's curve has, SI as in the log.

    Returns:
        Nothing where the model has no lasting speed; none of an extended model that has none, or that is a linear one.
    """
    finding = found.findings.get(group.name)
    if finding is None:
        return []
    model, signals = finding.task.model, found.machine.signals
    commands = np.linspace(ends[0], ends[1], COMMANDS + 1)
    order = np.argsort(-np.abs(commands), kind="stable")
    driven = (commands[order] * signals[told.command].gain).tolist()
    effects = tuple(cause.effect for cause in found.causes if cause.group == group.name)
    own = {n: v for n, v in found.values.items() if n.partition(".")[0] in group.components}
    nominal = static_speeds(model, (), found.calibrated, driven)
    extended = None
    if found.in_place is None and effects:
        extended = static_speeds(model, effects, own, driven)
    if nominal is None:
        return []
    rows = np.column_stack([commands[order], nominal, extended or nominal])[np.argsort(order)]
    scales = told.command_scale, *[told.motion_scale / signals[told.motion].gain] * 2
    return [(u, v, None if extended is None else w) for u, v, w in (rows * np.array(scales)).tolist()]
