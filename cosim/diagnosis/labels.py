"""A log held against its own labels, before any physical cause is looked for.

A unit that is off by a known factor, a reversed sign, two columns exchanged, a signal that never moves or a clock in another
unit change what a block seems to do far beyond any fault: its gain against the nominal model is off by that factor, and the
shape is right all the same. Each such mistake is tried, and told if it alone makes all blocks plausible.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.at_rest import nothing_moves, on_the_command
from cosim.diagnosis.fitting.bounds import absurd
from cosim.diagnosis.fitting.group_model import GroupModel
from cosim.diagnosis.model.groups import Group, merged
from cosim.diagnosis.model.machine import Machine, our_machine
from cosim.diagnosis.record.grid import window_span
from cosim.diagnosis.record.record import Record, fixed_values
from cosim.diagnosis.thresholds import (
    AT_END,
    AT_ZERO,
    BALANCE,
    BEYOND_RANGE,
    CLOCK_BETTER,
    CLOCK_SHAPE,
    FEWEST_AT_END,
    FEWEST_BLOCKS,
    MOVES,
    NEAR_TURN,
    NOISY,
    PLAUSIBLE_SPAN,
    PLAUSIBLE_STEP,
    REPEATED,
    SHAPE,
    SHAPE_ABOVE,
    STILL,
    TRACKER_LEFT,
    USUAL_GAIN,
    WRAPS,
)
from cosim.diagnosis.tracker.comparison import TrackerFinding, compare_tracker
from cosim.diagnosis.verdict.verdict import Cause
from cosim.errors import CosimError, DataError
from cosim.logs import Log, Tracker
from cosim.logs.repair import wide_intervals
from cosim.signals import SIGNALS
from cosim.units import factor

Array = NDArray[np.float64]
Signals = Mapping[str, Array]
Shapes = list[tuple[float, float]]  # gain and correlation of each block

UNITS = {
    "rad": ("deg", "rad"),
    "m": ("m", "cm", "mm", "in"),
    "Pa": ("Pa", "kPa", "MPa", "bar", "psi"),
    "1": ("1", "%"),
    "rad/s": ("deg/s", "rad/s"),
}
WHOLE = {"simplified": "full_order"}
"""Model of the crane that reads few signals -> the one that reads all."""

TIMES = {"ms labelled s": 1e-3, "us labelled s": 1e-6, "min labelled s": 60.0, "s labelled ms": 1e3}


@dataclass(frozen=True)
class Contradiction:
    """A label that the data contradict.

    Attributes:
        signal: the signal, "time" for the clock.
        finding: in words.
        factor: by which its values are too large as labelled; None where it is no factor.
        remedy: what to do.
    """

    signal: str
    finding: str
    remedy: str
    factor: float | None = None


@dataclass(frozen=True)
class Mistake:
    """A mistake in the labels that is tried.

    Attributes:
        reported: what would be said of it.
        undone: signals as they would be without it.
        exact: true only if all blocks answer as they should without it, not those alone that were beyond all faults.
    """

    reported: Contradiction
    undone: Callable[[Signals], dict[str, Array]] = field(repr=False)
    exact: bool = False


def contradictions(log: Log, record: Record, machine: Machine, trusted: bool) -> list[Contradiction]:
    """What the data say against their labels; nothing for nearly every log.

    Args:
        log: the log as read.
        record: the same prepared.
        machine: the model.
        trusted: its nominal parameters are known; of one whose gains are not only the signs can be held against the log.
    """
    found = [*still(record, machine), *wrapping(record), *saturated(log)]
    # the noise of signals at rest has neither gain nor shape
    if found or nothing_moves(record, machine):
        return found
    groups, base = merged(machine.groups, record.signals), machine.base
    as_labelled = shapes(record, record.signals, groups, base)
    usual = USUAL_GAIN if trusted else (0.0, np.inf)
    # the command passes a dead zone and limits: a wrong unit of it spoils the shape, not the gain
    command = record.signals[machine.drive]
    commanding = machine.drive != "u" or commands(command)
    spoiled = bool(as_labelled) and not (commanding and abs(as_labelled[0][1]) >= SHAPE)
    # of a reading where no machine is, the model can be that far off that its shape tells nothing
    strange = [name for name in record.signals if not in_range(record.signals, name)]
    odd = not plausible(as_labelled, usual) or (trusted and (spoiled or bool(strange)))
    # a column that is another one's spoils a shape, too, and not that of the first block alone
    foreign = trusted and not (commanding and all(abs(r) >= SHAPE for _, r in as_labelled))
    if not odd and not foreign:
        return exchanged_with_supply(record.signals)
    mistakes = [*signs(record, groups)] if odd else []
    if trusted:
        mistakes += [*(units(log, record, machine.drive) if odd else []), *exchanges(log, record)]
    told = []
    for mistake in mistakes:
        undone = mistake.undone(record.signals)
        # a label that leaves the command where it cannot be is not the one that is wrong
        if not in_range(undone, machine.drive):
            continue
        each = shapes(record, undone, groups, base)
        if not plausible(as_labelled, usual) and not mistake.exact:
            right = cured(as_labelled, each, usual)
        else:
            right = shaped(each, commanding) and all(in_range(undone, name) for name in strange)
        if right:
            told.append(((round(min(r for _, r in each), 3), -off(each)), mistake))
    if told:
        return [either_sign(max(told, key=lambda item: item[0])[1].reported, groups)]
    return exchanged_with_supply(record.signals) or (other_machine(as_labelled) if trusted and odd else [])


def whole(machine: Machine, trusted: bool) -> Machine:
    """The model against which a log's labels are held: of the crane the one that reads all signals.

    Of a machine that is not the crane nothing is known of what its model does not read.
    """
    known = trusted and machine.name in WHOLE and not machine.base
    return our_machine(WHOLE[machine.name]) if known else machine


def cured(before: Shapes, after: Shapes, usual: tuple[float, float]) -> bool:
    """True if the blocks whose gain was beyond all faults answer as they should, and no other does worse.

    Args:
        before: gain and correlation of each block as labelled.
        after: the same with the labels changed.
        usual: gains that are not beyond all faults.
    """
    return (
        len(before) == len(after)
        and plausible(after, usual)
        and all(
            usual[0] <= gain <= usual[1] and r >= SHAPE_ABOVE
            for was, (gain, r) in zip(before, after, strict=True)
            if beyond(was, usual)
        )
    )


def shaped(after: Shapes, commanding: bool) -> bool:
    """True if shape and gain of all blocks are right, of the first one only where the command was none as labelled."""
    firm = after if commanding else after[:1]
    return (
        bool(after)
        and plausible(after, USUAL_GAIN)
        and all(USUAL_GAIN[0] <= gain <= USUAL_GAIN[1] and r >= CLOCK_SHAPE for gain, r in firm)
    )


def off(each: Shapes) -> float:
    """How far the gains of the blocks are from the nominal ones, in logarithms."""
    return float(sum(abs(np.log(abs(gain))) for gain, _ in each if gain != 0.0 and np.isfinite(gain)))


def either_sign(told: Contradiction, groups: tuple[Group, ...]) -> Contradiction:
    """A reversed sign as the data tell it: where one group only was measured, command and answer go against one another."""
    drive, answer = groups[0].drive, groups[0].observed[0]
    if told.factor != -1.0 or len(groups) > 1:
        return told
    finding = f"{drive} and {answer} go against one another: one of the two looks reversed in sign"
    remedy = f"give {drive} or {answer} the other sign: gain = -1 in its table of a mapping"
    return replace(told, finding=finding, remedy=remedy)


def in_range(signals: Signals, name: str) -> bool:
    """True if a signal keeps to its plausible range, or half as much again."""
    most = float(np.max(np.abs(signals[name])))
    return name not in SIGNALS or most <= BEYOND_RANGE * max(abs(SIGNALS[name].low), abs(SIGNALS[name].high))


def of_machine(record: Record, signals: Signals, group: Group, base: Mapping[str, float]) -> dict[str, Array]:
    """(n,) SI of what a group observes, predicted from its drive among these signals by the machine as it is told to be."""
    own = Record(record.h, dict(signals), record.grid, record.rest)
    told = {n: v for n, v in base.items() if n.partition(".")[0] in group.components}
    model = GroupModel(group, signals[group.drive], record.h, told | fixed_values(own, group), record.grid)
    return model.simulate({})


def shapes(record: Record, signals: Signals, groups: tuple[Group, ...], base: Mapping[str, float]) -> Shapes:
    """Gain and correlation of what tells a group against the nominal prediction, as far as it was measured.

    Args:
        record: the log.
        signals: its signals, or what they would be under other labels.
        groups: the groups.
        base: ``component.parameter`` -> SI in which the machine differs from what its blocks declare.
    """
    found = []
    for group in groups:
        if group.drive not in signals or group.observed[0] not in signals:
            continue
        simulated = of_machine(record, signals, group, base)
        for name in (n for n in group.telling if n in signals):
            rows = [centred(v, record.h, group.integrates) for v in (signals[name], simulated[name])]
            sizes = [float(np.sqrt(row @ row)) for row in rows]
            if sizes[0] <= 0.0 or not np.all(np.isfinite(sizes)):
                continue
            if sizes[1] <= 0.0:  # the model would stand still
                found.append((np.inf, 0.0))
                continue
            product = float(rows[0] @ rows[1])
            found.append((product / sizes[1] ** 2, product / (sizes[0] * sizes[1])))
    return found


def centred(values: Array, h: float, windows: bool) -> Array:
    """A signal without its mean, or each of its windows of some 5 s without its own where it drifts."""
    count = max(1, round(values.size * h / window_span(h))) if windows else 1
    return np.concatenate([part - part.mean() for part in np.array_split(values, count)])


def plausible(each: Shapes, usual: tuple[float, float] = USUAL_GAIN) -> bool:
    """True if no block's gain is beyond all faults while its shape is right.

    Args:
        each: gain and correlation of each block.
        usual: gains that are not beyond all faults; of a machine whose gains are not known any positive one.
    """
    return not any(beyond(one, usual) for one in each)


def beyond(one: tuple[float, float], usual: tuple[float, float]) -> bool:
    """True if a block's gain is beyond all faults while its shape is right.

    Faults take from a motion and from its shape, and none adds to it: of too much motion a poorer shape is right.
    """
    gain, r = one
    if usual[0] <= gain <= usual[1]:
        return False
    return abs(r) >= (SHAPE_ABOVE if gain > usual[1] else SHAPE)


def scaled(names: tuple[str, ...], by: float) -> Callable[[Signals], dict[str, Array]]:
    """Signals with some of them divided by a factor; the load pressure follows its ports."""

    def undone(signals: Signals) -> dict[str, Array]:
        return loaded({n: v / by if n in names else v for n, v in signals.items()}, names)

    return undone


def loaded(signals: dict[str, Array], changed: tuple[str, ...]) -> dict[str, Array]:
    """Signals of which some were changed; the load pressure follows its ports."""
    if {"p_a", "p_b"} & set(changed) and {"p_a", "p_b"} <= signals.keys():
        return signals | {"p_load": signals["p_a"] - signals["p_b"]}
    return signals


def signs(record: Record, groups: tuple[Group, ...]) -> Iterator[Mistake]:
    """Each signal with its sign reversed, and the ports of the load pressure exchanged."""
    used = dict.fromkeys(n for g in groups for n in (g.drive, *g.telling) if n in record.signals)
    for name in used:
        if name == "p_load" and "p_a" in record.signals:
            told = Contradiction(
                "p_a", "p_a and p_b look exchanged", "exchange the two columns in the file or the mapping"
            )
        else:
            remedy = f"give {name} the other sign: gain = -1 in its table of a mapping"
            told = Contradiction(name, f"{name} looks reversed in sign", remedy, -1.0)
        yield Mistake(told, scaled((name,), -1.0))


def units(log: Log, record: Record, drive: str) -> Iterator[Mistake]:
    """Each signal of the crane in each other unit of its dimension, but for a command that is one as labelled only."""
    pressures = tuple(n for n in ("p_a", "p_b") if n in record.signals)
    single = [(n,) for n in record.signals if n in SIGNALS and n not in ("p_load", "p_supply")]
    for names in [pressures, *single] if len(pressures) == 2 else single:
        si = SIGNALS[names[0]].si
        who = " and ".join(names)
        # the unit in which people read it is the likeliest to have been meant or written
        usual = log.display.get(names[0], SIGNALS[names[0]].unit)
        pairs = sorted(permutations(UNITS.get(si, ()), 2), key=lambda pair: usual not in pair)
        seen: list[float] = []
        for labelled, true in pairs:
            by = factor(labelled, si) / factor(true, si)
            # what a fault may do twice over is no proof of another unit
            if USUAL_GAIN[0] ** 2 <= by <= USUAL_GAIN[1] ** 2 or any(
                abs(by / other - 1.0) < 1e-6 for other in seen
            ):
                continue
            seen.append(by)
            if (
                names == (drive,)
                and commands(record.signals[drive])
                and not commands(record.signals[drive] / by)
            ):
                continue
            told = Contradiction(
                names[0], f"{who}: looks like {true} labelled {labelled}", f"label {who} [{true}]", by
            )
            yield Mistake(told, scaled(names, by))


def exchanges(log: Log, record: Record) -> Iterator[Mistake]:
    """Each two columns of different signals exchanged, the numbers in the units of their headings."""

    def undone(one: str, other: str, by: float) -> Callable[[Signals], dict[str, Array]]:
        def made(signals: Signals) -> dict[str, Array]:
            exchanged = {one: signals[other] / by, other: signals[one] * by}
            return loaded({**signals, **exchanged}, (one, other))

        return made

    named = [n for n in record.signals if n in SIGNALS and n in log.signals]
    for one, other in combinations(named, 2):
        # ports are exchanged by their sign, a port and the supply by their sum
        if SIGNALS[one].si != SIGNALS[other].si:
            by = unit_of(log, other) / unit_of(log, one)
            told = Contradiction(
                one,
                f"{one} and {other} look exchanged",
                "exchange the two columns in the file or the mapping",
            )
            yield Mistake(told, undone(one, other, by), exact=True)


def unit_of(log: Log, name: str) -> float:
    """The unit of a signal's column in SI."""
    return factor(log.display.get(name, SIGNALS[name].unit), SIGNALS[name].si)


