"""What the HDF5 library does not check in a damaged file: a heap entry without length is an endless loop there."""

import mmap
from pathlib import Path

from cosim.errors import DataError

_HEAP, _ENTRY = 16, 16  # bytes of the headers


def check_heaps(path: Path) -> None:
    """Walks the entries of every global heap, as H5HG__cache_heap_deserialize does; other files pass.

    Raises:
        DataError: an entry has no length, or one that leads out of its heap.
    """
    with path.open("rb") as stream:
        if b"\x89HDF\r\n\x1a\n" not in stream.read(1024):
            return
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            at = data.find(b"GCOL\x01\0\0\0")
            while at >= 0:
                if not _sound(data, at):
                    raise DataError(f"{path}: cannot be read as a MAT file: the heap at byte {at} is damaged")
                at = data.find(b"GCOL\x01\0\0\0", at + 1)


def _sound(data: mmap.mmap, at: int) -> bool:
    end = at + _number(data, at + 8)
    if end > len(data):
        return False
    place = at + _HEAP
    while place + _ENTRY <= end:
        index, size = int.from_bytes(data[place : place + 2], "little"), _number(data, place + 8)
        length = _ENTRY + -(-size // 8) * 8 if index else size  # free space counts its own header
        if length == 0 or place + length > end:
            return False
        place += length
    return True


def _number(data: mmap.mmap, at: int) -> int:
    return int.from_bytes(data[at : at + 8], "little")
