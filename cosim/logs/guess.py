"""Which column is which signal, by name (in several languages), unit, range and shape; and a mapping that says so.

A guess is a line for a person to check: it is written into a mapping with its reason, never used unseen.
"""

import hashlib
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.errors import UsageError
from cosim.logs.clocks import plain
from cosim.logs.overview import Array, Column, Overview, longest
from cosim.signals import SIGNALS, conversion

# parts of words without accents: German, English, French, Spanish, Portuguese, Italian, Dutch, Scandinavian, Finnish, Polish
_PRESSURE = (
    r"pressure|druck|pression|presion|pressione|pressao|\bdruk|tryk|tryck|paine|cisnien|\bp\b|\bpress\b"
    r"|gauge|manomet|\bp[gt]\b(?= \d|$)"
)
# a plant's tags (ISA-5.1): FT 211 measures a flow, FV 211 is its valve
_FLOW = r"\bf[it] \d+$|flow|durchfl|volumenstrom|debit|caudal|vazao|portata|debiet"
_ESTIMATE = r"estimat|schatz|observ|beobacht|estimad|stima"
_RATE = (
    r"rate|speed|velocity|\bvelo?\b|geschw|drehzahl|vitesse|velocidad|velocit|hastig|snelheid|nopeus|predkosc|omega"
    r"|torque|moment|\b(dd?q|qdd?|qdot)\b"
)
_COMMAND = (
    r"command|\bcmd\b|befehl|ansteuer|stell|sollwert|setpoint|joystick|comand|controle|consigne"
    r"|orden|kommando|stuur|styr|ohjaus"
    r"|control(ler)? (effort|signal|output|action)"
    r"|sterow|duty|\bpwm\b|\b(f|l|t|fc|lc|pc|tc)v \d+$"
)
# what a controller is given, which is the command only where nothing says what it made of it
_SET = r"sollwert|setpoint|consigne"
_DRIVES = rf"{_COMMAND}|\bu\b|ventil|valve|valvula|soupape|\bklep"
# what a command may be called where nothing is called a command
_INPUT = (
    r"(?<!analog )(?<!digital )\binput\b(?! ?\d)|\beingang\b|\bentrada\b|\bentree\b|\bingresso\b"
    r"|\bthrottle\b(?! ?(angle|position|pos)\b)|\bsteering\b(?!.*(angle|rate|torque|wheel))"
    r"|\b(motor|anker|armature) ?(spannung|volt)|\besc\b|\bservo\b(?!.*(current|strom|volt|spannung))"
)
_VOLTAGE = r"volt|spannung"
# what a drive is fed with
_FED = r"\bpsu\b|batter|\bvbat\b|\bvin\b|\bvcc\b|(supply|input|bus|link|versorgungs|zwischenkreis) ?(volt|spannung)"
# what was asked for, not what was measured
_REFERENCE = r"\bref\b|referen|\btarget\b|\bgoal\b|\bsoll|desired|commanded|\bdes$|demand|\bset\b|gewenst"
# what was measured of it, where both have a name
_AS_MEASURED = (
    r"^(actual|act|measured|meas|feedback|fb|fbk|present|current|real|ist|istwert|istlage|mesure|medido"
    r"|encoder|sensor)$"
)
_ANGLE = (
    r"slew|swing|schwenk|dreh|winkel|angle|angul|angolo|vinkel|kulma|hoek\b|\bkat\b|rotat|\bgiro|theta|\bphi\b|\bpsi\b|\bang\b"
    r"|\bq \d+\b"  # a robot's joint; a flow has its unit beside
    r"|\bpan\b|\byaw\b|azimut|\bheading\b|\bencoder|drehgeber"
)
# of a command: the place that a controller is to reach, rather than what it made of it
_OF_PLACE = r"\bpos\b|position|posicion|posicao|posizione|positie|\blage\b"
# axes of a machine that slews as well: their commands and angles are none of the slew drive
_OTHER_AXES = (
    r"\b(boom|arm|stick|dipper|bucket|bkt|blade|jib|tilt|ausleger|stiel|loffel|fleche|balancier|godet)\b"
)
_TURNS = {"deg": 360, "rad": 6.283185307, "turn": 1}  # unit of an angle -> how much of it is a turn
_ENCODER = re.compile(r"\bencoder|drehgeber")
NAMES: dict[str, str] = {
    "slew_estimate": rf"^(?=.*({_ESTIMATE}))(?=.*({_ANGLE}))(?!.*({_RATE}))",
    "slew_rate_estimate": rf"^(?=.*({_ESTIMATE}))(?=.*({_RATE}))",
    "slew": rf"^(?=.*({_ANGLE}))(?!.*({_RATE}|{_ESTIMATE}|{_COMMAND}|{_REFERENCE}))",
    # "pressure Pa" ends in its unit
    "p_supply": rf"^(?!.*({_FLOW}))(?:(?=.*({_PRESSURE}))(?=.*(supply|pump|versorg|system|speise|aliment|bomba|tilfor"
    r"|matning|syotto|zasil|\bs\b|\bp\s?[0p]\b))|.*\bps\b)",
    "p_a": rf"^(?!.*({_FLOW}))(?:(?=.*({_PRESSURE}))(?=.*\ba\b)|(?!.*({_PRESSURE}).*\bpa\b).*\bpa\b)",
    "p_b": rf"^(?!.*({_FLOW}))(?:(?=.*({_PRESSURE}))(?=.*\bb\b)|.*\bpb\b)",
    "spool": r"spool|schieber|tiroir|corredera|cassetto|sleide|\bslid|luisti|suwak|ventilweg|valve (position|travel|stroke)",
    "u": rf"^(?!.*({_FED}))(?=.*({_DRIVES}|{_INPUT}))",
}
_POSITION = (
    r"position|\bpos\b|displac|stroke|travel|extension|cylind|zylind|\bhub\b|\bweg\b|\blage\b|\bcourse\b|carrera|corsa"
    r"|posicion|posicao|posizione|positie|\bslag\b|skok|asema"
)
_LENGTH = r"length|lange\b|distance|abstand|height|hohe\b|level"
_SPEED = (
    r"speed|velocity|\bvelo?\b|geschw|drehzahl|\brpm\b|omega|vitesse|velocid|velocita|hastig|hastighet|snelheid|nopeus"
    r"|predkosc|\b(dq|qd|qdot)\b"
)
_NO_MOTION = (
    rf"{_COMMAND}|{_REFERENCE}|{_ESTIMATE}|{_PRESSURE}|spool|schieber|valve|ventil|torque|moment|force|kraft"
    r"|\berr(or)?\b|fehler|abweich"  # what is amiss
)
# what a controller reports of itself in steps: no command either
_STATE = (
    r"status|\bstate\b|zustand|\bflag|enable|freigabe|alarm|\berr\b|error|fehler|fault|\bdigital\b|\bbit\b|\bmode\b"
    r"|limit switch|\blim\b|endschalter|trigger"
)
# what drives an axis where it is measured and no command is
_FRICTION = r"friction|reib|constant|\bmax|\bmin|limit|sensor"
_TORQUE, _FORCE = (
    r"torque|drehmoment|\bmoment|couple\b|coppia|\bpar\b|vaanto|\btau\b|\btrq\b|\btor\b",
    r"force|kraft|fuerza|forza|forca\b|\bvoima",
)
_MEASURED = rf"{_PRESSURE}|spool|temper|\btemp\b|{_TORQUE}|{_FORCE}|{_FED}"  # neither a command nor a motion
_MOTOR = r"motor|\bpwm\b|volt|spannung|current|\bstrom|armature|anker|encoder|\bservo"
# what another machine's axis may show instead of an angle, and its units
MOTIONS: dict[str, tuple[str, tuple[str, ...]]] = {
    "travel": (rf"^(?=.*({_POSITION}))(?!.*({_NO_MOTION}|{_RATE}))", ("m",)),
    "speed": (rf"^(?=.*({_SPEED}))(?!.*({_NO_MOTION}))", ("rad/s", "m/s")),
    "flow": (rf"^(?=.*({_FLOW}|\bq\b))(?!.*({_COMMAND}|{_REFERENCE}|{_ESTIMATE}|temper))", ("m3/s",)),
}
# what drives an axis without a command -> what it may be called, and its unit
DRIVERS: dict[str, tuple[str, str]] = {
    "torque": (rf"^(?=.*({_TORQUE}))(?!.*({_COMMAND}|{_REFERENCE}|{_ESTIMATE}|{_FRICTION}))", "N.m"),
    "force": (rf"^(?=.*({_FORCE}))(?!.*({_COMMAND}|{_REFERENCE}|{_ESTIMATE}|{_FRICTION}))", "N"),
}
# kind of quantity -> what a name or description of one may say
KINDS: dict[str, str] = {
    "command": rf"{_COMMAND}|\bu\b|{_INPUT}|valve (opening|signal)|controller output|stellgrosse",
    "reference": rf"{_REFERENCE}|setpoint|sollwert|consigne",
    "estimate": _ESTIMATE,
    "error": r"\berr(or)?\b|fehler|abweich|deviation",
    "pressure": _PRESSURE,
    "flow": _FLOW,
    "torque": _TORQUE,
    "force": _FORCE,
    "speed": rf"{_SPEED}|\brate\b",
    "angle": _ANGLE,
    "place": rf"{_POSITION}|{_LENGTH}",
    "current": r"current|\bstrom\b|\bi [abcq]\b",
    "temperature": r"temper|\btemp\b",
}
AT_ONCE = ("speed", "flow")  # what follows a command itself; of others it is the rate of change
ELECTRIC = ("V", "mV", "A", "mA")
RAW = (*ELECTRIC, "us")  # of a command: needs a gain; a servo's pulse in us
OPPOSITE = (  # words by which the two columns of a command differ that has one for each direction
    ({"up"}, {"down", "dn"}),
    ({"in"}, {"out"}),
    ({"left", "l"}, {"right", "r"}),
    ({"forward", "forwards", "fwd"}, {"backward", "backwards", "back", "bwd", "reverse", "rev"}),
    ({"extend", "ext", "extension", "extending"}, {"retract", "ret", "retraction", "retracting"}),
    ({"raise", "lift"}, {"lower"}),
    ({"pos", "plus"}, {"neg", "minus"}),
    ({"ccw"}, {"cw"}),
    ({"a"}, {"b"}),
    ({"auf", "heben"}, {"ab", "senken"}),
    ({"links"}, {"rechts"}),
    ({"vor"}, {"zuruck"}),
    ({"ein"}, {"aus"}),
)
# how names tell the two chambers of a cylinder apart: the side of the piston and that of the rod
SIDES = (
    ({"h", "head", "cap", "bore", "piston", "base", "blind", "kolben", "boden", "kolbenseite", "bodenseite"},
     {"r", "rod", "ring", "stange", "annulus", "kolbenstange", "stangenseite", "ringseite"}),
)  # fmt: skip
_CHAMBER = r"\bcyl|zylind|chamber|kammer|load|port|head|\brod\b|kolben|stange"
_PILOT = r"pilot|vorsteuer|epp?r|errp|pump|supply|tank|return|ruecklauf|rucklauf|accu|speicher"
_PORTS = ("p_supply", "p_a", "p_b")
FASTEST = 630.0  # rad/s, 6000 rpm: a servo motor's; a larger number counts revolutions a minute
HIGHEST = 750.0  # bar that oil of machines reaches, at presses and tools
GENERIC = {
    "var",
    "data",
    "ch",
    "chan",
    "channel",
    "col",
    "column",
    "signal",
    "sig",
    "yout",
    "xout",
    "simout",
    "unnamed",
    "value",
    "out",
    "port",
    "ai",
    "y",
    "output",
    "saida",
    "ausgang",
    "salida",
    "sortie",
    "uscita",
    "response",
    "measured",
    "measurement",
    "reading",
}
RESTING, OFF_ZERO, STILL = (
    0.2,
    0.05,
    0.2,
)  # a neutral command: share of samples, part of the range, of the motion
OPPOSED, FOLLOWS, DRIVEN = 0.9, 0.8, 0.6  # correlations from which on columns are said to move together
LACKING = 0.01  # of a column's values, beyond which nothing is held against it
LED = 0.3  # correlation from which on an axis of several is taken for that of a command
# what parts the names of two records in one file -> what the second has in its place
SECOND = (
    (r"\bid\b", "val"),
    (r"_?[eE]st(?![a-z])", lambda m: m[0].replace("Est", "Val").replace("est", "val")),
    (r"[tT]rain(?![a-z])", lambda m: "Test" if m[0][0] == "T" else "test"),
    (r"[tT]rain(?![a-z])", lambda m: "Val" if m[0][0] == "T" else "val"),
)
TOGETHER = 0.5  # correlation beyond which two columns drive at the same time: the two directions of one command never do
BY_ITSELF = 0.5  # part of an integrator's misfit that a column which falls back by itself leaves
WHOLE = 0.8  # of a column's range: jumps by so much begin it anew
CHANNELS = 16  # most that a recorder without names has
FINE = 20000  # stretches of a log in which it is looked for what moves first
STRETCHES, LAGS = (
    2000,
    60,
)  # a log is averaged in so many stretches; a spool or angle may lag by so many of them