def commands(u: Array) -> bool:
    """True if a command is one as its range says: more than none, and not beyond all of it."""
    return AT_ZERO < float(np.max(np.abs(u))) <= BEYOND_RANGE * SIGNALS["u"].high


def exchanged_with_supply(signals: Signals) -> list[Contradiction]:
    """A port's pressure and the supply's exchanged: p_a + p_b = p_supply then holds the other way round only."""
    if not {"p_a", "p_b", "p_supply"} <= set(signals):
        return []
    means = {n: float(np.mean(signals[n])) for n in ("p_a", "p_b", "p_supply")}
    whole = max(abs(v) for v in means.values())

    def error(port: str, other: str, supply: str) -> float:
        return abs(means[port] + means[other] - means[supply]) / max(whole, 1e-300)

    if error("p_a", "p_b", "p_supply") < BALANCE[1]:
        return []
    for port, other in (("p_a", "p_b"), ("p_b", "p_a")):
        if error("p_supply", other, port) < BALANCE[0]:
            finding = f"{port} and p_supply look exchanged"
            return [Contradiction(port, finding, "exchange the two columns in the file or the mapping")]
    return []


def still(record: Record, machine: Machine) -> Iterator[Contradiction]:
    """Signals that never move although the others do."""
    moving = {n: float(np.ptp(v)) > 0.0 for n, v in record.signals.items()}
    remedy = "check sensor and wiring, or leave the column out"
    if not moving[machine.drive] and not answered(record, machine):
        yield Contradiction(
            machine.drive, f"{machine.drive} never moves", "check that this column is the command"
        )
        return
    for one, other in (("p_a", "p_b"), ("p_b", "p_a")):
        if not moving.get(one, True) and moving.get(other, False):
            yield Contradiction(one, f"{one} never moves", remedy)
    for group in merged(machine.groups, record.signals):
        name = group.observed[0]
        if moving.get(name, True) or group.drive not in record.signals or name not in SIGNALS:
            continue
        # what integrates a drive that never moves would run away on the least zero of that sensor
        if group.drive != machine.drive and not moving[group.drive]:
            continue
        most = SIGNALS[name].high - SIGNALS[name].low
        if float(np.ptp(of_machine(record, record.signals, group, machine.base)[name])) > MOVES * most:
            yield Contradiction(name, f"{name} never moves", remedy)


