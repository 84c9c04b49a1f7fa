"""The valve's linearisation (3.5.5): start voltages, one slope a side, and the voltage that a command then asks for.

    travel = s (V - V_start) beyond the start voltage of that side, 0 between the two          valve as found, Table 3.5
    V = V_start + travel / s,   travel = full travel * command / full command                  Table 3.6

The first stage takes the dead zone out, the second makes both sides travel alike. In numbers of full command it is the exact
inverse (2.3) of a dead zone (2.2): form 2 of the block `dead_zone` in front of form 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import UsageError
from cosim.identify.answer import COLUMNS, Answer, parameter_table
from cosim.identify.estimate import Quantity
from cosim.units import parse_quantity

TABLE_3_5 = ("6.0 V:3.0275 mm", "-6.0 V:-2.6880 mm")
LARGEST = 6.0  # V about neutral that the actuator takes: 25 to 75 % of 24 V (section 3.4)
STEPS = 5  # commands a side in the printed table


@dataclass(frozen=True)
class Side:
    """One direction of the valve.

    Attributes:
        start: voltage at which the spool starts [V].
        slope: travel per voltage beyond it [mm/V].
    """

    start: float
    slope: float

    def voltage(self, travel: float) -> float:
        """Voltage [V] that gives a travel [mm] to this side."""
        return self.start + travel / self.slope


def pair(text: str, option: str) -> tuple[float, float]:
    """``6.0 V:3.0275 mm`` as (V, mm).

    Raises:
        UsageError: it cannot be read.
    """
    voltage, colon, travel = text.partition(":")
    if not colon:
        raise UsageError(f"{option} '{text}' should read voltage:travel, such as '6.0 V:3.0275 mm'")
    try:
        return parse_quantity(voltage, "V"), parse_quantity(travel, "mm")
    except UsageError as error:
        raise UsageError(f"{option} '{text}': {error}") from None


def side_of(start: float, points: Sequence[tuple[float, float]], name: str) -> Side:
    """One side from its start voltage [V] and measured points (V, mm), by least squares through the start.

    Raises:
        UsageError: there is no point, one lies before the start, or the travel does not grow with the voltage.
    """
    if not points:
        raise UsageError(f"side {name} has no measured point: give one, such as --point '6.0 V:3.0275 mm'")
    beyond = np.array([v - start for v, _ in points])
    travel = np.array([x for _, x in points])
    if np.any(beyond * np.sign(travel) <= 0.0):
        raise UsageError(
            f"side {name}: a point lies before the start voltage {start:g} V: correct --start-{name.lower()} or the point"
        )
    return Side(start, float(beyond @ travel) / float(beyond @ beyond))


def linearisation_answer(starts: tuple[str, str], points: Sequence[str], full: str) -> Answer:
    """Slopes of both sides, the voltage for each command, and the valve with its inverse as parameters of the model.

    Args:
        starts: voltages at which the spool starts, towards A (positive) and B (negative).
        points: measured points ``voltage:travel``; empty for Table 3.5.
        full: voltage of full command and the travel that it is to give.

    Raises:
        UsageError: a text cannot be read, or the numbers contradict each other.
    """
    begin = [parse_quantity(text, "V") for text in starts]
    if not begin[1] <= 0.0 <= begin[0]:
        raise UsageError(
            f"the start voltages {begin[0]:g} V (A) and {begin[1]:g} V (B) should lie on either side of 0: exchange them"
        )
    pairs = [pair(text, "--point") for text in points or TABLE_3_5]
    if any(x == 0.0 for _, x in pairs):
        raise UsageError(
            "a point without travel says nothing of a slope: give the start voltage in its place"
        )
    whole, travel = pair(full, "--full")
    if whole <= 0.0 or travel <= 0.0:
        raise UsageError(f"--full '{full}': voltage and travel should be positive: they count on both sides")
    a = side_of(begin[0], [p for p in pairs if p[1] > 0.0], "A")
    b = side_of(begin[1], [p for p in pairs if p[1] < 0.0], "B")
    commands = [k / STEPS for k in range(-STEPS, STEPS + 1)]
    table = [
        (c, whole * c, travel * c, (a if c > 0 else b).voltage(travel * c) if c else 0.0) for c in commands
    ]
    ends = (table[-1][3], table[0][3])
    notes = [
        f"side {name}: {travel:g} mm need {end:.4g} V, beyond the {LARGEST:g} V that the actuator takes: "
        f"it ends at {side.slope * (np.copysign(LARGEST, end) - side.start):.4g} mm"
        for name, side, end in (("A", a, ends[0]), ("B", b, ends[1]))
        if abs(end) > LARGEST
    ]
    shape = {
        "m_r": (a.slope * whole / travel, "1"),
        "b_r": (a.start / whole, "1"),
        "m_l": (b.slope * whole / travel, "1"),
        "b_l": (b.start / whole, "1"),
    }
    values = {
        "compensator.form": (2.0, "1"),
        **{f"compensator.{name}": value for name, value in shape.items()},
        "compensator.limit": (LARGEST / whole, "1"),
        **{f"dead_zone.{name}": value for name, value in shape.items()},
        "dcv.K": (travel * 1e-3, "m"),
    }
    data = {
        "sides": {
            name: {
                "start": {"value": side.start, "unit": "V"},
                "slope": {"value": side.slope, "unit": "mm/V"},
                "full": {"value": end, "unit": "V"},
            }
            for name, side, end in (("A", a, ends[0]), ("B", b, ends[1]))
        },
        "table": [{"command": c, "signal_V": v, "travel_mm": x, "valve_V": y} for c, v, x, y in table],
    }
    found = {name: Quantity(value, 0.0, 1.0, unit) for name, (value, unit) in values.items()}
    answer = Answer("linearisation", data, found, notes=notes, model="full_order")
    answer.tables.append((
        "command, its voltage, the travel it is to give, and the voltage at the valve",
        ["command", "V", "spool [mm]", "valve [V]"],
        [[f"{c:g}", f"{v:g}", f"{x:.4g}", f"{y:.4f}"] for c, v, x, y in table],
    ))  # fmt: skip
    answer.tables.append(
        (
            "the valve as found and its inverse as parameters, in parts of full command",
            COLUMNS,
            parameter_table(found, {}),
        )
    )
    answer.lines = [
        f"side {name}: starts at {side.start:g} V, then {side.slope:.4f} mm/V"
        for name, side in (("A", a), ("B", b))
    ]
    return answer