OF_MACHINE = {  # in place of the crane's, whose tables and ranges say nothing of another machine
    "u": "command of the valve or motor; 1 is full command",
    "torque": "torque that drives the axis",
    "force": "force that drives the axis",
    "slew": "angle of the axis",
    "travel": "position of a linear axis, such as a cylinder",
    "speed": "speed of the axis",
    "flow": "flow that a valve or pump lets through",
    "spool": "spool position",
    "p_supply": "supply pressure",
    "p_a": "pressure at port A",
    "p_b": "pressure at port B",
}
OTHER = "another machine than the crane? delete the line 'model' and take these marks away (or: cosim init --machine)"


@dataclass(frozen=True)
class Guess:
    """A column taken for a signal.

    Attributes:
        signal: the signal.
        column: the column.
        unit: unit of the value after the scaling.
        gain: factor on the reading.
        why: the reason, in words.
        check: whether the unit or scale is a guess as well.
        zero: reading that counts as none.
        minus: the column of the other direction, whose reading is taken off.
        place: a command that is the place which the drive is to hold.
    """

    signal: str
    column: Column
    unit: str
    gain: float
    why: str
    check: bool
    zero: float = 0.0
    minus: Column | None = None
    place: bool = False


def guesses(found: Overview, machine: bool = False) -> dict[str, Guess]:
    """Signal -> the column that it probably is: by name first, then by unit and shape.

    Args:
        found: the file.
        machine: it is of another machine than the crane, whose axis may show a position or a speed instead of an angle.
    """
    free = [
        c
        for c in found.columns
        if c.index not in found.times
        and c.finite.size
        and c.missing <= c.finite.size
        and c.label.name != "synthetic"
    ]
    made: dict[str, Guess] = {}
    # of several axes: "Swing Cmd" goes with "Swing Ms", and the axis is one whose command moves
    commands = [c for c in free if _score(c, "u") > 0.0]
    driven = {word for c in commands if not c.constant for word in _words(c)}
    shown, axes = "slew", list[Column]()
    shows = ("slew", *MOTIONS) if machine else ("slew",)
    # a speed tells more than a place that begins anew with each turn
    for shown, whole in [(shown, True) for shown in shows] + [(shown, False) for shown in shows]:
        axes = sorted(
            (c for c in free if _score(c, shown) > 0.0 and not (whole and machine and _begins_anew(c))),
            key=lambda c: (not driven & set(_words(c)), -float(np.ptp(c.finite))),
        )
        if axes:
            break
    leading: Column | None = None
    if len(axes) > 1 and not any(driven & set(_words(c)) for c in axes):
        axes, leading = paired(axes, [c for c in commands if not c.constant], shown not in AT_ONCE)
    axis = set(_words(axes[0])) if axes else set()

    def fits(column: Column, signal: str) -> float:
        score = _score(column, signal)
        if score <= 0.0 or (signal == shown and axes and column not in axes):
            return 0.0
        if machine and signal == "slew" != shown and axes:
            return 0.0  # an angle that begins anew, beside a motion that does not
        of_axis = signal == "u" and bool(axis & set(_words(column)))
        other_axis = signal == shown and column not in axes[:1]
        of_axis |= signal == "u" and column is leading
        return score + 0.25 * of_axis - 0.25 * column.constant - 0.25 * other_axis

    ranked = sorted(
        ((fits(c, signal), -c.index, signal, c) for c in free for signal in dict.fromkeys((*NAMES, shown))),
        key=lambda item: (-item[0], -item[1]),
    )
    taken: set[int] = set()
    for score, _, signal, column in ranked:
        if score > 0.0 and signal not in made and column.index not in taken:
            made[signal] = _guess(signal, column, f"its name ('{column.label.short}')")
            taken.add(column.index)
    if machine and "u" in made and (better := as_place(made, [c for c in free if c.index not in taken])):
        taken.add(better.column.index)
        made["u"] = better
    undriven = not {"u", *DRIVERS} & set(made)
    asked = demanded([c for c in free if c.index not in taken], made) if undriven else None
    if machine and asked:
        made["u"] = asked
        taken.add(asked.column.index)
    for signal, column, why in _by_shape([c for c in free if c.index not in taken], made):
        if signal == "u" and asked:
            continue  # a servo's current is what its controller made of the place that it is to hold
        if signal == "slew" and shown in made:
            continue  # the axis has shown itself by name
        if machine and signal == "u" and not column.held:
            driver = driven_by([c for c in free if c.index not in taken], made)
            if driver is not None and driver[1].held:
                continue  # a torque was set in steps, and a voltage or current moves as a reading does
        if machine and signal == "spool" and shown not in made:
            signal = "travel"  # where a length is all that shows a motion, it is the axis'
        made[signal] = _guess(signal, column, why)
        taken.add(column.index)
    if machine:
        other = opposite(made["u"].column, free) if "u" in made else None
        # which of two commands is the positive one says which chamber is port A, whichever of them this log drives
        ways = {"u": both_ways(made["u"], other, moved_by(made))} if other else {}
        for signal, column, why in chambers([c for c in free if c.index not in taken], made | ways):
            made[signal] = _guess(signal, column, why)
            taken.add(column.index)
        if "u" not in made and (driver := driven_by([c for c in free if c.index not in taken], made)):
            made[driver[0]] = _guess(*driver)
            taken.add(driver[1].index)
            if driver[0] == "torque" and "travel" in made:
                place = made.pop("travel")
                made["slew"] = _guess(
                    "slew", place.column, f"{place.why.split(';')[0]}, and a torque turns it"
                )
        left = [c for c in free if c.index not in taken]
        if regulated := demanded_pressure(left, made):
            made["u"] = regulated
            left.remove(regulated.column)
        if alone := pressure_alone(left, made):
            made["p_a"] = _guess("p_a", *alone)
        for signal, column, why in [] if alone else by_cause(left, made):
            made[signal] = _guess(signal, column, why)
            taken.add(column.index)
        made |= {} if made else by_lead(left)
    else:
        for signal, column, why in by_motion([c for c in free if c.index not in taken], made):
            made[signal] = _guess(signal, column, why)
    motion = moved_by(made)
    if "u" in made and made["u"].place:
        pass  # the place of a demanded place is where it is
    elif "u" in made and motion is not None and (zero := neutral(made["u"].column, motion)):
        largest = float(np.max(np.abs(made["u"].column.finite - zero)))
        why = f"{made['u'].why.removesuffix('; unit by its range')}; the machine stands at {zero:g}"
        made["u"] = replace(
            made["u"], unit="1", gain=float(f"{1.0 / largest:.4g}"), why=why, check=True, zero=zero
        )
    elif "u" in made and (other := opposite(made["u"].column, free)):
        made["u"] = both_ways(made["u"], other, motion)
    elif "u" in made and one_sided(made["u"].column):
        why = f"{made['u'].why}; CHECK: no reading is near 0, so `zero` may be missing"
        made["u"] = replace(made["u"], why=why, check=True)
    return {signal: made[signal] for signal in (*SIGNALS, *DRIVERS, *MOTIONS) if signal in made}