def answered(record: Record, machine: Machine) -> bool:
    """True if whatever moves does so as the model does on the command, a constant one or none."""
    predicted = on_the_command(record, machine)
    for group in machine.groups:
        name = group.observed[0]
        if name not in record.signals:
            continue
        measured = record.smooth(name)
        if name in SIGNALS and np.ptp(measured) <= STILL * (SIGNALS[name].high - SIGNALS[name].low):
            continue
        rows = [centred(values, record.h, group.integrates) for values in (measured, predicted[name])]
        sizes = [float(np.sqrt(row @ row)) for row in rows]
        if not float(rows[0] @ rows[1]) >= SHAPE * sizes[0] * sizes[1] > 0.0:
            return False
    return True


def other_machine(each: Shapes) -> list[Contradiction]:
    """A log of another machine: not one of its blocks answers as the model's, however wrong a single one may be."""
    if len(each) < FEWEST_BLOCKS or any(USUAL_GAIN[0] <= abs(gain) <= USUAL_GAIN[1] for gain, _ in each):
        return []
    gains = ", ".join(f"{gain:.3g}" for gain, _ in each)
    finding = f"no block answers as the model's does (gain over the model's, block by block: {gains})"
    return [Contradiction("all", finding, "check that log, mapping and model are of one machine")]


