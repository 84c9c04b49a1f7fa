"""What a set of signals can tell apart in principle, before any number is looked at.

Each group of blocks between two measured signals gives one residual; the tracker gives one more. An effect shows in the
residuals of the groups that hold it: its signature. Effects with different signatures are told apart by where they show;
effects with the same signature only by the shape of what they leave (Krysander and Frisk, structural analysis).
"""

from collections.abc import Collection
from dataclasses import dataclass

from cosim.diagnosis.model.groups import Group, merged
from fmus import registry

BY_TRACKER = ("sensor.gain", "sensor.bias", "sensor.drift", "tracker.clock", "tracker.seam")


@dataclass(frozen=True)
class Isolability:
    """The answer for one set of signals.

    Attributes:
        signatures: effect -> the residuals in which it shows; empty: it cannot be judged.
        classes: effects with one signature, which only their shape tells apart, largest class first.
        advice: signals that would help, each with what it would make visible or separable.
    """

    signatures: dict[str, tuple[str, ...]]
    classes: list[tuple[tuple[str, ...], tuple[str, ...]]]
    advice: list[str]


def residuals(groups: tuple[Group, ...], signals: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Effect -> names of the groups whose residual shows it, for the signals that are measured.

    Groups between which nothing was measured are judged as one.
    """
    found: dict[str, list[str]] = {name: [] for name in registry.effects()}
    for group in merged(groups, signals):
        if group.drive in signals and group.observed[0] in signals:
            for effect in group.effects():
                found[effect.name].append(group.name)
    if "slew_external" in signals and "slew" in signals:
        for name in BY_TRACKER:
            found[name].append("tracker")
    return {name: tuple(where) for name, where in found.items()}


def isolability(groups: tuple[Group, ...], signals: Collection[str]) -> Isolability:
    """What these signals can tell apart, and which further signal would help.

    Args:
        groups: the groups of the model.
        signals: names of the measured signals; ``slew_external`` stands for a tracker's record.
    """
    now = residuals(groups, signals)
    classes: dict[tuple[str, ...], list[str]] = {}
    for name, where in now.items():
        classes.setdefault(where, []).append(name)
    listed = [(where, tuple(names)) for where, names in classes.items() if where]
    listed.sort(key=lambda item: -len(item[1]))
    advice = []
    wanted = {s for g in groups for s in (g.drive, *g.observed)} | {"slew_external"}
    for signal in sorted(wanted - set(signals)):
        then = residuals(groups, {*signals, signal})
        visible = [n for n in now if not now[n] and then[n]]
        apart = [n for n in now if now[n] and now[n] != then[n]]
        if visible:
            advice.append(f"{signal} would make visible: {', '.join(visible)}")
        if apart:
            advice.append(f"{signal} would separate from their neighbours: {', '.join(apart)}")
    return Isolability(now, listed, advice)