def likely(found: Overview) -> tuple[dict[str, Guess], bool]:
    """The guesses for the crane, or, where these miss its command or angle, for another machine that they miss nothing of.

    Returns:
        The guesses, and whether they are those for another machine.
    """
    crane = guesses(found)
    elsewhere = of_other_axis(crane)
    if {"u", "slew"} <= crane.keys() and not elsewhere:
        return crane, False
    other = guesses(found, machine=True)
    driven, moves = {"u", *DRIVERS} & other.keys(), {"slew", *MOTIONS} & other.keys()
    return (other, True) if driven and moves and (elsewhere or len(other) >= len(crane)) else (crane, False)


def of_other_axis(made: dict[str, Guess]) -> str:
    """The column guessed as the slew angle whose name says that it is of another axis, such as a boom; empty if none is."""
    if "slew" not in made:
        return ""
    shown = made["slew"].column.label.shown
    words = plain(made["slew"].column.label.short)
    other = re.search(_OTHER_AXES, words) and not re.search(r"slew|swing|schwenk", words)
    return shown if other else ""


def paired(axes: list[Column], commands: list[Column], rate: bool) -> tuple[list[Column], Column | None]:
    """Of axes and commands that share no word: the axis that follows a command most closely first, and that command."""
    able = [
        (following(command, axis, rate), -axes.index(axis), axis, command)
        for axis in axes
        for command in commands
        if axis.values.size == command.values.size and not (axis.missing or command.missing)
    ]
    if not able or max(able, key=lambda item: item[:2])[0] < LED:
        return axes, None
    _, _, first, command = max(able, key=lambda item: item[:2])
    return [first, *(c for c in axes if c is not first)], command


def moved_by(made: dict[str, Guess]) -> Column | None:
    """What shows where the axis is: an angle, a position, or the sum of a speed; None without one."""
    for signal in ("slew", *MOTIONS):
        if signal in made:
            column = made[signal].column
            return replace(column, values=np.cumsum(column.values)) if signal in AT_ONCE else column
    return None


def neutral(command: Column, motion: Column) -> float:
    """The reading of a command, most often there, at which the machine stands; 0 without one, or where it is near 0.

    A servo's pulse of 7.5 % or a joystick of 2.5 V is no command. A level held while the machine moves is none of these.
    """
    if not command.finite.size or command.missing:
        return 0.0
    levels, counts = np.unique(command.values, return_counts=True)
    level = float(levels[np.argmax(counts)])
    low, high = float(levels[0]), float(levels[-1])
    if counts.max() < RESTING * command.values.size or abs(level) < OFF_ZERO * (high - low):
        return 0.0
    if min(level - low, high - level) < OFF_ZERO * (high - low):  # a valve goes both ways
        return 0.0
    moved = np.abs(np.diff(motion.values))
    there = command.values[:-1] == level
    still, moving = moved[there], moved[~there]
    stands = np.nanmean(still) < STILL * np.nanmean(moving) if still.size and moving.size else False
    return level if stands else 0.0


def opposite(command: Column, free: list[Column]) -> Column | None:
    """The column of a command's other direction: both are never negative and differ by a word such as up and down."""
    own = _words(command)
    for column in free:
        words = _words(column)
        if column is command or len(words) != len(own) or not _score(column, "u") > 0.0:
            continue
        if not command.finite.size or not column.finite.size or column.unit != command.unit:
            continue
        differing = [pair for pair in zip(own, words, strict=True) if pair[0] != pair[1]]
        if len(differing) != 1 or min(command.finite.min(), column.finite.min()) < 0.0:
            continue
        if command.values.size == column.values.size:
            both = np.isfinite(command.values) & np.isfinite(column.values)
            if _correlation(command.values[both], column.values[both]) > TOGETHER:
                continue  # two axes, as the left and right wheel of a vehicle
        one, two = differing[0]
        if any((one in a and two in b) or (one in b and two in a) for a, b in OPPOSITE):
            return column
    return None


