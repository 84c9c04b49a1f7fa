"""What the answer says besides its figures: warnings, what was held out or refused, and what was not judged."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.schema import (
    ITSELF,
    ONE_WAY,
    RefusedCause,
)
from cosim.diagnosis.extension.top_speed import static_speeds
from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.held_out.causes import Refused
from cosim.diagnosis.model.machine import Machine
from cosim.diagnosis.record.grid import Grid, Pieces
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.thresholds import AS_WELL, AT_ZERO, FAR, FEWEST_ITSELF, HELD_LEVEL, UNCOMMANDED
from cosim.diagnosis.verdict.verdict import names_of, what_stands
from cosim.errors import UsageError
from cosim.inference.held_out import ratio_ci95
from cosim.lexicon import current
from cosim.logs import Log
from cosim.machines.rough import stays_with
from cosim.units import number_and_unit, parse_quantity

Array = NDArray[np.float64]
STOP = "dcv.stroke_limit"
HELD_BY = "mechanical.gravity_load"  # brings a place back, as a spring or a pendulum's weight does


def shown(signal: str) -> tuple[str, float]:
    """Display unit of a signal and the factor from SI to it."""
    return current().signal(signal)


def notes(diagnosis: Diagnosis, logs: Sequence[Log]) -> list[str]:
    """What the user should know of how the logs were taken, and laid one behind the other."""
    log, grid = logs[0], diagnosis.record.grid
    found = [*dict.fromkeys(diagnosis.machine.aside.values()), *diagnosis.machine.notes]
    found += behind_one_another(diagnosis, logs, grid) if isinstance(grid, Pieces) else []
    if log.time_unit != "s":
        found.append(
            f"the log counts samples and its sampling time is not known: one sample counts as {diagnosis.record.h:g} s, "
            "and every time and rate here is on that scale"
        )
    if diagnosis.tracker is not None and diagnosis.tracker.rounds:
        found.append(
            f"the slew sensor's steps are rounded {diagnosis.tracker.rounds}: against the tracker its readings are off by "
            "half a step on average, which is no fault of its own"
        )
    found += short_of_demand(diagnosis)
    for group in diagnosis.groups:
        if lost := group.behind_lost_motion():
            found.append(
                f"{' and '.join(lost)} cannot be told in a model that feeds the speed back to the pressure, since then "
                "the sensor sees another speed than the piston has; hold the log against full_order for that"
            )
    grids = [own for piece in diagnosis.record.pieces if isinstance(own := piece.grid, Grid)]
    if grid is not None and grids:
        spread = np.concatenate([np.diff(own.stamps) for own in grids])
        low, high = (f"{1e3 * v:.4g}" for v in (spread.min(), spread.max()))
        drive = diagnosis.machine.drive
        way = (
            f"{drive} on straight lines from stamp to stamp"
            if grid.lines
            else f"{drive} held from stamp to stamp (if it changes in between, the machine seems early: `held = false` in a "
            "mapping file draws straight lines)"
        )
        found.append(
            f"sampled every {low if low == high else f'{low} to {high}'} ms: simulated in steps of "
            f"{1e3 * grid.step:.4g} ms, {way}, and compared at the stamps themselves"
        )
    return found


def short_of_demand(diagnosis: Diagnosis) -> list[str]:
    """How much of a demanded place a drive holds, where the mapping states the place and the fit ends elsewhere.

    The gain is fitted with all else, so nothing is named: but a drive that stays short of its demand is no accident.
    """
    mapping = diagnosis.machine.mapping
    stated = "?" if mapping is None else str(mapping.machine.get("speed", "?"))
    found = []
    for finding in diagnosis.findings.values() if stated != "?" else ():
        model = finding.task.model
        if not model.group.place or finding.lacks_linear:
            continue
        fit = what_stands(finding).fit
        values = fit.values | {n: v for n, v in diagnosis.values.items() if n in fit.values}
        held = static_speeds(model, finding.chosen.effects, values, [1.0])
        unit, scale = shown(model.group.observed[0])
        asked = parse_quantity(stated, unit)
        if held is None:
            continue
        share = abs(held[0] * scale / asked)
        if not 1.0 / AS_WELL < share < AS_WELL:
            found.append(
                f"of a demand of {asked:.4g} {unit} the drive holds {held[0] * scale:.4g} {unit} ({100.0 * share:.0f} %): "
                "a load on a controller without an integral part, or columns of another scale"
            )
    return found


def behind_one_another(diagnosis: Diagnosis, logs: Sequence[Log], grid: Pieces) -> list[str]:
    """Where each log begins, and the size of its noise."""
    begins = ", ".join(f"{log.name} from {start:.6g} s" for log, start in zip(logs, grid.starts, strict=True))
    found = [
        f"{len(logs)} logs, one behind the other: {begins}; times and pictures count from the start of the first, each log "
        "has a start and a noise of its own, and the packages play the command of the first"
    ]
    noise = [
        f"{signal} {', '.join(f'{scale:.2g}' for scale in rule.scales)}"
        for finding in diagnosis.findings.values()
        for signal, rule in finding.task.rules.items()
        if rule.scales
    ]
    if noise:
        found.append(f"noise of each log over that of all together: {'; '.join(noise)}")
    return found


def held_out(diagnosis: Diagnosis) -> str:
    """What the gains are measured on, in words."""
    held = diagnosis.held
    if held is None:
        return "every third window of the log"
    if held.first:
        return f"the log from {held.record.time[held.first]:.4g} s on, which took no part in the fits"
    what = "other logs" if held.record.cuts else "another log"
    return f"{what}, {held.name}, which took no part in the fits"


def held_from(diagnosis: Diagnosis) -> float | None:
    """Time in the log from which it was held out, its end where another log was; None for every third window."""
    if diagnosis.held is None:
        return None
    return float(
        diagnosis.held.record.time[diagnosis.held.first]
        if diagnosis.held.first
        else diagnosis.record.time[-1]
    )


def held_file(diagnosis: Diagnosis) -> dict[str, str]:
    """Name and checksum of another log that was held out."""
    held = diagnosis.held
    return (
        {}
        if held is None or not held.name
        else {"log_held_out": held.name, "log_held_out_sha256": held.sha256}
    )


def files(logs: Sequence[Log]) -> dict[str, str]:
    """Name and checksum of each log."""
    found: dict[str, str] = {}
    for number, log in enumerate(logs, 1):
        key = "log" if number == 1 else f"log_{number}"
        found |= {key: log.name, f"{key}_sha256": log.sha256}
    return found


def changed(one: float, other: float, unit: str, counts: bool = True) -> str:
    """How an error changes, with as many digits as show it, up to six: beyond these it stays.

    Args:
        one: before.
        other: after.
        unit: of both.
        counts: a fall of this size was held against the cause; else something else was.
    """
    for digits in range(4, 7):
        texts = f"{one:.{digits}g}", f"{other:.{digits}g}"
        if texts[0] != texts[1]:
            way = ("falls only" if counts else "falls") if other < one else "rises"
            return f"{way} from {texts[0]} to {texts[1]} {unit}"
    return f"stays at {one:.4g} {unit}"


def turned_down(item: Refused, named: Collection[str]) -> RefusedCause:
    """A refused cause in display units, beside those that are named in the end."""
    unit, scale = shown(item.signal)
    without, with_it = item.without * scale, item.with_it * scale
    where = "in a free run over them" if item.in_fitted else "on held-out data"
    way = changed(without, with_it, unit, counts=item.sure or bool(item.instead))
    chance = ", no more than chance may do" if way.startswith("falls") and item.sure else ""
    error = f"{where} the error of {item.signal} {way} with it{chance}"
    why = f"it gains {item.gain:.0f} in log-likelihood on the fitted data, but {error}"
    if item.instead:
        alike = f"({item.gain:+.1f} in log-likelihood, less the price of its parameters)"
        why = f"in place of {item.instead} it explains the fitted data alike {alike}, but {error}"
        if item.instead not in named:
            why = f"it explains the fitted data as {item.instead} does, which is not named either {alike}, but {error}"
    elif item.passed:
        beyond = item.passed[0]
        unit, scale = shown(beyond.signal)
        unit += "/s" if beyond.rate else ""
        why = (
            f"it gains {item.gain:.0f} in log-likelihood on the fitted data, but readings pass the limit: "
            f"{beyond.signal} reaches {beyond.reading * scale:.4g} {unit}, and it would end at {beyond.limit * scale:.4g}"
        )
    elif not item.sure and item.gain < 0.0:
        why = f"taken as a whole the fitted data are explained no better with it; {error}"
    elif not item.sure:
        why = (
            f"it gains {item.gain:.0f} in log-likelihood on the fitted data, but taken as a whole these do not determine "
            f"its size; {error}"
        )
    instead = item.instead if item.instead in named else None
    return RefusedCause(effect=item.effect.name, block=item.group, why=why, instead=instead)


def is_part(span: tuple[float, float], log: Log) -> bool:
    """True if the fits used a stretch of the log only."""
    start, end = span
    return end - start < log.duration - log.step


def not_judged(diagnosis: Diagnosis) -> dict[str, str]:
    """Group -> why nothing is said of it."""
    found = {g: f"not measured: {', '.join(s)}" for g, s in diagnosis.unjudged.items()} | diagnosis.sparse
    for group in diagnosis.groups:
        if group.name in diagnosis.failed:
            found[group.name] = diagnosis.failed[group.name]
        elif group.name not in found and group.name not in diagnosis.findings:
            found[group.name] = (
                "the data contradict their labels"
                if diagnosis.data
                else "the diagnosis was interrupted before it was judged"
            )
    return found


def levels(command: Array) -> Array:
    """(k,) levels other than zero that a command (n,) holds, in its unit."""
    reach = float(np.max(np.abs(command), initial=0.0))
    if reach == 0.0:
        return np.zeros(0)
    near = np.round(command / reach, 2)
    found, counts = np.unique(near[np.abs(near) > AT_ZERO], return_counts=True)
    held = counts >= HELD_LEVEL * command.size
    few = counts[~held].sum() < HELD_LEVEL * command.size  # a short ramp between levels is none
    return np.asarray(reach * (found[held] if few else found))


def one_level(diagnosis: Diagnosis) -> list[str]:
    """That a command with one level on a side does not show what bends the way from command to motion."""
    drive = diagnosis.machine.drive
    found = levels(diagnosis.record.signals.get(drive, np.zeros(0)))
    if not found.size or max(np.sum(found > 0.0), np.sum(found < 0.0)) > 1:
        return []
    unit, scale = shown(drive)
    said = " and ".join(f"{value * scale:.3g}{'' if unit == '1' else ' ' + unit}" for value in found)
    return [
        f"{drive} holds one level on a side only ({said}): dead zone, friction and limits cannot be told from the gain; "
        "fit logs with other levels beside this one (cosim diagnose LOG LOG ...)"
    ]


def moved(record: Record, machine: Machine) -> tuple[str, bool]:
    """The signal that shows the motion, and whether it is a speed; no name where none was measured."""
    for group in reversed([g for g in machine.groups if g.moves]):
        for name in group.observed:
            if name in record.signals:
                return name, group.is_speed(name)
    return "", False


def never(command: Array) -> str:
    """The sign that a command (n,) never has, beyond rounding; empty for one that has both or neither."""
    ahead, back = float(np.max(command, initial=0.0)), float(-np.min(command, initial=0.0))
    if min(ahead, back) > AT_ZERO * max(ahead, back) or ahead == back:
        return ""
    return "negative" if ahead > back else "positive"


def one_way(record: Record, machine: Machine) -> list[str]:
    """That a drive goes both ways on a command that never changes sign: the column of the other direction is missing.

    A load alone may turn a drive back while its valve is open; what it goes on no command at all it does not.
    """
    drive, (name, is_speed) = machine.drive, moved(record, machine)
    command = record.signals.get(drive)
    if command is None or not name or not never(command):
        return []
    rest = np.abs(command) <= AT_ZERO * float(np.max(np.abs(command)))
    shows = record.smooth(name)
    steps = 0.5 * (shows[1:] + shows[:-1]) * np.diff(record.time) if is_speed else np.diff(shows)
    steps[[cut - 1 for cut in record.cuts]] = 0.0  # a log does not go on where the one before it ended
    at_rest = rest[1:] & rest[:-1]
    alone, driven = float(np.sum(steps[at_rest])), float(np.sum(steps[~at_rest]))
    if alone * driven >= 0.0 or abs(alone) < UNCOMMANDED * abs(driven):
        return []
    unit, scale = shown(name)
    back = f"by {abs(alone) * scale:.3g} {unit}"
    if is_speed:
        back = f"{100.0 * abs(alone / driven):.0f} % of the way"
    return [
        f"{name} goes back {back} while {drive} is 0, and {drive} never changes its sign: if "
        f"the other direction has a column of its own, {ONE_WAY}"
    ]


def one_sided(record: Record, machine: Machine) -> list[str]:
    """That all logs drive one way: dead zone, friction and load take the same share of each command there."""
    command = record.signals.get(machine.drive)
    if command is None or not moved(record, machine)[0] or not (sign := never(command)):
        return []
    return [
        f"{machine.drive} is never {sign}: in one direction dead zone, friction and load look alike; if the machine goes "
        "both ways, fit logs of the other direction beside this one (cosim diagnose LOG LOG ...)"
    ]


def no_sign(record: Record, machine: Machine) -> list[str]:
    """That a speed or flow is as large on either side of the command and keeps its sign: its meter shows no direction."""
    drive, (name, is_speed) = machine.drive, moved(record, machine)
    command = record.signals.get(drive)
    if command is None or not is_speed:
        return []
    reach, seen = float(np.max(np.abs(command), initial=0.0)), record.signals[name]
    ahead, back = (seen[way * command > FAR * reach] for way in (1.0, -1.0))
    if reach == 0.0 or min(ahead.size, back.size) < HELD_LEVEL * command.size:
        return []
    sizes = float(np.median(ahead)), float(np.median(back))
    larger, smaller = max(sizes, key=abs), min(sizes, key=abs)
    against = np.mean(larger * seen < -AT_ZERO * larger * larger)
    if smaller * larger < UNCOMMANDED * larger * larger or larger == 0.0 or against > HELD_LEVEL:
        return []
    return [
        f"{name} is as large for a negative as for a positive {drive} and never changes its sign: a meter that shows no "
        "direction; give its readings the sign of the motion before they are compared, or take a log of one direction"
    ]


def zero_of_speed(diagnosis: Diagnosis) -> list[str]:
    """That a cause which does no more than move a measured speed is no other than a sensor whose zero is off."""
    found = []
    for cause in diagnosis.causes:
        finding = diagnosis.findings.get(cause.group)
        if finding is None or (model := finding.task.model).group.integrates or not model.group.level_counts:
            continue
        with_it = finding.chosen.fit.values
        without = with_it | {name: model.nominal(name) for name in names_of(cause.effect).values()}
        one, other = model.simulate(with_it), model.simulate(without)
        for signal in filter(model.group.is_speed, finding.task.measured):
            moved_by = one[signal] - other[signal]
            offset = float(np.median(moved_by))
            if np.median(np.abs(moved_by - offset)) >= AT_ZERO * abs(offset):
                continue
            unit, scale = shown(signal)
            size = f"{offset * scale:.3g}{'' if unit == '1' else ' ' + unit}"
            found.append(
                f"{cause.effect.name} moves {signal} by {size} throughout, as a sensor does whose zero "
                "is off by as much: check its zero at rest, or name it under `drifting` in the mapping file"
            )
    return found


def at_supply(diagnosis: Diagnosis) -> list[str]:
    """That a stop of a spool that was not measured looks as a pressure does that ends at its supply, if that moves."""
    found = []
    for cause in diagnosis.causes:
        finding = diagnosis.findings.get(cause.group)
        if finding is None or cause.effect.name != STOP:
            continue
        stages = [name for name, _ in finding.task.model.group.stages]
        if "dcv" not in stages or stages[-1] != "continuity" or diagnosis.record.has("p_supply"):
            continue
        for signal, reading in finding.task.measured.items():
            unit, scale = shown(signal)
            near = AT_ZERO * float(np.ptp(reading))
            ends = np.mean(reading <= reading.min() + near), np.mean(reading >= reading.max() - near)
            if max(ends) < HELD_LEVEL:
                continue
            low, high = (f"{v * scale:.4g}" for v in (reading.min(), reading.max()))
            found.append(
                f"{signal} stays between {low} and {high} {unit}: where neither spool nor supply is measured, a pressure "
                f"that ends at its supply or at a relief valve looks the same as {STOP}: compare these with the supply "
                "pressure"
            )
    return found


def itself(record: Record, drive: str, place: str) -> bool:
    """Whether a place follows its drive itself, in most pieces of a record of those that tell."""
    if not record.has(drive, place):
        return False
    cuts = (0, *record.cuts, record.time.size)
    rows = (record.time, record.signals[drive], record.signals[place])
    each = [stays_with(*(row[a:b] for row in rows)) for a, b in pairwise(cuts) if b - a > FEWEST_ITSELF]
    return each.count(True) > each.count(False)


def at_once(diagnosis: Diagnosis) -> list[str]:
    """That a place follows the command itself and not its sum over time: a demanded place was taken for a command.

    One that goes against it is answered by a controller, or counts the other way.
    Where a load that grows with the place was named, that holds it.
    """
    found = list[str]()
    if any(cause.effect.name == HELD_BY for cause in diagnosis.causes):
        return found
    for finding in diagnosis.findings.values():
        group, signal = finding.task.model.group, next(iter(finding.task.measured))
        if (
            not group.integrates
            or group.is_speed(signal)
            or group.drive != (drive := diagnosis.machine.drive)
        ):
            continue
        linear = finding.reference if finding.lacks_linear else None
        shown_itself = linear is not None and not linear.model.integrates
        if linear is not None and shown_itself and linear.model.settled < 0.0:
            found.append(
                f"{signal} goes against {drive} itself: if {drive} is what a controller puts out, this log shows how it "
                f"answers {signal}, and one without its loop tells more of the drive; if {signal} counts the other way, "
                "give it sign = -1 in [signals]"
            )
            continue
        if shown_itself or itself(diagnosis.record, drive, signal):
            found.append(
                f"{signal} follows {drive} {ITSELF}, where the model goes on while {drive} lasts: "
                f'if {drive} is a demanded place, say command = "place" in [machine], or log what the controller puts out; '
                f"if {signal} is a speed, a flow or a level, map it as a speed or flow; if a spring or its weight brings it "
                "back, state J and b in [machine], which a log alone then does not tell"
            )
    return found


def as_stated(diagnosis: Diagnosis) -> list[str]:
    """Speed and lag as the log has them, where the machine's file states its motion so and a cause changes it."""
    mapping = diagnosis.machine.mapping
    stated = mapping.machine if mapping is not None else {}
    freed = {n for c in diagnosis.causes for n in names_of(c.effect).values()}
    inertia, friction = (diagnosis.values.get(n) for n in ("mechanical.J", "mechanical.b"))
    if not freed & {"mechanical.J", "mechanical.b"} or not inertia or not friction:
        return []
    model = next(
        f.task.model for f in diagnosis.findings.values() if "mechanical" in dict(f.task.model.group.stages)
    )
    slower = friction / (model.nominal("mechanical.b") or np.nan)
    longer = inertia / (model.nominal("mechanical.J") or np.nan) / slower
    said = []
    for name, ratio in (("speed", 1.0 / slower), ("lag", longer)):
        with suppress(UsageError):  # not stated, or left to the log
            number, unit = number_and_unit(str(stated.get(name, "")))
            said.append(f"{name} {number * ratio:.4g} {unit} instead of {number:.4g} {unit}")
    return [f"in the numbers of [machine] the log has {' and '.join(said)}"] if said else []


