"""What people call the signals, blocks and quantities of the crane, and the words of a machine that moves along a line."""

from collections.abc import Iterable

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
# words for the crane's slew -> words for the axis of another machine
OTHER_AXIS = (("slew sensor", "sensor"), ("slew angle", "angle"), ("slew speed", "speed"))
# words for rotation -> words for a linear axis
TURNING = (
    ("torque", "force"),
    ("Torque", "Force"),
    ("the column", "the axis"),
    ("turns", "moves"),
    ("angle", "position"),
    *(("inertia", "mass"), ("Inertia", "Mass")),
)


def known_as(signal: str) -> str:
    """A signal by the name people know, with its own: "slew angle (slew)"."""
    name = SIGNAL_NAMES.get(signal)
    return f"{name} ({signal})" if name else signal


def replaced(text: str, pairs: Iterable[tuple[str, str]]) -> str:
    """A text in which the first of each pair of words stands no more, but the second."""
    for one, other in pairs:
        text = text.replace(one, other)
    return text
