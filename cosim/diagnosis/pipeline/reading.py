"""What the tracker tells of the slew sensor, and what the blocks tell of it in turn: each is judged knowing the other."""

from dataclasses import replace

from cosim.diagnosis.found import Diagnosis
from cosim.diagnosis.thresholds import SENSOR_MOVED
from cosim.diagnosis.tracker.comparison import TrackerFinding, compare_tracker
from cosim.logs import Tracker


def take_over(found: Diagnosis, seen: TrackerFinding) -> None:
    """What the tracker says, in place of what it said before; effects that it has settled are no candidates any more."""
    before = found.tracker
    if before is not None:
        found.causes = [c for c in found.causes if c not in before.causes]
        found.never = [n for n in found.never if n not in before.never]
    found.tracker = seen
    found.never += seen.never
    found.causes += seen.causes
    known = {"sensor.gain", "sensor.bias", "sensor.drift"}
    found.groups = tuple(
        replace(g, excluded=(*g.excluded, *sorted(known - set(g.excluded)))) for g in found.groups
    )


def known_of(found: Diagnosis) -> dict[str, float]:
    """``component.parameter`` -> SI that is known before any block is judged: the base, and the sensor's errors."""
    seen = {} if found.tracker is None else found.tracker.fit.values
    return dict(found.machine.base) | {n: v for n, v in seen.items() if n.startswith("sensor.")}


def clear_of_lag(found: Diagnosis, tracker: Tracker) -> bool:
    """Compare with the tracker anew where the slew sensor turns out to lag; True if all blocks are to be judged again.

    A lag is seen between command and slew only: against a tracker with a clock of its own it passes for an offset of that
    clock, and what it takes from the motion for a wrong scale of the sensor.
    """
    lag = next((c.parameters["tau_l"] for c in found.causes if c.effect.name == "sensor.lag"), None)
    if lag is None:
        return False
    before = known_of(found)
    take_over(found, compare_tracker(found.record, tracker, lag))
    assert found.tracker is not None
    spread, after = found.tracker.fit.deviations, known_of(found)
    same = set(before) == set(after) and all(
        abs(v - before[n]) <= SENSOR_MOVED * spread[n] for n, v in after.items() if n in spread
    )
    if not same:
        seen = found.tracker
        found.findings, found.unjudged, found.refused, found.rests = {}, {}, [], []
        found.causes, found.never = list(seen.causes), list(seen.never)
    return not same
