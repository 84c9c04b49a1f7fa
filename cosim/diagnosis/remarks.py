"""What the answer says besides its figures: warnings, what was held out or refused, and what was not judged."""

import numpy as np

from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.heldout import Refused
from cosim.diagnosis.lexicon import current
from cosim.diagnosis.schema import (
    RefusedCause,
)
from cosim.inference.held_out import ratio_ci95
from cosim.logs import Log


def shown(signal: str) -> tuple[str, float]:
    """Display unit of a signal and the factor from SI to it."""
    return current().signal(signal)


def notes(diagnosis: Diagnosis, log: Log) -> list[str]:
    """What the user should know of how the log was taken."""
    found = []
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
    grid = diagnosis.record.grid
    if grid is not None:
        spread = np.diff(grid.stamps)
        low, high = (f"{1e3 * v:.4g}" for v in (spread.min(), spread.max()))
        drive = diagnosis.machine.drive
        way = (
            f"{drive} on straight lines from stamp to stamp"
            if grid.lines
            else f"{drive} held from stamp to stamp (if it changes in between, the valve seems early: `held = false` in a "
            "mapping file draws straight lines)"
        )
        found.append(
            f"sampled every {low if low == high else f'{low} to {high}'} ms: simulated in steps of "
            f"{1e3 * grid.step:.4g} ms, {way}, and compared at the stamps themselves"
        )
    return found


def held_out(diagnosis: Diagnosis) -> str:
    """What the gains are measured on, in words."""
    held = diagnosis.held
    if held is None:
        return "every third window of the log"
    if held.first:
        return f"the log from {held.record.time[held.first]:.4g} s on, which took no part in the fits"
    return f"another log, {held.name}, which took no part in the fits"


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


def turned_down(item: Refused) -> RefusedCause:
    """A refused cause in display units."""
    unit, scale = shown(item.signal)
    without, with_it = item.without * scale, item.with_it * scale
    error = (
        f"on held-out data the error of {item.signal} goes from {without:.4g} to {with_it:.4g} {unit} with it"
    )
    why = f"it gains {item.gain:.0f} in log-likelihood on the fitted data, but {error}"
    if item.instead:
        why = (
            f"in place of {item.instead} it explains the fitted data alike ({item.gain:+.1f} in log-likelihood, less the "
            f"price of its parameters), but {error}"
        )
    elif not item.sure:
        why = (
            f"it gains {item.gain:.0f} in log-likelihood on the fitted data, but taken as a whole these do not determine "
            f"its size; {error}"
        )
    return RefusedCause(effect=item.effect.name, block=item.group, why=why)


def is_part(diagnosis: Diagnosis, log: Log) -> bool:
    """True if the fits used a stretch of the log only."""
    start, end = diagnosis.span
    return end - start < log.duration - log.step


def not_judged(diagnosis: Diagnosis) -> dict[str, str]:
    """Group -> why nothing is said of it."""
    found = {g: f"not measured: {', '.join(s)}" for g, s in diagnosis.unjudged.items()}
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


def limits(diagnosis: Diagnosis, log: Log) -> list[str]:
    """What limits the answer: an interruption, a stretch of a long log, a rest that differs from it."""
    found = list(diagnosis.notes)
    if diagnosis.stage:
        text = f"interrupted ({diagnosis.stage}): only what was finished until then is here"
        if not diagnosis.gains:
            text += "; the errors of the nominal model are those of the compiled twin, no gain was measured"
        found.append(text)
    if is_part(diagnosis, log):
        start, end = diagnosis.span
        found.append(
            f"the log lasts {log.duration:.0f} s; the diagnosis used the {end - start:.0f} s from {start:.6g} s on, "
            "whose command visits most, and times in it count from there"
        )
    for signal, linear in diagnosis.references.items():
        low, high = ratio_ci95(linear.ours, linear.squares)
        if diagnosis.rests and high > 1.0:
            unit, scale = shown(signal)
            how = "better than" if low > 1.0 else "no clearly worse than"
            found.append(
                f"on data held out a linear model ({linear.words}) predicts {signal} {how} the extended model: "
                f"{linear.error * scale:.4g} against {linear.ours_error * scale:.4g} {unit}"
            )
    return found + [
        f"from {item.start:.0f} to {item.end:.0f} s the extended model's error in {item.signal} is "
        f"{item.ratio:.3g} times that in the stretch used: something else happens there"
        for item in diagnosis.elsewhere
    ]
