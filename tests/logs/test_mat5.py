"""MAT files of version 5 to 7 that the library would crash on are refused before it sees them."""

import struct

import numpy as np
import pytest
from scipy.io import savemat

from cosim.errors import DataError
from cosim.logs import load_log
from cosim.logs.mat5 import DEEPEST, check_elements

HEAD = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
EMPTY = struct.pack("<II", 14, 0)


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(kind, *content, dims=(1, 1), flags=0):
    head = element(6, struct.pack("<II", kind | flags, 0)) + element(5, struct.pack(f"<{len(dims)}i", *dims))
    return element(14, head + element(1, b"x") + b"".join(content))


@pytest.fixture
def sound(tmp_path):
    """A log with a struct, a cell, texts and complex numbers beside it."""
    path = tmp_path / "log.mat"
    time = np.arange(50) / 1000
    content = {"time": time, "slew": np.sin(time), "units": {"time": "s", "slew": "rad"}}
    content |= {"more": np.array(["a", np.eye(2)], dtype=object), "spectrum": np.exp(1j * time)}
    return path, content


@pytest.mark.parametrize("packed", [False, True])
def test_what_is_whole_passes(sound, packed):
    path, content = sound
    savemat(path, content, oned_as="column", do_compression=packed)
    check_elements(path)
    assert len(load_log(path)) == 50


def test_numbers_of_a_type_that_there_is_not(sound):
    path, content = sound
    savemat(path, {name: content[name] for name in ("time", "slew")}, oned_as="column")
    data = path.read_bytes()
    at = data.index(struct.pack("<II", 9, 400))  # the tag of 50 doubles
    for kind in [0, 8, 10, 11, *range(14, 256), 0xFFFF]:
        path.write_bytes(data[:at] + struct.pack("<I", kind) + data[at + 4 :])
        with pytest.raises(DataError, match=f"an element of type {kind} where numbers belong|is damaged"):
            load_log(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (matrix(6, element(14, bytes(8))), "type 14 where numbers belong"),
        (matrix(19, element(9, bytes(8))), "no matrices of class 19"),
        (matrix(1, EMPTY, dims=(1, -1)), "a dimension is negative"),
        (matrix(1, EMPTY, dims=(1, 2)), "it ends early"),
        (matrix(1, element(9, bytes(8))), "type 9 where a matrix belongs"),
        (
            matrix(2, element(5, struct.pack("<i", 0)), element(1, b"ab")),
            "names of its fields have no length",
        ),
        (
            matrix(2, element(5, struct.pack("<i", -1)), element(1, b"ab")),
            "names of its fields have no length",
        ),
        (matrix(6, struct.pack("<I", 9 | 5 << 16), bytes(4)), "5 bytes in a tag that holds 4"),
        (element(9, bytes(8)), "of type 9, no matrix"),
        (struct.pack("<II", 14, 4000), "it has 4000 bytes, the file 0 more"),
        (element(15, b"no zlib at all"), "decompressing"),
    ],
)
def test_what_cannot_stand_there_is_told(tmp_path, content, message):
    path = tmp_path / "bad.mat"
    path.write_bytes(HEAD + content)
    with pytest.raises(DataError, match=message):
        check_elements(path)


def test_matrices_within_matrices_have_an_end(tmp_path):
    path, nested = tmp_path / "deep.mat", matrix(6, element(9, bytes(8)))
    for _ in range(DEEPEST + 1):
        nested = matrix(1, nested)
    path.write_bytes(HEAD + nested)
    with pytest.raises(DataError, match=f"more than {DEEPEST} matrices"):
        load_log(path)