def saturated(log: Log) -> Iterator[Contradiction]:
    """Readings without a stop of their own that end at one value, exactly, while elsewhere each sample has noise.

    A spool on its stop or a pressure at its relief still shows the noise of its sensor. The slew sensor's own
    saturation is a cause of the library.
    """
    for name in ("spool", "p_a", "p_b"):
        values = log.signals.get(name)
        if values is None or values.size < FEWEST_AT_END:
            continue
        steps = np.diff(values)
        ends = (values == values.max()) | (values == values.min())
        moving = steps[~(ends[1:] & ends[:-1])]
        for side, end in (("highest", values.max()), ("lowest", values.min())):
            at = values == end
            held = at[1:] & at[:-1]
            if held.sum() < max(FEWEST_AT_END, AT_END * values.size) or moving.size < FEWEST_AT_END:
                continue
            # neither readings in steps, nor stale ones, nor a simulation without noise
            turns = np.mean(np.sign(moving[1:]) * np.sign(moving[:-1]) < 0.0)
            if np.mean(moving == 0.0) < REPEATED and turns > NOISY:
                share = 100.0 * float(at.mean())
                yield Contradiction(
                    name,
                    f"{name} saturates: {share:.3g} % of its samples are its {side} value, without noise",
                    "record with a larger range of the sensor, or leave the column out",
                )