def directed(one: Column, other: Column, angle: Column | None) -> tuple[Column, Column]:
    """Of the two columns of a command the one in whose direction the angle grows, and the other."""
    if angle is not None and not (one.missing or other.missing or angle.missing):
        way, back = (replace(one, values=sign * (one.values - other.values)) for sign in (1.0, -1.0))
        if following(back, angle, rate=True) > following(way, angle, rate=True):
            return other, one
    return one, other


def both_ways(guess: Guess, other: Column, angle: Column | None) -> Guess:
    """A command of two columns, one a direction: positive in the direction in which the angle grows."""
    one, other = directed(guess.column, other, angle)
    largest = max((one, other), key=lambda c: float(np.max(np.abs(c.finite))))
    scaled = _guess("u", largest, f"its name ({_called(one)}), and {_called(other)} is the other direction")
    return replace(scaled, column=one, minus=other, check=True)


def chambers(free: list[Column], made: dict[str, Guess]) -> list[tuple[str, Column, str]]:
    """The pressures of the axis' cylinder, where names tell its two chambers apart by a side or a direction.

    ``Boom_UpH_Cyl_P`` and ``Boom_DnR_Cyl_P``: of the boom, raising on the side of the head, lowering on that of the rod.
    Port A is the one that drives in the direction of a positive command, else the head's.
    """
    if {"p_a", "p_b"} & set(made):
        return []
    able = [c for c in free if _pressure(c) and not re.search(_PILOT, plain(c.label.short))]
    named = {w for s in ("u", "slew", *MOTIONS) if s in made for w in _words(made[s].column)}
    found: list[tuple[bool, int, Column, Column, str]] = []
    for k, one in enumerate(able):
        for two in able[k + 1 :]:
            way = _other_side(one, two, set(_words(made["u"].column)) if "u" in made else set())
            if way:
                a, b = (one, two) if way > 0 else (two, one)
                of_axis = len(named & set(_words(one)) & set(_words(two)))
                chamber = bool(re.search(_CHAMBER, plain(one.label.short)))
                found.append((chamber, of_axis, a, b, f"its name, and {_called(b)} is the other chamber"))
    if not found:
        return []
    best = max(item[:2] for item in found)
    likely = [item for item in found if item[:2] == best]
    if len(likely) > 1:
        return []  # of several cylinders: a person knows which
    _, _, a, b, why = likely[0]
    return [("p_a", a, why), ("p_b", b, f"its name, and {_called(a)} is the other chamber")]


def _pressure(column: Column) -> bool:
    """Whether a column is a pressure that moves, by its name or its unit."""
    named = bool(re.search(_PRESSURE, plain(column.label.short))) or column.unit is not None
    fits = named and _fits(column, "p_a")
    return fits and not column.constant and not re.search(_FLOW, plain(column.label.short))


def _other_side(one: Column, two: Column, command: set[str]) -> int:
    """1 where names differ in sides and directions only and the first is port A, -1 where the second is; else 0."""
    words, others = _words(one), _words(two)
    if len(words) != len(others):
        return 0
    differing = [pair for pair in zip(words, others, strict=True) if pair[0] != pair[1]]
    ways: list[int] = []
    for x, y in differing:
        sides = [
            1 if (x in p and y in q) else -1
            for p, q in (*SIDES, *OPPOSITE)
            if (x in p and y in q) or (x in q and y in p)
        ]
        if not sides:
            return 0
        ways.append(1 if x in command else -1 if y in command else sides[0])
    commanded = [way for (x, y), way in zip(differing, ways, strict=True) if {x, y} & command]
    return (commanded or ways or [0])[0]


def one_sided(command: Column) -> bool:
    """Whether no reading of a command is near 0: a joystick of 1 to 4 V, whose 0 is somewhere between."""
    values = command.finite
    if not values.size:
        return False
    low, high = float(np.min(values)), float(np.max(values))
    return max(low, -high) > OFF_ZERO * (high - low) > 0.0


def _score(column: Column, signal: str) -> float:
    """How well a name and unit fit a signal; 0 where they do not."""
    if not _fits(column, signal) or (signal in _PORTS and _asked(column)):
        return 0.0  # what was asked for is no reading
    words = plain(column.label.short)
    if signal in (column.label.name, column.label.alias):
        return 4.0
    # a position that is given in degrees is that of an axis that turns
    turned = (
        signal == "slew"
        and column.unit is not None
        and _convertible(column.unit, "rad")
        and bool(re.search(MOTIONS["travel"][0], words))
    )
    # a unit of rotation a time says what a motor shows, whatever it is called
    turned |= (
        signal == "speed"
        and column.unit is not None
        and _convertible(column.unit, "rad/s")
        and not re.search(_NO_MOTION, words)
    )
    if not turned and not re.search(NAMES[signal] if signal in NAMES else MOTIONS[signal][0], words):
        return 0.0
    weak = signal == "u" and bool(re.search(r"ventil$|valve$", words))  # any valve signal
    weak |= signal == "u" and not re.search(_DRIVES, words)
    # what a controller was given, beside what it made of it
    weak |= signal == "u" and not re.search(_DRIVES, re.sub(_SET, "", words))
    weak |= signal == "u" and bool(re.search(_OF_PLACE, words))
    return 1.0 + (column.unit is not None) - 0.5 * weak


def _shows_motion(column: Column) -> bool:
    """Whether a column's name says that it is what a machine did, in whatever steps it was logged."""
    return any(_score(column, signal) > 0.0 for signal in ("slew", *MOTIONS))


def _measured(column: Column) -> bool:
    """Whether a column's name says that it is a quantity that neither commands nor moves."""
    return bool(re.search(_MEASURED, plain(column.label.short)))


def _state(column: Column) -> bool:
    """Whether a column's name says that it is what a controller reports of itself."""
    return bool(re.search(_STATE, plain(column.label.short)))


def _words(column: Column) -> list[str]:
    return plain(column.label.short).split()


def _fits(column: Column, signal: str) -> bool:
    """Whether a column's unit can be the signal's."""
    if column.unit is None:
        return True
    if signal == "u" and column.unit in RAW:
        return True
    targets = (SIGNALS[signal].si,) if signal in SIGNALS else MOTIONS[signal][1]
    return any(_convertible(column.unit, target) for target in targets)


def _convertible(unit: str, target: str) -> bool:
    try:
        conversion(unit, target)
    except UsageError:
        return False
    return True


def _by_shape(free: list[Column], made: dict[str, Guess]) -> list[tuple[str, Column, str]]:
    """What is left, by unit and shape, where only one reading is possible."""
    told: list[tuple[str, Column, str]] = []
    moving = [c for c in free if not c.constant]
    for signal, unit, what in (("slew", "rad", "an angle"), ("spool", "m", "a length")):
        alone = [
            c
            for c in moving
            if c.unit is not None and _convertible(c.unit, unit) and not (signal == "slew" and _asked(c))
        ]
        if signal not in made and len(alone) == 1 and not _asked(alone[0]):
            told.append(
                (signal, alone[0], f"it is the only column that is {what} and is not named otherwise")
            )
    commands = [
        c
        for c in moving
        if c.held
        and c.unit in (None, "1", "%", *RAW)
        and not (_shows_motion(c) or _measured(c) or _names_other(c))
    ]
    if "u" not in made and len(commands) == 1:
        told.append(("u", commands[0], "it is the only column that moves in steps, as a command does"))
    electric = [c for c in moving if c.unit in ELECTRIC and not re.search(_FED, plain(c.label.short))]
    if "u" not in made and len(commands) != 1 and len(electric) == 1:
        told.append(("u", electric[0], "it is the only voltage or current"))
    pressures = [c for c in free if c.unit is not None and _convertible(c.unit, "Pa")]
    if len(pressures) == 3 and not {"p_supply", "p_a", "p_b"} & set(made):
        supply = max(pressures, key=lambda c: float(np.mean(c.finite)))
        one, two = (c for c in pressures if c is not supply)
        told.append(("p_supply", supply, "it is the highest of three pressures"))
        told += [(name, c, "by the order of the columns") for name, c in (("p_a", one), ("p_b", two))]
    return told


