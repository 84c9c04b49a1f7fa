"""The canonical signals of a log: each is declared once, in one line.

Inside the program a signal is in its SI unit; a file shows it in its log unit, the one of the rig (table 3.8).
"""

import math
import re
from dataclasses import dataclass

from cosim.errors import UsageError
from cosim.units import factor, parse_unit, registry


@dataclass(frozen=True)
class Signal:
    """One measured quantity.

    Attributes:
        name: canonical name, the one in a log's header.
        si: SI unit inside the program, in FMI's spelling.
        unit: unit in which logs are written and people read it.
        low: lowest plausible value [si]; below it the unit or scaling is probably wrong.
        high: highest plausible value [si].
        held: True where the value is constant between samples (zero-order hold), False where it is continuous.
        text: what it is.
    """

    name: str
    si: str
    unit: str
    low: float
    high: float
    held: bool
    text: str

    @property
    def to_si(self) -> float:
        """Factor from `unit` to `si`."""
        return factor(self.unit, self.si)


def _signal(
    name: str, si: str, unit: str, low: float, high: float, text: str, held: bool = False
) -> Signal:  # range in `unit`
    scale = factor(unit, si)
    return Signal(name, si, unit, low * scale, high * scale, held, text)


_ALL = (
    _signal("time", "s", "s", -1e10, 1e10, "time of the sample on the rig's clock"),
    _signal(
        "u", "1", "1", -1.05, 1.05, "slew valve command U1, before the compensator (table 3.8)", held=True
    ),
    _signal("spool", "m", "mm", -7.0, 7.0, "spool position; the feedback ends at 7 mm (section 3.1)"),
    _signal("p_supply", "Pa", "bar", -5.0, 400.0, "supply pressure, HPU SP; the sensor ends at 400 bar"),
    _signal("p_a", "Pa", "bar", -5.0, 400.0, "pressure at port A; the sensor ends at 400 bar"),
    _signal("p_b", "Pa", "bar", -5.0, 400.0, "pressure at port B; the sensor ends at 400 bar"),
    _signal("slew", "rad", "deg", -30.0, 280.0, "slew angle by the draw-wire sensor (table 3.8)"),
    _signal("slew_estimate", "rad", "deg", -30.0, 280.0, "slew angle estimated by the observer"),
    _signal("slew_rate_estimate", "rad/s", "deg/s", -25.0, 25.0, "slew velocity estimated by the observer"),
    _signal("p_load", "Pa", "bar", -400.0, 400.0, "load pressure, derived: p_a - p_b (4.21)"),
    _signal(
        "slew_external", "rad", "deg", -30.0, 280.0, "slew angle by the external tracker, on its own clock"
    ),
)

SIGNALS: dict[str, Signal] = {signal.name: signal for signal in _ALL}
"""Every canonical signal by name, `time` and the derived `p_load` among them."""

LOG_SIGNALS: tuple[str, ...] = tuple(
    name for name in SIGNALS if name not in ("time", "p_load", "slew_external")
)
"""The signals a log of the rig may hold, in the order of its columns, without `time`."""

TRACKER_SIGNALS: tuple[str, ...] = ("slew_external",)
"""The signals a tracker's file holds, without `time`."""

SYNTHETIC_COLUMN = "synthetic"
"""Column (unit 1, value 1 in every row) that marks a log made by our virtual rig, in every file format."""


_FACTOR = r"(?:[A-Za-zµμΩ]+|%|°[A-Za-z]?)(?:\^?-?\d{1,2}|[²³])?"
_UNIT_TEXT = re.compile(rf"(?:1|{_FACTOR})(?: ?[./*] ?{_FACTOR})*")


def check_spelling(unit: str) -> None:
    """Refuse what is not even written like a unit, before pint, which would evaluate it as an expression.

    Raises:
        UsageError: the text is not names with small exponents, joined by ``.``, ``*`` or ``/``.
    """
    if len(unit) > 40 or not _UNIT_TEXT.fullmatch(unit.strip()):
        raise UsageError(f"'{unit[:40]}' is not a unit: write one such as 'bar', 'deg/s' or 'N.m.s/rad'")


def angle_power(unit: str) -> int:
    """The power of the angle in a unit: 1 for deg, rad, rev; 1 for deg/s; 0 for 1, % and Hz.

    pint counts angles as dimensionless, so its dimensions alone would let `deg` pass for `1`.

    Raises:
        UsageError: the text is not a unit.
    """
    base = (1.0 * parse_unit(unit)).to_base_units()
    return int(dict(base.unit_items()).get("radian", 0))


def conversion(unit: str, target: str) -> float:
    """Factor from `unit` to `target`, which must agree in dimension and in angle.

    Raises:
        UsageError: the unit cannot be read, or it measures something else than `target`.
    """
    check_spelling(unit)
    scale = factor(unit, target)
    if unit == target:
        return scale
    one, two = (registry().Quantity(x, parse_unit(unit)).to_base_units().magnitude for x in (1.0, 2.0))
    if not math.isclose(two, 2.0 * one):
        raise UsageError(f"unit '{unit}' has an offset or is logarithmic: give one that is a plain multiple")
    if angle_power(unit) != angle_power(target):
        measured = "is an angle" if angle_power(unit) else "is not an angle"
        raise UsageError(f"unit '{unit}' {measured}: expected one like '{target}'")
    return scale
