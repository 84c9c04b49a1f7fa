"""Datagrams to numbers and back: 7 float32 from the crane, 6 to it."""

import math
import struct
from typing import NamedTuple

from cosim.live.layout import COMMANDS, SENSORS, Layout
from cosim.logs.source import parse_label
from cosim.signals import SIGNALS, conversion

SYNTHETIC_MARK = 20190.25
"""What our own crane sends in the values that the layout leaves free, so that a log of it says that it is synthetic."""


class Channel(NamedTuple):
    """One value of a datagram from the crane.

    Attributes:
        place: among the 7.
        name: of the signal or column.
        unit: in which it is logged.
        scale: from the datagram's unit to that.
        low, high: what the instrument can show, in `unit`.
    """

    place: int
    name: str
    unit: str
    scale: float
    low: float
    high: float


def _channels(layout: Layout) -> tuple[list[Channel], list[int]]:
    """What is logged, and the places that the layout leaves free."""
    found, free = [], []
    for place, text in enumerate(layout.from_crane):
        label = parse_label(text)
        if label.name in SENSORS:
            signal = SIGNALS[label.name]
            bounds = (signal.low / signal.to_si, signal.high / signal.to_si)
            found.append(
                Channel(place, label.name, signal.unit, conversion(label.unit or "", signal.unit), *bounds)
            )
        elif label.unit is not None:
            largest = 3.4028234663852886e38
            found.append(Channel(place, label.name, label.unit, 1.0, -largest, largest))
        else:
            free.append(place)
    return found, free


class Sample(NamedTuple):
    """What a datagram of the crane says.

    Attributes:
        values: of each channel in the log's unit, None where it is no number or beyond the instrument.
        nan: values that are NaN or infinite.
        beyond: values that are beyond the instrument.
        synthetic: it carries our rig's mark.
    """

    values: tuple[float | None, ...]
    nan: int
    beyond: int
    synthetic: bool


class Codec:
    """Reads and writes the datagrams of a layout.

    Attributes:
        channels: the values that are logged, in the order of a log's columns, then those of the layout's own names.
        from_size, to_size: bytes of a datagram: 28 and 24.
    """

    def __init__(self, layout: Layout) -> None:
        sign = "<" if layout.byte_order == "little" else ">"
        self._from, self._to = struct.Struct(sign + "7f"), struct.Struct(sign + "6f")
        channels, self._free = _channels(layout)
        own = [c for c in channels if c.name not in SENSORS]
        self.channels = sorted((c for c in channels if c.name in SENSORS), key=_column) + own
        self._order = [layout.to_crane.index(name) for name in COMMANDS]
        self._names = [COMMANDS.index(name) for name in layout.to_crane]
        self.from_size, self.to_size = self._from.size, self._to.size

    def read_sample(self, payload: bytes) -> Sample:
        """A datagram of the crane; `payload` has `from_size` bytes."""
        raw = self._from.unpack(payload)
        values: list[float | None] = []
        nan = beyond = 0
        for place, _, _, scale, low, high in self.channels:
            value = scale * raw[place]
            if low <= value <= high:  # false for NaN
                values.append(value)
                continue
            values.append(None)
            if math.isfinite(value):
                beyond += 1
            else:
                nan += 1
        free = self._free
        return Sample(tuple(values), nan, beyond, bool(free) and all(raw[k] == SYNTHETIC_MARK for k in free))

    def write_sample(self, values: tuple[float, ...]) -> bytes:
        """A datagram with these values of the channels, in the log's units; the free places carry the mark."""
        raw = [SYNTHETIC_MARK] * 7
        for channel, value in zip(self.channels, values, strict=True):
            raw[channel.place] = value / channel.scale
        return self._from.pack(*raw)

    def write_command(self, values: tuple[float, ...]) -> bytes:
        """A datagram with u1, u2, u3 and the three enables."""
        return self._to.pack(*(values[k] for k in self._names))

    def read_command(self, payload: bytes) -> tuple[float, ...]:
        """u1, u2, u3 and the three enables of a datagram of `to_size` bytes."""
        raw = self._to.unpack(payload)
        return tuple(raw[k] for k in self._order)


def _column(channel: Channel) -> int:
    return SENSORS.index(channel.name)


def single(value: float) -> float:
    """`value` as the float32 that goes out."""
    rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    return rounded