def wrapping(record: Record) -> Iterator[Contradiction]:
    """Angles that jump by a whole turn; what moved while samples are missing is no jump."""
    intervals = np.diff(record.time)
    gaps, _ = wide_intervals(intervals)
    together = ~np.isin(np.arange(intervals.size), gaps)
    for name, values in record.signals.items():
        if name not in SIGNALS or SIGNALS[name].si != "rad":
            continue
        jumps = np.abs(np.diff(values))[together]
        for turn, unit in ((2.0 * np.pi, "360 deg"), (360.0, "360 rad")):
            near = np.abs(jumps - turn) < NEAR_TURN * turn
            # what lies between is smooth
            if near.sum() >= WRAPS and np.quantile(jumps[~near], 0.999) < NEAR_TURN * turn:
                finding = f"{name} wraps: it jumps by {unit} {int(near.sum())} times"
                yield Contradiction(
                    name, finding, "say so in the mapping: period = 360 of an angle in degrees"
                )


def rescaled(log: Log, scale: float) -> Log:
    """The log with its time from zero, times a factor."""
    return replace(log, time=(log.time - log.time[0]) * scale)


def clock(
    log: Log, prepared: Callable[[Log], Record], machine: Machine, trusted: bool
) -> list[Contradiction]:
    """The clock in another unit than it claims: only then do the blocks move as they do.

    Args:
        log: the log as read, its time in s.
        prepared: makes it ready.
        machine: the model.
        trusted: its nominal parameters are known.
    """
    if not trusted or machine.drive not in log or log.time_unit != "s":
        return []
    for said, scale in TIMES.items():
        span = log.duration * scale
        # as labelled it is no log of such a machine, and in the other unit it is
        (shortest, longest), (finest, coarsest) = PLAUSIBLE_SPAN, PLAUSIBLE_STEP
        likely = shortest <= span <= longest and finest <= log.step * scale <= coarsest
        if not likely or finest <= log.step <= coarsest:
            continue
        try:
            read = [prepared(one) for one in (log, rescaled(log, scale))]
        except CosimError:
            continue
        before, after = (shapes(r, r.signals, merged(machine.groups, r.signals), machine.base) for r in read)
        right = any(USUAL_GAIN[0] <= gain <= USUAL_GAIN[1] and r >= CLOCK_SHAPE for gain, r in after)
        # of friction a block may move next to nothing; too much, or the other way, is no fault
        if (
            right
            and plausible(after, (0.0, USUAL_GAIN[1]))
            and answering(after) > answering(before) + CLOCK_BETTER
        ):
            true = said.partition(" ")[0]
            return [
                Contradiction(
                    "time", f"time looks like {said}", f"label the column time [{true}]", 1.0 / scale
                )
            ]
    return []