def by_motion(free: list[Column], made: dict[str, Guess]) -> list[tuple[str, Column, str]]:
    """What columns without names and units do together: port pressures add up to the supply's, a spool follows the command.

    Args:
        free: columns that are nothing yet.
        made: the guesses so far.
    """
    alone = [c for c in free if c.unit is None and not c.constant and not c.missing and _nameless(c)]
    command = made["u"].column if "u" in made else None
    told: list[tuple[str, Column, str]] = []
    if not {"p_supply", "p_a", "p_b"} & set(made):
        told += _pressures(alone, command)
    left = [c for c in alone if c not in [column for _, column, _ in told]]
    if command is None or command.missing:
        return told
    for signal, rate, least, why in (
        ("spool", False, FOLLOWS, f"it follows {_called(command)}, as a spool does its command"),
        (
            "slew",
            True,
            DRIVEN,
            f"its rate of change follows {_called(command)}, as that of a slew angle does",
        ),
    ):
        likely = [
            (following(command, c, rate), -c.index, c) for c in left if c.values.size == command.values.size
        ]
        likely = [item for item in likely if item[0] > least]
        if signal not in made and likely:
            column = max(likely)[2]
            told.append((signal, column, why))
            left.remove(column)
    return told


def by_cause(free: list[Column], made: dict[str, Guess]) -> list[tuple[str, Column, str]]:
    """The command and the motion of a machine of its own, where one of them is not told by name: the one follows the other.

    Args:
        free: columns that are nothing yet.
        made: the guesses so far.
    """
    left = [c for c in free if not c.constant and not c.missing]
    told: list[tuple[str, Column, str]] = []
    motion = next((made[signal] for signal in ("slew", *MOTIONS) if signal in made), None)
    command = made["u"].column if "u" in made else None
    asked = [c for c in left if _demand(c)]
    alone = command is None and motion is None and len(asked) == 1
    if alone:
        command = asked[0]
        left.remove(command)
    if command is None and motion is not None and not (motion.column.missing or set(DRIVERS) & set(made)):
        shown = motion.column
        rate = motion.signal not in AT_ONCE
        # a measured speed is the rate of change of a place by itself, and no command
        able = [
            c
            for c in left
            if not (_names_other(c) or _shows_motion(c))
            and (c.unit in (None, "1", "%", *RAW) or (c.unit == shown.unit and not rate and _asked(c)))
        ]
        for likely in (able, asked):
            fitting = [
                (following(c, shown, rate), -c.index, c) for c in likely if c.values.size == shown.values.size
            ]
            most = max(fitting, key=lambda item: item[:2], default=None)
            if most is not None and abs(most[0]) > DRIVEN:
                what = f"the rate of change of {_called(shown)}" if rate else _called(shown)
                told.append(("u", most[2], f"{what} follows it, as a motion does its command"))
                break
    elif command is not None and motion is None and not command.missing:
        able = [
            c
            for c in left
            if c.values.size == command.values.size
            and not _same(c, command)
            and not _names_other(c)
            and (c.unit is None or any(_convertible(c.unit, x) for x in ("rad", "m", "rad/s", "m/s")))
        ]
        found = [
            (following(command, c, rate), -c.index, c, rate)
            for c in able
            for rate in (False, True)
            if c.unit is None or rate != any(_convertible(c.unit, x) for x in ("rad/s", "m/s"))
        ]
        moving = [item for item in found if item[0] > (DRIVEN if item[3] else FOLLOWS)]
        if moving:
            _, _, column, rate = max(moving, key=lambda item: item[:2])
            rate = rate and not (column.unit is None and _returns(command, column))
            also = sorted({item[2].index for item in moving if not _equal(item[2], column)})
            signal = "slew" if rate else "speed"
            if column.unit is not None and rate and _convertible(column.unit, "m"):
                signal = "travel"
            why = (
                f"its rate of change follows {_called(command)}" if rate else f"it follows {_called(command)}"
            )
            others = f" (as {len(also)} more {'do' if len(also) > 1 else 'does'})" if also else ""
            if alone:
                told.append(
                    ("u", command, f"no command was found, and {_called(command)} is what was asked for")
                )
            told.append((signal, column, f"{why}, as {'an angle' if rate else 'a speed'} does{others}"))
    return told


def by_lead(free: list[Column]) -> dict[str, Guess]:
    """The demanded place and the motion, where no column has a telling name: one does what another did before, as far.

    Args:
        free: the columns.
    """
    able = [c for c in free if _nameless(c) and not (c.constant or c.missing or c.held)]
    if len(able) > CHANNELS:
        return {}  # a matrix, no recorder
    pairs = [
        (lead(one, two), -one.index, one, two)
        for one in able
        for two in able
        if one is not two and one.values.size == two.values.size
        and WHOLE < np.ptp(one.finite) / np.ptp(two.finite) < 1.0 / WHOLE
    ]  # fmt: skip
    best = max(pairs, key=lambda pair: pair[:2], default=None)
    if best is None or best[0] < FOLLOWS:
        return {}
    _, _, asked, shown = best
    motion = _guess("slew", shown, f"it does what {_called(asked)} did before")
    return {
        "slew": motion,
        "u": _placed(asked, f"no column has a telling name, and {_called(shown)} follows it"),
    }


