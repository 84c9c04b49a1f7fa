"""What people call the signals, blocks and quantities of the crane, and the words of a machine that moves along a line."""

import re
from collections.abc import Iterable

from cosim.lexicon import current

SIGNAL_NAMES = {
    "slew": "slew angle",
    "spool": "spool position",
    "p_load": "load pressure",
    "p_supply": "supply pressure",
    "p_a": "pressure at port A",
    "p_b": "pressure at port B",
    "u": "command",
    "slew_external": "external tracker",
}
BLOCK_NAMES = {
    "dead_zone": "dead zone",
    "dcv": "valve",
    "continuity": "hydraulics",
    "mechanical": "mechanics",
    "sensor": "slew sensor",
    "tracker": "tracker",
    "simplified": "drive",
}
# where a quantity "of" which something depends, or "what" is missing, is shown: (name, SI unit, shown unit)
QUANTITIES: dict[str, tuple[str, str, str]] = {
    "omega": ("slew speed", "rad/s", "deg/s"),
    "acceleration": ("slew acceleration", "rad/s2", "deg/s2"),
    "direction": ("direction of motion", "1", "1"),
    "theta": ("slew angle", "rad", "deg"),
    "slew": ("slew angle", "rad", "deg"),
    "path of theta since it turned": ("path since the last reversal", "rad", "deg"),
    "time": ("time", "s", "s"),
    "p_load": ("load pressure", "Pa", "bar"),
    "u": ("command", "1", "%"),
    "spool": ("spool position", "m", "mm"),
    "spool_rate": ("spool speed", "m/s", "mm/s"),
    "abs(spool)": ("spool opening", "m", "mm"),
    "torque": ("missing torque", "N.m", "N.m"),
    "demand": ("missing demand", "1", "%"),
    "opening": ("missing opening", "m", "mm"),
    "supply": ("missing supply pressure", "Pa", "bar"),
    "lagged supply": ("missing supply pressure, lagged", "Pa", "bar"),
    "reading": ("missing reading", "rad", "deg"),
}
# words for the crane and its slew -> words for another machine and its axis; what is longer stands first
OTHER_AXIS = (
    ("between rack and column", "between drive and axis"),
    ("between column and boom", "between drive and load"),
    ("sensor and tracker see, the column", "the sensor sees, the drive"),
    ("boom alone, column locked", "load alone, drive locked"),
    ("of the boom with the column locked", "of the load with the drive locked"),
    ("that is the boom", "that is the load beyond the flexible part"),
    ("payload, or boom out", "payload, or its distance"),
    ("a flexible boom", "a flexible mode"),
    (", as of a base that is not level", ""),
    ("a base that is not level", "a load that depends on the position"),
    (": the base is not level", ""),
    ("along the tilted base", "along the path"),
    ("the column", "the axis"),
    ("external tracker", "second sensor of the motion"),
    *(
        pair
        for word in ("sensor", "angle", "speed", "acceleration", "reading", "axis")
        for pair in ((f"slew {word}", word), (f"Slew {word}", word.capitalize()))
    ),
    ("the slew stands", "the axis stands"),
    ("the slew moves", "the axis moves"),
    ("the measured slew takes", "the measured motion takes"),
    ("slew less tracker", "reading less tracker"),
)
# words for a valve -> words for what drives a motor
DRIVEN = (
    ("load pressure", "motor current"),
    ("spool position", "driver's output"),
    ("the spool's", "the output's"),
    ("The spool", "The driver's output"),
    ("spool", "driver's output"),
    ("valve", "driver"),
)
# words for rotation -> words for a linear axis
TURNING = (
    ("torque", "force"),
    ("Torque", "Force"),
    ("Turn slowly", "Move slowly"),
    ("many periods a turn", "many periods over the travel"),
    ("one period a turn", "one period over the travel"),
    ("Periods a turn", "Periods over the travel"),
    ("joint turns", "joint moves"),
    ("turns the joint", "moves the joint"),
    ("it turns more", "it moves more"),
    ("angle", "position"),
    ("Angle", "Position"),
    *(("inertia", "mass"), ("Inertia", "Mass")),
)

# words for rotation -> words for what a valve or pump lets through
FLOWING = (("torque", "pressure"), ("Torque", "Pressure"), ("slew speed", "flow"), ("slew angle", "volume"))


# words for a torque -> words for what a drive that holds the place it is told lacks
HOLDING = (("torque", "demand"), ("Torque", "Demand"))
# SI unit of a quantity of a motion -> that of the model's variable which stands for it there
ONE_RATE_ON = {"rad": "rad/s", "rad/s": "rad/s2"}


def known_as(signal: str) -> str:
    """A signal by the name people know, with its own: "slew angle (slew)"."""
    name = SIGNAL_NAMES.get(signal)
    return f"{name} ({signal})" if name else signal


def replaced(text: str, pairs: Iterable[tuple[str, str]]) -> str:
    """A text in which the first of each pair of words stands no more, but the second; a triangle is not an angle."""
    for one, other in pairs:
        alone = r"(?<![a-zäöüß])" if one[0].isalpha() else ""
        text = re.sub(alone + re.escape(one), other.replace("\\", r"\\"), text)
    return text


def kind_of_motion(text: str) -> str:
    """Words about the crane's slew, as they are said of another machine's axis, which may move along a line."""
    lexicon = current()
    pairs = (
        *(FLOWING if lexicon.units.get("rad") == "m3" else ()),
        *(HOLDING if lexicon.holds else ()),
        *(OTHER_AXIS if lexicon.blocks else ()),
        *(DRIVEN if lexicon.electric else ()),
        *(TURNING if lexicon.units.get("rad") in ("m", "m.s") else ()),
    )
    return replaced(text, pairs)