def answering(each: Shapes) -> float:
    """Mean correlation of the blocks, of those whose gain is beyond all faults none."""
    rows = [max(r, 0.0) * (USUAL_GAIN[0] <= gain <= USUAL_GAIN[1]) for gain, r in each]
    return float(np.mean(rows)) if rows else 0.0


def against_tracker(record: Record, tracker: Tracker, seen: TrackerFinding) -> list[Contradiction]:
    """An external tracker in another unit, of another sign or with another clock than the log.

    Args:
        record: the log.
        tracker: the tracker's record.
        seen: how the two compare as labelled.
    """
    strange = next((c for c in seen.causes if impossible_of(c)), None)
    left = misfit(seen)
    if strange is None and left < TRACKER_LEFT:
        return []
    for finding, remedy, by in (
        ("slew_external: looks like rad labelled deg", "label slew_external [rad]", np.pi / 180.0),
        ("slew_external: looks like deg labelled rad", "label slew_external [deg]", 180.0 / np.pi),
        ("slew_external looks reversed in sign against slew", "give one of the two the other sign", -1.0),
    ):
        try:
            other = compare_tracker(record, replace(tracker, slew_external=tracker.slew_external / by))
        except DataError:
            continue
        if misfit(other) < min(TRACKER_LEFT, 0.5 * left) and not any(map(impossible_of, other.causes)):
            return [Contradiction("slew_external", finding, remedy, by)]
    if strange is None:
        return []
    sizes = ", ".join(f"{p} = {v:.3g}" for p, (v, _) in strange.parameters.items())
    finding = f"slew and slew_external do not fit together: {strange.effect.name} would be {sizes}"
    return [Contradiction("slew_external", finding, "check units, signs and clocks of both files")]


def impossible_of(cause: Cause) -> bool:
    """True if what a tracker shows of the slew sensor or its own clock has a size that cannot be."""
    sizes = {p: value for p, (value, _) in cause.parameters.items()}
    return absurd(cause.effect, sizes, {"gain": 1.0, "rate": 1.0})


def misfit(seen: TrackerFinding) -> float:
    """What the comparison with a tracker leaves, in parts of how far the tracker sees it move."""
    return float(np.std(seen.measured - seen.predicted) / max(float(np.std(seen.measured)), 1e-300))
