"""Scaling of the analogue channels (3.2): value = greatest value / greatest voltage * voltage, as a mapping file.

The slopes and zeros are those of section 1 of the source and of Tables 3.5 and 3.6; measured points replace them. A log
recorded in volts is then read with the mapping, as gain and zero of each column (docs/logs.md).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from cosim.errors import DataError, UsageError
from cosim.identify.estimate import Quantity
from cosim.signals import SIGNALS, conversion
from cosim.units import parse_quantity

WIRE_TRAVEL, WIRE_VOLTAGE = 15000.0, 10.0  # mm and V of the draw-wire sensor WS17KT
TABLES: dict[str, tuple[tuple[float, float], ...]] = {  # volt, mm
    "Table 3.5": ((3.365, 3.0275), (1.732, -2.688)),
    "Table 3.6": ((3.248, 2.6), (1.769, -2.6)),
}


@dataclass(frozen=True)
class Channel:
    """How one column in volts becomes a signal: ``value = gain (voltage - zero)``.

    Attributes:
        signal: name of the signal.
        gain: [unit/V].
        zero: voltage that means zero [V].
        unit: of the value.
        source: where the numbers come from.
        points: (voltage [V], value [unit]) that they were fitted to.
        errors: of gain and zero where more than two points tell them.
    """

    signal: str
    gain: float
    zero: float
    unit: str
    source: str
    points: tuple[tuple[float, float], ...] = ()
    errors: tuple[Quantity, Quantity] | None = None

    def value(self, voltage: float) -> float:
        """The value at a voltage [V]."""
        return self.gain * (voltage - self.zero)

    @property
    def residuals(self) -> list[float]:
        """Of each point, its value minus the line's."""
        return [value - self.value(voltage) for voltage, value in self.points]


STANDARD: dict[str, Channel] = {
    "u": Channel("u", 1.0 / 3.0, 0.0, "1", "Table 3.6: ±3 V is full command"),
    "spool": Channel("spool", 14.0 / 4.0, 2.5, "mm", "PVES feedback: 0.5 to 4.5 V for -7 to 7 mm"),
    "p_supply": Channel("p_supply", 40.0, 0.0, "bar", "(3.2), Parker SCP01: 0 to 10 V for 0 to 400 bar"),
    "p_a": Channel("p_a", 40.0, 0.0, "bar", "(3.2), Parker SCP01: 0 to 10 V for 0 to 400 bar"),
    "p_b": Channel("p_b", 40.0, 0.0, "bar", "(3.2), Parker SCP01: 0 to 10 V for 0 to 400 bar"),
}


def read_points(texts: Iterable[str]) -> dict[str, list[tuple[float, float]]]:
    """Measured points ``spool=3.248 V:2.6 mm`` as signal -> [(V, value in the signal's log unit)].

    Raises:
        UsageError: a text cannot be read, or names no signal.
    """
    found: dict[str, list[tuple[float, float]]] = {}
    for text in texts:
        name, equals, pair = text.partition("=")
        voltage, colon, value = pair.partition(":")
        name = name.strip()
        if not equals or not colon:
            raise UsageError(
                f"--point '{text}' should read signal=voltage:value, such as 'spool=3.248 V:2.6 mm'"
            )
        if name not in SIGNALS or name in ("time", "p_load"):
            raise UsageError(
                f"--point '{text}': '{name}' is no signal of a log: {', '.join(sorted(SIGNALS))}"
            )
        found.setdefault(name, []).append(
            (parse_quantity(voltage, "V"), parse_quantity(value, SIGNALS[name].unit))
        )
    return found


def calibrate(signal: str, points: Iterable[tuple[float, float]]) -> Channel:
    """Gain and zero of a channel from measured points, by least squares.

    Args:
        signal: its name.
        points: (voltage [V], value in the signal's log unit); from three on, gain and zero have intervals.

    Raises:
        UsageError: there are fewer than two different voltages, or the values do not change with them.
    """
    pairs = tuple(points)
    volts, values = (np.array([p[i] for p in pairs]) for i in (0, 1))
    if len(pairs) < 2 or np.ptp(volts) == 0.0:
        raise UsageError(
            f"the scaling of '{signal}' needs two points at different voltages: give --point twice or more"
        )
    basis = np.column_stack([volts, np.ones(volts.size)])
    (gain, offset), *_ = np.linalg.lstsq(basis, values, rcond=None)
    if np.ptp(values) == 0.0:
        raise UsageError(
            f"the points of '{signal}' have one value at all voltages: there is no scaling between them"
        )
    zero, unit, errors = -offset / gain, SIGNALS[signal].unit, None
    freedom = volts.size - 2
    if freedom > 0:
        rest = values - basis @ np.array([gain, offset])
        covariance = float(rest @ rest) / freedom * np.linalg.inv(basis.T @ basis)
        slope = np.array([offset / gain**2, -1.0 / gain])
        errors = (
            Quantity(float(gain), float(np.sqrt(covariance[0, 0])), freedom, f"{unit}/V"),
            Quantity(float(zero), float(np.sqrt(slope @ covariance @ slope)), freedom, "V"),
        )
    return Channel(signal, float(gain), float(zero), unit, f"{len(pairs)} measured points", pairs, errors)


def wire_over_disc(radius: float, zero: float = 0.0) -> Channel:
    """The slew sensor: a draw-wire, 0 to 10 V for 15 m, over a disc of `radius` [m]; `zero` is the voltage [V] at 0 deg.

    Raises:
        UsageError: the radius is not positive.
    """
    if not radius > 0.0:
        raise UsageError(f"a disc of radius {radius:g} m does not exist: give it as --disc-radius '200 mm'")
    gain = np.rad2deg(WIRE_TRAVEL * 1e-3 / WIRE_VOLTAGE / radius)
    return Channel(
        "slew", float(gain), zero, "deg", "(3.2), ASM WS17KT: 0 to 10 V for 15000 mm, over the disc"
    )


def mapping_text(
    channels: Mapping[str, Channel], columns: Mapping[str, str], time: str, time_unit: str
) -> str:
    """A mapping file (TOML) that reads a log in volts.

    Args:
        channels: how each signal is scaled.
        columns: signal -> column.
        time: column of the time.
        time_unit: its unit.
    """
    lines = ["[time]", f"column = {_quoted(time)}", f"unit = {_quoted(time_unit)}"]
    for signal, column in columns.items():
        c = channels[signal]
        lines += [
            "",
            f"# {c.source}",
            f"[signals.{signal}]",
            f"column = {_quoted(column)}",
            f"unit = {_quoted(c.unit)}",
        ]
        lines += [f"gain = {c.gain!r}", f"zero = {c.zero!r}"]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def volt_columns(labels: Iterable[tuple[str, str | None]], source: str) -> dict[str, str]:
    """The columns of a log that are a signal in volts: signal -> column.

    Args:
        labels: name and unit of each column.
        source: the file, for messages.

    Raises:
        DataError: there is none.
    """
    found = {}
    for name, unit in labels:
        if unit is None or name not in SIGNALS:
            continue
        try:
            scale = conversion(unit, "V")
        except UsageError:
            continue
        if scale != 1.0:
            raise DataError(
                f"{source}: column '{name} [{unit}]': give it in V, or its points in the same unit"
            )
        found[name] = name
    if not found:
        raise DataError(
            f"{source}: no column is a signal in volts, such as 'spool [V]': name the columns with --column spool='Ch 3'"
        )
    return found
