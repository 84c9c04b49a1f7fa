"""The static curve of the drive beside a diagnosis: what a person reads off the log, in the machine's own terms.

Not a part of the naming: `cosim.identify.drive_curve` knows nothing of blocks, effects or models.
"""

from collections.abc import Sequence

from cosim.diagnosis.answer.schema import DriveCurve
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.model.groups import Group
from cosim.errors import DataError
from cosim.identify.drive_curve import OF_ITS_OWN, drive_curve
from cosim.identify.drive_fit import Run
from cosim.identify.run_drive import curve_data, run_of, told_of, way
from cosim.logs import Log, listed


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
            return DriveCurve.model_validate(curve_data(found_curve, told))
        except DataError:
            continue
    return None
