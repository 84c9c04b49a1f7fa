"""Files of measurement channels that each have a clock: ASAM MDF 4 (.mf4) and LabVIEW TDMS (.tdms)."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import DataError, MissingExtraError
from cosim.logs.source import Array, Label, Source, parse_label, translated

DEFLATE = 1032  # times that its data can be longer than what is compressed
VIRTUAL = (3, 6)  # channels of MDF 4 that are counted, not recorded
FLOATS, FLOAT_BITS = (4, 5), (16, 32, 64)  # of MDF 4


class MdfSource(Source):
    """An MDF file (.mf4, .mdf), through asammdf.

    Raises:
        MissingExtraError: asammdf is not installed.
        DataError: the file is damaged or has no channel.
    """

    row_word = "sample"

    def __init__(self, path: Path) -> None:
        try:
            from asammdf import MDF
        except ImportError:
            raise MissingExtraError(f"reading {path.name}", "mf4") from None
        notes: list[str] = []
        with translated(path, "MDF", notes):
            opened: Any = MDF(path)  # its groups' attributes are set at run time
            with opened as file:
                _check_structure(path, file)
                self._places = [
                    (g, c)
                    for g, group in enumerate(file.groups)
                    for c in range(len(group.channels))
                    if c != file.masters_db.get(g)
                ]
                heads = [(file.groups[g].channels[c].name, _mdf_unit(file, g, c)) for g, c in self._places]
        if not heads:
            raise DataError(f"{path}: holds no channel")
        super().__init__(path, [parse_label(name, unit) for name, unit in heads])
        self.warnings += notes
        self._clocks: dict[int, Array] = {}

    def read(self, indices: Sequence[int]) -> list[Array]:
        """See `Source.read`."""
        from asammdf import MDF

        columns = []
        with translated(self.path, "MDF", self.warnings), MDF(self.path) as file:
            for k in indices:
                group, channel = self._places[k]
                signal = file.get(group=group, index=channel)
                columns.append(_float_copy(self, k, signal.samples))
                self._clocks[k] = np.array(signal.timestamps, dtype=np.float64)
        return columns

    def clock(self, index: int) -> Array | None:
        """See `Source.clock`."""
        if index not in self._clocks:
            self.read([index])
        return self._clocks[index]


def _check_structure(path: Path, file: Any) -> None:
    """Refuses what the library takes in silence, or cannot survive.

    - A group that claims more than its file can hold: it would make room, for minutes.
    - A channel outside its group's records: it would read memory that is not the file's.
    - A channel that is named in the file and was not read, as one of an unknown type is: of a clock it would count samples.
    - A channel of no bits, or of a float of so many as no float has: it would give zeros.

    Raises:
        DataError: so it is.
    """
    most = DEFLATE * path.stat().st_size
    for number, group in enumerate(file.groups, 1):
        about = group.channel_group
        record = about.samples_byte_nr + getattr(about, "invalidation_bytes_nr", 0)
        if record * max(about.cycles_nr, 1) > most:
            raise DataError(
                f"{path}: cannot be read as an MDF file: group {number} claims {about.cycles_nr} records of {record} bytes,"
                " more than the file can hold"
            )
        if not _complete(group):
            raise DataError(
                f"{path}: cannot be read as an MDF file: group {number} names a channel that is none, or of no known type"
            )
        for channel in group.channels:
            begin, size = _place(channel)
            odd = channel.data_type in FLOATS and size not in FLOAT_BITS and hasattr(channel, "byte_offset")
            if channel.channel_type not in VIRTUAL and (size == 0 or odd):
                raise DataError(
                    f"{path}: cannot be read as an MDF file: channel '{channel.name}' has numbers of {size} bits"
                )
            if begin + size > 8 * about.samples_byte_nr and channel.channel_type not in VIRTUAL:
                raise DataError(
                    f"{path}: cannot be read as an MDF file: channel '{channel.name}' lies at byte {begin // 8} of records"
                    f" of {about.samples_byte_nr} bytes"
                )


def _complete(group: Any) -> bool:
    """Whether every channel of a group of MDF 4 that the file names was read."""
    if not hasattr(group.channel_group, "first_ch_addr"):
        return True
    read = {channel.address for channel in group.channels}
    return {
        group.channel_group.first_ch_addr,
        *(channel.next_ch_addr for channel in group.channels),
    } <= read | {0}


def _place(channel: Any) -> tuple[int, int]:
    """First bit in the record and number of bits of a channel of MDF 4, or of MDF 2 and 3."""
    if hasattr(channel, "byte_offset"):
        return 8 * channel.byte_offset + channel.bit_offset, channel.bit_count
    beyond = getattr(channel, "additional_byte_offset", 0)
    return channel.start_offset + 8 * beyond, channel.bit_count


def _mdf_unit(file: Any, group: int, channel: int) -> str:
    return str(file.get_channel_unit(group=group, index=channel) or "")


class TdmsSource(Source):
    """A TDMS file, through npTDMS; channels with a waveform's start and increment have their clock from it.

    Raises:
        MissingExtraError: npTDMS is not installed.
        DataError: the file is damaged or has no channel.
    """

    row_word = "sample"

    def __init__(self, path: Path) -> None:
        try:
            from nptdms import TdmsFile
        except ImportError:
            raise MissingExtraError(f"reading {path.name}", "tdms") from None
        notes: list[str] = []
        with translated(path, "TDMS", notes):
            self._channels = [
                channel for group in TdmsFile.read(path).groups() for channel in group.channels()
            ]
        if not self._channels:
            raise DataError(f"{path}: holds no channel")
        groups = Counter(channel.group_name for channel in self._channels)
        labels = []
        for channel in self._channels:
            unit = str(channel.properties.get("unit_string", ""))
            prefix = f"{channel.group_name}/" if len(groups) > 1 else ""
            labels.append(parse_label(channel.name, unit, prefix))
        super().__init__(path, labels)
        self.warnings += notes

    def read(self, indices: Sequence[int]) -> list[Array]:
        """See `Source.read`."""
        with translated(self.path, "TDMS"):
            return [_float_copy(self, k, self._channels[k][:]) for k in indices]

    def clock(self, index: int) -> Array | None:
        """See `Source.clock`."""
        channel = self._channels[index]
        if "wf_increment" not in channel.properties:
            return None
        with translated(self.path, "TDMS"):
            return np.asarray(channel.time_track(), dtype=np.float64)


def _float_copy(source: Source, index: int, values: Any) -> Array:
    label: Label = source.labels[index]
    samples = np.asarray(values)
    if samples.dtype.kind not in "fiub" or samples.ndim != 1:
        raise DataError(f"{source.path}: channel '{label.text}' holds no plain numbers")
    return samples.astype(np.float64)