def advice(diagnosis: Diagnosis) -> list[str]:
    """How to record or map a log that tells more, and what it says in the numbers that the file states."""
    record, machine = diagnosis.record, diagnosis.machine
    more = no_sign(record, machine) + zero_of_speed(diagnosis) + at_supply(diagnosis) + at_once(diagnosis)
    # a demanded place has neither directions nor levels of a speed
    if any(group.place for group in machine.groups):
        return as_stated(diagnosis) + more
    direction = one_way(record, machine) or one_sided(record, machine)
    return as_stated(diagnosis) + direction + more + one_level(diagnosis)


def limits(diagnosis: Diagnosis, logs: Sequence[Log]) -> list[str]:
    """What limits the answer: an interruption, a stretch of a long log, a rest that differs from it."""
    found = list(diagnosis.notes)
    if diagnosis.stage:
        text = f"interrupted ({diagnosis.stage}): only what was finished until then is here"
        if not diagnosis.gains:
            text += "; the errors of the nominal model are those of the compiled twin, no gain was measured"
        found.append(text)
    for log, span in zip(logs, diagnosis.spans, strict=False):
        if not is_part(span, log):
            continue
        start, end = span
        which = f"the log {log.name}" if len(logs) > 1 else "the log"
        found.append(
            f"{which} lasts {log.duration:.0f} s; the diagnosis used the {end - start:.0f} s from {start:.6g} s on, "
            "whose command visits most, and times in it count from there"
        )
    if diagnosis.at_rest:
        found.append(
            "nothing moves in this log: the command asks for no motion and none is measured, so no effect was exercised and "
            "none can be named or excluded; drive the machine over the whole range of the command, both ways"
        )
    found += advice(diagnosis)
    for signal, linear in diagnosis.references.items():
        _, high = ratio_ci95(linear.ours, linear.squares)
        # a wide interval alone says nothing
        as_good = high > 1.0 and linear.error < AS_WELL * linear.ours_error
        if (diagnosis.rests or diagnosis.verdict == "partly_explained") and as_good:
            unit, scale = shown(signal)
            how = "better than" if linear.ahead else "no clearly worse than"
            other = "the blocks in whose place it stands" if diagnosis.in_place else "the extended model"
            found.append(
                f"on data held out a linear model ({linear.words}) predicts {signal} {how} {other}: "
                f"{linear.error * scale:.4g} against {linear.ours_error * scale:.4g} {unit}"
            )
    return found + [
        f"{item.log + ': ' if len(logs) > 1 else ''}from {item.start:.0f} to {item.end:.0f} s the extended model's error "
        f"in {item.signal} is "
        f"{item.ratio:.3g} times that in the stretch used: something else happens there"
        for item in diagnosis.elsewhere
    ]
