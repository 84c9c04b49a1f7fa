"""What the library for MAT files of version 5 to 7 does not check: a wrong type of numbers ends the process.

It looks the type up in a table by the number that stands in the file. Here the file is walked before the library sees it,
in the order in which it reads ("MAT-File Level 5 File Format", The MathWorks).
"""

import os
import struct
import zlib
from pathlib import Path
from typing import BinaryIO, Protocol

from cosim.errors import DataError

HEADER = 128  # bytes
NUMBERS = frozenset(
    (1, 2, 3, 4, 5, 6, 7, 9, 12, 13)
)  # types of elements: integers of 8 to 64 bit, single, double
MATRIX, COMPRESSED = 14, 15
CELL, STRUCT, OBJECT, CHARACTERS, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NUMERIC = range(6, 16)  # classes of matrices
COMPLEX = 0x800
DEEPEST = 100  # matrices within each other: the library calls itself
MOST_DIMENSIONS = 32
BLOCK = 1 << 20


class _DamagedError(Exception):
    """The file cannot be what it says; the text says why."""


class _Stream(Protocol):
    def take(self, count: int) -> bytes: ...

    def skip(self, count: int) -> None: ...


def check_elements(path: Path) -> None:
    """Walks every element of a MAT file of version 5 to 7; other files pass.

    Raises:
        DataError: an element is of a type that cannot stand there, or leads out of the file.
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(HEADER)
        if len(head) < HEADER or head[126:] not in (b"IM", b"MI"):
            return
        order = "<" if head[126:] == b"IM" else ">"
        if struct.unpack(f"{order}H", head[124:126])[0] != 0x0100:
            return
        size = os.fstat(file.fileno()).st_size
        while file.tell() < size:
            at = file.tell()
            try:
                _variable(file, size, order)
            except _DamagedError as error:
                raise DataError(
                    f"{path}: cannot be read as a MAT file: the variable at byte {at} is damaged ({error})"
                ) from None


def _variable(file: BinaryIO, size: int, order: str) -> None:
    """Walks the variable at the file's place and goes on to the next."""
    plain = _Plain(file, size)
    kind, count = struct.unpack(f"{order}II", plain.take(8))
    end = file.tell() + count
    if end > size:
        raise _DamagedError(f"it has {count} bytes, the file {size - file.tell()} more")
    walk = _Walk(_Packed(file, end) if kind == COMPRESSED else plain, order)
    if kind == COMPRESSED:
        kind, count = walk.full_tag()
    if kind != MATRIX:
        raise _DamagedError(f"it is of type {kind}, no matrix")
    if count:
        walk.content(0)
    file.seek(end)


class _Plain:
    """Bytes of a file up to an end."""

    def __init__(self, file: BinaryIO, end: int) -> None:
        self._file, self._end = file, end

    def take(self, count: int) -> bytes:
        data = self._file.read(count)
        if len(data) < count:
            raise _DamagedError("it ends early")
        return data

    def skip(self, count: int) -> None:
        if self._file.seek(count, os.SEEK_CUR) > self._end:
            raise _DamagedError("it ends early")


class _Packed:
    """What is compressed in a file up to an end, unpacked block by block."""

    def __init__(self, file: BinaryIO, end: int) -> None:
        self._file, self._end = file, end
        self._packed = zlib.decompressobj()
        self._ready = b""

    def take(self, count: int) -> bytes:
        while len(self._ready) < count:
            self._ready += self._more()
        found, self._ready = self._ready[:count], self._ready[count:]
        return found

    def skip(self, count: int) -> None:
        while len(self._ready) < count:
            count -= len(self._ready)
            self._ready = self._more()
        self._ready = self._ready[count:]

    def _more(self) -> bytes:
        try:
            while True:
                data = self._packed.unconsumed_tail or self._file.read(
                    min(BLOCK, self._end - self._file.tell())
                )
                if not data or self._packed.eof:
                    raise _DamagedError("it ends early")
                if unpacked := self._packed.decompress(data, BLOCK):
                    return unpacked
        except zlib.error as error:
            raise _DamagedError(str(error)) from None


class _Walk:
    """Walks a variable."""

    def __init__(self, stream: _Stream, order: str) -> None:
        self._stream, self._order = stream, order

    def content(self, depth: int) -> None:
        """A matrix after its tag."""
        if depth > DEEPEST:
            raise _DamagedError(f"more than {DEEPEST} matrices within each other")
        flags = struct.unpack(f"{self._order}4I", self._stream.take(16))[2]
        kind = flags & 0xFF
        if kind == OPAQUE:
            for _ in ("name", "system of types", "class"):
                self._element()
            self._matrix(depth)
            return
        sizes = self._integers(4 * MOST_DIMENSIONS)
        if min(sizes, default=0) < 0:
            raise _DamagedError("a dimension is negative")
        count = 1
        for size in sizes:
            count *= size
        self._element()  # its name
        if kind == OBJECT:
            self._element()  # of its class
        if kind in NUMERIC or kind == SPARSE:
            for _ in range((3 if kind == SPARSE else 1) + bool(flags & COMPLEX)):
                self._numbers()
        elif kind == CHARACTERS:
            self._element()
        elif kind == FUNCTION:
            self._matrix(depth)
        elif kind in (CELL, STRUCT, OBJECT):
            for _ in range(count * (1 if kind == CELL else self._fields())):
                self._matrix(depth)
        else:
            raise _DamagedError(f"there are no matrices of class {kind}")

    def full_tag(self) -> tuple[int, int]:
        """Type and bytes of what follows."""
        kind, count = struct.unpack(f"{self._order}II", self._stream.take(8))
        return kind, count

    def _matrix(self, depth: int) -> None:
        kind, count = self.full_tag()
        if kind != MATRIX:
            raise _DamagedError(f"an element of type {kind} where a matrix belongs")
        if count:
            self.content(depth + 1)

    def _fields(self) -> int:
        """Number of fields of a structure."""
        length = self._integers(4)
        if len(length) != 1 or length[0] < 1:
            raise _DamagedError("the names of its fields have no length")
        _, count = self._element()
        return count // length[0]

    def _integers(self, most: int) -> tuple[int, ...]:
        kind, count, small = self._tag()
        if kind not in (5, 6) or count > most:
            raise _DamagedError(f"{count} bytes of type {kind} where 32-bit integers belong")
        data = self._stream.take(4 if small else -(-count // 8) * 8)
        return struct.unpack(f"{self._order}{count // 4}i", data[: count // 4 * 4])

    def _numbers(self) -> None:
        kind, _ = self._element()
        if kind not in NUMBERS:
            raise _DamagedError(f"an element of type {kind} where numbers belong")

    def _element(self) -> tuple[int, int]:
        """Type and bytes of an element, which is passed over."""
        kind, count, small = self._tag()
        if not small:
            self._stream.skip(-(-count // 8) * 8)
        else:
            self._stream.take(4)
        return kind, count

    def _tag(self) -> tuple[int, int, bool]:
        """Type, bytes, and whether they stand in the tag itself."""
        (first,) = struct.unpack(f"{self._order}I", self._stream.take(4))
        if first >> 16:
            if first >> 16 > 4:
                raise _DamagedError(f"{first >> 16} bytes in a tag that holds 4")
            return first & 0xFFFF, first >> 16, True
        return first, struct.unpack(f"{self._order}I", self._stream.take(4))[0], False