def lead(one: Column, two: Column) -> float:
    """Correlation of two columns where the second comes later; 0 where it comes no later."""
    step = -(-one.values.size // FINE)
    rows = (c.values[: c.values.size // step * step].reshape(-1, step).mean(axis=1) for c in (one, two))
    x, y = (row - row.mean() for row in rows)
    size = 2 ** (2 * x.size).bit_length()
    products = np.fft.irfft(np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size), size)
    latest = max(2, x.size // LAGS)
    later, sooner = products[1:latest], products[-latest:]
    most = float(later.max())
    return (
        most / float(np.sqrt(x @ x * (y @ y))) if most > max(float(sooner.max()), float(products[0])) else 0.0
    )


def _equal(one: Column, other: Column) -> bool:
    """Whether two columns hold the same readings."""
    return np.array_equal(one.values, other.values, equal_nan=True)


def once_more(found: Overview, used: Collection[int]) -> list[Column]:
    """Columns that hold the readings of another once more, as in a file of signals and of the object made of them.

    Args:
        found: the file.
        used: indices of the columns that stand for something: these are no copies.
    """
    seen = {_readings(c) for c in found.columns if c.index in used}
    copies: list[Column] = []
    for column in (c for c in found.columns if c.index not in used and c.finite.size and not c.constant):
        readings = _readings(column)
        if readings in seen:
            copies.append(column)
        seen.add(readings)
    return copies


def _readings(column: Column) -> bytes:
    """A digest of a column's readings: a file of hundreds of columns is not compared pair by pair."""
    values = np.where(np.isnan(column.values), np.nan, column.values + 0.0)  # one NaN, and no negative zero
    return hashlib.sha256(values.tobytes()).digest()


def pressure_alone(free: list[Column], made: dict[str, Guess]) -> tuple[Column, str] | None:
    """The only pressure that was measured, where nothing shows a motion: what a valve or pump builds up in a volume."""
    if "u" not in made or {"spool", "p_supply", "p_a", "p_b", "slew", *MOTIONS, *DRIVERS} & set(made):
        return None
    return only_pressure(free)


def only_pressure(free: list[Column]) -> tuple[Column, str] | None:
    """The only pressure among the columns that moves and was not asked for, with the reason."""
    able = [c for c in free if _pressure(c) and not _asked(c)]
    able = [c for c in able if re.search(_PRESSURE, plain(c.label.short))] or able
    if len(able) != 1:
        return None
    return able[0], f"its name ({_called(able[0])}), and no column shows a motion"


def demanded_pressure(free: list[Column], made: dict[str, Guess]) -> Guess | None:
    """The pressure that a regulator is given, where nothing else was found and one pressure that was measured follows it."""
    if made:
        return None
    shown = only_pressure(free)
    asked = [
        c
        for c in free
        if re.search(rf"{_COMMAND}|{_REFERENCE}", plain(c.label.short)) and not c.constant and not _state(c)
        and (c.unit is None or _fits(c, "p_a"))
    ]  # fmt: skip
    if shown is None or len(asked) != 1 or asked[0].missing or shown[0].missing:
        return None
    if following(asked[0], shown[0], rate=False) < LED:
        return None
    guess = _placed(asked[0], f"no command was found, and {_called(shown[0])} follows it")
    return replace(
        guess, why=guess.why.replace("the place that the drive is to hold", "what it is to be"), place=False
    )


def _same(one: Column, other: Column) -> bool:
    """Whether a column is another once more, in another unit or of another level: what was measured never is."""
    return abs(_correlation(one.values, other.values)) > 1.0 - 1e-9


def demanded(free: list[Column], made: dict[str, Guess]) -> Guess | None:
    """The place that a drive is to hold, where no command was logged: it is called as the motion is, and that follows it."""
    motion = next((made[signal] for signal in ("slew", "travel") if signal in made), None)
    if motion is None:
        return None
    for column in free:
        if demands(column, motion.column):
            return _placed(column, f"no command was found, and {_called(motion.column)} follows it")
    return None


def as_place(made: dict[str, Guess], free: list[Column]) -> Guess | None:
    """The command, where its name was that of a place which the drive is to hold; None where it was not.

    Args:
        made: the guesses so far, with a command.
        free: columns that are nothing yet: of these one may be what a controller made of it.
    """
    motion = next((made[signal] for signal in ("slew", "travel") if signal in made), None)
    column = made["u"].column
    if motion is None or not demands(column, motion.column):
        return None
    own = [
        c
        for c in free
        if _score(c, "u") > 0.0 and not (c.constant or _same(c, column) or demands(c, motion.column))
    ]
    if len(own) == 1:
        return _guess(
            "u", own[0], f"its name ('{own[0].label.short}'), and {_called(column)} is the place asked for"
        )
    return _placed(column, f"its name, and {_called(motion.column)} follows it")


def _placed(column: Column, why: str) -> Guess:
    """A command that is the place which the drive is to hold; 1 is the largest demand."""
    gain = float(f"{1.0 / np.max(np.abs(column.finite)):.4g}")
    return Guess(
        "u", column, "1", gain, f"{why}: the place that the drive is to hold", check=True, place=True
    )


def demands(column: Column, motion: Column) -> bool:
    """Whether a column is the place that a drive is to hold: called as its motion is but for a word, and followed by it.

    ``target position`` goes with ``position`` and with ``actual position``, and ``target_rad`` with what is in rad, too. A
    word such as target, position or a unit says that it is a place: it needs to be of this axis only, which may be too slow
    to follow it closely. ``swing cmd`` is one only where the swing follows it more closely than its rate of change does, as
    is ``target`` without units.
    """
    words, moves = ([w for w in _words(c) if w != plain(c.unit or "")] for c in (column, motion))
    asked = [w for w in words if re.search(rf"{_COMMAND}|{_REFERENCE}", w)]
    named = sorted(w for w in words if w not in asked)
    shown = sorted(w for w in moves if not re.search(_AS_MEASURED, w))
    if not any(w.isdigit() for w in named):
        shown = [w for w in shown if not w.isdigit()]
    units = column.unit is not None and motion.unit is not None
    units = units and _convertible(column.unit or "", motion.unit or "")
    reference = all(re.search(rf"{_SET}|{_REFERENCE}", w) for w in asked)
    called = bool(named) and named in (shown, sorted(moves))
    bare = not named and reference and None in (column.unit, motion.unit)
    if not asked or not (called or bare or (units and not named)) or column.constant:
        return False
    if column.values.size != motion.values.size or motion.missing > LACKING * motion.values.size:
        return False
    both = np.isfinite(column.values) & np.isfinite(motion.values)
    one, other = (replace(c, values=c.values[both]) for c in (column, motion))
    level = following(one, other, rate=False)
    if units or (called and (reference or re.search(_OF_PLACE, " ".join(named)))):
        return level > LED
    return level > FOLLOWS and level > following(one, other, rate=True)


def driven_by(free: list[Column], made: dict[str, Guess]) -> tuple[str, Column, str] | None:
    """The torque or force that drives an axis of which no command was logged: signal, column, reason; None where none does.

    Of several (``tau_1``, ``tau_2``) it is the one that shares a word or number with the motion, or the one that was set: it
    moves in steps, where readings have noise.
    """
    motion = next((made[signal] for signal in ("slew", *MOTIONS) if signal in made), None)
    if motion is None or motion.signal == "flow":
        return None
    linear = motion.signal == "travel" or _convertible(motion.unit, "m/s")
    # a place without a unit may be an angle
    for signal in (
        ("force", "torque")
        if motion.signal == "travel" and motion.column.unit is None
        else (("force",) if linear else ("torque",))
    ):
        said, unit = DRIVERS[signal]
        able = [
            c
            for c in free
            if not c.constant
            and re.search(said, plain(c.label.short))
            and (c.unit in (None, "1", "%") or _convertible(c.unit, unit))
        ]
        own = set(_words(motion.column))
        of_axis = [c for c in able if own & set(_words(c))]
        chosen = able if len(able) == 1 else of_axis
        if len(chosen) != 1:
            chosen = [c for c in chosen or able if c.held]
        if len(chosen) == 1:
            named = f"its name ('{chosen[0].label.short}') is that of what drives the axis"
            return signal, chosen[0], f"no command was found, and {named}"
    return None


def _names_other(column: Column) -> bool:
    """Whether a name says that a column is neither a command nor a motion, or what was asked for or reckoned."""
    said = rf"{_REFERENCE}|{_ESTIMATE}|{_MEASURED}|{_STATE}"
    return bool(re.search(said, plain(column.label.short)))


def _demand(column: Column) -> bool:
    """Whether a name says that a column was asked for, and not as a place: an axis runs on as long as a command lasts."""
    said = plain(column.label.short)
    other = rf"{_ESTIMATE}|{_MEASURED}|{_STATE}|{_POSITION}|{_ANGLE}"
    return bool(re.search(_REFERENCE, said)) and not re.search(other, said)


def _asked(column: Column) -> bool:
    """Whether a name says that a column was asked for, or is what is amiss, and not what the machine did."""
    return bool(re.search(rf"{_COMMAND}|{_REFERENCE}|\berr(or)?\b|fehler", plain(column.label.short)))


def _pressures(alone: list[Column], command: Column | None) -> list[tuple[str, Column, str]]:
    """Two columns that move against each other and add up to a third, as pressures at the ports do to the supply's."""
    for k, one in enumerate(alone):
        for two in alone[k + 1 :]:
            if one.values.size != two.values.size or min(one.values.min(), two.values.min()) < 0.0:
                continue
            total = one.values + two.values
            if _correlation(one.values, two.values) > -OPPOSED or total.std() > 0.3 * one.values.std():
                continue
            others = [c for c in alone if c not in (one, two)]
            supply = [c for c in others if abs(c.values.mean() - total.mean()) < 0.05 * total.mean()]
            if len(supply) != 1:
                continue
            a, b = one, two
            if (
                command is not None
                and command.values.size == one.values.size
                and _correlation(command.values, one.values - two.values) < 0.0
            ):
                a, b = two, one
            name = _called(supply[0])
            return [
                (
                    "p_supply",
                    supply[0],
                    f"{_called(a)} and {_called(b)} add up to it, as pressures at the ports do",
                ),
                ("p_a", a, f"it and {_called(b)} move against each other and add up to {name}"),
                ("p_b", b, f"it and {_called(a)} move against each other and add up to {name}"),
            ]
    return []


def following(command: Column, column: Column, rate: bool) -> float:
    """Correlation of a column, or of its rate of change, with the command, at the lag at which it is largest."""
    size = max(1, command.values.size // STRETCHES)
    count = command.values.size // size
    u, x = (c.values[: count * size].reshape(count, size).mean(axis=1) for c in (command, column))
    if rate:
        u, x = 0.5 * (u[1:] + u[:-1]), np.diff(x)
    return max(
        (_correlation(u[: u.size - lag], x[lag:]) for lag in range(min(LAGS, u.size // 4))), default=0.0
    )


def _returns(command: Column, column: Column) -> bool:
    """Whether a column falls back by itself, as a speed does, and no place: that explains most of its rate of change."""
    size = max(1, command.values.size // STRETCHES)
    count = command.values.size // size
    u, x = (c.values[: count * size].reshape(count, size).mean(axis=1) for c in (command, column))
    rate, level = np.diff(x), x[:-1]
    sums = np.column_stack([u[1:], u[:-1], np.ones(rate.size)])
    alone, with_level = (
        np.linalg.lstsq(terms, rate, rcond=None) for terms in (sums, np.column_stack([sums, level]))
    )
    left = [
        float(np.sum((rate - terms @ fit[0]) ** 2))
        for terms, fit in ((sums, alone), (np.column_stack([sums, level]), with_level))
    ]
    return bool(with_level[0][3] < 0.0 and left[1] < BY_ITSELF * left[0])


def _begins_anew(column: Column) -> bool:
    """Whether an angle or a place jumps back by its whole range again and again, and moves little in between."""
    span = float(np.ptp(column.finite))
    step = np.abs(np.diff(column.finite))
    back = step > WHOLE * span
    return bool(back.sum() > 1 and not np.any(step[~back] > (1.0 - WHOLE) * span))


def _nameless(column: Column) -> bool:
    """Whether a heading says nothing, as ``Var3``, ``Data_2``, ``ch 1`` or ``5``."""
    return not {word for word in _words(column) if not word.isdigit()} - GENERIC


def _called(column: Column) -> str:
    """A column as it is spoken of."""
    name = column.label.short
    return f"column {name}" if name.isdigit() else f"'{name}'"


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return float(np.sum(a * b)) / size if size > 0.0 else 0.0


def _guess(signal: str, column: Column, why: str) -> Guess:
    """A guess with unit and scale."""
    largest = float(np.max(np.abs(column.finite)))
    named = bool(re.search(_VOLTAGE, plain(column.label.short)))  # its name is as good as its unit
    raw = column.unit not in ("1", "%") if column.unit is not None else named or largest > 105.0
    if signal == "u" and raw:
        gain = float(f"{1.0 / largest:.4g}") if largest else 1.0
        return Guess(signal, column, "1", gain, why, check=True)
    if column.unit is not None and not (signal in DRIVERS and column.unit in ("1", "%")):
        gon = column.label.unit == "grad"  # a degree in German, a gon elsewhere
        return Guess(signal, column, column.unit, 1.0, why, check=gon)
    ranges = {
        "u": ((1.05, "1"), (105.0, "%")),
        "spool": ((0.01, "m"), (50.0, "mm"), (1e9, "um")),
        "slew": ((6.3, "rad"), (1e9, "deg")),
        "travel": ((3.0, "m"), (1e9, "mm")),
        "flow": ((0.05, "m3/s"), (1e9, "l/min")),
        "speed": ((0.0 if _in_rpm(column) else FASTEST, "rad/s"), (1e9, "rpm")),
        "torque": ((1e12, "N.m"),),
        "force": ((1e12, "N"),),
        "slew_estimate": ((6.3, "rad"), (1e9, "deg")),
        "slew_rate_estimate": ((0.5, "rad/s"), (1e9, "deg/s")),
    }.get(signal, ((HIGHEST, "bar"), (100.0 * HIGHEST, "kPa"), (1e12, "Pa")))
    unit = next((unit for most, unit in ranges if largest <= most), ranges[-1][1])
    if (
        signal == "slew"
        and _ENCODER.search(plain(column.label.short))
        and bool(np.all(column.finite % 1.0 == 0.0))
    ):
        return Guess(
            signal, column, "deg", 1.0, f"{why}; counts: `gain` is 360 over those of a turn", check=True
        )
    how = "by its range" if len(ranges) > 1 else "assumed"
    return Guess(signal, column, unit, 1.0, f"{why}; unit {how}", check=True)


def _in_rpm(column: Column) -> bool:
    """Whether a speed's name says that it counts revolutions."""
    return bool(re.search(r"drehzahl|\brpm\b", plain(column.label.short)))


def clock_column(found: Overview, made: dict[str, Guess]) -> int | None:
    """Index of the column that a mapping names for time, or None where nothing tells it.

    Where each column has stamps of its own, the one that holds these stamps, else the longest: its own stamps count then.
    """
    return stamped(found, [guess.column for guess in made.values()])


def stamped(found: Overview, chosen: Sequence[Column]) -> int | None:
    """As `clock_column`, with the columns that were chosen."""
    if found.clock is None or found.clock.column is not None:
        return None if found.clock is None else found.clock.column
    same = [c.index for c in found.columns if np.array_equal(c.values, found.clock.seconds)]
    return same[0] if same else longest(chosen or found.columns).index


def time_lines(found: Overview, stamps: int | None) -> list[str]:
    """The table `[time]` of a mapping.

    Args:
        found: the file.
        stamps: as `stamped` gives it.
    """
    clock = found.clock
    if clock is None and found.interval is not None:
        name, step = found.interval
        doubt = "" if found.coarse is None else ": CHECK"
        return ["[time]", f"step = {step:.9g}    # {name} in the file{doubt}", 'unit = "s"']
    if clock is None:
        return [
            "[time]",
            "# no column looks like a time: name one (column = ...), or give the interval between samples",
            "step = 0.001    # CHECK",
            'unit = "s"',
        ]
    note = f"    # CHECK: {clock.guessed}" if clock.guessed else ""
    return [
        "[time]",
        *(["# each column has stamps of its own in the file, which count"] if clock.column is None else []),
        f"column = {column_of(found, found.columns[stamps or 0])}",
        f"unit = {_quoted(clock.unit)}{note}",
    ]


def mapping_text(found: Overview, made: dict[str, Guess], model: str | None) -> str:
    """A mapping with the guesses, each with its reason, and the other columns in comments.

    Args:
        found: the file.
        made: the guesses.
        model: name or path of the model; None for a machine of its own, of which the log tells speed and lag.
    """
    name = found.path.name
    texts = texts_of(model)
    stamps = clock_column(found, made)
    lines = [
        f"# Which column of {name} is which signal, as guessed by 'cosim init'. Check each line; a value is",
        "#   sign * gain * (reading - zero) + offset   in `unit`.",
        f"# Then: cosim info {name} --mapping THIS_FILE    and: cosim diagnose {name} --mapping THIS_FILE",
        *([] if model is None else [f"model = {_quoted(model)}"]),
        "",
        *(
            []
            if found.header
            else ["[file]", "header = false    # its first row holds numbers: columns go by their place", ""]
        ),
        *time_lines(found, stamps),
    ]
    for guess in made.values():
        lines += ["", *_entry(found, guess, texts)]
    if model is None:
        lines += ["", *machine_lines(found, made)]
    elif "u" in made and "slew" in made:
        lines += ["", *(f"# {line}" for line in (OTHER, *machine_lines(found, made)))]
    second = second_record(found, made, stamps)
    lines += second_lines(found, second)
    used = used_by(made) | found.times | {column.index for column in second.values()}
    copies = once_more(found, used)
    rest = [c for c in found.columns if c.index not in used | {copy.index for copy in copies}]
    shown = any(signal in made for signal in MOTIONS)
    missing = [
        n for n in NAMES if n not in made and not n.endswith("estimate") and not (n == "slew" and shown)
    ]
    if missing:
        lines += [
            "",
            "# not found among the columns; for one that was measured, take the marks away and name its column",
        ]
        for name in missing:
            lines += [
                f"# [signals.{name}]    # {texts[name]}",
                '# column = "?"',
                f"# unit = {_quoted(SIGNALS[name].unit)}",
            ]
    if rest:
        lines += ["", "# other columns; to use one, give it the name of a signal, or a name of your own"]
    for column in rest:
        lines += [
            f"# [signals.{_identifier(column)}]",
            f"# column = {column_of(found, column)}",
            f"# unit = {_quoted(column.unit or '1')}    # {_range(column)}",
        ]
    if copies:
        lines += ["", f"# the same readings once more: {', '.join(c.label.text for c in copies)}"]
    return "\n".join(lines) + "\n"


def second_record(found: Overview, made: dict[str, Guess], stamps: int | None) -> dict[str, Column]:
    """Signal or ``time`` -> its column in a second record of the file (``uVal`` beside ``uEst``, ``val.y1``, ``id.y1``).

    Nothing where a signal has no such column, or where the second record holds the same values.
    """
    of = {name: guess.column for name, guess in made.items()}
    if stamps is not None:
        of["time"] = found.columns[stamps]
    by_text = {column.label.text: column for column in found.columns if column.finite.size}
    for first, second in SECOND:
        twins: dict[str, Column] = {}
        for name, column in of.items():
            said = re.sub(first, second, column.label.text)
            if said != column.label.text and said in by_text and column.label.text in by_text:
                twins[name] = by_text[said]
        if twins.keys() >= made.keys() and any(
            not np.array_equal(twin.values, of[name].values) for name, twin in twins.items()
        ):
            return twins
    return {}


def second_lines(found: Overview, second: dict[str, Column]) -> list[str]:
    """The table `[held_out]` of a mapping."""
    if not second:
        return []
    head = ["", "[held_out]    # a second record in this file: it is not fitted, and judges what is named"]
    return head + [f"{name} = {column_of(found, column)}" for name, column in second.items()]


def electric(found: Overview, made: dict[str, Guess]) -> bool:
    """Whether a motor moves the axis: a column says so, or a speed is shown and nothing speaks of oil."""
    said = " ".join(plain(c.label.short) for c in found.columns)
    if "flow" in made or re.search(rf"{_PRESSURE}|spool|valve|ventil|cylind|zylind|hydraul|\boil|pump", said):
        return False
    return "speed" in made or bool(re.search(_MOTOR, said))


def machine_lines(found: Overview, made: dict[str, Guess]) -> list[str]:
    """The table `[machine]` for a drive of its own, of which the log tells speed and lag."""
    motion = next((signal for signal in MOTIONS if signal in made), "slew")
    driver = next((signal for signal in DRIVERS if signal in made), None)
    before = ["mechanical"] if driver else ["dead_zone", "dcv", "continuity", "mechanical"]
    place = "u" in made and made["u"].place
    if motion not in made and driver is None and {"u", "p_a"} <= made.keys() and "p_b" not in made:
        return [
            "[machine]    # of its own, that builds up a pressure and moves nothing: docs/machines.md",
            'chain = ["dead_zone", "dcv", "continuity"]    # the log tells its gain and its lag',
            'output = "p_a"',
        ]
    blocks = [*before, *([] if motion in AT_ONCE or place else ["sensor"])]
    linear = motion == "travel" or (motion == "speed" and _convertible(made[motion].unit, "m/s"))
    example = "0.1 m/s" if linear else "40 l/min" if motion == "flow" else "48 deg/s"
    example = example.removesuffix("/s") if place else example
    speed = f'speed = "?"    # at a {driver or "command"} of 1, as "{example}"; "?": from the log'
    if demand := largest_demand(made, motion):
        speed = f'speed = "{demand}"    # CHECK: the place at a command of 1, which is the largest demand'
    return [
        "[machine]    # a drive of its own: docs/machines.md",
        f"chain = [{', '.join(map(_quoted, blocks))}]",
        *(['motion = "travel"    # a linear axis: kg, N, m'] if linear else []),
        *(['motion = "flow"    # of a valve or pump: no axis that moves'] if motion == "flow" else []),
        *(['command = "place"    # CHECK: u is the place that the drive is to hold'] if place else []),
        *(_HELD if not place and motion in ("slew", "travel") and _level(made, motion) else []),
        *(['drive = "electric"    # CHECK: a motor; "hydraulic" for oil'] if electric(found, made) else []),
        *([] if driver is None else [f"input = {_quoted(driver)}"]),
        *([] if motion == "slew" else [f"output = {_quoted(motion)}"]),
        speed,
        'lag = "?"    # as "150 ms"',
    ]


_HELD = (
    '# command = "place"    # CHECK: the motion follows u itself: u may be the place that the drive is to hold',
)


def _level(made: dict[str, Guess], motion: str) -> bool:
    """Whether a place follows the command itself, more closely than its rate of change does."""
    if not {"u", motion} <= made.keys() or made["u"].minus is not None:
        return False
    command, shown = made["u"].column, made[motion].column
    if command.values.size != shown.values.size or command.missing or shown.missing or command.constant:
        return False
    level = following(command, shown, rate=False)
    return level > FOLLOWS and level > following(command, shown, rate=True)


def largest_demand(made: dict[str, Guess], motion: str) -> str:
    """The place that a command of 1 asks for, with its unit, where a demanded place was logged in one; else empty."""
    if not ("u" in made and made["u"].place and motion in made):
        return ""
    asked, shown = made["u"].column.unit, made[motion].column.unit
    if asked is None or shown is None or not _convertible(asked, shown):
        return ""
    return f"{1.0 / made['u'].gain:.4g} {asked}"


def texts_of(model: str | None) -> dict[str, str]:
    """Signal -> what it is: of the crane, or (None) of a machine of its own."""
    return {n: signal.text for n, signal in SIGNALS.items()} | (OF_MACHINE if model is None else {})


def used_by(made: dict[str, Guess]) -> set[int]:
    """The columns, by their index, that guesses use."""
    return {c.index for g in made.values() for c in (g.column, g.minus) if c is not None}


def _entry(found: Overview, guess: Guess, texts: dict[str, str]) -> list[str]:
    column = guess.column
    mark = "    # CHECK" if guess.check else ""
    lines = [
        f"[signals.{guess.signal}]    # {texts[guess.signal]}",
        f"# guessed: {guess.why}; {_range(column)}",
        f"column = {column_of(found, column)}",
        *(
            []
            if guess.minus is None
            else [f"minus = {column_of(found, guess.minus)}    # CHECK: the other direction"]
        ),
        f"unit = {_quoted(guess.unit)}{mark}",
    ]
    if guess.signal in DRIVERS:
        lines.append(f'text = "applied {guess.signal}"')
    if guess.zero:
        lines.append(f"zero = {guess.zero!r}    # CHECK: the most frequent reading; the machine stands there")
    elif guess.signal == "u" and not guess.place and one_sided(column):
        lines.append("# zero = ?    # CHECK: the reading without a command, at which the machine stands")
    if guess.gain != 1.0:
        lines.append(f"gain = {guess.gain!r}    # CHECK: full command for the largest reading")
    if guess.signal == "slew" and guess.unit in _TURNS and _begins_anew(column):
        lines.append(
            f"period = {_TURNS[guess.unit]!r}    # CHECK: it begins anew after a turn, and is made to go on"
        )
    return lines


def _range(column: Column) -> str:
    if not column.finite.size:
        return f"no numbers: {column.why}" if column.why else "empty"
    return f"{np.min(column.finite):.4g} to {np.max(column.finite):.4g}, {column.kind}"


def column_of(found: Overview, column: Column) -> str:
    """The heading, or the position where two columns have the same one."""
    same = [c for c in found.columns if c.label.called(column.label.text)]
    return _quoted(column.label.text) if len(same) == 1 else str(column.index + 1)


def _identifier(column: Column) -> str:
    text = re.sub(r"\W+", "_", plain(column.label.short)).strip("_") or "column"
    return text if text.isidentifier() else f"column_{column.index + 1}"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
